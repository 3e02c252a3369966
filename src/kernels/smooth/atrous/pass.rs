//! One pass of the filter: every pixel's taps, weighed and averaged.

use std::ops::Range;

use super::{FilteredRow, IN_PLACE, LUMINANCE, Params, Sink};
use crate::bordered::{InPlace, Layout, SourceRow, Step};
use crate::kernels::smooth::guide::{Center, Comparison, Guide};
use crate::kernels::smooth::variance::floored_all;
use crate::lanes::{Lanes, TapColumns};
use crate::math::{LOG2_E, exp2_weights, luminances};
use crate::rows::{Kernel, Outlined, Simd};

/// log₂ of 1, 2/3 and 1/6.
const LOG2_CUBIC: [f32; 3] = [0.0, -0.584_962_5, -2.584_962_5];
/// log₂ of 1 and 1/2.
const LOG2_LINEAR: [f32; 2] = [0.0, -1.0];

/// What a pass reads, and what takes its rows.
pub(super) struct Pass<'a, K> {
    pub variance: &'a [f32],
    pub limits: Option<&'a [f32]>,
    pub tones: Option<&'a [f32]>,
    pub guide: &'a Guide,
    pub params: Params,
    pub step: usize,
    pub predicted: bool,
    pub sink: &'a K,
}

impl<'a, K: Sink> Kernel for Pass<'a, K>
where
    K::Row: 'a,
{
    type Out = InPlace<'a, IN_PLACE, K::Row>;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, _: Range<usize>, rows: Self::Out) {
        match (self.params.radius, self.predicted) {
            (1, false) => self.filter::<S, 1, false>(simd, rows),
            (1, true) => self.filter::<S, 1, true>(simd, rows),
            (_, false) => self.filter::<S, 2, false>(simd, rows),
            (_, true) => self.filter::<S, 2, true>(simd, rows),
        }
    }
}

impl<K: Sink> Pass<'_, K> {
    #[inline(always)]
    fn filter<S: Simd, const RADIUS: usize, const PREDICTED: bool>(
        &self,
        simd: S,
        rows: InPlace<IN_PLACE, K::Row>,
    ) {
        let around = Around::<RADIUS, PREDICTED> {
            layout: self.guide.layout,
            step: self.step as isize,
            variance: self.variance,
            limits: self.limits,
            tones: self.tones,
            guide: self.guide.compare(&self.params.sigmas, RADIUS * self.step),
            // Infinity times a variance of 0 would be NaN.
            sigma_luminance: self.params.sigma_luminance.min(f32::MAX),
        };
        around.rows(simd, rows, self.sink);
    }
}

/// The inputs that a pass does not overwrite.
struct Around<'a, const RADIUS: usize, const PREDICTED: bool> {
    layout: Layout,
    /// Pixels between taps.
    step: isize,
    variance: &'a [f32],
    limits: Option<&'a [f32]>,
    tones: Option<&'a [f32]>,
    guide: Comparison<'a>,
    sigma_luminance: f32,
}

/// One row of taps in every input. The slices have the same length, so that one bounds check serves them all.
#[derive(Clone, Copy)]
struct Line<'a> {
    /// Rows below the centre, and log₂ of the kernel's weight for that distance.
    down: isize,
    own: f32,
    channels: [&'a [f32]; IN_PLACE],
    variance: &'a [f32],
    tones: Option<&'a [f32]>,
    guide: Comparison<'a>,
}

/// What taps are compared with. `sharpness` is −log₂e over the luminance difference that counts as one. Both luminance and
/// sharpness are 0 where the centre is missing, so that any tap may fill it.
struct Like<S: Simd> {
    center: Center<S>,
    luminance: Lanes<S>,
    sharpness: Lanes<S>,
    /// e + l of the exposure and the unfiltered luminance, +∞ of pixels of few samples; if brighter taps weigh less.
    tone: Option<Lanes<S>>,
}

/// Sums over taps.
struct Sums<S: Simd> {
    weight: Lanes<S>,
    color: [Lanes<S>; 3],
    variance: Lanes<S>,
    /// Of the luminance that is compared, if it is a prediction's.
    luminance: Lanes<S>,
}

/// The filtering of one row: a function of its own, which is compiled once for all sinks.
struct FilterRow<'r, 'a, S, const RADIUS: usize, const PREDICTED: bool> {
    around: &'r Around<'a, RADIUS, PREDICTED>,
    simd: S,
    y: usize,
    /// Variance of the row above, of this one, and of the one below.
    near: [&'r [f32]; 3],
    /// The most that the standard deviation may be, if it is limited.
    limits: Option<&'r [f32]>,
    lines: [Line<'r>; 5],
    out: [&'r mut [f32]; IN_PLACE],
    target: &'r mut [f32],
}

impl<S: Simd, const RADIUS: usize, const PREDICTED: bool> Outlined
    for FilterRow<'_, '_, S, RADIUS, PREDICTED>
{
    type Output = ();

    #[inline(always)]
    fn call(mut self) {
        let width = self.around.layout.size.width;
        for x in (0..width).step_by(Lanes::<S>::COUNT) {
            let at = [x, self.y];
            let ([r, g, b, l], v) =
                (self.around).filter(self.simd, at, &self.near, self.limits, &self.lines);
            for (row, lanes) in self.out.iter_mut().zip([r, g, b, l]) {
                lanes.store(row, x);
            }
            v.store(self.target, x);
        }
    }
}

impl<'a, const RADIUS: usize, const PREDICTED: bool> Around<'a, RADIUS, PREDICTED> {
    /// log₂ of the kernel's weight, by steps along one axis.
    const KERNEL: &'static [f32] = if RADIUS == 1 {
        &LOG2_LINEAR
    } else {
        &LOG2_CUBIC
    };

    /// Filters the rows of a job.
    #[inline(always)]
    fn rows<S: Simd, K: Sink>(&self, simd: S, mut rows: InPlace<IN_PLACE, K::Row>, sink: &K) {
        let height = self.layout.size.height;
        for row in 0..rows.len {
            let Step {
                y,
                window,
                mut out,
                target,
                extra,
            } = rows.step(row);
            let lines = self.lines(y, &window);
            // Rows outside the image repeat the first and the last one; columns are padded likewise.
            let cut = |y| self.layout.cut(self.variance, y);
            let near = [
                cut(y.saturating_sub(1)),
                cut(y),
                cut((y + 1).min(height - 1)),
            ];
            simd.vectorize(FilterRow {
                around: self,
                simd,
                y,
                near,
                limits: self.limits.map(|limits| self.layout.cut(limits, y)),
                lines,
                out: out.each_mut().map(|row| &mut **row),
                target,
            });
            let filtered = FilteredRow {
                channels: out.map(|row| &*row),
                variance: target,
            };
            sink.take(y, filtered, extra);
        }
        rows.replicate();
    }

    /// Filters one register of pixels, from (x, y) on.
    #[inline(always)]
    fn filter<S: Simd>(
        &self,
        simd: S,
        [x, y]: [usize; 2],
        near: &[&[f32]; 3],
        limits: Option<&[f32]>,
        lines: &[Line; 5],
    ) -> ([Lanes<S>; IN_PLACE], Lanes<S>) {
        let at = self.layout.at(x, 0);
        let (step, farthest) = (self.step, self.layout.farthest());
        let own = &lines[2];
        let [r, g, b, l] = Lanes::load_all(simd, own.channels, at);
        let known = l.is_number();
        let sharpness = self.sharpness(simd, at, near, limits, l);
        // The centre has weight 1.
        let mut sums = Sums {
            weight: Lanes::splat(simd, 1.0).when_or(known, 0.0),
            color: [r, g, b],
            variance: Lanes::load(simd, own.variance, at).when_or(known, 0.0),
            luminance: l.when_or(known, 0.0),
        };
        let like = Like {
            center: own.guide.center(simd, x, y),
            luminance: l.when_or(known, 0.0),
            sharpness: sharpness.when_or(known, 0.0),
            tone: own.tones.map(|tones| {
                let tone = Lanes::load(simd, tones, at);
                (Lanes::splat(simd, 1.0) / tone).when_or(tone.is_finite(), f32::INFINITY)
            }),
        };
        if RADIUS == 1 {
            // All eight at once: three would not hide the latency of the exponential.
            let whole = TapColumns::new([-1, 0, 1], step, farthest);
            let beside = TapColumns::new([-1, 1], step, farthest);
            let [_, above, own, below, _] = lines;
            let [a, b, c] = exponents(simd, &like, above, &whole, Self::KERNEL);
            let [d, e] = exponents(simd, &like, own, &beside, Self::KERNEL);
            let [f, g, h] = exponents(simd, &like, below, &whole, Self::KERNEL);
            let [a, b, c, d, e, f, g, h] = exp2_weights([a, b, c, d, e, f, g, h]);
            add::<S, _, PREDICTED>(simd, &like, above, &whole, [a, b, c], &mut sums);
            add::<S, _, PREDICTED>(simd, &like, own, &beside, [d, e], &mut sums);
            add::<S, _, PREDICTED>(simd, &like, below, &whole, [f, g, h], &mut sums);
        } else {
            let whole = TapColumns::new([-2, -1, 0, 1, 2], step, farthest);
            let beside = TapColumns::new([-2, -1, 1, 2], step, farthest);
            for line in lines {
                if line.down == 0 {
                    let weights = exp2_weights(exponents(simd, &like, line, &beside, Self::KERNEL));
                    add::<S, _, PREDICTED>(simd, &like, line, &beside, weights, &mut sums);
                } else {
                    let weights = exp2_weights(exponents(simd, &like, line, &whole, Self::KERNEL));
                    add::<S, _, PREDICTED>(simd, &like, line, &whole, weights, &mut sums);
                }
            }
        }
        let some = sums.weight.above(0.0);
        // One division instead of five. The centre's weight keeps the sum away from subnormals.
        let share = Lanes::splat(simd, 1.0) / sums.weight;
        for channel in &mut sums.color {
            *channel = (*channel * share).when_or(some, 0.0);
        }
        let [r, g, b] = sums.color;
        let v = floored_all(sums.variance * share * share);
        let l = if PREDICTED {
            sums.luminance * share
        } else {
            luminances(r, g, b)
        };
        let l = l.when_or(some, f32::NAN);
        ([r, g, b, l], v)
    }

    /// The five rows of taps around row y. With radius 1 the outer two are not read.
    #[inline(always)]
    fn lines<'b>(&self, y: usize, window: &[SourceRow<'b, IN_PLACE>]) -> [Line<'b>; 5]
    where
        'a: 'b,
    {
        let own = self.line(y, 0, window);
        let [above, below] = [self.line(y, -1, window), self.line(y, 1, window)];
        if RADIUS == 1 {
            [own, above, own, below, own]
        } else {
            let [first, last] = [self.line(y, -2, window), self.line(y, 2, window)];
            [first, above, own, below, last]
        }
    }

    /// The row of taps so many steps below. Outside the image some other row stands in, with weight zero.
    #[inline(always)]
    fn line<'b>(&self, y: usize, steps: isize, window: &[SourceRow<'b, IN_PLACE>]) -> Line<'b>
    where
        'a: 'b,
    {
        let down = steps * self.step;
        let (row, own) = match window.iter().find(|row| row.down == down) {
            Some(row) => (row, Self::KERNEL[steps.unsigned_abs()]),
            None => (&window[0], f32::NEG_INFINITY),
        };
        let there = y.wrapping_add_signed(row.down);
        let stride = self.layout.stride();
        let [r, g, b, l] = row.channels;
        Line {
            down,
            own,
            channels: [&r[..stride], &g[..stride], &b[..stride], &l[..stride]],
            variance: self.layout.cut(self.variance, there),
            tones: self.tones.map(|tones| self.layout.cut(tones, there)),
            guide: self.guide.row(there),
        }
    }

    /// −log₂e over the luminance difference that counts as one, from the variance blurred over three rows.
    #[inline(always)]
    fn sharpness<S: Simd>(
        &self,
        simd: S,
        at: usize,
        [above, own, below]: &[&[f32]; 3],
        limits: Option<&[f32]>,
        luminance: Lanes<S>,
    ) -> Lanes<S> {
        let above = blurred(simd, above, at);
        let own = blurred(simd, own, at);
        let below = blurred(simd, below, at);
        let mut deviation = (above * 0.25 + own * 0.5 + below * 0.25).sqrt();
        if let Some(limits) = limits {
            let most = Lanes::load(simd, limits, at);
            deviation = deviation.when_else((most - deviation).at_least(0.0), most);
        }
        let unit = deviation * self.sigma_luminance + luminance.abs() * 1e-3 + 1e-30;
        Lanes::splat(simd, -LOG2_E) / unit
    }
}

/// log₂ of the weights of a row of taps.
#[inline(always)]
fn exponents<S: Simd, const N: usize>(
    simd: S,
    like: &Like<S>,
    line: &Line,
    columns: &TapColumns<N>,
    kernel: &[f32],
) -> [Lanes<S>; N] {
    let taps = columns.taps(line.down);
    let mut own = [line.own; N];
    for k in 0..N {
        own[k] += kernel[columns.multiples[k].unsigned_abs()];
    }
    let Like {
        center,
        luminance,
        sharpness,
        ..
    } = like;
    let mut exponents = line.guide.exponents(simd, center, &taps, own);
    let there = Lanes::load_taps(simd, line.channels[LUMINANCE], center.at, &taps);
    for k in 0..N {
        exponents[k] = (*luminance - there[k])
            .abs()
            .mul_add(*sharpness, exponents[k]);
    }
    exponents
}

/// Adds a row of taps to the sums.
#[inline(always)]
fn add<S: Simd, const N: usize, const PREDICTED: bool>(
    simd: S,
    like: &Like<S>,
    line: &Line,
    columns: &TapColumns<N>,
    mut weights: [Lanes<S>; N],
    sums: &mut Sums<S>,
) {
    let taps = columns.taps(line.down);
    let load = |row: &[f32]| Lanes::load_taps(simd, row, like.center.at, &taps);
    if let Some((own, tones)) = like.tone.zip(line.tones) {
        for (weight, there) in weights.iter_mut().zip(load(tones)) {
            let share = own * there;
            let share = share * share;
            *weight = weight.when_else(share.at_least(1.0), *weight * share);
        }
    }
    let [tr, tg, tb] = [
        load(line.channels[0]),
        load(line.channels[1]),
        load(line.channels[2]),
    ];
    let tv = load(line.variance);
    let [r, g, b] = &mut sums.color;
    for k in 0..N {
        let weight = weights[k];
        sums.weight = sums.weight + weight;
        *r = weight.mul_add(tr[k], *r);
        *g = weight.mul_add(tg[k], *g);
        *b = weight.mul_add(tb[k], *b);
        sums.variance = (weight * weight).mul_add(tv[k], sums.variance);
    }
    if PREDICTED {
        let luminances = load(line.channels[LUMINANCE]);
        for k in 0..N {
            // NaN is a missing tap's, whose weight is 0.
            let luminance = luminances[k].when_or(luminances[k].is_number(), 0.0);
            sums.luminance = weights[k].mul_add(luminance, sums.luminance);
        }
    }
}

/// Blurs by {1, 2, 1}/4 along a row.
#[inline(always)]
fn blurred<S: Simd>(simd: S, plane: &[f32], at: usize) -> Lanes<S> {
    let [left, own, right] = [
        Lanes::load(simd, plane, at - 1),
        Lanes::load(simd, plane, at),
        Lanes::load(simd, plane, at + 1),
    ];
    left * 0.25 + own * 0.5 + right * 0.25
}
