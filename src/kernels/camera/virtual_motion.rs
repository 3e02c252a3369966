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

use super::motion::{Geometry, Shown};
use super::pinhole::Camera;
use crate::image::{Pixels, Run, SEGMENT, segments};
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel};

/// What is known beside the distances to what is reflected.
#[derive(Clone, Copy)]
pub struct Mirrors<'a> {
    pub geometry: Geometry<'a>,
    pub camera: &'a Camera,
    pub previous: &'a Camera,
}

impl Mirrors<'_> {
    /// The motion of a run of pixels, which show what `shown` is to be made to hold.
    #[inline(always)]
    pub fn follow(&self, run: Run, distances: &[f32], shown: &mut Shown, motion: &mut [Row; 2]) {
        let len = run.len;
        shown.find(self.geometry, self.camera, run);
        let distances = &distances[..len];
        let [x, y] = motion.each_mut().map(|row| &mut row[..len]);
        for i in 0..len {
            let ((place, w), distance) = (shown.at(i), f64::from(distances[i]));
            let (now, depth) = self.camera.pixel_of(place, w);
            let away = place - self.camera.position;
            let steps = distance / away.length();
            let (surface, far) = (w != 0.0, distance == f64::INFINITY);
            let behind = if far { away } else { place + away * steps };
            let (image, w) = if surface {
                (behind, if far { 0.0 } else { 1.0 })
            } else {
                (place, 0.0)
            };
            let (before, depth_before) = self.previous.pixel_of(image, w);
            let known = !surface | (distance >= 0.0);
            let seen = known & (depth > 0.0) & (depth_before > 0.0);
            let moved = before - now;
            x[i] = if seen { moved.x as f32 } else { f32::NAN };
            y[i] = if seen { moved.y as f32 } else { f32::NAN };
        }
    }
}

struct VirtualMotion<'a> {
    mirrors: Mirrors<'a>,
    hit_distance: Pixels<'a>,
}

/// Writes the motion (2 channels) of what the pixels reflect.
pub fn virtual_motion<'a>(
    mirrors: Mirrors<'a>,
    hit_distance: Pixels<'a>,
    motion: impl Iterator<Item = PixelsMut<'a>>,
) {
    let kernel = VirtualMotion {
        mirrors,
        hit_distance,
    };
    rows::run(&kernel, hit_distance.size.height, motion);
}

impl<'a> Kernel for VirtualMotion<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut motion: PixelsMut<'a>) {
        let width = self.hit_distance.size.width;
        let mut shown = Shown::nothing();
        let (mut distances, mut moved) = ([0.0; SEGMENT], [[0.0; SEGMENT]; 2]);
        for run in rows.flat_map(|y| segments(y, width)) {
            self.hit_distance.load(run, 0, &mut distances[..run.len]);
            self.mirrors.follow(run, &distances, &mut shown, &mut moved);
            motion.write(run, moved.each_ref().map(Row::as_slice));
        }
    }
}
