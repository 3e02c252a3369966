//! How far is history trusted?

pub mod alternation;
pub mod anti_lag;
pub mod blend_factor;
pub(crate) mod boxes;
pub mod choice;
pub mod coherence;
pub mod collocation;
pub mod consistency;
pub mod disocclusion;
pub mod exposure;
pub mod gradient;
pub(crate) mod hull;
pub mod innovation;
pub mod light_change;
pub mod material_change;
pub mod neighborhood;
pub mod prediction;
pub mod repetition;
pub mod thin_features;
