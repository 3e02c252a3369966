//! Virtual motion: where each pixel's reflection was in the previous frame.
//!
//! What a flat mirror shows does not lie on it but behind it, on the continued view ray, as far from the surface as the
//! reflected object is. Across frames the reflection moves like that point,
//!   V = X + h (X − C)/|X − C|,
//! with X the surface, C the camera, h the distance from the surface to what it reflects (NRD's ReBLUR and ReLAX follow
//! specular light in this way). The motion is project(previous, V) − project(current, X), for h = 0 the surface's own.
//! Curved mirrors bend it, and moving ones turn it: then it is as good as a guess.
//!
//! Inputs: geometry as for [`super::motion`], h (1), from 0 to +inf (the environment). Output: (H, W, 2), in pixels; NaN
//! where h is no such number or V was not in front of the previous camera; background moves as it does.

use std::ops::Range;

use glam::DVec2;

use super::motion::{Geometry, Shown};
use super::pinhole::Camera;
use crate::image::{BandMut, Image, View};
use crate::rows::{self, Kernel};

struct VirtualMotion<'a> {
    geometry: Geometry<'a>,
    hit_distance: View<'a>,
    camera: &'a Camera,
    previous: &'a Camera,
}

pub fn virtual_motion(
    geometry: Geometry,
    hit_distance: View,
    camera: &Camera,
    previous: &Camera,
) -> Image {
    let mut motion = Image::new(camera.size, 2);
    let kernel = VirtualMotion {
        geometry,
        hit_distance,
        camera,
        previous,
    };
    rows::run(&kernel, camera.size.height, motion.bands());
    motion
}

impl<'a> Kernel for VirtualMotion<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut motion: BandMut<'a>) {
        for y in rows {
            let [mx, my] = motion.rows(y);
            for x in 0..mx.len() {
                let moved = self.pixel(x, y).unwrap_or(DVec2::NAN).as_vec2();
                (mx[x], my[x]) = (moved.x, moved.y);
            }
        }
    }
}

impl VirtualMotion<'_> {
    #[inline(always)]
    fn pixel(&self, x: usize, y: usize) -> Option<DVec2> {
        let centre = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        let i = y * self.camera.size.width + x;
        let distance = f64::from(self.hit_distance.plane(0)[i]);
        let point = match self.geometry.at(self.camera, centre, i) {
            Shown::Point(point) => point,
            Shown::Background => {
                let direction = self.camera.ray(centre);
                let now = self.camera.project_direction(direction)?;
                return Some(self.previous.project_direction(direction)? - now);
            }
            Shown::Unknown => return None,
        };
        if distance.is_nan() || distance < 0.0 {
            return None;
        }
        let (now, depth) = self.camera.project(point);
        let view = (point - self.camera.position).normalize();
        if depth.is_nan() || depth <= 0.0 {
            return None;
        }
        if distance == f64::INFINITY {
            return Some(self.previous.project_direction(view)? - now);
        }
        let (before, depth) = self.previous.project(point + view * distance);
        (depth > 0.0).then(|| before - now)
    }
}
