//! Kinds of material, as ids that stand in for those that a frame lacks.
//!
//! - 1: the albedo is no reflectance ([`reflectance`](super::reflectance)), so that light is not divided by it;
//! - 3: white, at least 0.99 in every channel. Nothing that scatters light reflects so much: it is how renderers mark glass
//!   and mirrors, and what is seen there has nothing to do with the light of the surfaces beside them;
//! - 2: all others. 0 would be background.
//!
//! Textures have white as well, up to single pixels of it, and one surface must not fall apart. So white counts as a kind only
//! in frames in which it ends where surfaces end. Where it does not, neighbours that normals and depths do not tell apart
//! ([`regions`](super::regions)) are of kinds 2 and 3. Of such pairs there may be an eighth as many as there are pixels of the
//! rarer of the two kinds. At 128×96 pixels, their share is 0.11 at most in 25 of 26 sequences (0.29 in frames of `fast_dolly`
//! with a few white pixels), and 0.58 or more where the bright half of their textures is made white.
//!
//! Inputs: albedo (3); normal (3), depth (1), each optional. Output: the kind (1).

use std::ops::Range;

use super::reflectance::Surfaces;
use super::regions::{beside, faces_alike};
use crate::image::{BandMut, Image, Pixels, SEGMENT, Size, View, segments};
use crate::kernels::fetch::validate::Surface;
use crate::pairs;
use crate::rows::{self, Kernel, Simd};

const NO_REFLECTANCE: u32 = 1;
const ORDINARY: u32 = 2;
const WHITE: u32 = 3;

/// Albedo of glass and mirrors. 0.98 is paint, of titanium white.
const CLEAR: f32 = 0.99;
/// White counts as texture if it splits more than one pair of neighbours for so many pixels of the rarer kind.
const RARE: usize = 8;

/// The materials of a frame.
pub struct Materials {
    /// With white as a kind, whether it counts or not.
    pub all: Image<u32>,
    /// Without it, if it does not.
    merged: Option<Image<u32>>,
}

impl Materials {
    /// Classifies the materials of a frame without ids by its albedo.
    pub fn of(albedo: Pixels, surfaces: Option<&Surfaces>, guide: &Surface) -> Self {
        let (size, mask) = (albedo.size, surfaces.map(Surfaces::mask));
        let mut all = Image::blank(size, 1);
        rows::run(&Tell { albedo, mask }, size.height, all.bands());
        let merged = is_texture(all.plane(0), size, guide).then(|| {
            let mut merged = all.clone();
            merge_white(merged.data_mut());
            merged
        });
        Self { all, merged }
    }

    /// Whether white counts.
    pub fn white_counts(&self) -> bool {
        self.merged.is_none()
    }

    /// The kinds that count.
    pub fn counted(&self) -> &Image<u32> {
        self.merged.as_ref().unwrap_or(&self.all)
    }
}

/// Counts white as ordinary.
pub fn merge_white(kinds: &mut [u32]) {
    for kind in kinds {
        *kind = (*kind).min(ORDINARY);
    }
}

/// Whether white is part of a texture.
fn is_texture(kinds: &[u32], size: Size, guide: &Surface) -> bool {
    let [white, ordinary] =
        [WHITE, ORDINARY].map(|kind| kinds.iter().filter(|&&own| own == kind).count());
    let splits = |a: usize, b: usize| {
        kinds[a] ^ kinds[b] == WHITE ^ ORDINARY
            && guide.normal.is_none_or(|normal| faces_alike(normal, a, b))
            && guide.depth.is_none_or(|depth| beside(depth, a, b))
    };
    white > 0 && RARE * pairs::count(size, splits) > white.min(ordinary)
}

/// Tells the kinds.
struct Tell<'a> {
    albedo: Pixels<'a>,
    /// 0 where the albedo is no reflectance.
    mask: Option<View<'a, u8>>,
}

impl<'a> Kernel for Tell<'a> {
    type Out = BandMut<'a, u32>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut kinds: Self::Out) {
        let mut albedo = [[0.0; SEGMENT]; 3];
        for y in rows {
            let kinds = kinds.row(0, y);
            for run in segments(y, self.albedo.size.width) {
                self.albedo.read_rows(run, &mut albedo);
                for (x, kind) in kinds[run.x..][..run.len].iter_mut().enumerate() {
                    let [r, g, b] = albedo.each_ref().map(|row| row[x] >= CLEAR);
                    *kind = if r & g & b { WHITE } else { ORDINARY };
                }
            }
            if let Some(mask) = self.mask {
                for (kind, &reflects) in kinds.iter_mut().zip(mask.row(0, y)) {
                    *kind = if reflects == 0 { NO_REFLECTANCE } else { *kind };
                }
            }
        }
    }
}
