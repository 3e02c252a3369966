//! Recirculating reprojection: what was traced now, its holes filled, and what was known before, blended by quality.
//!
//! Of both images each pixel takes the mean at three places along its motion v,
//!   c = ⅓ Σ image(p + k b v),  k = −1, 0, 1,
//! which blurs it as a shutter does that is open for 2 b of a frame's time; read bilinearly from the pixels that are
//! known. The quality of what was known falls with the length of the motion, to a half over h pixels, and both are
//! blended by the new one's share of quality, held to a range:
//!   q' = q_r / (1 + |v|/h),  s = clamp(q_f / (q_f + q'), s₀, s₁),  c = c_r + s (c_f − c_r).
//! Carried on is q = min(q_f + q', limit): the more is known of a pixel, the less a new sample changes it.
//!
//! The old image is already where it appears now, or it is that of the previous frame and is fetched: read at p + v
//! instead of p, and its quality with it, of which pixels that are not known have none.
//!
//! After "Reprojection 2", a developer's diary of 2008, which gives the three offsets (b = ¼), the shares and their
//! range, fetches the old image, and says that quality falls; how it falls and adds up is our choice.
//!
//! Inputs: colour (3) and quality (1) of both images, 0 where there is none; motion (2 or 3). Outputs: colour (3) and
//! quality (1); NaN and 0 where neither image has any.

use std::ops::Range;

use crate::error::{Error, Result, in_range};
use crate::image::{Pixels, Records, Run, SEGMENT, Size, segments};
use crate::math::is_present;
use crate::pixels::{PixelsMut, Row};
use crate::rows::{self, Kernel};

/// Blur, and how quality weighs.
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// How far the outer places are along the motion, b; 0 to 1; ¼.
    pub blur: f32,
    /// Least and greatest share of the new image where both are known; 0 to 1; (0, 1).
    pub share: [f32; 2],
    /// Motion in pixels over which quality falls to a half; above 0; infinite, over which it does not.
    pub fade: f32,
    /// Highest quality that is carried on, above 0; 8.
    pub limit: f32,
    /// Whether the old image is that of the previous frame, read at p + v; false.
    pub fetch: bool,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            blur: 0.25,
            share: [0.0, 1.0],
            fade: 64.0,
            limit: 8.0,
            fetch: false,
        }
    }
}

impl Params {
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

/// Motion that is as long is not known.
pub(crate) const FARTHEST: f32 = 1e6;

/// Colour, and its quality.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// 3 channels.
    pub color: Pixels<'a>,
    /// 0 where there is none.
    pub quality: Pixels<'a>,
}

impl Known<'_> {
    /// Reads a run, with quality 0 where there is nothing.
    #[inline(always)]
    fn read(&self, run: Run, color: &mut [Row; 3], quality: &mut Row) {
        let n = run.len;
        self.color
            .read(run, color.each_mut().map(Row::as_mut_slice));
        self.quality.load(run, 0, &mut quality[..n]);
        let [r, g, b] = color.each_ref().map(|row| &row[..n]);
        for (i, quality) in quality[..n].iter_mut().enumerate() {
            let known = is_present([r[i], g[i], b[i]]) & (*quality > 0.0) & quality.is_finite();
            *quality = if known { *quality } else { 0.0 };
        }
    }

    /// To be read between pixels: colours, and 1 as fourth number and quality as fifth, or zeros where there is nothing.
    fn to_places<const N: usize>(self) -> Records {
        let size = self.color.size;
        let mut places = Records::blank(size, N);
        let outs = PixelsMut::bands(size, N, places.data_mut());
        rows::run(&ToPlaces::<N>(self), size.height, outs);
        places
    }
}

struct ToPlaces<'a, const N: usize>(Known<'a>);

impl<'a, const N: usize> Kernel for ToPlaces<'a, N> {
    type Out = PixelsMut<'a>;

    #[inline(always)]
    fn rows(&self, rows: Range<usize>, mut out: PixelsMut<'a>) {
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

/// Adds the weighted sum of the four pixels around a place, in pixel centres.
#[inline(always)]
fn add<const N: usize>(places: &[[f32; N]], size: Size, [x, y]: [f32; 2], sum: &mut [f32; N]) {
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
        let (above, below) = (&places[first..][..2], &places[first + width..][..2]);
        for c in 0..N {
            sum[c] += weights[0] * above[0][c] + weights[1] * above[1][c];
            sum[c] += weights[2] * below[0][c] + weights[3] * below[1][c];
        }
        return;
    }
    for (i, weight) in weights.into_iter().enumerate() {
        let (x, y) = (left + (i % 2) as i32, top + (i / 2) as i32);
        if (0..width as i32).contains(&x) && (0..height as i32).contains(&y) {
            let place = &places[y as usize * width + x as usize];
            for (sum, value) in sum.iter_mut().zip(place) {
                *sum += weight * value;
            }
        }
    }
}

/// Writes records of colour, and quality.
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
        places: [
            blurs.then(|| filled.to_places::<4>()),
            (blurs && !params.fetch).then(|| reprojected.to_places::<4>()),
        ],
        previous: params.fetch.then(|| reprojected.to_places::<5>()),
        motion,
        params,
    };
    rows::run(&kernel, motion.size.height, color.zip(quality));
}

struct Recirculate<'a> {
    /// The new and the old.
    images: [Known<'a>; 2],
    /// To be blurred in place.
    places: [Option<Records>; 2],
    /// The old image, to be fetched.
    previous: Option<Records>,
    motion: Pixels<'a>,
    params: Params,
}

impl Recirculate<'_> {
    /// Replaces the known colours of a run by the means at their three places.
    #[inline(always)]
    fn blur(
        &self,
        places: &Records,
        run: Run,
        motion: &[Row; 2],
        quality: &Row,
        color: &mut [Row; 3],
    ) {
        let size = self.motion.size;
        let places = places.pixels().numbers().0.as_chunks::<4>().0;
        let blur = self.params.blur;
        for i in 0..run.len {
            let (x, y) = ((run.x + i) as f32, run.y as f32);
            let (dx, dy) = (blur * motion[0][i], blur * motion[1][i]);
            if quality[i] > 0.0 && (dx != 0.0 || dy != 0.0) {
                let mut sum = places[run.y * size.width + run.x + i];
                add(places, size, [x - dx, y - dy], &mut sum);
                add(places, size, [x + dx, y + dy], &mut sum);
                for (row, value) in color.iter_mut().zip(sum) {
                    row[i] = value / sum[3];
                }
            }
        }
    }
}

impl Recirculate<'_> {
    /// Replaces a run of the old image by what motion leads to, blurred.
    #[inline(always)]
    fn fetch(
        &self,
        previous: &Records,
        run: Run,
        motion: &[Row; 2],
        quality: &mut Row,
        color: &mut [Row; 3],
    ) {
        let size = self.motion.size;
        let places = previous.pixels().numbers().0.as_chunks::<5>().0;
        let blur = self.params.blur;
        for i in 0..run.len {
            let (mx, my) = (motion[0][i], motion[1][i]);
            if mx == 0.0 && my == 0.0 {
                continue;
            }
            let (x, y) = ((run.x + i) as f32 + mx, run.y as f32 + my);
            let mut sum = [0.0; 5];
            add(places, size, [x, y], &mut sum);
            quality[i] = sum[4];
            if blur > 0.0 {
                let (dx, dy) = (blur * mx, blur * my);
                add(places, size, [x - dx, y - dy], &mut sum);
                add(places, size, [x + dx, y + dy], &mut sum);
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
    fn rows(&self, rows: Range<usize>, (mut shown, mut carried): Self::Out) {
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
            self.motion
                .read(run, motion.each_mut().map(Row::as_mut_slice));
            let [mx, my] = motion.each_mut().map(|row| &mut row[..n]);
            for i in 0..n {
                // Motion that is not known, or leads nowhere, blurs nothing.
                let known = (mx[i].abs() < FARTHEST) & (my[i].abs() < FARTHEST);
                (mx[i], my[i]) = if known { (mx[i], my[i]) } else { (0.0, 0.0) };
            }
            for (side, image) in self.images.iter().enumerate() {
                image.read(run, &mut colors[side], &mut qualities[side]);
                if let Some(places) = &self.places[side] {
                    let (color, quality) = (&mut colors[side], &qualities[side]);
                    self.blur(places, run, &motion, quality, color);
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
                let share = fresh[i] / (fresh[i] + faded);
                let held = if share < low { low } else { share };
                let held = if held > high { high } else { held };
                for c in 0..3 {
                    let (new, old) = (new[c][i], &mut old[c][i]);
                    let blended = *old + held * (new - *old);
                    let alone = if fresh[i] > 0.0 { new } else { f32::NAN };
                    let or_old = if fresh[i] > 0.0 { blended } else { *old };
                    *old = if faded > 0.0 { or_old } else { alone };
                }
                let sum = fresh[i] + faded;
                known[i] = if sum > limit { limit } else { sum };
            }
            shown.write(run, old.each_ref().map(Row::as_slice));
            carried.write(run, [&*known]);
        }
    }
}
