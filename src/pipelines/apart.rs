//! Ids that stand in for those that a frame lacks: the kinds of material that its albedo tells
//! ([`material`](crate::kernels::smooth::material)).
//!
//! They keep light that is divided by albedo from light that is not, whose numbers have another meaning, and what is seen
//! through glass or in mirrors from the light of surfaces.

use super::frame::Frame;
use super::recall::Memory;
use crate::image::Image;
use crate::kernels::fetch::validate::Surface;
use crate::kernels::smooth::material::Materials;
use crate::kernels::smooth::reflectance::Surfaces;

/// The materials of a frame without ids. The frame before forgets ids of another kind.
pub fn stand_in(
    frame: &Frame,
    surfaces: Option<&Surfaces>,
    mut memory: Option<&mut Memory>,
) -> Option<Materials> {
    let albedo = frame.albedo?;
    let own = frame.surface.ids.is_some();
    if let Some(memory) = &mut memory {
        memory.forget_ids_unless(own);
    }
    let materials = (!own).then(|| Materials::of(albedo, surfaces, &frame.surface))?;
    if let Some(memory) = memory.filter(|_| !materials.white_counts()) {
        memory.merge_white();
    }
    Some(materials)
}

/// A frame whose surfaces are told apart by what stands in for its ids, if anything does.
pub fn told_apart<'a>(frame: &Frame<'a>, ids: Option<&'a Image<u32>>) -> Frame<'a> {
    let surface = Surface {
        ids: ids.map(Image::pixels).or(frame.surface.ids),
        ..frame.surface
    };
    Frame { surface, ..*frame }
}
