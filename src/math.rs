//! Formulas that several kernels share. All are free of branches, so that the loops around them vectorise.

use pulp::Simd;

use crate::lanes::Lanes;

pub type Color = [f32; 3];

/// Rec. 709 weights of linear red, green and blue.
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

#[inline(always)]
pub fn luminance(r: f32, g: f32, b: f32) -> f32 {
    LUMINANCE[0] * r + LUMINANCE[1] * g + LUMINANCE[2] * b
}

/// [`luminance`] of one vector of pixels.
#[inline(always)]
pub fn luminances<S: Simd>(r: Lanes<S>, g: Lanes<S>, b: Lanes<S>) -> Lanes<S> {
    r * LUMINANCE[0] + g * LUMINANCE[1] + b * LUMINANCE[2]
}

/// True for a valid sample: a pixel with NaN or infinity in any channel is missing.
#[inline(always)]
pub fn is_present([r, g, b]: Color) -> bool {
    r.is_finite() & g.is_finite() & b.is_finite()
}

#[inline(always)]
pub fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The distance of two points of an image.
#[inline(always)]
pub fn distance([ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> f32 {
    let (x, y) = (ax - bx, ay - by);
    (x * x + y * y).sqrt()
}

#[inline(always)]
pub fn ycocg([r, g, b]: Color) -> Color {
    [
        0.25 * r + 0.5 * g + 0.25 * b,
        0.5 * r - 0.5 * b,
        -0.25 * r + 0.5 * g - 0.25 * b,
    ]
}

#[inline(always)]
pub fn from_ycocg([y, co, cg]: Color) -> Color {
    [y - cg + co, y + cg, y - cg - co]
}

/// The largest channel; 0 where all are negative.
#[inline(always)]
pub fn max_channel([r, g, b]: Color) -> f32 {
    larger(larger(larger(r, g), b), 0.0)
}

/// The reversible tone curve c / (e + max(r, g, b)), e the exposure (Lottes 2016, *Optimized Reversible Tonemapper for
/// Resolve*).
#[inline(always)]
pub fn tone_map(rgb: Color, exposure: f32) -> Color {
    let scale = 1.0 / (exposure + max_channel(rgb));
    rgb.map(|c| c * scale)
}

/// Inverse of [`tone_map`]. The result is scaled down where its largest channel would exceed `limit`: the inverse has a
/// pole at 1, and filtered colours may come close to it or lie beyond.
#[inline(always)]
pub fn inverse_tone_map(rgb: Color, exposure: f32, limit: f32) -> Color {
    let mapped = max_channel(rgb);
    let inverse = if mapped < 1.0 {
        exposure / (1.0 - mapped)
    } else {
        f32::INFINITY
    };
    // Subnormal numbers count, as the exposure of so dark an image is 1.
    let scale = smaller(inverse, limit / larger(mapped, f32::from_bits(1)));
    rgb.map(|c| c * scale)
}

/// The luminance that is added where luminances are compared by their ratio: far below it, differences count as absolute.
pub fn black_level(exposure: f32) -> f32 {
    (exposure / 16.0).max(f32::MIN_POSITIVE)
}

/// Whether a depth is that of background: infinite, or not above 0, as many renderers store where nothing was hit. NaN is
/// unknown.
#[inline(always)]
pub fn is_background(depth: f32) -> bool {
    (depth == f32::INFINITY) | (depth <= 0.0)
}

/// Whether a depth is that of a surface: neither background nor unknown.
#[inline(always)]
pub fn is_surface(depth: f32) -> bool {
    (depth > 0.0) & (depth < f32::INFINITY)
}

/// The minimum; `b` where either is NaN. One instruction on every CPU, unlike `f32::min`, which tests for NaN.
#[inline(always)]
pub fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The maximum; `b` where either is NaN.
#[inline(always)]
pub fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Clamped to [0, 1]. NaN becomes 0; `f32::clamp` would keep it.
#[allow(clippy::manual_clamp)]
#[inline(always)]
pub fn saturate(x: f32) -> f32 {
    x.max(0.0).min(1.0)
}

pub const LOG2_E: f32 = std::f32::consts::LOG2_E;

/// Weights below 2^-64 count as zero. Beside a centre weight of one they are invisible, but their products with dark
/// colours would be subnormal numbers, whose arithmetic is up to five times slower.
const SMALLEST_EXPONENT: f32 = -64.0;

/// 2^x for weights: x ≤ 0, zero below 2^-64 and for NaN. Relative error below 2e-7.
///
/// Adding 1.5·2^23 rounds x to an integer and leaves it in the low mantissa bits; a shift moves it into the exponent.
/// The fraction in [-½, ½] goes through the minimax polynomial (relative error) of degree five with value 1 at 0. The
/// result for an x below the cut-off is garbage and is masked to zero.
#[inline(always)]
pub fn exp2_weight<S: Simd>(x: Lanes<S>) -> Lanes<S> {
    let [weight] = exp2_weights([x]);
    weight
}

/// [`exp2_weight`] of N vectors at once. The steps are interleaved, because one evaluation is a single chain of
/// dependent instructions and would leave the CPU waiting.
#[inline(always)]
pub fn exp2_weights<S: Simd, const N: usize>(x: [Lanes<S>; N]) -> [Lanes<S>; N] {
    const ROUND: f32 = 12_582_912.0; // 1.5 · 2^23
    let (mut f, mut shifted) = (x, x);
    // Compared first: the masks take fewer registers than keeping x until the end.
    let mut counts = [x[0].above(SMALLEST_EXPONENT); N];
    for k in 0..N {
        counts[k] = x[k].above(SMALLEST_EXPONENT);
        shifted[k] = x[k] + ROUND;
        f[k] = x[k] - (shifted[k] + -ROUND);
    }
    let splat = |coefficient| Lanes::splat(x[0].simd, coefficient);
    let mut p = f;
    for k in 0..N {
        p[k] = f[k].mul_add(splat(1.326_472e-3), splat(9.671_513e-3));
    }
    for coefficient in [5.550_734e-2, 2.402_224_2e-1, 6.931_469_4e-1, 1.0] {
        for k in 0..N {
            p[k] = p[k].mul_add(f[k], splat(coefficient));
        }
    }
    for k in 0..N {
        let power = p[k].scale_by_low_bits(shifted[k]);
        p[k] = power.when_or(counts[k], 0.0);
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn of(x: f32) -> f32 {
        exp2_weight(Lanes::splat(pulp::Scalar128b, x)).first()
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

    proptest! {
        #[test]
        fn inverse_tone_map_keeps_its_limit(rgb: [f32; 3], exposure in 1e-30f32..1e30, limit in 1e-30f32..1e30) {
            prop_assume!(rgb.iter().all(|c| c.abs() < 1e6));
            let back = inverse_tone_map(rgb, exposure, limit);
            prop_assert!(back.iter().all(|c| c.is_finite()), "{back:?}");
            prop_assert!(max_channel(back) <= limit * (1.0 + 1e-6), "{back:?}");
        }
    }

    #[test]
    fn tone_maps_have_inverses_for_the_darkest_colors() {
        for dark in [0.0, 1e-42, 1e-40, 1e-38, 1e-20] {
            let color = [dark, 0.5 * dark, 0.0];
            assert_eq!(inverse_tone_map(tone_map(color, 1.0), 1.0, dark), color);
        }
    }

    #[test]
    fn luminance_of_grey_is_grey() {
        assert!((luminance(0.5, 0.5, 0.5) - 0.5).abs() < 1e-7);
    }
}
