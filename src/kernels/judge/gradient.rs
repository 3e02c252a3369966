//! The temporal gradient: how far the light of a neighbourhood has changed, beyond what noise explains.
//!
//! For two images of the same pixels, δ = l − l′ is the difference of luminances and m = max(|l|, |l′|) the larger. Both,
//! and δ², are summed over the pixels that both images have; w is their number. The first pass sums cells of 2×2 pixels,
//! the others blur these by {1, 2, 1}/4 ⊗ {1, 2, 1}/4 at steps of 1, 2, 4, … cells. Then, with the mean D = Σδ/w, the
//! variance of δ, V = Σδ²/w − D², and K the sum of squares of the blurs' composed kernel,
//!   λ = clamp((|D| − z √(V K / w)) w / Σm, 0, 1):
//! the change relative to the larger light, where it exceeds z standard errors. All pixels of a cell have its λ. δ keeps
//! its sign while it is summed, so that noise cancels (Schied, Peters and Dachsbacher 2018, *Gradient Estimation for
//! Real-Time Adaptive Temporal Filtering*, who sum cells of 3×3). Two renders with the same random numbers have the same
//! noise, and z = 0 gives their exact gradient; for a new frame and a reprojected history the standard error keeps noise
//! from counting as change. Small blurs tell where light has changed, wide ones see a change that is everywhere but small:
//! of several, the largest λ counts.
//!
//! Inputs: two images (3). Output: λ (1) in [0, 1]; 0 where nothing is known.

use std::ops::Range;

use crate::error::{Result, Whole, finite_from_0, whole};
use crate::image::{BandMut, Image, Pixels, Run, Size, View, plane_bands};
use crate::lanes::LANES;
use crate::math::{is_present, larger, luminance, saturate};
use crate::pixels::STRIP;
use crate::rows::{self, BAND, Kernel, Simd};

/// What counts as a change, and how far it is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// z: standard errors that count as noise; ≥ 0; 2.
    pub noise: f32,
    /// Passes of the smallest sums; 1 to 8; 3.
    pub passes: u32,
    /// Passes of the widest; `passes` to 8; 3.
    pub widest: u32,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            noise: 2.0,
            passes: 3,
            widest: 3,
        }
    }
}

impl Params {
    pub(crate) fn passes(name: &str, value: impl Whole<u32>) -> Result<u32> {
        whole(name, value, "1 to 8 passes", |n| (1..=8).contains(n))
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        finite_from_0("noise", self.noise)?;
        Self::passes("passes", self.passes)?;
        Self::passes("widest", self.widest)?;
        let known = format!("at least as many as passes, {}", self.passes);
        whole("widest", self.widest, &known, |&n: &u32| n >= self.passes)?;
        Ok(())
    }
}

/// w, δ, δ² and m of each pixel or cell; all 0 where it is missing.
const CHANNELS: usize = 4;
/// Pixels along each side of a cell.
const CELL: usize = 2;

/// [`temporal_gradient`] as an image.
pub fn find_gradient(
    [color, previous]: [Pixels; 2],
    coverage: Option<View>,
    params: Params,
) -> Image {
    let mut gradient = Image::blank(color.size, 1);
    temporal_gradient(color, previous, coverage, params, gradient.data_mut());
    gradient
}

/// Writes the gradient of each pixel. `previous` counts where the coverage is above 0, or everywhere without one.
pub fn temporal_gradient(
    color: Pixels,
    previous: Pixels,
    coverage: Option<View>,
    params: Params,
    gradient: &mut [f32],
) {
    let size = color.size;
    let cells = Size {
        height: size.height.div_ceil(CELL),
        width: size.width.div_ceil(CELL),
    };
    let blurs = Params {
        passes: params.passes - 1,
        widest: params.widest - 1,
        ..params
    };
    let kernel = Gradient {
        color,
        previous,
        coverage,
        cells,
        blurs,
        squares: (0..=blurs.widest).map(sum_of_squares).collect(),
    };
    let mut found = Image::blank(cells, 1);
    let bands = found.data_mut().chunks_mut(BAND * cells.width);
    let jobs = rows::tall_jobs(cells.height, reach(blurs.widest), bands);
    rows::run_jobs(&kernel, jobs);
    rows::run(
        &Spread(found.view()),
        size.height,
        plane_bands(gradient, size),
    );
}

/// Writes the gradient of each cell to its pixels.
struct Spread<'a>(View<'a>);

impl<'a> Kernel for Spread<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut gradient: BandMut<'a>) {
        for y in rows {
            let (pairs, last) = gradient.row(0, y).as_chunks_mut::<CELL>();
            let (cells, beyond) = self.0.row(0, y / CELL).split_at(pairs.len());
            for (pair, &cell) in pairs.iter_mut().zip(cells) {
                *pair = [cell; CELL];
            }
            last.copy_from_slice(beyond);
        }
    }
}

/// Radius in cells after so many blurs.
fn reach(passes: u32) -> usize {
    (1 << passes) - 1
}

/// Sum of the squared weights of so many blurs together: how much they reduce variance.
fn sum_of_squares(passes: u32) -> f32 {
    let mut kernel = vec![1.0_f64];
    for pass in 0..passes {
        let step = 1 << pass;
        let mut wider = vec![0.0; kernel.len() + 2 * step];
        for (i, weight) in kernel.iter().enumerate() {
            wider[i] += 0.25 * weight;
            wider[i + step] += 0.5 * weight;
            wider[i + 2 * step] += 0.25 * weight;
        }
        kernel = wider;
    }
    let along: f64 = kernel.iter().map(|w| w * w).sum();
    (along * along) as f32
}

struct Gradient<'a> {
    color: Pixels<'a>,
    previous: Pixels<'a>,
    coverage: Option<View<'a>>,
    /// Size of the image of cells.
    cells: Size,
    /// The parameters, with the passes that blur cells.
    blurs: Params,
    /// [`sum_of_squares`] of 0, 1, 2 … blurs.
    squares: Vec<f32>,
}

/// A row of each channel.
type Sums = [Vec<f32>; CHANNELS];

/// Line buffers for a strip of columns of cells. Every blur makes the strip narrower by its step on both sides.
struct Strip {
    /// One row of the new and of the previous colours.
    colors: [Vec<f32>; 6],
    /// The pixels' sums over the rows of a cell.
    columns: Sums,
    sums: Sums,
    blurred: Sums,
    blurs: Vec<Blur>,
}

impl Strip {
    #[inline(always)]
    fn new(width: usize, passes: u32) -> Self {
        let mut length = STRIP.min(width).next_multiple_of(LANES);
        let mut blurs: Vec<_> = (0..passes)
            .rev()
            .map(|pass| {
                let blur = Blur::new(1 << pass, length);
                length = (length + 2 * blur.step).next_multiple_of(LANES);
                blur
            })
            .collect();
        blurs.reverse();
        let row = || vec![0.0; length];
        Self {
            colors: [(); 6].map(|()| vec![0.0; CELL * length]),
            columns: [(); CHANNELS].map(|()| vec![0.0; CELL * length]),
            sums: [(); CHANNELS].map(|()| row()),
            blurred: [(); CHANNELS].map(|()| row()),
            blurs,
        }
    }
}

impl<'a> Kernel for Gradient<'a> {
    type Out = Vec<&'a mut [f32]>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut gradient: Self::Out) {
        let (width, widest) = (self.cells.width, self.blurs.widest);
        let mut strip = Strip::new(width, widest);
        for left in (0..width).step_by(STRIP) {
            let columns = left..(left + STRIP).min(width);
            for row in 0..rows.len() + 2 * reach(widest) {
                self.advance(row, &columns, &rows, &mut strip, &mut gradient);
            }
        }
    }
}

impl Gradient<'_> {
    /// Pushes the next row of a strip through all passes. A pass lags the one before it by its radius; rows that reach the
    /// measured passes raise the gradient.
    #[inline(always)]
    fn advance(
        &self,
        mut row: usize,
        columns: &Range<usize>,
        rows: &Range<usize>,
        strip: &mut Strip,
        gradient: &mut [&mut [f32]],
    ) {
        let Size { height, width } = self.cells;
        let Params { passes, widest, .. } = self.blurs;
        for pass in 0..=widest {
            // The halo that later passes still need on each side.
            let rest = reach(widest) - reach(pass);
            let y = (rows.start + row).checked_sub(rest);
            let y = y.filter(|&y| y < height);
            match y {
                Some(y) if pass == 0 => self.compare(y, columns.start, strip),
                _ => {}
            }
            for sums in &mut strip.sums {
                let inside = inside(sums.len(), columns.start, rest, width);
                let inside = if y.is_some() { inside } else { 0..0 };
                sums[..inside.start].fill(0.0);
                sums[inside.end..].fill(0.0);
            }
            if let Some(y) = y.filter(|y| pass >= passes && rows.contains(y)) {
                let below = y - rows.start;
                let band = &mut gradient[below / BAND][below % BAND * width..][..width];
                self.raise(pass, rest, &strip.sums, &mut band[columns.clone()]);
            }
            let Some(blur) = strip.blurs.get_mut(pass as usize) else {
                break;
            };
            blur.advance(row, &strip.sums, &mut strip.blurred);
            // This pass has not yet seen enough rows above to produce one.
            let Some(next) = row.checked_sub(2 * blur.step) else {
                break;
            };
            row = next;
            std::mem::swap(&mut strip.sums, &mut strip.blurred);
        }
    }

    /// Fills a row with the w, δ, δ² and m of its cells.
    #[inline(always)]
    fn compare(&self, y: usize, left: usize, strip: &mut Strip) {
        let reach = reach(self.blurs.widest);
        let inside = inside(strip.sums[0].len(), left, reach, self.cells.width);
        let first = CELL * (left + inside.start - reach);
        let width = (CELL * inside.len()).min(self.color.size.width - first);
        let top = CELL * y;
        for y in top..(top + CELL).min(self.color.size.height) {
            let run = Run {
                y,
                x: first,
                len: width,
            };
            self.add_pixels(run, y == top, strip);
        }
        for (cells, columns) in strip.sums.iter_mut().zip(&mut strip.columns) {
            // The last cell of an odd width has one column.
            columns[width..]
                .iter_mut()
                .take(CELL - 1)
                .for_each(|v| *v = 0.0);
            let columns = columns.as_chunks::<CELL>().0;
            for (cell, [left, right]) in cells[inside.clone()].iter_mut().zip(columns) {
                *cell = left + right;
            }
        }
    }

    /// Adds a row of pixels to its columns, or begins with it.
    #[inline(always)]
    fn add_pixels(&self, run: Run, begins: bool, strip: &mut Strip) {
        let n = run.len;
        let [r, g, b, pr, pg, pb] = strip.colors.each_mut().map(|row| &mut row[..n]);
        self.color.read(run, [&mut *r, &mut *g, &mut *b]);
        self.previous.read(run, [&mut *pr, &mut *pg, &mut *pb]);
        if let Some(coverage) = self.coverage {
            let coverage = coverage.run(0, run);
            for (pr, &coverage) in pr.iter_mut().zip(coverage) {
                *pr = if coverage > 0.0 { *pr } else { f32::NAN };
            }
        }
        let [weight, delta, square, most] = strip.columns.each_mut().map(|row| &mut row[..n]);
        for x in 0..n {
            let known = is_present([r[x], g[x], b[x]]) & is_present([pr[x], pg[x], pb[x]]);
            let l = luminance(r[x], g[x], b[x]);
            let other = luminance(pr[x], pg[x], pb[x]);
            let keep = |v: f32| if known { v } else { 0.0 };
            let above = |sum: f32| if begins { 0.0 } else { sum };
            weight[x] = above(weight[x]) + keep(1.0);
            delta[x] = above(delta[x]) + keep(l - other);
            square[x] = above(square[x]) + keep((l - other) * (l - other));
            most[x] = above(most[x]) + keep(larger(l.abs(), other.abs()));
        }
    }

    /// Raises the gradient to the change that the sums after this pass show beyond their noise.
    #[inline(always)]
    fn raise(&self, pass: u32, rest: usize, sums: &Sums, gradient: &mut [f32]) {
        let n = gradient.len();
        let [weight, delta, square, most] = sums.each_ref().map(|sums| &sums[rest..][..n]);
        if pass == self.blurs.passes {
            gradient.fill(0.0);
        }
        let noise = self.blurs.noise;
        let squares = self.squares[pass as usize];
        for x in 0..n {
            // Numerator and denominator of the relative change are both scaled by the weight, which cancels.
            let variance = square[x] - delta[x] * delta[x] / weight[x];
            let error = (larger(variance, 0.0) * squares).sqrt();
            let change = (delta[x].abs() - noise * error) / most[x];
            // NaN where nothing is known or all is black.
            gradient[x] = larger(saturate(change), gradient[x]);
        }
    }
}

/// The part of a line buffer that lies inside the image, for a halo of `before` columns left of the strip.
fn inside(length: usize, left: usize, before: usize, width: usize) -> Range<usize> {
    before.saturating_sub(left)..(width + before - left).min(length)
}

/// Blur by {1, 2, 1}/4 along both axes with taps `step` apart; takes and returns one row at a time.
struct Blur {
    step: usize,
    /// Length of the rows that come out.
    length: usize,
    /// Ring of the last 2 × `step` rows, blurred horizontally, in two halves.
    rows: [Vec<f32>; 2],
}

impl Blur {
    fn new(step: usize, length: usize) -> Self {
        Self {
            step,
            length,
            rows: [(); 2].map(|()| vec![0.0; step * CHANNELS * length]),
        }
    }

    /// Takes a row and writes the finished one `step` rows above it.
    #[inline(always)]
    fn advance(&mut self, row: usize, from: &Sums, into: &mut Sums) {
        let Self { step, length, .. } = *self;
        let [first, second] = &mut self.rows;
        let (before, own) = if (row / step).is_multiple_of(2) {
            (first, second)
        } else {
            (second, first)
        };
        for channel in 0..CHANNELS {
            let at = (row % step * CHANNELS + channel) * length;
            smooth(
                step,
                &from[channel],
                &mut before[at..][..length],
                &own[at..][..length],
                &mut into[channel][..length],
            );
        }
    }
}

/// Blurs a row horizontally, combines it vertically with the two before, and stores it in the oldest one's place.
#[inline(always)]
fn smooth(step: usize, row: &[f32], before: &mut [f32], own: &[f32], into: &mut [f32]) {
    let n = into.len();
    let (left, middle, right) = (&row[..n], &row[step..][..n], &row[2 * step..][..n]);
    let (before, own) = (&mut before[..n], &own[..n]);
    for i in 0..n {
        let here = (left[i] + right[i]) + (middle[i] + middle[i]);
        into[i] = ((before[i] + here) + (own[i] + own[i])) * 0.0625;
        before[i] = here;
    }
}
