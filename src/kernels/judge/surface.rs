//! Whether a pixel and a pixel of the previous frame show the same surface.
//!
//! A surface is known by its depth, normal and id, each optional. The tests, each against its own threshold:
//! - **id**: equal.
//! - **normal**: n·n′ ≥ cos(angle) · |n| |n′|, so that shortened normals are judged by direction and zero normals pass.
//! - **depth**, with Ze the depth that the surface is expected to have had (its depth plus the motion's third channel):
//!   relative, |Z′ − Ze| ≤ t·Ze; or, where the previous camera is known, by the distance of the expected point from
//!   the tap's plane, |(Xe − X′)·n′| ≤ t·Ze, which stays small on slopes where depth itself runs (NRD ReLAX and
//!   ReBLUR test the plane distance against a share of view depth; the relative test at a tenth is the usual rule of
//!   thumb). Background matches background alone.

use glam::{Vec2, Vec3};

use crate::error::{Error, Result, in_range};
use crate::image::{Size, View};
use crate::kernels::camera::pinhole::Rays;

/// Why a pixel's history is refused; bits of a mask.
pub mod rejection {
    /// The tap lies outside the previous frame.
    pub const OUTSIDE: u8 = 1;
    /// Another depth than expected.
    pub const DEPTH: u8 = 2;
    /// Another orientation.
    pub const NORMAL: u8 = 4;
    /// Another object.
    pub const ID: u8 = 8;
}

/// What is known of the surfaces of one frame.
#[derive(Clone, Copy, Default)]
pub struct Surface<'a> {
    pub depth: Option<View<'a>>,
    pub normal: Option<View<'a>>,
    pub ids: Option<View<'a, u32>>,
}

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Largest relative difference of depth; > 0; 0.1.
    pub relative_depth: f32,
    /// Largest distance from the plane, as a share of depth; > 0; 0.01.
    pub plane_distance: f32,
    /// Largest angle between normals in degrees; 0 to 180; 25.
    pub normal_angle: f32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            relative_depth: 0.1,
            plane_distance: 0.01,
            normal_angle: 25.0,
        }
    }
}

impl Params {
    pub fn check(&self) -> Result<()> {
        in_range(
            "relative_depth",
            self.relative_depth,
            "a share above 0",
            |v| v > 0.0,
        )?;
        in_range(
            "plane_distance",
            self.plane_distance,
            "a share above 0",
            |v| v > 0.0,
        )?;
        in_range(
            "normal_angle",
            self.normal_angle,
            "degrees from 0 to 180",
            |v| (0.0..=180.0).contains(&v),
        )
    }
}

/// The tests between two frames: those that both frames have the buffers for.
#[derive(Clone, Copy)]
pub struct Tests<'a> {
    size: Size,
    depth: Option<[&'a [f32]; 2]>,
    normal: Option<[[&'a [f32]; 3]; 2]>,
    ids: Option<[&'a [u32]; 2]>,
    /// The previous camera's rays, where planes are tested.
    rays: Option<Rays>,
    relative_depth: f32,
    plane_distance: f32,
    min_cosine: f32,
}

/// What a pixel expects of its history.
pub struct Expected {
    depth: f32,
    /// Relative to the previous camera.
    point: Vec3,
    normal: Vec3,
    id: u32,
}

impl<'a> Tests<'a> {
    pub fn new(
        size: Size,
        now: Surface<'a>,
        before: Surface<'a>,
        rays: Option<Rays>,
        params: &Params,
    ) -> Self {
        let normal = |view: View<'a>| [0, 1, 2].map(|c| view.plane(c));
        let tests = Self {
            size,
            depth: now
                .depth
                .zip(before.depth)
                .map(|(now, before)| [now.plane(0), before.plane(0)]),
            normal: now
                .normal
                .zip(before.normal)
                .map(|(now, before)| [normal(now), normal(before)]),
            ids: now
                .ids
                .zip(before.ids)
                .map(|(now, before)| [now.plane(0), before.plane(0)]),
            rays: None,
            relative_depth: params.relative_depth,
            plane_distance: params.plane_distance,
            min_cosine: libm::cos(f64::from(params.normal_angle).to_radians()) as f32,
        };
        Self {
            rays: rays.filter(|_| tests.depth.is_some() && tests.normal.is_some()),
            ..tests
        }
    }

    pub fn depth(&self) -> bool {
        self.depth.is_some()
    }

    pub fn planes(&self) -> bool {
        self.rays.is_some()
    }

    /// What pixel `i` expects where it comes from: index-space position `from`, at the pixel's depth plus `change`.
    #[inline(always)]
    pub fn expected(&self, i: usize, from: Vec2, change: f32) -> Expected {
        let depth = self.depth.map_or(0.0, |[now, _]| {
            if now[i] > 0.0 {
                now[i] + change
            } else {
                f32::NAN
            }
        });
        Expected {
            depth,
            point: self.rays.map_or(Vec3::ZERO, |rays| {
                rays.at(from.x + 0.5, from.y + 0.5) * depth
            }),
            normal: self.normal.map_or(Vec3::ZERO, |[now, _]| vector(&now, i)),
            id: self.ids.map_or(0, |[now, _]| now[i]),
        }
    }

    /// The bits of the tests that the previous frame's pixel (x, y) fails.
    #[inline(always)]
    pub fn failures(&self, expected: &Expected, x: usize, y: usize) -> u8 {
        let i = y * self.size.width + x;
        let normal = self
            .normal
            .map_or(Vec3::ZERO, |[_, before]| vector(&before, i));
        let mut failed = 0;
        if let Some([_, before]) = self.ids
            && before[i] != expected.id
        {
            failed |= rejection::ID;
        }
        if self.normal.is_some() {
            let lengths = (expected.normal.length_squared() * normal.length_squared()).sqrt();
            if !(expected.normal.dot(normal) >= self.min_cosine * lengths) {
                failed |= rejection::NORMAL;
            }
        }
        if let Some([_, before]) = self.depth
            && !self.depth_holds(expected, before[i], normal, x, y)
        {
            failed |= rejection::DEPTH;
        }
        failed
    }

    #[inline(always)]
    fn depth_holds(
        &self,
        expected: &Expected,
        depth: f32,
        normal: Vec3,
        x: usize,
        y: usize,
    ) -> bool {
        if expected.depth == f32::INFINITY || depth == f32::INFINITY {
            return expected.depth == depth;
        }
        if !(expected.depth > 0.0 && depth > 0.0) {
            return false;
        }
        let length = normal.length();
        match self.rays {
            Some(rays) if length > 0.0 => {
                let tap = rays.at(x as f32 + 0.5, y as f32 + 0.5) * depth;
                let distance = (expected.point - tap).dot(normal) / length;
                distance.abs() <= self.plane_distance * expected.depth
            }
            _ => (depth - expected.depth).abs() <= self.relative_depth * expected.depth,
        }
    }
}

#[inline(always)]
fn vector(planes: &[&[f32]; 3], i: usize) -> Vec3 {
    Vec3::new(planes[0][i], planes[1][i], planes[2][i])
}

/// The plane test needs depths, normals and motion with a change of depth.
pub fn check_plane_test(depth: bool, normal: bool, motion_channels: usize) -> Result<()> {
    if !depth {
        return Err(Error::needs("previous_camera", "depth"));
    }
    if !normal {
        return Err(Error::needs("previous_camera", "normal"));
    }
    if motion_channels != 3 {
        return Err(Error::value(
            "motion",
            "shape (H, W, 3) for the plane test of previous_camera",
            "(H, W, 2)",
        ));
    }
    Ok(())
}
