//! Frames in which nothing moves: the mean of all samples, filtered by the mean of the guides.
//!
//! Each frame samples other points of a pixel, so that the means of colour, albedo and normal are all antialiased: divided by
//! the mean albedo, the mean colour is smooth at edges of texture, which a single frame's albedo is not. Its variance is that
//! of the samples over their number N, so that the filter does less with every frame. What lags behind light that changes is
//! the mean itself; the innovation corrects it, by a stricter test than elsewhere, as noise that is added to it stays.
//!
//! The filtered mean replaces the usual result from N = 8 to 16 on, with the share (N − 8)/8, and is then mixed with the
//! unfiltered mean ([`converge`]). Without albedo, where texture looks like noise, the usual result is mixed instead.
//!
//! Once nearly all pixels have 16 samples, the usual result is not made ([`Still::is_settled`]). The few whose light has changed,
//! or seemed to, show the filtered mean as well: neighbours of more samples steady it.

use std::array;
use std::ops::Range;

use super::Current;
use crate::image::{BandMut, Image, Interleaved, Pixels, SEGMENT, segments};
use crate::kernels::fetch::validate::Surface;
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::innovation::{self, innovation};
use crate::kernels::merge::accumulate::{CHANNELS, Images, Samples, accumulate, parts};
use crate::kernels::merge::converge::{converge, variance_of_mean};
use crate::kernels::smooth::atrous::{self, Source};
use crate::kernels::smooth::demodulate::{Texture, Way};
use crate::kernels::smooth::guide::Guide;
use crate::math::{larger, luminance, saturate};
use crate::pipelines::correction::{correct, history_factor, scale};
use crate::pipelines::illumination::illumination;
use crate::pipelines::recall::Recalled;
use crate::rows::{self, BAND, Kernel, Simd};

/// What the innovation of a mean must exceed. At half the strictness, FLIP of a still scene is a tenth worse after 128 frames.
const CORRECTION: innovation::Params = innovation::Params {
    strictness: 24.0,
    share: 0.7,
    ..innovation::Params::DEFAULT
};

/// The filtered mean shares some of the noise of the mean itself.
const STRICTNESS: f32 = 0.7;

/// Taps weigh less above so many times the exposure, as elsewhere, so that lamps leak less light.
const BRIGHTER: f32 = 16.0;

/// Samples from which the filtered mean begins to be shown, and over which its share grows.
const FEWEST: f32 = 8.0;

/// One in so many pixels may have fewer than twice as many samples when nothing else is shown. In renders at rest, up to one in
/// 80 has after 20 frames, as rare samples look like a change of light.
const SETTLED: usize = 64;

/// What goes from one such frame to the next.
pub struct Still {
    /// Frames since the last in which something moved.
    pub frames: u32,
    /// The samples as they were rendered, with texture: colour, moments and number. They are forgotten where the history is.
    mean: Interleaved,
    /// The means of albedo, emission and normal over as many frames, of those that there are.
    guides: [Option<Interleaved>; 3],
    /// Evidence of the innovation of the mean, carried to the next frame.
    evidence: Option<Interleaved>,
}

impl Still {
    /// Adds a frame's samples, before which all light has changed by a factor.
    pub fn add(before: Option<Self>, now: &Current, recalled: Option<&Recalled>) -> Self {
        let size = now.size();
        let before = before.unwrap_or_else(|| Self {
            frames: 0,
            mean: Interleaved::new(size, CHANNELS),
            guides: [None, None, None],
            evidence: None,
        });
        let (mut mean, mut guides) = (before.mean, before.guides);
        let change = recalled.map_or(1.0, |recalled| recalled.change);
        if change != 1.0 {
            let factors: [_; CHANNELS] = array::from_fn(|channel| history_factor(channel, change));
            scale(size.width, mean.data_mut(), &factors);
            if let Some(emission) = &mut guides[1] {
                scale(size.width, emission.data_mut(), &[change; 3]);
            }
        }
        let gradient = recalled.and_then(|recalled| recalled.gradient.as_ref());
        let samples = Samples {
            size,
            color: &now.frame.color,
            weight: None,
            gradient: gradient.map(Image::view),
        };
        let known = Images {
            parts: parts(mean.pixels()),
            confidence: None,
        };
        let mut merged = Interleaved::blank(size, CHANNELS);
        let outs = merged.pixels_mut().map(|all| [(0..CHANNELS, all)]);
        accumulate(samples, &known, now.accumulate, outs, std::iter::repeat(()));
        let fresh = [
            now.frame.albedo,
            now.frame.emission,
            now.frame.surface.normal,
        ];
        let [_, _, number] = parts(merged.pixels());
        let mut guides = guides.into_iter();
        let guides = fresh.map(|fresh| {
            let (fresh, mean) = (fresh?, guides.next().flatten());
            let mut mean = mean.unwrap_or_else(|| fresh.to_interleaved());
            let rows = mean.data_mut().chunks_mut(BAND * 3 * size.width);
            rows::run(&Average { fresh, number }, size.height, rows);
            Some(mean)
        });
        Self {
            frames: before.frames + 1,
            guides,
            mean: merged,
            evidence: before.evidence,
        }
    }

    /// Whether histories are so long that the filtered mean alone is shown. Pixels of black samples do not count: coarse
    /// corrections of their neighbours, which hardly change them, keep their history short.
    pub fn is_settled(&self, samples: Pixels, lengths: &[f32]) -> bool {
        let young = lengths.iter().enumerate().filter(|&(pixel, &length)| {
            length < 2.0 * FEWEST && samples.vector(pixel).iter().any(|&light| light > 0.0)
        });
        self.guides[0].is_some()
            && self.frames as f32 >= 2.0 * FEWEST
            && young.count() * SETTLED <= lengths.len()
    }

    /// Shows the filtered mean alone. Returns the variance of its luminance.
    pub fn show_alone(&mut self, now: &Current, shown: &mut [f32]) -> Image {
        shown.fill(0.0);
        self.show_from(now, shown, 0.0).expect("albedo is known")
    }

    /// Replaces what is shown by the filtered mean, as far as it has enough samples.
    pub fn show(&mut self, now: &Current, shown: &mut [f32]) {
        self.show_from(now, shown, FEWEST);
    }

    /// Replaces what is shown from so many samples on. Returns the variance of the filtered mean, which needs albedo.
    fn show_from(&mut self, now: &Current, shown: &mut [f32], fewest: f32) -> Option<Image> {
        let size = now.size();
        let bright = exposure(self.mean.pixels().part(0..3));
        if now.params.history.innovation.is_some() && self.frames > 1 {
            self.follow(now, bright);
        }
        let [mean, moments, number] = parts(self.mean.pixels());
        let [albedo, emission, normal] =
            (self.guides.each_ref()).map(|guide| guide.as_ref().map(Interleaved::pixels));
        let Some(albedo) = albedo else {
            // Nothing tells texture from noise. The usual result has been filtered as new samples find best.
            converge(shown, [mean, moments, number], bright, 1.0);
            return None;
        };
        let texture = Texture {
            albedo,
            emission,
            mask: now.texture.and_then(|texture| texture.mask),
        };
        let light = illumination(mean, Some(texture));
        let mut variance = Image::blank(size, 1);
        let noise = Noise {
            moments,
            number,
            texture: Texture {
                emission: None,
                ..texture
            },
        };
        rows::run(&noise, size.height, variance.bands());
        let normal = normal.map(|normal| {
            let mut units = Image::blank(size, 3);
            rows::run(&Normalize(normal), size.height, units.bands());
            units
        });
        let guide = Guide::new(
            size,
            now.params.atrous.reach(),
            Surface {
                depth: now.frame.surface.depth,
                normal: normal.as_ref().map(Image::pixels),
                // At edges they change from frame to frame, where the mean of the normals does not.
                ids: (now.frame.surface.ids).filter(|_| normal.is_none()),
                ..Surface::default()
            },
            None,
        );
        let source = Source {
            color: light.pixels(),
            variance: variance.pixels(),
            prediction: None,
            samples: Some(number),
            exposure: BRIGHTER * exposure(light.pixels()),
        };
        let (mut filtered, mut rest) = (Image::blank(size, 3), Image::blank(size, 1));
        let params = atrous::Params {
            relative_noise: f32::INFINITY,
            ..now.params.atrous
        };
        let bands = filtered.pixels_mut();
        atrous::atrous(source, &guide, params, bands, rest.data_mut(), None);
        let settle = Settle {
            light: filtered.pixels(),
            texture,
            number,
            fewest,
        };
        let rows = shown.chunks_mut(BAND * 3 * size.width);
        rows::run(&settle, size.height, rows);
        converge(shown, [mean, moments, number], bright, STRICTNESS);
        Some(rest)
    }

    /// Corrects the mean by what this frame's samples show to be wrong with it.
    fn follow(&mut self, now: &Current, bright: f32) {
        let size = now.size();
        let [mean, _, number] = parts(self.mean.pixels());
        let known = innovation::Known::of(self.evidence.as_ref(), now.motion.pixels());
        let mean = innovation::Predicted {
            colors: &mean,
            lengths: number,
        };
        let samples = &now.frame.color;
        let (found, rest) = innovation(samples, None, &mean, known, bright, CORRECTION);
        let bands = self.mean.pixels_mut();
        correct(&found, size, 0.0, bands, None::<std::iter::Empty<_>>);
        self.evidence = Some(rest);
    }
}

/// Adds a guide to its mean, which becomes that of as many frames as there are samples.
struct Average<'a> {
    fresh: Pixels<'a>,
    number: Pixels<'a>,
}

impl<'a> Kernel for Average<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, means: &'a mut [f32]) {
        let width = self.fresh.size.width;
        let (mut fresh, mut number) = ([[0.0; SEGMENT]; 3], [0.0; SEGMENT]);
        for (y, means) in rows::lines(rows, means, 3 * width) {
            let means = means.as_chunks_mut::<3>().0;
            for run in segments(y, width) {
                self.fresh.read_rows(run, &mut fresh);
                self.number.load(run, 0, &mut number[..run.len]);
                for (x, pixel) in means[run.x..][..run.len].iter_mut().enumerate() {
                    for (mean, fresh) in pixel.iter_mut().zip(&fresh) {
                        *mean = averaged(*mean, fresh[x], larger(number[x], 1.0));
                    }
                }
            }
        }
    }
}

/// Values that are not finite do not count.
#[inline(always)]
fn averaged(mean: f32, fresh: f32, number: f32) -> f32 {
    match (mean.is_finite(), fresh.is_finite()) {
        (true, true) => mean + (fresh - mean) / number,
        (true, false) => mean,
        (false, _) => fresh,
    }
}

/// The variance of the mean's light.
struct Noise<'a> {
    moments: Pixels<'a>,
    number: Pixels<'a>,
    texture: Texture<'a>,
}

impl<'a> Kernel for Noise<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Self::Out) {
        let (mut moments, mut number) = ([[0.0; SEGMENT]; 2], [0.0; SEGMENT]);
        for y in rows {
            let row = out.row(0, y);
            for run in segments(y, row.len()) {
                self.moments.read_rows(run, &mut moments);
                self.number.load(run, 0, &mut number[..run.len]);
                let mut deviation = [0.0; SEGMENT];
                for (x, deviation) in deviation[..run.len].iter_mut().enumerate() {
                    let (first, second) = (moments[0][x], moments[1][x]);
                    *deviation = variance_of_mean(first, second, number[x]).sqrt();
                }
                let mut gray = [deviation; 3];
                self.texture.modulate(Way::Off, run, &mut gray);
                for (x, variance) in row[run.x..][..run.len].iter_mut().enumerate() {
                    let [r, g, b] = gray.each_ref().map(|row| row[x]);
                    let deviation = luminance(r, g, b);
                    *variance = deviation * deviation;
                }
            }
        }
    }
}

/// Means of directions become directions.
struct Normalize<'a>(Pixels<'a>);

impl<'a> Kernel for Normalize<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: Self::Out) {
        let mut normal = [[0.0; SEGMENT]; 3];
        for y in rows {
            let mut units: [&mut [f32]; 3] = out.rows(y);
            for run in segments(y, self.0.size.width) {
                self.0.read_rows(run, &mut normal);
                for i in 0..run.len {
                    let [x, y, z] = normal.each_ref().map(|row| row[i]);
                    let length = (x * x + y * y + z * z).sqrt();
                    for (unit, value) in units.iter_mut().zip([x, y, z]) {
                        unit[run.x + i] = if length > 0.0 { value / length } else { 0.0 };
                    }
                }
            }
        }
    }
}

/// Shows the filtered light with its texture, by the number of samples.
struct Settle<'a> {
    light: Pixels<'a>,
    texture: Texture<'a>,
    number: Pixels<'a>,
    /// Samples up to which nothing of it is shown; 0 to show it alone.
    fewest: f32,
}

impl<'a> Kernel for Settle<'a> {
    type Out = &'a mut [f32];

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, shown: &'a mut [f32]) {
        let width = self.light.size.width;
        let (mut light, mut number) = ([[0.0; SEGMENT]; 3], [0.0; SEGMENT]);
        for (y, shown) in rows::lines(rows, shown, 3 * width) {
            let shown = shown.as_chunks_mut::<3>().0;
            for run in segments(y, width) {
                self.light.read_rows(run, &mut light);
                self.texture.modulate(Way::Back, run, &mut light);
                self.number.load(run, 0, &mut number[..run.len]);
                for (x, pixel) in shown[run.x..][..run.len].iter_mut().enumerate() {
                    let color = light.each_ref().map(|row| row[x]);
                    let share = match self.fewest {
                        0.0 => 1.0,
                        fewest => saturate((number[x] - fewest) / fewest),
                    };
                    if (color[0] + color[1] + color[2]).is_finite() {
                        for (value, color) in pixel.iter_mut().zip(color) {
                            *value += share * (color - *value);
                        }
                    }
                }
            }
        }
    }
}
