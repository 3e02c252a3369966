//! Motion vectors: where each pixel's surface was in the previous frame.
//!
//! A point X that is seen now stood at T·X one frame ago, with T the rigid (or affine) transform of its object,
//! previous · inverse(current), or the identity. Its motion is
//!   project(previous, T·X) − project(current, X)
//! in pixels, and its change of depth is the third channel. Background stands at infinity along the pixel's ray, where
//! only the camera's rotation moves it. Both ends are projected from the same point, so sub-pixel jitter of the sample
//! cancels, and a still camera gives zeros exactly. Everything is computed in double precision.
//!
//! Inputs: depth (H, W), view-space z, +inf where nothing was hit, or position (H, W, 3), world space, not finite where
//! nothing was hit; ids (H, W). Output: (H, W, 3), previous minus current x and y in pixels and depth in scene units;
//! NaN where the point was not in front of the previous camera or its depth is no number above zero.

use std::ops::Range;

use glam::{DMat4, DVec2, DVec3};

use super::pinhole::Camera;
use crate::error::{Error, Result};
use crate::image::{BandMut, Image, View};
use crate::rows::{self, Kernel};

/// What is known of where the pixels' surfaces are.
#[derive(Clone, Copy)]
pub enum Geometry<'a> {
    Depth(View<'a>),
    Position(View<'a>),
}

/// What a pixel shows.
pub enum Shown {
    Point(DVec3),
    Background,
    Unknown,
}

impl<'a> Geometry<'a> {
    pub fn of(view: View<'a>, positions: bool) -> Self {
        if positions {
            Self::Position(view)
        } else {
            Self::Depth(view)
        }
    }

    #[inline(always)]
    pub fn at(&self, camera: &Camera, centre: DVec2, i: usize) -> Shown {
        match self {
            Self::Depth(depth) => match depth.plane(0)[i] {
                f32::INFINITY => Shown::Background,
                z if z > 0.0 => Shown::Point(camera.unproject(centre, f64::from(z))),
                _ => Shown::Unknown,
            },
            Self::Position(position) => {
                let point = [0, 1, 2].map(|c| f64::from(position.plane(c)[i]));
                let point = DVec3::from_array(point);
                if point.is_finite() {
                    Shown::Point(point)
                } else {
                    Shown::Background
                }
            }
        }
    }
}

/// Transforms of objects that moved: id and previous · inverse(current), sorted by id.
#[derive(Default)]
pub struct Transforms(Vec<(u32, DMat4)>);

impl Transforms {
    pub fn new(mut transforms: Vec<(u32, DMat4)>) -> Result<Self> {
        for (id, matrix) in &transforms {
            let name = format!("transforms[{id}]");
            if !matrix.is_finite() {
                return Err(Error::value(&name, "finite numbers", "NaN or infinity"));
            }
            if matrix.row(3).to_array() != [0.0, 0.0, 0.0, 1.0] {
                return Err(Error::value(
                    &name,
                    "an affine matrix with last row 0 0 0 1",
                    matrix.row(3),
                ));
            }
        }
        transforms.sort_by_key(|&(id, _)| id);
        Ok(Self(transforms))
    }

    #[inline(always)]
    fn of(&self, id: u32) -> Option<&DMat4> {
        self.0
            .binary_search_by_key(&id, |&(id, _)| id)
            .ok()
            .map(|i| &self.0[i].1)
    }
}

struct Motion<'a> {
    geometry: Geometry<'a>,
    camera: &'a Camera,
    previous: &'a Camera,
    ids: Option<View<'a, u32>>,
    transforms: &'a Transforms,
}

/// The motion image (3 channels) of a frame.
pub fn motion_vectors(
    geometry: Geometry,
    camera: &Camera,
    previous: &Camera,
    ids: Option<View<u32>>,
    transforms: &Transforms,
) -> Image {
    let mut motion = Image::new(camera.size, 3);
    rows::run(
        &Motion {
            geometry,
            camera,
            previous,
            ids,
            transforms,
        },
        camera.size.height,
        motion.bands(),
    );
    motion
}

impl<'a> Kernel for Motion<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut motion: BandMut<'a>) {
        let width = self.camera.size.width;
        for y in rows {
            let [mx, my, mz] = motion.rows(y);
            for x in 0..width {
                let moved = self
                    .pixel(x, y, y * width + x)
                    .unwrap_or(DVec3::NAN)
                    .as_vec3();
                (mx[x], my[x], mz[x]) = (moved.x, moved.y, moved.z);
            }
        }
    }
}

impl Motion<'_> {
    #[inline(always)]
    fn pixel(&self, x: usize, y: usize, i: usize) -> Option<DVec3> {
        let centre = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        let point = match self.geometry.at(self.camera, centre, i) {
            Shown::Point(point) => point,
            Shown::Background => {
                let direction = self.camera.ray(centre);
                let now = self.camera.project_direction(direction)?;
                let before = self.previous.project_direction(direction)?;
                return Some((before - now).extend(0.0));
            }
            Shown::Unknown => return None,
        };
        let transform = self.ids.and_then(|ids| self.transforms.of(ids.plane(0)[i]));
        let before = transform.map_or(point, |t| t.transform_point3(point));
        let (now_pixel, now_depth) = self.camera.project(point);
        let (before_pixel, before_depth) = self.previous.project(before);
        let seen = now_depth > 0.0 && before_depth > 0.0;
        seen.then(|| (before_pixel - now_pixel).extend(before_depth - now_depth))
    }
}
