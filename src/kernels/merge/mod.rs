//! Combine in time.

pub mod accumulate;
pub mod resolve;
