//! Python bindings, numpy in, numpy out: a file or a few for each folder of kernels, and one for each pipeline. Every argument
//! is checked once, here or in a kernel's `Params::check`. Kernels run without the interpreter's lock.

// Classes have the names that Python has.
#![allow(clippy::upper_case_acronyms)]
// Comments of what Python sees are its docstrings: reStructuredText, not Markdown.
#![allow(clippy::doc_lazy_continuation)]

mod arrays;
mod camera;
mod evidence;
mod fetch;
mod joint_bilateral;
mod judge;
mod limits;
mod merge;
mod pipelines;
mod regress;
mod scatter;
mod smooth;
mod upscale;
mod validate;

use pyo3::prelude::*;

use crate::bindings::arrays::detached;
use crate::rows::Settings;

/// The compiled half of `yester`; its public names are re-exported there.
#[pymodule(gil_used = false)]
mod _core {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::arrays::canonical;
    #[pymodule_export]
    use super::camera::{
        Camera, depth_change_, dilate_motion, invert_motion_, jitter_, motion_vectors,
        virtual_motion_,
    };
    #[pymodule_export]
    use super::evidence::{
        choice_, collocate_, collocation_shares, compare_candidates, prediction_gain, repetition_,
    };
    #[pymodule_export]
    use super::fetch::reproject_;
    #[pymodule_export]
    use super::joint_bilateral::{joint_bilateral_upsample_, reconstruct_};
    #[pymodule_export]
    use super::judge::{
        alternation_, anti_lag_, blend_factor_, clip_history_, exposure_, incoherent_guides_,
        innovation_, light_change_, material_change_, temporal_gradient,
    };
    #[pymodule_export]
    use super::merge::{Accumulated, accumulate_, blend_, combine_histories, converge_, resolve_};
    #[pymodule_export]
    use super::pipelines::bmfr::BMFR;
    #[pymodule_export]
    use super::pipelines::half_res::HalfRes;
    #[pymodule_export]
    use super::pipelines::recirculation::Recirculation;
    #[pymodule_export]
    use super::pipelines::svgf::SVGF;
    #[pymodule_export]
    use super::pipelines::taa::TAA;
    #[pymodule_export]
    use super::pipelines::upscaler::Upscaler;
    #[pymodule_export]
    use super::pipelines::{History, Output, Pipeline, collect_warnings};
    #[pymodule_export]
    use super::regress::regress_;
    #[pymodule_export]
    use super::scatter::{pull_push_, recirculate_, splat_};
    #[pymodule_export]
    use super::smooth::{
        atrous_, demodulate_, estimate_variance_, fix_history_, is_reflectance_, material_ids_,
        morphological_aa_, remodulate_, restore_detail_, smooth_edges_, suppress_fireflies_,
    };
    #[pymodule_export]
    use super::upscale::{disocclusion_, resample_, sharpen_, thin_features_};
    #[pymodule_export]
    use super::validate::consistency_;
    #[pymodule_export]
    use super::{machine_limits, settings};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}

/// Return the number of threads and the instruction set of the kernels.
///
/// Returns
/// -------
/// threads : int
///     Those of the machine, unless lowered by ``YESTER_THREADS``.
/// level : str
///     The best that the machine has, unless lowered by ``YESTER_SIMD``.
#[pyfunction]
fn settings() -> PyResult<(usize, &'static str)> {
    let settings = Settings::from_environment()?;
    Ok((settings.threads, settings.level_name()))
}

/// Measure the roofline of this machine, with the current threads and instruction set.
///
/// Returns
/// -------
/// bandwidth : float
///     Bytes per second that a copy reads and writes.
/// arithmetic : float
///     Multiply-adds per second.
#[pyfunction]
fn machine_limits(py: Python<'_>) -> PyResult<(f64, f64)> {
    detached(py, limits::limits)
}
