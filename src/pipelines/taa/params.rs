//! Parameters of temporal antialiasing, and presets of them.

use crate::error::{Result, finite_from_0, from_0_to_1};
use crate::image::Pixels;
use crate::kernels::camera::dilate::{self, Window};
use crate::kernels::camera::pinhole::Rays;
use crate::kernels::fetch::footprint::{Filter, Wide};
use crate::kernels::fetch::validate::{self, Surface, Tests, Threshold};
use crate::kernels::judge::blend_factor;
use crate::kernels::judge::coherence::is_thin;
use crate::kernels::judge::exposure::exposure;
use crate::kernels::judge::innovation;
use crate::kernels::judge::neighborhood::{self, Bounds, Response, Space};
use crate::kernels::merge::blend::{self, Weighting};
use crate::kernels::merge::resolve;
use crate::kernels::smooth::fireflies;
use crate::math::larger;
use crate::pipelines::frame::{Frame, Guides, OwnedSurface};

/// Parameters of [`Taa`](super::Taa).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// The neighbours whose motion a pixel may take; none: always its own.
    pub dilate: Option<Window>,
    /// The margin of the dilation.
    pub dilate_margin: f32,
    /// Whether a pixel may also take the motion of neighbours that move by themselves.
    pub dilate_movers: bool,
    /// How history is interpolated.
    pub filter: Filter,
    /// How history is clipped to the colours of the neighbourhood; its exposure is relative to that of the frame.
    pub clip: neighborhood::Params,
    /// Least blend factor of the new sample.
    pub blend_factor: blend_factor::Params,
    /// Least share of the new colour in frames without albedo, normals and ids; from 0 to 1. Above 0, these frames are also
    /// weighted by the tone curve. Frames whose depth shows geometry that is thinner than a pixel are not among them.
    pub unguided_alpha: f32,
    /// Exposure of the weights by local tone in frames with albedo, normals or ids, in times of the frame's; 0: no such weights.
    pub guided_exposure: f32,
    /// What else weighs the two colours; its exposure is relative to that of the frame.
    pub blend: blend::Params,
    /// The filter that resolves a frame with known jitter to pixel centres.
    pub reconstruct: Option<resolve::Filter>,
    /// The surface tests that history must pass.
    pub limits: Limits,
    /// Whether outliers of the samples are held down first.
    pub fireflies: Option<fireflies::Params>,
    /// Whether history is shortened where the temporal gradient estimates that the light has changed.
    pub gradient: bool,
    /// How much history is shortened where it was clipped; from 0; 0.
    pub anti_lag: f32,
    /// Whether history escapes the clip where the colours of whole neighbourhoods alternate.
    pub alternation: bool,
    /// Whether history is shortened where the material has changed and it has to be clipped.
    pub material_change: bool,
    /// Corrects the result by the innovation of new samples, if these are noisy; of a denoised colour, only that of the samples
    /// before it.
    pub innovation: Option<innovation::Params>,
    /// Whether what is shown is smoothed along its edges; history is not.
    pub smooth_edges: bool,
    /// Whether tiles of a denoised colour's history that samples correct choose between the clip and none, by what has predicted
    /// the frames before better.
    pub clip_choice: bool,
    /// Whether the result of a denoised colour is mixed with it and the samples before it, as these tell tile by tile.
    pub choice: bool,
}

/// Thresholds of the surface tests that history must pass; by default there are none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Relative difference of depth.
    pub relative_depth: Option<Threshold>,
    /// Replaces the relative depth where two frames have camera, depth and normals, and motion has 3 channels.
    pub plane_distance: Option<Threshold>,
    /// Angle between the normals in degrees.
    pub normal_angle: Option<Threshold>,
    /// Relative difference of the albedo's luminance.
    pub relative_albedo: Option<Threshold>,
    /// Whether ids must be equal.
    pub ids: bool,
}

impl Default for Limits {
    fn default() -> Self {
        Self::NONE
    }
}

impl Limits {
    const NONE: Self = Self {
        relative_depth: None,
        plane_distance: None,
        normal_angle: None,
        relative_albedo: None,
        ids: false,
    };

    /// The tests of a frame's surfaces against the last frame's, whose camera gave the rays.
    pub(super) fn tests<'a>(
        &self,
        now: Surface<'a>,
        before: Surface<'a>,
        rays: Option<Rays>,
    ) -> Tests<'a> {
        let has_planes = |surface: Surface| surface.depth.is_some() && surface.normal.is_some();
        let tests_planes = self.plane_distance.is_some() && has_planes(now) && has_planes(before);
        let rays = rays.filter(|_| tests_planes);
        let [now, before] = [now, before].map(|surface| self.compared(surface, rays.is_some()));
        Tests::new(now, before, rays, &self.thresholds())
    }

    /// A copy of the buffers that the next frame's tests may compare.
    pub(super) fn keep(&self, surface: Surface) -> OwnedSurface {
        OwnedSurface::of(&self.compared(surface, self.plane_distance.is_some()))
    }

    /// A test without a threshold gets the one that all angles pass, or the default where its buffers are left out anyway.
    fn thresholds(&self) -> validate::Params {
        let default = validate::Params::default();
        validate::Params {
            relative_depth: self.relative_depth.unwrap_or(default.relative_depth),
            plane_distance: self.plane_distance.unwrap_or(default.plane_distance),
            normal_angle: self.normal_angle.unwrap_or(Threshold::hard(180.0)),
            relative_luminance: (self.relative_albedo).unwrap_or(default.relative_luminance),
            ..default
        }
    }

    /// The buffers that have a threshold, and those of the plane test if it is on.
    fn compared<'a>(&self, surface: Surface<'a>, planes: bool) -> Surface<'a> {
        let (depth, angle) = (self.relative_depth.is_some(), self.normal_angle.is_some());
        Surface {
            depth: surface.depth.filter(|_| planes || depth),
            normal: surface.normal.filter(|_| planes || angle),
            object_normal: surface.object_normal.filter(|_| angle),
            ids: surface.ids.filter(|_| self.ids),
            color: surface.color.filter(|_| self.relative_albedo.is_some()),
        }
    }
}

/// The preset "best".
impl Default for Params {
    fn default() -> Self {
        Self::BEST
    }
}

impl Params {
    /// Names of presets.
    pub const PRESETS: [(&str, Self); 5] = [
        ("best", Self::BEST),
        ("denoised", Self::DENOISED),
        ("textbook", Self::TEXTBOOK),
        ("karis", Self::KARIS),
        ("filament", Self::FILAMENT),
    ];

    /// Names of windows for `dilate`.
    pub const DILATIONS: [(&str, Option<Window>); 3] = [
        ("3x3", Some(Window::Square)),
        ("cross", Some(Window::Cross)),
        ("none", None),
    ];

    /// The textbook equation: history clamped to the range of its neighbourhood, a blend factor of 5 %.
    pub const TEXTBOOK: Self = Self {
        dilate: None,
        dilate_margin: 0.0,
        dilate_movers: true,
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
        unguided_alpha: 0.0,
        guided_exposure: 0.0,
        blend: blend::Params::PLAIN,
        reconstruct: None,
        limits: Limits::NONE,
        fireflies: None,
        gradient: false,
        anti_lag: 0.0,
        alternation: false,
        material_change: false,
        innovation: None,
        smooth_edges: false,
        clip_choice: false,
        choice: false,
    };

    /// After Karis 2014, *High Quality Temporal Supersampling*; the strength of its flicker reduction is our choice.
    pub const KARIS: Self = Self {
        dilate: Some(Window::Cross),
        clip: neighborhood::Params {
            bounds: Bounds::Rounded,
            space: Space::YCoCg,
            response: Response::Center,
            ..Self::TEXTBOOK.clip
        },
        blend: blend::Params {
            weighting: Weighting::Tone,
            flicker: 0.2,
            ..Self::TEXTBOOK.blend
        },
        reconstruct: Some(resolve::Filter::BlackmanHarris),
        ..Self::TEXTBOOK
    };

    /// After Filament's temporal antialiasing: filter, box, response, weights and blend factor.
    pub const FILAMENT: Self = Self {
        dilate: Some(Window::Square),
        filter: Filter::Wide(Wide::CatmullRom5),
        clip: neighborhood::Params {
            bounds: Bounds::Intersection,
            space: Space::YCoCg,
            response: Response::Current,
            ..Self::TEXTBOOK.clip
        },
        blend_factor: blend_factor::Params {
            alpha: 0.12,
            fast_alpha: 0.12,
            ..Self::TEXTBOOK.blend_factor
        },
        blend: blend::Params {
            weighting: Weighting::Tone,
            ..Self::TEXTBOOK.blend
        },
        reconstruct: Some(resolve::Filter::BlackmanHarris),
        ..Self::TEXTBOOK
    };

    /// Our own measurements' choice for frames without noise. With sixteen taps these lose up to .1 dB, and only frames of one
    /// sample per pixel that no denoiser has seen gain .01 dB.
    pub const BEST: Self = Self {
        dilate: Some(Window::Square),
        dilate_margin: dilate::Params::EDGES.margin,
        filter: Filter::Wide(Wide::CatmullRom5),
        clip: neighborhood::Params {
            bounds: Bounds::Variance,
            space: Space::ToneMappedYCoCg,
            ..Self::TEXTBOOK.clip
        },
        // History that moves is blurred by every resampling, so it is kept for fewer frames.
        blend_factor: blend_factor::Params {
            alpha: 0.05,
            fast_alpha: 0.25,
            speed: Threshold {
                full: 0.0,
                none: 1.0,
            },
        },
        reconstruct: Some(resolve::Filter::BlackmanHarris),
        ..Self::TEXTBOOK
    };

    /// Our own measurements' choice for denoised frames: the denoiser's errors stay in history, so it is kept for fewer frames.
    /// What a lamp leaves in the dark around it fades faster by tone. At eight times the exposure relMSE gains another percent,
    /// but a light that is switched on (`switched_light`) comes more slowly, by 0.1 to 0.2 dB.
    pub const DENOISED: Self = Self {
        dilate_movers: false,
        smooth_edges: true,
        clip_choice: true,
        choice: true,
        material_change: true,
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
        guided_exposure: 16.0,
        ..Self::BEST
    };

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        (self.dilation().iter()).try_for_each(|dilation| dilation.check("dilate_margin"))?;
        self.clip.check()?;
        (self.innovation.iter()).try_for_each(innovation::Params::check)?;
        (self.limits.relative_albedo.iter())
            .try_for_each(|albedo| albedo.check_luminance("relative_albedo"))?;
        self.limits.thresholds().check()?;
        finite_from_0("anti_lag", self.anti_lag)?;
        from_0_to_1("unguided_alpha", self.unguided_alpha)?;
        finite_from_0("guided_exposure", self.guided_exposure)?;
        self.blend_factor.check()?;
        self.fireflies
            .iter()
            .try_for_each(fireflies::Params::check)?;
        self.blend.check()
    }

    /// With the share and the weights that a frame's guides ask for.
    pub(super) fn of(mut self, frame: &Frame) -> Self {
        let least = self.unguided_alpha;
        let unguided = (least, Weighting::Tone, 1.0);
        let (least, weighting, brighter) = match frame.guides() {
            Guides::None if least > 0.0 => unguided,
            Guides::Depth(depth) if least > 0.0 && !is_thin(depth) => unguided,
            Guides::More if self.guided_exposure > 0.0 => {
                (0.0, Weighting::LocalTone, self.guided_exposure)
            }
            _ => return self,
        };
        let factor = &mut self.blend_factor;
        factor.alpha = larger(factor.alpha, least);
        factor.fast_alpha = larger(factor.fast_alpha, least);
        (self.blend.weighting, self.blend.exposure) = (weighting, brighter);
        self
    }

    /// The parameters of the dilation, if there is one.
    pub(super) fn dilation(&self) -> Option<dilate::Params> {
        let margin = self.dilate_margin;
        self.dilate.map(|window| dilate::Params { window, margin })
    }

    /// The exposure of a colour, if tone curves or relative luminances ask for it, else 1.
    pub(super) fn exposure(&self, color: Pixels) -> f32 {
        let weighs = self.blend.weighting != Weighting::None || self.alternation;
        let follows = self.dilate.is_some() && !self.dilate_movers;
        let tone_mapped = self.clip.space.is_tone_mapped();
        let smooths = self.smooth_edges;
        match tone_mapped || weighs || follows || smooths || self.innovation.is_some() {
            true => exposure(color),
            false => 1.0,
        }
    }

    /// The same at an exposure.
    pub(super) fn exposed(mut self, bright: f32) -> Self {
        self.clip.exposure *= bright;
        self.blend.exposure *= bright;
        self
    }
}
