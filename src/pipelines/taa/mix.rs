//! How much of the samples, and of the denoised colour, each tile shows instead of the output stage's result.
//!
//! Frames of many samples are antialiased as they come, and have little noise: what the stage still adds is then blur and lag,
//! and at some point the denoiser does no better. With y the samples, a the denoised colour and b the stage's result, a pixel
//! shows m + g (y − m), m = b + λ (a − b). Each tile's λ and g are those that would have made the error of the frame before
//! least ([`collocation`]); frames are fetched along the motion, bilinearly. In frames of one sample, g is above 0 in tiles
//! here and there by chance, and λ anything. A tile shows samples, therefore, only if [`ASK`] of the tiles around it ask for
//! some. Where one in [`FEWEST`] does, the frame has little noise, and all tiles show as much denoised colour as their own λ
//! says. So they do if the λ of all tiles together, which is no chance, is at least [`DENOISED_FROM`]. Where neither holds,
//! all show b, and the next [`REST`] frames are not judged; so it is where the noise of frames repeats, which looks like
//! detail. Frames whose jitter is known are not antialiased, however little noise they have: a tile shows denoised colour
//! only if it shows samples, too.
//!
//! A sample is held down to [`BRIGHTEST`] times the result; a result in which it has a share of an eighth or more is bright
//! enough to leave it alone. A firefly, nearly all of a tile's evidence, would otherwise be shown at its full brightness.
//! What is shown of it is at most [`SHOWN`] times the result, as a share that is right for the tile is still too much for
//! its brightest sample.
//!
//! What is shown may differ from the result by smoothed edges. The result is judged without: so no choice depends on them.
//!
//! Inputs: samples (3), denoised colour (3), result (3), motion (2 or 3), of the frame before: luminances (3), luminance of the
//! samples before it (1), evidence (of an eighth of the size). In place: what is shown (3). Outputs: what the next frame needs.

use std::ops::Range;

use super::fetch;
use crate::image::{
    BandMut, Image, Interleaved, Pixels, SEGMENT, Size, View, deinterleave, interleave, segments,
};
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::validate::Tests;
use crate::kernels::judge::choice::Levels;
use crate::kernels::judge::collocation::{self, Luminances, PLANES, SHARES, collocate};
use crate::math::{black_level, is_present, larger, luminance};
use crate::pipelines::correction::scale;
use crate::pipelines::frame::blacken_missing;
use crate::pixels::{Colors, Row};
use crate::rows::{self, BAND, Kernel, Simd};

/// Of the samples, the denoised colour and the result.
const LUMINANCES: usize = 3;

/// A tile asks for samples, or for the denoised colour, if it would give them more than this weight.
const ASKS: f32 = 0.05;
/// How many of how many tiles must ask for samples, at most [`REACH`] tiles away along each axis. Of frames of 128×96 pixels,
/// up to a fifth do with one sample, and mostly more than a third with 16.
const ASK: [u32; 2] = [3, 10];
const REACH: usize = 4;
/// The λ of all tiles together from which on each follows its own. With one sample behind `SVGF`, no sequence of the study that
/// has albedo reaches a tenth of it at 128×96 pixels; with 16 samples, most exceed it. Behind a network, some do with one sample.
const DENOISED_FROM: f32 = 0.25;
/// One over the least fraction of tiles that must ask for it themselves, as a few lamps can outweigh all other tiles. With one
/// sample a twentieth to three tenths do, with 16 mostly more than half.
const DENOISED_IN: usize = 4;
/// One over the least fraction of tiles that must agree: single groups do by chance.
const FEWEST: usize = 8;
/// Frames for which the test pauses after too few tiles have agreed. Its evidence takes four frames, so that five of nine cost
/// nothing.
const REST: u32 = 5;

/// No sample counts for more than so many times the result's luminance plus a sixteenth of the exposure.
const BRIGHTEST: f32 = 8.0;
/// No sample is shown as more than so many times that. With 2, a box of 64 samples behind a network has 3 % more error.
const SHOWN: f32 = 3.0;

/// What the next frame needs to judge this one.
#[derive(Default)]
pub struct Seen {
    luminances: Option<Interleaved>,
    /// Luminance of the samples before, where they are in this frame; NaN where they are not.
    samples_before: Option<Image>,
    evidence: Option<Interleaved>,
    /// Frames that are not judged.
    rest: u32,
}

impl Seen {
    /// Multiplies all light by a factor.
    pub fn scale(&mut self, change: f32) {
        if let Some(luminances) = &mut self.luminances {
            let width = luminances.size.width;
            scale(width, luminances.data_mut(), &[change; LUMINANCES]);
        }
        if let Some(plane) = &mut self.samples_before {
            let width = plane.size.width;
            scale(width, plane.data_mut(), &[change]);
        }
    }
}

/// What is known of the samples' noise.
pub struct SampleNoise {
    /// Whether it is that of the frame before: such samples do not judge, and nothing is mixed.
    pub repeats: bool,
    /// Whether all samples of a frame are at one known place of their pixels: they are aliased however little noise they have.
    pub jittered: bool,
}

/// Mixes samples and denoised colour into what is shown. The result is judged as it was before its edges were smoothed. Returns
/// what the next frame needs.
pub fn mix(
    before: Option<Seen>,
    samples: Pixels,
    denoised: Pixels,
    result: Pixels,
    motion: Pixels,
    exposure: f32,
    noise: SampleNoise,
    shown: &mut [f32],
) -> Seen {
    let size = samples.size;
    let mut before = before.unwrap_or_default();
    let resting = Seen {
        rest: REST,
        ..Seen::default()
    };
    if noise.repeats {
        return resting;
    }
    if let Some(rest) = before.rest.checked_sub(1) {
        return Seen {
            rest,
            ..Seen::default()
        };
    }
    let held = Held {
        samples,
        black: black_level(exposure),
    };
    let (mut shares, mut evidence, mut samples_before) = (None, None, None);
    if let Some(luminances) = before.luminances.take() {
        let recent = fetch(luminances.pixels(), motion, Tests::none(), Filter::Bilinear);
        drop(luminances);
        let carried = (before.evidence).map(|known| {
            collocation::shares(known.pixels(), motion, recent.1.view(), collocation::SHARE)
        });
        let (mut found, left) = carried.unzip();
        if let Some((shares, evidence)) = found.as_mut().zip(left.as_ref()) {
            let smooth = !noise.jittered && ask_for_denoised(shares, evidence);
            if !agree(shares, noise.jittered) && !smooth {
                return resting;
            }
        }
        let recent = forget(recent.0, &recent.1);
        if let Some(plane) = before.samples_before.take() {
            let (older, coverage) = fetch(plane.pixels(), motion, Tests::none(), Filter::Bilinear);
            let older = forget(older, &coverage);
            let compared = Compared {
                held: &held,
                result,
                recent: recent.view(),
                older: older.view(),
            };
            let mut sums = left.unwrap_or_else(|| collocation::nothing(size));
            collocate(&compared, exposure, &mut sums);
            evidence = Some(sums);
        }
        let before = Pixels::from(recent.channels(0..1)).to_planes();
        (shares, samples_before) = (found, Some(before));
    }
    let mut luminances = Interleaved::blank(size, LUMINANCES);
    let [first, second] = [0, 1].map(|c| (shares.as_ref()).map(|shares| shares.channels(c..c + 1)));
    let kernel = Mix {
        held,
        denoised,
        result,
        shares: first.zip(second).map(|(a, b)| [a, b].map(Levels)),
    };
    let band = BAND * size.width;
    let outs =
        (shown.chunks_mut(3 * band)).zip(luminances.data_mut().chunks_mut(LUMINANCES * band));
    rows::run(&kernel, size.height, outs);
    Seen {
        luminances: Some(luminances),
        samples_before,
        evidence,
        rest: 0,
    }
}

/// Whether the denoised colour is better for all tiles together, and for many of them alone.
fn ask_for_denoised(shares: &Image, evidence: &Interleaved) -> bool {
    let tiles = shares.plane(0);
    let asking = tiles.iter().filter(|&&share| share > ASKS).count();
    let [of_all, _] = collocation::share_of_all(evidence);
    of_all >= DENOISED_FROM && DENOISED_IN * asking >= tiles.len()
}

/// Lets tiles show no samples where too few around them ask for some, nor denoised colour there if frames are jittered.
/// Returns whether enough ask.
fn agree(shares: &mut Image, jittered: bool) -> bool {
    let Size { height, width } = shares.size;
    // Number of tiles that ask, above and to the left of a corner.
    let mut before = vec![0; (height + 1) * (width + 1)];
    for (y, row) in shares.plane(1).chunks(width).enumerate() {
        let mut count = 0;
        for (x, &samples) in row.iter().enumerate() {
            count += u32::from(samples > ASKS);
            before[(y + 1) * (width + 1) + x + 1] = before[y * (width + 1) + x + 1] + count;
        }
    }
    let near = |at: usize, side: usize| [at.saturating_sub(REACH), (at + REACH + 1).min(side)];
    let pixels = height * width;
    let mut others = 0;
    for y in 0..height {
        let [top, bottom] = near(y, height).map(|y| y * (width + 1));
        for x in 0..width {
            let [left, right] = near(x, width);
            let inside = |row: usize| before[row + right] - before[row + left];
            let tiles = (bottom - top) / (width + 1) * (right - left);
            if ASK[1] * (inside(bottom) - inside(top)) >= ASK[0] * tiles as u32 {
                others += 1;
            } else {
                for c in usize::from(!jittered)..collocation::SHARES {
                    shares.data_mut()[c * pixels + y * width + x] = 0.0;
                }
            }
        }
    }
    others * FEWEST >= pixels
}

/// Makes pixels that are not covered NaN.
fn forget(mut image: Image, coverage: &Image) -> Image {
    let size = image.size;
    rows::run(&Forget(coverage.view()), size.height, image.bands());
    image
}

struct Forget<'a>(View<'a>);

impl<'a> Kernel for Forget<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut image: BandMut<'a>) {
        for y in rows {
            let covered = self.0.row(0, y);
            for channel in 0..image.channels() {
                for (value, &coverage) in image.row(channel, y).iter_mut().zip(covered) {
                    *value = if coverage > 0.0 { *value } else { f32::NAN };
                }
            }
        }
    }
}

/// Samples, none of them much brighter than the result.
struct Held<'a> {
    samples: Pixels<'a>,
    /// Light below it is black.
    black: f32,
}

impl Held<'_> {
    /// The sample, of at most so many times the result's luminance, and its own luminance.
    #[inline(always)]
    fn beside(&self, sample: [f32; 3], result: f32, times: f32) -> ([f32; 3], f32) {
        let [r, g, b] = sample;
        let bright = luminance(r, g, b);
        let most = times * (larger(result, 0.0) + self.black);
        let factor = if bright > most { most / bright } else { 1.0 };
        let held = sample.map(|value| value * factor);
        (held, luminance(held[0], held[1], held[2]))
    }
}

/// What the evidence compares: luminances of new samples, of those of the frame before, of those before that, and of denoised
/// colour and result of the frame before.
struct Compared<'a> {
    held: &'a Held<'a>,
    result: Pixels<'a>,
    recent: View<'a>,
    older: View<'a>,
}

impl Luminances for Compared<'_> {
    fn size(&self) -> Size {
        self.result.size
    }

    #[inline(always)]
    fn read(&self, y: usize, [fresh, recent, older, denoised, result]: [&mut [f32]; PLANES]) {
        let [mut colors, mut results] = [[[0.0; SEGMENT]; 3]; 2];
        for run in segments(y, self.result.size.width) {
            self.held.samples.colors(run, &mut colors);
            self.result.colors(run, &mut results);
            results.iter_mut().for_each(|row| blacken_missing(row));
            for (i, fresh) in fresh[run.x..][..run.len].iter_mut().enumerate() {
                let [sample, [r, g, b]] =
                    [&colors, &results].map(|rows| [0, 1, 2].map(|c| rows[c][i]));
                *fresh = (self.held).beside(sample, luminance(r, g, b), BRIGHTEST).1;
            }
        }
        for (c, row) in [recent, denoised, result].into_iter().enumerate() {
            row.copy_from_slice(self.recent.row(c, y));
        }
        older.copy_from_slice(self.older.row(0, y));
    }
}

impl Mix<'_> {
    /// Mixes a run into what is shown, and tells the luminances of samples, denoised colour and result.
    #[inline(always)]
    fn mix(
        &self,
        sample: &[Row; 3],
        denoised: &[Row; 3],
        result: &[Row; 3],
        levels: &[Row; SHARES],
        shown: &mut [Row; 3],
        luminances: &mut [Row; LUMINANCES],
    ) {
        for i in 0..SEGMENT {
            let [y, a, b, result] =
                [sample, denoised, shown, result].map(|rows| [0, 1, 2].map(|c| rows[c][i]));
            let [denoised, before] = [a, result].map(|[r, g, b]| luminance(r, g, b));
            let (_, sample) = self.held.beside(y, before, BRIGHTEST);
            let (y, _) = self.held.beside(y, before, SHOWN);
            let known = [sample, denoised, before];
            // What is missing of samples and denoised colour has no share.
            let smooth: [f32; 3] = std::array::from_fn(|c| b[c] + levels[0][i] * (a[c] - b[c]));
            let smooth = if is_present(smooth) { smooth } else { b };
            let mixed: [f32; 3] =
                std::array::from_fn(|c| smooth[c] + levels[1][i] * (y[c] - smooth[c]));
            let finite = is_present(mixed);
            for c in 0..3 {
                luminances[c][i] = known[c];
                shown[c][i] = if finite { mixed[c] } else { smooth[c] };
            }
        }
    }
}

/// Mixes as the tiles' shares say.
struct Mix<'a> {
    held: Held<'a>,
    denoised: Pixels<'a>,
    result: Pixels<'a>,
    /// Of the denoised colour, and of the samples.
    shares: Option<[Levels<'a>; 2]>,
}

impl<'a> Kernel for Mix<'a> {
    type Out = (&'a mut [f32], &'a mut [f32]);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (shown, luminances): Self::Out) {
        let Size { width, .. } = self.denoised.size;
        let [mut sample, mut denoised, mut result, mut mixed, mut known] = [[[0.0; SEGMENT]; 3]; 5];
        let mut levels = [[0.0; SEGMENT]; SHARES];
        let shown = rows::lines(rows.clone(), shown, 3 * width);
        let luminances = rows::lines(rows, luminances, LUMINANCES * width);
        for ((y, shown), (_, luminances)) in shown.zip(luminances) {
            for run in segments(y, width) {
                let (start, len) = (3 * run.x, 3 * run.len);
                let shown = &mut shown[start..][..len];
                self.held.samples.colors(run, &mut sample);
                self.denoised.colors(run, &mut denoised);
                self.result.colors(run, &mut result);
                result.iter_mut().for_each(|row| blacken_missing(row));
                deinterleave(shown, mixed.iter_mut().map(Row::as_mut_slice));
                if let Some(shares) = &self.shares {
                    for (levels, shares) in levels.iter_mut().zip(shares) {
                        shares.read(run, &mut levels[..run.len]);
                    }
                }
                self.mix(&sample, &denoised, &result, &levels, &mut mixed, &mut known);
                let luminances = &mut luminances[start..][..len];
                interleave(known.iter().map(Row::as_slice), luminances);
                if self.shares.is_some() {
                    interleave(mixed.iter().map(Row::as_slice), shown);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_tiles_do_not_make_all_show_the_denoised_colour() {
        let [size, tiles] = [128, 16].map(|side| Size {
            height: side,
            width: side,
        });
        // The denoised colour is the signal, the result has a quarter of the samples' noise.
        let tile = [
            2.0, 1.0, 1.0, 2.0, 1.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.25, 1.0, 64.0,
        ];
        let mut evidence = collocation::nothing(size);
        for record in evidence.data_mut().chunks_exact_mut(collocation::CHANNELS) {
            record.copy_from_slice(&tile);
        }
        let mut shares = Image::blank(tiles, collocation::SHARES);
        for (asking, found) in [(63, false), (64, true)] {
            shares.data_mut()[..asking].fill(0.5);
            assert_eq!(ask_for_denoised(&shares, &evidence), found);
        }
    }
}
