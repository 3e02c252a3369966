//! Joint bilateral reconstruction: the kernels that fill pixels that were not traced.

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{COLOR, Channels, Input, Out, needs, vector};
use super::smooth::{GuideArgs, sigmas};
use crate::error::Error;
use crate::image::{Image, Pixels, Size};
use crate::kernels::fetch::validate::Surface;
use crate::kernels::smooth::guide::Guide;
use crate::kernels::smooth::joint_bilateral::{
    Grid, Params, joint_bilateral_upsample, reconstruct,
};

/// Fill missing pixels from neighbours on the same surface.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Illumination (see `demodulate`) if there is albedo. Pixels with NaN or infinity are missing.
/// depth : (H, W) array_like of float, optional
///     View-space z; +inf, NaN or not above 0 is background.
/// normal : (H, W, 3) array_like of float, optional
///     World space, unit length.
/// ids : (H, W) array_like of int, optional
///     Pixels with different ids do not mix.
/// radius : int, default 2
///     Radius of the window in pixels, 1 to 16.
/// sigma : float, default 1.0
///     Standard deviation of the spatial weight, in pixels; above 0.
/// sigma_normal, sigma_depth, sigma_plane : float, default 128.0, 0.5 and 0.05
///     As in `atrous`.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     Missing pixels become the weighted mean of the window's valid pixels, or NaN where no surface in it is similar;
///     the others keep their bits.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range.
///
/// See Also
/// --------
/// joint_bilateral_upsample : Reconstructs from samples on a regular grid.
/// pull_push : Fills holes without regard to surfaces.
/// HalfRes : A pipeline for frames of which a part is traced.
///
/// Notes
/// -----
/// The weight of a pixel at a distance of d is ``exp(-d²/(2 sigma²) - en - ez)``, with en and ez as in `atrous`, and
/// zero between ids or between surface and background: a joint bilateral filter [1]_ whose samples may lie anywhere.
/// Weights below 2⁻⁶⁴ count as 0: without guides, samples from 9.4 sigma on.
///
/// References
/// ----------
/// .. [1] J. Kopf, M. F. Cohen, D. Lischinski, M. Uyttendaele, "Joint bilateral upsampling", ACM Transactions on
///    Graphics 26(3), 2007.
///
/// Examples
/// --------
/// >>> color = np.ones((1, 4, 3))
/// >>> color[0, 1] = np.nan
/// >>> color[0, 2:] = 5
/// >>> yester.reconstruct(color, ids=[[1, 1, 2, 2]])[0, :, 0]
/// array([1., 1., 5., 5.], dtype=float32)
#[pyfunction]
#[pyo3(signature = (color, *, depth=None, normal=None, ids=None, radius=2, sigma=1.0, sigma_normal=128.0,
    sigma_depth=0.5, sigma_plane=0.05, out=None))]
#[pyo3(name = "reconstruct")]
pub fn reconstruct_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    depth: Option<&Bound<'py, PyAny>>,
    normal: Option<&Bound<'py, PyAny>>,
    ids: Option<&Bound<'py, PyAny>>,
    radius: i128,
    sigma: f32,
    sigma_normal: f32,
    sigma_depth: f32,
    sigma_plane: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = Params {
        radius: Params::radius(radius)?,
        sigma,
        sigmas: sigmas(sigma_normal, sigma_depth, sigma_plane),
    };
    params.check()?;
    let filled = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let guide = GuideArgs::new(size, depth, normal, ids)?;
        let out = Out::given(out, color.shape())?;
        let (color, guide) = (color.pixels(), guide.surface());
        out.fill(py, |filled| {
            let guide = Guide::new(size, params.radius, guide, None);
            let image = reconstruct(color, &guide, params);
            image.view().interleave(filled);
        })?
    };
    filled.array()
}

/// Upsample a low-resolution image along the edges of full-resolution buffers.
///
/// Parameters
/// ----------
/// color : (⌈H/scale⌉, ⌈W/scale⌉, 3) array_like of float
///     One sample for each block of scale×scale pixels; illumination (see `demodulate`) if there is albedo. Pixels with
///     NaN or infinity are missing.
/// depth : (H, W) array_like of float, optional
///     View-space z in full resolution; +inf, NaN or not above 0 is background. One of `depth`, `normal` and `ids` must
///     be given: they determine the size.
/// normal : (H, W, 3) array_like of float, optional
///     World space, unit length.
/// ids : (H, W) array_like of int, optional
///     Samples with another id have weight 0.
/// low_depth, low_normal, low_ids : array_like, optional
///     Buffers at the samples, of the size of `color`; by default the full-resolution buffers' values at the pixels
///     that contain the samples.
/// scale : int, default 2
///     Side of a block in pixels, 1 to 16.
/// offset : (float, float), optional
///     Position of each sample in its block: pixels right and down from the centre of its first pixel, 0 to scale - 1.
///     Integers are pixel centres; the default is the block's centre, (scale - 1)/2. A sample between two centres is in
///     the later pixel. In blocks that the border cuts, it is moved by whole pixels, into the last one inside.
/// radius : int, default 2
///     Radius of the window in multiples of `scale` pixels, 1 to 16.
/// sigma : float, default 1.0
///     Standard deviation of the spatial weight, in multiples of `scale` pixels; above 0.
/// sigma_normal, sigma_depth, sigma_plane : float, default 128.0, 0.5 and 0.05
///     As in `atrous`.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array.
///
/// Returns
/// -------
/// color : (H, W, 3) float32
///     NaN where no sample in the window is on a similar surface.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, sizes that do not fit each other, or parameters out of range.
///
/// See Also
/// --------
/// reconstruct : Reconstructs from samples at arbitrary pixels.
/// resample : Upsamples without guides.
///
/// Notes
/// -----
/// The mean of the samples in the window, each with the weight ``exp(-d²/(2 (sigma scale)²) - en - ez)`` at a distance
/// of d pixels, with en and ez as in `atrous` and zero between ids or between surface and background, or below 2⁻⁶⁴:
/// joint bilateral upsampling [1]_, here with geometry as guide instead of colour. `reconstruct` does the same for
/// samples at arbitrary pixels. No pipeline uses this function: `HalfRes` takes full-resolution frames with missing
/// samples and fills them by `reconstruct`.
///
/// References
/// ----------
/// .. [1] J. Kopf, M. F. Cohen, D. Lischinski, M. Uyttendaele, "Joint bilateral upsampling", ACM Transactions on
///    Graphics 26(3), 2007.
///
/// Examples
/// --------
/// >>> color = np.array([[[1.0] * 3, [5.0] * 3]])
/// >>> ids = np.array([[1, 1, 1, 2], [1, 1, 1, 2]])
/// >>> yester.joint_bilateral_upsample(color, ids=ids, low_ids=[[1, 2]])[..., 0]
/// array([[1., 1., 1., 5.],
///        [1., 1., 1., 5.]], dtype=float32)
#[pyfunction]
#[pyo3(signature = (color, *, depth=None, normal=None, ids=None, low_depth=None, low_normal=None,
    low_ids=None, scale=2, offset=None, radius=2, sigma=1.0, sigma_normal=128.0, sigma_depth=0.5, sigma_plane=0.05,
    out=None))]
#[pyo3(name = "joint_bilateral_upsample")]
pub fn joint_bilateral_upsample_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    depth: Option<&Bound<'py, PyAny>>,
    normal: Option<&Bound<'py, PyAny>>,
    ids: Option<&Bound<'py, PyAny>>,
    low_depth: Option<&Bound<'py, PyAny>>,
    low_normal: Option<&Bound<'py, PyAny>>,
    low_ids: Option<&Bound<'py, PyAny>>,
    scale: i128,
    offset: Option<&Bound<'py, PyAny>>,
    radius: i128,
    sigma: f32,
    sigma_normal: f32,
    sigma_depth: f32,
    sigma_plane: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = Params {
        radius: Params::radius(radius)?,
        sigma,
        sigmas: sigmas(sigma_normal, sigma_depth, sigma_plane),
    };
    params.check()?;
    let scale = Grid::scale(scale)?;
    let offset = match offset {
        Some(offset) => vector::<2>(offset, "offset")?.map(|d| d as f32),
        None => [(scale as f32 - 1.0) / 2.0; 2],
    };
    for (name, full, low) in [
        ("depth", depth, low_depth),
        ("normal", normal, low_normal),
        ("ids", ids, low_ids),
    ] {
        if low.is_some() && full.is_none() {
            return Err(needs(&format!("low_{name}"), name));
        }
    }
    let upsampled = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let full = match (depth, normal, ids) {
            (Some(depth), _, _) => Input::<f32>::new(depth, "depth", Channels::One)?.size(),
            (_, Some(normal), _) => Input::<f32>::new(normal, "normal", COLOR)?.size(),
            (_, _, Some(ids)) => Input::<u32>::new(ids, "ids", Channels::One)?.size(),
            (None, None, None) => {
                let expected = "one of them in full resolution";
                return Err(Error::value("depth, normal, ids", expected, "none").into());
            }
        };
        let grid = Grid {
            full,
            scale,
            offset,
        };
        grid.check()?;
        check_fits(grid, color.size())?;
        let guide = GuideArgs::new(full, depth, normal, ids)?;
        let size = color.size();
        let depth = Input::<f32>::optional(low_depth, "low_depth", Channels::One, size)?;
        let normal = Input::<f32>::optional(low_normal, "low_normal", COLOR, size)?;
        let ids = Input::<u32>::optional(low_ids, "low_ids", Channels::One, size)?;
        let out = Out::given(out, &[full.height, full.width, 3])?;
        let (color, guide) = (color.pixels(), guide.surface());
        let low = Surface {
            depth: depth.as_ref().map(Input::pixels),
            normal: normal.as_ref().map(Input::pixels),
            ids: ids.as_ref().map(Input::pixels),
            ..Default::default()
        };
        out.fill(py, |upsampled| {
            let reach = params.radius * scale;
            let shown = shown(low, guide, grid, reach);
            let guide = Guide::new(full, reach, guide, None);
            let guides = [&guide, shown.as_ref().unwrap_or(&guide)];
            let image = joint_bilateral_upsample(color, grid, guides, params);
            image.view().interleave(upsampled);
        })?
    };
    upsampled.array()
}

fn check_fits(grid: Grid, low: Size) -> PyResult<()> {
    let expected = grid.low();
    if low == expected {
        return Ok(());
    }
    let Grid { full, scale, .. } = grid;
    let expected =
        format!("{expected}, a sample for each block of {scale}x{scale} of the full {full}");
    Err(Error::value("color", expected, low).into())
}

/// Guide of the samples, if it differs from the full guide at their pixels.
fn shown(low: Surface, full: Surface, grid: Grid, reach: usize) -> Option<Guide> {
    let floats = |low: Option<Pixels>| low.map(|low| grid.scatter(low, 0.0));
    let (depth, normal) = (floats(low.depth), floats(low.normal));
    let ids = low.ids.map(|ids| grid.scatter(ids, 0));
    if depth.is_none() && normal.is_none() && ids.is_none() {
        return None;
    }
    let surface = Surface {
        depth: depth.as_ref().map(Image::pixels).or(full.depth),
        normal: normal.as_ref().map(Image::pixels).or(full.normal),
        ids: ids.as_ref().map(Image::pixels).or(full.ids),
        ..Default::default()
    };
    Some(Guide::new(grid.full, reach, surface, None))
}
