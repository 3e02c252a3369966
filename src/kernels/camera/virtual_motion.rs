//! Virtual motion: where each pixel's reflection was in the previous frame.
//!
//! A flat mirror's image lies behind the mirror, on the continued view ray, at the distance of the reflected object from
//! the surface. Across frames the reflection moves like that virtual point,
//!   V = X + h (X − C)/|X − C|,
//! with X the surface, C the camera, h the hit distance from the surface to the reflected object (NRD's ReBLUR and ReLAX
//! follow specular light in this way). The motion is project(previous, V) − project(current, X), for h = 0 the surface's
//! own. For curved or moving mirrors it is an approximation without bound on the error.
//!
//! Inputs: geometry as for [`super::motion`], h (1), from 0 to +inf (the environment). Output: (H, W, 2), in pixels;
//! NaN where h is NaN or negative, or V was not in front of the previous camera. Background pixels move with the
//! environment.

use std::ops::Range;

use glam::{DAffine3, DVec2};

use super::motion::{Geometry, Shown};
use super::pinhole::{Camera, Warp};
use crate::image::{Pixels, SEGMENT, segments};
use crate::pixels::PixelsMut;
use crate::rows::{self, Kernel, Simd};

/// The current camera and the warp to the previous one.
pub(crate) struct Mirrored<'a> {
    camera: &'a Camera,
    warp: Warp,
}

impl<'a> Mirrored<'a> {
    pub fn new(camera: &'a Camera, previous: &Camera) -> Self {
        Self {
            camera,
            warp: Warp::new(camera, previous, DAffine3::IDENTITY),
        }
    }

    /// The motion of the reflections in the pixels of `shown` from `start` on, at these hit distances.
    #[inline(always)]
    pub fn motion(
        &self,
        shown: &Shown,
        start: usize,
        distances: &[f32],
        x: &mut [f32],
        y: &mut [f32],
    ) {
        let len = distances.len();
        let [u, v, depth, surface] =
            [&shown.x, &shown.y, &shown.depth, &shown.near].map(|lane| &lane[start..][..len]);
        let (x, y) = (&mut x[..len], &mut y[..len]);
        for i in 0..len {
            let distance = f64::from(distances[i]);
            // Distance along the ray to depth: the ray has unit depth.
            let ray = self.camera.ray(DVec2::new(u[i], v[i]));
            let behind = depth[i] + distance / ray.length();
            let known = if distance >= 0.0 { behind } else { f64::NAN };
            // The environment's reflection lies at infinity. The depth test keeps unknown surfaces (NaN) unknown.
            let far = (distance == f64::INFINITY) & (depth[i] > 0.0);
            let (image, near) = if far { (1.0, 0.0) } else { (known, 1.0) };
            let (image, near) = if surface[i] == 0.0 {
                (1.0, 0.0)
            } else {
                (image, near)
            };
            [x[i], y[i], _] = self.warp.motion([u[i], v[i]], image, near);
        }
    }
}

struct VirtualMotion<'a> {
    geometry: Geometry<'a>,
    hit_distance: Pixels<'a>,
    camera: &'a Camera,
    mirrored: Mirrored<'a>,
}

/// Writes the motion (2 channels) of the pixels' reflections.
pub fn virtual_motion<'a>(
    geometry: Geometry<'a>,
    hit_distance: Pixels<'a>,
    camera: &'a Camera,
    previous: &Camera,
    motion: impl Iterator<Item = PixelsMut<'a>>,
) {
    let kernel = VirtualMotion {
        geometry,
        hit_distance,
        camera,
        mirrored: Mirrored::new(camera, previous),
    };
    rows::run(&kernel, camera.size.height, motion);
}

impl<'a> Kernel for VirtualMotion<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut motion: PixelsMut<'a>) {
        let mut shown = Shown::nothing();
        let (mut distances, mut moved) = ([0.0; SEGMENT], [[0.0; SEGMENT]; 2]);
        for run in rows.flat_map(|y| segments(y, self.camera.size.width)) {
            let distances = &mut distances[..run.len];
            self.hit_distance.load(run, 0, distances);
            shown.find(self.geometry, self.camera, run);
            let [x, y] = &mut moved;
            self.mirrored.motion(&shown, 0, distances, x, y);
            motion.write(run, &moved);
        }
    }
}
