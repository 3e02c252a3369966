//! Pipelines: lists of kernels, each with the state that goes from frame to frame.

pub mod bmfr;
mod correction;
pub mod frame;
mod illumination;
pub mod motion_check;
mod recall;
pub mod recirculation;
pub mod reflections;
pub mod replay;
pub mod svgf;
pub mod taa;
pub mod upscaler;
