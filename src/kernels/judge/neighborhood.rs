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

use std::ops::Range;

pub use super::boxes::Bounds;
use super::boxes::Boxes;
use super::exposure;
use super::hull::{Polygon, enter_hulls, enter_slabs};
use crate::error::{Error, Result, finite_from_0};
use crate::image::{Pixels, Run, SEGMENT, segments};
use crate::lanes::LANES;
use crate::math::{
    Color, from_ycocg, inverse_tone_map, is_present, larger, max_channel, tone_map, ycocg,
};
use crate::pixels::{Columns, PixelsMut, Rolling, Row, lanes, put};
use crate::rows::{self, BAND, Kernel, Outlined, Simd};

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
#[derive(Clone, Copy, Debug, PartialEq)]
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

impl Default for Params {
    fn default() -> Self {
        Self {
            bounds: Bounds::Variance,
            gamma: 1.0,
            radius: 1,
            space: Space::YCoCg,
            response: Response::Center,
            exposure: 1.0,
        }
    }
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
        finite_from_0("gamma", self.gamma)?;
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
                self.history.read_rows(run, &mut clipped);
                window.clip(run, &mut clipped);
                out.write(run, &clipped);
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
                color.read_rows(run, &mut own);
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
