//! The regression.

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{
    COLOR, Channels, Direct, Input, Interleaved, Out, choice, detached, needs, parts,
};
use super::camera::{Camera, check_size, place};
use crate::image::Size;
use crate::kernels::camera::pinhole;
use crate::kernels::smooth::regress::{self, Features, Place};

/// Light fitted block by block to features of the surfaces: block-wise multi-order feature regression.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     Linear, as a rule without texture (`demodulate`). Pixels with NaN or infinity are missing.
/// normal : (H, W, 3) array_like of float, optional
///     World space, unit length; not finite or zero where no surface shows.
/// geometry : (H, W) or (H, W, 3) array_like of float, optional
///     Depth, which needs `camera`, or world-space positions; not finite where no surface shows, nor a depth up to 0.
/// camera : Camera, optional
///     Of this frame.
/// weight : (H, W) array_like of float, optional
///     How much each pixel counts, from 0; those with a weight that is not finite or below 0 are not fitted at all. By
///     default, all count alike.
/// block : int, default 32
///     Side of the blocks in pixels, 4 to 256. An image smaller than that is one block.
/// offset : (int, int), default (0, 0)
///     Where, right and down, a block begins. Displaced from frame to frame, the blocks' edges average out in time. What the
///     border cuts to less than half a block belongs to its neighbour.
/// features : {"fewest", "all"}, default "fewest"
///     All features that vary, or the fewest that the block needs.
/// out : tuple of (H, W, 3) float32 and (H, W) uint8 arrays, optional
///     Written and returned instead of new arrays; they may be inputs. A part may be None.
///
/// Returns
/// -------
/// fitted : (H, W, 3) float32
///     Within the range of the block's colours. Missing pixels, and those of weight 0, get what their features make of
///     the others. Pixels that show no surface keep their colour, as do blocks without a pixel that counts.
/// used : (H, W) uint8
///     Number of the block's features, the constant among them: 1 to 10; 0 where a pixel keeps its colour.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or parameters out of range; if a depth has no camera.
///
/// Notes
/// -----
/// Least squares of colour on those of {1, normal, position, position²} that are given and that vary within the block
/// (Koskela et al. 2019, *Blockwise Multi-Order Feature Regression for Real-Time Path-Tracing Reconstruction*), by a QR
/// decomposition in double precision. A feature of which others leave less than a hundredth is left out, where the paper
/// adds noise; so is a normal that varies by less than a thousandth, and a coordinate that does so beside the others.
///
/// For the fewest, each feature in turn is the one that takes most off the sum S of squared residuals, as long as that
/// lowers the generalised cross-validation score ``S / (1 - (1 + 3k)/n)²``, with k features besides the constant and n
/// pixels (``(Σw)² / Σw²`` by weight): Craven and Wahba 1979, *Smoothing Noisy Data with Spline Functions*; that a
/// feature which was chosen counts as three, Friedman 1991, *Multivariate Adaptive Regression Splines*.
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
    block: i64,
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
            normal: normal.as_ref().map(|normal| normal.data().pixels()),
            place: (geometry.as_ref()).and_then(|geometry| Place::new(place(geometry), rays)),
        };
        let weight = weight.as_ref().map(|weight| weight.data().pixels());
        let color = Interleaved::pixels(color.data());
        let mut fitted = Direct::new(py, out.0, &[height, width, 3])?;
        let mut used = Direct::new(py, out.1, &[height, width])?;
        let (colors, counts) = (fitted.data()?, used.data()?);
        detached(py, || {
            regress::regress(color, given, weight, params, colors, counts)
        })?;
        (fitted, used)
    };
    Ok((fitted.array()?, used.array()?))
}
