//! Regions: pixels that are connected, which stand in for surfaces where no ids are known.
//!
//! Neighbours in a row or a column are connected if their normals differ by less than the angle whose cosine is 0.9, and their
//! depths by less than a fiftieth of the smaller one, or not at all. A region is all that is connected through others: two-pass
//! labelling, whose labels are joined in a forest of disjoint sets (R. E. Tarjan, "Efficiency of a good but not linear set union
//! algorithm", JACM 1975).
//!
//! Inputs: normal (3), depth (1). A value that is NaN connects with nothing. Output: the first pixel of the region, as an id (1).

use std::ops::Range;

use crate::image::{BandMut, Image, Pixels};
use crate::rows::{self, Kernel, Simd};

/// The square of the difference of two normals at the angle whose cosine is 0.9.
const TURNED: f32 = 0.2;
/// Depths that differ by more than this share belong to different surfaces.
const APART: f32 = 0.02;

/// The region of each pixel.
pub fn regions(normal: Pixels, depth: Pixels) -> Image<u32> {
    let size = depth.size;
    let mut joints = Image::<u8>::blank(size, 1);
    rows::run(&Joints { normal, depth }, size.height, joints.bands());
    let mut regions = Image::blank(size, 1);
    let first = regions.data_mut();
    for (pixel, &joint) in joints.plane(0).iter().enumerate() {
        first[pixel] = pixel as u32;
        for (known, back) in [(LEFT, 1), (ABOVE, size.width)] {
            if joint & known != 0 {
                join(first, pixel, pixel - back);
            }
        }
    }
    // The first pixel of a region comes before all others, so that their links are short by now.
    for pixel in 0..first.len() {
        first[pixel] = first[first[pixel] as usize];
    }
    regions
}

/// Lets two sets begin with the same pixel.
fn join(first: &mut [u32], a: usize, b: usize) {
    let (a, b) = (root(first, a), root(first, b));
    first[a.max(b)] = a.min(b) as u32;
}

/// The first pixel of a set. Halves the way there.
fn root(first: &mut [u32], mut pixel: usize) -> usize {
    while first[pixel] as usize != pixel {
        first[pixel] = first[first[pixel] as usize];
        pixel = first[pixel] as usize;
    }
    pixel
}

const LEFT: u8 = 1;
const ABOVE: u8 = 2;

/// Whether a pixel is connected with its left and upper neighbours.
struct Joints<'a> {
    normal: Pixels<'a>,
    depth: Pixels<'a>,
}

/// Whether two pixels have much the same normal.
#[inline(always)]
pub fn faces_alike(normal: Pixels, a: usize, b: usize) -> bool {
    let [a, b] = [a, b].map(|pixel| normal.vector(pixel));
    let [x, y, z] = [0, 1, 2].map(|channel| a[channel] - b[channel]);
    x * x + y * y + z * z < TURNED
}

/// Whether one of two pixels is as far away as the other.
#[inline(always)]
pub fn beside(depth: Pixels, a: usize, b: usize) -> bool {
    let [near, far] = [a, b].map(|pixel| depth.at(pixel, 0));
    (near == far) | ((near - far).abs() < APART * near.min(far))
}

impl Joints<'_> {
    #[inline(always)]
    fn connects(&self, a: usize, b: usize) -> bool {
        faces_alike(self.normal, a, b) & beside(self.depth, a, b)
    }
}

impl<'a> Kernel for Joints<'a> {
    type Out = BandMut<'a, u8>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut joints: Self::Out) {
        let width = self.depth.size.width;
        for y in rows {
            for (x, joint) in joints.row(0, y).iter_mut().enumerate() {
                let pixel = y * width + x;
                let left = x > 0 && self.connects(pixel, pixel - 1);
                let above = y > 0 && self.connects(pixel, pixel - width);
                *joint = u8::from(left) * LEFT + u8::from(above) * ABOVE;
            }
        }
    }
}
