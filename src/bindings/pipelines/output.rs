//! What steps write, and the histories that two sides of time join.

use std::cell::RefCell;
use std::ffi::CString;

use numpy::{Element, PyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::bindings::arrays::{COLOR, Channels, Direct, Input, Out, refuse_mask, wrong_type};
use crate::bindings::merge::MOMENTS;
use crate::error::{Error, whole};
use crate::image::{Size, Value};
use crate::pipelines::{self, Extras};

/// One denoised frame, with its auxiliary outputs.
///
/// Parameters
/// ----------
/// color : (H, W, 3) float32
///     Linear; finite everywhere.
/// history_length : (H, W) float32
///     Number of samples that each pixel's result is worth: at most 1/alpha from `step`, without limit while
///     `average_still` averages, both sides together from `denoise`; of `Upscaler`, samples per output pixel; of
///     `Recirculation`, the quality.
/// confidence : (H, W) float32
///     Accepted fraction of the history's footprint, 0 to 1; 0 where history was rejected (disocclusion).
/// rejection : (H, W) uint8
///     Bits of `Rejection`: the tests that taps of the footprint failed (one pixel for filter "nearest", else 2×2).
/// variance : (H, W) float32, optional
///     Estimated variance of the filtered luminance, before remodulation; None from pipelines without an estimate.
/// choice : (H, W) float32, optional
///     Number of filter passes of each pixel, fractional where two results are mixed; None from pipelines without a
///     choice.
/// motion : (H, W, 2) float32, optional
///     Motion for an output stage behind the pipeline, in pixels as `Frame.motion`: to where the frame before shows
///     what this one does. Where a reflection's history was taken and the luminance of albedo in 3×3 pixels is within a
///     tenth of the pixel's, that is the reflection's, elsewhere the surface's. None from pipelines that do not look
///     for reflections or have a stage of their own.
/// used : tuple of str, default ()
///     The buffers that were used: of "motion", "camera" (motion computed from cameras), "albedo", "emission",
///     "normal", "depth", "plane" (depth compared by plane distance), "ids", "position", "object_normal", "replay",
///     "hit_distance", "jitter" and "reactive".
/// missing : int, default 0
///     Pixels whose sample was not finite.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
/// TypeError
///     If an array has another dtype.
///
/// See Also
/// --------
/// SVGF.step : Returns an output.
/// Rejection : The bits of `rejection`.
///
/// Examples
/// --------
/// >>> output = yester.SVGF().step(yester.Frame(np.ones((4, 4, 3))))
/// >>> output
/// Output(4x4, used=(), missing=0)
#[pyclass(frozen, get_all, module = "yester")]
pub struct Output {
    /// Linear colour, finite everywhere: (H, W, 3) float32.
    color: Py<PyArrayDyn<f32>>,
    /// Estimated variance of the filtered luminance, before remodulation: (H, W) float32, or None.
    variance: Option<Py<PyArrayDyn<f32>>>,
    /// Number of filter passes of each pixel, fractional where two results are mixed: (H, W) float32, or None.
    choice: Option<Py<PyArrayDyn<f32>>>,
    /// Motion for an output stage behind the pipeline: (H, W, 2) float32, or None.
    motion: Option<Py<PyArrayDyn<f32>>>,
    /// Number of samples that each pixel's result is worth: (H, W) float32.
    history_length: Py<PyArrayDyn<f32>>,
    /// Accepted fraction of the history's footprint, 0 to 1; 0 at disocclusions: (H, W) float32.
    confidence: Py<PyArrayDyn<f32>>,
    /// Tests that taps of the history's footprint failed, as bits of `Rejection`: (H, W) uint8.
    rejection: Py<PyArrayDyn<u8>>,
    /// Names of the buffers that were used.
    used: Py<PyTuple>,
    /// Number of pixels whose sample was not finite.
    missing: usize,
}

/// The arrays that a step writes: an earlier output's, or new ones.
pub(super) struct Room<'py> {
    color: Direct<'py>,
    variance: Option<Direct<'py>>,
    choice: Option<Direct<'py>>,
    motion: Option<Direct<'py>>,
    history_length: Direct<'py>,
    confidence: Direct<'py>,
    rejection: Direct<'py, u8>,
}

impl<'py> Room<'py> {
    pub(super) fn new(
        py: Python<'py>,
        out: Option<&Bound<'py, Output>>,
        size: Size,
        extras: Extras,
    ) -> PyResult<Self> {
        fn room<'py, T: Element + Value>(
            py: Python<'py>,
            given: Option<&Py<PyArrayDyn<T>>>,
            shape: &[usize],
        ) -> PyResult<Direct<'py, T>> {
            let given = given.map(|array| array.bind(py).clone().into_any());
            Direct::new(py, Out::given(given, shape)?)
        }
        size.check("frame")?;
        let out = out.map(Bound::get);
        if let Some(out) = out {
            for (name, wanted, has) in [
                ("variance", extras.variance, out.variance.is_some()),
                ("choice", extras.choice, out.choice.is_some()),
                ("motion", extras.motion, out.motion.is_some()),
            ] {
                if wanted != has {
                    let text = |has| match has {
                        true => format!("one with {name}"),
                        false => format!("one of a pipeline without {name}"),
                    };
                    return Err(Error::value("out", text(wanted), text(has)).into());
                }
            }
        }
        let shape = [size.height, size.width, 3];
        let (flat, two) = (&shape[..2], [size.height, size.width, 2]);
        Ok(Self {
            color: room(py, out.map(|out| &out.color), &shape)?,
            variance: (extras.variance)
                .then(|| room(py, out.and_then(|out| out.variance.as_ref()), flat))
                .transpose()?,
            choice: (extras.choice)
                .then(|| room(py, out.and_then(|out| out.choice.as_ref()), flat))
                .transpose()?,
            motion: (extras.motion)
                .then(|| room(py, out.and_then(|out| out.motion.as_ref()), &two))
                .transpose()?,
            history_length: room(py, out.map(|out| &out.history_length), flat)?,
            confidence: room(py, out.map(|out| &out.confidence), flat)?,
            rejection: room(py, out.map(|out| &out.rejection), flat)?,
        })
    }

    pub(super) fn data(&mut self) -> PyResult<pipelines::Output<'_>> {
        Ok(pipelines::Output {
            color: self.color.data()?,
            variance: self.variance.as_mut().map(Direct::data).transpose()?,
            choice: self.choice.as_mut().map(Direct::data).transpose()?,
            motion: self.motion.as_mut().map(Direct::data).transpose()?,
            history_length: self.history_length.data()?,
            confidence: self.confidence.data()?,
            rejection: self.rejection.data()?,
        })
    }

    /// Makes the output, and says what seems wrong with the frame.
    pub(super) fn output(
        self,
        py: Python<'py>,
        summary: pipelines::Summary,
        mistake: Option<pipelines::Mistake>,
    ) -> PyResult<Output> {
        let [variance, choice, motion] = [self.variance, self.choice, self.motion]
            .map(|array| array.map(Direct::array).transpose());
        let output = Output {
            color: self.color.array()?.unbind(),
            variance: variance?.map(Bound::unbind),
            choice: choice?.map(Bound::unbind),
            motion: motion?.map(Bound::unbind),
            history_length: self.history_length.array()?.unbind(),
            confidence: self.confidence.array()?.unbind(),
            rejection: self.rejection.array()?.unbind(),
            used: PyTuple::new(py, summary.used)?.unbind(),
            missing: summary.missing,
        };
        if let Some(mistake) = mistake {
            warn(py, &mistake.to_string())?;
        }
        if summary.repeats {
            warn(py, REPEATS)?;
        }
        Ok(output)
    }
}

/// The array itself, as results may be written to it.
fn same_array<T: Element>(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Py<PyArrayDyn<T>>> {
    let py = value.py();
    refuse_mask(value, name)?;
    let array = value.cast::<PyArrayDyn<T>>().map_err(|_| {
        let got = value
            .getattr("dtype")
            .unwrap_or(value.get_type().into_any());
        wrong_type(name, format!("a {} array", T::get_dtype(py)), got)
    })?;
    Ok(array.clone().unbind())
}

#[pymethods]
impl Output {
    /// Constructor for pipelines written in Python.
    #[new]
    #[pyo3(signature = (color, history_length, confidence, rejection, *, variance=None, choice=None, motion=None, used=vec![],
        missing=0))]
    #[pyo3(
        text_signature = "(color, history_length, confidence, rejection, *, variance=None, choice=None, motion=None, \
        used=(), missing=0)"
    )]
    fn new(
        py: Python<'_>,
        color: &Bound<'_, PyAny>,
        history_length: &Bound<'_, PyAny>,
        confidence: &Bound<'_, PyAny>,
        rejection: &Bound<'_, PyAny>,
        variance: Option<&Bound<'_, PyAny>>,
        choice: Option<&Bound<'_, PyAny>>,
        motion: Option<&Bound<'_, PyAny>>,
        used: Vec<String>,
        missing: i128,
    ) -> PyResult<Self> {
        let maybe = |value: Option<&_>, name| value.map(|v| same_array(v, name)).transpose();
        let color = same_array::<f32>(color, "color")?;
        let history_length = same_array::<f32>(history_length, "history_length")?;
        let confidence = same_array::<f32>(confidence, "confidence")?;
        let rejection = same_array::<u8>(rejection, "rejection")?;
        let variance = maybe(variance, "variance")?;
        let choice = maybe(choice, "choice")?;
        let motion = maybe(motion, "motion")?;
        let missing = whole("missing", missing, "a number of pixels", |_| true)?;
        let shape = color.bind(py).shape().to_vec();
        let [height, width, 3] = shape[..] else {
            return Err(Error::value("color", "shape (H, W, 3)", format!("{shape:?}")).into());
        };
        let numbers = [
            ("history_length", Some(&history_length)),
            ("confidence", Some(&confidence)),
            ("variance", variance.as_ref()),
            ("choice", choice.as_ref()),
        ];
        let shapes = (numbers.into_iter())
            .filter_map(|(name, array)| Some((name, array?.bind(py).shape().to_vec())))
            .chain([("rejection", rejection.bind(py).shape().to_vec())]);
        for (name, shape) in shapes {
            if shape != [height, width] {
                let expected = format!("shape ({height}, {width})");
                return Err(Error::value(name, expected, format!("{shape:?}")).into());
            }
        }
        let moved = (motion.as_ref()).map(|motion| motion.bind(py).shape().to_vec());
        if let Some(shape) = moved.filter(|shape| *shape != [height, width, 2]) {
            let expected = format!("shape ({height}, {width}, 2)");
            return Err(Error::value("motion", expected, format!("{shape:?}")).into());
        }
        Ok(Self {
            color,
            variance,
            choice,
            motion,
            history_length,
            confidence,
            rejection,
            used: PyTuple::new(py, used)?.unbind(),
            missing,
        })
    }

    /// Supports pickling and copying; a shallow copy shares the arrays.
    fn __getnewargs_ex__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let Self {
            color,
            history_length,
            confidence,
            rejection,
            ..
        } = self;
        let args = (color, history_length, confidence, rejection).into_pyobject(py)?;
        let kwargs = PyDict::new(py);
        kwargs.set_item("variance", &self.variance)?;
        kwargs.set_item("choice", &self.choice)?;
        kwargs.set_item("motion", &self.motion)?;
        kwargs.set_item("used", &self.used)?;
        kwargs.set_item("missing", self.missing)?;
        Ok((args, kwargs))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let shape = self.color.bind(py).shape().to_vec();
        let used = self.used.bind(py).repr()?;
        Ok(format!(
            "Output({}x{}, used={used}, missing={})",
            shape[1], shape[0], self.missing
        ))
    }
}

/// What history expects of a frame's pixels, without the frame's own sample.
///
/// `recall` of a pipeline that runs backwards returns that of later frames, and `step` takes it as `later`.
///
/// Parameters
/// ----------
/// color : (H, W, 3) float32
///     Light: demodulated, if frames have albedo. NaN where nothing is known.
/// moments : (H, W, 2) float32
///     Means of its luminance and of the luminance's square.
/// history_length : (H, W) float32
///     How many samples it is worth: less than went into it where the light has changed.
/// confidence : (H, W) float32
///     As `Output.confidence`.
/// rejection : (H, W) uint8
///     As `Output.rejection`.
/// motion : (H, W, 2) float32, optional
///     As `Output.motion`.
/// used : tuple of str, default ()
///     As `Output.used`; empty if that is not known.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
///
/// See Also
/// --------
/// SVGF.recall : Returns a history.
/// combine_histories : Joins two histories.
///
/// Examples
/// --------
/// >>> pipeline = yester.SVGF()
/// >>> for light in (1.0, 1.0):
/// ...     history = pipeline.recall(yester.Frame(np.full((4, 4, 3), light)))
/// >>> history.history_length[0]
/// array([1., 1., 1., 1.], dtype=float32)
#[pyclass(frozen, get_all, module = "yester")]
pub struct History {
    /// Light, demodulated if frames have albedo; NaN where nothing is known: (H, W, 3) float32.
    pub(super) color: Py<PyArrayDyn<f32>>,
    /// Means of luminance and of its square: (H, W, 2) float32.
    pub(super) moments: Py<PyArrayDyn<f32>>,
    /// Number of samples that the history is worth: (H, W) float32.
    pub(super) history_length: Py<PyArrayDyn<f32>>,
    /// Accepted fraction of the history's footprint, 0 to 1: (H, W) float32.
    pub(super) confidence: Py<PyArrayDyn<f32>>,
    /// Tests that taps of the history's footprint failed, as bits of `Rejection`: (H, W) uint8.
    pub(super) rejection: Py<PyArrayDyn<u8>>,
    /// Motion for an output stage behind the pipeline: (H, W, 2) float32, or None.
    pub(super) motion: Option<Py<PyArrayDyn<f32>>>,
    /// Names of the buffers that were used.
    pub(super) used: Py<PyTuple>,
}

#[pymethods]
impl History {
    #[new]
    #[pyo3(signature = (color, moments, history_length, confidence, rejection, *, motion=None, used=vec![]))]
    #[pyo3(
        text_signature = "(color, moments, history_length, confidence, rejection, *, motion=None, used=())"
    )]
    fn new(
        py: Python<'_>,
        color: &Bound<'_, PyAny>,
        moments: &Bound<'_, PyAny>,
        history_length: &Bound<'_, PyAny>,
        confidence: &Bound<'_, PyAny>,
        rejection: &Bound<'_, PyAny>,
        motion: Option<&Bound<'_, PyAny>>,
        used: Vec<String>,
    ) -> PyResult<Self> {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let input = |value, name, channels| {
            Input::<f32>::of_size(value, name, channels, size).map(|input| input.array().unbind())
        };
        let rejection = Input::<u8>::of_size(rejection, "rejection", Channels::One, size)?;
        Ok(Self {
            color: color.array().unbind(),
            moments: input(moments, "moments", MOMENTS)?,
            history_length: input(history_length, "history_length", Channels::One)?,
            confidence: input(confidence, "confidence", Channels::One)?,
            rejection: rejection.array().unbind(),
            motion: (motion.map(|motion| input(motion, "motion", Channels::Of(&[2]))))
                .transpose()?,
            used: PyTuple::new(py, used)?.unbind(),
        })
    }

    /// Supports pickling and copying; a shallow copy shares the arrays.
    fn __getnewargs_ex__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyDict>)> {
        let Self {
            color,
            moments,
            history_length,
            confidence,
            rejection,
            motion,
            used,
        } = self;
        let args = (color, moments, history_length, confidence, rejection).into_pyobject(py)?;
        let kwargs = PyDict::new(py);
        kwargs.set_item("motion", motion)?;
        kwargs.set_item("used", used)?;
        Ok((args.into_any(), kwargs))
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let shape = self.color.bind(py).shape().to_vec();
        format!("History({}x{})", shape[1], shape[0])
    }
}

/// The arrays of a `History`, borrowed.
pub(super) struct HistoryArgs<'py> {
    color: Input<'py>,
    moments: Input<'py>,
    length: Input<'py>,
}

impl<'py> HistoryArgs<'py> {
    pub(super) fn new(later: &Bound<'py, History>, size: Size) -> PyResult<Self> {
        let (py, history) = (later.py(), later.get());
        let input = |array: &Py<PyArrayDyn<f32>>, channels| {
            Input::<f32>::of_size(array.bind(py), "later", channels, size)
        };
        Ok(Self {
            color: input(&history.color, COLOR)?,
            moments: input(&history.moments, MOMENTS)?,
            length: input(&history.history_length, Channels::One)?,
        })
    }

    pub(super) fn history(&self) -> pipelines::History<'_> {
        pipelines::History {
            color: self.color.pixels(),
            moments: self.moments.pixels(),
            length: self.length.pixels(),
        }
    }
}

/// What a user should know of frames whose noise repeats.
const REPEATS: &str = "color: expected new noise in every frame, got that of the frame before, which hides as much as one \
                       frame alone: render each with another seed, and none twice";

thread_local! {
    /// Texts of this thread's warnings, while [`collect_warnings`] runs.
    static TOLD: RefCell<Option<Vec<String>>> = const { RefCell::new(None) };
}

/// Call a function, and return what pipelines of this thread would warn of, instead of warning.
///
/// Filters of warnings belong to the whole process: a thread that changes them changes what others show.
///
/// Parameters
/// ----------
/// function : callable
/// *args, **named
///     Its arguments.
///
/// Returns
/// -------
/// result
///     What the function returns.
/// messages : list of str
///     The texts of the warnings, in their order.
#[pyfunction]
#[pyo3(signature = (function, /, *args, **named))]
pub fn collect_warnings<'py>(
    function: &Bound<'py, PyAny>,
    args: &Bound<'py, PyTuple>,
    named: Option<&Bound<'py, PyDict>>,
) -> PyResult<(Bound<'py, PyAny>, Vec<String>)> {
    let before = TOLD.replace(Some(vec![]));
    let result = function.call(args, named);
    let messages = TOLD.replace(before).unwrap_or_default();
    Ok((result?, messages))
}

pub(super) fn warn(py: Python<'_>, message: &str) -> PyResult<()> {
    let told = TOLD.with_borrow_mut(|told| told.as_mut().map(|told| told.push(message.into())));
    if told.is_some() {
        return Ok(());
    }
    let category = py.get_type::<PyUserWarning>();
    PyErr::warn(py, &category, &CString::new(message)?, 1)
}
