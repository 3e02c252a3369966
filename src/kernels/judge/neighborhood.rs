//! Neighbourhood clipping: history is clipped to the range of the current frame's colours around the pixel.
//!
//! Statistics of the 3×3 or 5×5 neighbourhood of the current colour give a box in a colour space; a history colour
//! outside the box is moved onto it.
//! - **box**: the range of the neighbourhood; the mean of the ranges of the square and of the cross, which is rounder
//!   (Karis 2014, *High Quality Temporal Supersampling*); mean ± γ standard deviations (Salvi 2016, *An Excursion in
//!   Temporal Supersampling*); or the intersection of the first and the last. Instead of a box, the convex hull, for the
//!   response "current" alone: exact in chrominance, with the range of Y; or of the whole colour, exact or as a polytope
//!   of thirteen slabs (see [`super::hull`]).
//! - **space**: RGB, YCoCg, or either after c / (e + max(r, g, b)), which keeps single bright pixels from opening the box
//!   (Lottes 2016, *Optimized Reversible Tonemapper for Resolve*), with e the exposure. The corners of such a box may lie
//!   beyond the range of the curve; a clipped colour is limited to the brightest of history and neighbourhood.
//! - **response**: each channel clamped; clipped on the way to the box's centre (Playdead 2016, *Temporal Reprojection
//!   Anti-Aliasing in INSIDE*); clipped on the way to the current colour, which is first clamped into the box, because a
//!   current colour outside its own box would let bad history through unclipped; or onto the ellipsoid of half-axes
//!   γσ · (1.7, 1, 1), wider in luminance (FSR 3.1).
//!
//! The inside test has a tolerance of a millionth of the box's largest coordinate. Without it, rounding would decide
//! where the neighbourhood is flat along an axis.
//!
//! Inputs: history (3), colour (3). Output: history; a colour inside keeps its bits. Neighbours that are missing or
//! outside the image do not count. History is unchanged where it is missing or has no valid neighbour.
//!
//! Statistics are separable: columns first, then across columns. Variances are merged by the formula of Chan, Golub and
//! LeVeque 1983, *Algorithms for Computing the Sample Variance*, since a mean of squares would cancel.

use std::ops::Range;

use super::exposure;
use super::hull::{Polygon, enter_hulls, enter_slabs, toward};
use crate::error::{Error, Result, in_range};
use crate::image::{Pixels, Run, SEGMENT, segments};
use crate::math::{Color, from_ycocg, inverse_tone_map, is_present, max_channel, tone_map, ycocg};
use crate::pixels::{Columns, LANES, PixelsMut, Rolling, Row, lanes, larger, put, smaller};
use crate::rows::{self, BAND, Kernel, Outlined, Simd};

/// What of the neighbourhood holds history.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    /// The range of each channel.
    MinMax,
    /// The mean of the ranges of the square and of the cross.
    Rounded,
    /// The mean ± γ standard deviations.
    Variance,
    /// What the range and the variance have in common.
    Intersection,
    /// A polytope of thirteen slabs around the convex hull.
    Hull,
    /// The convex hull.
    ExactHull,
    /// The convex hull in chrominance, with the range of Y.
    ChromaHull,
}

impl Bounds {
    fn is_hull(self) -> bool {
        matches!(self, Self::Hull | Self::ExactHull | Self::ChromaHull)
    }
}

/// The space in which bounds are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// Linear.
    Rgb,
    /// Luma and two chromas.
    YCoCg,
    /// After the tone curve.
    ToneMappedRgb,
    /// YCoCg after the tone curve.
    ToneMappedYCoCg,
}

/// How a colour outside of the bounds is brought to them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response {
    /// Channel by channel.
    Clamp,
    /// On the way to the box's centre.
    Center,
    /// On the way to the current colour.
    Current,
    /// Onto the ellipsoid; for [`Bounds::Variance`].
    Ellipsoid,
}

/// Bounds, the space in which they are taken, and what becomes of colours outside.
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Variance.
    pub bounds: Bounds,
    /// Half the side of the variance box in standard deviations; ≥ 0; 1.
    pub gamma: f32,
    /// Radius of the neighbourhood in pixels; 1 or 2; 1.
    pub radius: isize,
    /// YCoCg.
    pub space: Space,
    /// Center.
    pub response: Response,
    /// The radiance that tone curves map to ½; above 0; 1.
    pub exposure: f32,
}

impl Params {
    /// Names of bounds.
    pub const BOUNDS: [(&str, Bounds); 7] = [
        ("minmax", Bounds::MinMax),
        ("rounded", Bounds::Rounded),
        ("variance", Bounds::Variance),
        ("intersection", Bounds::Intersection),
        ("hull", Bounds::Hull),
        ("exact-hull", Bounds::ExactHull),
        ("chroma-hull", Bounds::ChromaHull),
    ];
    /// Names of spaces.
    pub const SPACES: [(&str, Space); 4] = [
        ("rgb", Space::Rgb),
        ("ycocg", Space::YCoCg),
        ("tonemapped-rgb", Space::ToneMappedRgb),
        ("tonemapped-ycocg", Space::ToneMappedYCoCg),
    ];
    /// Names of responses.
    pub const RESPONSES: [(&str, Response); 4] = [
        ("clamp", Response::Clamp),
        ("center", Response::Center),
        ("current", Response::Current),
        ("ellipsoid", Response::Ellipsoid),
    ];
    /// Names of windows, and their radii.
    pub const WINDOWS: [(&str, isize); 2] = [("3x3", 1), ("5x5", 2)];

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        if !Self::WINDOWS.iter().any(|(_, r)| *r == self.radius) {
            return Err(Error::value("window", "a radius of 1 or 2", self.radius));
        }
        in_range("gamma", self.gamma, "a finite number from 0", |v| {
            v >= 0.0 && v.is_finite()
        })?;
        exposure::check(self.exposure)?;
        let response = name_of(self.response, &Self::RESPONSES);
        let bounds = name_of(self.bounds, &Self::BOUNDS);
        if self.response == Response::Ellipsoid && self.bounds != Bounds::Variance {
            let expected = "\"variance\" for response \"ellipsoid\"";
            return Err(Error::value("box", expected, bounds));
        }
        if self.bounds.is_hull() && self.response != Response::Current {
            let expected = format!("\"current\" for box {bounds}");
            return Err(Error::value("response", expected, response));
        }
        if self.bounds == Bounds::ChromaHull && !self.space.has_chrominance() {
            let expected = format!("\"ycocg\" or \"tonemapped-ycocg\" for box {bounds}");
            let space = name_of(self.space, &Self::SPACES);
            return Err(Error::value("space", expected, space));
        }
        Ok(())
    }
}

/// The quoted name of a mode.
fn name_of<T: Copy + PartialEq>(mode: T, names: &[(&str, T)]) -> String {
    let known = names.iter().find(|(_, other)| *other == mode);
    format!("{:?}", known.map_or("", |(name, _)| name))
}

impl Space {
    #[inline(always)]
    fn of(self, rgb: Color, exposure: f32) -> Color {
        match self {
            Self::Rgb => rgb,
            Self::YCoCg => ycocg(rgb),
            Self::ToneMappedRgb => tone_map(rgb, exposure),
            Self::ToneMappedYCoCg => ycocg(tone_map(rgb, exposure)),
        }
    }

    /// `limit` bounds the largest channel of tone-mapped colours (see [`inverse_tone_map`]).
    #[inline(always)]
    fn to_rgb(self, color: Color, exposure: f32, limit: f32) -> Color {
        match self {
            Self::Rgb => color,
            Self::YCoCg => from_ycocg(color),
            Self::ToneMappedRgb => inverse_tone_map(color, exposure, limit),
            Self::ToneMappedYCoCg => inverse_tone_map(from_ycocg(color), exposure, limit),
        }
    }

    pub(crate) fn is_tone_mapped(self) -> bool {
        matches!(self, Self::ToneMappedRgb | Self::ToneMappedYCoCg)
    }

    fn has_chrominance(self) -> bool {
        matches!(self, Self::YCoCg | Self::ToneMappedYCoCg)
    }

    /// Half-axes of the ellipsoid relative to the standard deviations.
    fn axes(self) -> Color {
        [if self.has_chrominance() { 1.7 } else { 1.0 }, 1.0, 1.0]
    }
}

struct Clip<'a> {
    history: Pixels<'a>,
    color: Pixels<'a>,
    params: Params,
}

/// Clips `history` to the neighbourhoods of `color`.
pub fn clip_history<'a>(
    history: Pixels<'a>,
    color: Pixels<'a>,
    params: Params,
    clipped: impl Iterator<Item = PixelsMut<'a>>,
) {
    let height = color.size.height;
    let kernel = Clip {
        history,
        color,
        params,
    };
    let jobs = rows::tall_jobs(height, params.radius as usize, clipped);
    rows::run_jobs(&kernel, jobs);
}

impl<'a> Kernel for Clip<'a> {
    type Out = Vec<PixelsMut<'a>>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut outs: Self::Out) {
        let size = self.color.size;
        let mut window = Window::new(size.width, self.params);
        let mut clipped = [[0.0; SEGMENT]; 3];
        for y in rows.clone() {
            window.roll(self.color, y, y == rows.start);
            let out = &mut outs[(y - rows.start) / BAND];
            for run in segments(y, size.width) {
                self.history
                    .read(run, clipped.each_mut().map(Row::as_mut_slice));
                window.clip(run, &mut clipped);
                out.write(run, clipped.each_ref().map(Row::as_slice));
            }
        }
    }
}

/// Sliding window of 2·radius + 1 rows, and the clip of a row's history to it.
pub(crate) struct Window {
    params: Params,
    /// Input colours, unconverted.
    pub colors: Rolling<3>,
    /// Colours in the space of the box; NaN where missing.
    converted: Rolling<3>,
    /// The largest channel of each pixel, 0 where missing; only for tone-mapped spaces.
    max_channel: Option<Rolling<1>>,
    boxes: Box<Boxes>,
    /// Scratch: history in the space of the box.
    history: [Row; 3],
}

impl Window {
    #[inline(always)]
    pub fn new(width: usize, params: Params) -> Self {
        let radius = params.radius as usize;
        let toned = params.space.is_tone_mapped();
        Self {
            params,
            colors: Rolling::new(width, radius),
            converted: Rolling::new(width, radius),
            max_channel: toned.then(|| Rolling::within(width, radius, 0.0)),
            boxes: Box::new(Boxes::new()),
            history: [[0.0; SEGMENT]; 3],
        }
    }

    /// Centres the window on row `y`: the row after the previous call's, unless `first`.
    #[inline(always)]
    pub fn roll(&mut self, color: Pixels, y: usize, first: bool) {
        let Params {
            space, exposure, ..
        } = self.params;
        let (mut own, mut mapped) = ([[0.0; SEGMENT]; 3], [[0.0; SEGMENT]; 3]);
        let mut largest = [[0.0; SEGMENT]];
        for y in self.colors.due(y, first) {
            let size = color.size;
            let (colors, converted) = (self.colors.fresh(y, size), self.converted.fresh(y, size));
            let max_channel = (self.max_channel.as_mut()).map(|rows| rows.fresh(y, size));
            let Some((mut colors, mut converted)) = colors.zip(converted) else {
                continue;
            };
            let mut max_channel = max_channel.flatten();
            for run in segments(y as usize, size.width) {
                color.read(run, own.each_mut().map(Row::as_mut_slice));
                put(&mut colors, run, &own);
                let own = own.each_ref().map(Row::as_slice);
                space.convert(own, mapped.each_mut().map(Row::as_mut_slice), exposure);
                put(&mut converted, run, &mapped);
                if let Some(max_channel) = &mut max_channel {
                    find_max_channels(own, &mut largest[0]);
                    put(max_channel, run, &largest);
                }
            }
        }
    }

    /// Clips a span of history to the neighbourhoods of its pixels.
    pub fn clip(&mut self, run: Run, history: &mut [Row; 3]) {
        rows::outline(ClipRun {
            window: self,
            run,
            history,
        });
    }

    #[inline(always)]
    fn clip_among<const N: usize>(&mut self, run: Run, history: &mut [Row; 3]) {
        let n = lanes(run);
        let Params {
            bounds,
            response,
            space,
            exposure,
            gamma,
            ..
        } = self.params;
        let offset = |i: usize| i as isize - (N / 2) as isize;
        let rows: [[&Columns; 3]; N] =
            std::array::from_fn(|i| self.converted.columns(run, offset(i)));
        let new = &mut self.history;
        {
            let history = history.each_ref().map(|row| &row[..n]);
            space.convert(history, new.each_mut().map(|row| &mut row[..n]), exposure);
        }
        match bounds {
            Bounds::Hull | Bounds::ExactHull => {
                let mut targets = [[0.0; SEGMENT]; 3];
                find_targets(n, rows, &mut targets);
                match bounds {
                    Bounds::Hull => enter_slabs(n, rows, &targets, new),
                    _ => enter_hulls(n, rows, &targets, new),
                }
            }
            Bounds::ChromaHull => enter_polygons(run.len, rows, new),
            _ => {
                let boxes = &mut self.boxes;
                boxes.find(n, rows, bounds, gamma);
                let axes = space.axes().map(|axis| gamma * axis);
                let own = self.converted.own(run);
                match response {
                    Response::Clamp => boxes.clip_by(n, new, |b, _, color| b.clamp(color)),
                    Response::Center => boxes.clip_by(n, new, |b, _, color| b.to_center(color)),
                    Response::Current => boxes.clip_by(n, new, |b, i, color| {
                        b.to_current(color, own.map(|row| row[i]))
                    }),
                    Response::Ellipsoid => {
                        boxes.clip_by(n, new, |b, _, color| b.to_ellipsoid(color, axes));
                    }
                }
            }
        }
        let mut limits = [0.0; SEGMENT];
        if let Some(max_channel) = &self.max_channel {
            let mut columns: Columns = [0.0; _];
            for i in 0..N {
                let [row] = max_channel.columns(run, offset(i));
                for (column, &largest) in columns[..n + LANES].iter_mut().zip(row) {
                    *column = larger(*column, largest);
                }
            }
            for i in 0..n {
                for dx in 0..N {
                    limits[i] = larger(limits[i], columns[i + dx]);
                }
            }
        }
        space.replace(n, history, new, exposure, &limits);
    }
}

/// Statistics of the 3×3 neighbourhoods of a span, in the space of the box; valid where `count` is above 0.
pub(crate) struct Statistics<'a> {
    pub count: &'a Row,
    pub mean: &'a [Row; 3],
    pub low: &'a [Row; 3],
    pub high: &'a [Row; 3],
}

impl Window {
    #[inline(always)]
    pub fn statistics(&mut self, run: Run) -> Statistics<'_> {
        let rows = std::array::from_fn(|i| self.converted.columns(run, i as isize - 1));
        let boxes = &mut self.boxes;
        boxes.find_ranges::<3>(lanes(run), rows);
        boxes.find_deviations(lanes(run), rows, |_, _, range| range);
        let Boxes {
            count,
            mean,
            low,
            high,
            ..
        } = &**boxes;
        Statistics {
            count,
            mean,
            low,
            high,
        }
    }
}

struct ClipRun<'a> {
    window: &'a mut Window,
    run: Run,
    history: &'a mut [Row; 3],
}

impl Outlined for ClipRun<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self {
            window,
            run,
            history,
        } = self;
        match window.params.radius {
            1 => window.clip_among::<3>(run, history),
            _ => window.clip_among::<5>(run, history),
        }
    }
}

impl Space {
    /// Converts RGB to this space; NaN where missing.
    #[inline(always)]
    fn convert(self, colors: [&[f32]; 3], into: [&mut [f32]; 3], exposure: f32) {
        #[inline(always)]
        fn each([r, g, b]: [&[f32]; 3], into: [&mut [f32]; 3], of: impl Fn(Color) -> Color) {
            let n = r.len();
            let [o0, o1, o2] = into.map(|row| &mut row[..n]);
            let (g, b) = (&g[..n], &b[..n]);
            for i in 0..n {
                let rgb = [r[i], g[i], b[i]];
                let (present, color) = (is_present(rgb), of(rgb));
                let [c0, c1, c2] = color.map(|c| if present { c } else { f32::NAN });
                (o0[i], o1[i], o2[i]) = (c0, c1, c2);
            }
        }
        match self {
            Self::Rgb => each(colors, into, |rgb| Self::Rgb.of(rgb, exposure)),
            Self::YCoCg => each(colors, into, |rgb| Self::YCoCg.of(rgb, exposure)),
            Self::ToneMappedRgb => each(colors, into, |rgb| Self::ToneMappedRgb.of(rgb, exposure)),
            Self::ToneMappedYCoCg => {
                each(colors, into, |rgb| Self::ToneMappedYCoCg.of(rgb, exposure));
            }
        }
    }

    /// Overwrites `colors` (RGB) with `new` (this space), except where `new` is NaN. The largest channel of tone-mapped
    /// results is limited to that of the old colour or to `limits`.
    #[inline(always)]
    fn replace(self, n: usize, colors: &mut [Row; 3], new: &[Row; 3], exposure: f32, limits: &Row) {
        #[inline(always)]
        fn each(
            n: usize,
            [r, g, b]: &mut [Row; 3],
            [n0, n1, n2]: &[Row; 3],
            limits: &Row,
            to_rgb: impl Fn(Color, f32) -> Color,
        ) {
            for i in 0..n {
                let rgb = [r[i], g[i], b[i]];
                let new = to_rgb([n0[i], n1[i], n2[i]], larger(max_channel(rgb), limits[i]));
                let stays = n0[i].is_nan() | !is_present(rgb);
                let pick = |c: usize| if stays { rgb[c] } else { new[c] };
                (r[i], g[i], b[i]) = (pick(0), pick(1), pick(2));
            }
        }
        match self {
            Self::Rgb => each(n, colors, new, limits, |c, limit| {
                Self::Rgb.to_rgb(c, exposure, limit)
            }),
            Self::YCoCg => each(n, colors, new, limits, |c, limit| {
                Self::YCoCg.to_rgb(c, exposure, limit)
            }),
            Self::ToneMappedRgb => each(n, colors, new, limits, |c, limit| {
                Self::ToneMappedRgb.to_rgb(c, exposure, limit)
            }),
            Self::ToneMappedYCoCg => each(n, colors, new, limits, |c, limit| {
                Self::ToneMappedYCoCg.to_rgb(c, exposure, limit)
            }),
        }
    }
}

/// The largest channel of each pixel; 0 where missing.
#[inline(always)]
fn find_max_channels([r, g, b]: [&[f32]; 3], into: &mut [f32]) {
    let n = into.len();
    let (r, g, b) = (&r[..n], &g[..n], &b[..n]);
    for i in 0..n {
        let rgb = [r[i], g[i], b[i]];
        into[i] = if is_present(rgb) {
            max_channel(rgb)
        } else {
            0.0
        };
    }
}

/// The valid colours of a pixel's neighbourhood, compacted, and their number.
#[inline(always)]
fn taps<const N: usize>(i: usize, rows: [[&Columns; 3]; N]) -> ([Color; 25], usize) {
    let mut taps = [[0.0; 3]; 25];
    let mut count = 0;
    for row in rows {
        for x in i..i + N {
            let tap = row.map(|row| row[x]);
            if !tap[0].is_nan() {
                taps[count] = tap;
                count += 1;
            }
        }
    }
    (taps, count)
}

/// The point inside the hull towards which history is clipped: the pixel's current colour, which is one of the hull's
/// points, or the neighbourhood's mean where the current colour is missing.
#[inline(always)]
fn find_targets<const N: usize>(n: usize, rows: [[&Columns; 3]; N], targets: &mut [Row; 3]) {
    for (target, row) in targets.iter_mut().zip(rows[N / 2]) {
        target[..n].copy_from_slice(&row[N / 2..][..n]);
    }
    for i in 0..n {
        if targets[0][i].is_nan() {
            let (taps, count) = taps(i, rows);
            let mean = mean(&taps[..count]);
            for c in 0..3 {
                targets[c][i] = mean[c];
            }
        }
    }
}

#[inline(always)]
fn enter_polygons<const N: usize>(n: usize, rows: [[&Columns; 3]; N], colors: &mut [Row; 3]) {
    let mut targets = [[0.0; SEGMENT]; 3];
    find_targets(n, rows, &mut targets);
    for i in 0..n {
        let (taps, count) = taps(i, rows);
        let [color, target] = [&*colors, &targets].map(|rows| rows.each_ref().map(|row| row[i]));
        let new = if count == 0 || color[0].is_nan() {
            None
        } else {
            Polygon::of(&taps[..count]).enter(color, target)
        };
        let new = new.unwrap_or([f32::NAN; 3]);
        for c in 0..3 {
            colors[c][i] = new[c];
        }
    }
}

#[inline(always)]
fn mean(taps: &[Color]) -> Color {
    let weight = 1.0 / taps.len() as f32;
    [0, 1, 2].map(|c| taps.iter().fold(0.0, |sum, tap| sum + tap[c]) * weight)
}

/// Tolerance of the inside test, relative to the box's largest coordinate: rounding must not decide where a neighbourhood
/// is flat along an axis.
const TOLERANCE: f32 = 1e-6;

/// Statistics of a span's neighbourhoods, structure of arrays.
struct Boxes {
    count: Row,
    mean: [Row; 3],
    deviation: [Row; 3],
    low: [Row; 3],
    high: [Row; 3],
    sums: ColumnSums,
    ranges: ColumnRanges,
}

/// Statistics of single columns of height N, from which those of N×N neighbourhoods are merged.
struct ColumnSums {
    count: Columns,
    sum: [Columns; 3],
    mean: [Columns; 3],
    /// Sum of squared deviations from the column's mean.
    squares: [Columns; 3],
}

impl ColumnSums {
    #[inline(always)]
    fn find<const N: usize>(&mut self, n: usize, rows: [[&Columns; 3]; N]) {
        for i in 0..n.min(SEGMENT) + LANES {
            // Conversion made a missing colour NaN in every channel, so one channel tells.
            let mut there = [true; N];
            let mut count = 0.0;
            for k in 0..N {
                there[k] = !rows[k][0][i].is_nan();
                count += if there[k] { 1.0 } else { 0.0 };
            }
            self.count[i] = count;
            let weight = reciprocal::<N>(count);
            for c in 0..3 {
                let mut sum = 0.0;
                for k in 0..N {
                    sum += if there[k] { rows[k][c][i] } else { 0.0 };
                }
                let mean = sum * weight;
                let mut squares = 0.0;
                for k in 0..N {
                    let off = rows[k][c][i] - mean;
                    squares += if there[k] { off * off } else { 0.0 };
                }
                self.sum[c][i] = sum;
                self.mean[c][i] = mean;
                self.squares[c][i] = squares;
            }
        }
    }
}

/// 1/count for counts up to `N`, by selects instead of a division; 1 for a count of 0.
#[inline(always)]
fn reciprocal<const N: usize>(count: f32) -> f32 {
    (2..=N).fold(1.0, |found, n| {
        if count == n as f32 {
            1.0 / n as f32
        } else {
            found
        }
    })
}

/// Minima and maxima of single columns.
struct ColumnRanges {
    low: [Columns; 3],
    high: [Columns; 3],
}

impl ColumnRanges {
    #[inline(always)]
    fn find<const N: usize>(&mut self, n: usize, rows: [[&Columns; 3]; N]) {
        for c in 0..3 {
            for i in 0..n.min(SEGMENT) + LANES {
                let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
                for row in rows {
                    let tap = row[c][i];
                    (low, high) = (smaller(tap, low), larger(tap, high));
                }
                (self.low[c][i], self.high[c][i]) = (low, high);
            }
        }
    }
}

impl Boxes {
    #[inline(always)]
    fn new() -> Self {
        Self {
            count: [0.0; SEGMENT],
            mean: [[0.0; SEGMENT]; 3],
            deviation: [[0.0; SEGMENT]; 3],
            low: [[0.0; SEGMENT]; 3],
            high: [[0.0; SEGMENT]; 3],
            sums: ColumnSums {
                count: [0.0; _],
                sum: [[0.0; _]; 3],
                mean: [[0.0; _]; 3],
                squares: [[0.0; _]; 3],
            },
            ranges: ColumnRanges {
                low: [[0.0; _]; 3],
                high: [[0.0; _]; 3],
            },
        }
    }

    /// Computes the boxes of a span from the valid neighbours inside the image.
    #[inline(always)]
    fn find<const N: usize>(
        &mut self,
        n: usize,
        rows: [[&Columns; 3]; N],
        bounds: Bounds,
        gamma: f32,
    ) {
        let n = n.min(SEGMENT);
        if bounds != Bounds::Variance {
            self.find_ranges(n, rows);
        }
        if bounds == Bounds::Rounded {
            self.round(n, rows);
        }
        match bounds {
            Bounds::Variance => self.find_deviations(n, rows, |mean, reach, _| {
                [mean - gamma * reach, mean + gamma * reach]
            }),
            Bounds::Intersection => self.find_deviations(n, rows, |mean, reach, [low, high]| {
                [
                    larger(low, mean - gamma * reach),
                    smaller(high, mean + gamma * reach),
                ]
            }),
            _ => {}
        }
    }

    #[inline(always)]
    fn find_ranges<const N: usize>(&mut self, n: usize, rows: [[&Columns; 3]; N]) {
        self.ranges.find(n, rows);
        let columns = &self.ranges;
        for c in 0..3 {
            for i in 0..n {
                let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
                for dx in 0..N {
                    low = smaller(columns.low[c][i + dx], low);
                    high = larger(columns.high[c][i + dx], high);
                }
                (self.low[c][i], self.high[c][i]) = (low, high);
            }
        }
        for i in 0..n {
            self.count[i] = if self.low[0][i] <= self.high[0][i] {
                1.0
            } else {
                0.0
            };
        }
    }

    /// Averages the range of the square with that of the cross.
    #[inline(always)]
    fn round<const N: usize>(&mut self, n: usize, rows: [[&Columns; 3]; N]) {
        let columns = &self.ranges;
        for c in 0..3 {
            for i in 0..n {
                let (mut low, mut high) = (columns.low[c][i + N / 2], columns.high[c][i + N / 2]);
                for dx in 0..N {
                    let tap = rows[N / 2][c][i + dx];
                    (low, high) = (smaller(tap, low), larger(tap, high));
                }
                // With the whole cross missing, keep the square's range.
                let some = low <= high;
                let half = |a: f32, b: f32| if some { 0.5 * (a + b) } else { a };
                self.low[c][i] = half(self.low[c][i], low);
                self.high[c][i] = half(self.high[c][i], high);
            }
        }
    }

    /// Computes means, deviations, and the bounds that `bounds` makes of them and the range.
    #[inline(always)]
    fn find_deviations<const N: usize>(
        &mut self,
        n: usize,
        rows: [[&Columns; 3]; N],
        bounds: impl Fn(f32, f32, [f32; 2]) -> [f32; 2],
    ) {
        self.sums.find(n, rows);
        let columns = &self.sums;
        for i in 0..n {
            let mut count = 0.0;
            for dx in 0..N {
                count += columns.count[i + dx];
            }
            self.count[i] = count;
            let weight = 1.0 / count;
            for c in 0..3 {
                let mut sum = 0.0;
                for dx in 0..N {
                    sum += columns.sum[c][i + dx];
                }
                let mean = sum * weight;
                let mut squares = 0.0;
                for dx in 0..N {
                    let off = columns.mean[c][i + dx] - mean;
                    squares += columns.squares[c][i + dx] + columns.count[i + dx] * (off * off);
                }
                let deviation = (squares * weight).sqrt();
                let range = [self.low[c][i], self.high[c][i]];
                [self.low[c][i], self.high[c][i]] = bounds(mean, deviation, range);
                self.mean[c][i] = mean;
                self.deviation[c][i] = deviation;
            }
        }
    }

    /// Replaces each colour by what `clip` returns: the clipped colour, or NaN for a colour that stays.
    #[inline(always)]
    fn clip_by(
        &self,
        n: usize,
        [c0, c1, c2]: &mut [Row; 3],
        clip: impl Fn(&Neighborhood, usize, Color) -> Color,
    ) {
        for i in 0..n.min(SEGMENT) {
            let color = [c0[i], c1[i], c2[i]];
            [c0[i], c1[i], c2[i]] = clip(&self.at(i), i, color);
        }
    }

    #[inline(always)]
    fn at(&self, i: usize) -> Neighborhood {
        let of = |planes: &[Row; 3]| [planes[0][i], planes[1][i], planes[2][i]];
        let (low, high) = (of(&self.low), of(&self.high));
        let largest = (low.iter().zip(high)).fold(0.0_f32, |most, (low, high)| {
            larger(larger(most, low.abs()), high.abs())
        });
        let tolerance = TOLERANCE * largest;
        Neighborhood {
            empty: self.count[i] == 0.0,
            mean: of(&self.mean),
            deviation: of(&self.deviation),
            low,
            high,
            padded: [
                low.map(|low| low - tolerance),
                high.map(|high| high + tolerance),
            ],
            tolerance,
        }
    }
}

/// Statistics of one pixel's neighbourhood.
struct Neighborhood {
    empty: bool,
    mean: Color,
    deviation: Color,
    low: Color,
    high: Color,
    /// The box, enlarged by the tolerance.
    padded: [Color; 2],
    tolerance: f32,
}

/// Each response returns the clipped colour, or NaN for a colour inside.
impl Neighborhood {
    #[inline(always)]
    fn contains(&self, color: Color) -> bool {
        let [low, high] = self.padded;
        let inside = |c: usize| (low[c] <= color[c]) & (color[c] <= high[c]);
        self.empty | (inside(0) & inside(1) & inside(2))
    }

    #[inline(always)]
    fn unless_inside(&self, color: Color, clipped: Color) -> Color {
        let inside = self.contains(color);
        clipped.map(|c| if inside { f32::NAN } else { c })
    }

    #[inline(always)]
    fn clamped(&self, color: Color) -> Color {
        [0, 1, 2].map(|c| smaller(larger(color[c], self.low[c]), self.high[c]))
    }

    #[inline(always)]
    fn center(&self) -> Color {
        [0, 1, 2].map(|c| 0.5 * (self.low[c] + self.high[c]))
    }

    #[inline(always)]
    fn clamp(&self, color: Color) -> Color {
        let clamped = self.clamped(color);
        self.unless_inside(color, clamped)
    }

    #[inline(always)]
    fn to_center(&self, color: Color) -> Color {
        let ([low, high], center) = (self.padded, self.center());
        // 0/0 where the colour is at the centre along an axis: `smaller` then keeps the other axes' t.
        let t = (0..3).fold(1.0, |t, c| {
            smaller(0.5 * (high[c] - low[c]) / (color[c] - center[c]).abs(), t)
        });
        let clipped = self.clamped([0, 1, 2].map(|c| center[c] + t * (color[c] - center[c])));
        self.unless_inside(color, clipped)
    }

    #[inline(always)]
    fn to_current(&self, color: Color, own: Color) -> Color {
        let (center, clamped) = (self.center(), self.clamped(own));
        let missing = own[0].is_nan();
        let target = [0, 1, 2].map(|c| if missing { center[c] } else { clamped[c] });
        let [low, high] = self.padded;
        let exit = |c: usize| {
            let below = color[c] < low[c];
            let bound = if below { self.low[c] } else { self.high[c] };
            let t = (bound - target[c]) / (color[c] - target[c]);
            if below | (color[c] > high[c]) { t } else { 1.0 }
        };
        let t = smaller(exit(0), smaller(exit(1), exit(2)));
        let clipped = self.clamped(toward(color, target, t));
        self.unless_inside(color, clipped)
    }

    /// `axes` are the half-axes in standard deviations.
    #[inline(always)]
    fn to_ellipsoid(&self, color: Color, axes: Color) -> Color {
        let v = [0, 1, 2].map(|c| {
            ratio(
                color[c] - self.mean[c],
                axes[c] * self.deviation[c] + self.tolerance,
            )
        });
        let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let clipped = [0, 1, 2].map(|c| self.mean[c] + (color[c] - self.mean[c]) / length);
        let moves = (length > 1.0) & !self.empty;
        clipped.map(|c| if moves { c } else { f32::NAN })
    }
}

/// |distance| / half_axis; 0/0 counts as 0.
#[inline(always)]
fn ratio(distance: f32, half_axis: f32) -> f32 {
    let ratio = distance.abs() / half_axis;
    if distance == 0.0 { 0.0 } else { ratio }
}
