//! Smoothing along edges: antialiases what the samples of a pixel, all of one surface or the other, leave jagged.
//!
//! In a denoised frame of one sample a pixel, an edge pixel shows either of two surfaces by chance, and an average over frames
//! still some of that noise. Along the edge, the pixels beside it know as much of it. So each pixel is averaged with four
//! others on the line through it in the direction in which the image changes least.
//!
//! That direction is an eigenvector of the structure tensor (Bigün and Granlund 1987, *Optimal Orientation Detection of Linear
//! Symmetry*; smoothing by it as in Weickert 1999, *Coherence-Enhancing Diffusion Filtering*, and Kyprianidis and Kang 2011,
//! *Image and Video Abstraction by Coherence-Enhancing Filtering*). With g the gradient of the tone l / (l + e), l ≥ 0 the
//! luminance and e the exposure (central differences, averaged by {1, 2, 1}/4 across):
//!   [a b; b d] = Σ w g gᵀ,  w = {1, 6, 15, 20, 15, 6, 1}/64 ⊗ {1, 6, 15, 20, 15, 6, 1}/64,  R = √((a − d)² + 4b²).
//! Where a > d the line goes from row to row, with the slope −2b / (a − d + R) in columns, else from column to column with
//! −2b / (d − a + R) in rows. Taps are one and two rows (columns) before and after, interpolated by a Catmull-Rom spline within
//! the range of its four pixels. With v₀ the pixel, vₖ the taps and l(v) their luminance:
//!   m = Σ ωₖ vₖ / Σ ωₖ,  ωₖ = {1, 4, 6, 4, 1} / (1 + l(vₖ) / 2e),
//! so that one bright tap does not outshine a dark pixel. The result is v₀ + s (m − v₀), the share
//!   s = max(0, 16 s′ − 1) / 15,  s′ = clamp((a + d)/G − 1, 0, 1) · lerp(q, 1, ¾ (1 − C)) / (1 + (l₊ / 12e)²),  q = (R / (a + d))⁴,
//! with G = 3·10⁻⁵, below which a gradient is no edge, and l₊ the largest luminance in 3×3 pixels: around lamps far brighter
//! than the frame, the smallest error of a share is a large one in the dark beside them. R / (a + d) is 1 on a straight edge
//! and less in corners, on crossings and in noise. Where the history of the surface is only partly known, or not at all, as its
//! confidence C tells, a pixel shows few samples: then smoothing helps even if the edge is not straight.
//!
//! Colour that is an average over frames lags, and has been resampled in each. As the line takes noise from an edge, the edge can
//! show more of the newest frame: where that is given, n, each pixel h of the line is taken as h + 0.15 q s (n − h), with
//! q and s of the pixel in its centre. Taps stay within the range of four pixels h, and the centre within that of the pixels
//! beside it, across the line: a lamp that shines into the newest frame is not news of an edge.
//!
//! Inputs: colour (3), newest frame (3, optional), confidence (1, optional; else 1). Output: colour. Borders are replicated. Pixels
//! with a missing one among the 9×9 around keep their bits, as do those with s = 0; missing pixels of the newest frame have no
//! share.

use std::ops::Range;

use crate::image::{Pixels, Run, SEGMENT, Size, View, segments};
use crate::kernels::fetch::footprint::cubic;
use crate::math::{Color, is_present, larger, luminance, smaller};
use crate::pixels::{Colors, PixelsMut, Rolling, Row};
use crate::rows::{self, BAND, Kernel, Simd};

/// Binomial weights of the window in which gradients are averaged, from its centre outwards.
const WINDOW: [f32; 4] = [20.0 / 64.0, 15.0 / 64.0, 6.0 / 64.0, 1.0 / 64.0];
const RADIUS: usize = WINDOW.len() - 1;
/// How far a window and its gradients reach.
const REACH: usize = RADIUS + 1;

/// Mean square of the gradient of tone up to which nothing is an edge. A seventh of it gains 1 % more, and smooths half again
/// as many pixels.
const FLAT: f32 = 3e-5;
/// Binomial weights of the taps, from the pixel outwards.
const TAPS: [f32; 3] = [6.0, 4.0, 1.0];
/// Luminance, in times of the exposure, at which a tap counts half. Without it, `opening_door` has 2 % more relMSE.
const HALF: f32 = 2.0;
/// Luminance, in times of the exposure, near which the share is halved. Without this and [`HALF`], `many_lights` has 18 % more
/// relMSE than without the kernel.
const BRIGHT: f32 = 12.0;
/// Share below which pixels stay as they are.
const LEAST: f32 = 1.0 / 16.0;
/// The newest frame's share of a straight edge. With 0.2, `leaves` with depth alone has 2 % more relMSE than without the kernel.
const NEWEST: f32 = 0.15;
/// How little straightness counts where nothing is known of a surface. From 2/3 to 1, `grass` gains a quarter more, and `thicket`
/// less.
const UNKNOWN: f32 = 0.75;

/// Smooths colours along their edges. `newest` is the frame that was merged into them last, and `confidence` that of the history
/// of their surfaces. `smoothed` begins as the colours; what is missing may be anything in it.
pub fn smooth_edges<'a>(
    color: Pixels<'a>,
    newest: Option<Pixels<'a>>,
    confidence: Option<View<'a>>,
    exposure: f32,
    smoothed: impl Iterator<Item = PixelsMut<'a>>,
) {
    let kernel = SmoothEdges {
        color,
        newest,
        confidence,
        exposure,
    };
    let height = color.size.height;
    rows::run_jobs(&kernel, rows::tall_jobs(height, REACH, smoothed));
}

struct SmoothEdges<'a> {
    color: Pixels<'a>,
    newest: Option<Pixels<'a>>,
    confidence: Option<View<'a>>,
    exposure: f32,
}

impl<'a> Kernel for SmoothEdges<'a> {
    type Out = Vec<PixelsMut<'a>>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Self::Out) {
        let size = self.color.size;
        let mut tensors = Tensors::new(size.width);
        let mut lines = Lines::blank();
        let mut colors = [[0.0; SEGMENT]; 3];
        for y in rows.clone() {
            tensors.roll(self, y, y == rows.start);
            let smoothed = &mut out[(y - rows.start) / BAND];
            for run in segments(y, size.width) {
                tensors.lines(run, size, self.confidence, &mut lines);
                let shares = &lines.share[..run.len];
                if shares.iter().all(|&share| share <= 0.0) {
                    continue;
                }
                smoothed.load_colors(run, &mut colors);
                for (i, &share) in shares.iter().enumerate().filter(|&(_, &share)| share > 0.0) {
                    let smooth = self.smooth(&lines.through(run, i), share);
                    for c in 0..3 {
                        colors[c][i] = smooth[c];
                    }
                }
                smoothed.write(run, &colors);
            }
        }
    }
}

/// For a run of pixels, the lines along which they are smoothed, and by how much.
struct Lines {
    /// 0 where a pixel stays as it is.
    share: Row,
    /// How straight the edge is, from 0 to 1.
    straight: Row,
    /// Whether the line goes from row to row.
    steep: [bool; SEGMENT],
    /// Columns per row, or rows per column.
    slope: Row,
}

impl Lines {
    fn blank() -> Self {
        Self {
            share: [0.0; SEGMENT],
            straight: [0.0; SEGMENT],
            steep: [false; SEGMENT],
            slope: [0.0; SEGMENT],
        }
    }

    /// The line through pixel `i` of the run.
    #[inline(always)]
    fn through(&self, run: Run, i: usize) -> Line {
        Line {
            x: (run.x + i) as isize,
            y: run.y as isize,
            steep: self.steep[i],
            slope: self.slope[i],
            newest: NEWEST * self.straight[i] * self.share[i],
        }
    }
}

/// The rows around one, and their structure tensors.
struct Tensors {
    /// NaN where a pixel is missing.
    tones: Rolling<1>,
    /// Squares xx, xy and yy of the gradients, averaged within rows.
    squares: Rolling<3>,
    /// The same of one row before the average, with a halo.
    gradients: [Vec<f32>; 3],
}

impl Tensors {
    fn new(width: usize) -> Self {
        Self {
            tones: Rolling::new(width, REACH),
            squares: Rolling::new(width, RADIUS),
            gradients: [(); 3].map(|()| vec![0.0; width + 2 * RADIUS]),
        }
    }

    /// Steps to row `y`, one below that of the previous call unless it is the first.
    #[inline(always)]
    fn roll(&mut self, of: &SmoothEdges, y: usize, first: bool) {
        let size = of.color.size;
        for due in self.tones.due(y, first) {
            if (0..size.height as isize).contains(&due) {
                let [row] = self.tones.row_mut(due);
                of.tones(due as usize, &mut row[REACH..][..size.width]);
                replicate(row, REACH, size.width);
            }
        }
        for due in self.squares.due(y, first) {
            if (0..size.height as isize).contains(&due) {
                self.find_squares(due as usize, size);
            }
        }
    }

    /// Finds the squares of the gradients of a row.
    #[inline(always)]
    fn find_squares(&mut self, y: usize, size: Size) {
        let width = size.width;
        let rows = around::<3>(y, size.height).map(|y| &self.tones.row(y)[0][REACH - 1..]);
        let [above, own, below] = rows.map(|row| &row[..width + 2]);
        let [xx, xy, yy] = self
            .gradients
            .each_mut()
            .map(|row| &mut row[RADIUS..][..width]);
        for x in 0..width {
            let across = |row: &[f32]| 0.5 * (row[x + 2] - row[x]);
            let down = |x: usize| 0.5 * (below[x] - above[x]);
            let dx = 0.5 * across(own) + 0.25 * (across(above) + across(below));
            let dy = 0.5 * down(x + 1) + 0.25 * (down(x) + down(x + 2));
            (xx[x], xy[x], yy[x]) = (dx * dx, dx * dy, dy * dy);
        }
        let squares = self.squares.row_mut(y as isize);
        for (gradients, squares) in self.gradients.iter_mut().zip(squares) {
            replicate(gradients, RADIUS, width);
            for (x, mean) in squares[..width].iter_mut().enumerate() {
                let taps = &gradients[x..][..2 * RADIUS + 1];
                *mean = WINDOW[0] * taps[3]
                    + WINDOW[1] * (taps[2] + taps[4])
                    + WINDOW[2] * (taps[1] + taps[5])
                    + WINDOW[3] * (taps[0] + taps[6]);
            }
        }
    }

    /// The lines of a run.
    #[inline(always)]
    fn lines(&self, run: Run, size: Size, confidence: Option<View>, lines: &mut Lines) {
        let mut unknown = [0.0; SEGMENT];
        if let Some(confidence) = confidence {
            for (unknown, &known) in unknown.iter_mut().zip(confidence.run(0, run)) {
                *unknown = UNKNOWN * (1.0 - smaller(larger(known, 0.0), 1.0));
            }
        }
        let mut tensor = [[0.0; SEGMENT]; 3];
        let rows = around::<{ 2 * RADIUS + 1 }>(run.y, size.height).map(|y| self.squares.row(y));
        for (c, mean) in tensor.iter_mut().enumerate() {
            let taps = rows.map(|rows| &rows[c][run.x..][..run.len]);
            for i in 0..run.len {
                mean[i] = WINDOW[0] * taps[3][i]
                    + WINDOW[1] * (taps[2][i] + taps[4][i])
                    + WINDOW[2] * (taps[1][i] + taps[5][i])
                    + WINDOW[3] * (taps[0][i] + taps[6][i]);
            }
        }
        let tones = around::<3>(run.y, size.height);
        let tones = tones.map(|y| &self.tones.row(y)[0][REACH - 1 + run.x..][..run.len + 2]);
        let [xx, xy, yy] = tensor;
        for i in 0..run.len {
            let (apart, twice) = (xx[i] - yy[i], 2.0 * xy[i]);
            let square = apart * apart + twice * twice;
            let trace = xx[i] + yy[i];
            let coherence = square / (trace * trace);
            let straight = coherence * coherence;
            let along = straight + unknown[i] * (1.0 - straight);
            let edge = smaller(larger(trace / FLAT - 1.0, 0.0), 1.0);
            let column = |row: &[f32]| larger(larger(row[i], row[i + 1]), row[i + 2]);
            let tone = larger(larger(column(tones[0]), column(tones[1])), column(tones[2]));
            let bright = tone / ((1.0 - tone) * BRIGHT);
            let share = edge * along / (1.0 + bright * bright);
            // The comparison of NaN fails.
            lines.straight[i] = straight;
            lines.share[i] = larger((share - LEAST) / (1.0 - LEAST), 0.0);
            lines.steep[i] = apart > 0.0;
            lines.slope[i] = -twice / (apart.abs() + square.sqrt());
        }
    }
}

/// Rows from above row `y` to below it, those outside the image replaced by the nearest.
#[inline(always)]
fn around<const N: usize>(y: usize, height: usize) -> [isize; N] {
    let last = height as isize - 1;
    std::array::from_fn(|i| (y as isize + i as isize - N as isize / 2).clamp(0, last))
}

/// Fills the halo of a row by its first and last pixel.
#[inline(always)]
fn replicate(row: &mut [f32], halo: usize, width: usize) {
    let [first, last] = [row[halo], row[halo + width - 1]];
    row[..halo].fill(first);
    row[halo + width..].fill(last);
}

impl SmoothEdges<'_> {
    /// Tones of a row.
    #[inline(always)]
    fn tones(&self, y: usize, tones: &mut [f32]) {
        let mut colors = [[0.0; SEGMENT]; 3];
        for run in segments(y, tones.len()) {
            self.color.colors(run, &mut colors);
            let [r, g, b] = &colors;
            for (i, tone) in tones[run.x..][..run.len].iter_mut().enumerate() {
                // The luminance of the largest floats may round to infinity.
                let light = smaller(larger(luminance(r[i], g[i], b[i]), 0.0), f32::MAX);
                let present = is_present([r[i], g[i], b[i]]);
                *tone = if present {
                    light / (light + self.exposure)
                } else {
                    f32::NAN
                };
            }
        }
    }

    /// Moves the pixel of a line by a share to the weighted mean along it. Loops instead of closures: a closure that is not
    /// inlined is compiled without the caller's instruction set.
    #[inline(always)]
    fn smooth(&self, line: &Line, share: f32) -> Color {
        let mut own = self.tap(line, 0);
        let mut weights = self.weight(own, TAPS[0]);
        let mut sum = own.map(|value| weights * value);
        for (step, part) in [(-2, TAPS[2]), (-1, TAPS[1]), (1, TAPS[1]), (2, TAPS[2])] {
            let tap = self.tap(line, step);
            let weight = self.weight(tap, part);
            for c in 0..3 {
                sum[c] += weight * tap[c];
            }
            weights += weight;
        }
        for c in 0..3 {
            own[c] += share * (sum[c] / weights - own[c]);
        }
        own
    }

    /// A weight, reduced by the brightness of a tap.
    #[inline(always)]
    fn weight(&self, [r, g, b]: Color, part: f32) -> f32 {
        part / (1.0 + larger(luminance(r, g, b), 0.0) / (HALF * self.exposure))
    }

    /// Interpolates between the four pixels of a row, or of a column, that a line passes.
    #[inline(always)]
    fn tap(&self, line: &Line, step: isize) -> Color {
        let offset = step as f32 * line.slope;
        let floor = offset.floor();
        let weights = cubic(offset - floor);
        let mut sum = [0.0; 3];
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for (j, weight) in weights.into_iter().enumerate() {
            let at = self.pixel(line, step, floor as isize + j as isize - 1);
            let pixel = self.color.vector(at);
            let shown = self.with_newest(at, pixel, line.newest);
            for c in 0..3 {
                sum[c] += weight * shown[c];
                low[c] = smaller(pixel[c], low[c]);
                high[c] = larger(pixel[c], high[c]);
            }
        }
        for c in 0..3 {
            sum[c] = smaller(larger(sum[c], low[c]), high[c]);
        }
        sum
    }

    /// Where the pixel is that lies so many steps along the main axis of a line and so many aside.
    #[inline(always)]
    fn pixel(&self, line: &Line, step: isize, aside: isize) -> usize {
        let Size { height, width } = self.color.size;
        let (dx, dy) = if line.steep {
            (aside, step)
        } else {
            (step, aside)
        };
        let x = (line.x + dx).clamp(0, width as isize - 1) as usize;
        let y = (line.y + dy).clamp(0, height as isize - 1) as usize;
        y * width + x
    }

    /// A pixel's colour with a share of the newest frame's.
    #[inline(always)]
    fn with_newest(&self, at: usize, color: Color, share: f32) -> Color {
        let Some(newest) = &self.newest else {
            return color;
        };
        let (newest, mut mixed) = (newest.vector(at), color);
        for c in 0..3 {
            mixed[c] += share * (newest[c] - color[c]);
        }
        if is_present(mixed) { mixed } else { color }
    }
}

/// A line through a pixel.
struct Line {
    x: isize,
    y: isize,
    /// As in [`Lines`].
    steep: bool,
    slope: f32,
    /// The newest frame's share in its pixels.
    newest: f32,
}
