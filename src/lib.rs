//! Yester: temporal reprojection and denoising of rendered frames, on any CPU.
//!
//! [`pipelines`] are whole methods that work on a sequence frame by frame: they carry what earlier frames saw to the current
//! one along motion vectors, judge how far it may be trusted, merge it with the new samples, and smooth the noise that is
//! left. Every buffer of a [`Frame`](pipelines::Frame) but its colour is optional. Two frames, denoised:
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
//! // Uniform light of 0.5, in which noise was 0.25 off on average: less is left.
//! let off: f32 = results.color.iter().map(|value| (value - 0.5).abs()).sum();
//! assert!(off / (results.color.len() as f32) < 0.1);
//! assert!(results.history_length.iter().all(|&length| length == 2.0));
//! # Ok(())
//! # }
//! ```
//!
//! [`kernels`] are their building blocks, one module each, which begins with the formula and its source.
//!
//! All cores work, with the widest vector instructions that the CPU has. The environment lowers that: `YESTER_THREADS` to a
//! number of threads, `YESTER_SIMD` to `baseline`, `avx2`, `avx512` or `neon`; see [`Settings`]. Results have the same bits
//! with all of them. The feature `python` adds the extension module of the Python package; nothing else needs it.
//!
//! # Inside
//!
//! A frame flows through the kernels in the order of their folders. In Python, numpy's arrays are at both ends:
//!
//! ```text
//!   numpy ── bindings ──► planar views                          arrays are checked and taken apart, once
//!   camera   jitter ► motion_vectors ► dilate_motion            where was each pixel's surface,
//!            virtual_motion                                     and what it reflects?
//!   fetch    invert_motion                                      and where will it be?
//!            reproject                                          history, brought here tap by tap,
//!            splat ► pull_push                                  or point by point, its holes filled
//!   judge    consistency, disocclusion, thin_features,          what shows another surface or light is refused,
//!            exposure ► clip_history, alternation ► anti_lag,
//!            temporal_gradient, prediction_gain ► blend_factor, or counts for less,
//!            innovation, choice                                 or is corrected; the best of several is chosen
//!   merge    resample ► accumulate, blend, recirculate, resolve new samples join the history that is left
//!   smooth   suppress_fireflies, fix_history, reconstruct,      what noise remains
//!            estimate_variance ► atrous, regress,               is averaged in space,
//!            morphological_aa, joint_bilateral_upsample,        and what was not traced is filled
//!            sharpen
//!   numpy ◄─ bindings ─── planar images
//! ```
//!
//! `demodulate` and `remodulate` take the texture off before and put it back after; `morphological_aa` smooths the edges
//! of an image that has no history. Pipelines are lists of these kernels that keep the history; `rows` runs them
//! all, on every core and with the instructions that the CPU has.

#[cfg(feature = "python")]
mod bindings;
mod bordered;
pub mod error;
mod image;
pub mod kernels;
mod lanes;
mod math;
mod memory;
pub mod pipelines;
mod pixels;
mod rows;

pub use glam;
pub use image::{BandMut, Image, Pixels, Records, Size, Value, View};
pub use memory::OutOfMemory;
pub use pixels::PixelsMut;
pub use rows::Settings;
