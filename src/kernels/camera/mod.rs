//! Where was this point?

pub mod dilate;
pub mod jitter;
pub mod motion;
pub mod pinhole;
