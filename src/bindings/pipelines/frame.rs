//! The frames that pipelines take.

use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::output::{History, HistoryArgs, Output, Room, warn};
use crate::bindings::arrays::{
    COLOR, Channels, Direct, Input, MOTION, Number, Out, detached, needs, wrong_type,
};
use crate::bindings::camera::Camera;
use crate::error::Error;
use crate::image::{Pixels, Size};
use crate::kernels::camera::pinhole;
use crate::kernels::fetch::validate::Surface;
use crate::pipelines::{self, Pipeline as _, Svgf};

/// The buffers of a `yester.Frame`, borrowed; `Frame` has validated them.
pub(super) struct FrameArgs<'py> {
    floats: [Option<Input<'py>>; 11],
    ids: Option<Input<'py, u32>>,
    camera: Option<pinhole::Camera>,
    jitter: Option<[f64; 2]>,
}

impl<'py> FrameArgs<'py> {
    const FLOATS: [(&'static str, Channels); 11] = [
        ("color", COLOR),
        ("albedo", COLOR),
        ("emission", COLOR),
        ("normal", COLOR),
        ("object_normal", COLOR),
        ("position", COLOR),
        ("depth", Channels::One),
        ("motion", MOTION),
        ("replay", COLOR),
        ("hit_distance", Channels::One),
        ("reactive", Channels::One),
    ];

    pub(super) fn new(frame: &Bound<'py, PyAny>) -> PyResult<Self> {
        let class = frame.py().import("yester.frame")?.getattr("Frame")?;
        if !frame.is_instance(&class)? {
            return Err(wrong_type(
                "frame",
                "a yester.Frame",
                frame.get_type().name()?,
            ));
        }
        let mut floats = [const { None }; 11];
        for (buffer, (name, channels)) in floats.iter_mut().zip(Self::FLOATS) {
            *buffer = read(frame, name, channels)?;
        }
        let camera = frame.getattr("camera")?.extract::<Option<Camera>>()?;
        Ok(Self {
            floats,
            ids: read(frame, "ids", Channels::One)?,
            camera: camera.map(|camera| camera.inner),
            jitter: frame.getattr("jitter")?.extract()?,
        })
    }

    pub(super) fn size(&self) -> Size {
        self.color().size
    }

    /// Runs `step` on the frame without the interpreter's lock.
    pub(super) fn step(
        self,
        py: Python<'py>,
        out: Option<&Bound<'py, Output>>,
        pipeline: &mut (impl pipelines::Pipeline + Send),
    ) -> PyResult<Output> {
        let size = pipeline.output_size(self.size());
        let mut room = Room::new(py, out, size, pipeline.extras())?;
        let output = room.data()?;
        let frame = self.frame();
        let (summary, mistake) = detached(py, || pipeline.step(&frame, output))??;
        // Release the frame's buffers first: `out` may alias them.
        drop(self);
        room.output(py, summary, mistake)
    }

    /// The same with the history of later frames.
    pub(super) fn step_between(
        self,
        py: Python<'py>,
        out: Option<&Bound<'py, Output>>,
        later: Option<&Bound<'py, History>>,
        pipeline: &mut Svgf,
    ) -> PyResult<Output> {
        let Some(later) = later else {
            return self.step(py, out, pipeline);
        };
        let size = self.size();
        let used = later.get().used.bind(py);
        let divided = used.contains("albedo")?;
        // A history that lists no buffers may be of either kind.
        if !used.is_empty() && divided != self.frame().albedo.is_some() {
            let [expected, got] = match divided {
                true => ["without albedo, as the frame", "with it"],
                false => ["with albedo, as the frame", "without it"],
            };
            let expected = format!("a history of frames {expected}");
            return Err(Error::value("later", expected, format!("one of frames {got}")).into());
        }
        let later = HistoryArgs::new(later, size)?;
        let mut room = Room::new(py, out, size, pipeline.extras())?;
        let output = room.data()?;
        let (frame, history) = (self.frame(), later.history());
        let (summary, mistake) = detached(py, || pipeline.step_between(&frame, &history, output))??;
        drop((self, later));
        room.output(py, summary, mistake)
    }

    /// The same for a denoised frame, with the samples that it was made of, and the denoiser's confidence.
    pub(super) fn step_denoised(
        self,
        py: Python<'py>,
        out: Option<&Bound<'py, Output>>,
        [samples, confidence]: [Option<&Bound<'py, PyAny>>; 2],
        pipeline: &mut pipelines::taa::Taa,
    ) -> PyResult<Output> {
        let Some(samples) = samples else {
            if confidence.is_some() {
                return Err(needs("confidence", "samples"));
            }
            return self.step(py, out, pipeline);
        };
        let size = self.size();
        let samples = Input::<f32>::of_size(samples, "samples", COLOR, size)?;
        let confidence = Input::<f32>::optional(confidence, "confidence", Channels::One, size)?;
        let mut room = Room::new(py, out, size, pipeline.extras())?;
        let output = room.data()?;
        let frame = self.frame();
        let source = pipelines::taa::Source {
            samples: samples.pixels(),
            confidence: (confidence.as_ref()).map(|image| image.pixels().plane()),
        };
        let (summary, mistake) = detached(py, || pipeline.step_denoised(&frame, source, output))??;
        drop((self, samples, confidence));
        room.output(py, summary, mistake)
    }

    /// Runs `recall` on the frame without the interpreter's lock.
    pub(super) fn recall(self, py: Python<'py>, pipeline: &mut Svgf) -> PyResult<History> {
        let Size { height, width } = self.size();
        let shapes: [&[usize]; 3] = [&[height, width, 3], &[height, width, 2], &[height, width]];
        let mut color = Direct::new(py, Out::fresh(shapes[0]))?;
        let mut moments = Direct::new(py, Out::fresh(shapes[1]))?;
        let mut length = Direct::new(py, Out::fresh(shapes[2]))?;
        let mut confidence = Direct::new(py, Out::fresh(shapes[2]))?;
        let mut rejection = Direct::<u8>::new(py, Out::fresh(shapes[2]))?;
        let mut motion = Direct::new(py, Out::fresh(shapes[1]))?;
        let expected = pipelines::HistoryMut {
            color: color.data()?,
            moments: moments.data()?,
            length: length.data()?,
            confidence: confidence.data()?,
            rejection: rejection.data()?,
            motion: motion.data()?,
        };
        let frame = self.frame();
        let (summary, mistake) = detached(py, || pipeline.recall(&frame, expected))??;
        if let Some(mistake) = mistake {
            warn(py, &mistake.to_string())?;
        }
        Ok(History {
            color: color.array()?.unbind(),
            moments: moments.array()?.unbind(),
            history_length: length.array()?.unbind(),
            confidence: confidence.array()?.unbind(),
            rejection: rejection.array()?.unbind(),
            motion: Some(motion.array()?.unbind()),
            used: PyTuple::new(py, summary.used)?.unbind(),
        })
    }

    fn color(&self) -> Pixels<'_> {
        let [color, ..] = &self.floats;
        color.as_ref().expect("every frame has colour").pixels()
    }

    fn frame(&self) -> pipelines::Frame<'_> {
        let buffers = self.floats.each_ref();
        let [
            _,
            albedo,
            emission,
            normal,
            object_normal,
            position,
            depth,
            motion,
            replay,
            hit_distance,
            reactive,
        ] = buffers.map(|buffer| buffer.as_ref().map(Input::pixels));
        pipelines::Frame {
            color: self.color(),
            albedo,
            emission,
            surface: Surface {
                depth,
                normal,
                ids: self.ids.as_ref().map(Input::pixels),
                object_normal,
                color: None,
            },
            position,
            motion,
            replay,
            hit_distance,
            reactive,
            camera: self.camera,
            jitter: self.jitter,
        }
    }
}

fn read<'py, T: Number>(
    frame: &Bound<'py, PyAny>,
    name: &str,
    channels: Channels,
) -> PyResult<Option<Input<'py, T>>> {
    let value = frame.getattr(name)?;
    if value.is_none() {
        Ok(None)
    } else {
        Input::new(&value, name, channels).map(Some)
    }
}
