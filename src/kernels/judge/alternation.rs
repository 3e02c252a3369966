//! Alternation: neighbourhoods whose colours alternate from frame to frame.
//!
//! Where an aliased feature is wider than the neighbourhood, all of its pixels show one thing in one frame and another in
//! the next. Clipping then discards history in every frame, and the image flickers. A single frame cannot tell this from a
//! change of light or a disocclusion; the return of earlier colours can.
//!
//! The memory of a neighbourhood, 3×3 pixels in tone-mapped YCoCg, holds the mean μ, the mean μ₀ from before its last
//! jump, and a count of returns e. With the new mean m and range r (per channel):
//! - it **jumps** if |m − μ| > r in some channel, so that the last mean lies well outside the current range, and the
//!   largest |m − μ| is more than a fifth of the largest coordinate of m and μ;
//! - a jump is a **return** if |m − μ₀| < ½ |m − μ|: then e ← min(e + 1, 3); any other jump sets e ← 0;
//! - a jump sets μ₀ ← μ; without one, μ₀ ← μ₀ + ⅛ (m − μ₀) and e ← ⅞ e, so that old states are forgotten.
//!
//! The first return might be chance: clamp(e − 1, 0, 1) is the weight of unclipped history. (AMD's FSR 2.2 detects
//! returning luminances of single pixels among the last four frames.)
//!
//! Inputs: colour (3), memory (7: μ, μ₀, e), optional. Output: memory. Missing pixels do not count; where all are
//! missing, memory is unchanged. Without memory, μ and μ₀ start at m and e at 0.

use std::ops::Range;

use super::neighborhood::{self, Bounds, Response, Space, Window};
use crate::image::{Pixels, SEGMENT, View, segments};
use crate::math::larger;
use crate::pixels::{PixelsMut, Row, lanes};
use crate::rows::{self, BAND, Kernel, Simd};

/// Channels of the memory.
pub const CHANNELS: usize = 7;
/// The largest count of returns.
const MAX_COUNT: f32 = 3.0;
/// The smallest jump, relative to the larger mean.
const JUMP: f32 = 0.2;
/// Rate at which μ₀ drifts to m, and e decays, without a jump.
const PACE: f32 = 0.125;

/// Reprojected memory and its coverage, 0 where there is no history.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// Of [`CHANNELS`] channels, where the pixel is now.
    pub memory: Pixels<'a>,
    /// 0 to 1; none counts as 1.
    pub coverage: Option<View<'a>>,
}

struct Alternation<'a> {
    color: Pixels<'a>,
    known: Option<Known<'a>>,
    exposure: f32,
}

/// Writes the next memory.
pub fn alternation<'a>(
    color: Pixels<'a>,
    known: Option<Known<'a>>,
    exposure: f32,
    memory: impl Iterator<Item = PixelsMut<'a>>,
) {
    let height = color.size.height;
    let kernel = Alternation {
        color,
        known,
        exposure,
    };
    let jobs = rows::tall_jobs(height, 1, memory);
    rows::run_jobs(&kernel, jobs);
}

/// The weight of unclipped history.
#[inline(always)]
pub(crate) fn hold(count: f32) -> f32 {
    larger(count - 1.0, 0.0).min(1.0)
}

impl<'a> Kernel for Alternation<'a> {
    type Out = Vec<PixelsMut<'a>>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut outs: Self::Out) {
        let size = self.color.size;
        let around = neighborhood::Params {
            bounds: Bounds::MinMax,
            gamma: 1.0,
            radius: 1,
            space: Space::ToneMappedYCoCg,
            response: Response::Clamp,
            exposure: self.exposure,
        };
        let mut window = Window::new(size.width, around);
        let mut memory = [[f32::NAN; SEGMENT]; CHANNELS];
        for y in rows.clone() {
            window.roll(self.color, y, y == rows.start);
            let out = &mut outs[(y - rows.start) / BAND];
            for run in segments(y, size.width) {
                if let Some(known) = &self.known {
                    known.memory.read_rows(run, &mut memory);
                    if let Some(coverage) = known.coverage {
                        let coverage = coverage.run(0, run);
                        for (mean, &coverage) in memory[0].iter_mut().zip(coverage) {
                            *mean = if coverage > 0.0 { *mean } else { f32::NAN };
                        }
                    }
                } else {
                    memory[0].fill(f32::NAN);
                }
                let around = window.statistics(run);
                for i in 0..lanes(run) {
                    let of = |rows: &[Row; 3]| [rows[0][i], rows[1][i], rows[2][i]];
                    let (low, high) = (of(around.low), of(around.high));
                    let reach = [high[0] - low[0], high[1] - low[1], high[2] - low[2]];
                    let before = memory.each_ref().map(|row| row[i]);
                    let next = remember(before, of(around.mean), reach);
                    for (row, next) in memory.iter_mut().zip(next) {
                        row[i] = if around.count[i] > 0.0 { next } else { row[i] };
                    }
                }
                out.write(run, &memory);
            }
        }
    }
}

/// Updates the memory of one pixel; memory that is not finite starts anew.
#[inline(always)]
fn remember(memory: [f32; CHANNELS], mean: [f32; 3], range: [f32; 3]) -> [f32; CHANNELS] {
    let known = memory.iter().fold(true, |all, v| all & v.is_finite());
    let [p0, p1, p2, a0, a1, a2, count] = memory;
    let pick = |known_as: [f32; 3]| [0, 1, 2].map(|c| if known { known_as[c] } else { mean[c] });
    let (last, other) = (pick([p0, p1, p2]), pick([a0, a1, a2]));
    let count = if known { count } else { 0.0 };
    let (mut beyond, mut largest, mut size) = (false, 0.0, 0.0);
    let (mut moved, mut apart) = (0.0, 0.0);
    for c in 0..3 {
        let off = (mean[c] - last[c]).abs();
        beyond |= off > range[c];
        largest = larger(off, largest);
        size = larger(larger(mean[c].abs(), last[c].abs()), size);
        moved += off * off;
        apart += (mean[c] - other[c]) * (mean[c] - other[c]);
    }
    let jumps = beyond & (largest > JUMP * size);
    let returns = apart < 0.25 * moved;
    let counted = if returns {
        (count + 1.0).min(MAX_COUNT)
    } else {
        0.0
    };
    let count = if jumps { counted } else { (1.0 - PACE) * count };
    let other = [0, 1, 2].map(|c| {
        let drifts = other[c] + PACE * (mean[c] - other[c]);
        if jumps { last[c] } else { drifts }
    });
    [
        mean[0], mean[1], mean[2], other[0], other[1], other[2], count,
    ]
}
