//! Neighbourhood clipping: history is held to the colours that the current frame has around the pixel.
//!
//! Statistics of the 3×3 or 5×5 neighbourhood of the current colour give a box, in a colour space; a history colour
//! outside is brought to it.
//! - **box**: the range of the neighbourhood; the mean of the ranges of the square and of the cross, which is rounder
//!   (Karis 2014, *High Quality Temporal Supersampling*); mean ± γ standard deviations (Salvi 2016, *An Excursion in
//!   Temporal Supersampling*); or the intersection of the first and the last. Instead of a box, the convex hull, for the
//!   response "current" alone: exact in chrominance, with the range of Y; or of the whole colour, as a polytope of thirteen
//!   slabs (see [`super::hull`]).
//! - **space**: RGB, YCoCg, or either after c / (1 + max(r, g, b)), which keeps single bright pixels from opening the box
//!   (Lottes 2016, *Optimized Reversible Tonemapper for Resolve*).
//! - **response**: each channel clamped; clipped on the way to the box's centre (Playdead 2016, *Temporal Reprojection
//!   Anti-Aliasing in INSIDE*); clipped on the way to the current colour, which is first clamped into the box, since
//!   otherwise one outside its own box would return bad history whole; or onto the ellipsoid of half-axes
//!   γσ · (1.7, 1, 1), wider in luminance (FSR 3.1).
//!
//! Inputs: history (3), colour (3). Output: history; a colour inside keeps its bits. Pixels of the neighbourhood that lie
//! outside the image or are missing do not count; where none counts, and where history is missing, it stays.

use std::ops::Range;

use super::hull::{Hull, Polygon, Polytope, enter, toward};
use crate::error::{Error, Result, in_range};
use crate::image::{BandMut, Image, View};
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
    fn of(self, rgb: Color) -> Color {
        match self {
            Self::Rgb => rgb,
            Self::YCoCg => ycocg(rgb),
            Self::ToneMappedRgb => tone_mapped(rgb),
            Self::ToneMappedYCoCg => ycocg(tone_mapped(rgb)),
        }
    }

    #[inline(always)]
    fn to_rgb(self, color: Color) -> Color {
        match self {
            Self::Rgb => color,
            Self::YCoCg => from_ycocg(color),
            Self::ToneMappedRgb => untone_mapped(color),
            Self::ToneMappedYCoCg => untone_mapped(from_ycocg(color)),
        }
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
fn tone_mapped(rgb: Color) -> Color {
    let scale = 1.0 / (1.0 + brightest(rgb));
    rgb.map(|c| c * scale)
}

#[inline(always)]
fn untone_mapped(rgb: Color) -> Color {
    // Boxes in YCoCg have corners beyond the range of the curve; a million is as bright as it gets.
    let scale = 1.0 / (1.0 - brightest(rgb)).max(1e-6);
    rgb.map(|c| c * scale)
}

/// Brings the colours of `history` to those that `color` has around each pixel.
pub fn clip_history(history: View, color: View, params: Params) -> Image {
    let size = color.size;
    let mut converted = Image::new(size, 3);
    rows::run(
        &Convert {
            color,
            space: params.space,
        },
        size.height,
        converted.bands(),
    );
    let mut clipped = Image::new(size, 3);
    let kernel = Clip {
        history,
        color: converted.view(),
        params,
    };
    rows::run(&kernel, size.height, clipped.bands());
    clipped
}

struct Convert<'a> {
    color: View<'a>,
    space: Space,
}

impl<'a> Kernel for Convert<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let [r, g, b] = self.color.rows(y);
            let [o0, o1, o2] = out.rows(y);
            for x in 0..r.len() {
                let rgb = [r[x], g[x], b[x]];
                let color = if is_present(rgb) {
                    self.space.of(rgb)
                } else {
                    [f32::NAN; 3]
                };
                [o0[x], o1[x], o2[x]] = color;
            }
        }
    }
}

#[inline(always)]
fn is_present([r, g, b]: Color) -> bool {
    r.is_finite() & g.is_finite() & b.is_finite()
}

struct Clip<'a> {
    history: View<'a>,
    /// In the space of the box; NaN where missing.
    color: View<'a>,
    params: Params,
}

impl<'a> Kernel for Clip<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: BandMut<'a>) {
        for y in rows {
            let [r, g, b] = self.history.rows(y);
            let [o0, o1, o2] = out.rows(y);
            for x in 0..r.len() {
                let rgb = [r[x], g[x], b[x]];
                let clipped = if is_present(rgb) {
                    self.clipped(rgb, x, y)
                } else {
                    None
                };
                [o0[x], o1[x], o2[x]] =
                    clipped.map_or(rgb, |color| self.params.space.to_rgb(color));
            }
        }
    }
}

impl Clip<'_> {
    #[inline(always)]
    fn at(&self, i: usize) -> Color {
        [0, 1, 2].map(|channel| self.color.plane(channel)[i])
    }

    /// Where a history colour goes, in the space of the box; `None` where it stays.
    #[inline(always)]
    fn clipped(&self, rgb: Color, x: usize, y: usize) -> Option<Color> {
        let mut taps = [[0.0; 3]; 25];
        let (taps, cross) = self.neighbors(x, y, &mut taps);
        if taps.is_empty() {
            return None;
        }
        let color = self.params.space.of(rgb);
        let own = self.at(y * self.color.size.width + x);
        match self.params.bounds {
            Bounds::Hull => return into_hull(&Polytope::of(taps), color, own, taps),
            Bounds::ChromaHull => return into_hull(&Polygon::of(taps), color, own, taps),
            _ => {}
        }
        let Statistics {
            mean,
            deviation,
            low,
            high,
        } = self.statistics(taps, cross);
        if self.params.response == Response::Ellipsoid {
            let axes = self.params.space.axes();
            let half = [0, 1, 2].map(|c| self.params.gamma * deviation[c] * axes[c]);
            let v = [0, 1, 2].map(|c| beyond(color[c] - mean[c], half[c]));
            let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
            return (length > 1.0)
                .then(|| [0, 1, 2].map(|c| mean[c] + (color[c] - mean[c]) / length));
        }
        if (0..3).all(|c| low[c] <= color[c] && color[c] <= high[c]) {
            return None;
        }
        let held = |color: Color| [0, 1, 2].map(|c| color[c].max(low[c]).min(high[c]));
        let center = [0, 1, 2].map(|c| 0.5 * (low[c] + high[c]));
        Some(match self.params.response {
            Response::Center => {
                let share = |c: usize| beyond(color[c] - center[c], 0.5 * (high[c] - low[c]));
                let most = share(0).max(share(1)).max(share(2));
                held([0, 1, 2].map(|c| center[c] + (color[c] - center[c]) / most))
            }
            Response::Current => {
                let target = if own[0].is_nan() { center } else { held(own) };
                let exit = |c: usize| {
                    let bound = if color[c] < low[c] { low[c] } else { high[c] };
                    let outside = color[c] < low[c] || color[c] > high[c];
                    if outside {
                        (bound - target[c]) / (color[c] - target[c])
                    } else {
                        1.0
                    }
                };
                held(toward(color, target, exit(0).min(exit(1)).min(exit(2))))
            }
            _ => held(color),
        })
    }

    /// The neighbours that are inside and present, written to `taps`, and the extent of the cross among them.
    #[inline(always)]
    fn neighbors<'t>(
        &self,
        x: usize,
        y: usize,
        taps: &'t mut [Color; 25],
    ) -> (&'t [Color], Extent) {
        let (size, radius) = (self.color.size, self.params.radius);
        let mut count = 0;
        let mut cross = Extent::EMPTY;
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                let (x, y) = (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
                if x < size.width && y < size.height {
                    let color = self.at(y * size.width + x);
                    if !color[0].is_nan() {
                        taps[count] = color;
                        count += 1;
                        if dx == 0 || dy == 0 {
                            cross.include(color);
                        }
                    }
                }
            }
        }
        (&taps[..count], cross)
    }

    #[inline(always)]
    fn statistics(&self, taps: &[Color], cross: Extent) -> Statistics {
        let mut square = Extent::EMPTY;
        taps.iter().for_each(|&tap| square.include(tap));
        let mean = mean(taps);
        let share = 1.0 / taps.len() as f32;
        // From the mean, not from the mean of squares, which would cancel.
        let deviation = [0, 1, 2].map(|c| {
            let squares = taps.iter().fold(0.0, |sum, tap| {
                sum + (tap[c] - mean[c]) * (tap[c] - mean[c])
            });
            (squares * share).sqrt()
        });
        let by = |sign: f32| [0, 1, 2].map(|c| mean[c] + sign * self.params.gamma * deviation[c]);
        let (low, high) = match self.params.bounds {
            // A hull needs no box.
            Bounds::MinMax | Bounds::Hull | Bounds::ChromaHull => (square.low, square.high),
            // Where all of the cross is missing, the square is all there is.
            Bounds::Rounded if cross.low[0] > cross.high[0] => (square.low, square.high),
            Bounds::Rounded => {
                let half = |a: Color, b: Color| [0, 1, 2].map(|c| 0.5 * (a[c] + b[c]));
                (half(square.low, cross.low), half(square.high, cross.high))
            }
            Bounds::Variance => (by(-1.0), by(1.0)),
            Bounds::Intersection => {
                let (low, high) = (by(-1.0), by(1.0));
                (
                    [0, 1, 2].map(|c| low[c].max(square.low[c])),
                    [0, 1, 2].map(|c| high[c].min(square.high[c])),
                )
            }
        };
        Statistics {
            mean,
            deviation,
            low,
            high,
        }
    }
}

#[inline(always)]
fn mean(taps: &[Color]) -> Color {
    let share = 1.0 / taps.len() as f32;
    [0, 1, 2].map(|c| taps.iter().fold(0.0, |sum, tap| sum + tap[c]) * share)
}

/// On the way to the pixel's own colour, which is one of the taps, or to their mean where it is missing.
#[inline(always)]
fn into_hull(hull: &impl Hull, color: Color, own: Color, taps: &[Color]) -> Option<Color> {
    enter(hull, color, if own[0].is_nan() { mean(taps) } else { own })
}

struct Statistics {
    mean: Color,
    deviation: Color,
    low: Color,
    high: Color,
}

#[derive(Clone, Copy)]
struct Extent {
    low: Color,
    high: Color,
}

impl Extent {
    const EMPTY: Self = Self {
        low: [f32::INFINITY; 3],
        high: [f32::NEG_INFINITY; 3],
    };

    #[inline(always)]
    fn include(&mut self, color: Color) {
        for c in 0..3 {
            self.low[c] = self.low[c].min(color[c]);
            self.high[c] = self.high[c].max(color[c]);
        }
    }
}

/// |distance| / half, where nothing is no share of nothing.
#[inline(always)]
fn beyond(distance: f32, half: f32) -> f32 {
    if distance == 0.0 {
        0.0
    } else {
        distance.abs() / half
    }
}
