//! Where a frame's guides change from pixel to pixel: leaves, grass and hair that are thinner than a pixel.
//!
//! Every pixel there shows another surface than its neighbours, and the next frame's pixel yet another one. A filter that
//! normals and ids keep on one surface finds no samples to average, and leaves the noise; what depth tells still holds.
//!
//! In tiles of 16×16 pixels, neighbours along x and y are compared as history is ([`validate`](crate::kernels::fetch::validate)):
//! a pair differs if its ids do, or if its normals are farther apart than an angle. A tile is incoherent if more than a
//! share of its pairs differ. On 26 sequences, pairs differ by a half to nine tenths in grass and thickets, and by less than
//! four tenths everywhere else, out of focus apart. Small tiles are fooled by the corners of small objects.
//!
//! Inputs: normal (3), ids (1), each optional. Output: a mask of tiles. Normals of zero or NaN differ from none.

use std::ops::Range;

use crate::error::{Result, in_range};
use crate::image::{Pixels, Run, Size};
use crate::rows::{self, Kernel, Simd};
use crate::tiles::Tiles;

/// When a tile counts as incoherent.
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Normals farther apart differ, in degrees; 0 to 180; 25.
    pub angle: f32,
    /// The largest share of pairs that may differ, 0 to 1; 0.4.
    pub share: f32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            angle: 25.0,
            share: 0.4,
        }
    }
}

impl Params {
    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        in_range("angle", self.angle, "degrees from 0 to 180", |v| {
            (0.0..=180.0).contains(&v)
        })?;
        in_range("share", self.share, "a share from 0 to 1", |v| {
            (0.0..=1.0).contains(&v)
        })
    }
}

/// The tiles whose guides are incoherent.
pub fn incoherent(
    size: Size,
    normal: Option<Pixels>,
    ids: Option<Pixels<u32>>,
    params: Params,
) -> Tiles {
    let mut tiles = Tiles::new(size);
    let kernel = Count {
        size,
        normal,
        ids,
        cosine: f64::from(params.angle).to_radians().cos() as f32,
        share: params.share,
    };
    rows::run(&kernel, size.height, tiles.bands());
    tiles
}

struct Count<'a> {
    size: Size,
    normal: Option<Pixels<'a>>,
    ids: Option<Pixels<'a, u32>>,
    /// Of the largest angle between like normals.
    cosine: f32,
    share: f32,
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
        let mut differ = vec![0; width];
        let mut unlike = vec![0; tiles.len()];
        for y in rows.clone() {
            std::mem::swap(&mut above, &mut row);
            self.read(y, &mut row);
            self.compare(row.part(0..width - 1), row.part(1..width), &mut differ);
            for (unlike, tile) in unlike.iter_mut().zip(differ.chunks(Tiles::SIDE)) {
                // A tile's last pixel has no neighbour in it.
                *unlike += count(&tile[..tile.len() - 1]);
            }
            if y > rows.start {
                self.compare(above.part(0..width), row.part(0..width), &mut differ);
                for (unlike, tile) in unlike.iter_mut().zip(differ.chunks(Tiles::SIDE)) {
                    *unlike += count(tile);
                }
            }
        }
        for (i, (tile, unlike)) in tiles.iter_mut().zip(unlike).enumerate() {
            let across = Tiles::SIDE.min(width - i * Tiles::SIDE);
            let pairs = height * (across - 1) + (height - 1) * across;
            *tile = unlike as f32 > self.share * pairs as f32;
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
                *differs |= u8::from(dot(a, b) < self.cosine * lengths);
            }
        }
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
