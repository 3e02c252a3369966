//! `consistency`, and the arguments of the validation tests, which `reproject` shares.

use numpy::PyArrayDyn;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use super::arrays::{COLOR, Channels, Direct, Input, MOTION, Number, Out, detached, needs, parts};
use super::camera::{Camera, check_size};
use crate::error::Error;
use crate::image::{Interleaved, Pixels, Size, plane_bands};
use crate::kernels::camera::pinhole;
use crate::kernels::fetch::claims::claims;
use crate::kernels::fetch::validate::{self, Surface, Tests, Threshold};
use crate::kernels::judge::consistency;

/// A number, or a ramp's ends: full trust up to the first, none beyond the second.
impl FromPyObject<'_, '_> for Threshold {
    type Error = PyErr;

    fn extract(value: Borrowed<'_, '_, PyAny>) -> PyResult<Self> {
        if let Ok(at) = value.extract() {
            Ok(Self::hard(at))
        } else if let Ok((full, none)) = value.extract() {
            Ok(Self { full, none })
        } else {
            let text = format!(
                "expected a number or a pair of numbers, got {}",
                value.repr()?
            );
            Err(PyTypeError::new_err(text))
        }
    }
}

/// A buffer of the current and of the previous frame.
type Pair<T> = Option<[T; 2]>;

/// The surface tests' checked arguments.
pub struct SurfaceArgs<'py> {
    depth: Pair<Input<'py>>,
    normal: Pair<Input<'py>>,
    ids: Pair<Input<'py, u32>>,
    object_normal: Pair<Input<'py>>,
    color: Pair<Input<'py>>,
    previous_motion: Option<Input<'py>>,
    camera: Option<pinhole::Camera>,
    params: validate::Params,
}

/// The plane test needs depths, normals and motion with a change of depth.
fn check_plane_test(depth: bool, normal: bool, motion_channels: usize) -> PyResult<()> {
    if !depth {
        return Err(needs("previous_camera", "depth"));
    }
    if !normal {
        return Err(needs("previous_camera", "normal"));
    }
    if motion_channels != 3 {
        return Err(Error::value(
            "motion",
            "shape (H, W, 3) for the plane test of previous_camera",
            "(H, W, 2)",
        )
        .into());
    }
    Ok(())
}

type Arg<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

impl<'py> SurfaceArgs<'py> {
    pub fn new(
        motion: &Input<'py>,
        depth: [Arg<'_, 'py>; 2],
        normal: [Arg<'_, 'py>; 2],
        ids: [Arg<'_, 'py>; 2],
        object_normal: [Arg<'_, 'py>; 2],
        color: [Arg<'_, 'py>; 2],
        previous_motion: Arg<'_, 'py>,
        camera: Option<&Camera>,
        params: validate::Params,
    ) -> PyResult<Self> {
        params.check()?;
        let size = motion.size();
        if let Some(camera) = camera {
            check_size("previous_camera", camera, size)?;
            check_plane_test(depth[0].is_some(), normal[0].is_some(), motion.channels())?;
        }
        let previous_motion = Input::optional(previous_motion, "previous_motion", MOTION, size)?;
        let (one, three) = ((Channels::One, size), (COLOR, size));
        Ok(Self {
            depth: pair(depth, "depth", one)?,
            normal: pair(normal, "normal", three)?,
            object_normal: pair(object_normal, "object_normal", three)?,
            color: pair(color, "color", three)?,
            ids: pair(ids, "ids", one)?,
            previous_motion,
            camera: camera.map(|camera| camera.inner),
            params,
        })
    }

    pub fn tests(&self) -> Tests<'_> {
        fn part<'a, T: Number>(pair: &'a Pair<Input<'_, T>>, i: usize) -> Option<Pixels<'a, T>> {
            pair.as_ref().map(|pair| pair[i].pixels())
        }
        let buffers = |i: usize| Surface {
            depth: part(&self.depth, i),
            normal: part(&self.normal, i),
            ids: part(&self.ids, i),
            object_normal: part(&self.object_normal, i),
            color: part(&self.color, i),
        };
        let rays = self.camera.as_ref().map(pinhole::Camera::rays);
        Tests::new(buffers(0), buffers(1), rays, &self.params)
    }

    /// For the test of motion, which looks for [`claims`] first.
    pub fn previous_motion(&self) -> Option<Pixels<'_>> {
        self.previous_motion.as_ref().map(Input::pixels)
    }
}

/// Checks that a buffer was given for both frames or for neither.
fn pair<'py, T: Number>(
    args: [Arg<'_, 'py>; 2],
    name: &str,
    (channels, size): (Channels, Size),
) -> PyResult<Pair<Input<'py, T>>> {
    let previous = &format!("previous_{name}");
    match args {
        [Some(now), Some(before)] => Ok(Some([
            Input::of_size(now, name, channels, size)?,
            Input::of_size(before, previous, channels, size)?,
        ])),
        [None, None] => Ok(None),
        [Some(_), None] => Err(needs(name, previous)),
        [None, Some(_)] => Err(needs(previous, name)),
    }
}

/// History validation: the tests that each pixel's history fails, and the confidence in it.
///
/// Tests the bilinear footprint in the previous frame at the end of each pixel's motion.
///
/// Parameters
/// ----------
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     Previous minus current position in pixels; the third channel, if given, previous minus current depth.
/// depth, previous_depth : (H, W) array_like of float, optional
///     View-space z; +inf or not above 0 is background. Each pair of buffers is given together or not at all.
/// normal, previous_normal : (H, W, 3) array_like of float, optional
///     World space; only directions count. Zeros, as where nothing was hit, have none, and pass.
/// ids, previous_ids : (H, W) array_like of int, optional
///     Taps with another id fail.
/// object_normal, previous_object_normal : (H, W, 3) array_like of float, optional
///     In object space, where they do not rotate with the object. Their directions are compared instead of those of
///     `normal`.
/// color, previous_color : (H, W, 3) array_like of float, optional
///     Compared by luminance. Missing samples pass.
/// previous_motion : (H, W, 2) or (H, W, 3) array_like of float, optional
///     The previous frame's own motion. Tells what is uncovered from what covered it where no other buffer does. Where
///     it is not finite, it is unknown, and all pass.
/// previous_camera : Camera, optional
///     Turns the depth test from relative depth to plane distance; needs depths, normals and motion of 3 channels.
/// relative_depth : float or (float, float), default 0.1
///     Largest ``|previous - expected| / expected`` depth; above 0. Of this and all thresholds below, a pair is a ramp:
///     full trust up to the first, none beyond the second, linear between.
/// plane_distance : float or (float, float), default 0.01
///     Largest distance of the expected point from the tap's plane, relative to the expected depth; above 0.
/// normal_angle : float or (float, float), default 25.0
///     Largest angle between normals in degrees, 0 to 180. The ramp is linear in the cosine.
/// relative_luminance : float or (float, float), default 0.5
///     Largest ``|l - l'| / max(|l|, |l'|)`` of the luminances; from 0.
/// speed : float or (float, float), optional
///     Longest motion in pixels; from 0. By default any.
/// motion_difference : float or (float, float), default 0.2
///     Largest difference of the pixel's motion from the tap's in the previous frame, in pixels, above twice the least
///     such difference among all pixels whose 2×2 footprints have the tap; from 0, +inf for any.
/// out : tuple of (H, W) uint8 and (H, W) float32 arrays, optional
///     Written and returned instead of new arrays. A part may be None.
///
/// Returns
/// -------
/// rejection : (H, W) uint8
///     Bits of `Rejection`: every test that some tap of the footprint fails entirely.
/// confidence : (H, W) float32
///     The taps' weights times their trust, summed: with hard thresholds, the fraction of the footprint that passes all
///     tests. 0 to 1.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, a buffer without its partner, or a threshold out of range.
///
/// See Also
/// --------
/// reproject : Fetches history, with these tests.
/// blend_factor : Turns confidence into a blend factor.
/// Rejection : The tests.
///
/// Notes
/// -----
/// Expected depth is depth plus the motion's third channel, or depth itself. Background, of depth +inf or not above 0,
/// matches background only, and NaN nothing. The plane test is that of NRD's ReLAX and ReBLUR [1]_; the relative test
/// at a tenth and the angle of 25° are customary values.
///
/// With `previous_motion`, of the pixels that come from one place those are taken to have been there whose motion has
/// changed least, so that a change of speed of the whole image, such as by a camera in the hand, rejects nothing. The
/// claim c of a tap is the least ``|m - m'|`` of all pixels whose footprint has it, 0 if there is none, with m' its own
/// motion in the previous frame; ``|m - m'| - 2c`` is compared. In leaves thinner than a pixel, motion says nothing:
/// leave it out.
///
/// References
/// ----------
/// .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
///    hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.
///
/// Examples
/// --------
/// >>> depth = np.array([[1.0, 1.0, 5.0]])
/// >>> previous_depth = np.array([[1.0, 5.0, 5.0]])
/// >>> rejection, confidence = yester.consistency(
/// ...     np.zeros((1, 3, 2)), depth=depth, previous_depth=previous_depth
/// ... )
/// >>> rejection
/// array([[0, 2, 0]], dtype=uint8)
/// >>> yester.Rejection(int(rejection[0, 1]))
/// <Rejection.DEPTH: 2>
/// >>> confidence
/// array([[1., 0., 1.]], dtype=float32)
#[pyfunction]
#[pyo3(name = "consistency", signature = (motion, *, depth=None, previous_depth=None, normal=None, previous_normal=None, ids=None,
    previous_ids=None, object_normal=None, previous_object_normal=None, color=None, previous_color=None,
    previous_motion=None, previous_camera=None, relative_depth=Threshold::hard(0.1), plane_distance=Threshold::hard(0.01),
    normal_angle=Threshold::hard(25.0), relative_luminance=Threshold::hard(0.5), speed=None,
    motion_difference=Threshold::hard(0.2), out=None))]
#[pyo3(
    text_signature = "(motion, *, depth=None, previous_depth=None, normal=None, previous_normal=None, ids=None, \
    previous_ids=None, object_normal=None, previous_object_normal=None, color=None, previous_color=None, \
    previous_motion=None, previous_camera=None, relative_depth=0.1, plane_distance=0.01, normal_angle=25.0, \
    relative_luminance=0.5, speed=None, motion_difference=0.2, out=None)"
)]
pub fn consistency_<'py>(
    py: Python<'py>,
    motion: &Bound<'py, PyAny>,
    depth: Option<&Bound<'py, PyAny>>,
    previous_depth: Option<&Bound<'py, PyAny>>,
    normal: Option<&Bound<'py, PyAny>>,
    previous_normal: Option<&Bound<'py, PyAny>>,
    ids: Option<&Bound<'py, PyAny>>,
    previous_ids: Option<&Bound<'py, PyAny>>,
    object_normal: Option<&Bound<'py, PyAny>>,
    previous_object_normal: Option<&Bound<'py, PyAny>>,
    color: Option<&Bound<'py, PyAny>>,
    previous_color: Option<&Bound<'py, PyAny>>,
    previous_motion: Option<&Bound<'py, PyAny>>,
    previous_camera: Option<&Camera>,
    relative_depth: Threshold,
    plane_distance: Threshold,
    normal_angle: Threshold,
    relative_luminance: Threshold,
    speed: Option<Threshold>,
    motion_difference: Threshold,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArrayDyn<u8>>, Bound<'py, PyArrayDyn<f32>>)> {
    let (rejection, confidence) = {
        let motion = Input::<f32>::new(motion, "motion", MOTION)?;
        let surface = SurfaceArgs::new(
            &motion,
            [depth, previous_depth],
            [normal, previous_normal],
            [ids, previous_ids],
            [object_normal, previous_object_normal],
            [color, previous_color],
            previous_motion,
            previous_camera,
            validate::Params {
                relative_depth,
                plane_distance,
                normal_angle,
                relative_luminance,
                speed,
                motion_difference,
            },
        )?;
        let size = motion.size();
        let shape = [size.height, size.width];
        let [first, second] = parts(out.as_ref())?;
        let out = (Out::given(first, &shape)?, Out::given(second, &shape)?);
        let (motion, tests, before) = (motion.pixels(), surface.tests(), surface.previous_motion());
        let mut rejection = Direct::new(py, out.0)?;
        let mut confidence = Direct::new(py, out.1)?;
        {
            let (rejection, confidence) = (rejection.data()?, confidence.data()?);
            detached(py, || {
                let claims = before.map(|before| claims(motion, before));
                let tests = tests.with_claims(claims.as_ref().map(Interleaved::pixels));
                let outs = plane_bands(rejection, size).zip(plane_bands(confidence, size));
                consistency::consistency(motion, tests, outs);
            })?;
        }
        (rejection, confidence)
    };
    Ok((rejection.array()?, confidence.array()?))
}
