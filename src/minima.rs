//! An image of minima that all threads lower at once: their order does not matter.

use std::sync::atomic::{AtomicU32, Ordering};

/// The least of the values that pixels have been given, from 0 up; infinity where there was none.
pub struct Minima(Vec<AtomicU32>);

impl Minima {
    pub fn new(pixels: usize) -> Self {
        let none = f32::INFINITY.to_bits();
        Self((0..pixels).map(|_| AtomicU32::new(none)).collect())
    }

    /// Lowers a pixel to a value from 0 up: only their bit patterns sort as the numbers do.
    #[inline(always)]
    pub fn lower(&self, pixel: usize, value: f32) {
        let (least, bits) = (&self.0[pixel], value.to_bits());
        // A plain load first: the atomic minimum is slow, and most pixels have a lower value already.
        if bits < least.load(Ordering::Relaxed) {
            least.fetch_min(bits, Ordering::Relaxed);
        }
    }

    #[inline(always)]
    pub fn get(&self, pixel: usize) -> f32 {
        f32::from_bits(self.0[pixel].load(Ordering::Relaxed))
    }
}
