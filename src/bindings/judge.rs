//! The kernels of the judge folder, and the arguments of the surface tests, which `reproject` shares.

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{
    COLOR, Channels, Input, Interleaved, MOTION, Out, Outgoing, Planes, choice, parts,
};
use super::camera::{Camera, check_size};
use crate::error::Error;
use crate::image::Size;
use crate::kernels::camera::pinhole::{self, Rays};
use crate::kernels::judge::consistency;
use crate::kernels::judge::neighborhood;
use crate::kernels::judge::surface::{self, Surface, Tests, check_plane_test};

/// A buffer of the current and of the previous frame.
type Pair<T> = Option<[T; 2]>;

/// The surface tests' checked arguments.
pub struct SurfaceArgs<'py> {
    depth: Pair<Input<'py>>,
    normal: Pair<Input<'py>>,
    ids: Pair<Input<'py, u32>>,
    camera: Option<pinhole::Camera>,
    params: surface::Params,
}

type Arg<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

impl<'py> SurfaceArgs<'py> {
    pub fn new(
        motion: &Input<'py>,
        depth: [Arg<'_, 'py>; 2],
        normal: [Arg<'_, 'py>; 2],
        ids: [Arg<'_, 'py>; 2],
        camera: Option<&Camera>,
        params: surface::Params,
    ) -> PyResult<Self> {
        params.check()?;
        let size = motion.size();
        if let Some(camera) = camera {
            check_size("previous_camera", camera, size)?;
            check_plane_test(depth[0].is_some(), normal[0].is_some(), motion.channels())?;
        }
        Ok(Self {
            depth: pair(depth, ["depth", "previous_depth"], |v, name| {
                Input::new(v, name, Channels::One)?.sized(name, size)
            })?,
            normal: pair(normal, ["normal", "previous_normal"], |v, name| {
                Input::new(v, name, COLOR)?.sized(name, size)
            })?,
            ids: pair(ids, ["ids", "previous_ids"], |v, name| {
                Input::new(v, name, Channels::One)?.sized(name, size)
            })?,
            camera: camera.map(|camera| camera.inner),
            params,
        })
    }

    pub fn data(&self) -> SurfaceData<'_> {
        SurfaceData {
            depth: self
                .depth
                .as_ref()
                .map(|pair| pair.each_ref().map(Input::data)),
            normal: self
                .normal
                .as_ref()
                .map(|pair| pair.each_ref().map(Input::data)),
            ids: self
                .ids
                .as_ref()
                .map(|pair| pair.each_ref().map(Input::data)),
            rays: self.camera.as_ref().map(pinhole::Camera::rays),
            params: self.params,
        }
    }
}

/// Both buffers or neither.
fn pair<'py, T>(
    args: [Arg<'_, 'py>; 2],
    names: [&str; 2],
    check: impl Fn(&Bound<'py, PyAny>, &str) -> PyResult<T>,
) -> PyResult<Pair<T>> {
    match args {
        [Some(now), Some(before)] => Ok(Some([check(now, names[0])?, check(before, names[1])?])),
        [None, None] => Ok(None),
        [Some(_), None] => Err(Error::needs(names[0], names[1]).into()),
        [None, Some(_)] => Err(Error::needs(names[1], names[0]).into()),
    }
}

/// The same, without the interpreter.
#[derive(Clone, Copy)]
pub struct SurfaceData<'a> {
    depth: Pair<Interleaved<'a, f32>>,
    normal: Pair<Interleaved<'a, f32>>,
    ids: Pair<Interleaved<'a, u32>>,
    rays: Option<Rays>,
    params: surface::Params,
}

impl SurfaceData<'_> {
    /// Calls `f` with the tests.
    pub fn with<R>(self, size: Size, f: impl FnOnce(Tests) -> R) -> R {
        let depth = self.depth.map(|pair| pair.map(Interleaved::planes));
        let normal = self.normal.map(|pair| pair.map(Interleaved::planes));
        let ids = self.ids.map(|pair| pair.map(Interleaved::planes));
        let surface = |i: usize| Surface {
            depth: depth.as_ref().map(|pair| pair[i].view()),
            normal: normal.as_ref().map(|pair| pair[i].view()),
            ids: ids.as_ref().map(|pair| pair[i].view()),
        };
        f(Tests::new(
            size,
            surface(0),
            surface(1),
            self.rays,
            &self.params,
        ))
    }
}

/// Why each pixel's history is refused, and how much of it is not.
///
/// Looks at the bilinear footprint, in the previous frame, that each pixel's motion points to.
///
/// Parameters
/// ----------
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     Previous minus current position in pixels; the third channel, if given, previous minus current depth.
/// depth, previous_depth : (H, W) array_like of float, optional
///     View-space z, +inf where nothing was hit. Each pair of buffers is given together or not at all.
/// normal, previous_normal : (H, W, 3) array_like of float, optional
///     World space; only directions count.
/// ids, previous_ids : (H, W) array_like of int, optional
///     Must be equal.
/// previous_camera : Camera, optional
///     Turns the depth test from relative depth to plane distance; needs depths, normals and motion of 3 channels.
/// relative_depth : float, default 0.1
///     Largest \|previous - expected\| / expected depth; above 0.
/// plane_distance : float, default 0.01
///     Largest distance of the expected point from the tap's plane, as a share of the expected depth; above 0.
/// normal_angle : float, default 25.0
///     Largest angle between normals in degrees, 0 to 180.
/// out : tuple of (H, W) uint8 and (H, W) float32 arrays, optional
///     Written and returned instead of new arrays. A part may be None.
///
/// Returns
/// -------
/// rejection : (H, W) uint8
///     Bits of `Rejection`: every test that some tap of the footprint fails. 0 where all taps pass.
/// confidence : (H, W) float32
///     The share of the footprint's weight whose taps pass all tests, 0 to 1.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, a buffer without its partner, or a threshold out of range.
///
/// Notes
/// -----
/// Expected depth is depth plus the motion's third channel, or depth itself. Background (+inf) matches background only;
/// NaN or non-positive depth matches nothing. The plane test is that of NRD's ReLAX and ReBLUR; the relative test at a
/// tenth and the angle of 25° are customary values.
#[pyfunction]
#[pyo3(name = "consistency", signature = (motion, *, depth=None, previous_depth=None, normal=None, previous_normal=None, ids=None,
    previous_ids=None, previous_camera=None, relative_depth=0.1, plane_distance=0.01, normal_angle=25.0, out=None))]
pub fn consistency_<'py>(
    py: Python<'py>,
    motion: &Bound<'py, PyAny>,
    depth: Option<&Bound<'py, PyAny>>,
    previous_depth: Option<&Bound<'py, PyAny>>,
    normal: Option<&Bound<'py, PyAny>>,
    previous_normal: Option<&Bound<'py, PyAny>>,
    ids: Option<&Bound<'py, PyAny>>,
    previous_ids: Option<&Bound<'py, PyAny>>,
    previous_camera: Option<&Camera>,
    relative_depth: f32,
    plane_distance: f32,
    normal_angle: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArrayDyn<u8>>, Bound<'py, PyArrayDyn<f32>>)> {
    let ((rejection, confidence), out) = {
        let motion = Input::<f32>::new(motion, "motion", MOTION)?;
        let surface = SurfaceArgs::new(
            &motion,
            [depth, previous_depth],
            [normal, previous_normal],
            [ids, previous_ids],
            previous_camera,
            surface::Params {
                relative_depth,
                plane_distance,
                normal_angle,
            },
        )?;
        let Size { height, width } = motion.size();
        let [first, second] = parts(out.as_ref())?;
        let out = (
            Out::given(first, &[height, width])?,
            Out::given(second, &[height, width])?,
        );
        let (motion, surface) = (motion.data(), surface.data());
        let judged = py.detach(|| {
            let motion: Planes = motion.planes();
            let motion = motion.view();
            let (rejection, confidence) =
                surface.with(motion.size, |tests| consistency::consistency(motion, tests));
            (Outgoing::new(rejection), Outgoing::new(confidence))
        });
        (judged, out)
    };
    Ok((rejection.array(py, out.0)?, confidence.array(py, out.1)?))
}

/// History held to the colours that the current frame has around each pixel.
///
/// Parameters
/// ----------
/// history : (H, W, 3) array_like of float
///     Reprojected colour, linear. Missing pixels stay as they are.
/// color : (H, W, 3) array_like of float
///     The current frame. Missing pixels do not count; where a neighbourhood has no others, history stays.
/// box : {"variance", "minmax", "rounded", "intersection"}, default "variance"
///     What bounds the neighbourhood's colours: their mean ± `gamma` standard deviations; their range; the mean of the
///     ranges of the square and of the cross in it; range and variance box at once.
/// gamma : float, default 1.0
///     Half the side of the variance box in standard deviations; from 0.
/// window : {"3x3", "5x5"}, default "3x3"
///     The neighbourhood.
/// space : {"ycocg", "rgb", "tonemapped-ycocg", "tonemapped-rgb"}, default "ycocg"
///     Where the box is a box. The last two apply c / (1 + max(r, g, b)) first, so that one bright pixel does not open
///     the box to everything.
/// response : {"center", "clamp", "current", "ellipsoid"}, default "center"
///     How a colour outside is brought in: along the line to the box's centre; each channel by itself; along the line to
///     the current colour, itself clamped into the box; or to the ellipsoid with half-axes gamma · deviation · (1.7, 1,
///     1) in YCoCg, (1, 1, 1) in RGB, which needs `box` "variance".
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// history : (H, W, 3) float32
///     A colour inside its box keeps its bits.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, an unknown mode (the error lists the modes), or `gamma` out of range.
///
/// Notes
/// -----
/// Lottes 2011 (range), Karis 2014, *High Quality Temporal Supersampling* (rounded range, YCoCg), Salvi 2016, *An
/// Excursion in Temporal Supersampling* (variance), Playdead 2016, *Temporal Reprojection Anti-Aliasing in INSIDE*
/// (centre), AMD FSR 3.1 (ellipsoid).
#[pyfunction]
#[pyo3(name = "clip_history", signature = (history, color, *, r#box="variance", gamma=1.0, window="3x3", space="ycocg",
    response="center", out=None))]
pub fn clip_history_<'py>(
    py: Python<'py>,
    history: &Bound<'py, PyAny>,
    color: &Bound<'py, PyAny>,
    r#box: &str,
    gamma: f32,
    window: &str,
    space: &str,
    response: &str,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = neighborhood::Params {
        bounds: choice("box", r#box, &neighborhood::Params::BOUNDS)?,
        gamma,
        radius: choice("window", window, &neighborhood::Params::WINDOWS)?,
        space: choice("space", space, &neighborhood::Params::SPACES)?,
        response: choice("response", response, &neighborhood::Params::RESPONSES)?,
    };
    params.check()?;
    let (clipped, out) = {
        let history = Input::<f32>::new(history, "history", COLOR)?;
        let color = Input::<f32>::new(color, "color", COLOR)?.sized("color", history.size())?;
        let out = Out::given(out, history.shape())?;
        let data = [history.data(), color.data()];
        let clipped = py.detach(|| {
            let planes = data.map(Interleaved::planes);
            let [history, color] = planes.each_ref().map(Planes::view);
            Outgoing::new(neighborhood::clip_history(history, color, params))
        });
        (clipped, out)
    };
    clipped.array(py, out)
}
