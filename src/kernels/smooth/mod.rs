//! Combine in space.

pub mod atrous;
pub mod demodulate;
pub mod edges;
pub mod fireflies;
pub mod guide;
pub mod history_fix;
pub mod joint_bilateral;
pub mod lend;
pub mod material;
pub mod morphological;
pub mod reflectance;
pub(crate) mod regions;
pub mod regress;
pub mod restore;
pub mod sharpen;
pub mod variance;
