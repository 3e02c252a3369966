//! The kernels that scatter points, fill the holes between them, and blend.

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{COLOR, Channels, Input, MOTION, fill_parts};
use super::camera::{Camera, check_size};
use crate::image::Size;
use crate::kernels::fetch::pull_push::{self, pull_push};
use crate::kernels::fetch::splat::{self, Points, Splats, splat};
use crate::kernels::merge::recirculate::{self, Known, recirculate};
use crate::pixels::PixelsMut;

type Array<'py> = Bound<'py, PyArrayDyn<f32>>;

const OFFSET: Channels = Channels::Of(&[2]);

/// Scatter the previous frame's pixels as points to where they appear now: forward reprojection.
///
/// Every pixel of the previous frame is a world-space point, static unless `drift` says otherwise. In the current frame
/// it covers a square as large as its old pixel appears now. The nearest point that covers a pixel determines the
/// visible surface there.
///
/// Parameters
/// ----------
/// color : (H, W) or (H, W, C) array_like of float
///     The points' values. NaN or infinity in a channel: no point.
/// depth : (H, W) array_like of float
///     Distance along the previous camera's axis; +inf for the background, which only turns with the camera. NaN, or
///     not above 0: no point.
/// camera, previous_camera : Camera
///     Of the current and the previous frame, without jitter, both of the image's size.
/// offset : (H, W, 2) array_like of float, optional
///     Position of each point relative to its pixel's centre, in pixels, x right, y down; -0.5 and 0.5 are the pixel's
///     borders and belong to it. By default 0.
/// drift : (H, W, 2) or (H, W, 3) array_like of float, optional
///     The points' own motion: previous minus current position in pixels, and depth; that is, `Frame.motion` minus the
///     `motion_vectors` of a static scene. Values that are not finite count as 0.
/// quality : (H, W) array_like of float, optional
///     Weight of each point, above 0; pixels with another value are no points. By default 1.
/// tolerance : float, default 0.1
///     Largest depth difference from the nearest point, relative to its depth, of points of the same surface; above 0.
/// reach : float, default 0.0
///     Pixels, 0 to 1, by which squares are enlarged on every side to fill pixels that no square covers. Points keep
///     their sub-pixel positions and leave cracks as they move; 0.5 closes them.
/// out : tuple of float32 arrays like the results, optional
///     Written and returned instead of new arrays; they may be inputs. A part may be None.
///
/// Returns
/// -------
/// color : float32 array like `color`
///     Weighted mean of the points of the nearest surface; NaN in holes, which no point covers.
/// depth : (H, W) float32
///     Their mean distance along the current camera's axis; NaN in holes.
/// offset : (H, W, 2) float32
///     Their mean position relative to the pixel's centre, -0.5 to 0.5; NaN in holes. Passed to the next call, it
///     prevents blur and sub-pixel drift over many frames.
/// quality : (H, W) float32
///     Mean of their ``quality / s**4``, weighted as `color` is; 0 in holes.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, a camera of another size, or a tolerance or reach out of range.
///
/// See Also
/// --------
/// pull_push : Fills the holes.
/// reproject : Fetches instead of scattering.
/// Recirculation : The pipeline that keeps history as points.
///
/// Notes
/// -----
/// A point of depth z that is now at z' covers a square of side ``s = 1 + 1.01 max(0, z/z' - 1)`` (z/z' times the ratio
/// of the focal lengths; at most 16 pixels), and its weight becomes ``quality / s**4``: small points override large
/// ones. With the nearest point at z0, weights fall linearly to 0 at ``z' = z0 (1 + tolerance)``. In a pixel that it
/// fills by `reach`, a point has the weight of its enlarged square. Points are summed in the order of their source
/// pixels, whatever the number of threads. In pixels other than its own, a large point counts as lying at the centre.
/// Equal cameras leave everything unchanged. That points are weighted by their size and depth is from a developer's
/// diary [1]_; the formula is our own.
///
/// References
/// ----------
/// .. [1] T. Lottes, "Reprojection 2", timothylottes.github.io/20081218.html, 2008.
///
/// Examples
/// --------
/// >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
/// >>> previous = yester.Camera.from_look_at([2.5, 0, 5], [2.5, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
/// >>> image = np.tile([1.0, 2.0, 3.0, 4.0], (4, 1))
/// >>> color, depth, offset, quality = yester.splat(image, np.full((4, 4), 5.0), camera, previous)
/// >>> color[0]
/// array([nan,  1.,  2.,  3.], dtype=float32)
#[pyfunction]
#[pyo3(name = "splat", signature = (color, depth, camera, previous_camera, *, offset=None, drift=None, quality=None,
    tolerance=0.1, reach=0.0, out=None))]
pub fn splat_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    depth: &Bound<'py, PyAny>,
    camera: &Camera,
    previous_camera: &Camera,
    offset: Option<&Bound<'py, PyAny>>,
    drift: Option<&Bound<'py, PyAny>>,
    quality: Option<&Bound<'py, PyAny>>,
    tolerance: f32,
    reach: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Array<'py>, Array<'py>, Array<'py>, Array<'py>)> {
    let params = splat::Params { tolerance, reach };
    params.check()?;
    let [color, depth, offset, quality] = {
        let depth = Input::<f32>::new(depth, "depth", Channels::One)?;
        let size = depth.size();
        let color = Input::<f32>::of_size(color, "color", Channels::Any, size)?;
        for (name, camera) in [("camera", camera), ("previous_camera", previous_camera)] {
            check_size(name, camera, size)?;
        }
        let offset = Input::<f32>::optional(offset, "offset", OFFSET, size)?;
        let drift = Input::<f32>::optional(drift, "drift", MOTION, size)?;
        let quality = Input::<f32>::optional(quality, "quality", Channels::One, size)?;
        let points = Points {
            color: color.pixels(),
            depth: depth.pixels(),
            offset: offset.as_ref().map(|offset| offset.pixels()),
            drift: drift.as_ref().map(|drift| drift.pixels()),
            quality: quality.as_ref().map(|quality| quality.pixels()),
        };
        let Size { height, width } = size;
        let shapes: [&[usize]; 4] = [
            color.shape(),
            &[height, width],
            &[height, width, 2],
            &[height, width],
        ];
        let cameras = [&camera.inner, &previous_camera.inner];
        fill_parts(
            py,
            out.as_ref(),
            shapes,
            |[color, depth, offset, quality]| {
                let splats = Splats {
                    color,
                    depth,
                    offset,
                    quality,
                };
                splat(points, cameras, params, splats);
            },
        )?
    };
    Ok((
        color.array()?,
        depth.array()?,
        offset.array()?,
        quality.array()?,
    ))
}

/// Fill holes from a pyramid of ever coarser images, by pull-push.
///
/// Parameters
/// ----------
/// color : (H, W) or (H, W, C) array_like of float
///     NaN or infinity in a channel makes a hole.
/// quality : (H, W) array_like of float, optional
///     Weight of each pixel; pixels whose weight is not above 0 and finite are holes. By default 1.
/// factor : int, default 2
///     Ratio of the sides of successive levels, 2 to 16.
/// levels : int, optional
///     Number of coarser levels, at least 1. By default down to a single pixel, so that one valid pixel fills all
///     holes.
/// out : tuple of float32 arrays like the results, optional
///     Written and returned instead of new arrays; they may be inputs. A part may be None.
///
/// Returns
/// -------
/// color : float32 array like `color`
///     Valid pixels are unchanged. NaN in holes that no level can fill: with too few levels, or without a valid pixel.
/// quality : (H, W) float32
///     Unchanged for valid pixels; in filled holes, the lower the coarser the level that filled them; 0 where `color`
///     is NaN.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, or a factor or number of levels out of range.
///
/// See Also
/// --------
/// splat : Leaves such holes.
/// reconstruct : Fills holes within surfaces.
///
/// Notes
/// -----
/// Pull: ``c = Σ q c / Σ q``, ``q = Σ q / (n factor²)`` over the n pixels of a block. Push: bilinear interpolation
/// weighted by quality, so that near and detailed points override the others. With ``factor=4, levels=2`` the levels
/// have 1, 1/4 and 1/16 of the size, as in a developer's diary [1]_, which planned ``factor=2`` next. Pull-push is due
/// to Gortler et al. ([2]_, section 3.4).
///
/// References
/// ----------
/// .. [1] T. Lottes, "Reprojection 2", timothylottes.github.io/20081218.html, 2008.
/// .. [2] S. J. Gortler, R. Grzeszczuk, R. Szeliski, M. F. Cohen, "The lumigraph", SIGGRAPH, 1996.
///
/// Examples
/// --------
/// >>> filled, quality = yester.pull_push([[1.0, np.nan, np.nan, 3.0]])
/// >>> filled
/// array([[1. , 1.5, 2.5, 3. ]], dtype=float32)
/// >>> quality
/// array([[1.   , 0.125, 0.125, 1.   ]], dtype=float32)
#[pyfunction]
#[pyo3(name = "pull_push", signature = (color, quality=None, *, factor=2, levels=None, out=None))]
pub fn pull_push_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    quality: Option<&Bound<'py, PyAny>>,
    factor: i128,
    levels: Option<i128>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let params = pull_push::Params {
        factor: pull_push::Params::factor(factor)?,
        levels: levels.map_or(Ok(usize::MAX), pull_push::Params::levels)?,
    };
    let [color, quality] = {
        let mut color = Input::<f32>::new(color, "color", Channels::Any)?;
        let quality = quality.map(|quality| Input::<f32>::new(quality, "quality", Channels::One));
        let quality = quality.transpose()?;
        if let Some(quality) = &quality {
            color = color.sized("color", quality.size())?;
        }
        let size = color.size();
        let shapes: [&[usize]; 2] = [color.shape(), &[size.height, size.width]];
        let color = color.pixels();
        let quality = quality.as_ref().map(|quality| quality.pixels());
        fill_parts(py, out.as_ref(), shapes, |[filled, known]| {
            pull_push(color, quality, params, filled, known);
        })?
    };
    Ok((color.array()?, quality.array()?))
}

/// Blend the new, hole-filled image with reprojected history by quality, both motion-blurred.
///
/// Parameters
/// ----------
/// filled : (H, W, 3) array_like of float
///     The new image, as `pull_push` returns it.
/// filled_quality : (H, W) array_like of float
///     Its quality. A pixel is a hole if its quality is not above 0 and finite or its colour is not finite.
/// reprojected : (H, W, 3) array_like of float
///     Reprojected history, as `splat` returns it. With `fetch`, the previous frame's result.
/// reprojected_quality : (H, W) array_like of float
///     Its quality.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     Previous minus current position in pixels, as `motion_vectors` returns it; values that are not finite count as
///     0.
/// blur : float, default 0.25
///     Distance of the two outer taps of the motion blur, forwards and backwards, as a fraction of the motion, 0 to 1;
///     0 for no blur.
/// share : (float, float), default (0.0, 1.0)
///     Range to which the weight of the new image is clamped where both are valid, within 0 to 1.
/// fade : float, default 64.0
///     Length of motion in pixels over which the quality of history falls to a half; above 0.
/// limit : float, default 8.0
///     Upper bound of the resulting quality; above 0.
/// fetch : bool, default False
///     `reprojected` and its quality are those of the previous frame and are fetched here, at the end of `motion`;
///     outside the image there is no history.
/// out : tuple of (H, W, 3) and (H, W) float32 arrays, optional
///     Written and returned instead of new arrays; they may be inputs. A part may be None.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     NaN where both images are missing.
/// quality : (H, W) float32
///     For the next frame; 0 where both are missing.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, or a parameter out of range.
///
/// See Also
/// --------
/// pull_push : Fills the holes of the new image.
/// splat : Scatters the history to this frame.
/// Recirculation : The pipeline that keeps history as points.
///
/// Notes
/// -----
/// Each image is the mean of three bilinear taps at ``-blur``, 0 and ``blur`` times the motion, over valid pixels. With
/// `fetch`, those of history are centred on the position plus the motion, and its quality is one bilinear tap there.
/// With ``q = reprojected_quality / (1 + |motion| / fade)`` the weight of the new image is
/// ``filled_quality / (filled_quality + q)``, and the resulting quality is ``filled_quality + q``: the more samples a
/// pixel has, the less a new one changes it. After a developer's diary [1]_; how quality falls and adds up is our
/// choice.
///
/// References
/// ----------
/// .. [1] T. Lottes, "Reprojection 2", timothylottes.github.io/20081218.html, 2008.
///
/// Examples
/// --------
/// >>> new, old = np.ones((1, 2, 3)), np.zeros((1, 2, 3))
/// >>> color, quality = yester.recirculate(new, [[1.0, 1.0]], old, [[1.0, 3.0]], np.zeros((1, 2, 2)))
/// >>> color[..., 0], quality
/// (array([[0.5 , 0.25]], dtype=float32), array([[2., 4.]], dtype=float32))
#[pyfunction]
#[pyo3(name = "recirculate", signature = (filled, filled_quality, reprojected, reprojected_quality, motion, *, blur=0.25,
    share=(0.0, 1.0), fade=64.0, limit=8.0, fetch=false, out=None))]
#[pyo3(
    text_signature = "(filled, filled_quality, reprojected, reprojected_quality, motion, *, blur=0.25, share=(0.0, 1.0), \
    fade=64.0, limit=8.0, fetch=False, out=None)"
)]
pub fn recirculate_<'py>(
    py: Python<'py>,
    filled: &Bound<'py, PyAny>,
    filled_quality: &Bound<'py, PyAny>,
    reprojected: &Bound<'py, PyAny>,
    reprojected_quality: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
    blur: f32,
    share: (f32, f32),
    fade: f32,
    limit: f32,
    fetch: bool,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Array<'py>, Array<'py>)> {
    let params = recirculate::Params {
        blur,
        share: share.into(),
        fade,
        limit,
        fetch,
    };
    params.check()?;
    let [color, quality] = {
        let filled = Input::<f32>::new(filled, "filled", COLOR)?;
        let size = filled.size();
        let sized = |value, name, channels| Input::<f32>::of_size(value, name, channels, size);
        let filled_quality = sized(filled_quality, "filled_quality", Channels::One)?;
        let reprojected = sized(reprojected, "reprojected", COLOR)?;
        let reprojected_quality = sized(reprojected_quality, "reprojected_quality", Channels::One)?;
        let motion = sized(motion, "motion", MOTION)?;
        let shapes: [&[usize]; 2] = [filled.shape(), &[size.height, size.width]];
        let [new, old] = [
            (&filled, &filled_quality),
            (&reprojected, &reprojected_quality),
        ]
        .map(|(color, quality)| Known {
            color: color.pixels(),
            quality: quality.pixels(),
        });
        let motion = motion.pixels();
        fill_parts(py, out.as_ref(), shapes, |[color, quality]| {
            let color = PixelsMut::bands(size, 3, color);
            let quality = PixelsMut::bands(size, 1, quality);
            recirculate(new, old, motion, params, color, quality);
        })?
    };
    Ok((color.array()?, quality.array()?))
}
