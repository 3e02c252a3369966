//! Combine in time.

pub mod accumulate;
pub mod blend;
pub mod combine;
pub mod converge;
pub mod recirculate;
pub mod resample;
pub mod resolve;
