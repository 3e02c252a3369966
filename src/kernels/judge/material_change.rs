//! Material change: surfaces whose texture or material is another than in the frame before, as on a screen that plays or where
//! a texture is swapped.
//!
//! A pixel differs if, by luminance y of albedo, all texels of its 2×2 footprint in the frame before differ:
//!   |y − y′| > d max(|y|, |y′|), but for texels that together weigh less than 0.01.
//! Its material has changed if, besides, more than a share s of the pixels around it differ. Fine texture is sampled elsewhere
//! in each frame, so that single pixels of it always differ, and so do those beside edges.
//!
//! Inputs: luminance of the albedo (1), of that of the frame before (1), motion (2 or 3). Output: 1 where the material has
//! changed, else 0 (1). What was outside or is missing does not differ.

use std::ops::Range;

use crate::box_sums::box_sums;
use crate::error::{Result, Whole, finite_from_0, from_0_to_1, whole};
use crate::image::{BandMut, Image, Pixels, View, segments};
use crate::kernels::fetch::footprint::{Footprints, MIN_COVERAGE};
use crate::kernels::fetch::validate::Tests;
use crate::pixels::MotionLanes;
use crate::rows::{self, BAND, Kernel, Simd};

/// What counts as a change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Relative difference of luminance; ≥ 0.
    pub relative_luminance: f32,
    /// Share of pixels around that must differ; from 0 to 1.
    pub share: f32,
    /// Of the square around a pixel, as far as it lies inside the image; 0 to 16.
    pub radius: usize,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            relative_luminance: 0.2,
            share: 0.6,
            radius: 7,
        }
    }
}

impl Params {
    pub(crate) fn radius(value: impl Whole<usize>) -> Result<usize> {
        whole("radius", value, "0 to 16", |n| *n <= 16)
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        finite_from_0("relative_luminance", self.relative_luminance)?;
        from_0_to_1("share", self.share)?;
        Self::radius(self.radius)?;
        Ok(())
    }
}

/// Where the material has changed; none if it has nowhere.
pub fn material_change(now: View, before: View, motion: Pixels, params: Params) -> Option<Image> {
    let size = now.size;
    let mut differing = Image::blank(size, 1);
    let compare = Compare {
        now,
        before: before.plane(0),
        motion,
        relative_luminance: params.relative_luminance,
    };
    let mut some = vec![false; size.height.div_ceil(BAND)];
    rows::run(&compare, size.height, differing.bands().zip(&mut some));
    if !some.contains(&true) {
        return None;
    }
    let mut changed = Image::blank(size, 1);
    let gather = Gather {
        differing: differing.view(),
        params,
    };
    rows::run(&gather, size.height, changed.bands().zip(&mut some));
    some.contains(&true).then_some(changed)
}

/// A band of an output, and whether any of its pixels is 1.
type Marks<'a> = (BandMut<'a>, &'a mut bool);

/// Writes 1 where a pixel differs.
struct Compare<'a> {
    now: View<'a>,
    before: &'a [f32],
    motion: Pixels<'a>,
    relative_luminance: f32,
}

impl Compare<'_> {
    /// Values that are not finite are the same as any.
    #[inline(always)]
    fn same(&self, now: f32, before: f32) -> bool {
        let larger = now.abs().max(before.abs());
        let differs = (now - before).abs() > self.relative_luminance * larger;
        !(differs & now.is_finite() & before.is_finite())
    }
}

impl<'a> Kernel for Compare<'a> {
    type Out = Marks<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut differing, some): Marks<'a>) {
        *some = false;
        let size = self.now.size;
        let (mut lanes, mut footprints) = (MotionLanes::zeroed(), Footprints::new(size));
        for y in rows {
            for run in segments(y, size.width) {
                let motion = lanes.load(&self.motion, run);
                footprints.find(run, motion, false, &Tests::none());
                let own = self.now.run(0, run);
                let differing = &mut differing.row(0, y)[run.x..][..run.len];
                for (i, differs) in differing.iter_mut().enumerate() {
                    // Mostly the first texel tells.
                    let (at, weight) = (footprints.at[i] as usize, footprints.weights[0][i]);
                    if weight >= MIN_COVERAGE && self.same(own[i], self.before[at]) {
                        *differs = 0.0;
                        continue;
                    }
                    let found = footprints.taps(i, |at| self.same(own[i], self.before[at]));
                    let known = footprints.coverage[i] >= MIN_COVERAGE;
                    let apart = known && found.weight() < MIN_COVERAGE;
                    *differs = f32::from(apart);
                    *some |= apart;
                }
            }
        }
    }
}

/// Writes 1 where a pixel differs and enough of those around it do.
struct Gather<'a> {
    differing: View<'a>,
    params: Params,
}

impl<'a> Kernel for Gather<'a> {
    type Out = Marks<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut changed, some): Marks<'a>) {
        *some = false;
        let Params { radius, share, .. } = self.params;
        let (height, width) = (self.differing.size.height, self.differing.size.width);
        let (mut columns, mut sums) = (vec![], vec![0.0; width]);
        let inside = |at: usize, side: usize| side.min(at + radius + 1) - at.saturating_sub(radius);
        for y in rows {
            let own = self.differing.row(0, y);
            let out = changed.row(0, y);
            if own.iter().all(|&differs| differs == 0.0) {
                out.fill(0.0);
                continue;
            }
            box_sums(self.differing, 0, y, radius, |v| v, &mut columns, &mut sums);
            let down = inside(y, height);
            for (x, changed) in out.iter_mut().enumerate() {
                let least = share * (down * inside(x, width)) as f32;
                let has_changed = own[x] > 0.0 && sums[x] > least;
                *changed = f32::from(has_changed);
                *some |= has_changed;
            }
        }
    }
}
