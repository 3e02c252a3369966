//! The regression.

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{COLOR, Channels, Direct, Input, Out, choice, detached, needs, parts};
use super::camera::{Camera, check_size, place};
use crate::image::Size;
use crate::kernels::camera::pinhole;
use crate::kernels::smooth::regress::{self, Features, Place};

/// Fit colour, block by block, to feature buffers: block-wise multi-order feature regression.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Linear, usually illumination (`demodulate`). Pixels with NaN or infinity are missing.
/// normal : (H, W, 3) array_like of float, optional
///     World space, unit length; not finite or zero where there is no surface.
/// geometry : (H, W) or (H, W, 3) array_like of float, optional
///     Depth, which needs `camera`, or world-space positions; not finite where there is no surface. Depth up to 0 means
///     no surface, too.
/// camera : Camera, optional
///     This frame's camera.
/// weight : (H, W) array_like of float, optional
///     Weight of each pixel, at least 0; pixels whose weight is not finite or below 0 keep their colour. By default 1.
/// block : int, default 32
///     Side of the blocks in pixels, 4 to 256. An image smaller than that is one block.
/// offset : (int, int), default (0, 0)
///     Offset of the grid of blocks, right and down, in pixels. Changed from frame to frame, it lets blocks' edges
///     average out in time. Blocks that the border cuts to less than half are merged with their neighbours.
/// features : {"fewest", "all"}, default "fewest"
///     The fewest features that the block needs, or all that vary in it.
/// out : tuple of (H, W, 3) float32 and (H, W) uint8 arrays, optional
///     Written and returned instead of new arrays; they may be inputs. A part may be None.
///
/// Returns
/// -------
/// fitted : (H, W, 3) float32
///     Clamped to the range of the block's colours. Missing pixels, and those of weight 0, get the fitted colour.
///     Pixels without a surface keep their colour, as do blocks without valid pixels.
/// used : (H, W) uint8
///     Number of the block's features, including the constant: 1 to 10; 0 where a pixel keeps its colour.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range; if a depth has no camera.
///
/// See Also
/// --------
/// BMFR : The pipeline that fits every frame.
/// demodulate : Divides colour by albedo.
/// atrous : Filters instead of fitting.
///
/// Notes
/// -----
/// Least squares of colour on those of {1, normal, position, position²} that are given and vary within the block
/// (Koskela et al. [1]_), by a QR decomposition in double precision. Positions are relative to the block's weighted
/// mean, which matters to "fewest": their squares are other features than those of coordinates. A feature is skipped if
/// the others explain all but a hundredth of it (the paper adds noise instead), if it is a normal that varies by less
/// than a thousandth, or a coordinate that varies by less than a thousandth of the others.
///
/// "fewest" adds features one by one, each the one that reduces the sum S of squared residuals most, as long as that
/// lowers the generalised cross-validation score ``S / (1 - (1 + 3k)/n)²``, with k features besides the constant and n
/// pixels (``(Σw)² / Σw²`` by weight; Craven and Wahba [2]_). A chosen feature counts as three degrees of freedom, as
/// in Friedman's regression splines [3]_.
///
/// References
/// ----------
/// .. [1] M. Koskela, K. Immonen, M. Mäkitalo, A. Foi, T. Viitanen, P. Jääskeläinen, H. Kultala, J. Takala, "Blockwise
///    multi-order feature regression for real-time path-tracing reconstruction", ACM Transactions on Graphics 38(5),
///    2019.
/// .. [2] P. Craven, G. Wahba, "Smoothing noisy data with spline functions", Numerische Mathematik 31, 1979.
/// .. [3] J. H. Friedman, "Multivariate adaptive regression splines", The Annals of Statistics 19(1), 1991.
///
/// Examples
/// --------
/// >>> depth = np.tile(np.linspace(1, 2, 8), (8, 1))
/// >>> camera = yester.Camera.from_look_at([0, 0, 0], [0, 0, 1], [0, 1, 0], fov=60, width=8, height=8)
/// >>> position = camera.unproject(np.stack(np.meshgrid(np.arange(8) + 0.5, np.arange(8) + 0.5), -1), depth)
/// >>> color = np.repeat(position[..., 2:], 3, -1)
/// >>> color[4, 4] = np.nan
/// >>> fitted, used = yester.regress(color, geometry=position)
/// >>> np.allclose(fitted[..., 0], depth, atol=1e-4)
/// True
/// >>> int(used[4, 4])
/// 2
#[pyfunction]
#[pyo3(signature = (color, *, normal=None, geometry=None, camera=None, weight=None, block=32, offset=(0, 0),
    features="fewest", out=None))]
#[pyo3(
    text_signature = "(color, *, normal=None, geometry=None, camera=None, weight=None, block=32, offset=(0, 0), \
    features='fewest', out=None)"
)]
#[pyo3(name = "regress")]
pub fn regress_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    normal: Option<&Bound<'py, PyAny>>,
    geometry: Option<&Bound<'py, PyAny>>,
    camera: Option<&Camera>,
    weight: Option<&Bound<'py, PyAny>>,
    block: i128,
    offset: (i64, i64),
    features: &str,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<u8>>)> {
    let params = regress::Params {
        block: regress::Params::block(block)?,
        offset: offset.into(),
        features: choice("features", features, &regress::Params::FEATURES)?,
    };
    let (fitted, used) = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let normal = Input::<f32>::optional(normal, "normal", COLOR, size)?;
        let geometry = Input::<f32>::optional(geometry, "geometry", Channels::OneOr3, size)?;
        let weight = Input::<f32>::optional(weight, "weight", Channels::One, size)?;
        if let Some(camera) = camera {
            check_size("camera", camera, size)?;
        } else if geometry
            .as_ref()
            .is_some_and(|geometry| geometry.channels() == 1)
        {
            return Err(needs("geometry", "camera"));
        }
        let Size { height, width } = size;
        let [first, second] = parts(out.as_ref())?;
        let out = (
            Out::given(first, &[height, width, 3])?,
            Out::given(second, &[height, width])?,
        );
        let rays = camera.map(|camera| pinhole::Camera::rays(&camera.inner));
        let given = Features {
            normal: normal.as_ref().map(|normal| normal.pixels()),
            place: (geometry.as_ref()).and_then(|geometry| Place::new(place(geometry), rays)),
        };
        let weight = weight.as_ref().map(|weight| weight.pixels());
        let color = color.pixels();
        let mut fitted = Direct::new(py, out.0)?;
        let mut used = Direct::new(py, out.1)?;
        let (colors, counts) = (fitted.data()?, used.data()?);
        detached(py, || {
            regress::regress(color, given, weight, params, colors, counts)
        })?;
        (fitted, used)
    };
    Ok((fitted.array()?, used.array()?))
}
