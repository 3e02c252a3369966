//! Recirculating reprojection: blends the new, hole-filled image with history, weighted by quality.
//!
//! Each pixel takes from both images the mean of three taps along its motion v,
//!   c = ⅓ Σ image(p + k b v),  k = −1, 0, 1,
//! a motion blur like that of a shutter open for 2 b of a frame; taps are bilinear over valid pixels. The quality of
//! history falls with the length of the motion, to a half over h pixels, and the blend factor s is the new image's
//! fraction of the total quality, clamped to a range:
//!   q' = q_r / (1 + |v|/h),  s = clamp(q_f / (q_f + q'), s₀, s₁),  c = c_r + s (c_f − c_r).
//! The quality passed on is q = min(q_f + q', limit): the higher it is, the less a new sample changes the pixel.
//!
//! History is either already reprojected, or it is the previous frame's output and fetched here: colour and quality are
//! read at p + v instead of p, with quality 0 for missing pixels.
//!
//! After Lottes 2008, *Reprojection 2*, which gives the three offsets (b = ¼), the blend factor and its
//! range, fetches the old image, and says that quality falls; how it falls and adds up is our choice.
//!
//! Inputs: colour (3) and quality (1) of both images, quality 0 where missing; motion (2 or 3). Outputs: colour (3) and
//! quality (1); NaN and 0 where both images are missing.

use std::ops::Range;

use crate::error::{Error, Result, in_range};
use crate::image::{Interleaved, Pixels, Run, SEGMENT, Size, segments};
use crate::math::is_present;
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel, Simd};

/// Blur, and how quality weighs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// b: distance of the outer taps, as a fraction of the motion; 0 to 1; ¼.
    pub blur: f32,
    /// s₀ and s₁: range of the blend factor where both images are valid; 0 to 1; (0, 1).
    pub share: [f32; 2],
    /// h: motion in pixels over which quality falls to a half; above 0, with infinity for never; 64.
    pub fade: f32,
    /// Upper bound of the quality passed on; above 0; 8.
    pub limit: f32,
    /// True if history is the previous frame's output, to be read at p + v; false.
    pub fetch: bool,
}

impl Default for Params {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Params {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self {
        blur: 0.25,
        share: [0.0, 1.0],
        fade: 64.0,
        limit: 8.0,
        fetch: false,
    };

    /// An error if a parameter is out of range.
    pub fn check(&self) -> Result<()> {
        in_range("blur", self.blur, "0 to 1", |v| (0.0..=1.0).contains(&v))?;
        let [low, high] = self.share;
        if !(0.0 <= low && low <= high && high <= 1.0) {
            let got = format!("({low}, {high})");
            return Err(Error::value(
                "share",
                "two shares from 0 to 1, the lower first",
                got,
            ));
        }
        in_range("fade", self.fade, "pixels above 0", |v| v > 0.0)?;
        in_range("limit", self.limit, "a number above 0", |v| v > 0.0)
    }
}

/// Motion this long counts as unknown.
pub(crate) const FARTHEST: f32 = 1e6;

/// An image with its quality.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// 3 channels.
    pub color: Pixels<'a>,
    /// 0 where there is none.
    pub quality: Pixels<'a>,
}

impl Known<'_> {
    /// Reads a span; quality is 0 where colour or quality is invalid.
    #[inline(always)]
    fn read(&self, run: Run, color: &mut [Row; 3], quality: &mut Row) {
        let n = run.len;
        self.color.read_rows(run, color);
        self.quality.load(run, 0, &mut quality[..n]);
        let [r, g, b] = color.each_ref().map(|row| &row[..n]);
        for (i, quality) in quality[..n].iter_mut().enumerate() {
            let known = is_present([r[i], g[i], b[i]]) & (*quality > 0.0) & quality.is_finite();
            *quality = if known { *quality } else { 0.0 };
        }
    }

    /// Interleaved copy for bilinear taps: colour, validity (1) and, for N = 5, quality; all zeros where missing.
    fn interleaved<const N: usize>(self) -> Interleaved {
        let size = self.color.size;
        let mut texels = Interleaved::blank(size, N);
        rows::run(&Interleave::<N>(self), size.height, texels.pixels_mut());
        texels
    }
}

struct Interleave<'a, const N: usize>(Known<'a>);

impl<'a, const N: usize> Kernel for Interleave<'a, N> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut out: PixelsMut<'a>) {
        let (mut color, mut quality) = ([[0.0; SEGMENT]; 3], [0.0; SEGMENT]);
        let mut present = [0.0; SEGMENT];
        for run in rows.flat_map(|y| segments(y, self.0.color.size.width)) {
            self.0.read(run, &mut color, &mut quality);
            for i in 0..run.len {
                let known = quality[i] > 0.0;
                present[i] = if known { 1.0 } else { 0.0 };
                for row in &mut color {
                    row[i] = if known { row[i] } else { 0.0 };
                }
            }
            let [r, g, b] = color.each_ref().map(Row::as_slice);
            out.write(run, [r, g, b, &present, &quality].into_iter().take(N));
        }
    }
}

/// Adds a bilinear tap at (x, y), where integers are pixel centres.
#[inline(always)]
fn add<const N: usize>(texels: &[[f32; N]], size: Size, [x, y]: [f32; 2], sum: &mut [f32; N]) {
    let Size { height, width } = size;
    let (left, top) = (x.floor(), y.floor());
    let (right, down) = (x - left, y - top);
    let (left, top) = (left as i32, top as i32);
    let weights = [
        (1.0 - right) * (1.0 - down),
        right * (1.0 - down),
        (1.0 - right) * down,
        right * down,
    ];
    let inner = left >= 0 && top >= 0 && left + 1 < width as i32 && top + 1 < height as i32;
    if inner {
        let first = top as usize * width + left as usize;
        let (above, below) = (&texels[first..][..2], &texels[first + width..][..2]);
        for c in 0..N {
            sum[c] += weights[0] * above[0][c] + weights[1] * above[1][c];
            sum[c] += weights[2] * below[0][c] + weights[3] * below[1][c];
        }
        return;
    }
    for (i, weight) in weights.into_iter().enumerate() {
        let (x, y) = (left + (i % 2) as i32, top + (i / 2) as i32);
        if (0..width as i32).contains(&x) && (0..height as i32).contains(&y) {
            let texel = &texels[y as usize * width + x as usize];
            for (sum, value) in sum.iter_mut().zip(texel) {
                *sum += weight * value;
            }
        }
    }
}

/// Writes blended colour and quality.
pub fn recirculate<'a>(
    filled: Known<'a>,
    reprojected: Known<'a>,
    motion: Pixels<'a>,
    params: Params,
    color: impl Iterator<Item = PixelsMut<'a>>,
    quality: impl Iterator<Item = PixelsMut<'a>>,
) {
    let images = [filled, reprojected];
    let blurs = params.blur > 0.0;
    let kernel = Recirculate {
        images,
        blurred: [
            blurs.then(|| filled.interleaved::<4>()),
            (blurs && !params.fetch).then(|| reprojected.interleaved::<4>()),
        ],
        previous: params.fetch.then(|| reprojected.interleaved::<5>()),
        motion,
        params,
    };
    rows::run(&kernel, motion.size.height, color.zip(quality));
}

struct Recirculate<'a> {
    /// The new image and history.
    images: [Known<'a>; 2],
    /// Interleaved copies for motion blur at the pixel's own position.
    blurred: [Option<Interleaved>; 2],
    /// Interleaved copy of history if it is to be fetched.
    previous: Option<Interleaved>,
    motion: Pixels<'a>,
    params: Params,
}

impl Recirculate<'_> {
    /// Replaces the valid colours of a span by the mean of their three taps.
    #[inline(always)]
    fn blur(
        &self,
        texels: &Interleaved,
        run: Run,
        motion: &[Row; 2],
        quality: &Row,
        color: &mut [Row; 3],
    ) {
        let size = self.motion.size;
        let texels = texels.pixels().elements().0.as_chunks::<4>().0;
        let blur = self.params.blur;
        for i in 0..run.len {
            let (x, y) = ((run.x + i) as f32, run.y as f32);
            let (dx, dy) = (blur * motion[0][i], blur * motion[1][i]);
            if quality[i] > 0.0 && (dx != 0.0 || dy != 0.0) {
                let mut sum = texels[run.y * size.width + run.x + i];
                add(texels, size, [x - dx, y - dy], &mut sum);
                add(texels, size, [x + dx, y + dy], &mut sum);
                for (row, value) in color.iter_mut().zip(sum) {
                    row[i] = value / sum[3];
                }
            }
        }
    }

    /// Fetches and blurs a span of history at the end of its motion; without motion, the span is already in place.
    #[inline(always)]
    fn fetch(
        &self,
        previous: &Interleaved,
        run: Run,
        motion: &[Row; 2],
        quality: &mut Row,
        color: &mut [Row; 3],
    ) {
        let size = self.motion.size;
        let texels = previous.pixels().elements().0.as_chunks::<5>().0;
        let blur = self.params.blur;
        for i in 0..run.len {
            let (mx, my) = (motion[0][i], motion[1][i]);
            if mx == 0.0 && my == 0.0 {
                continue;
            }
            let (x, y) = ((run.x + i) as f32 + mx, run.y as f32 + my);
            let mut sum = [0.0; 5];
            add(texels, size, [x, y], &mut sum);
            quality[i] = sum[4];
            if blur > 0.0 {
                let (dx, dy) = (blur * mx, blur * my);
                add(texels, size, [x - dx, y - dy], &mut sum);
                add(texels, size, [x + dx, y + dy], &mut sum);
            }
            for (row, value) in color.iter_mut().zip(sum) {
                row[i] = value / sum[3];
            }
        }
    }
}

impl<'a> Kernel for Recirculate<'a> {
    type Out = (PixelsMut<'a>, PixelsMut<'a>);

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, (mut shown, mut carried): Self::Out) {
        let Params {
            share: [low, high],
            fade,
            limit,
            ..
        } = self.params;
        let mut colors = [[[0.0; SEGMENT]; 3]; 2];
        let mut qualities = [[0.0; SEGMENT]; 2];
        let mut motion = [[0.0; SEGMENT]; 2];
        for run in rows.flat_map(|y| segments(y, self.motion.size.width)) {
            let n = run.len;
            self.motion.read_rows(run, &mut motion);
            let [mx, my] = motion.each_mut().map(|row| &mut row[..n]);
            for i in 0..n {
                // Unknown or excessive motion counts as none: no blur, no fetch.
                let known = (mx[i].abs() < FARTHEST) & (my[i].abs() < FARTHEST);
                (mx[i], my[i]) = if known { (mx[i], my[i]) } else { (0.0, 0.0) };
            }
            for (side, image) in self.images.iter().enumerate() {
                image.read(run, &mut colors[side], &mut qualities[side]);
                if let Some(texels) = &self.blurred[side] {
                    let (color, quality) = (&mut colors[side], &qualities[side]);
                    self.blur(texels, run, &motion, quality, color);
                }
            }
            if let Some(previous) = &self.previous {
                self.fetch(previous, run, &motion, &mut qualities[1], &mut colors[1]);
            }
            let [new, old] = &mut colors;
            let [fresh, known] = qualities.each_mut().map(|row| &mut row[..n]);
            for i in 0..n {
                let length = (motion[0][i] * motion[0][i] + motion[1][i] * motion[1][i]).sqrt();
                let faded = known[i] / (1.0 + length / fade);
                let alpha = fresh[i] / (fresh[i] + faded);
                let alpha = if alpha < low { low } else { alpha };
                let alpha = if alpha > high { high } else { alpha };
                for c in 0..3 {
                    let (new, old) = (new[c][i], &mut old[c][i]);
                    let blended = *old + alpha * (new - *old);
                    let alone = if fresh[i] > 0.0 { new } else { f32::NAN };
                    let or_old = if fresh[i] > 0.0 { blended } else { *old };
                    *old = if faded > 0.0 { or_old } else { alone };
                }
                let sum = fresh[i] + faded;
                known[i] = if sum > limit { limit } else { sum };
            }
            shown.write(run, &*old);
            carried.write(run, [&*known]);
        }
    }
}
