//! What guides a spatial filter: weights between two pixels of one frame, from class, normal and depth.
//!
//! Every weight is one exponential, exp(−(normal + depth)), and zero between different classes:
//! - **normal**: κ·½|n − n′|², which is κ(1 − n·n′) for unit vectors: the lobe that the customary (n·n′)^κ approaches
//!   for large κ, and no difference between zero normals.
//! - **depth**, by plane: |n·(X − X′)| / (σ·Z), the distance of the other point from this pixel's plane as a share of
//!   depth; needs a camera and normals.
//! - **depth**, by slope: |Z − Z′| / (σ·(|∂Z/∂x Δx| + |∂Z/∂y Δy|) + Z/1000), the difference as a multiple of what the
//!   slope explains (Schied et al. 2017, equation 3). Slopes are one-sided differences, the smaller of both sides, so
//!   that edges do not count as slopes.
//! - **class**: background is one surface, without depth or normal; every id is one, or all that is not background.

use std::ops::Range;

use crate::error::{Result, in_range};
use crate::image::{BandMut, Image, Run, Size, Tap, View};
use crate::kernels::camera::pinhole::Rays;
use crate::kernels::judge::surface::Surface;
use crate::math::{LOG2_E, is_present};
use crate::rows::{self, Kernel};

#[derive(Clone, Copy, Debug)]
pub struct Sigmas {
    /// κ: how sharply differences of normals count; ≥ 0; 128.
    pub normal: f32,
    /// Depth difference that counts as one, in multiples of what the slope explains; > 0; 1.
    pub depth: f32,
    /// Plane distance that counts as one, as a share of depth; > 0; 0.01.
    pub plane: f32,
}

impl Default for Sigmas {
    fn default() -> Self {
        Self {
            normal: 128.0,
            depth: 1.0,
            plane: 0.01,
        }
    }
}

impl Sigmas {
    pub fn check(&self) -> Result<()> {
        in_range("sigma_normal", self.normal, "a finite number from 0", |v| {
            v >= 0.0 && v.is_finite()
        })?;
        in_range("sigma_depth", self.depth, "a number above 0", |v| v > 0.0)?;
        in_range("sigma_plane", self.plane, "a share above 0", |v| v > 0.0)
    }
}

/// The buffers of one frame in the form in which filters want them: without NaN or infinity.
pub struct Guide {
    class: Option<Image<u32>>,
    normal: Option<Image>,
    depth: Option<Depth>,
}

enum Depth {
    /// Position relative to the camera (3), and depth.
    Plane(Image),
    /// Depth, and its slopes along x and y.
    Slope(Image),
}

impl Guide {
    /// Planes are compared where rays, depth and normals are given, slopes where only depth is.
    pub fn new(size: Size, surface: Surface, rays: Option<Rays>) -> Self {
        let Surface {
            depth, normal, ids, ..
        } = surface;
        let class = (depth.is_some() || ids.is_some()).then(|| {
            let mut class = Image::new(size, 1);
            rows::run(&Classes { depth, ids }, size.height, class.bands());
            class
        });
        let fill = |channels, kernel: Fill| {
            let mut image = Image::new(size, channels);
            rows::run(&kernel, size.height, image.bands());
            image
        };
        let normal = normal.map(|normal| fill(3, Fill::Normals { normal, depth }));
        let depth = depth.map(|depth| match rays.filter(|_| normal.is_some()) {
            Some(rays) => Depth::Plane(fill(4, Fill::Points { depth, rays })),
            None => Depth::Slope(fill(3, Fill::Slopes { depth })),
        });
        Self {
            class,
            normal,
            depth,
        }
    }

    pub fn compares_planes(&self) -> bool {
        matches!(self.depth, Some(Depth::Plane(_)))
    }

    /// Subtracts from `exponents`, in units of log₂, what stands between the pixels `here` and the pixels of `tap`.
    #[inline(always)]
    pub fn subtract(&self, exponents: &mut [f32], sigmas: &Sigmas, here: Run, tap: Tap) {
        let there = tap.of(here);
        if let Some(normal) = &self.normal {
            let scale = LOG2_E * 0.5 * sigmas.normal;
            subtract_normal(exponents, scale, here.rows(normal), there.rows(normal));
        }
        match &self.depth {
            Some(Depth::Plane(points)) => {
                let normal = self.normal.as_ref().expect("planes have normals");
                let [px, py, pz, z] = here.rows(points);
                let scale = LOG2_E / sigmas.plane;
                subtract_plane(
                    exponents,
                    scale,
                    z,
                    here.rows(normal),
                    [px, py, pz],
                    there.rows(points),
                );
            }
            Some(Depth::Slope(slopes)) => {
                let reach =
                    [tap.dx, tap.dy].map(|d| sigmas.depth * (d.unsigned_abs() * tap.step) as f32);
                let [other] = there.rows(slopes);
                subtract_slope(exponents, reach, here.rows(slopes), other);
            }
            None => {}
        }
        if let Some(class) = &self.class {
            separate(exponents, here.rows(class), there.rows(class));
        }
    }
}

#[inline(always)]
fn subtract_normal(exponents: &mut [f32], scale: f32, here: [&[f32]; 3], there: [&[f32]; 3]) {
    let n = exponents.len();
    let [ax, ay, az] = here.map(|row| &row[..n]);
    let [bx, by, bz] = there.map(|row| &row[..n]);
    for i in 0..n {
        let (dx, dy, dz) = (ax[i] - bx[i], ay[i] - by[i], az[i] - bz[i]);
        exponents[i] -= scale * (dx * dx + dy * dy + dz * dz);
    }
}

#[inline(always)]
fn subtract_plane(
    exponents: &mut [f32],
    scale: f32,
    depth: &[f32],
    normal: [&[f32]; 3],
    here: [&[f32]; 3],
    there: [&[f32]; 3],
) {
    let n = exponents.len();
    let depth = &depth[..n];
    let [nx, ny, nz] = normal.map(|row| &row[..n]);
    let [ax, ay, az] = here.map(|row| &row[..n]);
    let [bx, by, bz] = there.map(|row| &row[..n]);
    for i in 0..n {
        let distance = nx[i] * (bx[i] - ax[i]) + ny[i] * (by[i] - ay[i]) + nz[i] * (bz[i] - az[i]);
        // Background has depth 1 here, and no normal.
        exponents[i] -= scale * distance.abs() / depth[i];
    }
}

#[inline(always)]
fn subtract_slope(exponents: &mut [f32], reach: [f32; 2], here: [&[f32]; 3], there: &[f32]) {
    let n = exponents.len();
    let [z, zx, zy] = here.map(|row| &row[..n]);
    let there = &there[..n];
    for i in 0..n {
        // The last term keeps background, where all is zero, from 0/0.
        let scale = reach[0] * zx[i] + reach[1] * zy[i] + 1e-3 * z[i] + 1e-30;
        exponents[i] -= LOG2_E * (z[i] - there[i]).abs() / scale;
    }
}

#[inline(always)]
fn separate(exponents: &mut [f32], [here]: [&[u32]; 1], [there]: [&[u32]; 1]) {
    let n = exponents.len();
    let (here, there) = (&here[..n], &there[..n]);
    for i in 0..n {
        exponents[i] = if here[i] == there[i] {
            exponents[i]
        } else {
            f32::NEG_INFINITY
        };
    }
}

/// Whether a depth is that of a surface.
#[inline(always)]
fn is_surface(z: f32) -> bool {
    (z > 0.0) & (z < f32::INFINITY)
}

struct Classes<'a> {
    depth: Option<View<'a>>,
    ids: Option<View<'a, u32>>,
}

impl<'a> Kernel for Classes<'a> {
    type Out = BandMut<'a, u32>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut class: BandMut<'a, u32>) {
        for y in rows {
            let class = class.row(0, y);
            match self.ids {
                // Background is 0, and an object may be as well.
                Some(ids) => {
                    for (class, &id) in class.iter_mut().zip(ids.row(0, y)) {
                        *class = id.saturating_add(1);
                    }
                }
                None => class.fill(1),
            }
            if let Some(depth) = self.depth {
                for (class, &z) in class.iter_mut().zip(depth.row(0, y)) {
                    *class = if is_surface(z) { *class } else { 0 };
                }
            }
        }
    }
}

/// The float planes of a guide.
enum Fill<'a> {
    Normals {
        normal: View<'a>,
        depth: Option<View<'a>>,
    },
    Points {
        depth: View<'a>,
        rays: Rays,
    },
    Slopes {
        depth: View<'a>,
    },
}

impl<'a> Kernel for Fill<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            match *self {
                Self::Normals { normal, depth } => {
                    normals(normal.rows(y), depth.map(|d| d.row(0, y)), out.rows(y))
                }
                Self::Points { depth, rays } => points(y, depth.row(0, y), rays, out.rows(y)),
                Self::Slopes { depth } => {
                    let row = |y: usize| (y < depth.size.height).then(|| depth.row(0, y));
                    slopes(
                        row(y.wrapping_sub(1)),
                        depth.row(0, y),
                        row(y + 1),
                        out.rows(y),
                    );
                }
            }
        }
    }
}

#[inline(always)]
fn normals([nx, ny, nz]: [&[f32]; 3], depth: Option<&[f32]>, [ox, oy, oz]: [&mut [f32]; 3]) {
    for x in 0..nx.len() {
        let finite = is_present([nx[x], ny[x], nz[x]]);
        let kept = finite && depth.is_none_or(|depth| is_surface(depth[x]));
        (ox[x], oy[x], oz[x]) = if kept {
            (nx[x], ny[x], nz[x])
        } else {
            (0.0, 0.0, 0.0)
        };
    }
}

#[inline(always)]
fn points(y: usize, depth: &[f32], rays: Rays, [ox, oy, oz, od]: [&mut [f32]; 4]) {
    for x in 0..depth.len() {
        let surface = is_surface(depth[x]);
        let z = if surface { depth[x] } else { 0.0 };
        let point = rays.at(x as f32 + 0.5, y as f32 + 0.5) * z;
        (ox[x], oy[x], oz[x]) = (point.x, point.y, point.z);
        od[x] = if surface { z } else { 1.0 };
    }
}

/// A neighbour beyond the border is absent: NaN, which is no surface.
#[inline(always)]
fn slopes(
    above: Option<&[f32]>,
    depth: &[f32],
    below: Option<&[f32]>,
    [oz, ox, oy]: [&mut [f32]; 3],
) {
    for x in 0..depth.len() {
        let z = depth[x];
        let [left, right] =
            [x.wrapping_sub(1), x + 1].map(|x| depth.get(x).copied().unwrap_or(f32::NAN));
        let [up, down] = [above, below].map(|row| row.map_or(f32::NAN, |row| row[x]));
        oz[x] = if is_surface(z) { z } else { 0.0 };
        ox[x] = slope(z, left, right);
        oy[x] = slope(z, up, down);
    }
}

/// The smaller of the differences with the two neighbours, of those that are surfaces; 0 where none is.
#[inline(always)]
fn slope(z: f32, before: f32, after: f32) -> f32 {
    let difference = |other: f32| {
        if is_surface(z) & is_surface(other) {
            (z - other).abs()
        } else {
            f32::INFINITY
        }
    };
    let smaller = difference(before).min(difference(after));
    if smaller < f32::INFINITY {
        smaller
    } else {
        0.0
    }
}
