//! Temporal antialiasing, as a list of this library's kernels:
//!
//!   (resolve the jittered sample) → (motion from cameras) → dilate → reproject → expose → clip → blend
//!
//! It works on colours across surfaces: no test of depth, normal or id refuses history, since along an edge that would
//! refuse what antialiases it. The neighbourhood's colours decide instead.

use std::ops::Range;

use super::frame::{Frame, Output, blacken_missing, check_size, count_missing};
use crate::error::Result;
use crate::image::{BandMut, Image, View};
use crate::kernels::camera::dilate::{Choice, Window, dilate_motion};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::footprint::{Filter, Wide};
use crate::kernels::fetch::reproject::{self, Reprojected, reproject};
use crate::kernels::judge::blend_factor::{self, blend_factor};
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::neighborhood::{self, Bounds, Response, Space, clip_history};
use crate::kernels::judge::surface::{self, Surface, Tests, Threshold};
use crate::kernels::merge::blend::{self, Alpha, Weighting, blend};
use crate::kernels::merge::resolve::{self, Resolve};
use crate::math::is_present;
use crate::rows::{self, Kernel};

#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// Which neighbours' motion a pixel may take; its own alone if none.
    pub dilate: Option<Window>,
    pub filter: Filter,
    pub clip: neighborhood::Params,
    pub blend_factor: blend_factor::Params,
    pub blend: blend::Params,
    /// How a frame with known jitter is brought to pixel centres.
    pub reconstruct: Option<resolve::Filter>,
}

impl Params {
    pub const PRESETS: [(&str, Self); 5] = [
        ("best", Self::BEST),
        ("denoised", Self::DENOISED),
        ("seed", Self::SEED),
        ("karis", Self::KARIS),
        ("filament", Self::FILAMENT),
    ];

    pub const DILATIONS: [(&str, Option<Window>); 3] = [
        ("3x3", Some(Window::Square)),
        ("cross", Some(Window::Cross)),
        ("none", None),
    ];

    /// The core equation: the range of the neighbourhood, a twentieth of the new sample.
    pub const SEED: Self = Self {
        dilate: None,
        filter: Filter::Bilinear,
        clip: neighborhood::Params {
            bounds: Bounds::MinMax,
            gamma: 1.0,
            radius: 1,
            space: Space::Rgb,
            response: Response::Clamp,
            exposure: 1.0,
        },
        blend_factor: blend_factor::Params {
            alpha: 0.05,
            fast_alpha: 0.05,
            speed: Threshold {
                full: 2.0,
                none: 16.0,
            },
        },
        blend: blend::Params {
            weighting: Weighting::None,
            flicker: 1.0,
            exposure: 1.0,
        },
        reconstruct: None,
    };

    /// After Karis 2014, *High Quality Temporal Supersampling*; how far flicker lessens the share is our choice.
    pub const KARIS: Self = Self {
        dilate: Some(Window::Cross),
        clip: neighborhood::Params {
            bounds: Bounds::Rounded,
            space: Space::YCoCg,
            response: Response::Center,
            ..Self::SEED.clip
        },
        blend: blend::Params {
            weighting: Weighting::Tone,
            flicker: 0.2,
            ..Self::SEED.blend
        },
        reconstruct: Some(resolve::Filter::BlackmanHarris),
        ..Self::SEED
    };

    /// After Filament's temporal antialiasing: filter, box, response, weights and share.
    pub const FILAMENT: Self = Self {
        dilate: Some(Window::Square),
        filter: Filter::Wide(Wide::CatmullRom5),
        clip: neighborhood::Params {
            bounds: Bounds::Intersection,
            space: Space::YCoCg,
            response: Response::Current,
            ..Self::SEED.clip
        },
        blend_factor: blend_factor::Params {
            alpha: 0.12,
            fast_alpha: 0.12,
            ..Self::SEED.blend_factor
        },
        blend: blend::Params {
            weighting: Weighting::Tone,
            ..Self::SEED.blend
        },
        reconstruct: Some(resolve::Filter::BlackmanHarris),
    };

    /// What our own measurements choose for frames without noise.
    pub const BEST: Self = Self {
        dilate: Some(Window::Square),
        filter: Filter::Wide(Wide::CatmullRom),
        clip: neighborhood::Params {
            bounds: Bounds::Variance,
            space: Space::ToneMappedYCoCg,
            ..Self::SEED.clip
        },
        // What stands still may be averaged for longer than what is resampled every time.
        blend_factor: blend_factor::Params {
            alpha: 0.05,
            fast_alpha: 0.25,
            speed: Threshold {
                full: 0.0,
                none: 1.0,
            },
        },
        blend: Self::SEED.blend,
        reconstruct: Some(resolve::Filter::BlackmanHarris),
    };

    /// The same for frames that a denoiser has smoothed, whose history is the worse for what was wrong in each of them.
    pub const DENOISED: Self = Self {
        clip: neighborhood::Params {
            gamma: 0.75,
            response: Response::Center,
            ..Self::BEST.clip
        },
        blend_factor: blend_factor::Params {
            alpha: 0.1,
            fast_alpha: 0.3,
            ..Self::BEST.blend_factor
        },
        ..Self::BEST
    };

    pub fn check(&self) -> Result<()> {
        self.clip.check()?;
        self.blend_factor.check()?;
        self.blend.check()
    }
}

/// Channels of a history image: colour 0 to 2, length 3.
const CHANNELS: usize = 4;

/// A history image with a new one merged in, and what was thought of the former.
pub struct Antialiased {
    pub history: Image,
    pub coverage: Image,
    pub rejection: Image<u8>,
}

impl Antialiased {
    pub fn color(&self) -> Image {
        self.history.channels(0..3).to_image()
    }
}

/// Merges a colour into the history of those before, which came along `motion`.
pub fn antialias(
    params: &Params,
    history: Option<&Image>,
    color: View,
    motion: View,
    depth: Option<View>,
) -> Antialiased {
    let size = color.size;
    let Reprojected {
        values,
        coverage,
        rejection,
    } = match history {
        Some(history) => recall(params, history, motion, depth),
        None => Reprojected::nothing(size, CHANNELS),
    };
    // Tone curves are for images that are exposed as photographs are.
    let exposure = exposure(color);
    let clip = neighborhood::Params {
        exposure,
        ..params.clip
    };
    let clipped = clip_history(values.channels(0..3), color, clip);
    let mut alpha = blend_factor(coverage.view(), Some(motion), params.blend_factor);
    let mut history = Image::new(size, CHANNELS);
    let kernel = WarmUp {
        color,
        length: values.channels(3..4),
        longest: 1.0 / params.blend_factor.alpha,
    };
    rows::run(&kernel, size.height, alpha.bands().zip(history.bands()));
    let blended = blend(
        color,
        clipped.view(),
        Alpha::Map(alpha.view()),
        blend::Params {
            exposure,
            ..params.blend
        },
    );
    history.set_channels(0, blended.view());
    Antialiased {
        history,
        coverage,
        rejection,
    }
}

fn recall(params: &Params, history: &Image, motion: View, depth: Option<View>) -> Reprojected {
    let dilated = params.dilate.map(|window| {
        let choice = depth.map_or(Choice::Longest, Choice::Nearest);
        dilate_motion(motion, choice, window)
    });
    let motion = dilated.as_ref().map_or(motion, Image::view);
    let (nothing, limits) = (Surface::default(), surface::Params::default());
    let tests = Tests::new(nothing, nothing, None, &limits);
    let params = reproject::Params {
        filter: params.filter,
        fallback: false,
        dering: true,
    };
    reproject(&[history.view().into()], motion.into(), tests, params)
}

/// Averages the first samples equally: the share of the N-th is at least 1/N, until the least share bounds N.
struct WarmUp<'a> {
    color: View<'a>,
    /// Samples so far; 0 without history.
    length: View<'a>,
    longest: f32,
}

impl<'a> Kernel for WarmUp<'a> {
    type Out = (BandMut<'a>, BandMut<'a>);

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, (mut alpha, mut history): Self::Out) {
        for y in rows {
            let [r, g, b] = self.color.rows(y);
            let before = self.length.row(0, y);
            let alpha = alpha.row(0, y);
            let [_, _, _, length] = history.rows(y);
            for x in 0..before.len() {
                let present = is_present([r[x], g[x], b[x]]);
                let counted = (before[x] + 1.0).min(self.longest);
                alpha[x] = alpha[x].max(1.0 / counted);
                length[x] = if present { counted } else { before[x] };
            }
        }
    }
}

/// What one frame leaves to the next.
struct Memory {
    history: Image,
    camera: Option<Camera>,
}

pub struct Taa {
    params: Params,
    memory: Option<Memory>,
}

impl Taa {
    pub fn new(params: Params) -> Result<Self> {
        params.check()?;
        Ok(Self {
            params,
            memory: None,
        })
    }

    /// Forgets the sequence.
    pub fn reset(&mut self) {
        self.memory = None;
    }

    pub fn step(&mut self, frame: &Frame) -> Result<Output> {
        let size = frame.color.size;
        if let Some(memory) = &self.memory {
            check_size(memory.history.size, size)?;
        }
        let mut used = vec![];
        let resolved = self
            .params
            .reconstruct
            .zip(frame.jitter)
            .map(|(filter, jitter)| {
                used.push("jitter");
                let mut resolve = Resolve::new(size, 3, filter);
                resolve.add(frame.color, jitter);
                resolve.finish()
            });
        let color = resolved.as_ref().map_or(frame.color, Image::view);
        let previous = self.memory.as_ref();
        let motion = frame.motion(
            previous.and_then(|memory| memory.camera.as_ref()),
            &mut used,
        );
        let depth = frame.surface.depth.filter(|_| self.params.dilate.is_some());
        if depth.is_some() {
            used.push("depth");
        }
        let antialiased = antialias(
            &self.params,
            previous.map(|memory| &memory.history),
            color,
            motion.view(),
            depth,
        );
        let mut color = antialiased.color();
        blacken_missing(&mut color);
        let history_length = antialiased.history.channels(3..4).to_image();
        self.memory = Some(Memory {
            history: antialiased.history,
            camera: frame.camera,
        });
        Ok(Output {
            color,
            variance: None,
            history_length,
            confidence: antialiased.coverage,
            rejection: antialiased.rejection,
            used,
            missing: count_missing(frame.color),
        })
    }
}
