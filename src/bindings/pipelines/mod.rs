//! The pipelines, and their base class.

pub mod bmfr;
mod frame;
pub mod half_res;
mod output;
pub mod recirculation;
pub mod svgf;
pub mod taa;
pub mod upscaler;

use std::sync::OnceLock;

use pyo3::PyClass;
use pyo3::exceptions::{PyDeprecationWarning, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::pyclass::boolean_struct::False;
use pyo3::types::{PyDict, PyTuple};

use self::frame::FrameArgs;
pub use self::output::{History, Output, collect_warnings};
use crate::pipelines;

/// Base class of pipelines, which process a sequence frame by frame.
///
/// The `repr` is the constructor call with the given parameters (``inf`` is `math.inf`). Copies (shallow or deep) and
/// unpickled objects are made by this call: they have the same parameters, no history, and start a new sequence.
///
/// Parameters
/// ----------
/// *_args, **_kwargs
///     Parameters of the pipeline, kept for `repr`, copies and pickles.
///
/// See Also
/// --------
/// SVGF : Denoises path-traced frames.
/// denoise : Runs a pipeline over a sequence, from both sides.
///
/// Examples
/// --------
/// >>> import copy
/// >>> pipeline = yester.SVGF(alpha=0.1)
/// >>> copy.copy(pipeline)
/// SVGF(alpha=0.1)
/// >>> isinstance(pipeline, yester.Pipeline)
/// True
#[pyclass(frozen, subclass, module = "yester")]
#[derive(Default)]
pub struct Pipeline {
    call: OnceLock<(Py<PyTuple>, Py<PyDict>)>,
}

#[pymethods]
impl Pipeline {
    /// Lets Python classes derive from this one.
    #[new]
    #[pyo3(signature = (*_args, **_kwargs))]
    fn new(_args: &Bound<'_, PyTuple>, _kwargs: Option<&Bound<'_, PyDict>>) -> Self {
        Self::default()
    }

    /// Stores the given parameters for `repr`, copies and pickles.
    #[pyo3(signature = (*args, **kwargs))]
    fn __init__(
        &self,
        args: &Bound<'_, PyTuple>,
        kwargs: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        let py = args.py();
        let kwargs = kwargs.map_or_else(|| PyDict::new(py), Clone::clone);
        let copies = py
            .import("copy")?
            .call_method1("deepcopy", ((args, kwargs),))?;
        // A second `__init__` must not change the parameters.
        let _ = self.call.set(copies.extract()?);
        Ok(())
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, ())> {
        let py = slf.py();
        let partial = py.import("functools")?.getattr("partial")?;
        let class = PyTuple::new(py, [slf.get_type()])?.into_sequence();
        let (args, kwargs) = slf.get().call(py);
        let args = class.concat(args.as_sequence())?.to_tuple()?;
        Ok((partial.call(args, Some(&kwargs))?, ()))
    }

    fn __repr__(slf: &Bound<'_, Self>) -> PyResult<String> {
        let (args, kwargs) = slf.get().call(slf.py());
        let mut parameters = vec![];
        for value in args {
            parameters.push(value.repr()?.to_string());
        }
        for (name, value) in kwargs {
            parameters.push(format!("{name}={}", value.repr()?));
        }
        Ok(format!(
            "{}({})",
            slf.get_type().name()?,
            parameters.join(", ")
        ))
    }
}

impl Pipeline {
    /// The base object; `__init__` fills in the parameters.
    fn made<M: pyo3::PyClass<BaseType = Self>>(method: M) -> PyClassInitializer<M> {
        PyClassInitializer::from(Self::default()).add_subclass(method)
    }

    fn call<'py>(&self, py: Python<'py>) -> (Bound<'py, PyTuple>, Bound<'py, PyDict>) {
        match self.call.get() {
            Some((args, kwargs)) => (args.bind(py).clone(), kwargs.bind(py).clone()),
            None => (PyTuple::empty(py), PyDict::new(py)),
        }
    }
}

/// A preset's current name; the former one is deprecated and works for one more release.
fn renamed<'a>(py: Python<'_>, preset: &'a str) -> PyResult<&'a str> {
    if preset != "seed" {
        return Ok(preset);
    }
    let category = py.get_type::<PyDeprecationWarning>();
    PyErr::warn(py, &category, c"preset: \"seed\" is now \"textbook\"", 1)?;
    Ok("textbook")
}

/// A denoiser and its output stage, if it has one.
type Parts<'py> = (Bound<'py, PyAny>, Option<Bound<'py, PyAny>>);

/// The pipeline without its output stage, and the stage.
fn split<'py>(
    pipeline: &Bound<'py, Pipeline>,
    params: &pipelines::svgf::Params,
    both_sides: bool,
) -> PyResult<Parts<'py>> {
    let py = pipeline.py();
    let (args, given) = pipeline.get().call(py);
    let named = given.copy()?;
    named.set_item("antialias", false)?;
    let denoiser = pipeline.get_type().call(args, Some(&named))?;
    let Some(stage) = &params.antialias else {
        return Ok((denoiser, None));
    };
    let changed = PyDict::new(py);
    if stage.clip.gamma != pipelines::taa::Params::DENOISED.clip.gamma {
        // The shortest decimal of single precision, as it was given.
        let gamma: f64 = (stage.clip.gamma.to_string().parse()).expect("a number");
        changed.set_item("gamma", gamma)?;
    }
    let unguided = pipelines::taa::Params::DENOISED.unguided_alpha;
    if !both_sides && stage.unguided_alpha != unguided {
        changed.set_item("unguided_alpha", stage.unguided_alpha)?;
    }
    if stage.guided_exposure != pipelines::taa::Params::DENOISED.guided_exposure {
        changed.set_item("guided_exposure", stage.guided_exposure)?;
    }
    if params.history.innovation.is_some() {
        changed.set_item("innovation", true)?;
    }
    if stage.choice != pipelines::taa::Params::DENOISED.choice {
        changed.set_item("choice", stage.choice)?;
    }
    let class = py.get_type::<taa::TAA>();
    let stage = class.call(("denoised",), Some(&changed))?;
    Ok((denoiser, Some(stage)))
}

/// A pipeline for the time of a call. Another thread may be in a step of it.
fn alone<'py, T: PyClass<Frozen = False>>(pipeline: &Bound<'py, T>) -> PyResult<PyRefMut<'py, T>> {
    pipeline.try_borrow_mut().map_err(|_| {
        let name = pipeline.as_any().get_type().name();
        let name = name.map_or_else(|_| "pipeline".into(), |name| name.to_string());
        PyRuntimeError::new_err(format!(
            "{name}: expected one thread at a time, got a call while another thread is in a step"
        ))
    })
}
