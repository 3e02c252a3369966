//! The pinhole camera: world points to pixels and back, in double precision.
//!
//! A world-to-clip matrix M maps column vectors; x points right and y up in clip space, w is positive in front.
//! The pixel of a point is ((x/w + 1)/2 · width, (1 − y/w)/2 · height), with pixel centres at +0.5, and its depth is
//! w / |M₃,xyz|: the distance along the camera axis. The z row of M, which differs between APIs, is not used.
//! With h = A·X + b = depth · (u, v, 1) for a pixel (u, v), the camera stands at C = −A⁻¹b and a point of known depth
//! is X = C + depth · D(u, v), D(u, v) = A⁻¹(u, v, 1) (Hartley and Zisserman, *Multiple View Geometry*, chapter 6).

use glam::{DAffine3, DMat3, DVec2, DVec3, Vec3};

use crate::error::{Error, Result};
use crate::image::Size;

/// A 4×4 matrix in numpy's order: an array of rows.
pub type Rows4 = [[f64; 4]; 4];

/// A pinhole camera and the size of its image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub(crate) world_to_clip: Rows4,
    pub(crate) size: Size,
    /// A: the linear part of the map from world to (u, v, 1) · depth.
    to_pixel: DMat3,
    translation: DVec3,
    from_pixel: DMat3,
    pub(crate) position: DVec3,
}

/// The axis along which a field of view is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FovAxis {
    /// The width.
    X,
    /// The height.
    Y,
}

impl Camera {
    /// From the product of projection and view, for column vectors; an error if it is no perspective projection.
    pub fn new(world_to_clip: Rows4, size: Size) -> Result<Self> {
        size.check("width, height")?;
        if !world_to_clip.iter().flatten().all(|v| v.is_finite()) {
            return Err(Error::value(
                "world_to_clip",
                "finite numbers",
                "NaN or infinity",
            ));
        }
        // By a power of two, which changes no bit, so that no square of a length under- or overflows.
        let largest =
            (world_to_clip.as_flattened().iter()).fold(0.0_f64, |most, v| most.max(v.abs()));
        let exponent = if largest > 0.0 {
            libm::ilogb(largest)
        } else {
            0
        };
        let scaled = world_to_clip.map(|row| row.map(|v| libm::ldexp(v, -exponent)));
        let row = |i: usize| DVec3::new(scaled[i][0], scaled[i][1], scaled[i][2]);
        let scale = row(3).length();
        if scale == 0.0 {
            return Err(Error::value(
                "world_to_clip",
                "a perspective projection",
                "an affine (orthographic) matrix",
            ));
        }
        let [x, y, _, w] = scaled.map(|r| r[3] / scale);
        let (half_width, half_height) = (size.width as f64 / 2.0, size.height as f64 / 2.0);
        let [rx, ry, rw] = [row(0) / scale, row(1) / scale, row(3) / scale];
        let to_pixel =
            DMat3::from_cols((rx + rw) * half_width, (rw - ry) * half_height, rw).transpose();
        let translation = DVec3::new((x + w) * half_width, (w - y) * half_height, w);
        // Compared relative to the rows' lengths, so that neither the scene's unit nor the resolution matters.
        let volume: f64 = [0, 1, 2].map(|i| to_pixel.row(i).length()).iter().product();
        if !(to_pixel.determinant().abs() > 1e-12 * volume) {
            return Err(Error::value(
                "world_to_clip",
                "an invertible projection",
                "a singular matrix",
            ));
        }
        let from_pixel = to_pixel.inverse();
        let position = -(from_pixel * translation);
        Ok(Self {
            world_to_clip,
            size,
            to_pixel,
            translation,
            from_pixel,
            position,
        })
    }

    /// Looks from `origin` towards `target` with `up` upwards; `fov` in degrees; `principal_point` in pixels.
    pub fn from_look_at(
        origin: DVec3,
        target: DVec3,
        up: DVec3,
        fov: f64,
        size: Size,
        axis: FovAxis,
        principal_point: Option<DVec2>,
    ) -> Result<Self> {
        for (name, v) in [("origin", origin), ("target", target), ("up", up)] {
            if !v.is_finite() {
                return Err(Error::value(name, "finite coordinates", v));
            }
        }
        if !(fov > 0.0 && fov < 180.0) {
            return Err(Error::value(
                "fov",
                "degrees between 0 and 180, exclusive",
                fov,
            ));
        }
        let forward = (target - origin).try_normalize();
        let forward =
            forward.ok_or_else(|| Error::value("target", "a point other than origin", target))?;
        let right = forward
            .cross(up)
            .try_normalize()
            .filter(|_| forward.cross(up.normalize()).length() > 1e-9);
        let right =
            right.ok_or_else(|| Error::value("up", "a direction other than the view's own", up))?;
        let up = right.cross(forward);
        let (width, height) = (size.width as f64, size.height as f64);
        let side = match axis {
            FovAxis::X => width,
            FovAxis::Y => height,
        };
        let focal = side / 2.0 / libm::tan(fov.to_radians() / 2.0);
        let centre = principal_point.unwrap_or(DVec2::new(width, height) / 2.0);
        if !centre.is_finite() {
            return Err(Error::value("principal_point", "finite pixels", centre));
        }
        let x = right * (2.0 * focal / width) + forward * (2.0 * centre.x / width - 1.0);
        let y = up * (2.0 * focal / height) + forward * (1.0 - 2.0 * centre.y / height);
        let row = |v: DVec3, offset: f64| [v.x, v.y, v.z, offset - v.dot(origin)];
        size.check("width, height")?;
        // The z row is not used here; for other readers of the matrix: near plane at ½, far plane at infinity.
        let rows = [
            row(x, 0.0),
            row(y, 0.0),
            row(forward, -1.0),
            row(forward, 0.0),
        ];
        let degrees = "degrees for which the matrix can be inverted";
        Self::new(rows, size).map_err(|_| Error::value("fov", degrees, fov))
    }

    /// The camera whose samples at pixel centres are this camera's samples at pixel centres plus `offset`.
    pub fn jittered(&self, offset: DVec2) -> Result<Self> {
        if !offset.is_finite() {
            return Err(Error::value("offset", "finite pixels", offset));
        }
        let mut matrix = self.world_to_clip;
        let shift = 2.0 * offset / DVec2::new(self.size.width as f64, self.size.height as f64);
        for column in 0..4 {
            matrix[0][column] -= shift.x * matrix[3][column];
            matrix[1][column] += shift.y * matrix[3][column];
        }
        Self::new(matrix, self.size)
    }

    /// The pixel and depth of a world point; the pixel is valid only for depth > 0.
    #[inline(always)]
    pub fn project(&self, point: DVec3) -> (DVec2, f64) {
        let h = self.to_pixel * point + self.translation;
        (h.truncate() * (1.0 / h.z), h.z)
    }

    /// The world point that a pixel shows at a depth.
    #[inline(always)]
    pub fn unproject(&self, pixel: DVec2, depth: f64) -> DVec3 {
        self.position + self.ray(pixel) * depth
    }

    /// The world-space direction through a pixel, of unit depth.
    #[inline(always)]
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        self.from_pixel * pixel.extend(1.0)
    }

    /// [`Self::ray`] in single precision, for kernels whose points are relative to the camera.
    pub fn rays(&self) -> Rays {
        let cols = [
            self.from_pixel.x_axis,
            self.from_pixel.y_axis,
            self.from_pixel.z_axis,
        ];
        let [dx, dy, corner] = cols.map(|c| c.as_vec3());
        Rays { dx, dy, corner }
    }

    /// World to camera space with +X right, +Y up, +Z forward (left-handed, as EXR headers have it).
    pub fn world_to_camera(&self) -> Rows4 {
        let forward = self.forward();
        let along = |i: usize| {
            let axis = self.to_pixel.row(i);
            (axis - forward * axis.dot(forward)).normalize()
        };
        let axes = [along(0), -along(1), forward];
        let mut rows = [[0.0, 0.0, 0.0, 1.0]; 4];
        for (row, axis) in rows.iter_mut().zip(axes) {
            *row = [axis.x, axis.y, axis.z, -axis.dot(self.position)];
        }
        rows
    }

    pub(crate) fn forward(&self) -> DVec3 {
        self.to_pixel.row(2)
    }

    /// The area in pixels of a unit square that faces the camera at unit depth.
    pub(crate) fn pixels_per_unit(&self) -> f64 {
        self.to_pixel.determinant().abs()
    }
}

/// A camera's rays of unit depth, for points relative to the camera.
#[derive(Clone, Copy, Debug)]
pub struct Rays {
    /// Change of the ray per pixel to the right.
    pub dx: Vec3,
    /// Change of the ray per pixel down.
    pub dy: Vec3,
    /// The ray through the image's top left corner.
    pub corner: Vec3,
}

impl Rays {
    #[inline(always)]
    pub(crate) fn at(&self, x: f32, y: f32) -> Vec3 {
        self.corner + self.dx * x + self.dy * y
    }
}

/// Maps a pixel and depth of one camera to the pixel and depth of another, one frame before.
///
/// A point that appears at the pixel p = (u, v, 1) at depth z is X = C + z A⁻¹p. The other camera saw T·X at
///   h = z (p + E p) + t,  E = A′ T A⁻¹ − 1,  t = A′ T·C + b′.
/// The motion (h − h_z p)/h_z is computed from the small E and t alone, which avoids cancellation and makes it exactly
/// zero where they are. At infinity, z = 1 and t does not count.
#[derive(Clone, Copy)]
pub(crate) struct Warp {
    turn: DMat3,
    shift: DVec3,
}

impl Warp {
    /// `transform` is that of the object, previous · inverse(current).
    pub fn new(now: &Camera, before: &Camera, transform: DAffine3) -> Self {
        if now == before && transform == DAffine3::IDENTITY {
            return Self {
                turn: DMat3::ZERO,
                shift: DVec3::ZERO,
            };
        }
        let stood = before.to_pixel * transform.matrix3;
        let position = transform.transform_point3(now.position);
        Self {
            turn: stood * now.from_pixel - DMat3::IDENTITY,
            shift: before.to_pixel * position + before.translation,
        }
    }

    /// Previous minus current pixel position and depth of the point at a pixel position. `near` is 1, or 0 for
    /// background, whose change of depth is 0. NaN where the point was not in front of the other camera.
    #[inline(always)]
    pub fn motion(&self, [x, y]: [f64; 2], depth: f64, near: f64) -> [f32; 3] {
        let turned = self.turn * DVec3::new(x, y, 1.0) * depth + self.shift * near;
        let before = depth + turned.z;
        let scale = 1.0 / if before > 0.0 { before } else { f64::NAN };
        let moved = [(turned.x - x * turned.z), (turned.y - y * turned.z)].map(|v| v * scale);
        let nearer = if near == 0.0 { 0.0 } else { turned.z };
        let nearer = if before > 0.0 { nearer } else { f64::NAN };
        [moved[0] as f32, moved[1] as f32, nearer as f32]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: Size = Size {
        height: 90,
        width: 160,
    };

    fn camera() -> Camera {
        let centre = Some(DVec2::new(70.0, 50.0));
        Camera::from_look_at(
            DVec3::new(1.0, 2.0, 5.0),
            DVec3::ZERO,
            DVec3::Y,
            50.0,
            SIZE,
            FovAxis::X,
            centre,
        )
        .unwrap()
    }

    proptest! {
        #[test]
        fn unproject_inverts_project(u in -50f64..200.0, v in -50f64..150.0, depth in 0.01f64..1e4) {
            let (pixel, z) = camera().project(camera().unproject(DVec2::new(u, v), depth));
            prop_assert!((pixel - DVec2::new(u, v)).length() < 1e-9);
            prop_assert!((z / depth - 1.0).abs() < 1e-12);
        }

        #[test]
        fn the_scale_of_the_matrix_does_not_matter(power in -300i32..300) {
            let scale = 10f64.powi(power);
            let scaled = Camera::new(camera().world_to_clip.map(|r| r.map(|v| v * scale)), SIZE).unwrap();
            prop_assert!((scaled.position - camera().position).length() < 1e-9);
        }
    }

    #[test]
    fn the_target_is_at_the_principal_point() {
        let (pixel, depth) = camera().project(DVec3::ZERO);
        assert!((pixel - DVec2::new(70.0, 50.0)).length() < 1e-9);
        assert!((depth - 30f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn camera_space_is_left_handed() {
        let m = glam::DMat4::from_cols_array_2d(&camera().world_to_camera()).transpose();
        assert!((m.determinant() + 1.0).abs() < 1e-12);
        assert!((m.transform_point3(DVec3::ZERO).z - 30f64.sqrt()).abs() < 1e-12);
        assert!(m.transform_point3(camera().position).length() < 1e-12);
    }

    #[test]
    fn bad_cameras_are_refused() {
        let mut singular = camera().world_to_clip;
        singular[1] = singular[0];
        assert!(Camera::new(singular, SIZE).is_err());
        singular[1][2] = f64::NAN;
        assert!(Camera::new(singular, SIZE).is_err());
        assert!(
            Camera::new(
                camera().world_to_clip,
                Size {
                    height: 0,
                    width: 3
                }
            )
            .is_err()
        );
    }
}
