//! Pipelines: lists of kernels, each with the state that goes from frame to frame.

pub mod bmfr;
pub mod correction;
pub mod frame;
pub mod half_res;
pub mod motion_check;
pub mod passes;
pub mod recirculation;
pub mod reflections;
pub mod replay;
pub mod svgf;
pub mod taa;
pub mod upscaler;
