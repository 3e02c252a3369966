//! Where was this point?

pub mod depth_change;
pub mod dilate;
pub mod jitter;
pub mod motion;
pub mod parallax;
pub mod pinhole;
pub mod virtual_motion;
