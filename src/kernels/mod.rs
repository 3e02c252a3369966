//! The passes of the pipelines, in folders that sort in the order of data flow.
//!
//! Each module is headed by its formula with the source, and by the channels and ranges of its inputs and outputs. Inputs
//! are views, [`Pixels`](crate::Pixels) or [`View`](crate::View). An output that is an iterator takes bands: those of
//! [`PixelsMut::interleaved`](crate::PixelsMut::interleaved), or the [`bands`](crate::Image::bands) of a planar image. An
//! output that is a slice is interleaved.
//!
//! Kernels do not validate their arguments: call `Params::check` for the parameters, and the functions named `check` for
//! the numbers beside them. All images of a call have the same size unless the module says otherwise; a kernel panics if
//! an output is too small, and may leave elements of one that is too large as they were. It panics, too, if an environment
//! variable that [`Settings`](crate::Settings) reads has a value that it cannot have. [Pipelines](crate::pipelines) check all
//! of this themselves.

pub mod camera;
pub mod fetch;
pub mod judge;
pub mod merge;
pub mod smooth;

#[cfg(test)]
mod tests;
