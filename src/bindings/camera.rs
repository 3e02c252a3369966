//! `Camera` and the kernels of the camera folder.

use std::hash::{Hash, Hasher};

use glam::{DMat4, DVec2, DVec3};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyMapping;

use super::arrays::{
    self, Channels, Direct, Input, MOTION, Out, choice, detached, matrix4, needs, points, vector,
};
use crate::error::{Error, whole};
use crate::image::Size;
use crate::kernels::camera::depth_change::depth_change;
use crate::kernels::camera::dilate::{self, Choice, Window};
use crate::kernels::camera::jitter::{self, Sequence};
use crate::kernels::camera::motion::{self, Geometry, Transforms};
use crate::kernels::camera::pinhole::{self, FovAxis, Rows4};
use crate::kernels::camera::virtual_motion;
use crate::kernels::fetch::invert::invert_motion;
use crate::pixels::PixelsMut;

/// A pinhole camera: where world points appear in the image, and the rays of its pixels.
///
/// Parameters
/// ----------
/// world_to_clip : (4, 4) array_like of float
///     Maps column vectors, ``clip = world_to_clip @ [x, y, z, 1]``, with x to the right, y up and w positive in
///     front of the camera: the convention of OpenGL, Direct3D and (with y flipped) Vulkan. Their z rows differ; the z
///     row is not used. The matrix's scale does not matter. It may have an off-axis principal point.
/// width, height : int
///     The image's size in pixels: 1 to 2²³ - 1 each, 2³¹ pixels at most.
///
/// Raises
/// ------
/// ValueError
///     If the matrix has NaN or infinity, is singular or orthographic, or the image has no pixels or too many.
///
/// See Also
/// --------
/// motion_vectors : Motion of static surfaces, from two cameras.
/// jitter : Offsets for `Camera.jittered`.
///
/// Notes
/// -----
/// The pixel of a point is ``((x/w + 1)/2 * width, (1 - y/w)/2 * height)``: x to the right, y down, pixel centres at
/// +0.5. Its depth is the distance along the camera axis, in scene units. Cameras are immutable, compare by matrix
/// and size, can be keys of a dictionary and can be pickled.
///
/// Examples
/// --------
/// >>> camera = yester.Camera.from_look_at([1, 2, 5], [1, 2, 0], [0, 1, 0], fov=90, width=4, height=4)
/// >>> camera
/// Camera(4x4, position=[1.0000, 2.0000, 5.0000], forward=[0.0000, 0.0000, -1.0000])
/// >>> pixels, depth = camera.project([[1, 2, 0], [3.5, 2, 0]])
/// >>> pixels
/// array([[2., 2.],
///        [3., 2.]])
/// >>> depth
/// array([5., 5.])
#[pyclass(frozen, eq, hash, from_py_object, module = "yester")]
#[derive(Clone, PartialEq)]
pub struct Camera {
    pub inner: pinhole::Camera,
}

impl Hash for Camera {
    fn hash<H: Hasher>(&self, state: &mut H) {
        let pinhole::Camera {
            world_to_clip,
            size,
            ..
        } = &self.inner;
        // 0 and -0 are equal.
        let numbers = world_to_clip
            .as_flattened()
            .iter()
            .map(|number| (number + 0.0).to_bits());
        (numbers.collect::<Vec<_>>(), size.height, size.width).hash(state);
    }
}

#[pymethods]
impl Camera {
    #[new]
    fn new(world_to_clip: &Bound<'_, PyAny>, width: i128, height: i128) -> PyResult<Self> {
        let matrix = matrix4(world_to_clip, "world_to_clip")?;
        Ok(Self {
            inner: pinhole::Camera::new(matrix, size(width, height)?)?,
        })
    }

    /// Make a camera at `origin` that looks at `target`.
    ///
    /// Parameters
    /// ----------
    /// origin, target, up : (3,) array_like of float
    ///     World space, right-handed; `up` need not be perpendicular to the view.
    /// fov : float
    ///     Field of view in degrees, above 0 and below 180; `ValueError` if it is so close to either that the matrix is
    ///     singular.
    /// width, height : int
    ///     The image's size in pixels.
    /// fov_axis : {"x", "y"}, default "x"
    ///     The axis that `fov` spans: the image's width or its height.
    /// principal_point : (2,) array_like of float, optional
    ///     Where the optical axis meets the image, in pixels; the centre by default.
    ///
    /// Returns
    /// -------
    /// Camera
    ///     Without jitter.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If `target` is `origin`, `up` is along the view, or a value is out of range.
    ///
    /// Examples
    /// --------
    /// >>> camera = yester.Camera.from_look_at([1, 2, 5], [1, 2, 0], [0, 1, 0], fov=90, width=4, height=4)
    /// >>> camera.position
    /// array([1., 2., 5.])
    /// >>> camera.forward
    /// array([ 0.,  0., -1.])
    #[staticmethod]
    #[pyo3(signature = (origin, target, up, fov, width, height, *, fov_axis="x", principal_point=None))]
    fn from_look_at(
        origin: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        up: &Bound<'_, PyAny>,
        fov: f64,
        width: i128,
        height: i128,
        fov_axis: &str,
        principal_point: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let axis = choice(
            "fov_axis",
            fov_axis,
            &[("x", FovAxis::X), ("y", FovAxis::Y)],
        )?;
        let centre = principal_point
            .map(|p| vector::<2>(p, "principal_point"))
            .transpose()?;
        let inner = pinhole::Camera::from_look_at(
            DVec3::from(vector(origin, "origin")?),
            DVec3::from(vector(target, "target")?),
            DVec3::from(vector(up, "up")?),
            fov,
            size(width, height)?,
            axis,
            centre.map(DVec2::from),
        )?;
        Ok(Self { inner })
    }

    /// The matrix that was passed to the constructor: (4, 4) float64.
    #[getter]
    fn world_to_clip<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        rows(py, &self.inner.world_to_clip)
    }

    /// World to camera; +X right, +Y up, +Z forward, as in EXR files; rigid unless skewed: (4, 4) float64.
    #[getter]
    fn world_to_camera<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        rows(py, &self.inner.world_to_camera())
    }

    /// Image width in pixels.
    #[getter]
    fn width(&self) -> usize {
        self.inner.size.width
    }

    /// Image height in pixels.
    #[getter]
    fn height(&self) -> usize {
        self.inner.size.height
    }

    /// The centre of projection in world space: (3,) float64.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.inner.position.to_array())
    }

    /// The unit vector along the optical axis, in world space: (3,) float64.
    #[getter]
    fn forward<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.inner.forward().to_array())
    }

    /// Project world points to pixels.
    ///
    /// Parameters
    /// ----------
    /// points : (..., 3) array_like of float
    ///     World space.
    ///
    /// Returns
    /// -------
    /// pixels : (..., 2) float64
    ///     Position, x right, y down, pixel centres at +0.5; NaN for points that are not in front of the camera.
    /// depth : (...) float64
    ///     Distance along the camera axis.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the last axis of `points` has not three coordinates.
    ///
    /// See Also
    /// --------
    /// Camera.unproject : From pixels and depths to world points.
    ///
    /// Examples
    /// --------
    /// >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
    /// >>> pixels, depth = camera.project([1, 1, 0])
    /// >>> pixels
    /// array([2.4, 1.6])
    /// >>> float(depth)
    /// 5.0
    fn project<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
    ) -> PyResult<(Bound<'py, PyArrayDyn<f64>>, Bound<'py, PyArrayDyn<f64>>)> {
        let (points, outer) = arrays::points::<3>(points, "points")?;
        let (mut pixels, mut depths) = (
            Vec::with_capacity(2 * points.len()),
            Vec::with_capacity(points.len()),
        );
        for point in points {
            let (pixel, depth) = self.inner.project(DVec3::from(point));
            pixels.extend(if depth > 0.0 {
                pixel.to_array()
            } else {
                [f64::NAN; 2]
            });
            depths.push(depth);
        }
        Ok((
            shaped(py, pixels, &outer, Some(2))?,
            shaped(py, depths, &outer, None)?,
        ))
    }

    /// Unproject pixels and depths to world points.
    ///
    /// Parameters
    /// ----------
    /// pixels : (..., 2) array_like of float
    ///     Position, x right, y down, pixel centres at +0.5.
    /// depth : (...) array_like of float
    ///     Distance along the camera axis; the axes before the last of `pixels`.
    ///
    /// Returns
    /// -------
    /// points : (..., 3) float64
    ///     World space.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the last axis of `pixels` has not two coordinates, or `depth` another shape than the axes before it.
    ///
    /// See Also
    /// --------
    /// Camera.project : From world points to pixels.
    ///
    /// Examples
    /// --------
    /// >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
    /// >>> camera.unproject([2.5, 1.5], 4)
    /// array([1., 1., 1.])
    fn unproject<'py>(
        &self,
        py: Python<'py>,
        pixels: &Bound<'py, PyAny>,
        depth: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (pixels, outer) = points::<2>(pixels, "pixels")?;
        let depth = arrays::doubles(depth, "depth")?;
        if depth.shape() != outer {
            return Err(Error::value(
                "depth",
                format!("shape {outer:?}"),
                format!("{:?}", depth.shape()),
            )
            .into());
        }
        let points = pixels.into_iter().zip(depth.as_slice()?);
        let points = points
            .flat_map(|(p, &z)| self.inner.unproject(DVec2::from(p), z).to_array())
            .collect();
        shaped(py, points, &outer, Some(3))
    }

    /// Compute the view rays of pixels.
    ///
    /// Parameters
    /// ----------
    /// pixels : (..., 2) array_like of float, optional
    ///     By default the centres of all pixels, (height, width, 2).
    ///
    /// Returns
    /// -------
    /// origin : (3,) float64
    ///     The camera's position.
    /// directions : (..., 3) float64
    ///     World space, unit length.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the last axis of `pixels` has not two coordinates.
    ///
    /// Examples
    /// --------
    /// >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
    /// >>> origin, directions = camera.rays()
    /// >>> directions.shape
    /// (4, 4, 3)
    /// >>> directions[0, 0]
    /// array([-0.5145,  0.5145, -0.686 ])
    #[pyo3(signature = (pixels=None))]
    fn rays<'py>(
        &self,
        py: Python<'py>,
        pixels: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArrayDyn<f64>>)> {
        let Size { height, width } = self.inner.size;
        let given = pixels.map(|pixels| points::<2>(pixels, "pixels"));
        let (pixels, outer) = given
            .transpose()?
            .map_or((None, vec![height, width]), |given| {
                (Some(given.0), given.1)
            });
        let centre = |i: usize| [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
        let shape: Vec<_> = outer.into_iter().chain([3]).collect();
        let mut rays = Direct::new(py, Out::<f64>::fresh(&shape))?;
        let directions = rays.data()?.as_chunks_mut::<3>().0;
        detached(py, || {
            for (i, direction) in directions.iter_mut().enumerate() {
                let pixel = pixels
                    .as_ref()
                    .map_or_else(|| centre(i), |pixels| pixels[i]);
                *direction = self.inner.ray(DVec2::from(pixel)).normalize().to_array();
            }
        })?;
        Ok((self.position(py), rays.array()?))
    }

    /// Make a camera whose image is shifted by part of a pixel.
    ///
    /// Parameters
    /// ----------
    /// offset : (2,) array_like of float
    ///     In pixels, x right, y down, for instance from `jitter`. The new camera's samples at pixel centres are this
    ///     camera's at pixel centres plus `offset`: points appear at their old pixel positions minus `offset`.
    ///
    /// Returns
    /// -------
    /// Camera
    ///     With the same size, position and direction.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If `offset` is not finite.
    ///
    /// See Also
    /// --------
    /// jitter : Offsets for the frames of a sequence.
    ///
    /// Notes
    /// -----
    /// Use the jittered camera for rendering only: `Frame.camera` and `motion_vectors` take cameras without jitter.
    ///
    /// Examples
    /// --------
    /// >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
    /// >>> shifted = camera.jittered([0.25, -0.25])
    /// >>> shifted.project([0, 0, 0])[0] - camera.project([0, 0, 0])[0]
    /// array([-0.25,  0.25])
    fn jittered(&self, offset: &Bound<'_, PyAny>) -> PyResult<Self> {
        let offset = DVec2::from(vector::<2>(offset, "offset")?);
        Ok(Self {
            inner: self.inner.jittered(offset)?,
        })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let this = slf.get();
        Ok((
            slf.get_type().into_any(),
            (this.world_to_clip(slf.py())?, this.width(), this.height()),
        ))
    }

    fn __repr__(&self) -> String {
        let Size { width, height } = self.inner.size;
        let (position, forward) = (self.inner.position, self.inner.forward());
        format!("Camera({width}x{height}, position={position:.4}, forward={forward:.4})")
    }
}

type Reduced<'py> = (Bound<'py, PyAny>, (Bound<'py, PyArray2<f64>>, usize, usize));

fn rows<'py>(py: Python<'py>, rows: &Rows4) -> PyResult<Bound<'py, PyArray2<f64>>> {
    rows.as_flattened()
        .to_vec()
        .into_pyarray(py)
        .reshape([4, 4])
}

fn shaped<'py>(
    py: Python<'py>,
    data: Vec<f64>,
    outer: &[usize],
    last: Option<usize>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let shape: Vec<_> = outer.iter().copied().chain(last).collect();
    data.into_pyarray(py).reshape(shape)
}

/// Sub-pixel sample positions for successive frames.
///
/// Parameters
/// ----------
/// count : int
///     Number of phases, at least 1.
/// sequence : {"halton", "r2", "rotated-grid", "blue-noise"}, default "halton"
///     Halton in bases 2 and 3; Roberts' R2; the lattice with one point in each row and column of a `count` x `count`
///     grid and the largest minimum distance, from left to right (for 4, the pattern of rotated-grid multisampling);
///     the same points in an order of which every prefix is well spread.
///
/// Returns
/// -------
/// offsets : (count, 2) float64
///     From the pixel's centre, x right, y down, in pixels from -0.5 to 0.5. For `Camera.jittered`.
///
/// Raises
/// ------
/// ValueError
///     If `count` is below 1 or above 65536, or the sequence is unknown.
///
/// See Also
/// --------
/// Camera.jittered : The camera that renders a jittered frame.
/// resolve : The image that jittered frames amount to.
///
/// Notes
/// -----
/// The points of "halton" and "r2" do not depend on `count`; those of the others do. "halton" has the radical inverses
/// of 1, 2, 3, … in bases 2 and 3 [1]_, "r2" multiples of (1/ρ, 1/ρ²) modulo 1, with ρ³ = ρ + 1 [2]_.
///
/// References
/// ----------
/// .. [1] J. H. Halton, G. B. Smith, "Algorithm 247: radical-inverse quasi-random point sequence", Communications of
///    the ACM 7(12), 1964.
/// .. [2] M. Roberts, "The unreasonable effectiveness of quasirandom sequences", extremelearning.com.au, 2018.
///
/// Examples
/// --------
/// >>> yester.jitter(4)
/// array([[ 0.    , -0.1667],
///        [-0.25  ,  0.1667],
///        [ 0.25  , -0.3889],
///        [-0.375 , -0.0556]])
#[pyfunction]
#[pyo3(name = "jitter", signature = (count, *, sequence="halton"))]
pub fn jitter_<'py>(
    py: Python<'py>,
    count: i128,
    sequence: &str,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let sequence = choice("sequence", sequence, &Sequence::NAMES)?;
    let range = |&n: &usize| (1..=65536).contains(&n);
    let count = whole("count", count, "1 to 65536 phases", range)?;
    let go_on = || Python::attach(|py| py.check_signals());
    let offsets = detached(py, || jitter::jitter(count, sequence, go_on))??;
    offsets
        .as_flattened()
        .to_vec()
        .into_pyarray(py)
        .reshape([count, 2])
}

/// Motion vectors: where each pixel's surface was in the previous frame.
///
/// Parameters
/// ----------
/// geometry : (H, W) or (H, W, 3) array_like of float
///     Depth, view-space z, +inf or not above 0 where nothing was hit; or world-space position, not finite there.
///     Positions account for the sub-pixel position of each sample.
/// camera, previous_camera : Camera
///     Of the current and the previous frame, without jitter, both of the image's size.
/// ids : (H, W) array_like of int, optional
///     Object id of each pixel.
/// transforms : dict of int to (4, 4) array_like of float, optional
///     Per id, ``previous @ inverse(current)`` of the object's to-world matrices: maps a current world point of the
///     object to its previous position. Objects that are not listed are static. Needs `ids`.
/// out : (H, W, 3) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// motion : (H, W, 3) float32
///     Previous minus current x and y in pixels (x right, y down) and previous minus current depth in scene units.
///     Zero for a still camera and object, exactly. Background moves with the camera's rotation alone. NaN where the
///     surface was not in front of the previous camera, or the depth is NaN.
///
/// Raises
/// ------
/// ValueError
///     On a wrong shape, a camera of another size, `transforms` without `ids`, or a matrix that is not affine.
///
/// See Also
/// --------
/// virtual_motion : Motion of reflections.
/// dilate_motion : Motion that antialiases edges.
/// reproject : Fetches history along the motion.
///
/// Notes
/// -----
/// With T the `transforms` matrix of the object (the identity for static ones), a point X has the motion
/// ``project(previous_camera, T X) - project(camera, X)``, computed in double precision. Both ends project the same
/// point, so that the jitter of its sample cancels. The third channel is what NRD calls 2.5-D motion [1]_; it makes the
/// depth tests of `reproject` exact under motion.
///
/// References
/// ----------
/// .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
///    hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.
///
/// Examples
/// --------
/// >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
/// >>> previous = yester.Camera.from_look_at([1, 0, 5], [1, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
/// >>> motion = yester.motion_vectors(np.full((4, 4), 5.0), camera, previous)
/// >>> motion[0, 0]
/// array([-0.4,  0. ,  0. ], dtype=float32)
#[pyfunction]
#[pyo3(signature = (geometry, camera, previous_camera, *, ids=None, transforms=None, out=None))]
pub fn motion_vectors<'py>(
    py: Python<'py>,
    geometry: &Bound<'py, PyAny>,
    camera: &Camera,
    previous_camera: &Camera,
    ids: Option<&Bound<'py, PyAny>>,
    transforms: Option<&Bound<'py, PyMapping>>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let motion = {
        let geometry = Input::<f32>::new(geometry, "geometry", Channels::OneOr3)?;
        let size = geometry.size();
        for (name, camera) in [("camera", camera), ("previous_camera", previous_camera)] {
            check_size(name, camera, size)?;
        }
        let ids = Input::<u32>::optional(ids, "ids", Channels::One, size)?;
        if transforms.is_some() && ids.is_none() {
            return Err(needs("transforms", "ids"));
        }
        let items = transforms
            .map(|transforms| transforms.items())
            .transpose()?;
        let transforms: Vec<_> = (items.iter().flatten())
            .map(|item| {
                let (id, matrix): (i128, Bound<PyAny>) = item.extract()?;
                Ok((
                    whole("transforms", id, "ids from 0 to 4294967295", |_: &u32| true)?,
                    DMat4::from_cols_array_2d(&matrix4(&matrix, &format!("transforms[{id}]"))?)
                        .transpose(),
                ))
            })
            .collect::<PyResult<_>>()?;
        let transforms = Transforms::new(transforms)?;
        let out = Out::given(out, &[size.height, size.width, 3])?;
        let ids = ids.as_ref().map(|ids| ids.pixels());
        let (geometry, camera, previous) =
            (place(&geometry), &camera.inner, &previous_camera.inner);
        out.fill(py, |motion| {
            let motion = PixelsMut::bands(size, 3, motion);
            motion::motion_vectors(geometry, camera, previous, ids, &transforms, motion);
        })?
    };
    motion.array()
}

/// Depth, or position of three channels.
pub fn place<'a>(geometry: &'a Input) -> Geometry<'a> {
    let pixels = geometry.pixels();
    match geometry.channels() {
        3 => Geometry::Position(pixels),
        _ => Geometry::Depth(pixels),
    }
}

/// Virtual motion: where each pixel's reflection was in the previous frame.
///
/// Parameters
/// ----------
/// geometry : (H, W) or (H, W, 3) array_like of float
///     Depth or world-space position of the reflecting surfaces, as for `motion_vectors`.
/// hit_distance : (H, W) array_like of float
///     Distance from the surface to the reflected object, in scene units; +inf for the environment.
/// camera, previous_camera : Camera
///     Of the current and the previous frame, without jitter, both of the image's size.
/// out : (H, W, 2) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// motion : (H, W, 2) float32
///     Previous position of the virtual image minus current position of the pixel, x right, y down. For a distance of 0
///     this is the surface's own motion. NaN where the distance is NaN or negative, or the virtual image was not in
///     front of the previous camera. Background moves with the camera's rotation, whatever its distance.
///
/// Raises
/// ------
/// ValueError
///     On a wrong shape or a camera of another size.
///
/// See Also
/// --------
/// motion_vectors : Motion of the surfaces themselves.
/// prediction_gain : Tells which of two histories predicts new samples better.
///
/// Notes
/// -----
/// The image in a flat mirror lies on the continued view ray, as far behind the surface as the reflected object is in
/// front of it: ``X + hit_distance (X - C)/|X - C|``. For static mirrors; after the virtual motion of NRD's ReBLUR and
/// ReLAX [1]_. Validate history fetched along it by id and normal only: the source pixel shows another point of the
/// mirror.
///
/// References
/// ----------
/// .. [1] NVIDIA, "NVIDIA Real-Time Denoisers" (ReBLUR, ReLAX), github.com/NVIDIA-RTX/NRD; D. Zhdan, "ReBLUR: a
///    hierarchical recurrent denoiser", Ray Tracing Gems II, 2021.
///
/// Examples
/// --------
/// >>> camera = yester.Camera.from_look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
/// >>> previous = yester.Camera.from_look_at([1, 0, 5], [1, 0, 0], [0, 1, 0], fov=90, width=4, height=4)
/// >>> depth = np.full((4, 4), 5.0)
/// >>> yester.virtual_motion(depth, np.zeros((4, 4)), camera, previous)[1, 1]
/// array([-0.4,  0. ], dtype=float32)
/// >>> yester.virtual_motion(depth, np.full((4, 4), 5.0), camera, previous)[1, 1]
/// array([-0.2059,  0.    ], dtype=float32)
#[pyfunction]
#[pyo3(name = "virtual_motion", signature = (geometry, hit_distance, camera, previous_camera, *, out=None))]
pub fn virtual_motion_<'py>(
    py: Python<'py>,
    geometry: &Bound<'py, PyAny>,
    hit_distance: &Bound<'py, PyAny>,
    camera: &Camera,
    previous_camera: &Camera,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let motion = {
        let geometry = Input::<f32>::new(geometry, "geometry", Channels::OneOr3)?;
        let size = geometry.size();
        for (name, camera) in [("camera", camera), ("previous_camera", previous_camera)] {
            check_size(name, camera, size)?;
        }
        let distance = Input::<f32>::of_size(hit_distance, "hit_distance", Channels::One, size)?;
        let out = Out::given(out, &[size.height, size.width, 2])?;
        let distance = distance.pixels();
        let geometry = place(&geometry);
        let (camera, previous) = (&camera.inner, &previous_camera.inner);
        out.fill(py, |motion| {
            let motion = PixelsMut::bands(size, 2, motion);
            virtual_motion::virtual_motion(geometry, distance, camera, previous, motion);
        })?
    };
    motion.array()
}

/// Find the change of depth that most surfaces share, where neither motion nor cameras tell it.
///
/// Parameters
/// ----------
/// depth : (H, W) array_like of float
///     View-space z. Background, which is infinite or not above 0, and NaN tell nothing.
/// previous_depth : (H, W) array_like of float
///     That of the previous frame.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     As `motion_vectors` returns it. A third channel is not used.
///
/// Returns
/// -------
/// change : float
///     By how much the surfaces were farther away in the previous frame: the third channel of motion that
///     `motion_vectors` would give for most of them. 0 where they share no change.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
///
/// See Also
/// --------
/// motion_vectors : Exact changes of depth, from cameras.
/// reproject : Expects history at ``depth + motion[..., 2]``.
///
/// Notes
/// -----
/// A camera that moves by d along its view, without turning, changes the depth of all that rests by d. With Z the depth
/// and Z′ that of the pixel of the previous frame nearest to where the motion leads, let r(d) be the number of pixels
/// with ``|Z′ - Z - d| > (Z + d) / 10``, whose history the test of depth rejects. The change is ``m = median(Z′ - Z)``
/// where ``2 r(m) < r(0)`` and ``|m| < median(Z) / 4``, else 0. Every eighth pixel of every eighth row is looked at,
/// from the fourth on, of which 16 must be known.
///
/// Without the change, a dolly of a tenth of the distance a frame loses all history. The pipelines add it to motion of
/// two channels where cameras are unknown.
///
/// Examples
/// --------
/// >>> depth = np.random.default_rng(0).uniform(4, 6, size=(48, 64))
/// >>> yester.depth_change(depth, depth + 1, np.zeros((48, 64, 2)))
/// 1.0
#[pyfunction]
#[pyo3(name = "depth_change")]
pub fn depth_change_<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    previous_depth: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
) -> PyResult<f32> {
    let depth = Input::<f32>::new(depth, "depth", Channels::One)?;
    let size = depth.size();
    let previous = Input::<f32>::of_size(previous_depth, "previous_depth", Channels::One, size)?;
    let motion = Input::<f32>::of_size(motion, "motion", MOTION, size)?;
    let (depth, previous, motion) = (depth.pixels(), previous.pixels(), motion.pixels());
    detached(py, || depth_change(depth, previous, motion))
}

/// Dilated motion: each pixel takes the motion of the nearest surface around it.
///
/// Parameters
/// ----------
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     As `motion_vectors` returns it.
/// depth : (H, W) array_like of float, optional
///     View-space z; NaN or not above 0 counts as infinitely far. Needed for `choose` "nearest".
/// still : (H, W, 2) or (H, W, 3) array_like of float, optional
///     Motion if nothing but the camera moved (`motion_vectors`). With it, a pixel does not take the motion of
///     neighbours that move by themselves: those whose motion differs from it by more than half a pixel. For `choose`
///     "nearest".
/// choose : {"nearest", "longest"}, default "nearest"
///     Takes the motion of the neighbour with the smallest depth, or the longest motion in pixels.
/// window : {"3x3", "cross"}, default "3x3"
///     The neighbours that are searched: all eight, or four.
/// margin : float, default 0.0
///     How much nearer than the pixel itself a neighbour must be, relative to the pixel's depth; for "longest", how
///     much longer its motion, relative to the neighbour's. 0 to below 1.
/// out : float32 array like `motion`, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// motion : (H, W, 2) or (H, W, 3) float32
///     All channels of the chosen neighbour. Motion that is not finite is taken only where there is no other. Ties go
///     to the pixel itself, then to the first neighbour from the top left.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, an unknown mode, a margin out of range, "nearest" without depth, or `still` without "nearest".
///
/// See Also
/// --------
/// motion_vectors : Motion from cameras.
/// TAA : Uses dilated motion.
///
/// Notes
/// -----
/// With dilation, the history of an edge moves with the foreground as a whole, so that the edge is antialiased [1]_.
/// Without it, histories of different surfaces do not mix. The published rule has no margin: on surfaces that turn or
/// come closer, where motion differs from pixel to pixel, it fetches history beside its place, and blurs it. `TAA`,
/// `Upscaler` and the denoisers dilate with a margin of 0.1, which leaves the motion of surfaces alone. Beside an
/// object that moves by itself, dilation drags the history of the background along; the denoisers do not dilate there.
///
/// References
/// ----------
/// .. [1] B. Karis, "High quality temporal supersampling", Advances in Real-Time Rendering in Games, SIGGRAPH courses,
///    2014.
///
/// Examples
/// --------
/// >>> motion = np.zeros((3, 4, 2))
/// >>> motion[1, 1] = 4, 0
/// >>> depth = np.full((3, 4), 9.0)
/// >>> depth[1, 1] = 1
/// >>> yester.dilate_motion(motion, depth)[..., 0]
/// array([[4., 4., 4., 0.],
///        [4., 4., 4., 0.],
///        [4., 4., 4., 0.]], dtype=float32)
#[pyfunction]
#[pyo3(signature = (motion, depth=None, *, still=None, choose="nearest", window="3x3", margin=0.0, out=None))]
pub fn dilate_motion<'py>(
    py: Python<'py>,
    motion: &Bound<'py, PyAny>,
    depth: Option<&Bound<'py, PyAny>>,
    still: Option<&Bound<'py, PyAny>>,
    choose: &str,
    window: &str,
    margin: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let nearest = choice("choose", choose, &[("nearest", true), ("longest", false)])?;
    let window = choice("window", window, &Window::NAMES)?;
    let params = dilate::Params { window, margin };
    params.check("margin")?;
    let dilated = {
        let motion = Input::<f32>::new(motion, "motion", MOTION)?;
        let depth = Input::<f32>::optional(depth, "depth", Channels::One, motion.size())?;
        if nearest && depth.is_none() {
            return Err(needs("choose=\"nearest\"", "depth"));
        }
        let still = Input::<f32>::optional(still, "still", MOTION, motion.size())?;
        if still.is_some() && !nearest {
            return Err(needs("still", "choose=\"nearest\""));
        }
        let out = Out::given(out, motion.shape())?;
        let depth = depth.as_ref().filter(|_| nearest).map(Input::pixels);
        let still = still.as_ref().map(Input::pixels);
        let choice = depth.map_or(Choice::Longest, |depth| Choice::Nearest {
            depth: depth.plane(),
            still,
        });
        let pixels = motion.pixels();
        out.fill(py, |dilated| {
            let dilated = PixelsMut::bands(pixels.size, pixels.channels, dilated);
            dilate::dilate_motion(pixels, choice, params, dilated);
        })?
    };
    dilated.array()
}

/// Inverted motion: where each pixel's surface is in the next frame, from the next frame's motion.
///
/// Parameters
/// ----------
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     `Frame.motion` of the next frame: its pixels' positions in this frame minus their own, in pixels, x right, y
///     down, and the same of depth. Pixels with NaN or infinity are left out.
/// depth : (H, W) array_like of float, optional
///     View-space z of the next frame, +inf where nothing was hit; pixels with NaN, or not above 0, are left out. Where
///     several pixels come from one, the nearest in this frame counts, by the third channel of `motion`. Without depth,
///     all pixels count as equally far, even if motion has a third channel.
/// still : (H, W, 2) or (H, W, 3) array_like of float, optional
///     Motion to the next frame if nothing moved but the camera, with as many channels as `motion`: `motion_vectors` of
///     this frame with the next frame's camera as the previous one. Exact where that is so; it replaces inverted motion
///     that differs by at most half a pixel, and holds where no pixel of the next frame comes from.
/// out : float32 array like `motion`, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// motion : (H, W, 2) or (H, W, 3) float32
///     Next minus current position in pixels, and depth. NaN where nothing is known.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
///
/// See Also
/// --------
/// denoise : Denoises with later frames as well, along inverted motion.
/// motion_vectors : Motion from cameras.
///
/// Notes
/// -----
/// Pixel q of the next frame comes from ``q + motion[q]`` and therefore gives the pixel there ``-motion[q]``. A pixel
/// that none comes from takes the nearest of its neighbours' points that lie less than a pixel away along each axis, so
/// that surfaces which move apart have no cracks. Of points at the same depth, the first in rows counts.
///
/// Examples
/// --------
/// >>> motion = np.zeros((1, 4, 2))
/// >>> motion[..., 0] = -1
/// >>> yester.invert_motion(motion)[0, :, 0]
/// array([ 1.,  1.,  1., nan], dtype=float32)
#[pyfunction]
#[pyo3(name = "invert_motion", signature = (motion, depth=None, *, still=None, out=None))]
pub fn invert_motion_<'py>(
    py: Python<'py>,
    motion: &Bound<'py, PyAny>,
    depth: Option<&Bound<'py, PyAny>>,
    still: Option<&Bound<'py, PyAny>>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let inverted = {
        let motion = Input::<f32>::new(motion, "motion", MOTION)?;
        let size = motion.size();
        let depth = Input::<f32>::optional(depth, "depth", Channels::One, size)?;
        let still = Input::<f32>::optional(still, "still", MOTION, size)?;
        if let Some(still) = still
            .as_ref()
            .filter(|still| still.shape() != motion.shape())
        {
            let text = |shape: &[usize]| format!("shape {shape:?}");
            let (expected, got) = (text(motion.shape()), text(still.shape()));
            return Err(Error::value("still", expected, got).into());
        }
        let pixels = motion.pixels();
        let depth = depth.as_ref().map(|depth| depth.pixels());
        let still = still.as_ref().map(Input::pixels);
        Out::given(out, motion.shape())?.fill(py, |inverted| {
            let inverted = PixelsMut::bands(size, pixels.channels, inverted);
            invert_motion(pixels, depth, still, inverted);
        })?
    };
    inverted.array()
}

fn size(width: i128, height: i128) -> crate::error::Result<Size> {
    let side = |name, value| {
        let expected = "a number of pixels, 1 to 2²³ - 1";
        whole(name, value, expected, |n| (1..=Size::LONGEST).contains(n))
    };
    Ok(Size {
        width: side("width", width)?,
        height: side("height", height)?,
    })
}

/// Checks that a camera has the size of the image it comes with.
pub fn check_size(name: &str, camera: &Camera, size: Size) -> PyResult<()> {
    match camera.inner.size == size {
        true => Ok(()),
        false => Err(Error::value(name, size, camera.inner.size).into()),
    }
}
