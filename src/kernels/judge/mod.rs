//! How far is history trusted?

pub mod consistency;
pub mod neighborhood;
pub mod surface;
