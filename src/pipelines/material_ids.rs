//! Ids that stand in for those that a frame lacks: the materials that its albedo tells
//! ([`material`](crate::kernels::smooth::material)).
//!
//! They keep light that is divided by albedo from light that is not, whose numbers have another meaning, and what is seen
//! through glass or in mirrors from the light of surfaces.

use super::frame::Frame;
use super::history::Params;
use super::illumination;
use super::recall::Memory;
use crate::image::{Image, Interleaved};
use crate::kernels::fetch::validate::Surface;
use crate::kernels::smooth::demodulate::Texture;
use crate::kernels::smooth::material::Materials;
use crate::kernels::smooth::reflectance::Surfaces;

/// What the albedo of a frame tells of its surfaces.
pub struct MaterialIds {
    /// Where the albedo is a reflectance.
    surfaces: Option<Surfaces>,
    /// In place of ids, if the frame has none.
    materials: Option<Materials>,
}

impl MaterialIds {
    /// Classifies a frame's materials, and makes the ids of the frame before comparable with them.
    pub fn of(frame: &Frame, memory: Option<&mut Memory>) -> Self {
        let Some(albedo) = frame.albedo else {
            return Self {
                surfaces: None,
                materials: None,
            };
        };
        let has_ids = frame.surface.ids.is_some();
        let surfaces = Surfaces::of(albedo, &frame.surface);
        let materials =
            (!has_ids).then(|| Materials::of(albedo, surfaces.as_ref(), &frame.surface));
        if let Some(memory) = memory {
            memory.forget_ids_unless(has_ids);
            if materials.as_ref().is_some_and(|of| !of.white_counts()) {
                memory.merge_white();
            }
            memory.reject_changed(surfaces.as_ref());
        }
        Self {
            surfaces,
            materials,
        }
    }

    /// The frame, with its materials as ids if it has none.
    pub fn frame<'a>(&'a self, frame: &Frame<'a>) -> Frame<'a> {
        with_ids(frame, self.materials.as_ref().map(Materials::counted))
    }

    pub fn texture<'a>(&'a self, frame: &Frame<'a>) -> Option<Texture<'a>> {
        illumination::texture(frame, self.surfaces.as_ref())
    }

    /// Leaves ids out of a list of the buffers that take part, if they are not the renderer's.
    pub fn omit_stand_ins(&self, used: &mut Vec<&'static str>) {
        used.retain(|&name| name != "ids" || self.materials.is_none());
    }

    /// What the frame leaves to the next; see [`Memory::new`].
    pub fn remember(
        self,
        frame: &Frame,
        history: Interleaved,
        params: &Params,
        first: bool,
    ) -> Memory {
        let all = self.materials.as_ref().map(|materials| &materials.all);
        Memory::new(&with_ids(frame, all), self.surfaces, history, params, first)
    }
}

fn with_ids<'a>(frame: &Frame<'a>, ids: Option<&'a Image<u32>>) -> Frame<'a> {
    let surface = Surface {
        ids: ids.map(Image::pixels).or(frame.surface.ids),
        ..frame.surface
    };
    Frame { surface, ..*frame }
}
