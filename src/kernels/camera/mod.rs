//! Where was this point?

pub mod dilate;
pub mod jitter;
pub mod motion;
pub mod parallax;
pub mod pinhole;
pub mod virtual_motion;
