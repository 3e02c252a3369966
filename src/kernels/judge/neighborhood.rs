//! Neighbourhood clipping: history is held to the colours that the current frame has around the pixel.
//!
//! Statistics of the 3×3 or 5×5 neighbourhood of the current colour give a box, in a colour space; a history colour
//! outside is brought to it.
//! - **box**: the range of the neighbourhood; the mean of the ranges of the square and of the cross, which is rounder
//!   (Karis 2014, *High Quality Temporal Supersampling*); mean ± γ standard deviations (Salvi 2016, *An Excursion in
//!   Temporal Supersampling*); or the intersection of the first and the last. Instead of a box, the convex hull, for the
//!   response "current" alone: exact in chrominance, with the range of Y; or of the whole colour, as a polytope of thirteen
//!   slabs (see [`super::hull`]).
//! - **space**: RGB, YCoCg, or either after c / (e + max(r, g, b)), which keeps single bright pixels from opening the box
//!   (Lottes 2016, *Optimized Reversible Tonemapper for Resolve*), with e the exposure. The corners of such a box may lie
//!   beyond the range of the curve: what is clipped becomes no brighter than history and all of the neighbourhood.
//! - **response**: each channel clamped; clipped on the way to the box's centre (Playdead 2016, *Temporal Reprojection
//!   Anti-Aliasing in INSIDE*); clipped on the way to the current colour, which is first clamped into the box, since
//!   otherwise one outside its own box would return bad history whole; or onto the ellipsoid of half-axes
//!   γσ · (1.7, 1, 1), wider in luminance (FSR 3.1).
//!
//! Who is outside a box, and how far, is judged with room for a millionth of the box's largest coordinate, so that where a
//! neighbourhood is flat along an axis, rounding does not decide.
//!
//! Inputs: history (3), colour (3). Output: history; a colour inside keeps its bits. Pixels of the neighbourhood that lie
//! outside the image or are missing do not count; where none counts, and where history is missing, it stays.

use std::ops::Range;

use super::hull::{Hull, Polygon, Polytope, enter, toward};
use crate::error::{Error, Result, in_range};
use crate::image::{BandMut, Image, Run, SEGMENT, Tap, View};
use crate::math::is_present;
use crate::rows::{self, Kernel};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    MinMax,
    Rounded,
    Variance,
    Intersection,
    Hull,
    ChromaHull,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    Rgb,
    YCoCg,
    ToneMappedRgb,
    ToneMappedYCoCg,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Response {
    Clamp,
    Center,
    Current,
    Ellipsoid,
}

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Variance.
    pub bounds: Bounds,
    /// Half the side of the variance box in standard deviations; ≥ 0; 1.
    pub gamma: f32,
    /// The neighbourhood reaches so many pixels to each side; 1 or 2; 1.
    pub radius: isize,
    /// YCoCg.
    pub space: Space,
    /// Center.
    pub response: Response,
    /// The radiance that tone curves take for 1; above 0; 1.
    pub exposure: f32,
}

impl Params {
    pub const BOUNDS: [(&str, Bounds); 6] = [
        ("minmax", Bounds::MinMax),
        ("rounded", Bounds::Rounded),
        ("variance", Bounds::Variance),
        ("intersection", Bounds::Intersection),
        ("hull", Bounds::Hull),
        ("chroma-hull", Bounds::ChromaHull),
    ];
    pub const SPACES: [(&str, Space); 4] = [
        ("rgb", Space::Rgb),
        ("ycocg", Space::YCoCg),
        ("tonemapped-rgb", Space::ToneMappedRgb),
        ("tonemapped-ycocg", Space::ToneMappedYCoCg),
    ];
    pub const RESPONSES: [(&str, Response); 4] = [
        ("clamp", Response::Clamp),
        ("center", Response::Center),
        ("current", Response::Current),
        ("ellipsoid", Response::Ellipsoid),
    ];
    pub const WINDOWS: [(&str, isize); 2] = [("3x3", 1), ("5x5", 2)];

    pub fn check(&self) -> Result<()> {
        in_range("gamma", self.gamma, "a finite number from 0", |v| {
            v >= 0.0 && v.is_finite()
        })?;
        in_range("exposure", self.exposure, "a finite number above 0", |v| {
            v > 0.0 && v.is_finite()
        })?;
        let response = name_of(self.response, &Self::RESPONSES);
        let bounds = name_of(self.bounds, &Self::BOUNDS);
        if self.response == Response::Ellipsoid && self.bounds != Bounds::Variance {
            let expected = "\"variance\" for response \"ellipsoid\"";
            return Err(Error::value("box", expected, bounds));
        }
        let hull = matches!(self.bounds, Bounds::Hull | Bounds::ChromaHull);
        if hull && self.response != Response::Current {
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

type Color = [f32; 3];

impl Space {
    #[inline(always)]
    fn of(self, rgb: Color, exposure: f32) -> Color {
        match self {
            Self::Rgb => rgb,
            Self::YCoCg => ycocg(rgb),
            Self::ToneMappedRgb => tone_mapped(rgb, exposure),
            Self::ToneMappedYCoCg => ycocg(tone_mapped(rgb, exposure)),
        }
    }

    /// Tone-mapped colours become no brighter than `most`.
    #[inline(always)]
    fn to_rgb(self, color: Color, exposure: f32, most: f32) -> Color {
        match self {
            Self::Rgb => color,
            Self::YCoCg => from_ycocg(color),
            Self::ToneMappedRgb => untone_mapped(color, exposure, most),
            Self::ToneMappedYCoCg => untone_mapped(from_ycocg(color), exposure, most),
        }
    }

    fn is_tone_mapped(self) -> bool {
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

#[inline(always)]
fn ycocg([r, g, b]: Color) -> Color {
    [
        0.25 * r + 0.5 * g + 0.25 * b,
        0.5 * r - 0.5 * b,
        -0.25 * r + 0.5 * g - 0.25 * b,
    ]
}

#[inline(always)]
fn from_ycocg([y, co, cg]: Color) -> Color {
    [y - cg + co, y + cg, y - cg - co]
}

#[inline(always)]
fn brightest([r, g, b]: Color) -> f32 {
    r.max(g).max(b).max(0.0)
}

#[inline(always)]
fn tone_mapped(rgb: Color, exposure: f32) -> Color {
    let scale = 1.0 / (exposure + brightest(rgb));
    rgb.map(|c| c * scale)
}

/// Toned, `most` is most / (e + most); whatever is brighter is scaled down to it.
#[inline(always)]
fn untone_mapped(rgb: Color, exposure: f32, most: f32) -> Color {
    let bright = brightest(rgb);
    let shown = bright.min(most / (exposure + most));
    let scale = exposure / (1.0 - shown) * if bright > shown { shown / bright } else { 1.0 };
    rgb.map(|c| c * scale)
}

/// Brings the colours of `history` to those that `color` has around each pixel.
pub fn clip_history(history: View, color: View, params: Params) -> Image {
    let size = color.size;
    let mut converted = Image::new(size, 4);
    rows::run(&Convert { color, params }, size.height, converted.bands());
    let mut clipped = Image::new(size, 3);
    let kernel = Clip {
        history,
        color: converted.channels(0..3),
        brightest: converted.channels(3..4),
        params,
    };
    rows::run(&kernel, size.height, clipped.bands());
    clipped
}

/// To the space of the box, and the brightest channel.
struct Convert<'a> {
    color: View<'a>,
    params: Params,
}

impl<'a> Kernel for Convert<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let [r, g, b] = self.color.rows(y);
            let [o0, o1, o2, most] = out.rows(y);
            for x in 0..r.len() {
                let rgb = [r[x], g[x], b[x]];
                let color = if is_present(rgb) {
                    self.params.space.of(rgb, self.params.exposure)
                } else {
                    [f32::NAN; 3]
                };
                [o0[x], o1[x], o2[x]] = color;
                most[x] = if is_present(rgb) { brightest(rgb) } else { 0.0 };
            }
        }
    }
}

struct Clip<'a> {
    history: View<'a>,
    /// In the space of the box; NaN where missing.
    color: View<'a>,
    /// Of each pixel, the brightest channel.
    brightest: View<'a>,
    params: Params,
}

impl<'a> Kernel for Clip<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        let width = self.color.size.width;
        for y in rows {
            for x in (0..width).step_by(SEGMENT) {
                let run = Run {
                    y,
                    x,
                    len: SEGMENT.min(width - x),
                };
                let out = out.rows(y).map(|row| &mut row[x..][..run.len]);
                match self.params.bounds {
                    Bounds::Hull => self.each(run, out, |i, color| {
                        self.enter_hull(run, i, color, Polytope::of)
                    }),
                    Bounds::ChromaHull => {
                        self.each(run, out, |i, color| {
                            self.enter_hull(run, i, color, Polygon::of)
                        });
                    }
                    _ => self.clip_to_boxes(run, out),
                }
            }
        }
    }
}

impl Clip<'_> {
    /// Clips the pixels of a run: `clipped` tells where a history colour goes, in the space of the box, or that it stays.
    #[inline(always)]
    fn each(
        &self,
        run: Run,
        [o0, o1, o2]: [&mut [f32]; 3],
        clipped: impl Fn(usize, Color) -> Option<Color>,
    ) {
        let [r, g, b] = self
            .history
            .rows(run.y)
            .map(|row: &[f32]| &row[run.x..][..run.len]);
        let Params {
            space, exposure, ..
        } = self.params;
        let mut most = [0.0_f32; SEGMENT];
        if space.is_tone_mapped() {
            self.for_each_place(run, |at, here, tap| {
                let there = tap.of(here);
                let taps = &self.brightest.row(0, there.y)[there.x..][..there.len];
                for (most, &tap) in most[at..].iter_mut().zip(taps) {
                    *most = most.max(tap);
                }
            });
        }
        for i in 0..run.len {
            let rgb = [r[i], g[i], b[i]];
            let new = clipped(i, space.of(rgb, exposure));
            let most = most[i].max(brightest(rgb));
            let new = new.map_or(rgb, |color| space.to_rgb(color, exposure, most));
            let kept = !is_present(rgb);
            let pick = |c: usize| if kept { rgb[c] } else { new[c] };
            (o0[i], o1[i], o2[i]) = (pick(0), pick(1), pick(2));
        }
    }

    #[inline(always)]
    fn clip_to_boxes(&self, run: Run, out: [&mut [f32]; 3]) {
        let boxes = self.boxes(run);
        let own = self
            .color
            .rows(run.y)
            .map(|row: &[f32]| &row[run.x..][..run.len]);
        match self.params.response {
            Response::Clamp => self.each(run, out, |i, color| boxes.at(i).clamp(color)),
            Response::Center => self.each(run, out, |i, color| boxes.at(i).to_center(color)),
            Response::Current => self.each(run, out, |i, color| {
                boxes.at(i).to_current(color, own.map(|row| row[i]))
            }),
            Response::Ellipsoid => {
                let axes = self
                    .params
                    .space
                    .axes()
                    .map(|axis| self.params.gamma * axis);
                self.each(run, out, |i, color| boxes.at(i).to_ellipsoid(color, axes));
            }
        }
    }

    /// What the neighbours of a run's pixels are, those that are inside and present.
    #[inline(always)]
    fn boxes(&self, run: Run) -> Boxes {
        let Params { bounds, gamma, .. } = self.params;
        let mut boxes = Boxes::new();
        let mut cross = [[f32::INFINITY; SEGMENT], [f32::NEG_INFINITY; SEGMENT]];
        self.for_each_tap(run, |at, _, taps| {
            for (count, tap) in boxes.count[at..].iter_mut().zip(taps[0]) {
                *count += if tap.is_nan() { 0.0 } else { 1.0 };
            }
        });
        for c in 0..3 {
            let (low, high) = (&mut boxes.low[c], &mut boxes.high[c]);
            let (mean, deviation) = (&mut boxes.mean[c], &mut boxes.deviation[c]);
            let uses_range = bounds != Bounds::Variance;
            let uses_variance = matches!(bounds, Bounds::Variance | Bounds::Intersection);
            if uses_range {
                self.for_each_tap(run, |at, _, taps| widen([low, high], at, taps[c]));
            }
            if bounds == Bounds::Rounded {
                cross[0].fill(f32::INFINITY);
                cross[1].fill(f32::NEG_INFINITY);
                let [least, most] = &mut cross;
                self.for_each_tap(run, |at, tap, taps| {
                    if tap.dx == 0 || tap.dy == 0 {
                        widen([least, most], at, taps[c]);
                    }
                });
                for i in 0..run.len {
                    // Where all of the cross is missing, the square is all there is.
                    let some = cross[0][i] <= cross[1][i];
                    let half = |a: f32, b: f32| if some { 0.5 * (a + b) } else { a };
                    low[i] = half(low[i], cross[0][i]);
                    high[i] = half(high[i], cross[1][i]);
                }
            }
            if uses_variance {
                self.for_each_tap(run, |at, _, taps| {
                    for (mean, &tap) in mean[at..].iter_mut().zip(taps[c]) {
                        *mean += if tap.is_nan() { 0.0 } else { tap };
                    }
                });
                for i in 0..run.len {
                    mean[i] *= 1.0 / boxes.count[i];
                }
                // From the mean, not from the mean of squares, which would cancel.
                self.for_each_tap(run, |at, _, taps| {
                    let deviations = deviation[at..].iter_mut().zip(&mean[at..]);
                    for ((deviation, mean), &tap) in deviations.zip(taps[c]) {
                        let square = (tap - mean) * (tap - mean);
                        *deviation += if tap.is_nan() { 0.0 } else { square };
                    }
                });
                for i in 0..run.len {
                    deviation[i] = (deviation[i] * (1.0 / boxes.count[i])).sqrt();
                    let (below, above) = (
                        mean[i] - gamma * deviation[i],
                        mean[i] + gamma * deviation[i],
                    );
                    low[i] = if uses_range { low[i].max(below) } else { below };
                    high[i] = if uses_range {
                        high[i].min(above)
                    } else {
                        above
                    };
                }
            }
        }
        boxes
    }

    /// Calls `f` for each tap of the window with where the part of the run that has it inside begins, and that part.
    #[inline(always)]
    fn for_each_place(&self, run: Run, mut f: impl FnMut(usize, Run, Tap)) {
        let radius = self.params.radius;
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                let tap = Tap { dx, dy, step: 1 };
                if let Some(here) = tap.inside(run, self.color.size) {
                    f(here.x - run.x, here, tap);
                }
            }
        }
    }

    /// The same, with the part's taps.
    #[inline(always)]
    fn for_each_tap(&self, run: Run, mut f: impl FnMut(usize, Tap, [&[f32]; 3])) {
        self.for_each_place(run, |at, here, tap| {
            let there = tap.of(here);
            let taps = self.color.rows(there.y);
            f(
                at,
                tap,
                taps.map(|row: &[f32]| &row[there.x..][..there.len]),
            );
        });
    }

    /// On the way to the pixel's own colour, which is one of the hull's, or to their mean where it is missing.
    #[inline(always)]
    fn enter_hull<H: Hull>(
        &self,
        run: Run,
        i: usize,
        color: Color,
        hull: impl Fn(&[Color]) -> H,
    ) -> Option<Color> {
        let mut taps = [[0.0; 3]; 25];
        let mut count = 0;
        let pixel = Run {
            y: run.y,
            x: run.x + i,
            len: 1,
        };
        let mut own = None;
        self.for_each_tap(pixel, |_, tap, planes| {
            let color = planes.map(|plane| plane[0]);
            if !color[0].is_nan() {
                taps[count] = color;
                count += 1;
                if tap.dx == 0 && tap.dy == 0 {
                    own = Some(color);
                }
            }
        });
        let taps = &taps[..count];
        if taps.is_empty() || !is_present(color) {
            return None;
        }
        enter(&hull(taps), color, own.unwrap_or_else(|| mean(taps)))
    }
}

#[inline(always)]
fn mean(taps: &[Color]) -> Color {
    let share = 1.0 / taps.len() as f32;
    [0, 1, 2].map(|c| taps.iter().fold(0.0, |sum, tap| sum + tap[c]) * share)
}

/// Takes taps, from `at` on, into a range; NaN is none.
#[inline(always)]
fn widen([low, high]: [&mut [f32; SEGMENT]; 2], at: usize, taps: &[f32]) {
    for ((low, high), &tap) in low[at..].iter_mut().zip(&mut high[at..]).zip(taps) {
        *low = low.min(tap);
        *high = high.max(tap);
    }
}

/// Who is outside a box, and how far, is judged with some room, this share of the box's largest coordinate: where a
/// neighbourhood is flat along an axis, rounding shall not decide.
const ROOM: f32 = 1e-6;

/// Statistics of the neighbourhoods of a run's pixels.
struct Boxes {
    count: [f32; SEGMENT],
    mean: [[f32; SEGMENT]; 3],
    deviation: [[f32; SEGMENT]; 3],
    low: [[f32; SEGMENT]; 3],
    high: [[f32; SEGMENT]; 3],
}

impl Boxes {
    #[inline(always)]
    fn new() -> Self {
        Self {
            count: [0.0; SEGMENT],
            mean: [[0.0; SEGMENT]; 3],
            deviation: [[0.0; SEGMENT]; 3],
            low: [[f32::INFINITY; SEGMENT]; 3],
            high: [[f32::NEG_INFINITY; SEGMENT]; 3],
        }
    }

    #[inline(always)]
    fn at(&self, i: usize) -> Neighborhood {
        let of = |planes: &[[f32; SEGMENT]; 3]| [planes[0][i], planes[1][i], planes[2][i]];
        let (low, high) = (of(&self.low), of(&self.high));
        let largest = (low.iter().zip(high)).fold(0.0_f32, |most, (low, high)| {
            most.max(low.abs()).max(high.abs())
        });
        let room = ROOM * largest;
        Neighborhood {
            empty: self.count[i] == 0.0,
            mean: of(&self.mean),
            deviation: of(&self.deviation),
            low,
            high,
            wide: [low.map(|low| low - room), high.map(|high| high + room)],
            room,
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
    /// The box with some room.
    wide: [Color; 2],
    room: f32,
}

/// Where a colour goes; `None` where it stays.
impl Neighborhood {
    #[inline(always)]
    fn keeps(&self, color: Color) -> bool {
        let [low, high] = self.wide;
        let inside = |c: usize| (low[c] <= color[c]) & (color[c] <= high[c]);
        self.empty | (inside(0) & inside(1) & inside(2))
    }

    #[inline(always)]
    fn held(&self, color: Color) -> Color {
        [0, 1, 2].map(|c| color[c].max(self.low[c]).min(self.high[c]))
    }

    #[inline(always)]
    fn center(&self) -> Color {
        [0, 1, 2].map(|c| 0.5 * (self.low[c] + self.high[c]))
    }

    #[inline(always)]
    fn clamp(&self, color: Color) -> Option<Color> {
        let held = self.held(color);
        (!self.keeps(color)).then_some(held)
    }

    #[inline(always)]
    fn to_center(&self, color: Color) -> Option<Color> {
        let ([low, high], center) = (self.wide, self.center());
        let share = |c: usize| beyond(color[c] - center[c], 0.5 * (high[c] - low[c]));
        let most = share(0).max(share(1)).max(share(2));
        let clipped = self.held([0, 1, 2].map(|c| center[c] + (color[c] - center[c]) / most));
        (!self.keeps(color)).then_some(clipped)
    }

    #[inline(always)]
    fn to_current(&self, color: Color, own: Color) -> Option<Color> {
        let (center, held) = (self.center(), self.held(own));
        let target = [0, 1, 2].map(|c| if own[0].is_nan() { center[c] } else { held[c] });
        let [low, high] = self.wide;
        let exit = |c: usize| {
            let below = color[c] < low[c];
            let bound = if below { self.low[c] } else { self.high[c] };
            let share = (bound - target[c]) / (color[c] - target[c]);
            if below | (color[c] > high[c]) {
                share
            } else {
                1.0
            }
        };
        let clipped = self.held(toward(color, target, exit(0).min(exit(1)).min(exit(2))));
        (!self.keeps(color)).then_some(clipped)
    }

    /// The half-axes are multiples of the deviations.
    #[inline(always)]
    fn to_ellipsoid(&self, color: Color, axes: Color) -> Option<Color> {
        let v = [0, 1, 2].map(|c| {
            beyond(
                color[c] - self.mean[c],
                axes[c] * self.deviation[c] + self.room,
            )
        });
        let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        let clipped = [0, 1, 2].map(|c| self.mean[c] + (color[c] - self.mean[c]) / length);
        ((length > 1.0) & !self.empty).then_some(clipped)
    }
}

/// |distance| / half, where nothing is no share of nothing.
#[inline(always)]
fn beyond(distance: f32, half: f32) -> f32 {
    let share = distance.abs() / half;
    if distance == 0.0 { 0.0 } else { share }
}
