//! Pipelines: lists of kernels, each with the state that goes from frame to frame.
//!
//! | pipeline | what it makes of frames |
//! |---|---|
//! | [`Svgf`] | denoised ones; with [`svgf::Params::half_res`], of frames of which a part is traced |
//! | [`Bmfr`] | denoised ones, by regression |
//! | [`Taa`] | antialiased ones, of frames with little noise |
//! | [`Upscaler`] | larger ones, by what their jitter shows |
//! | [`Recirculation`] | whole ones, of frames of which a part is traced |
//!
//! All are used in the same way: see [`Pipeline`], [`Frame`] and [`Results`]. `Params::default()` is what the class of the
//! Python package has by default.

/// Shows the parameters of a pipeline: the rest is images.
macro_rules! debug_params {
    ($pipeline:ident, $($params:ident).+) => {
        impl std::fmt::Debug for $pipeline {
            fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.debug_struct(stringify!($pipeline))
                    .field("params", &self.$($params).+)
                    .finish_non_exhaustive()
            }
        }
    };
}

pub mod bmfr;
mod correction;
mod frame;
pub mod history;
mod illumination;
mod material_ids;
mod recall;
pub mod recirculation;
mod reflections;
mod repetition;
mod replay;
pub mod svgf;
pub mod taa;
pub mod upscaler;

pub use bmfr::Bmfr;
pub use frame::{Extras, Frame, History, HistoryMut, Mistake, Output, Pipeline, Results, Summary};
pub use recirculation::Recirculation;
pub use svgf::Svgf;
pub use taa::Taa;
pub use upscaler::Upscaler;
