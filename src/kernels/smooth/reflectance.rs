//! Which surfaces have an albedo that is a reflectance, so that their texture can be divided out
//! ([`demodulate`](super::demodulate)).
//!
//! A surface, all pixels of one id, counts as one whose albedo is a reflectance if some channel of some pixel is at least
//! 1/1000, and no more than one in 64 of its pixels has a largest channel above 5/4, or above 0 and below 10⁻⁵. Under the
//! name of albedo, renderers store other things as well. The value of a BSDF at one pair of directions, which Mitsuba's
//! integrator `aov` writes for rough metal, follows a highlight: from below a millionth to tens, from one pixel to the next.
//! Light that is divided by it changes as much. Glass, mirrors, lamps and sky have 0. No reflectance is above 1, but the
//! reconstruction filters of renderers overshoot, by a tenth or so; and nothing that is used for a material reflects less than
//! a thousandth everywhere. The darkest value of an 8-bit texture that is not 0 is 1/3295. Single pixels outside of that, at a
//! seam or by a sample gone wrong, do not count: highlights of rough metals cover a 25th of their surface and more, and beside
//! weak ones, two fifths are fainter than 10⁻⁵.
//!
//! The surface decides, not the pixel: a highlight's slopes pass through all values that reflectances have,
//! and a decision that changes within a surface would divide the light of neighbours by different numbers.
//!
//! Where no ids are known, regions stand in for surfaces ([`regions`](super::regions)), in frames in which more than one pixel
//! in 1024 has such a value; in others, nothing is known. Without normals or depth, regions run across the edges of surfaces,
//! and the albedo of such a frame is no reflectance anywhere.
//!
//! Inputs: albedo (3); ids (1), or normal (3) and depth (1). Values that are not finite count as 0.

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use super::regions::regions;
use crate::image::{BandMut, Image, Pixels, SEGMENT, View, segments};
use crate::kernels::fetch::validate::Surface;
use crate::lanes::LANES;
use crate::math::larger;
use crate::rows::{self, Kernel, Simd};

/// A surface with a reflectance has one of at least this somewhere.
const LEAST: f32 = 1e-3;
/// Larger values are no reflectance.
const MOST: f32 = 1.25;
/// Nor are values between 0 and this.
const FAINT: f32 = 1e-5;
/// A surface still has a reflectance if at most one in so many of its pixels has a value that is none.
const RARE: usize = 64;
/// A frame without ids has other values if more than one in so many of its pixels does.
const RARE_ANYWHERE: usize = 1024;

/// What decides for a surface.
#[derive(Clone, Copy, Default)]
struct Kind {
    /// The largest value.
    most: f32,
    /// Pixels with a value that is no reflectance.
    others: usize,
    pixels: usize,
}

impl Kind {
    fn add(&mut self, other: Self) {
        self.most = larger(self.most, other.most);
        self.others += other.others;
        self.pixels += other.pixels;
    }

    fn reflects(&self) -> bool {
        self.most >= LEAST && RARE * self.others <= self.pixels
    }
}

/// The surfaces of a frame, and whether their albedo is a reflectance.
pub struct Surfaces {
    /// By id.
    reflecting: HashMap<u32, bool>,
    /// 1 where the pixel's surface is one of them, 0 elsewhere.
    mask: Image<u8>,
    /// Whether the renderer's ids told them apart.
    pub by_ids: bool,
}

impl Surfaces {
    /// The surfaces of a frame. Without ids, only if its albedo has values that are no reflectance.
    pub fn of(albedo: Pixels, surface: &Surface) -> Option<Self> {
        match surface.ids {
            Some(ids) => Some(Self::new(albedo, ids)),
            None => Self::without_ids(albedo, surface),
        }
    }

    /// The surfaces that ids tell apart.
    pub fn new(albedo: Pixels, ids: Pixels<u32>) -> Self {
        let reflecting = (kinds(albedo, ids).into_iter())
            .map(|(id, kind)| (id, kind.reflects()))
            .collect();
        Self::marked(ids, reflecting)
    }

    fn without_ids(albedo: Pixels, surface: &Surface) -> Option<Self> {
        let whole = Image::new(albedo.size, 1);
        let all = kinds(albedo, whole.pixels())[&0];
        if RARE_ANYWHERE * all.others <= all.pixels {
            return None;
        }
        Some(match surface.normal.zip(surface.depth) {
            Some((normal, depth)) => Self {
                reflecting: HashMap::new(),
                by_ids: false,
                ..Self::new(albedo, regions(normal, depth).pixels())
            },
            None => Self {
                by_ids: false,
                ..Self::marked(whole.pixels(), [(0, false)].into())
            },
        })
    }

    fn marked(ids: Pixels<u32>, reflecting: HashMap<u32, bool>) -> Self {
        let mut mask = Image::blank(ids.size, 1);
        let kernel = Mark {
            ids,
            reflecting: &reflecting,
        };
        rows::run(&kernel, ids.size.height, mask.bands());
        Self {
            reflecting,
            mask,
            by_ids: true,
        }
    }

    /// 1 at pixels whose albedo is a reflectance, 0 at the others.
    pub fn mask(&self) -> View<'_, u8> {
        self.mask.view()
    }

    /// The ids of surfaces that are in both frames, but with a reflectance in only one.
    pub fn changed(&self, before: &Self) -> HashSet<u32> {
        let differs =
            |(id, now): &(&u32, &bool)| before.reflecting.get(id).is_some_and(|then| then != *now);
        (self.reflecting.iter())
            .filter(differs)
            .map(|(&id, _)| id)
            .collect()
    }

    /// An id that no surface has.
    pub fn unused(&self) -> u32 {
        let free = |id: &u32| !self.reflecting.contains_key(id);
        (0..=u32::MAX)
            .find(free)
            .expect("an image has fewer pixels")
    }
}

/// What decides for each surface.
fn kinds(albedo: Pixels, ids: Pixels<u32>) -> HashMap<u32, Kind> {
    let height = albedo.size.height;
    let mut kinds: Vec<HashMap<u32, Kind>> = vec![];
    kinds.resize_with(rows::bands(height).count(), HashMap::new);
    rows::run(&Kinds { albedo, ids }, height, kinds.iter_mut());
    let mut all = HashMap::<u32, Kind>::new();
    for (id, kind) in kinds.into_iter().flatten() {
        all.entry(id).or_default().add(kind);
    }
    all
}

/// What decides for each surface in a band.
struct Kinds<'a> {
    albedo: Pixels<'a>,
    ids: Pixels<'a, u32>,
}

impl<'a> Kernel for Kinds<'a> {
    type Out = &'a mut HashMap<u32, Kind>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, kinds: Self::Out) {
        let (mut albedo, mut ids) = ([[0.0; SEGMENT]; 3], [0; SEGMENT]);
        let mut largest = [0.0; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.albedo.size.width)) {
            self.albedo.read_rows(run, &mut albedo);
            let ids = &mut ids[..run.len];
            self.ids.load(run, 0, ids);
            for (x, largest) in largest.iter_mut().enumerate() {
                let finite = albedo
                    .each_ref()
                    .map(|row| if row[x].is_finite() { row[x] } else { 0.0 });
                *largest = larger(larger(finite[0], finite[1]), larger(finite[2], 0.0));
            }
            let mut x = 0;
            for same in ids.chunk_by(|a, b| a == b) {
                let values = &largest[x..][..same.len()];
                kinds.entry(same[0]).or_default().add(Kind {
                    most: largest_of(values),
                    others: (values.iter())
                        .map(|&value| u32::from((value > MOST) | ((value > 0.0) & (value < FAINT))))
                        .sum::<u32>() as usize,
                    pixels: same.len(),
                });
                x += same.len();
            }
        }
    }
}

/// The largest of some numbers from 0. Lane by lane, as the compiler does not reorder comparisons by itself.
#[inline(always)]
fn largest_of(values: &[f32]) -> f32 {
    let mut most = [0.0; LANES];
    let (whole, rest) = values.as_chunks::<LANES>();
    for part in whole {
        for (most, &value) in most.iter_mut().zip(part) {
            *most = larger(value, *most);
        }
    }
    most.iter().chain(rest).copied().fold(0.0, larger)
}

struct Mark<'a> {
    ids: Pixels<'a, u32>,
    reflecting: &'a HashMap<u32, bool>,
}

impl<'a> Kernel for Mark<'a> {
    type Out = BandMut<'a, u8>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut mask: Self::Out) {
        let mut ids = [0; SEGMENT];
        for y in rows {
            let mask = mask.row(0, y);
            for run in segments(y, mask.len()) {
                let ids = &mut ids[..run.len];
                self.ids.load(run, 0, ids);
                let mut x = run.x;
                for same in ids.chunk_by(|a, b| a == b) {
                    mask[x..][..same.len()].fill(u8::from(self.reflecting[&same[0]]));
                    x += same.len();
                }
            }
        }
    }
}
