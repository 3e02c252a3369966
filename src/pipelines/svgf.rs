//! Spatiotemporal variance-guided filtering (Schied et al. 2017), as a list of this library's kernels:
//!
//!   demodulate → (motion from cameras) → reproject → accumulate → estimate variance → à-trous → remodulate
//!
//! Every buffer but colour is optional; what is absent drops out of the tests and weights that would use it.

use crate::error::{Error, Result};
use crate::image::{Image, Size, View};
use crate::kernels::camera::motion::{Geometry, Transforms, motion_vectors};
use crate::kernels::camera::pinhole::Camera;
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::reproject::{self, Reprojected, reproject};
use crate::kernels::judge::surface::{self, Surface, Tests};
use crate::kernels::merge::accumulate::{self, accumulate};
use crate::kernels::smooth::atrous::{self, Filtered, atrous};
use crate::kernels::smooth::demodulate::{demodulate, remodulate};
use crate::kernels::smooth::guide::{Guide, Sigmas};
use crate::kernels::smooth::variance::{self, estimate_variance};

#[derive(Clone, Copy, Debug, Default)]
pub struct Params {
    pub surface: surface::Params,
    pub accumulate: accumulate::Params,
    pub variance: variance::Params,
    pub atrous: atrous::Params,
    /// Whether the first pass of the filter, instead of its input, is the next frame's history.
    pub feedback: bool,
}

impl Params {
    /// The same guide serves the variance and the filter.
    pub fn with_sigmas(mut self, sigmas: Sigmas) -> Self {
        self.variance.sigmas = sigmas;
        self.atrous.sigmas = sigmas;
        self
    }

    pub fn check(&self) -> Result<()> {
        self.surface.check()?;
        self.accumulate.check()?;
        self.variance.check()?;
        self.atrous.check()
    }
}

/// One frame's buffers.
pub struct Frame<'a> {
    pub color: View<'a>,
    pub albedo: Option<View<'a>>,
    pub emission: Option<View<'a>>,
    pub surface: Surface<'a>,
    pub position: Option<View<'a>>,
    pub motion: Option<View<'a>>,
    pub camera: Option<Camera>,
}

impl Frame<'_> {
    fn geometry(&self) -> Option<Geometry<'_>> {
        self.position
            .map(Geometry::Position)
            .or(self.surface.depth.map(Geometry::Depth))
    }
}

/// What a step returns.
pub struct Output {
    pub color: Image,
    pub variance: Image,
    pub history_length: Image,
    pub confidence: Image,
    pub rejection: Image<u8>,
    /// Names of the buffers that took part.
    pub used: Vec<&'static str>,
    /// Samples that were not finite.
    pub missing: usize,
}

/// What one frame leaves to the next.
struct Memory {
    /// As [`accumulate`] has it.
    history: Image,
    depth: Option<Image>,
    normal: Option<Image>,
    ids: Option<Image<u32>>,
    camera: Option<Camera>,
    demodulated: bool,
}

impl Memory {
    fn surface(&self) -> Surface<'_> {
        Surface {
            depth: self.depth.as_ref().map(Image::view),
            normal: self.normal.as_ref().map(Image::view),
            ids: self.ids.as_ref().map(Image::view),
            ..Default::default()
        }
    }
}

pub struct Svgf {
    params: Params,
    memory: Option<Memory>,
}

impl Svgf {
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
        if let Some(memory) = &self.memory {
            check_continues(memory, frame)?;
        }
        let size = frame.color.size;
        let mut used = vec![];

        let illumination = frame
            .albedo
            .map(|albedo| demodulate(frame.color, albedo, frame.emission));
        let color = illumination.as_ref().map_or(frame.color, Image::view);
        let Reprojected {
            values,
            coverage,
            rejection,
        } = match &self.memory {
            Some(memory) => self.recall(memory, frame, &mut used),
            None => Reprojected {
                values: Image::new(size, accumulate::CHANNELS),
                coverage: Image::new(size, 1),
                rejection: Image::new(size, 1),
            },
        };
        let history = std::array::from_fn(|channel| values.plane(channel));
        let (mut history, missing) = accumulate(color, history, None, self.params.accumulate);

        let guide = Guide::new(size, frame.surface, frame.camera.as_ref().map(Camera::rays));
        let [color, moments, length] =
            [0..3, 3..5, 5..6].map(|channels| history.channels(channels));
        let variance = estimate_variance(moments, length, &guide, self.params.variance);
        let Filtered {
            mut color,
            variance,
            first,
        } = atrous(
            color,
            variance.view(),
            &guide,
            self.params.atrous,
            self.params.feedback,
        );

        let history_length = length.to_image();
        if let Some(first) = first {
            history.set_channels(0, first.view());
        }
        if let Some(albedo) = frame.albedo {
            color = remodulate(color.view(), albedo, frame.emission);
        }
        // Where nobody has seen anything, nor has a neighbour.
        color
            .data_mut()
            .iter_mut()
            .filter(|v| !v.is_finite())
            .for_each(|v| *v = 0.0);

        used.extend(list_used(frame, &guide));
        self.memory = Some(Memory {
            history,
            depth: frame.surface.depth.map(|v| v.to_image()),
            normal: frame.surface.normal.map(|v| v.to_image()),
            ids: frame.surface.ids.map(|v| v.to_image()),
            camera: frame.camera,
            demodulated: frame.albedo.is_some(),
        });
        Ok(Output {
            color,
            variance,
            history_length,
            confidence: coverage,
            rejection,
            used,
            missing,
        })
    }

    /// What the memory knows of the current frame's pixels.
    fn recall(&self, memory: &Memory, frame: &Frame, used: &mut Vec<&'static str>) -> Reprojected {
        let size = frame.color.size;
        let cameras = frame.camera.as_ref().zip(memory.camera.as_ref());
        let computed;
        let motion = match (frame.motion, cameras, frame.geometry()) {
            (Some(motion), ..) => {
                used.push("motion");
                motion
            }
            (None, Some((camera, previous)), Some(geometry)) => {
                used.push("camera");
                computed = motion_vectors(geometry, camera, previous, None, &Transforms::default());
                computed.view()
            }
            _ => {
                computed = Image::new(size, 2);
                computed.view()
            }
        };
        let rays = memory
            .camera
            .as_ref()
            .filter(|_| motion.channels == 3)
            .map(Camera::rays);
        let tests = Tests::new(
            size,
            frame.surface,
            memory.surface(),
            rays,
            &self.params.surface,
        );
        let params = reproject::Params {
            filter: Filter::Bilinear,
            fallback: true,
            dering: true,
        };
        reproject(&[memory.history.view()], motion, tests, params)
    }
}

fn check_continues(memory: &Memory, frame: &Frame) -> Result<()> {
    let text = |Size { height, width }: Size| format!("height {height} and width {width}");
    if memory.history.size != frame.color.size {
        let expected = format!(
            "{}, as in earlier frames (or reset() before)",
            text(memory.history.size)
        );
        return Err(Error::value("frame", expected, text(frame.color.size)));
    }
    if memory.demodulated != frame.albedo.is_some() {
        let [before, now] = [memory.demodulated, frame.albedo.is_some()]
            .map(|has| if has { "given" } else { "absent" });
        return Err(Error::value(
            "albedo",
            format!("{before}, as in earlier frames (or reset() before)"),
            now,
        ));
    }
    Ok(())
}

fn list_used(frame: &Frame, guide: &Guide) -> impl Iterator<Item = &'static str> {
    [
        ("albedo", frame.albedo.is_some()),
        (
            "emission",
            frame.albedo.is_some() && frame.emission.is_some(),
        ),
        ("normal", frame.surface.normal.is_some()),
        ("depth", frame.surface.depth.is_some()),
        ("plane", guide.compares_planes()),
        ("ids", frame.surface.ids.is_some()),
    ]
    .into_iter()
    .filter_map(|(name, used)| used.then_some(name))
}
