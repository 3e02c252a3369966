//! Tiles whose history is not clipped, because clipped history has predicted the next frames worse.
//!
//! The clip keeps wrong history out, and where a texture is as fine as the pixels it also keeps right history out: the colours
//! around a pixel do not contain what it shows on average. Which of both prevails is found out tile by tile: each frame leaves
//! two luminances of its result, as it is with the clip and as it would be without, and the next samples tell which is nearer
//! ([`crate::kernels::judge::choice`]). With h the history, k the clipped history, a the blend factor and s from 0 to 1 what the
//! tiles choose, interpolated between their centres, times how steady history was in the frame before,
//!   d = (h − k) min(1, (l(k) + e/16) / 4 |l(h − k)|), 0 where the clip always holds, and k ← k + s d;
//! with m the result, the two luminances are l(m) − s (1 − a) l(d) and l(m) + (1 − s) (1 − a) l(d). History that is much brighter
//! or darker is let in but in part: where a lamp has been, it would shine on. The clip always holds where samples are not
//! compared with history, where history lags, and near pixels without history of their own ([`super::lag`]). Where it has held
//! in the frame before, nothing has been predicted, and older evidence does not count.
//!
//! Inputs: the two luminances and whether history was steady (3), samples (3), motion (2 or 3), evidence (4; of an eighth of the
//! size). Outputs: what the tiles choose (1) and evidence, of an eighth of the size.

use super::fetch;
use super::lag::COVERED;
use crate::image::{Image, Interleaved, Pixels, Run, View};
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::validate::Tests;
use crate::kernels::judge::choice::{self, carry, compare, decide};
use crate::pipelines::correction::scale;
use crate::pixels::{Colors, Row};

/// Luminances of the result: with the clip and without.
const CANDIDATES: usize = 2;
/// These, and whether history was steady.
pub const PREDICTED: usize = CANDIDATES + 1;

/// What the next frame needs to choose.
pub struct Predicted {
    records: Interleaved,
    evidence: Option<Interleaved>,
}

impl Predicted {
    /// Multiplies all light by a factor.
    pub fn scale(&mut self, change: f32) {
        let width = self.records.size.width;
        let factors: [_; PREDICTED] = [change, change, 1.0];
        scale(width, self.records.data_mut(), &factors);
    }
}

/// What a frame's tiles choose.
#[derive(Default)]
pub struct Chosen {
    /// 0 for the clip, 1 for none; nothing without evidence.
    tiles: Option<Image>,
    /// What the frame before has predicted, where its pixels are now.
    fetched: Option<Image>,
    evidence: Option<Interleaved>,
}

impl Chosen {
    /// By the evidence of the frames before and of the new samples, which none of what they judge has seen.
    pub fn by(before: Option<Predicted>, samples: Pixels, motion: Pixels, exposure: f32) -> Self {
        let Some(before) = before else {
            return Self::default();
        };
        let records = before.records.pixels();
        let (fetched, coverage) = fetch(records, motion, Tests::none(), Filter::Bilinear);
        let (coverage, params) = (coverage.view(), choice::Params::default());
        let carried =
            (before.evidence).map(|known| carry(known.pixels(), motion, coverage, params.share));
        let mut evidence = carried.unwrap_or_else(|| {
            Interleaved::new(choice::tiles(samples.size), choice::channels(CANDIDATES))
        });
        let candidates = [0, 1].map(|candidate| fetched.channels(candidate..candidate + 1));
        let fresh = Covered { samples, coverage };
        compare(&fresh, &candidates, exposure, 0, &mut evidence);
        Self {
            tiles: Some(decide(evidence.pixels(), 0, params)),
            fetched: Some(fetched),
            evidence: Some(evidence),
        }
    }

    /// What the tiles choose, and how steady history was in the frame before, from 0 to 1.
    pub fn levels(&self) -> Option<[View<'_>; 2]> {
        let (tiles, fetched) = (self.tiles.as_ref()?, self.fetched.as_ref()?);
        Some([tiles.view(), fetched.channels(CANDIDATES..PREDICTED)])
    }

    /// With what the frame predicts.
    pub fn and(self, records: Interleaved) -> Predicted {
        Predicted {
            records,
            evidence: self.evidence,
        }
    }
}

/// The samples where history is all of the pixel's surface; missing elsewhere.
struct Covered<'a> {
    samples: Pixels<'a>,
    coverage: View<'a>,
}

impl Colors for Covered<'_> {
    #[inline(always)]
    fn colors(&self, run: Run, into: &mut [Row; 3]) {
        self.samples.colors(run, into);
        for row in into {
            for (value, &coverage) in row.iter_mut().zip(self.coverage.run(0, run)) {
                *value = if coverage > COVERED { *value } else { f32::NAN };
            }
        }
    }
}
