//! Formulas that several kernels share. All are branch-free, so that loops over rows vectorise.

use pulp::Simd;

use crate::lanes::Lanes;

/// Rec. 709 weights of linear red, green and blue.
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

#[inline(always)]
pub fn luminance(r: f32, g: f32, b: f32) -> f32 {
    LUMINANCE[0] * r + LUMINANCE[1] * g + LUMINANCE[2] * b
}

/// The same of neighbouring pixels.
#[inline(always)]
pub fn luminances<S: Simd>(r: Lanes<S>, g: Lanes<S>, b: Lanes<S>) -> Lanes<S> {
    r * LUMINANCE[0] + g * LUMINANCE[1] + b * LUMINANCE[2]
}

/// Whether a sample is there: a pixel with NaN or infinity in a channel is missing. Without branches, for rows.
#[inline(always)]
pub fn is_present([r, g, b]: [f32; 3]) -> bool {
    r.is_finite() & g.is_finite() & b.is_finite()
}

/// Held to [0, 1]; NaN becomes 0, which `clamp` would keep.
#[allow(clippy::manual_clamp)]
#[inline(always)]
pub fn saturate(x: f32) -> f32 {
    x.max(0.0).min(1.0)
}

pub const LOG2_E: f32 = std::f32::consts::LOG2_E;

/// Weights below 2^-64 count as zero: they cannot be seen beside a centre weight of one, and their products
/// with dark colours would be subnormal numbers, which cost up to five times as much.
const SMALLEST_EXPONENT: f32 = -64.0;

/// 2^x for weights: x ≤ 0, zero below 2^-64 and for NaN. Relative error below 2e-7.
///
/// The integer part of x is found by adding 1.5·2^23, which leaves it in the low mantissa bits, from where a shift
/// moves it into the exponent; the fraction in [-½, ½] goes through the polynomial of degree five whose largest relative
/// error is smallest, among those that are 1 at 0. What this makes of an x that is too small is not used.
#[inline(always)]
pub fn exp2_weight<S: Simd>(x: Lanes<S>) -> Lanes<S> {
    let [weight] = exp2_weights([x]);
    weight
}

/// The same of several at once, each operation of all before the next: one alone is a long chain.
#[inline(always)]
pub fn exp2_weights<S: Simd, const N: usize>(x: [Lanes<S>; N]) -> [Lanes<S>; N] {
    const ROUND: f32 = 12_582_912.0; // 1.5 · 2^23
    let (mut f, mut shifted) = (x, x);
    // Asked first, as the answers take less room than the numbers.
    let mut counts = [x[0].above(SMALLEST_EXPONENT); N];
    for k in 0..N {
        counts[k] = x[k].above(SMALLEST_EXPONENT);
        shifted[k] = x[k] + ROUND;
        f[k] = x[k] - (shifted[k] + -ROUND);
    }
    let mut p = f;
    for k in 0..N {
        p[k] = f[k] * 1.326_472e-3 + 9.671_513e-3;
    }
    for coefficient in [5.550_734e-2, 2.402_224_2e-1, 6.931_469_4e-1, 1.0] {
        for k in 0..N {
            p[k] = p[k] * f[k] + coefficient;
        }
    }
    for k in 0..N {
        let power = p[k].scale_by_low_bits(shifted[k]);
        p[k] = power.or_all(counts[k], 0.0);
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn of(x: f32) -> f32 {
        exp2_weight(Lanes::all(pulp::Scalar128b, x)).first()
    }

    proptest! {
        #[test]
        fn exp2_weight_is_exp2(x in -63.99f32..=0.0) {
            let exact = f64::from(x).exp2();
            prop_assert!((f64::from(of(x)) / exact - 1.0).abs() < 2e-7);
        }
    }

    #[test]
    fn exp2_weight_at_its_ends() {
        assert_eq!(of(0.0), 1.0);
        for x in [-64.0, -65.0, -1e30, f32::NEG_INFINITY, f32::NAN] {
            assert_eq!(of(x), 0.0, "{x}");
        }
    }

    #[test]
    fn luminance_of_grey_is_grey() {
        assert!((luminance(0.5, 0.5, 0.5) - 0.5).abs() < 1e-7);
    }
}
