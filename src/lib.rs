//! Yester: temporal reprojection and denoising of rendered frames, on any CPU.
//!
//! [`pipelines`] are whole methods that work on a sequence frame by frame: they reproject the history along motion vectors,
//! validate it, accumulate the new samples, and filter the remaining noise in space. Every buffer of a
//! [`Frame`](pipelines::Frame) but its colour is optional. Two frames, denoised:
//!
//! ```
//! use yester::pipelines::svgf::{Params, Svgf};
//! use yester::pipelines::{Frame, Pipeline, Results};
//! use yester::{Pixels, Size};
//!
//! # fn main() -> yester::error::Result<()> {
//! let size = Size { height: 48, width: 64 };
//! let mut svgf = Svgf::new(Params::default())?;
//! let mut results = Results::new(&svgf, size)?;
//! for number in 0..2 {
//!     // A renderer gives these: three channels of each pixel side by side, rows from the top.
//!     let noise = |i: usize| (i * 2654435761 + number * 97) % 1000;
//!     let color: Vec<f32> = (0..3 * size.pixels()).map(|i| noise(i) as f32 / 1000.0).collect();
//!     let depth = vec![1.0; size.pixels()];
//!     let motion = vec![0.0; 2 * size.pixels()];
//!
//!     let mut frame = Frame::new(Pixels::interleaved(size, 3, &color)?);
//!     frame.surface.depth = Some(Pixels::interleaved(size, 1, &depth)?);
//!     frame.motion = Some(Pixels::interleaved(size, 2, &motion)?);
//!     let (summary, mistake) = svgf.step(&frame, results.output())?;
//!     assert_eq!(summary.missing, 0);
//!     assert!(mistake.is_none());
//! }
//! // The mean is 0.5, and the noise deviates from it by 0.25 on average: less remains.
//! let off: f32 = results.color.iter().map(|value| (value - 0.5).abs()).sum();
//! assert!(off / (results.color.len() as f32) < 0.1);
//! assert!(results.history_length.iter().all(|&length| length == 2.0));
//! # Ok(())
//! # }
//! ```
//!
//! [`kernels`] are the passes of the pipelines, one module each, headed by the formula and its source.
//!
//! Every kernel uses all cores and the widest vector instructions of the CPU. Two environment variables lower that, never
//! raise it: `YESTER_THREADS`, a number of threads, and `YESTER_SIMD`, one of `baseline`, `avx2`, `avx512` and `neon`; see
//! [`Settings`]. The results have the same bits with every setting. The feature `python` adds the extension module of the
//! Python package; nothing else needs it.
//!
//! # Inside
//!
//! A frame passes through the kernels in the order of their folders. In Python, numpy arrays come in and go out:
//!
//! ```text
//!   numpy ── bindings ──► views                                 arrays are checked once, at the door
//!   camera   jitter ► motion_vectors ► dilate_motion            where was each pixel's surface,
//!            virtual_motion                                     and what it reflects?
//!   fetch    invert_motion                                      and where will it be?
//!            reproject                                          history, gathered and validated tap by tap,
//!            splat ► pull_push                                  or scattered point by point, its holes filled
//!   judge    consistency, disocclusion, thin_features,          history of another surface or light is refused,
//!            incoherent_guides, light_change, material_change,
//!            repetition,
//!            exposure ► clip_history, alternation ► anti_lag,
//!            temporal_gradient, prediction_gain ► blend_factor, or weighs less,
//!            innovation, compare_candidates ► choice,           or is corrected; the best of several wins,
//!            collocate ► collocation_shares                     or their best mixture
//!   merge    resample ► accumulate, blend, recirculate, resolve new samples are accumulated,
//!            combine_histories, converge                        and both sides of time put together
//!   smooth   suppress_fireflies, fix_history, reconstruct,      the remaining noise
//!            estimate_variance ► atrous, regress ► restore_detail, is filtered in space,
//!            morphological_aa, smooth_edges, sharpen,           edges become smooth,
//!            joint_bilateral_upsample                           and pixels without samples are filled
//!   numpy ◄─ bindings ─── views
//! ```
//!
//! `demodulate` divides by the albedo before, where it `is_reflectance`, and `remodulate` multiplies by it after;
//! `morphological_aa` antialiases where there is no history. Pipelines are lists of these kernels that keep the history. The
//! module `rows` runs all of them, band by band on every core, compiled for the CPU's best instruction set.

#[cfg(feature = "python")]
mod bindings;
mod bordered;
mod box_sums;
pub mod error;
mod image;
pub mod kernels;
mod lanes;
mod math;
mod memory;
mod minima;
mod pairs;
pub mod pipelines;
mod pixels;
mod rows;
mod tiles;

pub use glam;
pub use image::{BandMut, Image, Interleaved, Pixels, Run, Size, Value, View};
pub use memory::OutOfMemory;
pub use pixels::{Colors, InterleavedMut, PixelsMut};
pub use rows::Settings;
pub use tiles::Tiles;
