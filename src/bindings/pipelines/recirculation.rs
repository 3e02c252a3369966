//! Forward reprojection with recirculation.

use pyo3::prelude::*;

use super::{FrameArgs, Output, Pipeline, Room};
use crate::kernels::fetch::{pull_push, splat};
use crate::kernels::merge::recirculate;
use crate::pipelines::frame::Pipeline as _;
use crate::pipelines::recirculation;

/// Whole pictures from frames of which a part of the pixels is traced.
///
/// What has been seen is kept as points in the world, one for each pixel, and scattered to where it appears now; the
/// samples of the new frame, its holes filled from around, join it by quality. No buffer is needed where nothing was
/// traced.
///
/// A pixel of a frame was traced if its colour is finite and its place is known: its `position`, or else its `depth`,
/// +inf where nothing was hit. All others are missing, whatever is in their buffers; NaN says so. Every frame needs a
/// camera. The pattern of traced pixels should change from frame to frame, so that each is traced at some time.
///
/// Parameters
/// ----------
/// factor : int, default 2
///     By how much the levels that fill holes grow, 2 to 16: as for `pull_push`.
/// levels : int, optional
///     How many of them, at least 1; by default as many as there can be.
/// blur, share, fade, limit : optional
///     As for `recirculate`. The blur is seen only, and not carried on.
/// tolerance : float, default 0.1
///     As for `splat`; and by how much a sample's depth may differ, as a share of it, from that of what was known
///     there.
///
/// Raises
/// ------
/// ValueError
///     If a parameter is out of range.
///
/// Notes
/// -----
/// After "Reprojection 2", a developer's diary of 2008. Each step consists of this package's functions and
/// gives their bits: `splat` (with a reach of 0.5), `pull_push` (of colour and the inverse of depth), `motion_vectors`,
/// and `recirculate`, without blur for the next frame and with it for the result. A pixel's point lies where it was
/// sampled (`Frame.position` or `Frame.jitter`, else the centre), where it comes from, or, at the depth of those
/// around, in the centre. What is filled does not count beside what has eight times its quality, or what stands still
/// would never be as sharp as its samples. With `Frame.motion` where a pixel is traced, what moves by itself is taken
/// to go on as it did (`splat`'s drift); without, it stays behind until samples overwrite it, as does light that
/// changes.
#[pyclass(extends = Pipeline, module = "yester")]
pub struct Recirculation {
    inner: recirculation::Recirculation,
}

#[pymethods]
impl Recirculation {
    #[new]
    #[pyo3(signature = (*, factor=2, levels=None, blur=0.25, share=(0.0, 1.0), fade=64.0, limit=8.0, tolerance=0.1))]
    #[pyo3(
        text_signature = "(*, factor=2, levels=None, blur=0.25, share=(0.0, 1.0), fade=64.0, limit=8.0, tolerance=0.1)"
    )]
    fn new(
        factor: i64,
        levels: Option<i64>,
        blur: f32,
        share: (f32, f32),
        fade: f32,
        limit: f32,
        tolerance: f32,
    ) -> PyResult<PyClassInitializer<Self>> {
        let params = recirculation::Params {
            splat: splat::Params {
                tolerance,
                reach: 0.5,
            },
            pull_push: pull_push::Params::new(factor, levels)?,
            recirculate: recirculate::Params {
                blur,
                share: share.into(),
                fade,
                limit,
            },
        };
        let inner = recirculation::Recirculation::new(params)?;
        Ok(Pipeline::made(Self { inner }))
    }

    /// Completes the next frame of the sequence.
    ///
    /// Parameters
    /// ----------
    /// frame : Frame
    ///     Of the same size as those before, with camera, and depth or position.
    /// out : Output, optional
    ///     Of an earlier step, no longer needed: its arrays are overwritten and returned, instead of new ones.
    ///
    /// Returns
    /// -------
    /// Output
    ///     Without a variance. `history_length` is the quality that is carried on: 1 for a sample, and more for
    ///     several; the smaller, the farther off samples are. `confidence` is 1 where the past knows the pixel, else 0;
    ///     `rejection` is OUTSIDE where no point of the past came to be, and DEPTH where a sample shows that another
    ///     surface has taken its place. As long as nothing at all has been traced, colour is black.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the frame has no camera, or neither depth nor position; if the size changes without `reset` in between;
    ///     if `out` does not fit.
    #[pyo3(signature = (frame, out=None))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, Output>>,
    ) -> PyResult<Output> {
        let frame = FrameArgs::new(frame)?;
        let room = Room::new(py, out, frame.size(), false)?;
        frame.step(py, room, &mut self.inner)
    }

    /// Forgets the sequence; the next frame is a first one.
    fn reset(&mut self) {
        self.inner.reset();
    }
}
