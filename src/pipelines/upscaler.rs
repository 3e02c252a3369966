//! Temporal upscaling, as a list of this library's kernels:
//!
//!   (motion from cameras) → dilate → disocclusion → reproject → (suppress fireflies) → thin features → resample
//!     → temporal gradient → clip → blend → sharpen
//!
//! The history is of the output's size, everything that comes with a frame of the input's ([`grids`]). A pixel's history
//! counts samples: a frame adds as many as it has near the pixel, and old and new are blended by these counts.
//!
//! Clipping would forget what single jittered frames cannot show. History escapes it where it stands still, as far as the
//! new samples do not contradict it beyond their noise (the temporal gradient), and where a thin feature is locked, which
//! most frames contradict.

mod grids;
mod merge;

use self::grids::Grids;
use self::merge::{CHANNELS, Merge};
use super::frame::{Frame, Output, Steps, Summary, Upkeep, check_size, names};
use super::illumination::samples_without_fireflies;
use crate::error::{Error, Result, from_0_to_1, in_range};
use crate::image::{Image, Interleaved, Pixels, SEGMENT, Size, View, segments};
use crate::kernels::camera::dilate::{self, Choice, dilate};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::footprint::{Filter, Wide};
use crate::kernels::fetch::reproject::{self, reproject};
use crate::kernels::fetch::validate::{Tests, Threshold};
use crate::kernels::judge::blend_factor;
use crate::kernels::judge::disocclusion::{self, disocclusion};
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::gradient::{self, find_gradient};
use crate::kernels::judge::neighborhood::{self, Bounds, Response, Space, clip_history};
use crate::kernels::judge::thin_features::thin_features;
use crate::kernels::merge::accumulate::count_missing;
use crate::kernels::smooth::fireflies;
use crate::kernels::smooth::sharpen::{self, sharpen};
use crate::pixels::PixelsMut;

/// Parameters of [`Upscaler`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Pixels of the output to one of the input, along each side; 1 to 4; 2.
    pub scale: f64,
    /// Least blend factor of a sample.
    pub blend_factor: blend_factor::Params,
    /// Relative difference of depth above which a nearer surface hid a farther one; 0 to 1; 0.05.
    pub separation: f32,
    /// Frames after which the lock of a thin feature opens; above 0; 16.
    pub lifetime: f32,
    /// Strength of the sharpening; 0, which leaves it out, to 1; 0.
    pub sharpness: f32,
    /// Whether outliers of the samples are held down first.
    pub fireflies: Option<fireflies::Params>,
}

const CLIP: neighborhood::Params = neighborhood::Params {
    bounds: Bounds::Variance,
    gamma: 1.0,
    radius: 1,
    space: Space::ToneMappedYCoCg,
    response: Response::Clamp,
    exposure: 1.0,
};
const GRADIENT: gradient::Params = gradient::Params {
    noise: 2.2,
    passes: 1,
    widest: 1,
};
/// A frame that misses a thin feature hardly changes the mean around it.
const AROUND: gradient::Params = gradient::Params {
    passes: 3,
    widest: 3,
    ..GRADIENT
};
/// Luminances within this ratio belong to one thin feature.
const SIMILARITY: f32 = 1.05;
const FETCH: reproject::Params = reproject::Params::of(Filter::Wide(Wide::CatmullRom5));

impl Default for Params {
    fn default() -> Self {
        Self {
            scale: 2.0,
            blend_factor: blend_factor::Params {
                alpha: 0.06,
                fast_alpha: 0.5,
                speed: Threshold {
                    full: 0.0,
                    none: 1.0,
                },
            },
            separation: 0.05,
            lifetime: 16.0,
            sharpness: 0.0,
            fireflies: None,
        }
    }
}

impl Params {
    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        if !(1.0..=4.0).contains(&self.scale) {
            return Err(Error::value("scale", "a number from 1 to 4", self.scale));
        }
        self.blend_factor.check()?;
        disocclusion::check(self.separation)?;
        self.fireflies
            .iter()
            .try_for_each(fireflies::Params::check)?;
        in_range("lifetime", self.lifetime, "frames above 0", |v| v > 0.0)?;
        from_0_to_1("sharpness", self.sharpness)
    }

    /// The output's size for an input.
    pub fn scaled(&self, size: Size) -> Size {
        let side = |side: usize| (side as f64 * self.scale).round_ties_even() as usize;
        Size {
            height: side(size.height),
            width: side(size.width),
        }
    }
}

/// What one frame leaves to the next.
struct State {
    /// Of the input.
    size: Size,
    history: Interleaved,
    camera: Option<Camera>,
}

/// Temporal upscaling.
pub struct Upscaler {
    params: Params,
    upkeep: Upkeep,
    state: Option<State>,
}

impl Upscaler {
    /// A pipeline without history; an error if a parameter is out of range.
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            params,
            upkeep: Upkeep::default(),
            state: None,
        })
    }
}

debug_params!(Upscaler, params);

impl Steps for Upscaler {
    fn result_size(&self, size: Size) -> Size {
        self.params.scaled(size)
    }

    fn upkeep(&mut self) -> &mut Upkeep {
        &mut self.upkeep
    }

    fn forget(&mut self) {
        self.state = None;
    }

    fn next(&mut self, frame: &Frame, mut output: Output) -> Result<Summary> {
        let (params, fresh) = (self.params, frame.color);
        if let Some(before) = &self.state {
            check_size(before.size, fresh.size)?;
        }
        let (before, mut used) = (self.state.take(), vec![]);
        let camera = before.as_ref().and_then(|before| before.camera.as_ref());
        let motion = frame.motion(camera, None, &mut used);
        used.extend(names([
            ("depth", frame.surface.depth.is_some()),
            ("jitter", frame.jitter.is_some()),
            ("reactive", frame.reactive.is_some()),
        ]));
        let depth = frame.surface.depth.map(Pixels::plane);
        let large = params.scaled(fresh.size);
        let grids = Grids::new(fresh.size, large, frame.jitter.unwrap_or_default());

        let choice = Choice::of(depth, None);
        let dilated = dilate(motion.pixels(), choice, dilate::Params::EDGES);
        let disoccluded = find_disoccluded(depth, motion.pixels(), params.separation);
        let motion = grids.enlarge_motion(dilated.pixels());
        let past = Past::reproject(before.as_ref(), motion.pixels());
        let then = grids.at_samples(past.color());
        let held = params.fireflies.map(|limits| {
            samples_without_fireflies(fresh, Some(then.pixels()), frame.surface, limits)
        });
        let fresh = held.as_ref().map_or(fresh, Image::pixels);
        let exposure = exposure(fresh);
        let thin = find_thin_features(fresh);
        let (color, weight) = grids.resample(fresh);
        let [change, change_around] =
            [GRADIENT, AROUND].map(|params| find_gradient([fresh, then.pixels()], None, params));
        let clipped = clip(past.color(), color.pixels(), exposure);
        let merge = Merge {
            params,
            grids,
            color,
            weight,
            past,
            clipped,
            motion,
            disoccluded,
            change,
            change_around,
            thin,
            reactive: frame.reactive.map(Pixels::plane),
        };
        let (shown, report) = output.parts(large);
        let history = merge.run(report);
        show_sharpened(&history, params.sharpness, exposure, shown);
        self.state = Some(State {
            size: fresh.size,
            history,
            camera: frame.camera,
        });
        let missing = missing(fresh);
        Ok(Summary {
            used,
            missing,
            repeats: false,
        })
    }
}

/// The history where its surfaces are now, in the output's size; all zero in a first frame.
struct Past {
    history: Image,
    coverage: Image,
    rejection: Image<u8>,
}

impl Past {
    fn reproject(before: Option<&State>, motion: Pixels) -> Self {
        let size = motion.size;
        let (mut coverage, mut rejection) = (Image::new(size, 1), Image::new(size, 1));
        let history = before.and_then(|before| {
            let history = [before.history.pixels()];
            let (covered, rejected) = (coverage.data_mut(), Some(rejection.data_mut()));
            reproject(&history, motion, Tests::none(), FETCH, covered, rejected).pop()
        });
        Self {
            history: history.unwrap_or_else(|| Image::new(size, CHANNELS)),
            coverage,
            rejection,
        }
    }

    fn color(&self) -> Pixels<'_> {
        self.history.pixels().part(0..3)
    }
}

/// 1 where a pixel's surface was hidden in the last frame; 0 everywhere without depth.
fn find_disoccluded(depth: Option<View>, motion: Pixels, separation: f32) -> Image {
    let mut disoccluded = Image::new(motion.size, 1);
    if let Some(depth) = depth {
        disocclusion(depth, motion, separation, disoccluded.pixels_mut());
    }
    disoccluded
}

fn find_thin_features(color: Pixels) -> Image {
    let mut thin = Image::blank(color.size, 1);
    thin_features(color, SIMILARITY, thin.pixels_mut());
    thin
}

/// Clips history to the box of the new colours' neighbourhood.
fn clip(history: Pixels, color: Pixels, exposure: f32) -> Image {
    let mut clipped = Image::blank(color.size, 3);
    let clip = neighborhood::Params { exposure, ..CLIP };
    clip_history(history, color, clip, clipped.pixels_mut());
    clipped
}

fn show_sharpened(history: &Interleaved, strength: f32, exposure: f32, shown: &mut [f32]) {
    let color = history.pixels().part(0..3);
    let out = PixelsMut::bands(color.size, 3, shown);
    sharpen(color, sharpen::Params { strength, exposure }, out);
}

/// Counts the missing samples.
fn missing(color: Pixels) -> usize {
    let mut planes = [[0.0; SEGMENT]; 3];
    let runs = (0..color.size.height).flat_map(|y| segments(y, color.size.width));
    runs.map(|run| {
        color.read_rows(run, &mut planes);
        count_missing(planes.each_ref().map(|row| &row[..run.len]))
    })
    .sum()
}
