//! The kernels of the fetch folder.

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::{PyList, PyTuple};

use super::arrays::{Channels, Direct, Input, MOTION, Out, choice, detached, parts};
use super::camera::Camera;
use super::validate::SurfaceArgs;
use crate::error::Error;
use crate::image::{Interleaved, Size};
use crate::kernels::fetch::claims::claims;
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::reproject::{self, reproject_interleaved};
use crate::kernels::fetch::validate::{self, Threshold};

/// Reprojection: fetches history along motion vectors, each tap validated.
///
/// Parameters
/// ----------
/// history : (H, W) or (H, W, C) array_like of float, or list of such
///     The previous frame's image, or several, which are faster in one call than in several.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     Previous minus current position in pixels, x right, y down; the third channel, if given, previous minus current
///     depth. Where it is not finite there is no history.
/// filter : {"bilinear", "nearest", "catmull-rom", "catmull-rom-5", "lanczos-2"}, default "bilinear"
///     Interpolation between pixel centres. The last three stay sharp under repeated resampling: the cubic with 16
///     taps, the cubic without its corner taps (as GPUs compute it from five bilinear fetches), and sinc(x) sinc(x/2).
///     They apply where all their taps are valid; elsewhere bilinear does.
/// fallback : bool, default True
///     Take the mean of the valid pixels of a 3×3 window where less than 0.01 of the footprint is valid.
/// dering : bool, default True
///     Clamp the wide filters to the range of the nearest 2×2 taps.
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
/// out : tuple of values, as `history` has them, and of (H, W) float32 coverage, optional
///     Written and returned instead of new arrays; they may be inputs. A part may be None.
///
/// Returns
/// -------
/// values : float32 array like `history`, or list of such
///     The weighted mean of the valid taps; 0 where less than 0.01 of the footprint is valid and no fallback applies.
/// coverage : (H, W) float32
///     The valid fraction of the footprint, 0 to 1: the 2×2 weights times their trust, summed, or, where the fallback
///     applied, the fraction of the 3×3 window's pixels. 0 where there is no history, or less than 0.01 of it.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, an unknown filter, a buffer without its partner, or a threshold out of range.
///
/// See Also
/// --------
/// consistency : Tests history without fetching it.
/// motion_vectors : Motion from cameras.
/// accumulate : Merges new samples into the result.
///
/// Notes
/// -----
/// A tap is valid when it lies inside the image, is finite in every channel of every history image, and passes the
/// tests that `consistency` describes; its weight is multiplied by their trust. The scheme is that of SVGF ([1]_,
/// section 4.1), with every tap tested on its own. "catmull-rom" is the cubic with a = -½ [2]_, "catmull-rom-5" drops
/// its corner taps [3]_. Without motion, the values are those of `history`, bit for bit, except that −0 becomes 0.
///
/// References
/// ----------
/// .. [1] C. Schied, A. Kaplanyan, C. Wyman, A. Patney, C. R. A. Chaitanya, J. Burgess, S. Liu, C. Dachsbacher, A.
///    Lefohn, M. Salvi, "Spatiotemporal variance-guided filtering: real-time reconstruction for path-traced global
///    illumination", High-Performance Graphics, 2017.
/// .. [2] R. G. Keys, "Cubic convolution interpolation for digital image processing", IEEE Transactions on Acoustics,
///    Speech, and Signal Processing 29(6), 1981.
/// .. [3] J. Jimenez, "Filmic SMAA: sharp morphological and temporal antialiasing", Advances in Real-Time Rendering in
///    Games, SIGGRAPH courses, 2016.
///
/// Examples
/// --------
/// >>> history = np.array([[0.0, 1.0, 2.0, 3.0]])
/// >>> motion = np.zeros((1, 4, 2))
/// >>> motion[..., 0] = 0.5
/// >>> values, coverage = yester.reproject(history, motion)
/// >>> values
/// array([[0.5, 1.5, 2.5, 3. ]], dtype=float32)
/// >>> coverage
/// array([[1. , 1. , 1. , 0.5]], dtype=float32)
#[pyfunction]
#[pyo3(signature = (history, motion, *, filter="bilinear", fallback=true, dering=true, depth=None, previous_depth=None, normal=None,
    previous_normal=None, ids=None, previous_ids=None, object_normal=None, previous_object_normal=None, color=None,
    previous_color=None, previous_motion=None, previous_camera=None, relative_depth=Threshold::hard(0.1),
    plane_distance=Threshold::hard(0.01), normal_angle=Threshold::hard(25.0), relative_luminance=Threshold::hard(0.5),
    speed=None, motion_difference=Threshold::hard(0.2), out=None))]
#[pyo3(
    text_signature = "(history, motion, *, filter='bilinear', fallback=True, dering=True, depth=None, previous_depth=None, \
    normal=None, previous_normal=None, ids=None, previous_ids=None, object_normal=None, previous_object_normal=None, \
    color=None, previous_color=None, previous_motion=None, previous_camera=None, relative_depth=0.1, plane_distance=0.01, \
    normal_angle=25.0, relative_luminance=0.5, speed=None, motion_difference=0.2, out=None)"
)]
#[pyo3(name = "reproject")]
pub fn reproject_<'py>(
    py: Python<'py>,
    history: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
    filter: &str,
    fallback: bool,
    dering: bool,
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
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyArrayDyn<f32>>)> {
    let filter = choice("filter", filter, &Filter::NAMES)?;
    let several = history.is_instance_of::<PyList>() || history.is_instance_of::<PyTuple>();
    let (values, coverage) = {
        let motion = Input::<f32>::new(motion, "motion", MOTION)?;
        let Size { height, width } = motion.size();
        let images: Vec<_> = match several {
            true => history.try_iter()?.collect::<PyResult<_>>()?,
            false => vec![history.clone()],
        };
        if images.is_empty() {
            return Err(Error::value("history", "an image or several", "an empty list").into());
        }
        let named = |i: usize| {
            if several {
                format!("history[{i}]")
            } else {
                "history".into()
            }
        };
        let images: Vec<_> = images
            .iter()
            .enumerate()
            .map(|(i, image)| Input::<f32>::of_size(image, &named(i), Channels::Any, motion.size()))
            .collect::<PyResult<_>>()?;
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

        let history: Vec<_> = images.iter().map(Input::pixels).collect();
        let (motion, tests, before) = (motion.pixels(), surface.tests(), surface.previous_motion());
        let [first, second] = parts(out.as_ref())?;
        let values = if several {
            listed(first, images.len())?
        } else {
            vec![first]
        };
        let out = values
            .into_iter()
            .zip(&images)
            .map(|(out, image)| Out::given(out, image.shape()))
            .collect::<PyResult<Vec<_>>>()?;
        let coverage = Out::given(second, &[height, width])?;
        let mut values = out
            .into_iter()
            .map(|out| Direct::new(py, out))
            .collect::<PyResult<Vec<_>>>()?;
        let mut coverage = Direct::new(py, coverage)?;
        {
            let values = values.iter_mut().map(Direct::data);
            let values = values.collect::<PyResult<Vec<_>>>()?;
            let coverage = coverage.data()?;
            detached(py, || {
                let params = reproject::Params {
                    filter,
                    fallback,
                    dering,
                };
                let claims = before.map(|before| claims(motion, before));
                let tests = tests.with_claims(claims.as_ref().map(Interleaved::pixels));
                reproject_interleaved(&history, motion, tests, params, values, coverage);
            })?;
        }
        (values, coverage)
    };
    let arrays = values.into_iter().map(Direct::array);
    let mut values = arrays.collect::<PyResult<Vec<_>>>()?;
    let values = if several {
        PyList::new(py, values)?.into_any()
    } else {
        values.remove(0).into_any()
    };
    Ok((values, coverage.array()?))
}

/// The arrays of a list of outputs, as many as there are images.
fn listed<'py>(
    out: Option<Bound<'py, PyAny>>,
    count: usize,
) -> PyResult<Vec<Option<Bound<'py, PyAny>>>> {
    let Some(out) = out else {
        return Ok(vec![None; count]);
    };
    let arrays: Vec<_> = match out.is_instance_of::<PyList>() || out.is_instance_of::<PyTuple>() {
        true => out.try_iter()?.collect::<PyResult<_>>()?,
        false => vec![],
    };
    if arrays.len() != count {
        return Err(Error::value(
            "out",
            format!("a list of {count} arrays for the values"),
            arrays.len(),
        )
        .into());
    }
    Ok(arrays.into_iter().map(Some).collect())
}
