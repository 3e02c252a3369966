//! Combine in space.

pub mod atrous;
pub mod demodulate;
pub mod guide;
pub mod variance;
