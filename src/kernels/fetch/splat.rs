//! Forward reprojection: the previous frame's pixels, scattered as points to where they appear now.
//!
//! A point is a pixel of the previous frame: a colour at depth z, seen at the pixel's centre plus an offset, with a
//! quality q. Its new position p and depth z' follow from the two cameras (see [`crate::kernels::camera::pinhole::Warp`];
//! for background from their rotation), minus its drift, the object's own motion. It covers the pixels whose centres lie
//! within a square around p. The side of the square is that of the old pixel at the new distance, slightly enlarged where
//! it grows, so that rounding leaves no cracks,
//!   s = 1 + 1.01 max(0, z/z' · √(f'x f'y / fx fy) − 1),
//! and the point has quality q/s⁴ there: it is larger than a pixel, and that much less sharp. The nearest point that
//! covers a pixel, at depth z₀, determines the visible surface; points of the same surface are averaged with weights
//!   w = q/s⁴ · max(0, 1 − (z' − z₀)/(t z₀)),
//! t being the tolerance. All sums run over the points in the order of their source pixels.
//!
//! Points keep their sub-pixel positions and so leave cracks between them as they move. A pixel that no point covers may
//! therefore use points whose squares, enlarged by `reach` on every side and closed, cover it; their quality falls
//! accordingly.
//!
//! A covered pixel other than the one that contains the point gets a copy with offset 0.
//!
//! Inputs: colour (any channels), depth (1), offset (2, in pixels), drift (2 or 3, previous minus current pixels and
//! depth), quality (1), all of the previous frame; both cameras. Outputs: colour, depth, offset and quality of this
//! frame's pixels; in holes NaN, and 0 for quality.

use std::ops::Range;

use glam::DAffine3;

use crate::error::{Result, in_range};
use crate::image::{Pixels, Size};
use crate::kernels::camera::pinhole::{Camera, Warp};
use crate::rows::{self, BAND, Kernel, Simd};

/// What a point covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// t: relative depth difference from which points belong to another surface; above 0; 0.1.
    pub tolerance: f32,
    /// Pixels by which squares are enlarged to fill cracks; 0 to 1; 0.
    pub reach: f32,
}

impl Default for Params {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Params {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self {
        tolerance: 0.1,
        reach: 0.0,
    };

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        in_range("tolerance", self.tolerance, "a share above 0", |v| v > 0.0)?;
        in_range("reach", self.reach, "0 to 1 pixels", |v| {
            (0.0..=1.0).contains(&v)
        })
    }
}

/// The previous frame's points: every pixel with finite values, depth above 0 (+inf for background) and quality above 0.
#[derive(Clone, Copy)]
pub struct Points<'a> {
    /// Any number of channels.
    pub color: Pixels<'a>,
    /// View-space z in the previous camera (1).
    pub depth: Pixels<'a>,
    /// Position relative to the pixel's centre; `None` means 0.
    pub offset: Option<Pixels<'a>>,
    /// Motion beyond that of the cameras; `None` and values that are not finite mean 0.
    pub drift: Option<Pixels<'a>>,
    /// `None` means 1.
    pub quality: Option<Pixels<'a>>,
}

/// Outputs, interleaved.
pub struct Splats<'a> {
    /// As many channels as the points have, side by side; NaN where no point is.
    pub color: &'a mut [f32],
    /// In the current camera.
    pub depth: &'a mut [f32],
    /// From the pixel's centre, x and y side by side.
    pub offset: &'a mut [f32],
    /// 0 where no point is.
    pub quality: &'a mut [f32],
}

impl<'a> Splats<'a> {
    fn bands(self, size: Size, channels: usize) -> impl Iterator<Item = Splats<'a>> {
        let lengths = [
            self.color.len() / channels,
            self.depth.len(),
            self.offset.len() / 2,
            self.quality.len(),
        ];
        assert_eq!(lengths, [size.pixels(); 4], "an output has another size");
        let band = BAND * size.width;
        (self.color.chunks_mut(band * channels))
            .zip(self.depth.chunks_mut(band))
            .zip(self.offset.chunks_mut(band * 2))
            .zip(self.quality.chunks_mut(band))
            .map(|(((color, depth), offset), quality)| Splats {
                color,
                depth,
                offset,
                quality,
            })
    }
}

/// Largest side of a point's square, in pixels.
const LARGEST: f32 = 16.0;

/// Enlarges the growth of squares, so that rounding leaves no cracks between them.
const MARGIN: f32 = 1.01;

/// Scatters points from the second camera to the first, which is the current one.
pub fn splat(points: Points, cameras: [&Camera; 2], params: Params, splats: Splats) {
    let Pixels { size, channels, .. } = points.color;
    let count = rows::bands(size.height).count();
    let mut bins = vec![vec![]; count];
    let project = Project::new(points, cameras, params);
    rows::run(&project, size.height, bins.iter_mut());
    let mut lists = vec![vec![]; count];
    for (band, points) in bins.iter().flatten() {
        lists[*band].push(points.as_slice());
    }
    let gather = Gather {
        color: points.color,
        points: lists,
        params,
    };
    let outs = splats.bands(size, channels);
    rows::run(&gather, size.height, outs);
}

/// Points at either border of their pixel belong to it, although a pixel ends just before its right and lower border.
const BELOW_HALF: f32 = 0.5 - 0.5 * f32::EPSILON;

/// A point projected to the current frame.
#[derive(Clone, Copy)]
struct Point {
    source: u32,
    /// The pixel that contains the point, and its offset from that pixel's centre, in [−½, ½).
    x: i32,
    y: i32,
    offset: [f32; 2],
    depth: f32,
    side: f32,
    quality: f32,
}

impl Point {
    /// The pixels covered along an axis: those with centres in (−s/2, s/2] around the point, so that one of side 1 has one
    /// pixel; with a reach, in [−s/2, s/2], so that cracks are filled from both sides alike.
    #[inline(always)]
    fn covers(place: i32, offset: f32, side: f32, reach: f32, end: usize) -> Range<usize> {
        let half = 0.5 * side + reach;
        let first = match reach > 0.0 {
            true => place + (offset - half).ceil() as i32,
            false => place + (offset - half).floor() as i32 + 1,
        };
        let last = place + (offset + half).floor() as i32;
        let end = end as i32;
        first.clamp(0, end) as usize..(last + 1).clamp(0, end) as usize
    }

    /// Covered columns and rows, with the square enlarged by `reach` on every side.
    #[inline(always)]
    fn square(&self, size: Size, reach: f32) -> [Range<usize>; 2] {
        [
            Self::covers(self.x, self.offset[0], self.side, reach, size.width),
            Self::covers(self.y, self.offset[1], self.side, reach, size.height),
        ]
    }
}

/// The points of one band of the previous frame, binned by the bands of the current frame that they cover. Bands that none
/// covers have no bin: there are as many pairs of bands as the square of the height.
type Bins = Vec<(usize, Vec<Point>)>;

struct Project<'a> {
    points: Points<'a>,
    warp: Warp,
    /// Magnification of the new camera relative to the old one at equal depth.
    zoom: f64,
    reach: f32,
}

impl<'a> Project<'a> {
    fn new(points: Points<'a>, [camera, previous]: [&Camera; 2], params: Params) -> Self {
        Self {
            points,
            warp: Warp::new(previous, camera, DAffine3::IDENTITY),
            zoom: (camera.pixels_per_unit() / previous.pixels_per_unit()).sqrt(),
            reach: params.reach,
        }
    }

    /// The point of a pixel; `None` if the pixel is invalid or the point lies behind the camera.
    #[inline(always)]
    fn point(&self, source: usize, x: usize, y: usize) -> Option<Point> {
        let Points {
            color,
            depth,
            offset,
            drift,
            quality,
        } = self.points;
        let depth = depth.at(source, 0);
        let quality = quality.map_or(1.0, |quality| quality.at(source, 0));
        let present = (0..color.channels).all(|c| color.at(source, c).is_finite());
        if !(present && depth > 0.0 && quality > 0.0 && quality.is_finite()) {
            return None;
        }
        let [ox, oy] = match offset {
            Some(offset) => [0, 1].map(|c| match offset.at(source, c) {
                0.5 => BELOW_HALF,
                offset => offset,
            }),
            None => [0.0; 2],
        };
        let place = [(x, ox), (y, oy)].map(|(place, o)| place as f64 + 0.5 + f64::from(o));
        let (far, near) = match depth == f32::INFINITY {
            true => (1.0, 0.0),
            false => (f64::from(depth), 1.0),
        };
        let [mx, my, mz] = self.warp.motion(place, far, near);
        let [dx, dy, dz] = match drift {
            Some(drift) => [0, 1, 2].map(|c| match c < drift.channels {
                true => finite(drift.at(source, c)),
                false => 0.0,
            }),
            None => [0.0; 3],
        };
        let moved = [ox + mx - dx, oy + my - dy];
        let now = depth + mz - dz;
        // Positions far outside any image cover nothing, and beyond 2^24 integers would not be exact.
        if !(moved.iter().all(|v| v.abs() < 1e6) && now > 0.0) {
            return None;
        }
        let nearer = match near == 0.0 {
            true => 1.0,
            false => far / f64::from(now),
        };
        let growth = (nearer * self.zoom) as f32 - 1.0;
        let side = (1.0 + MARGIN * growth).clamp(1.0, LARGEST);
        let area = side * side;
        let cell = moved.map(|v| (v + 0.5).floor());
        Some(Point {
            source: source as u32,
            x: x as i32 + cell[0] as i32,
            y: y as i32 + cell[1] as i32,
            offset: [moved[0] - cell[0], moved[1] - cell[1]],
            depth: now,
            side,
            quality: quality / (area * area),
        })
    }
}

impl<'a> Kernel for Project<'a> {
    type Out = &'a mut Bins;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, bins: &'a mut Bins) {
        let size = self.points.color.size;
        let mut bin_of = vec![u32::MAX; rows::bands(size.height).count()];
        for y in rows {
            for x in 0..size.width {
                let Some(point) = self.point(y * size.width + x, x, y) else {
                    continue;
                };
                let [columns, covered] = point.square(size, self.reach);
                if covered.is_empty() || columns.is_empty() {
                    continue;
                }
                for band in covered.start / BAND..=(covered.end - 1) / BAND {
                    if bin_of[band] == u32::MAX {
                        bin_of[band] = bins.len() as u32;
                        bins.push((band, vec![]));
                    }
                    bins[bin_of[band] as usize].1.push(point);
                }
            }
        }
    }
}

#[inline(always)]
fn finite(value: f32) -> f32 {
    if value.is_finite() { value } else { 0.0 }
}

struct Gather<'a> {
    color: Pixels<'a>,
    /// Those that cover each band, in the order of the previous frame's bands.
    points: Vec<Vec<&'a [Point]>>,
    params: Params,
}

impl Gather<'_> {
    /// Calls `call` with every point, every pixel of the band that its enlarged square covers, and that pixel's index in
    /// the band.
    #[inline(always)]
    fn each(
        &self,
        rows: &Range<usize>,
        reach: f32,
        mut call: impl FnMut(&Point, [usize; 2], usize),
    ) {
        let size = self.color.size;
        let band = rows.start / BAND;
        for point in self.points[band].iter().copied().flatten() {
            let [columns, covered] = point.square(size, reach);
            for y in covered.start.max(rows.start)..covered.end.min(rows.end) {
                for x in columns.clone() {
                    call(point, [x, y], (y - rows.start) * size.width + x);
                }
            }
        }
    }
}

impl<'a> Kernel for Gather<'a> {
    type Out = Splats<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, out: Splats<'a>) {
        let channels = self.color.channels;
        for image in [&mut *out.color, out.depth, out.offset] {
            image.fill(f32::NAN);
        }
        out.quality.fill(0.0);
        let Params { tolerance, reach } = self.params;
        let mut nearest = vec![f32::NAN; out.depth.len()];
        // The initial NaN is replaced by any depth.
        let nearer = |before: f32, depth: f32| if before <= depth { before } else { depth };
        self.each(&rows, 0.0, |point, _, at| {
            nearest[at] = nearer(nearest[at], point.depth);
        });
        let mut weights = vec![0.0; out.depth.len()];
        let mut add = |point: &Point, [x, y]: [usize; 2], at: usize, nearest: f32, quality: f32| {
            let behind = point.depth - nearest;
            let nearness = match behind > 0.0 {
                true => 1.0 - behind / (tolerance * nearest),
                false => 1.0,
            };
            let weight = quality * nearness;
            if !(weight > 0.0) {
                return;
            }
            let offset = match [x as i32, y as i32] == [point.x, point.y] {
                true => point.offset,
                false => [0.0; 2],
            };
            let first = weights[at] == 0.0;
            weights[at] += weight;
            let fraction = weight / weights[at];
            // Running mean. A single point, or several equal ones, keep their bits.
            let join = |mean: &mut f32, value: f32| {
                let moved = *mean + fraction * (value - *mean);
                *mean = if first || value == *mean {
                    value
                } else {
                    moved
                };
            };
            let color = &mut out.color[at * channels..][..channels];
            for (channel, mean) in color.iter_mut().enumerate() {
                join(mean, self.color.at(point.source as usize, channel));
            }
            join(&mut out.depth[at], point.depth);
            join(&mut out.offset[2 * at], offset[0]);
            join(&mut out.offset[2 * at + 1], offset[1]);
            join(&mut out.quality[at], quality);
        };
        self.each(&rows, 0.0, |point, pixel, at| {
            add(point, pixel, at, nearest[at], point.quality);
        });
        if reach > 0.0 {
            // Nearest depth of enlarged squares, for pixels that no square covers.
            let mut spare = vec![f32::NAN; nearest.len()];
            self.each(&rows, reach, |point, _, at| {
                spare[at] = nearer(spare[at], point.depth);
            });
            self.each(&rows, reach, |point, pixel, at| {
                if nearest[at].is_nan() {
                    let ratio = point.side / (point.side + 2.0 * reach);
                    let area = ratio * ratio;
                    add(point, pixel, at, spare[at], point.quality * (area * area));
                }
            });
        }
    }
}
