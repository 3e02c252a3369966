//! The pipelines.

use numpy::{PyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::arrays::{COLOR, Channels, Input, Interleaved, MOTION, Number, Out, Outgoing, Planes};
use super::camera::Camera;
use super::judge::Bounds;
use crate::error::Error;
use crate::image::View;
use crate::kernels::camera::pinhole;
use crate::kernels::judge::surface::{self, Surface};
use crate::kernels::merge::accumulate;
use crate::kernels::smooth::guide::Sigmas;
use crate::kernels::smooth::{atrous, variance};
use crate::pipelines::svgf::{self, Params};

/// One denoised frame and what the denoiser knows of it.
///
/// Attributes
/// ----------
/// color : (H, W, 3) float32
///     Linear; finite everywhere.
/// variance : (H, W) float32
///     Estimated variance of the filtered luminance, before albedo is put back.
/// history_length : (H, W) float32
///     Samples that went into each pixel, up to 1/alpha.
/// confidence : (H, W) float32
///     Share of the history's footprint that was accepted, 0 to 1; 0 where the pixel starts anew.
/// rejection : (H, W) uint8
///     Bits of `Rejection`: the tests that taps of the 2×2 footprint failed.
/// used : tuple of str
///     What took part: of "motion", "camera" (motion computed from cameras), "albedo", "emission", "normal", "depth",
///     "plane" (depth compared by plane distance) and "ids".
/// missing : int
///     Pixels whose sample was not finite.
#[pyclass(frozen, get_all, module = "yester")]
pub struct Output {
    color: Py<PyArrayDyn<f32>>,
    variance: Py<PyArrayDyn<f32>>,
    history_length: Py<PyArrayDyn<f32>>,
    confidence: Py<PyArrayDyn<f32>>,
    rejection: Py<PyArrayDyn<u8>>,
    used: Py<PyTuple>,
    missing: usize,
}

#[pymethods]
impl Output {
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
/// new sample, estimates the variance that is left and filters in space accordingly. Buffers that a frame lacks drop out
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
/// iterations : int, default 5
///     Passes of the spatial filter, 0 to 16.
/// sigma_luminance : float, default 4.0
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
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range.
///
/// Notes
/// -----
/// Schied et al. 2017, *Spatiotemporal Variance-Guided Filtering: Real-Time Reconstruction for Path-Traced Global
/// Illumination*. Each step consists of this package's functions and gives their bits: `demodulate`, `motion_vectors`,
/// `reproject` (with `consistency`), `accumulate`, `estimate_variance`, `atrous`, `remodulate`.
#[pyclass(module = "yester")]
pub struct SVGF {
    inner: svgf::Svgf,
}

#[pymethods]
impl SVGF {
    #[new]
    #[pyo3(signature = (*, alpha=0.05, moments_alpha=0.2, iterations=5, sigma_luminance=4.0, sigma_normal=128.0,
        sigma_depth=1.0, sigma_plane=0.01, relative_depth=Bounds::Hard(0.1), plane_distance=Bounds::Hard(0.01),
        normal_angle=Bounds::Hard(25.0), min_length=3.5, feedback=false))]
    #[pyo3(
        text_signature = "(*, alpha=0.05, moments_alpha=0.2, iterations=5, sigma_luminance=4.0, sigma_normal=128.0, \
        sigma_depth=1.0, sigma_plane=0.01, relative_depth=0.1, plane_distance=0.01, normal_angle=25.0, min_length=3.5, \
        feedback=False)"
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
    ) -> PyResult<Self> {
        let sigmas = Sigmas {
            normal: sigma_normal,
            depth: sigma_depth,
            plane: sigma_plane,
        };
        let params = Params {
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
    ///
    /// Returns
    /// -------
    /// Output
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the size changes, or albedo appears or vanishes, without `reset` in between.
    fn step<'py>(&mut self, py: Python<'py>, frame: &Bound<'py, PyAny>) -> PyResult<Output> {
        let frame = FrameArgs::new(frame)?;
        let floats = frame
            .floats
            .each_ref()
            .map(|buffer| buffer.as_ref().map(Input::data));
        let ids = frame.ids.as_ref().map(Input::data);
        let camera = frame.camera;
        let output = py.detach(|| -> crate::error::Result<_> {
            let floats = floats.map(|buffer| buffer.map(Interleaved::planes));
            let ids = ids.map(Interleaved::planes);
            let [color, albedo, emission, normal, position, depth, motion] =
                floats.each_ref().map(view);
            let surface = Surface {
                depth,
                normal,
                ids: view(&ids),
                object_normal: None,
                color: None,
            };
            let color = color.expect("every frame has colour");
            let output = self.inner.step(&svgf::Frame {
                color,
                albedo,
                emission,
                surface,
                position,
                motion,
                camera,
            })?;
            let images = [
                output.color,
                output.variance,
                output.history_length,
                output.confidence,
            ];
            Ok((
                images.map(Outgoing::new),
                Outgoing::new(output.rejection),
                output.used,
                output.missing,
            ))
        });
        let (images, rejection, used, missing) = output?;
        let [color, variance, history_length, confidence] =
            images.map(|image| image.array(py, Out::fresh()).map(Bound::unbind));
        Ok(Output {
            color: color?,
            variance: variance?,
            history_length: history_length?,
            confidence: confidence?,
            rejection: rejection.array(py, Out::fresh())?.unbind(),
            used: PyTuple::new(py, used)?.unbind(),
            missing,
        })
    }

    /// Forgets the sequence; the next frame is a first one.
    fn reset(&mut self) {
        self.inner.reset();
    }
}

/// The buffers of a `yester.Frame`, which has checked them; borrowing them costs nothing.
struct FrameArgs<'py> {
    floats: [Option<Input<'py>>; 7],
    ids: Option<Input<'py, u32>>,
    camera: Option<pinhole::Camera>,
}

impl<'py> FrameArgs<'py> {
    const FLOATS: [(&'static str, Channels); 7] = [
        ("color", COLOR),
        ("albedo", COLOR),
        ("emission", COLOR),
        ("normal", COLOR),
        ("position", COLOR),
        ("depth", Channels::One),
        ("motion", MOTION),
    ];

    fn new(frame: &Bound<'py, PyAny>) -> PyResult<Self> {
        let class = frame.py().import("yester.frame")?.getattr("Frame")?;
        if !frame.is_instance(&class)? {
            return Err(
                Error::wrong_type("frame", "a yester.Frame", frame.get_type().name()?).into(),
            );
        }
        let mut floats = [const { None }; 7];
        for (buffer, (name, channels)) in floats.iter_mut().zip(Self::FLOATS) {
            *buffer = read(frame, name, channels)?;
        }
        let camera = frame.getattr("camera")?.extract::<Option<Camera>>()?;
        Ok(Self {
            floats,
            ids: read(frame, "ids", Channels::One)?,
            camera: camera.map(|camera| camera.inner),
        })
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

fn view<'a, T: Number>(planes: &'a Option<Planes<'_, T>>) -> Option<View<'a, T>> {
    planes.as_ref().map(Planes::view)
}
