//! Bring history here.

pub(crate) mod claims;
pub mod footprint;
pub mod invert;
pub mod pull_push;
pub mod reproject;
pub(crate) mod spans;
pub mod splat;
pub mod validate;
