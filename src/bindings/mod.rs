//! numpy in, numpy out: one file per kernel folder and one for the pipelines. Every check of an argument is here or in
//! a kernel's `Params::check`, once; kernels run without the interpreter's lock.

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

/// The number of threads and the instruction set that kernels run with: what the machine has, lowered by
/// `YESTER_THREADS` and `YESTER_SIMD`.
#[pyfunction]
pub fn settings() -> PyResult<(usize, &'static str)> {
    let settings = Settings::from_environment()?;
    Ok((settings.threads, settings.level_name()))
}

/// Bytes that a copy can read and write, and multiply-adds, per second: the limits of this machine, measured with the threads and
/// instructions in use.
#[pyfunction]
pub fn machine_limits(py: Python<'_>) -> (f64, f64) {
    py.detach(limits)
}
