//! Firefly suppression: samples far brighter than all around them are held down, and their light is spread.
//!
//! The ring is the window around a pixel without the pixel itself, so that a firefly does not speak for itself. With mean
//! and standard deviation of its luminances, a pixel may be as bright as mean + t·deviation (NRD's anti-firefly has a 9×9
//! ring and t = 2). What exceeds it, e = l − limit, is not lost at once, which would darken the image: the pixels of the
//! window that are below their own limits take it, in its colour, in proportion to their headroom g and up to it:
//!   given = min(e, Σg),  a pixel q gets g_q Σ_p (c_p / l_p) given_p / Σg_p,
//! the sum over fireflies p around q. What nobody could take is removed, and reported. Headroom is g = limit′ − l with
//! limits taken from what the first round left, or a firefly would make room for itself.
//!
//! Input: colour (any channels are its three). Outputs: colour (3), removed luminance (1). Missing pixels stay, do not
//! count and take nothing; where the ring has fewer than two pixels there is no limit.

use std::ops::Range;

use crate::error::{Result, in_range, whole};
use crate::image::{BandMut, Image, Run, Tap, View};
use crate::math::{is_present, luminance};
use crate::rows::{self, Kernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Standard deviations above the mean; ≥ 0; 2.
    pub threshold: f32,
    /// The window reaches so many pixels to each side; 1 to 16; 4.
    pub radius: usize,
    /// Whether what exceeds the limit is spread; true.
    pub redistribute: bool,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            threshold: 2.0,
            radius: 4,
            redistribute: true,
        }
    }
}

impl Params {
    pub fn radius(value: i64) -> Result<usize> {
        whole("radius", value, "1 to 16 pixels", |n| (1..=16).contains(n))
    }

    pub fn check(&self) -> Result<()> {
        in_range("threshold", self.threshold, "a finite number from 0", |v| {
            v >= 0.0 && v.is_finite()
        })
    }
}

/// Limits have this much room, so that rounding makes no fireflies of equal pixels.
const SLACK: f32 = 1.000_01;

pub fn suppress_fireflies(color: View, params: Params) -> (Image, Image) {
    let size = color.size;
    let reach = params.radius as isize;
    let mut moments = Image::new(size, 3);
    rows::run(&Moments { color }, size.height, moments.bands());
    let limits = limit(&moments, reach, params.threshold);
    // Without redistribution nobody has room.
    let mut headroom = Image::new(size, 1);
    if params.redistribute {
        let mut held = moments.clone();
        rows::run(&HoldMoments { limits: &limits }, size.height, held.bands());
        let second = limit(&held, reach, params.threshold);
        let kernel = Headroom {
            moments: &held,
            limits: &second,
        };
        rows::run(&kernel, size.height, headroom.bands());
    }
    let room = window(headroom.view(), reach);
    let (mut gifts, mut removed) = (Image::new(size, 3), Image::new(size, 1));
    let kernel = Gifts {
        color,
        moments: &moments,
        limits: &limits,
        room: &room,
    };
    rows::run(&kernel, size.height, gifts.bands().zip(removed.bands()));
    let received = params
        .redistribute
        .then(|| (headroom, window(gifts.view(), reach)));
    let mut held = Image::new(size, 3);
    let kernel = Hold {
        color,
        moments: &moments,
        limits: &limits,
        received: received.as_ref(),
    };
    rows::run(&kernel, size.height, held.bands());
    (held, removed)
}

/// Whether a pixel is present (1 or 0), its luminance and the square of that; 0 where it is missing.
struct Moments<'a> {
    color: View<'a>,
}

impl<'a> Kernel for Moments<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let [r, g, b] = self.color.rows(y);
            let [count, first, second] = out.rows(y);
            for x in 0..r.len() {
                let present = is_present([r[x], g[x], b[x]]);
                let l = luminance(r[x], g[x], b[x]);
                count[x] = if present { 1.0 } else { 0.0 };
                first[x] = if present { l } else { 0.0 };
                second[x] = if present { l * l } else { 0.0 };
            }
        }
    }
}

/// Whether the middle of a window counts.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Middle {
    Counts,
    Left,
}

/// Sums of each channel along an axis, `reach` pixels to each side, with nothing beyond the border.
struct Sums<'a> {
    image: View<'a>,
    axis: [isize; 2],
    reach: isize,
    middle: Middle,
}

fn sums(image: View, axis: [isize; 2], reach: isize, middle: Middle) -> Image {
    let mut sums = Image::new(image.size, image.channels);
    let kernel = Sums {
        image,
        axis,
        reach,
        middle,
    };
    rows::run(&kernel, image.size.height, sums.bands());
    sums
}

fn window(image: View, reach: isize) -> Image {
    let columns = sums(image, [0, 1], reach, Middle::Counts);
    sums(columns.view(), [1, 0], reach, Middle::Counts)
}

impl<'a> Kernel for Sums<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let row = Run {
                y,
                x: 0,
                len: self.image.size.width,
            };
            for channel in 0..self.image.channels {
                let out = out.row(channel, y);
                out.fill(0.0);
                for d in -self.reach..=self.reach {
                    let [dx, dy] = self.axis.map(|axis| axis * d);
                    let tap = Tap { dx, dy, step: 1 };
                    if d == 0 && self.middle == Middle::Left {
                        continue;
                    }
                    if let Some(here) = tap.inside(row, self.image.size) {
                        let there = tap.of(here);
                        let from = &self.image.row(channel, there.y)[there.x..][..there.len];
                        for (sum, from) in out[here.x..][..here.len].iter_mut().zip(from) {
                            *sum += from;
                        }
                    }
                }
            }
        }
    }
}

/// The limit of each pixel; +inf where there is none.
fn limit(moments: &Image, reach: isize, threshold: f32) -> Image {
    // The ring is put together from columns, those beside the pixel and its own without it. Subtracting the pixel
    // from the whole window would not do: beside a firefly the rest is rounded away.
    let columns = sums(moments.view(), [0, 1], reach, Middle::Counts);
    let beside = sums(columns.view(), [1, 0], reach, Middle::Left);
    let own = sums(moments.view(), [0, 1], reach, Middle::Left);
    let mut limits = Image::new(moments.size, 1);
    let kernel = Limits {
        ring: [&beside, &own],
        threshold,
    };
    rows::run(&kernel, moments.size.height, limits.bands());
    limits
}

struct Limits<'a> {
    /// Two parts whose sum is the ring's count and moments.
    ring: [&'a Image; 2],
    threshold: f32,
}

impl<'a> Kernel for Limits<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let [[n0, a0, b0], [n1, a1, b1]] = self.ring.map(|part| part.view().rows(y));
            for (x, out) in out.row(0, y).iter_mut().enumerate() {
                let count = n0[x] + n1[x];
                let mean = (a0[x] + a1[x]) / count;
                let variance = ((b0[x] + b1[x]) / count - mean * mean).max(0.0);
                let limit = (mean + self.threshold * variance.sqrt()) * SLACK;
                // Squares that overflow leave no limit either.
                let limited = (count >= 2.0) & limit.is_finite();
                *out = if limited { limit } else { f32::INFINITY };
            }
        }
    }
}

/// What a luminance has beyond its limit; nothing that is not positive has.
#[inline(always)]
fn excess(l: f32, limit: f32) -> f32 {
    if l > 0.0 { (l - limit).max(0.0) } else { 0.0 }
}

/// Moments of what is left when luminances are held to their limits.
struct HoldMoments<'a> {
    limits: &'a Image,
}

impl<'a> Kernel for HoldMoments<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut moments: BandMut<'a>) {
        for y in rows {
            let limit = self.limits.view().row(0, y);
            let [_, first, second] = moments.rows(y);
            for x in 0..limit.len() {
                let held = if excess(first[x], limit[x]) > 0.0 {
                    limit[x]
                } else {
                    first[x]
                };
                first[x] = held;
                second[x] = held * held;
            }
        }
    }
}

/// What present pixels lack to their limits.
struct Headroom<'a> {
    moments: &'a Image,
    limits: &'a Image,
}

impl<'a> Kernel for Headroom<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let [present, l, _] = self.moments.view().rows(y);
            let limit = self.limits.view().row(0, y);
            for (x, out) in out.row(0, y).iter_mut().enumerate() {
                let limited = (present[x] > 0.0) & limit[x].is_finite();
                *out = if limited {
                    (limit[x] - l[x]).max(0.0)
                } else {
                    0.0
                };
            }
        }
    }
}

/// What a firefly has for each unit of headroom around it, in its colour, and what it cannot give away.
struct Gifts<'a> {
    color: View<'a>,
    moments: &'a Image,
    limits: &'a Image,
    /// Headroom over the window.
    room: &'a Image,
}

impl<'a> Kernel for Gifts<'a> {
    type Out = (BandMut<'a>, BandMut<'a>);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut gifts, mut removed): Self::Out) {
        for y in rows {
            let color: [_; 3] = self.color.rows(y);
            let [_, l, _] = self.moments.view().rows(y);
            let limit = self.limits.view().row(0, y);
            let room = self.room.view().row(0, y);
            let removed = removed.row(0, y);
            let mut gifts: [_; 3] = gifts.rows(y);
            for x in 0..l.len() {
                let excess = excess(l[x], limit[x]);
                let gives = (excess > 0.0) & (room[x] > 0.0);
                let given = if gives { excess.min(room[x]) } else { 0.0 };
                removed[x] = excess - given;
                for (gift, color) in gifts.iter_mut().zip(color) {
                    gift[x] = if gives {
                        color[x] / l[x] * (given / room[x])
                    } else {
                        0.0
                    };
                }
            }
        }
    }
}

struct Hold<'a> {
    color: View<'a>,
    moments: &'a Image,
    limits: &'a Image,
    /// Headroom, and gifts over the window.
    received: Option<&'a (Image, Image)>,
}

impl<'a> Kernel for Hold<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let [_, l, _] = self.moments.view().rows(y);
            let limit = self.limits.view().row(0, y);
            for channel in 0..3 {
                let color = self.color.row(channel, y);
                let out = out.row(channel, y);
                for x in 0..l.len() {
                    let held = color[x] * (limit[x] / l[x]);
                    let exceeds = excess(l[x], limit[x]) > 0.0;
                    out[x] = if exceeds { held } else { color[x] };
                }
                if let Some((headroom, gifts)) = self.received {
                    let headroom = headroom.view().row(0, y);
                    let gifts = gifts.view().row(channel, y);
                    for x in 0..l.len() {
                        out[x] += headroom[x] * gifts[x];
                    }
                }
            }
        }
    }
}
