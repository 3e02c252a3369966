//! Dilated motion: each pixel takes the motion of the nearest surface around it.
//!
//! Along an edge, jittered samples of a pixel hit foreground and background in turn. If its history followed whichever
//! the current sample hits, the edge would never be antialiased; if it follows the foreground, the edge moves as one
//! (Karis 2014, *High Quality Temporal Supersampling*). Without depth, the longest motion stands in for the nearest.
//!
//! Away from edges nothing is gained: where motion varies over a surface, as under rotation or zoom, a neighbour's motion
//! misses the pixel's history by up to a pixel and blurs it. So a neighbour may be required to be nearer by a margin m,
//! z < (1 - m) z₀, or its motion to be longer by as much, (1 - m) |v| > |v₀|. The published rule has m = 0.
//!
//! The background beside an object that moves by itself would follow the object's motion and fetch its own texture from the
//! wrong place. So neighbours may be left out whose motion is not that of a still scene. The price is that the edges of such
//! objects are antialiased less.
//!
//! Inputs: motion (2 or 3), depth (1, optional), motion of the still scene (2 or 3, optional). Output: motion. Motion that is
//! not finite is never chosen; depth that is NaN or not above 0 counts as infinite. Ties go to the pixel itself, then to the
//! first neighbour from the top left.

use std::ops::Range;

use crate::error::{Result, in_range};
use crate::image::{Image, Pixels, Run, SEGMENT, View, segments};
use crate::kernels::camera::motion::is_still;
use crate::math::{larger, smaller};
use crate::pixels::{PixelsMut, Rolling, Row, lanes, read_motion};
use crate::rows::{self, Kernel, Simd};

/// The neighbours that are searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Window {
    /// 3×3.
    Square,
    /// The pixel and its four neighbours.
    Cross,
}

impl Window {
    /// Their names.
    pub const NAMES: [(&str, Self); 2] = [("3x3", Self::Square), ("cross", Self::Cross)];
}

/// Parameters of [`dilate_motion`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// The neighbours that are searched.
    pub window: Window,
    /// How much nearer than the pixel a neighbour must be, or how much longer its motion; relative; from 0 to below 1; 0.
    pub margin: f32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            window: Window::Square,
            margin: 0.0,
        }
    }
}

impl Params {
    /// At edges alone, which are steps of depth; less of a difference is the slope of a surface.
    pub const EDGES: Self = Self {
        window: Window::Square,
        margin: 0.1,
    };

    /// An error about the argument `margin` if that is out of range.
    pub fn check(&self, margin: &str) -> Result<()> {
        let expected = "a number from 0 to below 1";
        in_range(margin, self.margin, expected, |m| (0.0..1.0).contains(&m))
    }
}

/// The criterion: the neighbour with the least depth, or with the longest motion.
#[derive(Clone, Copy, Debug)]
pub enum Choice<'a> {
    /// That of the least depth.
    Nearest {
        /// View-space z.
        depth: View<'a>,
        /// The motion of the still scene: neighbours that move by themselves are left out.
        still: Option<Pixels<'a>>,
    },
    /// The longest.
    Longest,
}

impl<'a> Choice<'a> {
    /// The nearest, if there is depth.
    pub fn of(depth: Option<View<'a>>, still: Option<&'a Image>) -> Self {
        let still = still.map(Image::pixels);
        depth.map_or(Self::Longest, |depth| Self::Nearest { depth, still })
    }
}

/// The rank of a pixel for itself, and as a neighbour, among the rows of a [`Dilation`].
const OWN: usize = 0;
const OFFERED: usize = 1;

/// Sliding window of three rows of motion.
pub(crate) struct Dilation<'a> {
    motion: Pixels<'a>,
    choice: Choice<'a>,
    window: Window,
    /// Factor on a pixel's own rank, by which it wins against neighbours within the margin.
    handicap: f32,
    /// A pixel's rank for itself and as a neighbour, then the channels of its motion; the lowest rank wins. The rank is the
    /// depth, or minus the squared length. It is `f32::MAX` for infinite depth and infinity for unknown motion.
    rows: Rolling<5>,
}

impl<'a> Dilation<'a> {
    pub fn new(motion: Pixels<'a>, choice: Choice<'a>, Params { window, margin }: Params) -> Self {
        let rest = 1.0 - margin;
        Self {
            motion,
            choice,
            window,
            handicap: match choice {
                Choice::Nearest { .. } => rest,
                Choice::Longest => 1.0 / (rest * rest),
            },
            rows: Rolling::new(motion.size.width, 1),
        }
    }

    /// Centres the window on row `y`: the row after the previous call's, unless `first`.
    #[inline(always)]
    pub fn roll(&mut self, y: usize, first: bool) {
        for y in self.rows.due(y, first) {
            if let Some(rows) = self.rows.fresh(y, self.motion.size) {
                let row = Run {
                    y: y as usize,
                    x: 0,
                    len: self.motion.size.width,
                };
                rank(&self.motion, self.choice, row, rows);
            }
        }
    }

    /// The dilated motion of a span.
    #[inline(always)]
    pub fn choose(&self, run: Run, chosen: &mut [Row; 3]) {
        self.choose_by::<OFFERED>(run, chosen);
    }

    /// [`Self::choose`] among all neighbours.
    #[inline(always)]
    pub fn choose_of_all(&self, run: Run, chosen: &mut [Row; 3]) {
        self.choose_by::<OWN>(run, chosen);
    }

    /// Whether a neighbour is left out somewhere in a span.
    #[inline(always)]
    pub fn leaves_out(&self, run: Run) -> bool {
        let differs = |dy| {
            let [own, offered, ..] = self.rows.columns(run, dy);
            let mut differs = false;
            for i in 0..run.len + 2 {
                differs |= own[i] != offered[i];
            }
            differs
        };
        [-1, 0, 1].map(differs).contains(&true)
    }

    #[inline(always)]
    fn choose_by<const RANK: usize>(&self, run: Run, chosen: &mut [Row; 3]) {
        match self.window {
            Window::Square => self.choose_among::<RANK>(run, chosen, |_, _| true),
            Window::Cross => {
                self.choose_among::<RANK>(run, chosen, |dx, dy| dx == 1 || dy == 1);
            }
        }
    }

    /// The lowest rank in the 3×3 neighbourhoods of a span: for [`Choice::Nearest`], the dilated depth.
    #[inline(always)]
    pub fn nearest(&self, run: Run, depth: &mut Row) {
        let ranks = [-1, 0, 1].map(|dy| self.rows.columns(run, dy)[0]);
        for i in 0..lanes(run) {
            depth[i] = f32::INFINITY;
            for row in ranks {
                for dx in 0..3 {
                    depth[i] = smaller(row[i + dx], depth[i]);
                }
            }
        }
    }

    #[inline(always)]
    fn choose_among<const RANK: usize>(
        &self,
        run: Run,
        [cx, cy, cz]: &mut [Row; 3],
        has: impl Fn(usize, usize) -> bool,
    ) {
        let rows = [-1, 0, 1].map(|dy| self.rows.columns(run, dy));
        for i in 0..lanes(run) {
            // Start from the pixel itself, so that it wins ties.
            let [own, _, mut x, mut y, mut z] = rows[1].map(|row| row[i + 1]);
            let mut best = own * self.handicap;
            for dy in 0..3 {
                for dx in 0..3 {
                    if has(dx, dy) {
                        let [.., tx, ty, tz] = rows[dy].map(|row| row[i + dx]);
                        let rank = rows[dy][RANK][i + dx];
                        let nearer = rank < best;
                        best = if nearer { rank } else { best };
                        x = if nearer { tx } else { x };
                        y = if nearer { ty } else { y };
                        z = if nearer { tz } else { z };
                    }
                }
            }
            (cx[i], cy[i], cz[i]) = (x, y, z);
        }
    }
}

#[inline(always)]
fn rank(motion: &Pixels, choice: Choice, row: Run, [ranks, offered, x, y, z]: [&mut [f32]; 5]) {
    let n = row.len;
    let offered = &mut offered[..n];
    let (ranks, x, y, z) = (&mut ranks[..n], &mut x[..n], &mut y[..n], &mut z[..n]);
    read_motion(motion, row, [&mut *x, y, z]);
    if motion.channels != 3 {
        z.fill(0.0);
    }
    match choice {
        Choice::Nearest { depth, .. } => {
            for (rank, &depth) in ranks.iter_mut().zip(depth.row(0, row.y)) {
                let near = (depth > 0.0) & (depth < f32::MAX);
                *rank = if near { depth } else { f32::MAX };
            }
        }
        Choice::Longest => {
            for i in 0..n {
                ranks[i] = -(x[i] * x[i] + y[i] * y[i]);
            }
        }
    }
    for i in 0..n {
        let known = x[i].is_finite() & y[i].is_finite() & z[i].is_finite();
        ranks[i] = if known { ranks[i] } else { f32::INFINITY };
    }
    offered.copy_from_slice(ranks);
    if let Choice::Nearest {
        still: Some(still), ..
    } = choice
    {
        let mut lanes = [[0.0; SEGMENT]; 2];
        for run in segments(row.y, n) {
            still.read_rows(run, &mut lanes);
            for i in 0..run.len {
                let at = run.x + i;
                let moves = !is_still([x[at], y[at]], [lanes[0][i], lanes[1][i]]);
                offered[at] = if moves {
                    larger(offered[at], f32::MAX)
                } else {
                    offered[at]
                };
            }
        }
    }
}

struct Dilate<'a> {
    motion: Pixels<'a>,
    choice: Choice<'a>,
    params: Params,
}

/// [`dilate_motion`] as an image.
pub fn dilate(motion: Pixels, choice: Choice, params: Params) -> Image {
    let mut dilated = Image::blank(motion.size, motion.channels);
    dilate_motion(motion, choice, params, dilated.pixels_mut());
    dilated
}

/// Writes the motion of the chosen neighbour.
pub fn dilate_motion<'a>(
    motion: Pixels<'a>,
    choice: Choice<'a>,
    params: Params,
    dilated: impl Iterator<Item = PixelsMut<'a>>,
) {
    let kernel = Dilate {
        motion,
        choice,
        params,
    };
    rows::run(&kernel, motion.size.height, dilated);
}

impl<'a> Kernel for Dilate<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut dilated: PixelsMut<'a>) {
        let mut dilation = Dilation::new(self.motion, self.choice, self.params);
        let mut chosen = [[0.0; SEGMENT]; 3];
        for y in rows.clone() {
            dilation.roll(y, y == rows.start);
            for run in segments(y, self.motion.size.width) {
                dilation.choose(run, &mut chosen);
                dilated.write(run, &chosen[..self.motion.channels]);
            }
        }
    }
}
