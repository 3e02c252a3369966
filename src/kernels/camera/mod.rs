//! Where was this point?

pub mod motion;
pub mod pinhole;
