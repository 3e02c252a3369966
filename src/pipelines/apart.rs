//! Ids that stand in for those that a frame lacks, so that light that is divided by albedo is not mixed with light that is not.
//!
//! They say where the albedo is a reflectance ([`as_ids`]). Where that is the same for all pixels of a frame and of the one
//! before, there is nothing to tell apart.

use super::frame::Frame;
use super::recall::Memory;
use crate::image::Image;
use crate::kernels::fetch::validate::Surface;
use crate::kernels::smooth::reflectance::{Surfaces, Told, as_ids};

/// The ids, if any are needed. The frame before gets its own if it lacks them.
pub fn stand_in(
    frame: &Frame,
    now: Option<&Surfaces>,
    memory: Option<&mut Memory>,
) -> Option<Image<u32>> {
    if frame.surface.ids.is_some() || frame.albedo.is_none() {
        return None;
    }
    let told = |surfaces: Option<&Surfaces>| surfaces.map(|surfaces| surfaces.told);
    let mixed = told(now) == Some(Told::ByRegions);
    match memory {
        Some(memory) => {
            let before = told(memory.surfaces());
            if before == Some(Told::ByIds) || before == told(now) && !mixed {
                return None;
            }
            memory.tell_apart();
        }
        None if !mixed => return None,
        None => {}
    }
    Some(as_ids(now, frame.color.size))
}

/// A frame whose surfaces are told apart by these ids, if there are any.
pub fn told_apart<'a>(frame: &Frame<'a>, ids: Option<&'a Image<u32>>) -> Frame<'a> {
    let surface = Surface {
        ids: ids.map(Image::pixels).or(frame.surface.ids),
        ..frame.surface
    };
    Frame { surface, ..*frame }
}
