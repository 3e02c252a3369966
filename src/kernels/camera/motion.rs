//! Motion vectors: where each pixel's surface was in the previous frame.
//!
//! A point X that is seen now stood at T·X one frame ago, with T the rigid (or affine) transform of its object,
//! previous · inverse(current), or the identity. Its motion is
//!   project(previous, T·X) − project(current, X)
//! in pixels, and its change of depth is the third channel. With X on the ray of its pixel, X = C + z D(p), both are
//! rational in p and z (see [`super::pinhole::Warp`]). Background lies at infinity along the pixel's ray, where only the
//! camera's rotation moves it. Both ends project the same point, so the sub-pixel jitter of the sample cancels, and a
//! still camera gives exact zeros. Everything is computed in double precision.
//!
//! Inputs: depth (H, W), view-space z, +inf or not above zero where nothing was hit, or position (H, W, 3), world space, not
//! finite where nothing was hit; ids (H, W). Output: (H, W, 3), previous minus current x and y in pixels and depth in scene
//! units; NaN where the point was not in front of the previous camera, or where depth is NaN.

use std::ops::Range;

use glam::{DAffine3, DMat4, DVec3};

use super::pinhole::{Camera, Warp};
use crate::error::{Error, Result};
use crate::image::{Pixels, Run, SEGMENT, segments};
use crate::math::is_background;
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// The positions of the pixels' surfaces, as either buffer.
#[derive(Clone, Copy)]
pub enum Geometry<'a> {
    /// View-space z (1), +inf or not above 0 where nothing was hit.
    Depth(Pixels<'a>),
    /// World space (3), not finite where nothing was hit.
    Position(Pixels<'a>),
}

/// The visible points of a span, in the form that [`Warp::motion`] takes.
pub(crate) struct Shown {
    /// Position in pixels.
    pub x: [f64; SEGMENT],
    pub y: [f64; SEGMENT],
    /// NaN where unknown, 1 for background.
    pub depth: [f64; SEGMENT],
    /// Weight of the camera's translation: 1 for surfaces, 0 for background.
    pub near: [f64; SEGMENT],
    geometry: [Row; 3],
}

impl Shown {
    pub fn nothing() -> Self {
        Self {
            x: [0.0; SEGMENT],
            y: [0.0; SEGMENT],
            depth: [0.0; SEGMENT],
            near: [0.0; SEGMENT],
            geometry: [[0.0; SEGMENT]; 3],
        }
    }

    #[inline(always)]
    pub fn find(&mut self, geometry: Geometry, camera: &Camera, run: Run) {
        let len = run.len;
        let [x, y, depth, near] = [&mut self.x, &mut self.y, &mut self.depth, &mut self.near]
            .map(|lane| &mut lane[..len]);
        let [a, b, c] = self.geometry.each_mut().map(|row| &mut row[..len]);
        let right = |i: usize| f64::from(run.x as i32 + i as i32) + 0.5;
        let down = run.y as f64 + 0.5;
        match geometry {
            Geometry::Depth(image) => {
                image.load(run, 0, a);
                for i in 0..len {
                    (x[i], y[i]) = (right(i), down);
                    let far = is_background(a[i]);
                    depth[i] = f64::from(if far { 1.0 } else { a[i] });
                    near[i] = if far { 0.0 } else { 1.0 };
                }
            }
            Geometry::Position(image) => {
                image.read(run, [&mut *a, &mut *b, &mut *c]);
                for i in 0..len {
                    let point = DVec3::new(a[i].into(), b[i].into(), c[i].into());
                    let far = !(a[i].is_finite() & b[i].is_finite() & c[i].is_finite());
                    let (pixel, z) = camera.project(point);
                    let known = if z > 0.0 { z } else { f64::NAN };
                    x[i] = if far { right(i) } else { pixel.x };
                    y[i] = if far { down } else { pixel.y };
                    depth[i] = if far { 1.0 } else { known };
                    near[i] = if far { 0.0 } else { 1.0 };
                }
            }
        }
    }
}

/// Pixels by which a motion may differ from the still scene's and count as the same.
const SAME_MOTION: f32 = 0.5;

/// Whether a motion is that of a still scene.
#[inline(always)]
pub(crate) fn is_still([x, y]: [f32; 2], still: [f32; 2]) -> bool {
    let (dx, dy) = (x - still[0], y - still[1]);
    dx * dx + dy * dy <= SAME_MOTION * SAME_MOTION
}

/// Transforms of objects that moved: id and previous · inverse(current), sorted by id.
#[derive(Default)]
pub struct Transforms(Vec<(u32, DAffine3)>);

impl Transforms {
    /// By id; an error if a matrix is not affine.
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
        if let Some(twice) = transforms.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let name = format!("transforms[{}]", twice[0].0);
            return Err(Error::value(&name, "one matrix", "several"));
        }
        let affine = |(id, matrix)| (id, DAffine3::from_mat4(matrix));
        Ok(Self(transforms.into_iter().map(affine).collect()))
    }
}

struct Motion<'a> {
    geometry: Geometry<'a>,
    camera: &'a Camera,
    still: Warp,
    ids: Option<Pixels<'a, u32>>,
    /// Warps of objects that moved, sorted by id.
    moved: Vec<(u32, Warp)>,
}

/// Writes motion vectors (3 channels).
pub fn motion_vectors<'a>(
    geometry: Geometry<'a>,
    camera: &'a Camera,
    previous: &Camera,
    ids: Option<Pixels<'a, u32>>,
    transforms: &Transforms,
    motion: impl Iterator<Item = PixelsMut<'a>>,
) {
    let warp = |transform| Warp::new(camera, previous, transform);
    let moved = transforms.0.iter();
    let kernel = Motion {
        geometry,
        camera,
        still: warp(DAffine3::IDENTITY),
        ids: ids.filter(|_| !transforms.0.is_empty()),
        moved: moved
            .map(|&(id, transform)| (id, warp(transform)))
            .collect(),
    };
    rows::run(&kernel, camera.size.height, motion);
}

impl<'a> Kernel for Motion<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut motion: PixelsMut<'a>) {
        let width = self.camera.size.width;
        let mut shown = Shown::nothing();
        let mut moved = [[0.0; SEGMENT]; 3];
        for run in rows.flat_map(|y| segments(y, width)) {
            shown.find(self.geometry, self.camera, run);
            let Shown {
                x, y, depth, near, ..
            } = &shown;
            let [mx, my, mz] = moved.each_mut().map(|row| &mut row[..run.len]);
            for i in 0..run.len {
                [mx[i], my[i], mz[i]] = self.still.motion([x[i], y[i]], depth[i], near[i]);
            }
            if let Some(ids) = self.ids {
                let first = run.y * width + run.x;
                for i in (0..run.len).filter(|&i| near[i] != 0.0) {
                    let id = ids.at(first + i, 0);
                    if let Ok(found) = self.moved.binary_search_by_key(&id, |&(id, _)| id) {
                        let (_, warp) = self.moved[found];
                        [mx[i], my[i], mz[i]] = warp.motion([x[i], y[i]], depth[i], near[i]);
                    }
                }
            }
            motion.write(run, &moved);
        }
    }
}
