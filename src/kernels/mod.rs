//! The building blocks, in folders that sort in the order in which data flows.
//!
//! Each module begins with its formula and the source of that, and the channels and ranges of what goes in and comes out. Images
//! come in as [`Pixels`](crate::Pixels) or [`View`](crate::View). Where a kernel writes to an iterator, that is
//! [`PixelsMut::interleaved`](crate::PixelsMut::interleaved) data, or the [`bands`](crate::Image::bands) of a planar image;
//! slices have an element for each pixel and channel, pixel by pixel.
//!
//! Kernels do not check what they are called with: `Params::check` asks for ranges, and the functions named `check` for numbers
//! beside them. All images of a call have one size, but where the module says otherwise; where one is smaller, a kernel
//! panics or leaves pixels as they were. [Pipelines](crate::pipelines) check all of this themselves.

pub mod camera;
pub mod fetch;
pub mod judge;
pub mod merge;
pub mod smooth;
