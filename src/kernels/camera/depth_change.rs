//! Change of depth: by how much most surfaces were farther away in the previous frame, where neither motion nor cameras tell.
//!
//! A camera that moves along its view by d, without turning, changes the depth of all that rests by d. With Z the depth of a
//! pixel, Z′ that of the pixel of the previous frame nearest to where its motion leads, and r(d) the number of pixels of which
//! |Z′ − Z − d| > (Z + d) / 10, those whose history the test of depth rejects
//! ([`validate`](crate::kernels::fetch::validate)), the change is
//!   m = median (Z′ − Z)  where  2 r(m) < r(0)  and  |m| < median Z / 4,
//! and 0 elsewhere: rejected history may be that of another surface. Behind a cut, another m may let some history pass; the
//! second bound keeps a cut from one wall to another from being taken for a camera that moves. Every eighth pixel of every
//! eighth row is looked at, of which 16 must be known: with both depths finite. Medians of an even number of values are the
//! higher one in the middle.
//!
//! Inputs: depth (1), previous depth (1), motion (2). Output: a number.

use crate::image::{Pixels, Size};
use crate::math::is_surface;

/// From one pixel that is looked at to the next, along x and y.
const STEP: usize = 8;
/// Fewer known pixels tell nothing.
const FEWEST: usize = 16;
/// Relative difference beyond which the test of depth rejects history.
const REJECTED: f32 = 0.1;
/// Changes from this share of the median depth on are none.
const MOST: f32 = 0.25;

/// By how much the previous depth of most surfaces exceeds that of this frame; 0 if it tells no common change.
pub fn depth_change(depth: Pixels, previous: Pixels, motion: Pixels) -> f32 {
    let mut known = pairs(depth, previous, motion);
    if known.len() < FEWEST {
        return 0.0;
    }
    let change = median(&mut known, |[now, before]| before - now);
    let near = change.abs() < MOST * median(&mut known, |[now, _]| now);
    let rejected = |change: f32| {
        let beyond =
            |&&[now, before]: &&[f32; 2]| (before - now - change).abs() > REJECTED * (now + change);
        known.iter().filter(beyond).count()
    };
    let explains = near && 2 * rejected(change) < rejected(0.0);
    if explains { change } else { 0.0 }
}

/// The depths, now and before, of the pixels that are looked at.
fn pairs(depth: Pixels, previous: Pixels, motion: Pixels) -> Vec<[f32; 2]> {
    let Size { height, width } = depth.size;
    let inside = |place: f32, end: usize| (0.0..end as f32).contains(&place);
    let looked_at = |end: usize| (0..end).skip(STEP / 2).step_by(STEP);
    (looked_at(height).flat_map(|y| looked_at(width).map(move |x| [x, y])))
        .filter_map(|[x, y]| {
            let pixel = y * width + x;
            let from = [x, y].map(|at| at as f32);
            let [column, row] =
                [0, 1].map(|axis| (from[axis] + motion.at(pixel, axis) + 0.5).floor());
            let there = inside(column, width) && inside(row, height);
            let before = there.then(|| previous.at(row as usize * width + column as usize, 0))?;
            let now = depth.at(pixel, 0);
            (is_surface(now) && is_surface(before)).then_some([now, before])
        })
        .collect()
}

/// The median of a number of each pair.
fn median(pairs: &mut [[f32; 2]], of: impl Fn([f32; 2]) -> f32) -> f32 {
    let middle = pairs.len() / 2;
    let order = |a: &[f32; 2], b: &[f32; 2]| of(*a).total_cmp(&of(*b));
    of(*pairs.select_nth_unstable_by(middle, order).1)
}
