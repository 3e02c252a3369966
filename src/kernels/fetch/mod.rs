//! Bring history here.

pub mod footprint;
pub mod reproject;
