//! Detail that a smooth image lacks, restored from a noisy one as far as it exceeds the noise: the local Wiener filter.
//!
//! A smooth image s has lost detail; a noisy one y has it, under noise of known variance v. Over a window around each
//! pixel, the mean of (l_y − l_s)² is what detail and noise have in common, and the mean of v is the noise's part of it:
//!   g = max(0, 1 − c ⟨v⟩ / ⟨(l_y − l_s)²⟩),  s + g (y − s),
//! with l the luminance and ⟨·⟩ the mean over (2·radius + 1)² pixels, as far as they lie inside the image and have
//! colours and a variance (Lee 1980, *Digital Image Enhancement and Noise Filtering by Use of Local Statistics*). With
//! c = 1, g is what minimises the expected squared error.
//!
//! Inputs: smooth colour (3), noisy colour (3), variance (1) of the noisy luminance. Output: colour (3). A pixel whose
//! noisy colour is missing, or whose variance is unknown (negative, NaN or infinite), keeps its smooth colour.

use std::ops::Range;

use crate::box_sums::box_sums;
use crate::error::{Result, Whole, finite_from_0, whole};
use crate::image::{BandMut, Image, Pixels, SEGMENT, View, segments};
use crate::math::{is_present, luminance};
use crate::pixels::PixelsMut;
use crate::rows::{self, Kernel, Simd};

/// How much exceeds the noise, and over which window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// c: multiple of the variance below which a difference counts as noise; ≥ 0; 1.
    pub strictness: f32,
    /// The window reaches so many pixels to each side; 0 to 16; 1.
    pub radius: usize,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            strictness: 1.0,
            radius: 1,
        }
    }
}

impl Params {
    pub(crate) fn radius(value: impl Whole<usize>) -> Result<usize> {
        whole("radius", value, "0 to 16", |n| *n <= 16)
    }

    /// Whether all are in range.
    pub fn check(&self) -> Result<()> {
        finite_from_0("strictness", self.strictness)?;
        Self::radius(self.radius)?;
        Ok(())
    }
}

/// Restores in `smooth` what `noisy` shows beyond its variance.
pub fn restore_detail<'a>(
    smooth: Pixels<'a>,
    noisy: Pixels<'a>,
    variance: View<'a>,
    params: Params,
    restored: impl Iterator<Item = PixelsMut<'a>>,
) {
    let size = smooth.size;
    let mut parts = Image::blank(size, 2);
    let compare = Compare {
        smooth,
        noisy,
        variance,
    };
    rows::run(&compare, size.height, parts.bands());
    let kernel = Restore {
        smooth,
        noisy,
        parts,
        params,
    };
    rows::run(&kernel, size.height, restored);
}

/// Writes the squared difference in luminance and the variance; NaN and 0 where they do not count.
struct Compare<'a> {
    smooth: Pixels<'a>,
    noisy: Pixels<'a>,
    variance: View<'a>,
}

impl<'a> Kernel for Compare<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: BandMut<'a>) {
        let [mut smooth, mut noisy] = [[[0.0; SEGMENT]; 3]; 2];
        for y in rows {
            let variance = self.variance.row(0, y);
            for run in segments(y, variance.len()) {
                self.smooth.read_rows(run, &mut smooth);
                self.noisy.read_rows(run, &mut noisy);
                let mut parts = out.parts(run);
                let (Some(squares), Some(variances)) = (parts.next(), parts.next()) else {
                    continue;
                };
                for i in 0..run.len {
                    let [s, y] = [&smooth, &noisy].map(|rows| rows.each_ref().map(|row| row[i]));
                    let difference = luminance(y[0], y[1], y[2]) - luminance(s[0], s[1], s[2]);
                    let v = variance[run.x + i];
                    let known = is_present(y) & is_present(s) & (0.0..f32::INFINITY).contains(&v);
                    squares[i] = if known {
                        difference * difference
                    } else {
                        f32::NAN
                    };
                    variances[i] = if known { v } else { 0.0 };
                }
            }
        }
    }
}

struct Restore<'a> {
    smooth: Pixels<'a>,
    noisy: Pixels<'a>,
    parts: Image,
    params: Params,
}

impl<'a> Kernel for Restore<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let (width, Params { strictness, radius }) = (self.smooth.size.width, self.params);
        let mut columns = vec![];
        let [mut squares, mut variances] = [(); 2].map(|()| vec![0.0; width]);
        let [mut restored, mut detail] = [[[0.0; SEGMENT]; 3]; 2];
        let or_0 = |value: f32| if value.is_nan() { 0.0 } else { value };
        for y in rows {
            for (part, sums) in [&mut squares, &mut variances].into_iter().enumerate() {
                box_sums(self.parts.view(), part, y, radius, or_0, &mut columns, sums);
            }
            let own = self.parts.view().row(0, y);
            for run in segments(y, width) {
                self.smooth.read_rows(run, &mut restored);
                self.noisy.read_rows(run, &mut detail);
                for i in 0..run.len {
                    let x = run.x + i;
                    let noise = strictness * variances[x];
                    let exceeds = !own[x].is_nan() & (squares[x] > noise);
                    let gain = 1.0 - noise / squares[x];
                    for (restored, detail) in restored.iter_mut().zip(&detail) {
                        let more = restored[i] + gain * (detail[i] - restored[i]);
                        restored[i] = if exceeds { more } else { restored[i] };
                    }
                }
                out.write(run, &restored);
            }
        }
    }
}
