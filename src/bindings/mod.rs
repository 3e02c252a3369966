//! numpy in, numpy out: one file per kernel folder and one for the pipelines. Every check of an argument is here or in
//! a kernel's `Params::check`, once; kernels run without the interpreter's lock.

pub mod arrays;
pub mod camera;
pub mod fetch;
pub mod judge;
pub mod merge;
pub mod pipelines;
pub mod smooth;
