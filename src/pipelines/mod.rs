//! Whole denoisers: lists of kernels, with the state that goes from frame to frame.

pub mod svgf;
