//! Parameters of history, common to [`super::svgf`] and [`super::bmfr`]: how it is validated and corrected, and how a frame's
//! samples join it.

use crate::error::Result;
use crate::kernels::fetch::validate::{self, Threshold};
use crate::kernels::judge::{gradient, innovation};
use crate::kernels::merge::accumulate;
use crate::kernels::smooth::fireflies;

/// How history is brought to a frame, and how the frame's samples join it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// The tests that history must pass.
    pub surface: validate::Params,
    /// Whether history must be of the same albedo, by the surface's threshold of luminance.
    pub same_albedo: bool,
    /// Whether depth alone tells surfaces apart where normals and ids change from pixel to pixel and from frame to frame.
    pub coherence: bool,
    /// How samples join the history.
    pub accumulate: accumulate::Params,
    /// Whether the new sample's share rises where less than the whole footprint of history is valid.
    pub by_confidence: bool,
    /// Whether history is shortened where the light changes, and how the change is estimated; frames with a replay tell it,
    /// and correct their history by it.
    pub gradient: Option<gradient::Params>,
    /// Whether outliers are held down.
    pub fireflies: Option<fireflies::Params>,
    /// Whether the innovation, what new samples show beside the prediction, corrects result and history.
    pub innovation: Option<innovation::Params>,
}

/// A lamp that travels changes all of the light by less than the noise of a few pixels, so windows of three widths are
/// tested. The wider margin compensates for three tests instead of one: with 2.3, the noise of `caustics` counts as changes
/// (3 % more relMSE); with 2.6, `naked_lamps` and `sunlit_teapot` keep old light (1 % more).
pub const ESTIMATED_GRADIENT: gradient::Params = gradient::Params {
    noise: 2.4,
    passes: 3,
    widest: 5,
};

/// By our own measurements.
impl Default for Params {
    fn default() -> Self {
        Self {
            surface: validate::Params::default(),
            coherence: true,
            gradient: Some(ESTIMATED_GRADIENT),
            innovation: Some(innovation::Params::default()),
            ..Self::plain()
        }
    }
}

impl Params {
    /// Validation by surfaces and accumulation, nothing else.
    pub fn plain() -> Self {
        Self {
            surface: validate::Params {
                motion_difference: Threshold::hard(f32::INFINITY),
                ..Default::default()
            },
            same_albedo: false,
            coherence: false,
            accumulate: accumulate::Params::default(),
            by_confidence: false,
            gradient: None,
            fireflies: None,
            innovation: None,
        }
    }

    /// Whether history is tested by motion, where no depth is known.
    pub(super) fn tests_motion(&self) -> bool {
        self.surface.motion_difference.none < f32::INFINITY
    }

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        self.surface.check()?;
        self.accumulate.check()?;
        (self.innovation.iter()).try_for_each(innovation::Params::check)?;
        (self.fireflies.iter()).try_for_each(fireflies::Params::check)?;
        self.gradient.iter().try_for_each(gradient::Params::check)
    }
}
