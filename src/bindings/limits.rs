//! What this machine can do at most, by measurement: the yardstick of `yester bench`, which alone asks for it.

use std::hint::black_box;
use std::marker::PhantomData;
use std::ops::Range;
use std::time::Instant;

use crate::image::{BandMut, Image, Size, View};
use crate::rows::{self, BAND, Kernel, Settings, Simd};

/// 134 MB.
const COPIED: Size = Size {
    height: 4096,
    width: 8192,
};
const ROUNDS: usize = 8;
const STEPS: usize = 1 << 14;
const BANDS: usize = 64;

/// Bytes per second, read and written, of a copy; and multiply-adds per second, or multiplications and additions where no
/// instruction does both; with all threads and the instructions in use. The best of a few rounds.
pub fn limits() -> (f64, f64) {
    let from = Image::new(COPIED, 1);
    let mut to = Image::new(COPIED, 1);
    let seconds = best(|| rows::run(&Copy { from: from.view() }, COPIED.height, to.bands()));
    let copied = 2.0 * (COPIED.pixels() * size_of::<f32>()) as f64 / seconds;

    // The baseline has no such instruction, and kernels that want one emulate it.
    let fused = Settings::get().level_name() != "baseline";
    let multiplied = multiply_adds::<8>(fused)
        .max(multiply_adds::<12>(fused))
        .max(multiply_adds::<20>(fused));
    (copied, multiplied)
}

/// Per second, in so many independent chains: enough to hide an operation's latency, not more than registers hold.
fn multiply_adds<const CHAINS: usize>(fused: bool) -> f64 {
    let kernel = MultiplyAdd::<CHAINS> {
        factor: 0.5,
        fused,
        lanes: PhantomData,
    };
    let mut lanes = [0; BANDS];
    let seconds = best(|| rows::run(&kernel, BANDS * BAND, lanes.iter_mut()));
    let operations = if fused { 1 } else { 2 };
    (lanes.iter().sum::<usize>() * STEPS * CHAINS * operations) as f64 / seconds
}

fn best(mut work: impl FnMut()) -> f64 {
    let mut time = || {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    };
    (0..ROUNDS).map(|_| time()).fold(f64::INFINITY, f64::min)
}

struct Copy<'a> {
    from: View<'a>,
}

impl<'a> Kernel for Copy<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut to: BandMut<'a>) {
        for y in rows {
            to.row(0, y).copy_from_slice(self.from.row(0, y));
        }
    }
}

struct MultiplyAdd<'a, const CHAINS: usize> {
    factor: f32,
    /// Whether the level has an instruction for it.
    fused: bool,
    lanes: PhantomData<&'a usize>,
}

impl<'a, const CHAINS: usize> Kernel for MultiplyAdd<'a, CHAINS> {
    /// How many lanes the chains have.
    type Out = &'a mut usize;

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, _: Range<usize>, lanes: &'a mut usize) {
        let factor = simd.splat_f32s(self.factor);
        let mut chains = [simd.splat_f32s(1.0); CHAINS];
        for _ in 0..STEPS {
            for chain in &mut chains {
                *chain = if self.fused {
                    simd.mul_add_e_f32s(*chain, factor, factor)
                } else {
                    simd.add_f32s(simd.mul_f32s(*chain, factor), factor)
                };
            }
        }
        let sum = (chains.into_iter()).fold(factor, |a, b| simd.add_f32s(a, b));
        black_box(sum);
        *lanes = S::F32_LANES;
    }
}
