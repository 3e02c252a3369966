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
use crate::image::{Pixels, Run, Size};
use crate::math::{is_present, luminance};
use crate::pixels::{LANES, PixelsMut, Rolling, STRIP, larger, smaller};
use crate::rows::{self, BAND, Kernel};

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

/// Writes the colours, and the luminance that was removed, where that is asked for.
pub fn suppress_fireflies<'a>(
    color: Pixels<'a>,
    params: Params,
    held: impl Iterator<Item = PixelsMut<'a>>,
    removed: Option<&'a mut [f32]>,
) {
    let size = color.size;
    let kernel = Suppress { color, params };
    let mut removed = removed.map(|removed| removed.chunks_mut(BAND * size.width));
    let outs = held.map(|held| Outs {
        held,
        removed: removed.as_mut().and_then(Iterator::next),
    });
    rows::run_far(&kernel, size.height, kernel.reach(), outs);
}

struct Suppress<'a> {
    color: Pixels<'a>,
    params: Params,
}

struct Outs<'a> {
    held: PixelsMut<'a>,
    removed: Option<&'a mut [f32]>,
}

impl<'a> Kernel for Suppress<'a> {
    type Out = Vec<Outs<'a>>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut outs: Self::Out) {
        let width = self.color.size.width;
        let mut strip = Strip::new(width, self.params.radius, self.reach());
        for left in (0..width).step_by(STRIP) {
            let columns = left..(left + STRIP).min(width);
            for row in 0..rows.len() + 2 * self.reach() {
                self.advance(row, &columns, &rows, &mut strip, &mut outs);
            }
        }
    }
}

/// The last rows of a strip of columns, and of as many more on both sides as count.
struct Strip {
    radius: usize,
    length: usize,
    colors: Rolling<3>,
    /// Presence (1 or 0), luminance, present pixels of the ring, limit, what of the luminance is removed, and headroom.
    known: Rolling<6>,
    moments: Windows<3>,
    held: Windows<2>,
    headroom: Windows<1>,
    gifts: Windows<3>,
    /// What one row adds to windows, and what it takes from them.
    own: [Vec<f32>; 3],
    sums: [Vec<f32>; 3],
}

impl Strip {
    #[inline(always)]
    fn new(width: usize, radius: usize, reach: usize) -> Self {
        let length = STRIP.min(width).next_multiple_of(LANES) + 2 * reach;
        let rows = || [(); 3].map(|()| vec![0.0; length]);
        Self {
            radius,
            length,
            colors: Rolling::new(length, reach.div_ceil(2)),
            known: Rolling::new(length, reach.div_ceil(2)),
            moments: Windows::new(length, radius, Middle::Left),
            held: Windows::new(length, radius, Middle::Left),
            headroom: Windows::new(length, radius, Middle::Counts),
            gifts: Windows::new(length, radius, Middle::Counts),
            own: rows(),
            sums: rows(),
        }
    }

    /// Places whose windows, and their windows, and so forth, are known.
    fn places(&self, windows: usize) -> Range<usize> {
        windows * self.radius..self.length - windows * self.radius
    }

    /// Which of a row's places, of which `reach` lie before the strip, are the image's.
    fn inside(&self, left: usize, reach: usize, width: usize) -> Range<usize> {
        reach.saturating_sub(left)..(width + reach - left).min(self.length)
    }
}

impl Suppress<'_> {
    /// Pixels to each side that count: each sum is over windows of what the one before has found.
    fn reach(&self) -> usize {
        let Params {
            radius,
            redistribute,
            ..
        } = self.params;
        radius * if redistribute { 4 } else { 1 }
    }

    /// Takes the next row of a strip, and finds what those above have waited for.
    #[inline(always)]
    fn advance(
        &self,
        row: usize,
        columns: &Range<usize>,
        rows: &Range<usize>,
        strip: &mut Strip,
        outs: &mut [Outs],
    ) {
        let (radius, reach) = (self.params.radius, self.reach());
        let y = (rows.start + row) as isize - reach as isize;
        let above = |windows: usize| y - (windows * radius) as isize;
        self.read(y, columns.start, strip);
        self.measure(y, strip);
        if row >= 2 * radius {
            self.limit(above(1), strip);
        }
        if self.params.redistribute {
            if row >= 4 * radius {
                self.find_room(above(2), strip);
            }
            if row >= 6 * radius {
                give(above(3), strip);
            }
        }
        if row >= 2 * reach {
            let below = row - 2 * reach;
            let run = Run {
                y: rows.start + below,
                x: columns.start,
                len: columns.len(),
            };
            let Outs { held, removed } = &mut outs[below / BAND];
            let place = reach..reach + run.len;
            self.hold(run.y as isize, place.clone(), strip);
            held.write(run, strip.own.each_ref().map(|row| &row[place.clone()]));
            if let Some(removed) = removed {
                let row = &mut removed[below % BAND * self.color.size.width..][columns.clone()];
                let [.., known, _] = strip.known.row(run.y as isize);
                row.copy_from_slice(&known[place]);
            }
        }
    }

    /// Reads a row's colours; NaN outside the image.
    #[inline(always)]
    fn read(&self, y: isize, left: usize, strip: &mut Strip) {
        let Size { height, width } = self.color.size;
        let reach = self.reach();
        let inside = strip.inside(left, reach, width);
        let rows = strip.colors.row_mut(y);
        if (0..height as isize).contains(&y) {
            let run = Run {
                y: y as usize,
                x: left + inside.start - reach,
                len: inside.len(),
            };
            let rows = rows.map(|row| {
                row[..inside.start].fill(f32::NAN);
                row[inside.end..strip.length].fill(f32::NAN);
                &mut row[inside.clone()]
            });
            self.color.read(run, rows);
        } else {
            rows.into_iter().for_each(|row| row.fill(f32::NAN));
        }
    }

    /// Counts present pixels, and adds up their luminances and the squares of these.
    #[inline(always)]
    fn measure(&self, y: isize, strip: &mut Strip) {
        let (n, places) = (strip.length, strip.places(1));
        let [r, g, b] = strip.colors.row(y).map(|row| &row[..n]);
        let [present, light, ..] = strip.known.row_mut(y).map(|row| &mut row[..n]);
        let [squares, ..] = &mut strip.own;
        let squares = &mut squares[..n];
        for i in 0..n {
            let here = is_present([r[i], g[i], b[i]]);
            let l = luminance(r[i], g[i], b[i]);
            let l = if here { l } else { 0.0 };
            present[i] = if here { 1.0 } else { 0.0 };
            (light[i], squares[i]) = (l, l * l);
        }
        let [present, light, ..] = strip.known.row(y);
        let own = [present, light, &*squares];
        strip.moments.add(y, places, own);
    }

    /// Finds a row's limits, and adds up what is left when luminances are held to them.
    #[inline(always)]
    fn limit(&self, y: isize, strip: &mut Strip) {
        let places = strip.places(1);
        let n = places.len();
        let sums = strip.sums.each_mut().map(|row| &mut row[places.clone()]);
        let [count, first, second] = strip.moments.sum(y, places.clone(), sums);
        let known = strip.known.row_mut(y);
        let known = known.map(|row| &mut row[places.clone()][..n]);
        let [_, light, counts, limits, removed, _] = known;
        let own = strip.own.each_mut();
        let [held, squares, _] = own.map(|row| &mut row[places.clone()][..n]);
        for i in 0..n {
            let limit = limit(self.params.threshold, count[i], first[i], second[i]);
            let excess = excess(light[i], limit);
            let left = if excess > 0.0 { limit } else { light[i] };
            (counts[i], limits[i], removed[i]) = (count[i], limit, excess);
            (held[i], squares[i]) = (left, left * left);
        }
        let [held, squares, _] = strip.own.each_ref().map(Vec::as_slice);
        strip.held.add(y, strip.places(2), [held, squares]);
    }

    /// Finds what a row's present pixels lack to the limits that are left, and adds it up.
    #[inline(always)]
    fn find_room(&self, y: isize, strip: &mut Strip) {
        let places = strip.places(2);
        let n = places.len();
        let [first, second, _] = strip.sums.each_mut();
        let sums = [first, second].map(|row| &mut row[places.clone()]);
        let [first, second] = strip.held.sum(y, places.clone(), sums);
        let known = strip.known.row_mut(y);
        let known = known.map(|row| &mut row[places.clone()][..n]);
        let [present, light, count, limits, _, headroom] = known;
        for i in 0..n {
            let exceeds = excess(light[i], limits[i]) > 0.0;
            let left = if exceeds { limits[i] } else { light[i] };
            let limit = limit(self.params.threshold, count[i], first[i], second[i]);
            let limited = (present[i] > 0.0) & limit.is_finite();
            let room = larger(limit - left, 0.0);
            headroom[i] = if limited { room } else { 0.0 };
        }
        let [.., headroom] = strip.known.row(y);
        strip.headroom.add(y, strip.places(3), [headroom]);
    }

    /// Holds a row's colours to their limits, and gives them what others have for them.
    #[inline(always)]
    fn hold(&self, y: isize, places: Range<usize>, strip: &mut Strip) {
        let n = places.len();
        let known = strip.known.row(y).map(|row| &row[places.clone()][..n]);
        let [_, light, _, limits, _, headroom] = known;
        let colors = strip.colors.row(y);
        let [r, g, b] = colors.map(|row| &row[places.clone()][..n]);
        let own = strip.own.each_mut();
        let [or, og, ob] = own.map(|row| &mut row[places.clone()][..n]);
        for i in 0..n {
            let exceeds = excess(light[i], limits[i]) > 0.0;
            let share = limits[i] / light[i];
            let held = |color: f32| if exceeds { color * share } else { color };
            (or[i], og[i], ob[i]) = (held(r[i]), held(g[i]), held(b[i]));
        }
        if self.params.redistribute {
            let sums = strip.sums.each_mut().map(|row| &mut row[places.clone()]);
            let gifts = strip.gifts.sum(y, places.clone(), sums);
            for (out, gifts) in strip.own.iter_mut().zip(gifts) {
                let out = &mut out[places.clone()][..n];
                for i in 0..n {
                    out[i] += headroom[i] * gifts[i];
                }
            }
        }
    }
}

/// Adds up what a row's fireflies have for each unit of headroom around them, in their colour.
#[inline(always)]
fn give(y: isize, strip: &mut Strip) {
    let places = strip.places(3);
    let n = places.len();
    let [room, ..] = &mut strip.sums;
    let room = &mut room[places.clone()][..n];
    strip.headroom.sum(y, places.clone(), [&mut *room]);
    let known = strip.known.row_mut(y);
    let [_, light, _, limits, removed, _] = known.map(|row| &mut row[places.clone()][..n]);
    for i in 0..n {
        let excess = excess(light[i], limits[i]);
        let gives = (excess > 0.0) & (room[i] > 0.0);
        let given = if gives { smaller(excess, room[i]) } else { 0.0 };
        removed[i] = excess - given;
        let share = given / room[i];
        room[i] = if gives { share } else { 0.0 };
    }
    for (own, color) in strip.own.iter_mut().zip(strip.colors.row(y)) {
        let (own, color) = (&mut own[places.clone()][..n], &color[places.clone()][..n]);
        for i in 0..n {
            // Shares first: of dark images, products of two luminances are zero.
            let gift = color[i] / light[i] * room[i];
            own[i] = if room[i] > 0.0 { gift } else { 0.0 };
        }
    }
    let own = strip.own.each_ref().map(Vec::as_slice);
    strip.gifts.add(y, strip.places(4), own);
}

/// The limit of a pixel by the sums over its ring; +inf where there is none.
#[inline(always)]
fn limit(threshold: f32, count: f32, first: f32, second: f32) -> f32 {
    let share = 1.0 / count;
    let mean = first * share;
    let variance = larger(second * share - mean * mean, 0.0);
    let limit = (mean + threshold * variance.sqrt()) * SLACK;
    // Squares that overflow leave no limit either.
    let limited = (count >= 2.0) & limit.is_finite();
    if limited { limit } else { f32::INFINITY }
}

/// What a luminance has beyond its limit; nothing that is not positive has.
#[inline(always)]
fn excess(l: f32, limit: f32) -> f32 {
    if l > 0.0 { larger(l - limit, 0.0) } else { 0.0 }
}

/// Whether the middle of a window counts.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Middle {
    Counts,
    Left,
}

/// Sums over the window around each pixel, from rows that come from above.
struct Windows<const C: usize> {
    radius: usize,
    middle: Middle,
    /// Sums along rows.
    along: Rolling<C>,
    /// The same without the pixel itself. Subtracting it from the whole would not do: beside a firefly the rest is rounded
    /// away.
    own: Rolling<C>,
}

impl<const C: usize> Windows<C> {
    #[inline(always)]
    fn new(length: usize, radius: usize, middle: Middle) -> Self {
        Self {
            radius,
            middle,
            along: Rolling::new(length, radius),
            own: Rolling::new(length, if middle == Middle::Left { radius } else { 0 }),
        }
    }

    /// Takes the next row.
    #[inline(always)]
    fn add(&mut self, y: isize, places: Range<usize>, rows: [&[f32]; C]) {
        let sums = self.along.row_mut(y).into_iter().zip(self.own.row_mut(y));
        for ((along, own), row) in sums.zip(rows) {
            let (along, own) = (&mut along[places.clone()], &mut own[places.clone()]);
            own.fill(0.0);
            let beside = |d: usize| [places.start - d, places.start + d].map(|at| &row[at..]);
            add_pairs(self.radius, beside, own);
            let row = &row[places.clone()];
            for i in 0..own.len() {
                along[i] = own[i] + row[i];
            }
        }
    }

    /// Finds the sums of a row, of which those below have been taken.
    #[inline(always)]
    fn sum<'s>(&self, y: isize, places: Range<usize>, sums: [&'s mut [f32]; C]) -> [&'s [f32]; C] {
        let own = match self.middle {
            Middle::Counts => self.along.row(y),
            Middle::Left => self.own.row(y),
        };
        for c in 0..C {
            sums[c].copy_from_slice(&own[c][places.clone()]);
            let around = |d: usize| {
                [y - d as isize, y + d as isize].map(|y| &self.along.row(y)[c][places.start..])
            };
            add_pairs(self.radius, around, sums[c]);
        }
        sums.map(|sums| &*sums)
    }
}

/// Adds the rows at every distance up to the radius.
#[inline(always)]
fn add_pairs<'r>(radius: usize, pair: impl Fn(usize) -> [&'r [f32]; 2], sums: &mut [f32]) {
    let n = sums.len();
    let pair = |d| pair(d).map(|row| &row[..n]);
    // Two at once, which saves half of the loads and stores of sums.
    for d in (1..radius).step_by(2) {
        let [[a, b], [c, d]] = [pair(d), pair(d + 1)];
        for i in 0..n {
            sums[i] += (a[i] + b[i]) + (c[i] + d[i]);
        }
    }
    if radius % 2 == 1 {
        let [a, b] = pair(radius);
        for i in 0..n {
            sums[i] += a[i] + b[i];
        }
    }
}
