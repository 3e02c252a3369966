//! Thin features: bright or dark lines that are narrower than a pixel.
//!
//! Of the 3×3 pixels, those whose luminance is similar to the centre's, max ≤ similarity · min, belong to its feature. The
//! feature is thin if none of the four 2×2 blocks around the centre belongs to it entirely, and if it is brighter, or
//! darker, than all other pixels (after the locks of AMD's FSR 2). Jittered samples hit such a feature in some frames and
//! miss it in others, where the neighbourhood does not contain it: there its history must not be clipped.
//!
//! Input: colour (3). Output: 1 or 0 (1). Neighbours that are missing or outside count as similar: they make no line.

use std::ops::Range;

use crate::error::{Result, in_range};
use crate::image::{Pixels, SEGMENT, segments};
use crate::math::{is_present, luminance};
use crate::pixels::{Columns, PixelsMut, Rolling, lanes};
use crate::rows::{self, Kernel, Simd};

/// An error if the largest ratio of similar luminances is below 1; its default is 1.05.
pub fn check(similarity: f32) -> Result<()> {
    in_range("similarity", similarity, "a finite ratio from 1", |v| {
        v >= 1.0 && v.is_finite()
    })
}

/// Writes 1 where a feature is thin, else 0.
pub fn thin_features<'a>(
    color: Pixels<'a>,
    similarity: f32,
    thin: impl Iterator<Item = PixelsMut<'a>>,
) {
    let height = color.size.height;
    rows::run(&ThinFeatures { color, similarity }, height, thin);
}

struct ThinFeatures<'a> {
    color: Pixels<'a>,
    similarity: f32,
}

impl<'a> Kernel for ThinFeatures<'a> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut thin: PixelsMut<'a>) {
        let mut colors = Rolling::new(self.color.size.width, 1);
        let mut lights: [Columns; 3] = [[0.0; _]; 3];
        let mut out = [0.0; SEGMENT];
        for y in rows.clone() {
            colors.roll(self.color, y, y == rows.start);
            for run in segments(y, self.color.size.width) {
                for (dy, light) in (-1..).zip(&mut lights) {
                    let [r, g, b] = colors.columns(run, dy);
                    for i in 0..light.len() {
                        let l = luminance(r[i], g[i], b[i]).max(0.0);
                        light[i] = if is_present([r[i], g[i], b[i]]) {
                            l
                        } else {
                            f32::NAN
                        };
                    }
                }
                for i in 0..lanes(run) {
                    let window = lights
                        .each_ref()
                        .map(|row| [row[i], row[i + 1], row[i + 2]]);
                    out[i] = f32::from(is_thin(window, self.similarity));
                }
                thin.write(run, [&out[..]]);
            }
        }
    }
}

#[inline(always)]
fn is_thin(window: [[f32; 3]; 3], similarity: f32) -> bool {
    let own = window[1][1];
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    let mut alike = [[true; 3]; 3];
    for (row, alike) in window.iter().zip(&mut alike) {
        for (&light, alike) in row.iter().zip(alike) {
            let differs = light.max(own) > similarity * light.min(own);
            let differs = differs & !light.is_nan();
            low = if differs & (light < low) { light } else { low };
            high = if differs & (light > high) {
                light
            } else {
                high
            };
            *alike = !differs;
        }
    }
    let block = |y: usize, x: usize| alike[y][1] & alike[1][x] & alike[y][x];
    let solid = block(0, 0) | block(0, 2) | block(2, 0) | block(2, 2);
    ((own > high) | (own < low)) & !solid & !own.is_nan()
}
