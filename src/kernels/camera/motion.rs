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
use crate::image::{Pixels, Run, SEGMENT, segments};
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel};

/// What is known of where the pixels' surfaces are.
#[derive(Clone, Copy)]
pub enum Geometry<'a> {
    Depth(Pixels<'a>),
    Position(Pixels<'a>),
}

/// What the pixels of a run show: points, w = 1, or for the background directions, w = 0; NaN where that is not known.
pub struct Shown {
    pub x: [f64; SEGMENT],
    pub y: [f64; SEGMENT],
    pub z: [f64; SEGMENT],
    pub w: [f64; SEGMENT],
    geometry: [Row; 3],
}

impl Shown {
    pub fn nothing() -> Self {
        Self {
            x: [0.0; SEGMENT],
            y: [0.0; SEGMENT],
            z: [0.0; SEGMENT],
            w: [0.0; SEGMENT],
            geometry: [[0.0; SEGMENT]; 3],
        }
    }

    /// Each pixel's point or direction, and which it is.
    #[inline(always)]
    pub fn at(&self, i: usize) -> (DVec3, f64) {
        (DVec3::new(self.x[i], self.y[i], self.z[i]), self.w[i])
    }

    #[inline(always)]
    pub fn set(&mut self, i: usize, point: DVec3, w: f64) {
        (self.x[i], self.y[i], self.z[i], self.w[i]) = (point.x, point.y, point.z, w);
    }

    #[inline(always)]
    pub fn find(&mut self, geometry: Geometry, camera: &Camera, run: Run) {
        let len = run.len;
        let Self {
            x,
            y,
            z,
            w,
            geometry: [a, b, c],
        } = self;
        let (x, y, z, w) = (&mut x[..len], &mut y[..len], &mut z[..len], &mut w[..len]);
        let (a, b, c) = (&mut a[..len], &mut b[..len], &mut c[..len]);
        let down = run.y as f64 + 0.5;
        let right = |i: usize| f64::from(run.x as i32 + i as i32) + 0.5;
        let ray = |i: usize| camera.ray(DVec2::new(right(i), down));
        match geometry {
            Geometry::Depth(depth) => {
                depth.load(run, 0, a);
                for i in 0..len {
                    let depth = f64::from(a[i]);
                    let far = depth == f64::INFINITY;
                    let known = if depth > 0.0 { depth } else { f64::NAN };
                    let (scale, point) = if far { (1.0, 0.0) } else { (known, 1.0) };
                    let place = camera.position * point + ray(i) * scale;
                    (x[i], y[i], z[i], w[i]) = (place.x, place.y, place.z, point);
                }
            }
            Geometry::Position(position) => {
                position.read(run, [&mut *a, &mut *b, &mut *c]);
                for i in 0..len {
                    let ray = ray(i);
                    let hit = a[i].is_finite() & b[i].is_finite() & c[i].is_finite();
                    x[i] = if hit { f64::from(a[i]) } else { ray.x };
                    y[i] = if hit { f64::from(b[i]) } else { ray.y };
                    z[i] = if hit { f64::from(c[i]) } else { ray.z };
                    w[i] = if hit { 1.0 } else { 0.0 };
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
    ids: Option<Pixels<'a, u32>>,
    transforms: &'a Transforms,
}

/// Writes the motion (3 channels) of a frame.
pub fn motion_vectors<'a>(
    geometry: Geometry<'a>,
    camera: &'a Camera,
    previous: &'a Camera,
    ids: Option<Pixels<'a, u32>>,
    transforms: &'a Transforms,
    motion: impl Iterator<Item = PixelsMut<'a>>,
) {
    let kernel = Motion {
        geometry,
        camera,
        previous,
        ids: ids.filter(|_| !transforms.0.is_empty()),
        transforms,
    };
    rows::run(&kernel, camera.size.height, motion);
}

impl<'a> Kernel for Motion<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut motion: PixelsMut<'a>) {
        let width = self.camera.size.width;
        let (mut now, mut before) = (Shown::nothing(), Shown::nothing());
        let mut moved = [[0.0; SEGMENT]; 3];
        for run in rows.flat_map(|y| segments(y, width)) {
            now.find(self.geometry, self.camera, run);
            match self.ids {
                None => self.project(run.len, &now, &now, &mut moved),
                Some(ids) => {
                    for i in 0..run.len {
                        let (point, w) = now.at(i);
                        let transform = self.transforms.of(ids.at(run.y * width + run.x + i, 0));
                        let moved = transform.filter(|_| w != 0.0);
                        before.set(i, moved.map_or(point, |t| t.transform_point3(point)), w);
                    }
                    self.project(run.len, &now, &before, &mut moved);
                }
            }
            motion.write(run, moved.each_ref().map(Row::as_slice));
        }
    }
}

impl Motion<'_> {
    #[inline(always)]
    fn project(&self, len: usize, now: &Shown, before: &Shown, [x, y, z]: &mut [Row; 3]) {
        for i in 0..len {
            let ((now, w), (before, _)) = (now.at(i), before.at(i));
            let (now, now_depth) = self.camera.pixel_of(now, w);
            let (before, before_depth) = self.previous.pixel_of(before, w);
            let seen = (now_depth > 0.0) & (before_depth > 0.0);
            let moved = before - now;
            let nearer = if w == 0.0 {
                0.0
            } else {
                before_depth - now_depth
            };
            x[i] = if seen { moved.x as f32 } else { f32::NAN };
            y[i] = if seen { moved.y as f32 } else { f32::NAN };
            z[i] = if seen { nearer as f32 } else { f32::NAN };
        }
    }
}
