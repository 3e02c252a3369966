//! Where a frame's normals and ids tell no surfaces apart: grass, fur and wire that are thinner than a pixel.
//!
//! Every pixel there shows another surface than its neighbours, and yet another one in the next frame. A filter that is kept
//! on one surface finds no samples to average, history is rejected, and the noise stays. What depth tells still holds.
//!
//! This is decided in tiles of 16×16 pixels, by two signs that must agree:
//! - **in space**: of the pairs of neighbours along x and y, more than two fifths differ, in id or by more than 25° in normal,
//!   as history is tested ([`validate`](crate::kernels::fetch::validate));
//! - **in time**: the mean confidence in history is between a tenth and a half. Pebbles and leaves of a few pixels differ as
//!   much from their neighbours, but are found again, and normals then tell how they are shaded. Where nothing is found
//!   again, at a cut or behind what moves away, that says nothing of the guides.
//!
//! Inputs: normal (3), ids (1), confidence (1), each optional. Output: a mask of tiles. Normals of zero or NaN differ from
//! none.
//!
//! Coarse ids then stand in for the frame's: all that they tell apart are surfaces whose light is divided by their albedo from
//! those whose light is not ([`reflectance`](crate::kernels::smooth::reflectance)), whose numbers have another meaning. 0, the
//! id of what is no surface, stays.
//!
//! Of frames without normals and ids, [`is_thin`] and [`is_erratic`] tell for the whole frame whether there is such geometry,
//! by depth and by motion.

use std::ops::Range;

use crate::image::{BandMut, Image, Pixels, Run, Size, View};
use crate::math::{distance, dot, smaller};
use crate::pairs;
use crate::rows::{self, Kernel, Simd};
use crate::tiles::Tiles;

/// The share of pairs of neighbours that differ, and the mean confidence in history, of incoherent tiles.
const DIFFERING: f32 = 0.4;
const FOUND: Range<f32> = 0.1..0.5;
/// The cosine of 25°: normals farther apart differ.
const COSINE: f32 = 0.906_307_8;

/// The share of pairs of neighbours whose depth differs, and by how much of it, of thin geometry. Of frames of 128×96 pixels,
/// `thicket` and `grass` have 0.27 and 0.32, and none of 24 other sequences more than 0.06.
const THIN: f32 = 0.125;
const STEP: f32 = 0.1;
/// The same of motion, in pixels: `thicket`, `grass` and `fur` have 0.26, 0.27 and 0.20, others up to 0.11 (`carousel`).
const LEAP: f32 = 0.5;

/// The ids of surfaces whose light is divided, and of those whose light is not. Few frames use ids as large.
const DIVIDED: u32 = u32::MAX - 1;
const WHOLE: u32 = u32::MAX - 2;

/// The tiles whose guides are incoherent.
pub fn incoherent(
    size: Size,
    normal: Option<Pixels>,
    ids: Option<Pixels<u32>>,
    confidence: Option<Pixels>,
) -> Tiles {
    let mut tiles = Tiles::new(size);
    if normal.is_none() && ids.is_none() {
        return tiles;
    }
    let kernel = Count {
        size,
        normal,
        ids,
        confidence,
    };
    rows::run(&kernel, size.height, tiles.bands());
    tiles
}

struct Count<'a> {
    size: Size,
    normal: Option<Pixels<'a>>,
    ids: Option<Pixels<'a, u32>>,
    confidence: Option<Pixels<'a>>,
}

/// Guides of a row.
struct Row<'a> {
    normal: Option<[Vec<f32>; 3]>,
    ids: Option<&'a [u32]>,
}

/// Guides of a part of a row.
struct Part<'a> {
    normal: Option<[&'a [f32]; 3]>,
    ids: Option<&'a [u32]>,
}

impl Row<'_> {
    #[inline(always)]
    fn part(&self, columns: Range<usize>) -> Part<'_> {
        let normal = self.normal.as_ref();
        Part {
            normal: normal.map(|normal| normal.each_ref().map(|row| &row[columns.clone()])),
            ids: self.ids.map(|ids| &ids[columns]),
        }
    }
}

impl<'a> Kernel for Count<'a> {
    type Out = &'a mut [bool];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, tiles: &'a mut [bool]) {
        let (width, height) = (self.size.width, rows.len());
        let [mut above, mut row] = [(); 2].map(|()| self.row());
        let mut differ = vec![0u8; width];
        let (mut unlike, mut found) = (vec![0; tiles.len()], vec![0.0; tiles.len()]);
        for y in rows.clone() {
            std::mem::swap(&mut above, &mut row);
            self.read(y, &mut row);
            self.compare(row.part(0..width - 1), row.part(1..width), &mut differ);
            for (unlike, tile) in unlike.iter_mut().zip(differ.chunks(Tiles::SIDE)) {
                // A tile's last pixel has no neighbour in it.
                *unlike += count(&tile[..tile.len() - 1]);
            }
            if let Some(confidence) = self.confidence {
                let confidence = confidence.row(y).chunks(Tiles::SIDE);
                for (found, tile) in found.iter_mut().zip(confidence) {
                    *found += tile.iter().sum::<f32>();
                }
            }
            if y > rows.start {
                self.compare(above.part(0..width), row.part(0..width), &mut differ);
                for (unlike, tile) in unlike.iter_mut().zip(differ.chunks(Tiles::SIDE)) {
                    *unlike += count(tile);
                }
            }
        }
        for (i, (tile, (unlike, found))) in
            tiles.iter_mut().zip(unlike.iter().zip(found)).enumerate()
        {
            let across = Tiles::SIDE.min(width - i * Tiles::SIDE);
            let pairs = height * (across - 1) + (height - 1) * across;
            let found = found / (height * across) as f32;
            let lost = self.confidence.is_none() || FOUND.contains(&found);
            *tile = lost && *unlike as f32 > DIFFERING * pairs as f32;
        }
    }
}

fn count(differ: &[u8]) -> u32 {
    differ.iter().map(|&differs| u32::from(differs)).sum()
}

impl<'a> Count<'a> {
    fn row(&self) -> Row<'a> {
        let zeros = || [(); 3].map(|()| vec![0.0; self.size.width]);
        Row {
            normal: self.normal.map(|_| zeros()),
            ids: None,
        }
    }

    #[inline(always)]
    fn read(&self, y: usize, row: &mut Row<'a>) {
        if let Some((normal, rows)) = self.normal.zip(row.normal.as_mut()) {
            let run = Run::row(y, self.size.width);
            normal.read(run, rows.each_mut().map(Vec::as_mut_slice));
        }
        row.ids = self.ids.map(|ids| ids.row(y));
    }

    /// Writes 1 for pairs that differ and 0 for others.
    #[inline(always)]
    fn compare(&self, one: Part, other: Part, differ: &mut [u8]) {
        differ.fill(0);
        if let Some((one, other)) = one.ids.zip(other.ids) {
            for ((a, b), differs) in one.iter().zip(other).zip(&mut *differ) {
                *differs = u8::from(a != b);
            }
        }
        if let Some(([ax, ay, az], [bx, by, bz])) = one.normal.zip(other.normal) {
            let len = ax.len();
            let [ay, az, bx, by, bz] = [ay, az, bx, by, bz].map(|row| &row[..len]);
            for (x, differs) in differ[..len].iter_mut().enumerate() {
                let [a, b] = [[ax[x], ay[x], az[x]], [bx[x], by[x], bz[x]]];
                let lengths = (dot(a, a) * dot(b, b)).sqrt();
                *differs |= u8::from(dot(a, b) < COSINE * lengths);
            }
        }
    }
}

/// Whether depth shows geometry that is thinner than a pixel: more than [`THIN`] of the pairs of neighbours differ by more than
/// [`STEP`] of the nearer one's depth.
pub fn is_thin(depth: Pixels) -> bool {
    differ(depth.size, |a, b| {
        let [a, b] = [a, b].map(|pixel| depth.at(pixel, 0));
        (a - b).abs() > STEP * smaller(a, b)
    })
}

/// Whether motion shows it: more than [`THIN`] of the pairs of neighbours differ by more than [`LEAP`].
pub fn is_erratic(motion: Pixels) -> bool {
    let at = |pixel| [0, 1].map(|channel| motion.at(pixel, channel));
    differ(motion.size, |a, b| distance(at(a), at(b)) > LEAP)
}

/// Whether more than [`THIN`] of the pairs of neighbours differ.
fn differ(size: Size, pair: impl Fn(usize, usize) -> bool + Sync) -> bool {
    let Size { height, width } = size;
    let all = height * (width - 1) + (height - 1) * width;
    pairs::count(size, pair) as f32 > THIN * all as f32
}

/// Replacement ids for incoherent tiles: demodulated surfaces, other surfaces, background. Without a mask all surfaces count as
/// demodulated.
pub fn coarse_ids(ids: Pixels<u32>, reflects: Option<View<u8>>) -> Image<u32> {
    let mut coarse = Image::blank(ids.size, 1);
    rows::run(&Coarsen { ids, reflects }, ids.size.height, coarse.bands());
    coarse
}

struct Coarsen<'a> {
    ids: Pixels<'a, u32>,
    reflects: Option<View<'a, u8>>,
}

impl<'a> Kernel for Coarsen<'a> {
    type Out = BandMut<'a, u32>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut coarse: Self::Out) {
        for y in rows {
            let row = coarse.row(0, y);
            row.fill(DIVIDED);
            if let Some(reflects) = self.reflects {
                for (coarse, &reflects) in row.iter_mut().zip(reflects.row(0, y)) {
                    *coarse = if reflects == 0 { WHOLE } else { DIVIDED };
                }
            }
            for (coarse, &id) in row.iter_mut().zip(self.ids.row(y)) {
                *coarse = if id == 0 { 0 } else { *coarse };
            }
        }
    }
}
