//! What comes before the filter: a frame's illumination joins the history.

use super::{Current, Reports};
use crate::image::{
    BandMut, Image, Interleaved, Pixels, Run, SEGMENT, View, deinterleave, plane_bands,
};
use crate::kernels::fetch::reproject::{Fetch, Fetched};
use crate::kernels::merge::accumulate::{self, CHANNELS, History, Images, Samples, accumulate};
use crate::kernels::smooth::lend;
use crate::pipelines::illumination::without_fireflies;
use crate::pipelines::recall::{self, Memory, Recalled};
use crate::pixels::{MotionLanes, PixelsMut, Row};

/// The history with a frame's samples in it.
pub struct Merged {
    pub history: Interleaved,
    /// Samples that were not finite.
    pub missing: usize,
    /// What was known before; None where it was merged as it was fetched.
    pub recalled: Option<Recalled>,
}

/// Brings history to the frame, image by image, and merges its illumination into it.
pub fn merge(
    now: &Current,
    sample: &Image,
    mut memory: Option<Memory>,
    reports: &mut Reports,
) -> Merged {
    let (params, texture) = (now.params, now.texture);
    let size = now.size();
    let hold = |known: Option<Pixels>| {
        (params.history.fireflies)
            .map(|params| without_fireflies(sample, known, texture, now.guide(), params))
    };
    let frame = recall::Now {
        params: &params.history,
        frame: now.frame,
        motion: now.motion,
        texture,
        sample,
        reflections: &params.reflections,
    };
    let recalled = recall::recall(
        &frame,
        memory.as_mut(),
        CHANNELS,
        hold,
        reports.confidence,
        reports.rejection,
    );
    drop(memory);
    let known = &recalled.history;
    let color = recalled.held.as_ref().unwrap_or(sample);
    let lent =
        (params.lend).map(|params| lend::lend(color, known.channels(5..6), now.guide(), params));
    let samples = Samples {
        size,
        color: &lent.as_ref().map_or(color, |lent| &lent.color).pixels(),
        weight: lent.as_ref().map(|lent| lent.weight.view()),
        gradient: recalled.gradient.as_ref().map(Image::view),
    };
    let images = Images {
        parts: accumulate::parts(known.pixels()),
        confidence: (params.history.by_confidence).then(|| View::new(size, 1, reports.confidence)),
    };
    let mut history = Interleaved::blank(size, CHANNELS);
    let outs = merged(&mut history, reports.history_length);
    let nothing = std::iter::repeat(());
    let missing = accumulate(samples, &images, now.accumulate, outs, nothing);
    Merged {
        history,
        missing: lent.map_or(missing, |lent| lent.missing),
        recalled: Some(recalled),
    }
}

/// [`merge`] in one sweep, without images in between: for parameters by which no pass reads neighbouring pixels.
pub fn merge_at_once(now: &Current, memory: Option<Memory>, reports: &mut Reports) -> Merged {
    let (params, size) = (&now.params.history, now.size());
    let samples = Samples {
        size,
        color: &now.fresh(),
        weight: None,
        gradient: None,
    };
    let memory = memory.as_ref();
    let claims = memory.and_then(|memory| memory.claims(now.frame, now.motion, params));
    let along = Along {
        fetch: memory.map(|memory| memory.fetch(now.frame, now.motion, params, claims.as_ref())),
        motion: now.motion.pixels(),
        by_confidence: params.by_confidence,
    };
    let mut history = Interleaved::blank(size, CHANNELS);
    let outs = merged(&mut history, reports.history_length);
    let known = plane_bands(reports.confidence, size).zip(plane_bands(reports.rejection, size));
    let missing = accumulate(samples, &along, now.accumulate, outs, known);
    Merged {
        history,
        missing,
        recalled: None,
    }
}

/// The outputs of accumulation: all channels, and the length once more.
fn merged<'a>(
    history: &'a mut Interleaved,
    length: &'a mut [f32],
) -> impl Iterator<Item = [accumulate::Part<'a>; 2]> {
    let size = history.size;
    history
        .pixels_mut()
        .zip(PixelsMut::planar(size, length))
        .map(|(all, length)| [(0..6, all), (5..6, length)])
}

/// History that is fetched along the motion when it is merged.
struct Along<'a> {
    /// None for a first frame.
    fetch: Option<Fetch<'a>>,
    motion: Pixels<'a>,
    by_confidence: bool,
}

impl<'a> History for Along<'a> {
    /// Confidence and rejection.
    type Out = (BandMut<'a>, BandMut<'a, u8>);
    type Scratch = (MotionLanes, Option<Fetched>);

    fn scratch(&self) -> Self::Scratch {
        (
            MotionLanes::zeroed(),
            self.fetch.as_ref().map(Fetch::scratch),
        )
    }

    #[inline(always)]
    fn read(
        &self,
        run: Run,
        (lanes, fetched): &mut Self::Scratch,
        history: &mut [Row; CHANNELS],
        confidence: &mut Row,
        (covered, rejected): &mut Self::Out,
    ) {
        let Some((fetch, fetched)) = self.fetch.as_ref().zip(fetched.as_mut()) else {
            history.iter_mut().for_each(|row| row.fill(0.0));
            covered.put(run, &history[0]);
            rejected.put(run, &[0; SEGMENT]);
            return;
        };
        fetch.run(run, lanes.load(&self.motion, run), fetched);
        let records = &fetched.values(0)[..run.len * CHANNELS];
        deinterleave(records, history.iter_mut().map(|row| &mut row[..run.len]));
        covered.put(run, &fetched.coverage);
        rejected.put(run, &fetched.rejection);
        if self.by_confidence {
            *confidence = fetched.coverage;
        }
    }
}
