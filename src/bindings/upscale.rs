//! The kernels of temporal upscaling.

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{COLOR, Channels, Input, MOTION, Out, choice, fill_parts, vector};
use crate::error::{Error, whole};
use crate::image::Size;
use crate::kernels::judge::{disocclusion, thin_features};
use crate::kernels::merge::resample;
use crate::kernels::smooth::sharpen;
use crate::pixels::PixelsMut;

/// Resample an image's jittered samples to a grid of another size.
///
/// Parameters
/// ----------
/// image : (H, W) or (H, W, C) array_like of float
///     Pixels with NaN or infinity are missing.
/// size : (int, int)
///     Height and width of the new grid, each at least 1. It covers the same area as the image.
/// offset : (2,) array_like of float, default (0, 0)
///     A frame's jitter: the samples' positions relative to pixel centres, x right, y down, in the image's pixels.
/// filter : {"lanczos-2", "catmull-rom", "bilinear", "nearest"}, default "lanczos-2"
///     Reconstruction filter, as in `reproject`; "nearest" copies a sample.
/// dering : bool, default True
///     Clamp "lanczos-2" and "catmull-rom" to the range of the nearest 2×2 samples.
/// out : tuple of (H', W') or (H', W', C) and (H', W') float32 arrays, optional
///     Written and returned instead of new arrays. A part may be None.
///
/// Returns
/// -------
/// resampled : (H', W') or (H', W', C) float32
///     NaN without valid samples. Missing samples have weight 0, except that "nearest" copies them.
/// weight : (H', W') float32
///     Density of samples near each pixel of the grid, in samples per pixel: each sample contributes a normal
///     distribution with a standard deviation of 0.33 pixels of the grid. The average over offsets is the ratio of the
///     pixel counts; on a finer grid the maximum is 1.46, where a sample hits a pixel's centre. On grids of less
///     than half the resolution the average is lower, 12.1 instead of 16 at a quarter, as only the nearest 4×4 samples
///     count.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, an unknown filter, sizes below 1 or above 65536, or an offset that is not finite.
///
/// See Also
/// --------
/// Upscaler : The pipeline that upscales sequences.
/// jitter : Offsets.
/// joint_bilateral_upsample : Upsamples along the edges of guides.
///
/// Notes
/// -----
/// Lanczos with two lobes, ``sinc(x) sinc(x/2)``, as in AMD's FSR 2 [1]_, normalised by the sum of weights. There is no
/// low-pass filter: downsampling aliases. Frames with different offsets, blended by weight, converge to an image at the
/// grid's full resolution [2]_.
///
/// References
/// ----------
/// .. [1] AMD, "FidelityFX Super Resolution 2", GPUOpen, 2022.
/// .. [2] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
///    2014.
///
/// Examples
/// --------
/// >>> image = np.array([[0.0, 1.0], [0.0, 1.0]])
/// >>> resampled, weight = yester.resample(image, (2, 4), filter="bilinear")
/// >>> resampled
/// array([[0.  , 0.25, 0.75, 1.  ],
///        [0.  , 0.25, 0.75, 1.  ]], dtype=float32)
#[pyfunction]
#[pyo3(name = "resample", signature = (image, size, *, offset=None, filter="lanczos-2", dering=true, out=None))]
#[pyo3(
    text_signature = "(image, size, *, offset=(0.0, 0.0), filter='lanczos-2', dering=True, out=None)"
)]
pub fn resample_<'py>(
    py: Python<'py>,
    image: &Bound<'py, PyAny>,
    size: Vec<i128>,
    offset: Option<&Bound<'py, PyAny>>,
    filter: &str,
    dering: bool,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<f32>>)> {
    let filter = choice("filter", filter, &resample::FILTERS)?;
    let [height, width] = size[..] else {
        return Err(Error::value("size", "height and width", format!("{size:?}")).into());
    };
    let side = |value| {
        whole("size", value, "sides of 1 to 65536 pixels", |n: &usize| {
            (1..=65536).contains(n)
        })
    };
    let size = Size {
        height: side(height)?,
        width: side(width)?,
    };
    size.check("size")?;
    let offset = match offset {
        Some(offset) => vector::<2>(offset, "offset")?,
        None => [0.0; 2],
    };
    if !offset.iter().all(|d| d.is_finite()) {
        return Err(Error::value("offset", "finite pixels", format!("{offset:?}")).into());
    }
    let [resampled, weight] = {
        let image = Input::<f32>::new(image, "image", Channels::Any)?;
        let Size { height, width } = size;
        let mut shape = image.shape().to_vec();
        shape[..2].copy_from_slice(&[height, width]);
        let pixels = image.pixels();
        let shapes = [&*shape, &shape[..2]];
        fill_parts(py, out.as_ref(), shapes, |[resampled, weight]| {
            let resampled = PixelsMut::bands(size, pixels.channels, resampled);
            let weight = PixelsMut::bands(size, 1, weight);
            resample::resample(pixels, size, offset, filter, dering, resampled, weight);
        })?
    };
    Ok((resampled.array()?, weight.array()?))
}

/// Measure the fraction of each pixel's history footprint that was hidden by a nearer surface.
///
/// Parameters
/// ----------
/// depth : (H, W) array_like of float
///     View-space z of the current frame; NaN, +inf or not above 0 counts as infinitely far.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     As `motion_vectors` returns it; with the third channel, depths are compared as they were.
/// separation : float, default 0.05
///     Smallest depth difference of an occluder, relative to depth, 0 to 1.
/// out : (H, W) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// share : (H, W) float32
///     0 (visible before) to 1 (hidden, wholly outside the image, or of unknown motion). Of a position partly outside,
///     the part inside counts.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or a separation out of range.
///
/// See Also
/// --------
/// consistency : Tests history by buffers of the previous frame.
/// Upscaler : The pipeline that upscales sequences.
///
/// Notes
/// -----
/// Needs no buffer of the previous frame: the current depths are scattered to their previous positions, nearest depth
/// wins. A surface that lies behind the result by more than ``separation`` times its depth was hidden; the 2×2 pixels
/// at its previous position count by their bilinear weights. Depth and motion are dilated over 3×3 pixels, as in
/// `dilate_motion`. After AMD's FSR 2 [1]_, whose separation is 1.37e-5 times half the image's width in pixels, the
/// resolution of depth buffers [2]_: 0.013 at 1920 pixels. The default also tolerates slopes.
///
/// References
/// ----------
/// .. [1] AMD, "FidelityFX Super Resolution 2", GPUOpen, 2022.
/// .. [2] K. Akeley, J. Su, "Minimum triangle separation for correct z-buffer occlusion", Graphics Hardware, 2006.
///
/// Examples
/// --------
/// >>> depth = np.full((3, 12), 9.0)
/// >>> depth[:, :4] = 1
/// >>> motion = np.zeros((3, 12, 2))
/// >>> motion[:, :4, 0] = 4
/// >>> yester.disocclusion(depth, motion)[1]
/// array([0., 0., 0., 0., 0., 1., 1., 1., 1., 0., 0., 0.], dtype=float32)
#[pyfunction]
#[pyo3(name = "disocclusion", signature = (depth, motion, *, separation=0.05, out=None))]
pub fn disocclusion_<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
    separation: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    disocclusion::check(separation)?;
    let share = {
        let depth = Input::<f32>::new(depth, "depth", Channels::One)?;
        let size = depth.size();
        let motion = Input::<f32>::of_size(motion, "motion", MOTION, size)?;
        let out = Out::given(out, depth.shape())?;
        let (depths, motions) = (depth.pixels().plane(), motion.pixels());
        out.fill(py, |share| {
            let share = PixelsMut::bands(size, 1, share);
            disocclusion::disocclusion(depths, motions, separation, share);
        })?
    };
    share.array()
}

/// Detect bright or dark lines narrower than two pixels.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Linear.
/// similarity : float, default 1.05
///     Largest ratio of luminances that count as similar, at least 1.
/// out : (H, W) float32 array, optional
///     Written and returned instead of a new array.
///
/// Returns
/// -------
/// thin : (H, W) float32
///     1 where a pixel is brighter, or darker, than all dissimilar pixels of its 3×3, and no 2×2 block that contains it
///     is similar throughout; else 0. Neighbours that are missing or outside count as similar.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or a ratio out of range.
///
/// See Also
/// --------
/// Upscaler : Locks thin features.
/// alternation : Detects wider features that flicker.
///
/// Notes
/// -----
/// After the locks of AMD's FSR 2 [1]_: jittered samples miss a thin feature in some frames; there its history must not
/// be clipped to the neighbourhood.
///
/// References
/// ----------
/// .. [1] AMD, "FidelityFX Super Resolution 2", GPUOpen, 2022.
///
/// Examples
/// --------
/// >>> color = np.full((3, 5, 3), 0.1)
/// >>> color[:, 2] = 1
/// >>> yester.thin_features(color)
/// array([[0., 0., 1., 0., 0.],
///        [0., 0., 1., 0., 0.],
///        [0., 0., 1., 0., 0.]], dtype=float32)
#[pyfunction]
#[pyo3(name = "thin_features", signature = (color, *, similarity=1.05, out=None))]
pub fn thin_features_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    similarity: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    thin_features::check(similarity)?;
    let thin = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let out = Out::given(out, &[size.height, size.width])?;
        let pixels = color.pixels();
        out.fill(py, |thin| {
            let thin = PixelsMut::bands(size, 1, thin);
            thin_features::thin_features(pixels, similarity, thin);
        })?
    };
    thin.array()
}

/// Sharpen an image in proportion to its local contrast, without halos.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Linear.
/// strength : float, default 0.5
///     0 (unchanged) to 1.
/// exposure : float, default 1.0
///     The radiance that counts as 1, above 0, as `exposure` returns it.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// sharpened : (H, W, 3) float32
///     Tone-mapped channels stay in the range of the pixel and its four neighbours: there are no halos. Missing pixels
///     stay missing.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, a strength or an exposure out of range.
///
/// See Also
/// --------
/// Upscaler : Sharpens with the option `sharpness`.
///
/// Notes
/// -----
/// Robust contrast-adaptive sharpening, as in AMD's FSR 1 [1]_, on colours ``c / (exposure + max(r, g, b))``: a pixel p
/// with the four neighbours n becomes ``(p + λ Σ n) / (1 + 4λ)``. λ is `strength` times the strongest from -3/16 to 0
/// by which a pixel within the range of its neighbours stays within 0 to 1, the weakest channel's:
/// ``max(-min(n) / (4 max(n)), (1 - max(n)) / (4 min(n) - 4))``.
///
/// References
/// ----------
/// .. [1] AMD, "FidelityFX Super Resolution 1", GPUOpen, 2021: RCAS, robust contrast-adaptive sharpening.
///
/// Examples
/// --------
/// >>> color = np.full((3, 3, 3), 0.4)
/// >>> color[:, 1] = 0.5
/// >>> color[:, 2] = 0.6
/// >>> color[1, 1] = 0.55
/// >>> yester.sharpen(color, strength=1.0)[1, :, 0]
/// array([0.4, 0.6, 0.6], dtype=float32)
#[pyfunction]
#[pyo3(name = "sharpen", signature = (color, *, strength=0.5, exposure=1.0, out=None))]
pub fn sharpen_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    strength: f32,
    exposure: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let params = sharpen::Params { strength, exposure };
    params.check()?;
    let sharpened = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let out = Out::given(out, color.shape())?;
        let pixels = color.pixels();
        out.fill(py, |sharpened| {
            sharpen::sharpen(pixels, params, PixelsMut::bands(size, 3, sharpened));
        })?
    };
    sharpened.array()
}
