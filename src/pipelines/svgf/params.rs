//! The parameters of [`Svgf`](super::Svgf), and the presets.

use std::borrow::Cow;

use crate::error::{Result, in_range};
use crate::kernels::judge::{choice, gradient, neighborhood};
use crate::kernels::merge::accumulate;
use crate::kernels::smooth::guide::Sigmas;
use crate::kernels::smooth::{atrous, joint_bilateral, lend, variance};
use crate::math::smaller;
use crate::pipelines::history::{self, ESTIMATED_GRADIENT};
use crate::pipelines::taa;

/// Parameters of [`Svgf`](super::Svgf).
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// How history is recalled, and how samples join it.
    pub history: history::Params,
    /// Whether they join without forgetting in frames in which nothing moves. With `choice`, the result then takes its
    /// detail from their mean.
    pub average_still: bool,
    /// How the variance is estimated.
    pub variance: variance::Params,
    /// The filter. `relative_noise`, if finite, limits the noise that it expects in frames with no guide but depth alone.
    pub atrous: atrous::Params,
    /// The light above which brighter taps of the filter weigh less, in multiples of the exposure; > 0, +∞ if they do not; 16.
    pub tap_exposure: f32,
    /// Whether the first pass of the filter, instead of its input, is the next frame's history. Not in a step that joins later
    /// frames: they have seen the next frame's samples.
    pub feedback: bool,
    /// Whether each tile gets as many passes of the filter, up to one more than `atrous.iterations`, as predicted best; not
    /// where the noise of frames repeats, which is looked for.
    pub choice: Option<choice::Params>,
    /// Whether that is also done in frames that have albedo. Without it, a fixed number of passes blurs texture.
    pub choice_with_albedo: bool,
    /// Distances behind the surface at which reflections are looked for, in units of depth; above 0, +inf included.
    pub reflections: Vec<f32>,
    /// The output stage.
    pub antialias: Option<taa::Params>,
    /// For frames of which only a part is traced: samples for the rest.
    pub lend: Option<lend::Params>,
}

/// After n frames in which nothing moved, the margin of noise that the gradient ignores is multiplied by √(n/10), with n/10
/// clamped to 1 to 16: a false alarm costs the more samples, the longer they have been averaged.
const PATIENCE: [f32; 2] = [10.0, 16.0];

/// Cap on the history length where α is 0.
const LONGEST: f32 = 1e6;

/// Normals are compared half as strictly as by the paper.
const SIGMAS: Sigmas = Sigmas {
    normal: 64.0,
    ..Sigmas::DEFAULT
};

/// Without guides, the filter blurs edges and texture along with the noise, and history adds more blur and lag than it removes
/// noise.
pub const ANTIALIASED: taa::Params = taa::Params {
    unguided_alpha: 0.5,
    ..taa::Params::DENOISED
};

/// By our own measurements.
impl Default for Params {
    fn default() -> Self {
        let textbook = Self::textbook();
        Self {
            history: history::Params {
                accumulate: textbook.history.accumulate,
                ..Default::default()
            },
            variance: variance::Params {
                sigmas: SIGMAS,
                ..Default::default()
            },
            atrous: atrous::Params {
                iterations: 3,
                radius: 1,
                sigma_luminance: 3.0,
                sigmas: SIGMAS,
                ..Default::default()
            },
            tap_exposure: 16.0,
            choice: Some(choice::Params::default()),
            reflections: vec![0.2, 0.4, 0.7, 1.2],
            antialias: Some(ANTIALIASED),
            feedback: false,
            ..textbook
        }
    }
}

impl Params {
    /// The paper's passes: accumulation by its α, variance, and filter, whose first pass feeds back.
    pub fn textbook() -> Self {
        Self {
            history: history::Params {
                accumulate: accumulate::Params {
                    alpha: 0.2,
                    ..Default::default()
                },
                ..history::Params::plain()
            },
            average_still: false,
            variance: variance::Params::default(),
            atrous: atrous::Params {
                relative_noise: f32::INFINITY,
                ..Default::default()
            },
            tap_exposure: f32::INFINITY,
            feedback: true,
            choice: None,
            choice_with_albedo: true,
            reflections: vec![],
            antialias: None,
            lend: None,
        }
    }

    /// Half resolution: frames of which a part is traced, another one each time. More noise is expected than from whole
    /// frames, and histories to be wrong more often. `weight` is what a borrowed sample counts for, `radius` how many
    /// pixels away it may be ([`lend`]). Gradient, reflections and innovation ask traced samples alone.
    pub fn half_res(weight: f32, radius: usize) -> Self {
        let window = joint_bilateral::Params {
            radius,
            sigmas: SIGMAS,
            ..Default::default()
        };
        let whole = Self::default();
        let clip = neighborhood::Params {
            gamma: 0.6,
            ..ANTIALIASED.clip
        };
        Self {
            atrous: atrous::Params {
                iterations: 4,
                radius: 2,
                sigma_luminance: 4.0,
                // With 2.5, as in whole frames, lamps leak more; with 1.5, noise stays where light has just changed.
                relative_noise: 2.0,
                // With a quarter of the pixels traced, hardly any history reaches 3.5 samples in ten frames.
                settled: 1.75,
                ..whole.atrous
            },
            history: history::Params {
                // Windows twice as wide have as many samples.
                gradient: Some(gradient::Params {
                    passes: ESTIMATED_GRADIENT.passes + 1,
                    widest: ESTIMATED_GRADIENT.widest + 1,
                    ..ESTIMATED_GRADIENT
                }),
                ..whole.history
            },
            // A tile of a partly traced frame has few samples to judge by, so that rare bright ones may decide. With albedo, most
            // scenes gain too little by the choice to make up for the highlights that lose by this.
            choice: Some(choice::Params {
                strictness: 1.0,
                ..Default::default()
            }),
            choice_with_albedo: false,
            antialias: Some(taa::Params {
                clip,
                // Most pixels have no sample to judge by, nor to show.
                choice: false,
                ..ANTIALIASED
            }),
            lend: Some(lend::Params { weight, window }),
            ..whole
        }
    }

    /// Whether the number of passes is chosen in frames with albedo, or without.
    pub(super) fn chooses(&self, with_albedo: bool) -> bool {
        self.choice.is_some() && (self.choice_with_albedo || !with_albedo)
    }

    /// For a frame: after so many still ones, with noise that may repeat that of the frame before, and in which samples choose
    /// passes or not.
    pub(super) fn for_frame(
        &self,
        still: Option<u32>,
        repeats: bool,
        chooses: bool,
    ) -> Cow<'_, Self> {
        match still {
            _ if repeats => Cow::Owned(self.repeated()),
            Some(frames) => Cow::Owned(self.still(frames)),
            None if !chooses && self.choice.is_some() => Cow::Owned(Self {
                choice: None,
                ..self.clone()
            }),
            None => Cow::Borrowed(self),
        }
    }

    /// For a frame whose noise is that of the frame before. However many samples its history counts, they are worth one, so
    /// that the variance is estimated in space, for one sample.
    fn repeated(&self) -> Self {
        let longest = 1.0 / self.history.accumulate.alpha;
        Self {
            choice: None,
            variance: variance::Params {
                min_length: smaller(longest, LONGEST) * self.variance.min_length,
                ..self.variance
            },
            atrous: atrous::Params {
                relative_noise: f32::INFINITY,
                ..self.atrous
            },
            tap_exposure: f32::INFINITY,
            ..self.clone()
        }
    }

    /// After so many frames in which nothing moved.
    fn still(&self, frames: u32) -> Self {
        let [first, most] = PATIENCE;
        let patience = (frames as f32 / first).clamp(1.0, most).sqrt();
        Self {
            history: history::Params {
                gradient: self.history.gradient.map(|gradient| gradient::Params {
                    noise: gradient.noise * patience,
                    ..gradient
                }),
                ..self.history
            },
            ..self.clone()
        }
    }

    /// Pixels from the farthest tap to the centre.
    pub(super) fn reach(&self) -> usize {
        let filter = atrous::Params {
            iterations: self.passes(),
            ..self.atrous
        };
        let lent = self.lend.map_or(0, |lend| lend.window.radius);
        let spread = self
            .history
            .fireflies
            .map_or(0, |fireflies| fireflies.radius);
        (filter.reach().max(self.variance.radius))
            .max(lent)
            .max(spread)
    }

    /// Passes of the filter that are run.
    pub(super) fn passes(&self) -> u32 {
        let usual = self.atrous.iterations;
        match self.choice {
            Some(_) => (usual + 1).min(atrous::Params::MOST),
            None => usual,
        }
    }

    /// Whether a pass before the filter reads neighbouring pixels, or one after it the reprojected history: both need whole
    /// images, so that the merge cannot be fused.
    pub(super) fn looks_around(&self) -> bool {
        let fills = self.history.fireflies.is_some() || self.lend.is_some();
        let asks = !self.reflections.is_empty() || self.choice.is_some();
        self.history.gradient.is_some() || self.history.coherence || fills || asks
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        self.history.check()?;
        self.variance.check()?;
        self.atrous.check()?;
        self.choice.iter().try_for_each(choice::Params::check)?;
        (self.antialias.iter()).try_for_each(taa::Params::check)?;
        self.lend.iter().try_for_each(lend::Params::check)?;
        in_range("tap_exposure", self.tap_exposure, "a number above 0", |v| {
            v > 0.0
        })?;
        for &distance in &self.reflections {
            in_range("reflections", distance, "distances above 0", |v| v > 0.0)?;
        }
        Ok(())
    }
}
