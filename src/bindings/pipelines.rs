//! The pipelines.

use numpy::{Element, PyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::arrays::{COLOR, Channels, Direct, Input, Interleaved, MOTION, Number, Out, choice};
use super::camera::Camera;
use super::judge::Bounds;
use crate::error::Error;
use crate::image::{Size, Value};
use crate::kernels::camera::pinhole;
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::judge::neighborhood;
use crate::kernels::judge::surface::{self, Surface};
use crate::kernels::merge::{accumulate, blend};
use crate::kernels::smooth::guide::Sigmas;
use crate::kernels::smooth::{atrous, fireflies, variance};
use crate::pipelines::{frame, svgf, taa};

/// One denoised frame and what the denoiser knows of it.
///
/// Attributes
/// ----------
/// color : (H, W, 3) float32
///     Linear; finite everywhere.
/// variance : (H, W) float32 or None
///     Estimated variance of the filtered luminance, before albedo is put back; None from pipelines without an estimate.
/// history_length : (H, W) float32
///     Samples that went into each pixel, up to 1/alpha.
/// confidence : (H, W) float32
///     Share of the history's footprint that was accepted, 0 to 1; 0 where the pixel starts anew.
/// rejection : (H, W) uint8
///     Bits of `Rejection`: the tests that taps of the footprint failed (one pixel for filter "nearest", else 2×2).
/// used : tuple of str
///     What took part: of "motion", "camera" (motion computed from cameras), "albedo", "emission", "normal", "depth",
///     "plane" (depth compared by plane distance), "ids", "position", "object_normal", "replay", "hit_distance" and
///     "jitter".
/// missing : int
///     Pixels whose sample was not finite.
#[pyclass(frozen, get_all, module = "yester")]
pub struct Output {
    color: Py<PyArrayDyn<f32>>,
    variance: Option<Py<PyArrayDyn<f32>>>,
    history_length: Py<PyArrayDyn<f32>>,
    confidence: Py<PyArrayDyn<f32>>,
    rejection: Py<PyArrayDyn<u8>>,
    used: Py<PyTuple>,
    missing: usize,
}

/// The arrays that a step writes: those of an earlier output, or new ones.
pub struct Room<'py> {
    color: Direct<'py>,
    variance: Option<Direct<'py>>,
    history_length: Direct<'py>,
    confidence: Direct<'py>,
    rejection: Direct<'py, u8>,
}

impl<'py> Room<'py> {
    pub fn new(
        py: Python<'py>,
        out: Option<&Output>,
        size: Size,
        estimates_variance: bool,
    ) -> PyResult<Self> {
        fn room<'py, T: Element + Value>(
            py: Python<'py>,
            given: Option<&Py<PyArrayDyn<T>>>,
            shape: &[usize],
        ) -> PyResult<Direct<'py, T>> {
            let given = given.map(|array| array.bind(py).clone().into_any());
            Direct::new(py, Out::given(given, shape)?, shape)
        }
        if out.is_some_and(|out| out.variance.is_some() != estimates_variance) {
            let expected = ["one of a pipeline without variance", "one with variance"];
            let [expected, got] =
                [estimates_variance, !estimates_variance].map(|has| expected[usize::from(has)]);
            return Err(Error::value("out", expected, got).into());
        }
        let shape = [size.height, size.width, 3];
        let flat = &shape[..2];
        Ok(Self {
            color: room(py, out.map(|out| &out.color), &shape)?,
            variance: estimates_variance
                .then(|| room(py, out.and_then(|out| out.variance.as_ref()), flat))
                .transpose()?,
            history_length: room(py, out.map(|out| &out.history_length), flat)?,
            confidence: room(py, out.map(|out| &out.confidence), flat)?,
            rejection: room(py, out.map(|out| &out.rejection), flat)?,
        })
    }

    pub fn data(&mut self) -> PyResult<frame::Output<'_>> {
        Ok(frame::Output {
            color: self.color.data()?,
            variance: self.variance.as_mut().map(Direct::data).transpose()?,
            history_length: self.history_length.data()?,
            confidence: self.confidence.data()?,
            rejection: self.rejection.data()?,
        })
    }

    /// To be called when the frame is no longer borrowed.
    pub fn output(self, py: Python<'py>, summary: frame::Summary) -> PyResult<Output> {
        let variance = self.variance.map(Direct::array).transpose()?;
        Ok(Output {
            color: self.color.array()?.unbind(),
            variance: variance.map(Bound::unbind),
            history_length: self.history_length.array()?.unbind(),
            confidence: self.confidence.array()?.unbind(),
            rejection: self.rejection.array()?.unbind(),
            used: PyTuple::new(py, summary.used)?.unbind(),
            missing: summary.missing,
        })
    }
}

#[pymethods]
impl Output {
    /// For stages that are written in Python.
    #[new]
    #[pyo3(signature = (color, history_length, confidence, rejection, *, variance=None, used=vec![], missing=0))]
    #[pyo3(
        text_signature = "(color, history_length, confidence, rejection, *, variance=None, used=(), missing=0)"
    )]
    fn new(
        py: Python<'_>,
        color: Py<PyArrayDyn<f32>>,
        history_length: Py<PyArrayDyn<f32>>,
        confidence: Py<PyArrayDyn<f32>>,
        rejection: Py<PyArrayDyn<u8>>,
        variance: Option<Py<PyArrayDyn<f32>>>,
        used: Vec<String>,
        missing: usize,
    ) -> PyResult<Self> {
        let shape = color.bind(py).shape().to_vec();
        let [height, width, 3] = shape[..] else {
            return Err(Error::value("color", "shape (H, W, 3)", format!("{shape:?}")).into());
        };
        let numbers = [
            ("history_length", Some(&history_length)),
            ("confidence", Some(&confidence)),
            ("variance", variance.as_ref()),
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
        Ok(Self {
            color,
            variance,
            history_length,
            confidence,
            rejection,
            used: PyTuple::new(py, used)?.unbind(),
            missing,
        })
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

/// Spatiotemporal variance-guided filtering of a sequence of frames.
///
/// Carries the history of every pixel along its motion, accepts it where it shows the same surface, merges it with the
/// new sample, estimates the variance that is left and filters in space accordingly. Surface that a frame lacks drop out
/// of the tests and weights: without albedo, texture is filtered with the light; without normals, depth or ids, their
/// tests fall away; without motion, it is computed from the cameras if both frames have one and depth or position is
/// known, and otherwise history stays in place.
///
/// Parameters
/// ----------
/// alpha : float, default 0.05
///     Least share of the new sample in the history, 0 to 1.
/// moments_alpha : float, default 0.2
///     The same for the moments of luminance.
/// iterations : int, default 4
///     Passes of the spatial filter, 0 to 16.
/// sigma_luminance : float, default 3.0
///     Luminance difference that counts as one in the filter, in standard deviations; above 0.
/// sigma_normal : float, default 128.0
///     How sharply differences of normals count in the filter; from 0.
/// sigma_depth : float, default 1.0
///     Depth difference that counts as one, in multiples of what the slope explains; above 0. For frames without
///     camera or normals.
/// sigma_plane : float, default 0.01
///     Plane distance that counts as one, as a share of depth; above 0. For frames with camera, depth and normals.
/// relative_depth : float or (float, float), default 0.1
///     Largest relative difference from the expected depth that history may have; above 0. For frames without camera,
///     normals or motion of 3 channels.
/// plane_distance : float or (float, float), default 0.01
///     Largest distance from the history's plane, as a share of depth; above 0. For frames with these.
/// normal_angle : float or (float, float), default 25.0
///     Largest angle between a pixel's normal and its history's, in degrees, 0 to 180.
/// min_length : float, default 3.5
///     Samples from which the temporal variance is trusted; at least 1. Not a whole number by default, so that rounding
///     of resampled lengths does not decide.
/// feedback : bool, default False
///     Whether the filter's first pass, instead of its input, is the next frame's history: less noise in motion, more
///     bias.
/// gradient : bool, default True
///     Whether changes of light shorten history. They are known exactly from frames that have a `replay`, and for others
///     estimated from the new samples and history, as far as noise lets see.
/// fireflies : bool, default True
///     Whether samples far brighter than their surroundings are spread over them first (`suppress_fireflies`).
/// reflections : sequence of float, default (0.5, 2.0)
///     Distances behind the surface, in multiples of its depth, +inf included, at which history is looked for as well:
///     where one of them predicts the new samples better than the surface itself, it takes its place. Each costs time;
///     () leaves it out, (0.25, 0.5, 1, 2, 4, inf) is a finer choice for very glossy scenes. Frames with a
///     `hit_distance` are tried at that one alone. Needs cameras, and depth.
/// antialias : bool, default True
///     Whether a stage of temporal antialiasing, `TAA` with preset "denoised", follows.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range.
///
/// Notes
/// -----
/// Schied et al. 2017, *Spatiotemporal Variance-Guided Filtering: Real-Time Reconstruction for Path-Traced Global
/// Illumination*. Each step consists of this package's functions and gives their bits: `demodulate`,
/// `suppress_fireflies`, `motion_vectors`, `reproject` (with `consistency`), `temporal_gradient`, `virtual_motion` and
/// `prediction_gain`, `accumulate`, `estimate_variance`, `atrous`, `remodulate`, and those of `TAA`.
#[pyclass(module = "yester")]
pub struct SVGF {
    inner: svgf::Svgf,
}

#[pymethods]
impl SVGF {
    #[new]
    #[pyo3(signature = (*, alpha=0.05, moments_alpha=0.2, iterations=4, sigma_luminance=3.0, sigma_normal=128.0,
        sigma_depth=1.0, sigma_plane=0.01, relative_depth=Bounds::Hard(0.1), plane_distance=Bounds::Hard(0.01),
        normal_angle=Bounds::Hard(25.0), min_length=3.5, feedback=false, gradient=true, fireflies=true,
        reflections=vec![0.5, 2.0], antialias=true))]
    #[pyo3(
        text_signature = "(*, alpha=0.05, moments_alpha=0.2, iterations=4, sigma_luminance=3.0, sigma_normal=128.0, \
        sigma_depth=1.0, sigma_plane=0.01, relative_depth=0.1, plane_distance=0.01, normal_angle=25.0, min_length=3.5, \
        feedback=False, gradient=True, fireflies=True, reflections=(0.5, 2.0), antialias=True)"
    )]
    fn new(
        alpha: f32,
        moments_alpha: f32,
        iterations: i64,
        sigma_luminance: f32,
        sigma_normal: f32,
        sigma_depth: f32,
        sigma_plane: f32,
        relative_depth: Bounds,
        plane_distance: Bounds,
        normal_angle: Bounds,
        min_length: f32,
        feedback: bool,
        gradient: bool,
        fireflies: bool,
        reflections: Vec<f32>,
        antialias: bool,
    ) -> PyResult<Self> {
        let sigmas = Sigmas {
            normal: sigma_normal,
            depth: sigma_depth,
            plane: sigma_plane,
        };
        let params = svgf::Params {
            surface: surface::Params {
                relative_depth: relative_depth.into(),
                plane_distance: plane_distance.into(),
                normal_angle: normal_angle.into(),
                ..Default::default()
            },
            accumulate: accumulate::Params {
                alpha,
                moments_alpha,
                warmup: true,
            },
            variance: variance::Params {
                min_length,
                sigmas,
                ..Default::default()
            },
            atrous: atrous::Params {
                iterations: atrous::Params::iterations(iterations)?,
                sigma_luminance,
                sigmas,
            },
            feedback,
            gradient,
            fireflies: fireflies.then(fireflies::Params::default),
            reflections,
            antialias: antialias.then_some(taa::Params::DENOISED),
            half_res: None,
        };
        Ok(Self {
            inner: svgf::Svgf::new(params)?,
        })
    }

    /// Denoises the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     Of the same size as those before.
    /// out : Output, optional
    ///     Of an earlier step, no longer needed: its arrays are overwritten and returned, instead of new ones. From the
    ///     second frame on no memory for images is then asked for.
    ///
    /// Returns
    /// -------
    /// Output
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the size changes, or albedo appears or vanishes, without `reset` in between; if `out` does not fit.
    #[pyo3(signature = (frame, out=None))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, Output>>,
    ) -> PyResult<Output> {
        let (room, summary) = {
            let frame = FrameArgs::new(frame)?;
            let mut room = Room::new(py, out.map(Bound::get), frame.size(), true)?;
            let output = room.data()?;
            let summary = frame.with(py, |frame| self.inner.step(frame, output))?;
            (room, summary)
        };
        room.output(py, summary)
    }

    /// Forgets the sequence; the next frame is a first one.
    fn reset(&mut self) {
        self.inner.reset();
    }
}

/// Temporal antialiasing of a sequence of frames.
///
/// Carries the colours of former frames along the motion, holds them to the colours that the new frame has around each
/// pixel, and blends. For frames without noise to speak of, with samples that differ in place from frame to frame; what
/// noise there is makes neighbourhoods wide and histories doubtful. No surface is told from another, so that edges are
/// antialiased, and all buffers but colour may be absent: without motion, it is computed from the cameras if both frames
/// have one and depth or position is known, and otherwise history stays in place.
///
/// Parameters
/// ----------
/// preset : {"best", "denoised", "seed", "karis", "filament"}, default "best"
///     Where the other parameters come from that are not given: our own measurements, on frames without noise and on
///     denoised ones; the textbook equation (range of the 3×3 pixels, clamped, 5 % of the new sample); after Karis 2014,
///     *High Quality Temporal Supersampling*, and after Google's Filament, whose techniques these have, not every constant.
/// alpha : float, optional
///     Least share of the new sample, 0 to 1.
/// fast_alpha : float, optional
///     The same for fast motion.
/// speed : float or (float, float), optional
///     Pixels up to which motion is slow, and from which it is fast.
/// dilate : {"3x3", "cross", "none"}, optional
///     Which pixels may lend their motion, as in `dilate_motion`: the nearest one where there is depth, else the longest.
/// filter : {"bilinear", "nearest", "catmull-rom", "catmull-rom-5", "lanczos-2"}, optional
///     As in `reproject`.
/// box, gamma, window, space, response : optional
///     As in `clip_history`.
/// weighting, flicker : optional
///     As in `blend`.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range, or a mode unknown (the error lists the modes).
///
/// Notes
/// -----
/// Each step consists of this package's functions and gives their bits: `resolve` (with "blackman-harris", of frames that
/// tell their jitter, but for "seed"), `motion_vectors`, `dilate_motion`, `reproject` without tests or fallback,
/// `blend_factor`, `exposure`, `clip_history`, `blend`. The share of the N-th sample of a pixel is at least 1/N.
#[pyclass(module = "yester")]
pub struct TAA {
    inner: taa::Taa,
}

#[pymethods]
impl TAA {
    #[new]
    #[pyo3(signature = (preset="best", *, alpha=None, fast_alpha=None, speed=None, dilate=None, filter=None, r#box=None,
        gamma=None, window=None, space=None, response=None, weighting=None, flicker=None))]
    fn new(
        preset: &str,
        alpha: Option<f32>,
        fast_alpha: Option<f32>,
        speed: Option<Bounds>,
        dilate: Option<&str>,
        filter: Option<&str>,
        r#box: Option<&str>,
        gamma: Option<f32>,
        window: Option<&str>,
        space: Option<&str>,
        response: Option<&str>,
        weighting: Option<&str>,
        flicker: Option<f32>,
    ) -> PyResult<Self> {
        /// The mode that is named, or the preset's.
        fn or<T: Copy>(
            name: Option<&str>,
            argument: &str,
            names: &[(&str, T)],
            preset: T,
        ) -> PyResult<T> {
            name.map_or(Ok(preset), |name| choice(argument, name, names))
        }
        let mut params = choice("preset", preset, &taa::Params::PRESETS)?;
        params.dilate = or(dilate, "dilate", &taa::Params::DILATIONS, params.dilate)?;
        params.filter = or(filter, "filter", &Filter::NAMES, params.filter)?;
        let factor = &mut params.blend_factor;
        factor.alpha = alpha.unwrap_or(factor.alpha);
        factor.fast_alpha = fast_alpha.unwrap_or(factor.fast_alpha);
        factor.speed = speed.map_or(factor.speed, Into::into);
        let clip = &mut params.clip;
        clip.bounds = or(r#box, "box", &neighborhood::Params::BOUNDS, clip.bounds)?;
        clip.gamma = gamma.unwrap_or(clip.gamma);
        clip.radius = or(
            window,
            "window",
            &neighborhood::Params::WINDOWS,
            clip.radius,
        )?;
        clip.space = or(space, "space", &neighborhood::Params::SPACES, clip.space)?;
        clip.response = or(
            response,
            "response",
            &neighborhood::Params::RESPONSES,
            clip.response,
        )?;
        let weightings = &blend::Params::WEIGHTINGS;
        params.blend.weighting = or(weighting, "weighting", weightings, params.blend.weighting)?;
        params.blend.flicker = flicker.unwrap_or(params.blend.flicker);
        Ok(Self {
            inner: taa::Taa::new(params)?,
        })
    }

    /// Antialiases the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     Of the same size as those before.
    /// out : Output, optional
    ///     Of an earlier step, no longer needed: its arrays are overwritten and returned, instead of new ones. From the
    ///     second frame on no memory for images is then asked for.
    ///
    /// Returns
    /// -------
    /// Output
    ///     Without a variance.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the size changes without `reset` in between; if `out` does not fit.
    #[pyo3(signature = (frame, out=None))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, Output>>,
    ) -> PyResult<Output> {
        let (room, summary) = {
            let frame = FrameArgs::new(frame)?;
            let mut room = Room::new(py, out.map(Bound::get), frame.size(), false)?;
            let output = room.data()?;
            let summary = frame.with(py, |frame| self.inner.step(frame, output))?;
            (room, summary)
        };
        room.output(py, summary)
    }

    /// Forgets the sequence; the next frame is a first one.
    fn reset(&mut self) {
        self.inner.reset();
    }
}

/// The buffers of a `yester.Frame`, which has checked them; borrowing them costs nothing.
pub struct FrameArgs<'py> {
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

    pub fn new(frame: &Bound<'py, PyAny>) -> PyResult<Self> {
        let class = frame.py().import("yester.frame")?.getattr("Frame")?;
        if !frame.is_instance(&class)? {
            return Err(
                Error::wrong_type("frame", "a yester.Frame", frame.get_type().name()?).into(),
            );
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

    fn buffer(&self, name: &str) -> Option<Interleaved<'_, f32>> {
        let place = Self::FLOATS.iter().position(|(known, _)| *known == name)?;
        self.floats[place].as_ref().map(Input::data)
    }

    pub fn size(&self) -> Size {
        let color = self.buffer("color").expect("every frame has colour");
        color.pixels().size
    }

    /// Calls `step` without the interpreter.
    pub fn with<R: Send>(
        &self,
        py: Python<'_>,
        step: impl FnOnce(&frame::Frame) -> crate::error::Result<R> + Send,
    ) -> PyResult<R> {
        let buffer = |name| self.buffer(name).map(Interleaved::pixels);
        let surface = Surface {
            depth: buffer("depth"),
            normal: buffer("normal"),
            ids: self.ids.as_ref().map(|ids| ids.data().pixels()),
            object_normal: buffer("object_normal"),
            color: None,
        };
        let frame = frame::Frame {
            color: buffer("color").expect("every frame has colour"),
            albedo: buffer("albedo"),
            emission: buffer("emission"),
            surface,
            position: buffer("position"),
            motion: buffer("motion"),
            replay: buffer("replay"),
            hit_distance: buffer("hit_distance"),
            reactive: buffer("reactive"),
            camera: self.camera,
            jitter: self.jitter,
        };
        let result = py.detach(|| step(&frame));
        Ok(result?)
    }
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
