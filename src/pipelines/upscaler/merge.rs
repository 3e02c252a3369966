//! The merge of an upscaler: new samples join the history, which escapes the clip where it can be trusted.
//!
//! With c the reprojection's coverage, o the disocclusion, r the reactive mask and |m| the motion, history is trusted by
//!   t = c (1 − o) (1 − r),
//! and held, which is to say not clipped, by
//!   h = max((1 − min(4 λ, 1)) (1 − haste(|m|)), l),  l = lock · (1 − clamp(4 Λ − 1, 0, 1)),
//! λ being the temporal gradient and haste 0 where all stands still, 1 from fast motion on. A lock is set to 1 by a thin
//! feature near a sample, follows the history, and opens over its lifetime L, or as the light changes all around, by Λ:
//!   lock ← max(l t − 1/L, thin · min(w, 1)),
//! w being the samples that the frame has near the pixel. History counts N samples, at most 1/α − 1 for the blend factor α
//! that `blend_factor` gives for t and |m|, and becomes
//!   N ← N + w,  c ← lerp(lerp(clipped, history, h), new, w/N).
//!
//! Inputs of the output's size: new colour (3), w (1), history (5: colour, N, lock), c, failed tests (1), clipped history (3),
//! motion (2). Of the input's: o, λ, Λ, thin, and r, optional (1). Outputs: history (5), N, t and failed tests.

use std::ops::Range;

use super::grids::Grids;
use super::{Params, Past};
use crate::image::{Image, Interleaved, Run, SEGMENT, View, segments};
use crate::kernels::fetch::validate::rejection;
use crate::kernels::judge::blend_factor;
use crate::kernels::merge::blend::{Weighting, mix};
use crate::math::{is_present, saturate};
use crate::pipelines::frame::Report;
use crate::pixels::{Colors, MotionLanes, MotionRun, PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// Channels of the history: colour 0 to 2, samples 3, lock 4.
pub const CHANNELS: usize = 5;
const SAMPLES: usize = 3;
const LOCK: usize = 4;

/// History is held less the larger the temporal gradient, and not at all where this times the gradient reaches 1: where a
/// quarter of the light has changed.
const CHANGE: f32 = 4.0;

pub struct Merge<'a> {
    pub params: Params,
    pub grids: Grids,
    pub color: Image,
    pub weight: Image,
    pub past: Past,
    pub clipped: Image,
    pub motion: Image,
    pub disoccluded: Image,
    /// λ: the gradient in each cell of 2×2 samples.
    pub change: Image,
    /// Λ: the same with the cells around it.
    pub change_around: Image,
    pub thin: Image,
    pub reactive: Option<View<'a>>,
}

impl Merge<'_> {
    /// Returns the new history.
    pub fn run(&self, report: Vec<Report>) -> Interleaved {
        let size = self.color.size;
        let mut history = Interleaved::blank(size, CHANNELS);
        rows::run(self, size.height, history.pixels_mut().zip(report));
        history
    }
}

impl<'a> Kernel for Merge<'a> {
    type Out = (PixelsMut<'a>, Report<'a>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut history, mut report): Self::Out) {
        let mut lanes = MotionLanes::zeroed();
        let [mut color, mut old, mut clipped, mut merged] = [[[0.0; SEGMENT]; 3]; 4];
        let mut found = Found::zeroed();
        for run in rows.flat_map(|y| segments(y, self.color.size.width)) {
            let motion = lanes.load(&self.motion.pixels(), run);
            self.color.pixels().colors(run, &mut color);
            self.clipped.pixels().colors(run, &mut clipped);
            self.past.color().colors(run, &mut old);
            self.find_trust(run, &mut found);
            self.find_weights(run, motion, &color, &mut found);
            let unclipped = old.each_ref().map(|row| &row[..run.len]);
            let hold = &found.hold;
            mix(unclipped, &clipped, hold, Weighting::None, 1.0, &mut merged);
            let new = color.each_ref().map(|row| &row[..run.len]);
            mix(new, &merged, &found.factor, Weighting::None, 1.0, &mut old);
            let [r, g, b] = old.each_ref().map(Row::as_slice);
            history.write(run, [r, g, b, &found.samples, &found.lock]);
            report.write(run, &found.samples, &found.trust, &found.failed);
        }
    }
}

/// Per pixel of a run: samples and lock of the merged history, trust in the old one, the tests that it failed, how far it is
/// held, and the blend factor of the new samples.
struct Found {
    samples: Row,
    lock: Row,
    trust: Row,
    failed: [u8; SEGMENT],
    hold: Row,
    factor: Row,
}

impl Found {
    fn zeroed() -> Self {
        let [samples, lock, trust, hold, factor] = [[0.0; SEGMENT]; 5];
        Self {
            samples,
            lock,
            trust,
            failed: [0; SEGMENT],
            hold,
            factor,
        }
    }
}

impl Merge<'_> {
    #[inline(always)]
    fn find_trust(&self, run: Run, found: &mut Found) {
        let coverage = self.past.coverage.view().run(0, run);
        let failed = self.past.rejection.view().run(0, run);
        let disoccluded = self.disoccluded.plane(0);
        for i in 0..run.len {
            let at = self.grids.nearest(run.x + i, run.y);
            let reacts = match self.reactive {
                // A NaN in the mask counts as 0.
                Some(reactive) => saturate(reactive.plane(0)[at]),
                None => 0.0,
            };
            let hidden = if disoccluded[at] > 0.0 {
                rejection::DEPTH
            } else {
                0
            };
            found.trust[i] = coverage[i] * (1.0 - disoccluded[at]) * (1.0 - reacts);
            found.failed[i] = failed[i] | hidden;
        }
    }

    #[inline(always)]
    fn find_weights(&self, run: Run, motion: MotionRun, color: &[Row; 3], found: &mut Found) {
        let Found {
            samples,
            lock,
            trust,
            hold,
            factor,
            ..
        } = found;
        let past = |channel| self.past.history.view().run(channel, run);
        let (counts, locks) = (past(SAMPLES), past(LOCK));
        let weights = self.weight.view().run(0, run);
        let (change, around) = (self.change.plane(0), self.change_around.plane(0));
        let thin = self.thin.plane(0);
        let mut hastes = [0.0; SEGMENT];
        let factors = self.params.blend_factor;
        let haste = blend_factor::Params {
            alpha: 0.0,
            fast_alpha: 1.0,
            ..factors
        };
        haste.shares(&[1.0; SEGMENT][..run.len], Some(motion), &mut hastes);
        factors.shares(&trust[..run.len], Some(motion), factor);
        for i in 0..run.len {
            let at = self.grids.nearest(run.x + i, run.y);
            let same = 1.0 - (CHANGE * change[at]).min(1.0);
            // Samples that miss a bright line change what is around it, too, but by less.
            let locked = locks[i] * (1.0 - saturate(CHANGE * around[at] - 1.0));
            let kept = locked * trust[i] - 1.0 / self.params.lifetime;
            lock[i] = kept.max(thin[at] * weights[i].min(1.0));
            hold[i] = (same * (1.0 - hastes[i])).max(locked);
            let present = is_present([color[0][i], color[1][i], color[2][i]]);
            let new = if present { weights[i] } else { 0.0 };
            let old = counts[i].min(1.0 / factor[i] - 1.0);
            samples[i] = old + new;
            factor[i] = if old > 0.0 { new / samples[i] } else { 1.0 };
        }
    }
}
