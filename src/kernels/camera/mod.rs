//! Where was this point?

pub mod dilate;
pub mod motion;
pub mod pinhole;
