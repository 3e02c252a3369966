//! Combine in time.

pub mod accumulate;
