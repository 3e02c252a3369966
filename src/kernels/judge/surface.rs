//! Whether a pixel and a pixel of the previous frame show the same surface, in the same light.
//!
//! A pixel is known by depth, normal, id and colour, each optional. Every test turns a difference into a trust: 1 up to
//! one bound, 0 beyond another, linear between; where the bounds are one number, the threshold is hard. A tap's trust is
//! the product.
//! - **id**: equal.
//! - **normal**: n·n′ ≥ cos(angle) · |n| |n′|, so that shortened normals are judged by direction and zero normals pass.
//!   Normals in the object's own space, where given, are compared instead: they do not turn with it.
//! - **depth**, with Ze the depth that the surface is expected to have had (its depth plus the motion's third channel):
//!   relative, |Z′ − Ze| ≤ t·Ze; or, where the previous camera is known, by the distance of the expected point from
//!   the tap's plane, |(Xe − X′)·n′| ≤ t·Ze, which stays small on slopes where depth itself runs (NRD ReLAX and
//!   ReBLUR test the plane distance against a share of view depth; the relative test at a tenth is the usual rule of
//!   thumb). Background matches background alone.
//! - **luminance**: |l − l′| / max(|l|, |l′|) ≤ t; missing samples pass.
//! - **speed**: the length of the motion in pixels.

use glam::{Vec2, Vec3};

use crate::error::{Error, Result, in_range};
use crate::image::{Size, View};
use crate::kernels::camera::pinhole::Rays;
use crate::math::luminance;

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
    /// Too fast.
    pub const VELOCITY: u8 = 16;
    /// Another brightness.
    pub const LUMINANCE: u8 = 32;
}

/// What is known of the surfaces of one frame.
#[derive(Clone, Copy, Default)]
pub struct Surface<'a> {
    pub depth: Option<View<'a>>,
    pub normal: Option<View<'a>>,
    pub ids: Option<View<'a, u32>>,
    pub object_normal: Option<View<'a>>,
    pub color: Option<View<'a>>,
}

/// Up to `full` a difference is trusted, beyond `none` it is not; the ramp between is linear.
#[derive(Clone, Copy, Debug)]
pub struct Threshold {
    pub full: f32,
    pub none: f32,
}

impl Threshold {
    pub const fn hard(at: f32) -> Self {
        Self { full: at, none: at }
    }

    pub fn check(self, name: &str, expected: &str, holds: impl Fn(f32) -> bool) -> Result<()> {
        in_range(name, self.full, expected, &holds)?;
        in_range(name, self.none, expected, &holds)?;
        if self.full > self.none {
            let got = format!("({}, {})", self.full, self.none);
            return Err(Error::value(
                name,
                "full trust up to less than none from",
                got,
            ));
        }
        if self.full < self.none && self.none == f32::INFINITY {
            return Err(Error::value(name, "a ramp that ends", self.none));
        }
        Ok(())
    }

    /// The trust in a difference that is measured in the given unit; 0 in NaN.
    #[inline(always)]
    pub fn trust(self, difference: f32, unit: f32) -> f32 {
        let (full, none) = (self.full * unit, self.none * unit);
        if difference <= full {
            1.0
        } else if difference < none {
            (none - difference) / (none - full)
        } else {
            0.0
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Relative difference of depth; > 0; 0.1.
    pub relative_depth: Threshold,
    /// Distance from the plane, as a share of depth; > 0; 0.01.
    pub plane_distance: Threshold,
    /// Angle between normals in degrees; 0 to 180; 25. The ramp is linear in the cosine.
    pub normal_angle: Threshold,
    /// Relative difference of luminance; ≥ 0; 0.5.
    pub relative_luminance: Threshold,
    /// Length of the motion in pixels; ≥ 0; none.
    pub speed: Option<Threshold>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            relative_depth: Threshold::hard(0.1),
            plane_distance: Threshold::hard(0.01),
            normal_angle: Threshold::hard(25.0),
            relative_luminance: Threshold::hard(0.5),
            speed: None,
        }
    }
}

impl Params {
    pub fn check(&self) -> Result<()> {
        self.relative_depth
            .check("relative_depth", "a share above 0", |v| v > 0.0)?;
        self.plane_distance
            .check("plane_distance", "a share above 0", |v| v > 0.0)?;
        self.normal_angle
            .check("normal_angle", "degrees from 0 to 180", |v| {
                (0.0..=180.0).contains(&v)
            })?;
        self.relative_luminance
            .check("relative_luminance", "a finite share from 0", |v| {
                v >= 0.0 && v.is_finite()
            })?;
        self.speed.map_or(Ok(()), |speed| {
            speed.check("speed", "pixels from 0", |v| v >= 0.0)
        })
    }
}

/// A buffer of the current and of the previous frame.
type Pair<T> = Option<[T; 2]>;

/// The tests between two frames: those that both frames have the buffers for.
#[derive(Clone, Copy)]
pub struct Tests<'a> {
    size: Size,
    depth: Pair<&'a [f32]>,
    /// What the plane test needs, and what directions are compared of.
    normal: Pair<[&'a [f32]; 3]>,
    direction: Pair<[&'a [f32]; 3]>,
    ids: Pair<&'a [u32]>,
    color: Pair<[&'a [f32]; 3]>,
    /// The previous camera's rays, where planes are tested.
    rays: Option<Rays>,
    params: Params,
    /// Of minus the cosine.
    turn: Threshold,
}

/// What a pixel expects of its history.
pub struct Expected {
    depth: f32,
    /// Relative to the previous camera.
    point: Vec3,
    direction: Vec3,
    id: u32,
    luminance: f32,
    /// Trust that does not depend on the tap, and the bits of the tests that failed.
    trust: f32,
    failed: u8,
}

fn both<T, U>(now: Option<T>, before: Option<T>, part: impl Fn(T) -> U) -> Pair<U> {
    now.zip(before)
        .map(|(now, before)| [part(now), part(before)])
}

impl<'a> Tests<'a> {
    pub fn new(
        size: Size,
        now: Surface<'a>,
        before: Surface<'a>,
        rays: Option<Rays>,
        params: &Params,
    ) -> Self {
        let vectors = |view: View<'a>| [0, 1, 2].map(|c| view.plane(c));
        let minus_cosine = |angle: f32| -libm::cos(f64::from(angle).to_radians()) as f32;
        let depth = both(now.depth, before.depth, |view| view.plane(0));
        let normal = both(now.normal, before.normal, vectors);
        Self {
            size,
            depth,
            normal,
            direction: both(now.object_normal, before.object_normal, vectors).or(normal),
            ids: both(now.ids, before.ids, |view| view.plane(0)),
            color: both(now.color, before.color, vectors),
            rays: rays.filter(|_| depth.is_some() && normal.is_some()),
            params: *params,
            turn: Threshold {
                full: minus_cosine(params.normal_angle.full),
                none: minus_cosine(params.normal_angle.none),
            },
        }
    }

    /// Whether nothing is tested.
    pub fn accept_all(&self) -> bool {
        let untested = self.depth.is_none() && self.direction.is_none() && self.ids.is_none();
        untested && self.color.is_none() && self.params.speed.is_none()
    }

    /// What pixel `i` expects where it comes from: index-space position `from`, after `motion`, at the pixel's depth
    /// plus `change`.
    #[inline(always)]
    pub fn expected(&self, i: usize, from: Vec2, motion: Vec2, change: f32) -> Expected {
        let depth = self.depth.map_or(0.0, |[now, _]| {
            if now[i] > 0.0 {
                now[i] + change
            } else {
                f32::NAN
            }
        });
        let trust = self
            .params
            .speed
            .map_or(1.0, |speed| speed.trust(motion.length(), 1.0));
        Expected {
            depth,
            point: self.rays.map_or(Vec3::ZERO, |rays| {
                rays.at(from.x + 0.5, from.y + 0.5) * depth
            }),
            direction: self
                .direction
                .map_or(Vec3::ZERO, |[now, _]| vector(&now, i)),
            id: self.ids.map_or(0, |[now, _]| now[i]),
            luminance: self.color.map_or(0.0, |[now, _]| brightness(&now, i)),
            trust,
            failed: if trust > 0.0 { 0 } else { rejection::VELOCITY },
        }
    }

    /// The trust in the previous frame's pixel (x, y), and the bits of the tests that leave none.
    #[inline(always)]
    pub fn judge(&self, expected: &Expected, x: usize, y: usize) -> (f32, u8) {
        let i = y * self.size.width + x;
        let (mut trust, mut failed) = (expected.trust, expected.failed);
        let mut count = |this: f32, bit: u8| {
            trust *= this;
            failed |= if this > 0.0 { 0 } else { bit };
        };
        if let Some([_, before]) = self.ids {
            let same = before[i] == expected.id;
            count(if same { 1.0 } else { 0.0 }, rejection::ID);
        }
        if let Some([_, before]) = self.direction {
            let direction = vector(&before, i);
            let lengths = (expected.direction.length_squared() * direction.length_squared()).sqrt();
            let turn = -expected.direction.dot(direction);
            count(self.turn.trust(turn, lengths), rejection::NORMAL);
        }
        if let Some([_, before]) = self.depth {
            let normal = self
                .normal
                .map_or(Vec3::ZERO, |[_, before]| vector(&before, i));
            count(
                self.depth_trust(expected, before[i], normal, x, y),
                rejection::DEPTH,
            );
        }
        if let Some([_, before]) = self.color {
            let (l, other) = (expected.luminance, brightness(&before, i));
            let larger = l.abs().max(other.abs());
            let known = l.is_finite() & other.is_finite();
            if known {
                let trust = self
                    .params
                    .relative_luminance
                    .trust((l - other).abs(), larger);
                count(trust, rejection::LUMINANCE);
            }
        }
        (trust, failed)
    }

    #[inline(always)]
    fn depth_trust(
        &self,
        expected: &Expected,
        depth: f32,
        normal: Vec3,
        x: usize,
        y: usize,
    ) -> f32 {
        if expected.depth == f32::INFINITY || depth == f32::INFINITY {
            return if expected.depth == depth { 1.0 } else { 0.0 };
        }
        if !(expected.depth > 0.0 && depth > 0.0) {
            return 0.0;
        }
        let length = normal.length();
        match self.rays {
            Some(rays) if length > 0.0 => {
                let tap = rays.at(x as f32 + 0.5, y as f32 + 0.5) * depth;
                let distance = (expected.point - tap).dot(normal) / length;
                self.params
                    .plane_distance
                    .trust(distance.abs(), expected.depth)
            }
            _ => self
                .params
                .relative_depth
                .trust((depth - expected.depth).abs(), expected.depth),
        }
    }
}

#[inline(always)]
fn vector(planes: &[&[f32]; 3], i: usize) -> Vec3 {
    Vec3::new(planes[0][i], planes[1][i], planes[2][i])
}

#[inline(always)]
fn brightness(planes: &[&[f32]; 3], i: usize) -> f32 {
    luminance(planes[0][i], planes[1][i], planes[2][i])
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
