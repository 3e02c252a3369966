//! Yester: temporal reprojection and denoising of rendered frames.

pub mod bindings;
pub mod error;
pub mod image;
pub mod kernels;
pub mod math;
pub mod pipelines;
pub mod rows;

use pyo3::prelude::*;

/// The compiled half of `yester`; its public names are re-exported there.
#[pymodule(gil_used = false)]
mod _core {
    use super::*;

    #[pymodule_export]
    use bindings::arrays::canonical;
    #[pymodule_export]
    use bindings::camera::{Camera, motion_vectors};
    #[pymodule_export]
    use bindings::fetch::reproject_;
    #[pymodule_export]
    use bindings::judge::consistency_;
    #[pymodule_export]
    use bindings::merge::{Accumulated, accumulate_};
    #[pymodule_export]
    use bindings::pipelines::{Output, SVGF};
    #[pymodule_export]
    use bindings::smooth::{atrous_, demodulate_, estimate_variance_, remodulate_};

    #[pymodule_init]
    fn init(_module: &Bound<'_, PyModule>) -> PyResult<()> {
        rows::Settings::from_environment()?;
        Ok(())
    }
}
