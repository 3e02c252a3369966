//! What guides a spatial filter: weights between two pixels of one frame, from class, normal and depth.
//!
//! Every weight is one exponential, exp(−(normal + depth)), and zero between different classes:
//! - **normal**: κ·½|n − n′|² / (1 + κρ), where κ·½|n − n′|² is κ(1 − n·n′) for unit vectors: the lobe that the customary
//!   (n·n′)^κ approaches for large κ, and no difference between zero normals. The roughness ρ is how much normals change
//!   from pixel to pixel where that is neither an edge nor curvature, but bumps and noise, which would stop the filter at
//!   every pixel: ½ Σ min(|n₋ − n|², |n₊ − n|², ⅓|n₋ − 2n + n₊|²) over both axes, n₋ and n₊ being the normals of the pixels
//!   before and after, of the same class. Rousselle et al. 2013 (*Robust Denoising using Feature and Color Information*)
//!   divide a feature's difference by its gradient likewise.
//! - **depth**: |w′ − w − Δx ∂w/∂x − Δy ∂w/∂y| / (σ_p w + σ_d r (|∂w/∂x| + |∂w/∂y|)), with w = 1/Z, which is linear in the
//!   image on a plane: how far the other point lies before or behind this pixel's tangent plane, as a share of depth, where
//!   the slope is allowed to be wrong by a multiple of itself over the kernel's reach r. Slopes are one-sided differences,
//!   the smaller of both sides, so that edges do not count as slopes. Schied et al. 2017, equation 3, compare Z′ with Z
//!   itself and divide by the slope: on every inclined surface, each tap then has a weight of 1/e beside the centre's 1.
//! - **class**: background is one surface, without depth or normal; every id is one, or all that is not background.
//!
//! In tiles whose normals and ids are incoherent ([`coherence`](crate::kernels::judge::coherence)), depth guides: their normals
//! are zeroed, and coarser ids stand in for theirs.

use std::ops::Range;

use crate::bordered::{Bordered, BorderedBand, Layout};
use crate::error::{Result, finite_from_0, in_range};
use crate::image::{Pixels, Run, Size};
use crate::kernels::fetch::validate::Surface;
use crate::lanes::{Classes, Lanes, Taps};
use crate::math::{LOG2_E, is_present, is_surface, smaller};
use crate::rows::{self, Kernel, Simd};
use crate::tiles::Tiles;

/// How far surfaces may differ before they stop a filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sigmas {
    /// κ: how sharply differences of normals count; ≥ 0; 128.
    pub normal: f32,
    /// Part of the distance from the tangent plane that counts as one, in multiples of what the slope explains over the
    /// reach of the kernel; > 0; 0.5.
    pub depth: f32,
    /// The other part, as a share of depth; > 0; 0.05.
    pub plane: f32,
}

impl Default for Sigmas {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Sigmas {
    /// The defaults above.
    pub const DEFAULT: Self = Self {
        normal: 128.0,
        depth: 0.5,
        plane: 0.05,
    };

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        finite_from_0("sigma_normal", self.normal)?;
        in_range("sigma_depth", self.depth, "a number above 0", |v| v > 0.0)?;
        in_range("sigma_plane", self.plane, "a share above 0", |v| v > 0.0)
    }
}

/// What guides where normals and ids are incoherent.
#[derive(Clone, Copy)]
pub struct Coarse<'a> {
    /// The tiles in which that is so.
    pub tiles: &'a Tiles,
    /// The ids that stand in for the frame's there, if it has any.
    pub ids: Option<Pixels<'a, u32>>,
}

/// A frame's guide buffers, padded and free of NaN and infinity.
pub struct Guide {
    pub(crate) layout: Layout,
    /// One number per surface class; the same everywhere if neither depth nor ids are known.
    class: Bordered<u32>,
    normal: Option<Bordered>,
    /// How much normals change from pixel to pixel, if there are any.
    roughness: Option<Bordered>,
    /// 1/Z and its slopes along x and y; 0 where there is no surface.
    depth: Option<Bordered>,
}

impl Guide {
    /// For taps up to `reach` pixels to the side.
    pub fn new(size: Size, reach: usize, surface: Surface, coarse: Option<Coarse>) -> Self {
        let Surface {
            depth, normal, ids, ..
        } = surface;
        let layout = Layout::new(size, reach);
        let mut guide = Self {
            layout,
            class: Bordered::new(layout, [0]),
            normal: normal.map(|_| Bordered::new(layout, [0.0; 3])),
            roughness: None,
            depth: depth.map(|_| Bordered::new(layout, [0.0; 3])),
        };
        let normals = guide.normal.as_mut().map(Bordered::bands);
        let depths = guide.depth.as_mut().map(Bordered::bands);
        let outs = (guide.class.bands())
            .zip(rows::optional(normals))
            .zip(rows::optional(depths))
            .map(|((class, normal), depth)| Outs {
                class,
                normal,
                depth,
            });
        let kernel = Fill {
            depth,
            normal,
            ids,
            coarse,
        };
        rows::run(&kernel, size.height, outs);
        if let Some(normal) = &guide.normal {
            let [class] = guide.class.planes();
            let kernel = Roughness {
                layout,
                class,
                normal: normal.planes(),
            };
            let mut roughness = Bordered::new(layout, [0.0]);
            rows::run(&kernel, size.height, roughness.bands());
            guide.roughness = Some(roughness);
        }
        guide
    }

    /// The guide as kernels read it, with how strictly it is compared by a kernel that reaches so many pixels to the side.
    pub(crate) fn compare(&self, sigmas: &Sigmas, reach: usize) -> Comparison<'_> {
        let [class] = self.class.planes();
        Comparison {
            layout: self.layout,
            top: 0,
            len: class.len(),
            class,
            normal: self
                .normal
                .as_ref()
                .zip(self.roughness.as_ref())
                .map(|(normal, roughness)| {
                    let ([x, y, z], [roughness]) = (normal.planes(), roughness.planes());
                    [x, y, z, roughness]
                }),
            sigma_normal: sigmas.normal,
            depth: self.depth.as_ref().map(Bordered::planes),
            // Infinity times a slope of 0 would be NaN.
            sigma_plane: sigmas.plane.min(f32::MAX),
            sigma_slope: (sigmas.depth * reach as f32).min(f32::MAX),
        }
    }
}

/// Borrowed planes of a guide.
#[derive(Clone, Copy)]
pub(crate) struct Comparison<'a> {
    layout: Layout,
    /// First row, and numbers in a plane.
    top: usize,
    len: usize,
    class: &'a [u32],
    /// Normals, and their roughness.
    normal: Option<[&'a [f32]; 4]>,
    sigma_normal: f32,
    depth: Option<[&'a [f32]; 3]>,
    sigma_plane: f32,
    sigma_slope: f32,
}

/// What taps are compared with, for one register of centre pixels.
#[derive(Clone, Copy)]
pub(crate) struct Center<S: Simd> {
    pub at: usize,
    class: Classes<S>,
    normal: [Lanes<S>; 3],
    /// −log₂e·κ/2 over 1 + κ times the roughness.
    normal_scale: Lanes<S>,
    /// 1/Z and its slopes: the tangent plane.
    plane: [Lanes<S>; 3],
    /// −log₂e over the distance from it that counts as one.
    plane_scale: Lanes<S>,
}

impl Comparison<'_> {
    /// Row y alone, so that all taps in it share one bounds check.
    #[inline(always)]
    pub fn row(&self, y: usize) -> Self {
        let cut = |plane| self.layout.cut(plane, y);
        Self {
            top: y,
            len: self.layout.stride(),
            class: self.layout.cut(self.class, y),
            normal: self.normal.map(|planes| planes.map(cut)),
            depth: self.depth.map(|planes| planes.map(cut)),
            ..*self
        }
    }

    /// One register of centre pixels, from (x, y) on.
    #[inline(always)]
    pub fn center<S: Simd>(&self, simd: S, x: usize, y: usize) -> Center<S> {
        let at = self.layout.at(x, y - self.top);
        let mut center = Center {
            at,
            class: Classes::load(simd, &self.class[..self.len], at),
            normal: [Lanes::splat(simd, 0.0); 3],
            normal_scale: Lanes::splat(simd, 0.0),
            plane: [Lanes::splat(simd, 0.0); 3],
            plane_scale: Lanes::splat(simd, 0.0),
        };
        if let Some(planes) = self.normal {
            let planes = planes.map(|plane| &plane[..self.len]);
            let [x, y, z, roughness] = Lanes::load_all(simd, planes, at);
            center.normal = [x, y, z];
            let sharpness = Lanes::splat(simd, -LOG2_E * 0.5 * self.sigma_normal);
            center.normal_scale = sharpness / (roughness * self.sigma_normal + 1.0);
        }
        if let Some(planes) = self.depth {
            let planes = planes.map(|plane| &plane[..self.len]);
            let [w, across, along] = Lanes::load_all(simd, planes, at);
            let slope = across.abs() + along.abs();
            // The last term avoids 0/0 on the background.
            let unit = w * self.sigma_plane + slope * self.sigma_slope + 1e-30;
            center.plane = [w, across, along];
            center.plane_scale = Lanes::splat(simd, -LOG2_E) / unit;
        }
        center
    }

    /// log₂ of the weights of some taps: `own`, the kernel's part, less the differences of normal and depth; −∞ between
    /// classes. Each operation runs over all taps before the next one, to hide latency, as in [`crate::math::exp2_weights`].
    #[inline(always)]
    pub fn exponents<S: Simd, const N: usize>(
        &self,
        simd: S,
        center: &Center<S>,
        taps: &Taps<N>,
        own: [f32; N],
    ) -> [Lanes<S>; N] {
        let mut exponents = [Lanes::splat(simd, 0.0); N];
        for k in 0..N {
            exponents[k] = Lanes::splat(simd, own[k]);
        }
        if let Some([nx, ny, nz, _]) = self.normal {
            let x = Lanes::load_taps(simd, &nx[..self.len], center.at, taps);
            let y = Lanes::load_taps(simd, &ny[..self.len], center.at, taps);
            let z = Lanes::load_taps(simd, &nz[..self.len], center.at, taps);
            let [hx, hy, hz] = center.normal;
            let mut difference = x;
            for k in 0..N {
                difference[k] = (hx - x[k]) * (hx - x[k]);
            }
            for k in 0..N {
                difference[k] = (hy - y[k]).mul_add(hy - y[k], difference[k]);
            }
            for k in 0..N {
                difference[k] = (hz - z[k]).mul_add(hz - z[k], difference[k]);
            }
            for k in 0..N {
                exponents[k] = difference[k].mul_add(center.normal_scale, exponents[k]);
            }
        }
        if let Some([depth, ..]) = self.depth {
            let there = Lanes::load_taps(simd, &depth[..self.len], center.at, taps);
            let [w, across, along] = center.plane;
            let row = w + along * taps.down;
            let mut difference = there;
            for k in 0..N {
                difference[k] = across.mul_add(Lanes::splat(simd, taps.right[k]), row) - there[k];
            }
            for k in 0..N {
                exponents[k] = difference[k]
                    .abs()
                    .mul_add(center.plane_scale, exponents[k]);
            }
        }
        let classes = Classes::load_taps(simd, &self.class[..self.len], center.at, taps);
        for k in 0..N {
            let same = center.class.equal(classes[k]);
            exponents[k] = exponents[k].when_or(same, f32::NEG_INFINITY);
        }
        exponents
    }
}

struct Fill<'a> {
    depth: Option<Pixels<'a>>,
    normal: Option<Pixels<'a>>,
    ids: Option<Pixels<'a, u32>>,
    coarse: Option<Coarse<'a>>,
}

/// A band of each image of a guide.
struct Outs<'a> {
    class: BorderedBand<'a, u32>,
    normal: Option<BorderedBand<'a>>,
    depth: Option<BorderedBand<'a>>,
}

impl<'a> Kernel for Fill<'a> {
    type Out = Outs<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Outs<'a>) {
        let mut inverse = Inverse::new(self.depth.map_or(0, |depth| depth.size.width));
        for y in rows {
            let depth = self.depth.map(|depth| depth.row(y));
            let class = out.class.row(0, y);
            let run = Run::row(y, class.len());
            let parts = || {
                (self.coarse.into_iter())
                    .flat_map(|coarse| coarse.tiles.runs(run))
                    .map(|run| run.x..run.x + run.len)
            };
            classes(depth, self.ids.map(|ids| ids.row(y)), class);
            if let Some(ids) = self.coarse.and_then(|coarse| coarse.ids) {
                for part in parts() {
                    let depth = depth.map(|depth| &depth[part.clone()]);
                    classes(depth, Some(&ids.row(y)[part.clone()]), &mut class[part]);
                }
            }
            if let Some((normal, out)) = self.normal.zip(out.normal.as_mut()) {
                let mut out = out.rows(y);
                normal.read(run, out.each_mut().map(|row| &mut **row));
                normals(depth.map(|_| &*class), out.each_mut().map(|row| &mut **row));
                for part in parts() {
                    for row in &mut out {
                        row[part.clone()].fill(0.0);
                    }
                }
            }
            if let Some((image, out)) = self.depth.zip(out.depth.as_mut()) {
                let row = |y: usize| (y < image.size.height).then(|| image.row(y));
                inverse.fill([row(y.wrapping_sub(1)), row(y), row(y + 1)]);
                inverse.tangents(out.rows(y));
            }
        }
    }
}

/// Writes a row's classes; all the same if neither depth nor ids are known.
#[inline(always)]
fn classes(depth: Option<&[f32]>, ids: Option<&[u32]>, class: &mut [u32]) {
    match ids {
        Some(ids) => {
            for (class, &id) in class.iter_mut().zip(ids) {
                *class = id.wrapping_add(1);
            }
        }
        None => class.fill(1),
    }
    if let Some(depth) = depth {
        for (class, &z) in class.iter_mut().zip(depth) {
            // 0 is the background. The id 2³² − 1 would wrap around to it and is merged with id 0 instead.
            *class = if is_surface(z) { (*class).max(1) } else { 0 };
        }
    }
}

struct Roughness<'a> {
    layout: Layout,
    class: &'a [u32],
    normal: [&'a [f32]; 3],
}

impl<'a> Kernel for Roughness<'a> {
    type Out = BorderedBand<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BorderedBand<'a>) {
        let Size { width, height } = self.layout.size;
        let part = |x: isize, y: usize| {
            let start = self.layout.at(0, y).wrapping_add_signed(x);
            let class = &self.class[start..][..width];
            (class, self.normal.map(|plane| &plane[start..][..width]))
        };
        for y in rows {
            let (own, out) = (part(0, y), out.row(0, y));
            out.fill(0.0);
            add_roughness(part(-1, y), own, part(1, y), out);
            if y > 0 && y + 1 < height {
                add_roughness(part(0, y - 1), own, part(0, y + 1), out);
            }
        }
    }
}

/// Part of a row: classes and normals.
type Part<'a> = (&'a [u32], [&'a [f32]; 3]);

/// Adds the roughness along one axis: half the square of the smaller difference to the pixels before and after, or of the
/// bend between them if that is less, so that neither edges nor curvature count. Of independent noise, the bend has three
/// times the square of a difference.
#[inline(always)]
fn add_roughness<'a>(before: Part<'a>, own: Part<'a>, after: Part<'a>, out: &mut [f32]) {
    let len = out.len();
    let [(ca, na), (c, n), (cb, nb)] =
        [before, own, after].map(|(class, normal)| (&class[..len], normal.map(|row| &row[..len])));
    for x in 0..len {
        let [mut left, mut right, mut bend] = [0.0; 3];
        for axis in 0..3 {
            let (l, r) = (na[axis][x] - n[axis][x], nb[axis][x] - n[axis][x]);
            left += l * l;
            right += r * r;
            bend += (l + r) * (l + r);
        }
        let least = smaller(smaller(left, right), bend * (1.0 / 3.0));
        let same = (ca[x] == c[x]) & (cb[x] == c[x]);
        out[x] += if same { 0.5 * least } else { 0.0 };
    }
}

/// Zeroes normals that are not finite, and those of the background.
#[inline(always)]
fn normals(class: Option<&[u32]>, [nx, ny, nz]: [&mut [f32]; 3]) {
    let len = nx.len();
    let (nx, ny, nz) = (&mut nx[..len], &mut ny[..len], &mut nz[..len]);
    for x in 0..len {
        let kept = is_present([nx[x], ny[x], nz[x]]);
        let keep = |n: f32| if kept { n } else { 0.0 };
        (nx[x], ny[x], nz[x]) = (keep(nx[x]), keep(ny[x]), keep(nz[x]));
    }
    if let Some(class) = class {
        for (x, &class) in class.iter().enumerate() {
            let keep = |n: f32| if class != 0 { n } else { 0.0 };
            (nx[x], ny[x], nz[x]) = (keep(nx[x]), keep(ny[x]), keep(nz[x]));
        }
    }
}

/// 1/Z of a row and of those beside it; NaN where no surface is, outside of the image too.
struct Inverse([Vec<f32>; 3]);

impl Inverse {
    #[inline(always)]
    fn new(width: usize) -> Self {
        Self(std::array::from_fn(|_| vec![f32::NAN; width + 2]))
    }

    /// From the depths of the row above, the row, and the row below.
    #[inline(always)]
    fn fill(&mut self, depths: [Option<&[f32]>; 3]) {
        for (inverse, depths) in self.0.iter_mut().zip(depths) {
            match depths {
                Some(depths) => {
                    for (inverse, &z) in inverse[1..].iter_mut().zip(depths) {
                        *inverse = if is_surface(z) { 1.0 / z } else { f32::NAN };
                    }
                }
                None => inverse.fill(f32::NAN),
            }
        }
    }

    /// Writes 1/Z, 0 where no surface is, and its slopes.
    #[inline(always)]
    fn tangents(&self, [ow, ox, oy]: [&mut [f32]; 3]) {
        let len = ow.len();
        let (ox, oy) = (&mut ox[..len], &mut oy[..len]);
        let [above, here, below] = self.0.each_ref().map(|row| &row[..len + 2]);
        for x in 0..len {
            let w = here[x + 1];
            ow[x] = if w.is_nan() { 0.0 } else { w };
            ox[x] = slope(w, here[x], here[x + 2]);
            oy[x] = slope(w, above[x + 1], below[x + 1]);
        }
    }
}

/// The slope of 1/Z: the smaller one-sided difference to a neighbour that is a surface; 0 if neither is.
#[inline(always)]
fn slope(own: f32, before: f32, after: f32) -> f32 {
    let difference = |from: f32, to: f32| {
        let apart = from.is_nan() | to.is_nan();
        if apart { f32::INFINITY } else { to - from }
    };
    let (behind, ahead) = (difference(before, own), difference(own, after));
    let smaller = if behind.abs() < ahead.abs() {
        behind
    } else {
        ahead
    };
    if smaller.abs() < f32::INFINITY {
        smaller
    } else {
        0.0
    }
}
