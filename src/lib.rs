//! Yester: temporal reprojection and denoising of rendered frames.
//!
//! A frame flows through the kernels in the order of their folders:
//!
//! ```text
//!   numpy ── bindings ──► planar views                          arrays are checked and taken apart, once
//!   camera   jitter ► motion_vectors ► dilate_motion            where was each pixel's surface,
//!            virtual_motion                                     and what it reflects?
//!   fetch    reproject                                          history, brought here tap by tap,
//!            splat ► pull_push                                  or point by point, its holes filled
//!   judge    consistency, disocclusion, thin_features,          what shows another surface or light is refused,
//!            exposure ► clip_history, alternation ► anti_lag,
//!            temporal_gradient, prediction_gain ► blend_factor, or counts for less,
//!            innovation, choice                                 or is corrected; the best of several is chosen
//!   merge    resample ► accumulate, blend, recirculate, resolve new samples join the history that is left
//!   smooth   suppress_fireflies, fix_history, reconstruct,      what noise remains
//!            estimate_variance ► atrous, regress,               is averaged in space,
//!            morphological_aa, joint_bilateral_upsample,        and what was not traced is filled
//!            sharpen
//!   numpy ◄─ bindings ─── planar images
//! ```
//!
//! `demodulate` and `remodulate` take the texture off before and put it back after; `morphological_aa` smooths the edges
//! of an image that has no history. [`pipelines`] are lists of these kernels that keep the history; [`rows`] runs them
//! all, on every core and with the instructions that the CPU has.

pub mod bindings;
pub mod bordered;
pub mod error;
pub mod image;
pub mod kernels;
pub mod lanes;
pub mod limits;
pub mod math;
pub mod memory;
pub mod pipelines;
pub mod pixels;
pub mod rows;

use pyo3::prelude::*;

/// The compiled half of `yester`; its public names are re-exported there.
#[pymodule(gil_used = false)]
mod _core {
    use super::*;

    #[pymodule_export]
    use bindings::arrays::canonical;
    #[pymodule_export]
    use bindings::camera::{Camera, dilate_motion, jitter_, motion_vectors, virtual_motion_};
    #[pymodule_export]
    use bindings::fetch::reproject_;
    #[pymodule_export]
    use bindings::joint_bilateral::{joint_bilateral_upsample_, reconstruct_};
    #[pymodule_export]
    use bindings::judge::{
        alternation_, anti_lag_, blend_factor_, choice_, clip_history_, consistency_, exposure_,
        innovation_, prediction_gain, temporal_gradient,
    };
    #[pymodule_export]
    use bindings::merge::{Accumulated, accumulate_, blend_, resolve_};
    #[pymodule_export]
    use bindings::pipelines::bmfr::BMFR;
    #[pymodule_export]
    use bindings::pipelines::half_res::HalfRes;
    #[pymodule_export]
    use bindings::pipelines::recirculation::Recirculation;
    #[pymodule_export]
    use bindings::pipelines::svgf::SVGF;
    #[pymodule_export]
    use bindings::pipelines::taa::TAA;
    #[pymodule_export]
    use bindings::pipelines::upscaler::Upscaler;
    #[pymodule_export]
    use bindings::pipelines::{Output, Pipeline};
    #[pymodule_export]
    use bindings::regress::regress_;
    #[pymodule_export]
    use bindings::scatter::{pull_push_, recirculate_, splat_};
    #[pymodule_export]
    use bindings::smooth::{
        atrous_, demodulate_, estimate_variance_, fix_history_, morphological_aa_, remodulate_,
        suppress_fireflies_,
    };
    #[pymodule_export]
    use bindings::upscale::{disocclusion_, resample_, sharpen_, thin_features_};
    #[pymodule_export]
    use bindings::{machine_limits, settings};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        rows::Settings::from_environment()?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
