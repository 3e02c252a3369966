//! Python bindings, numpy in, numpy out: one file per kernel folder and one per pipeline. Every argument is checked
//! once, here or in a kernel's `Params::check`. Kernels run without the interpreter's lock.

pub mod arrays;
pub mod camera;
pub mod fetch;
pub mod joint_bilateral;
pub mod judge;
pub mod merge;
pub mod pipelines;
pub mod regress;
pub mod scatter;
pub mod smooth;
pub mod upscale;

use pyo3::prelude::*;

use crate::limits::limits;
use crate::rows::Settings;

/// The number of threads and the instruction set of the kernels: the machine's, unless lowered by `YESTER_THREADS` and
/// `YESTER_SIMD`.
#[pyfunction]
pub fn settings() -> PyResult<(usize, &'static str)> {
    let settings = Settings::from_environment()?;
    Ok((settings.threads, settings.level_name()))
}

/// Roofline of this machine, measured with the current threads and instruction set: bytes per second that a copy reads
/// and writes, and multiply-adds per second.
#[pyfunction]
pub fn machine_limits(py: Python<'_>) -> (f64, f64) {
    py.detach(limits)
}
