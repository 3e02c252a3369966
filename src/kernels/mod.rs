//! The building blocks, in folders that sort in the order in which data flows.

pub mod camera;
pub mod fetch;
pub mod judge;
pub mod merge;
pub mod smooth;
