//! Pairs of neighbouring pixels, in rows and in columns.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::image::Size;
use crate::rows::{self, Kernel, Simd};

/// How many pairs, by index, have a property.
pub fn count(size: Size, property: impl Fn(usize, usize) -> bool + Sync) -> usize {
    let found = AtomicUsize::new(0);
    let pairs = Pairs {
        width: size.width,
        property,
        found: &found,
    };
    rows::run(&pairs, size.height, rows::bands(size.height).map(|_| ()));
    found.into_inner()
}

struct Pairs<'a, F> {
    width: usize,
    property: F,
    found: &'a AtomicUsize,
}

impl<F: Fn(usize, usize) -> bool + Sync> Kernel for Pairs<'_, F> {
    type Out = ();

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (): ()) {
        let width = self.width;
        let mut found = 0;
        for y in rows {
            for pixel in y * width..(y + 1) * width {
                let beside = pixel > y * width && (self.property)(pixel - 1, pixel);
                let above = y > 0 && (self.property)(pixel - width, pixel);
                found += usize::from(beside) + usize::from(above);
            }
        }
        self.found.fetch_add(found, Ordering::Relaxed);
    }
}
