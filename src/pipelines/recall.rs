//! What a frame leaves to the next, and what the next frame makes of it; common to [`super::svgf`] and [`super::bmfr`]:
//!
//!   (replay) → reproject → (coherence → reproject) → (change of light) → (suppress fireflies) → (temporal gradient)
//!     → (reflections)

use super::correction::{history_factor, scale};
use super::frame::{Frame, Motion, OwnedSurface, check_size};
use super::history::Params;
use super::illumination::texture;
use super::reflections::{self, Own};
use super::replay;
use crate::error::{Error, Result};
use crate::image::{Image, Interleaved, Pixels, View};
use crate::kernels::camera::pinhole::{Camera, Rays};
use crate::kernels::fetch::claims::claims;
use crate::kernels::fetch::footprint::Filter;
use crate::kernels::fetch::reproject::{self, Fetch, reproject, reproject_again};
use crate::kernels::fetch::validate::{self, Surface, Tests, Threshold};
use crate::kernels::judge::coherence::{coarse_ids, incoherent, is_erratic};
use crate::kernels::judge::gradient::find_gradient;
use crate::kernels::judge::light_change::light_change;
use crate::kernels::smooth::demodulate::Texture;
use crate::kernels::smooth::guide::Coarse;
use crate::kernels::smooth::material::merge_white;
use crate::kernels::smooth::reflectance::Surfaces;
use crate::tiles::Tiles;

const BILINEAR: reproject::Params = reproject::Params {
    filter: Filter::Bilinear,
    fallback: true,
    dering: true,
};

/// The state after a frame. Images of several channels are interleaved, as they will be gathered.
pub struct Memory {
    /// Beginning with the channels of [`crate::kernels::merge::accumulate`].
    pub history: Interleaved,
    /// The colour that the next frame's replay is compared with, where one is expected.
    shown: Option<replay::Before>,
    pub reflections: Option<reflections::Memory>,
    surface: OwnedSurface,
    /// The motion of a frame without depth, unless it changes from pixel to pixel.
    motion: Option<Interleaved>,
    pub camera: Option<Camera>,
    demodulated: bool,
    /// If the frame had albedo, and ids or values in it that are no reflectance.
    surfaces: Option<Surfaces>,
}

impl Memory {
    /// `first` if no history came before: the colour is kept for a replay after a first frame, and after a frame with one.
    pub fn new(
        frame: &Frame,
        surfaces: Option<Surfaces>,
        history: Interleaved,
        params: &Params,
        first: bool,
    ) -> Self {
        let replayed = params.gradient.is_some() && (first || frame.replay.is_some());
        let compared = Surface {
            color: frame.surface.color.filter(|_| params.same_albedo),
            ..frame.surface
        };
        Self {
            history,
            shown: replayed
                .then(|| replay::Before::of(frame.color, texture(frame, surfaces.as_ref()))),
            reflections: None,
            surface: OwnedSurface::of(&compared),
            motion: (told_by_motion(frame).filter(|_| params.tests_motion()))
                .map(Pixels::to_interleaved),
            camera: frame.camera,
            demodulated: frame.albedo.is_some(),
            surfaces,
        }
    }

    /// Rejects the history of surfaces whose albedo has become a reflectance or ceased to be one: what it knows of their
    /// light is divided by another number than the frame's. An id that the frame does not have fails the test of ids.
    pub fn reject_changed(&mut self, now: Option<&Surfaces>) {
        let Some((before, now)) = self.surfaces.as_ref().zip(now) else {
            return;
        };
        let changed = now.changed(before);
        if changed.is_empty() {
            return;
        }
        let unused = now.unused();
        for id in self.surface.ids_mut() {
            *id = if changed.contains(id) { unused } else { *id };
        }
    }

    /// Forgets the ids if they are the renderer's and the next frame's are not, or the other way round.
    pub fn forget_ids_unless(&mut self, own: bool) {
        let had_own = (self.surfaces.as_ref()).is_some_and(|surfaces| surfaces.by_ids);
        if had_own != own {
            self.surface.forget_ids();
        }
    }

    /// Counts white as ordinary, where kinds of material stand in for ids.
    pub fn merge_white(&mut self) {
        merge_white(self.surface.ids_mut());
    }

    /// Multiplies all light by a factor.
    fn scale(&mut self, change: f32) {
        let (size, channels) = (self.history.size, self.history.pixels().channels);
        let factors: Vec<_> = (0..channels)
            .map(|channel| history_factor(channel, change))
            .collect();
        scale(size.width, self.history.data_mut(), &factors);
        if let Some(known) = &mut self.reflections {
            scale(size.width, known.light.data_mut(), &[change; 3]);
        }
    }

    pub fn depth(&self) -> Option<Pixels<'_>> {
        self.surface.surface().depth
    }

    pub fn expects_replay(&self) -> bool {
        self.shown.is_some()
    }

    /// Whether the frame goes on where this ended.
    pub fn check(&self, frame: &Frame) -> Result<()> {
        check_size(self.history.size, frame.color.size)?;
        if self.demodulated == frame.albedo.is_some() {
            return Ok(());
        }
        let [before, now] = [self.demodulated, frame.albedo.is_some()]
            .map(|has| if has { "given" } else { "absent" });
        Err(Error::value(
            "albedo",
            format!("{before}, as in the other frames (or reset() between)"),
            now,
        ))
    }

    /// For the test of motion, where no depth is known: how well the pixels that come from one place agree with its own motion.
    pub fn claims(&self, frame: &Frame, motion: &Motion, params: &Params) -> Option<Interleaved> {
        let before = self.motion.as_ref().filter(|_| params.tests_motion())?;
        told_by_motion(frame).map(|_| claims(motion.pixels(), before.pixels()))
    }

    /// Fetches history run by run, with what [`claims`](Self::claims) found.
    pub fn fetch<'a>(
        &'a self,
        frame: &Frame<'a>,
        motion: &Motion,
        params: &Params,
        claims: Option<&'a Interleaved>,
    ) -> Fetch<'a> {
        let tests = self
            .tests(frame, motion, &params.surface)
            .with_claims(claims.map(Interleaved::pixels));
        Fetch::new(&[self.history.pixels()], frame.color.size, tests, BILINEAR)
    }

    /// The validation of history.
    fn tests<'a>(
        &'a self,
        frame: &Frame<'a>,
        motion: &Motion,
        limits: &validate::Params,
    ) -> Tests<'a> {
        Tests::new(
            frame.surface,
            self.surface.surface(),
            self.rays(motion),
            limits,
        )
    }

    /// The tests of surfaces by coarse ids, and without the test of the directions of normals.
    fn coarse_tests<'a>(
        &'a self,
        now: &Now<'a>,
        [here, before]: [Option<&'a Image<u32>>; 2],
    ) -> Tests<'a> {
        let with = |surface, ids: Option<&'a Image<u32>>| Surface {
            ids: ids.map(Image::pixels),
            ..surface
        };
        let limits = validate::Params {
            normal_angle: Threshold::hard(180.0),
            ..now.params.surface
        };
        let (here, before) = (
            with(now.frame.surface, here),
            with(self.surface.surface(), before),
        );
        Tests::new(here, before, self.rays(now.motion), &limits)
    }

    /// Whether history is tested by its distance from this frame's planes.
    pub fn tests_planes(&self, frame: &Frame, motion: &Motion) -> bool {
        let tests = self.tests(frame, motion, &validate::Params::default());
        tests.used().contains(&"plane")
    }

    /// The coarse ids of the frame before.
    fn coarse_ids(&self) -> Option<Image<u32>> {
        let reflects = self.surfaces.as_ref().map(Surfaces::mask);
        let ids = self.surface.surface().ids;
        ids.map(|ids| coarse_ids(ids, reflects))
    }

    /// The rays of the frame before, if history is tested by its distance from planes.
    fn rays(&self, motion: &Motion) -> Option<Rays> {
        let camera = self.camera.as_ref().filter(|_| motion.tells_depth());
        camera.map(Camera::rays)
    }
}

/// The motion of a frame without depth, which stands in for it; none among surfaces thinner than a pixel, where motion
/// changes from pixel to pixel.
pub fn told_by_motion<'a>(frame: &Frame<'a>) -> Option<Pixels<'a>> {
    (frame.motion).filter(|&motion| frame.surface.depth.is_none() && !is_erratic(motion))
}

/// The tiles in which normals and ids are incoherent, and the coarse ids that tell surfaces apart there.
pub struct Incoherent {
    tiles: Tiles,
    ids: Option<Image<u32>>,
}

impl Incoherent {
    /// None if all is coherent.
    fn find(now: &Now, confidence: Pixels) -> Option<Self> {
        let Surface { normal, ids, .. } = now.frame.surface;
        let tiles = incoherent(confidence.size, normal, ids, Some(confidence));
        let reflects = now.texture.and_then(|texture| texture.mask);
        tiles.any().then(|| Self {
            tiles,
            ids: ids.map(|ids| coarse_ids(ids, reflects)),
        })
    }

    pub fn guide(&self) -> Coarse<'_> {
        Coarse {
            tiles: &self.tiles,
            ids: self.ids.as_ref().map(Image::pixels),
        }
    }
}

/// The frame to which [`recall`] brings history.
pub struct Now<'a> {
    pub params: &'a Params,
    pub frame: &'a Frame<'a>,
    pub motion: &'a Motion<'a>,
    pub texture: Option<Texture<'a>>,
    /// The illumination as it was sampled.
    pub sample: &'a Image,
    /// Distances behind the surface at which reflections are looked for.
    pub reflections: &'a [f32],
}

/// History at the current frame's pixels.
pub struct Recalled {
    /// Beginning with the channels of [`crate::kernels::merge::accumulate`].
    pub history: Image,
    /// The new illumination without fireflies, where they are suppressed.
    pub held: Option<Image>,
    /// The factor by which all light has changed; history has been multiplied by it.
    pub change: f32,
    pub gradient: Option<Image>,
    pub reflections: Option<reflections::Won>,
    pub incoherent: Option<Incoherent>,
}

/// Brings history to the current frame. `hold` suppresses fireflies, given the history's illumination. Writes how much of
/// each pixel's footprint was accepted, and the tests that the rest failed.
pub fn recall(
    now: &Now,
    memory: Option<&mut Memory>,
    channels: usize,
    hold: impl FnOnce(Option<Pixels>) -> Option<Image>,
    coverage: &mut [f32],
    rejection: &mut [u8],
) -> Recalled {
    let Some(memory) = memory else {
        coverage.fill(0.0);
        rejection.fill(0);
        return Recalled {
            history: Image::new(now.frame.color.size, channels),
            held: hold(None),
            change: 1.0,
            gradient: None,
            reflections: None,
            incoherent: None,
        };
    };
    let replayed = memory.relight(now);
    let claims = memory.claims(now.frame, now.motion, now.params);
    let claims = claims.as_ref().map(Interleaved::pixels);
    let (mut history, told, incoherent) =
        memory.fetch_all(now, claims, replayed.as_ref(), coverage, rejection);
    let change = match &told {
        Some(_) => 1.0, // replayed already
        None => memory.follow_light(now, &mut history, coverage),
    };
    let held = hold(Some(history.pixels().part(0..3)));
    let gradient = now.params.gradient.map(|estimated| {
        told.unwrap_or_else(|| {
            let color = held.as_ref().unwrap_or(now.sample);
            let known = [color.pixels(), history.pixels().part(0..3)];
            let coverage = View::new(color.size, 1, coverage);
            find_gradient(known, Some(coverage), estimated)
        })
    });
    let reflections = memory.reflect(now, claims, &mut history, coverage);
    Recalled {
        history,
        held,
        change,
        gradient,
        reflections,
        incoherent,
    }
}

impl Memory {
    /// Brings the history's light up to the frame's replay, if it has one that was expected, and returns how far each pixel's
    /// light has changed.
    fn relight(&mut self, now: &Now) -> Option<Image> {
        let (replay, shown) = now.frame.replay.zip(self.shown.as_ref())?;
        let light = self.reflections.as_mut().map(|known| &mut known.light);
        let corrects = now.params.innovation.is_some();
        Some(replay::relight(
            replay,
            shown,
            &mut self.history,
            light,
            corrects,
        ))
    }

    /// History along the motion, and the change that a replay tells; again by coarser tests where normals and ids are
    /// incoherent.
    fn fetch_all(
        &self,
        now: &Now,
        claims: Option<Pixels>,
        replayed: Option<&Image>,
        coverage: &mut [f32],
        rejection: &mut [u8],
    ) -> (Image, Option<Image>, Option<Incoherent>) {
        let tests = self
            .tests(now.frame, now.motion, &now.params.surface)
            .with_claims(claims);
        let motion = now.motion.pixels();
        let mut planes = vec![self.history.pixels()];
        planes.extend(replayed.map(Image::pixels));
        let mut values = reproject(&planes, motion, tests, BILINEAR, coverage, Some(rejection));
        let confidence = View::new(motion.size, 1, coverage).into();
        let looks = now.params.coherence;
        let incoherent = (looks.then(|| Incoherent::find(now, confidence))).flatten();
        if let Some(found) = &incoherent {
            let before = self.coarse_ids();
            let tests = self
                .coarse_tests(now, [found.ids.as_ref(), before.as_ref()])
                .with_claims(claims);
            let (tiles, values) = (&found.tiles, &mut values);
            reproject_again(
                tiles, &planes, motion, tests, BILINEAR, values, coverage, rejection,
            );
        }
        let mut values = values.into_iter();
        let history = values.next().expect("the first plane is the history");
        (history, values.next(), incoherent)
    }

    /// Multiplies the fetched history, and what the next frame will know, by the factor by which all light has changed, if
    /// innovation is on; returns it.
    fn follow_light(&mut self, now: &Now, history: &mut Image, coverage: &[f32]) -> f32 {
        if now.params.innovation.is_none() {
            return 1.0;
        }
        let size = history.size;
        let light = history.pixels().part(0..3);
        let covered = View::new(size, 1, coverage);
        let change = light_change(now.sample.pixels(), light, Some(covered));
        if change != 1.0 {
            self.scale(change);
            let planes = history.data_mut().chunks_mut(size.pixels());
            for (channel, plane) in planes.enumerate() {
                scale(size.width, plane, &[history_factor(channel, change)]);
            }
        }
        change
    }

    /// The history of what is reflected, where it predicts the samples better.
    fn reflect(
        &self,
        now: &Now,
        claims: Option<Pixels>,
        history: &mut Image,
        coverage: &mut [f32],
    ) -> Option<reflections::Won> {
        let known = self.reflections.as_ref()?;
        let cameras = now.frame.camera.as_ref().zip(self.camera.as_ref())?;
        let own = Own {
            motion: now.motion.pixels(),
            tests: (self.tests(now.frame, now.motion, &now.params.surface)).with_claims(claims),
            params: BILINEAR,
        };
        reflections::choose(
            known,
            self.history.pixels(),
            now.reflections,
            now.frame,
            cameras.into(),
            self.surface.surface(),
            own,
            now.sample.view(),
            history,
            coverage,
        )
    }
}
