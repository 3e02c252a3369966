//! The pipelines' base class, their inputs and outputs.

pub mod bmfr;
pub mod half_res;
pub mod recirculation;
pub mod svgf;
pub mod taa;
pub mod upscaler;

use std::ffi::CString;
use std::sync::OnceLock;

use numpy::{Element, PyArrayDyn, PyUntypedArrayMethods};
use pyo3::PyClass;
use pyo3::exceptions::{PyDeprecationWarning, PyRuntimeError, PyUserWarning};
use pyo3::prelude::*;
use pyo3::pyclass::boolean_struct::False;
use pyo3::types::{PyDict, PyTuple};

use crate::bindings::arrays::{
    COLOR, Channels, Direct, Input, MOTION, Number, Out, detached, needs, wrong_type,
};
use crate::bindings::camera::Camera;
use crate::bindings::merge::MOMENTS;
use crate::error::{Error, whole};
use crate::image::{Pixels, Size, Value};
use crate::kernels::camera::pinhole;
use crate::kernels::fetch::validate::Surface;
use crate::pipelines::{self, Extras, Pipeline as _, Svgf};

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
///     "hit_distance" and "jitter".
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
struct Room<'py> {
    color: Direct<'py>,
    variance: Option<Direct<'py>>,
    choice: Option<Direct<'py>>,
    motion: Option<Direct<'py>>,
    history_length: Direct<'py>,
    confidence: Direct<'py>,
    rejection: Direct<'py, u8>,
}

impl<'py> Room<'py> {
    fn new(
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
            Direct::new(py, Out::given(given, shape)?, shape)
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

    fn data(&mut self) -> PyResult<pipelines::Output<'_>> {
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
    fn output(
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
    color: Py<PyArrayDyn<f32>>,
    /// Means of luminance and of its square: (H, W, 2) float32.
    moments: Py<PyArrayDyn<f32>>,
    /// Number of samples that the history is worth: (H, W) float32.
    history_length: Py<PyArrayDyn<f32>>,
    /// Accepted fraction of the history's footprint, 0 to 1: (H, W) float32.
    confidence: Py<PyArrayDyn<f32>>,
    /// Tests that taps of the history's footprint failed, as bits of `Rejection`: (H, W) uint8.
    rejection: Py<PyArrayDyn<u8>>,
    /// Motion for an output stage behind the pipeline: (H, W, 2) float32, or None.
    motion: Option<Py<PyArrayDyn<f32>>>,
    /// Names of the buffers that were used.
    used: Py<PyTuple>,
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
            let input = Input::<f32>::new(value, name, channels)?.sized(name, size)?;
            Ok::<_, PyErr>(input.array().unbind())
        };
        let rejection = Input::<u8>::new(rejection, "rejection", Channels::One)?;
        Ok(Self {
            color: color.array().unbind(),
            moments: input(moments, "moments", MOMENTS)?,
            history_length: input(history_length, "history_length", Channels::One)?,
            confidence: input(confidence, "confidence", Channels::One)?,
            rejection: rejection.sized("rejection", size)?.array().unbind(),
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
struct HistoryArgs<'py> {
    color: Input<'py>,
    moments: Input<'py>,
    length: Input<'py>,
    confidence: Input<'py>,
    rejection: Input<'py, u8>,
}

impl<'py> HistoryArgs<'py> {
    fn new(later: &Bound<'py, History>, size: Size) -> PyResult<Self> {
        let (py, history) = (later.py(), later.get());
        let input = |array: &Py<PyArrayDyn<f32>>, channels| {
            Input::<f32>::new(array.bind(py), "later", channels)?.sized("later", size)
        };
        let rejection = Input::<u8>::new(history.rejection.bind(py), "later", Channels::One)?;
        Ok(Self {
            color: input(&history.color, COLOR)?,
            moments: input(&history.moments, MOMENTS)?,
            length: input(&history.history_length, Channels::One)?,
            confidence: input(&history.confidence, Channels::One)?,
            rejection: rejection.sized("later", size)?,
        })
    }

    fn history(&self) -> pipelines::History<'_> {
        pipelines::History {
            color: self.color.pixels(),
            moments: self.moments.pixels(),
            length: self.length.pixels(),
            confidence: self.confidence.pixels().plane(),
            rejection: self.rejection.pixels().plane(),
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

/// The buffers of a `yester.Frame`, borrowed; `Frame` has validated them.
struct FrameArgs<'py> {
    floats: [Option<Input<'py>>; 11],
    ids: Option<Input<'py, u32>>,
    camera: Option<pinhole::Camera>,
    jitter: Option<[f64; 2]>,
}

impl<'py> FrameArgs<'py> {
    const FLOATS: [(&'static str, Channels); 11] = [
        ("color", COLOR),
        ("albedo", COLOR),
        ("emission", COLOR),
        ("normal", COLOR),
        ("object_normal", COLOR),
        ("position", COLOR),
        ("depth", Channels::One),
        ("motion", MOTION),
        ("replay", COLOR),
        ("hit_distance", Channels::One),
        ("reactive", Channels::One),
    ];

    fn new(frame: &Bound<'py, PyAny>) -> PyResult<Self> {
        let class = frame.py().import("yester.frame")?.getattr("Frame")?;
        if !frame.is_instance(&class)? {
            return Err(wrong_type(
                "frame",
                "a yester.Frame",
                frame.get_type().name()?,
            ));
        }
        let mut floats = [const { None }; 11];
        for (buffer, (name, channels)) in floats.iter_mut().zip(Self::FLOATS) {
            *buffer = read(frame, name, channels)?;
        }
        let camera = frame.getattr("camera")?.extract::<Option<Camera>>()?;
        Ok(Self {
            floats,
            ids: read(frame, "ids", Channels::One)?,
            camera: camera.map(|camera| camera.inner),
            jitter: frame.getattr("jitter")?.extract()?,
        })
    }

    fn buffer(&self, name: &str) -> Option<Pixels<'_>> {
        let place = Self::FLOATS.iter().position(|(known, _)| *known == name)?;
        self.floats[place].as_ref().map(Input::pixels)
    }

    fn size(&self) -> Size {
        let color = self.buffer("color").expect("every frame has colour");
        color.size
    }

    /// Runs `step` on the frame without the interpreter's lock.
    fn step(
        self,
        py: Python<'py>,
        out: Option<&Bound<'py, Output>>,
        pipeline: &mut (impl pipelines::Pipeline + Send),
    ) -> PyResult<Output> {
        let size = pipeline.output_size(self.size());
        let mut room = Room::new(py, out, size, pipeline.extras())?;
        let output = room.data()?;
        let frame = self.frame();
        let (summary, mistake) = detached(py, || pipeline.step(&frame, output))??;
        // Release the frame's buffers first: `out` may alias them.
        drop(self);
        room.output(py, summary, mistake)
    }

    /// The same with the history of later frames.
    fn step_between(
        self,
        py: Python<'py>,
        out: Option<&Bound<'py, Output>>,
        later: Option<&Bound<'py, History>>,
        pipeline: &mut Svgf,
    ) -> PyResult<Output> {
        let Some(later) = later else {
            return self.step(py, out, pipeline);
        };
        let size = self.size();
        let used = later.get().used.bind(py);
        let divided = used.contains("albedo")?;
        // A history that lists no buffers may be of either kind.
        if !used.is_empty() && divided != self.frame().albedo.is_some() {
            let [expected, got] = match divided {
                true => ["without albedo, as the frame", "with it"],
                false => ["with albedo, as the frame", "without it"],
            };
            let expected = format!("a history of frames {expected}");
            return Err(Error::value("later", expected, format!("one of frames {got}")).into());
        }
        let later = HistoryArgs::new(later, size)?;
        let mut room = Room::new(py, out, size, pipeline.extras())?;
        let output = room.data()?;
        let (frame, history) = (self.frame(), later.history());
        let (summary, mistake) = detached(py, || pipeline.step_between(&frame, &history, output))??;
        drop((self, later));
        room.output(py, summary, mistake)
    }

    /// The same for a denoised frame, with the samples that it was made of, and the denoiser's confidence.
    fn step_denoised(
        self,
        py: Python<'py>,
        out: Option<&Bound<'py, Output>>,
        [samples, confidence]: [Option<&Bound<'py, PyAny>>; 2],
        pipeline: &mut pipelines::taa::Taa,
    ) -> PyResult<Output> {
        let Some(samples) = samples else {
            if confidence.is_some() {
                return Err(needs("confidence", "samples"));
            }
            return self.step(py, out, pipeline);
        };
        let size = self.size();
        let samples = Input::<f32>::new(samples, "samples", COLOR)?.sized("samples", size)?;
        let confidence = Input::<f32>::optional(confidence, "confidence", Channels::One, size)?;
        let mut room = Room::new(py, out, size, pipeline.extras())?;
        let output = room.data()?;
        let frame = self.frame();
        let source = pipelines::taa::Source {
            samples: samples.pixels(),
            confidence: (confidence.as_ref()).map(|image| image.pixels().plane()),
        };
        let (summary, mistake) = detached(py, || pipeline.step_denoised(&frame, source, output))??;
        drop((self, samples, confidence));
        room.output(py, summary, mistake)
    }

    /// Runs `recall` on the frame without the interpreter's lock.
    fn recall(self, py: Python<'py>, pipeline: &mut Svgf) -> PyResult<History> {
        let Size { height, width } = self.size();
        let shapes: [&[usize]; 3] = [&[height, width, 3], &[height, width, 2], &[height, width]];
        let mut color = Direct::new(py, Out::fresh(), shapes[0])?;
        let mut moments = Direct::new(py, Out::fresh(), shapes[1])?;
        let mut length = Direct::new(py, Out::fresh(), shapes[2])?;
        let mut confidence = Direct::new(py, Out::fresh(), shapes[2])?;
        let mut rejection = Direct::<u8>::new(py, Out::fresh(), shapes[2])?;
        let mut motion = Direct::new(py, Out::fresh(), shapes[1])?;
        let expected = pipelines::HistoryMut {
            color: color.data()?,
            moments: moments.data()?,
            length: length.data()?,
            confidence: confidence.data()?,
            rejection: rejection.data()?,
            motion: motion.data()?,
        };
        let frame = self.frame();
        let (summary, mistake) = detached(py, || pipeline.recall(&frame, expected))??;
        if let Some(mistake) = mistake {
            warn(py, &mistake.to_string())?;
        }
        Ok(History {
            color: color.array()?.unbind(),
            moments: moments.array()?.unbind(),
            history_length: length.array()?.unbind(),
            confidence: confidence.array()?.unbind(),
            rejection: rejection.array()?.unbind(),
            motion: Some(motion.array()?.unbind()),
            used: PyTuple::new(py, summary.used)?.unbind(),
        })
    }

    fn frame(&self) -> pipelines::Frame<'_> {
        let surface = Surface {
            depth: self.buffer("depth"),
            normal: self.buffer("normal"),
            ids: self.ids.as_ref().map(Input::pixels),
            object_normal: self.buffer("object_normal"),
            color: None,
        };
        pipelines::Frame {
            color: self.buffer("color").expect("every frame has colour"),
            albedo: self.buffer("albedo"),
            emission: self.buffer("emission"),
            surface,
            position: self.buffer("position"),
            motion: self.buffer("motion"),
            replay: self.buffer("replay"),
            hit_distance: self.buffer("hit_distance"),
            reactive: self.buffer("reactive"),
            camera: self.camera,
            jitter: self.jitter,
        }
    }
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

/// What a user should know of frames whose noise repeats.
const REPEATS: &str = "color: expected new noise in every frame, got that of the frame before, which hides as much as one \
                       frame alone: render each with another seed, and none twice";

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

fn warn(py: Python<'_>, message: &str) -> PyResult<()> {
    let category = py.get_type::<PyUserWarning>();
    PyErr::warn(py, &category, &CString::new(message)?, 1)
}

fn read<'py, T: Number>(
    frame: &Bound<'py, PyAny>,
    name: &str,
    channels: Channels,
) -> PyResult<Option<Input<'py, T>>> {
    let value = frame.getattr(name)?;
    if value.is_none() {
        Ok(None)
    } else {
        Input::new(&value, name, channels).map(Some)
    }
}
