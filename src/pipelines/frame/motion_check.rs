//! A check, at a sequence's second frame, that motion has the direction and units that this library expects.
//! It is the quick form of `yester.check`, which has more hypotheses, more buffers and standard errors.
//!
//! Mistakes are factors of motion: −1 where it points the other way, or up; half the image's sides where it comes in
//! normalised device coordinates, its sides where it comes as fractions of the image. On a sparse grid of pixels, the motion
//! as given is compared with the motion corrected for each mistake:
//!
//! - **cameras**: if both frames have one, and depth or position, the motion of a still scene is computed. A mistake is found
//!   if the median of |corrected − expected| / |corrected − motion| is below ⅒, over the pixels in which the correction is at
//!   least a quarter of a pixel: only vertical motion tells whether y points up. Were the motion right, it would be 1.
//! - **warp**: otherwise the first frame (its albedo and normals, or else its colour) is read along both motions. A pixel
//!   agrees if its values lie in the range of the four pixels around the place that it came from. A mistake is found if most
//!   pixels agree for the corrected motion, and far more change to agreement than away from it. Cuts, disocclusion and
//!   objects that move without motion vectors disagree for both.

use std::fmt::{self, Display};

use super::{Frame, still_motion};
use crate::image::{Interleaved, Pixels, Size};
use crate::kernels::camera::motion::Geometry;
use crate::kernels::camera::pinhole::Camera;

/// Most pixels of the grid along each side.
const GRID: usize = 96;
/// Least number of pixels that must show a mistake.
const VOTES: usize = 32;

/// A mistake in motion: the factors that correct it, and how to describe it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mistake {
    factors: [f64; 2],
    looks: [&'static str; 2],
    against: &'static str,
}

impl Mistake {
    /// No mistake first, then each, the likelier first: of equals the first is reported.
    fn all(size: Size, against: &'static str) -> impl Iterator<Item = Self> {
        let (width, height) = (size.width as f64, size.height as f64);
        let units = [
            (1.0, 1.0, "pixels"),
            (width / 2.0, height / 2.0, "normalised device coordinates"),
            (width, height, "shares of the image's sides"),
        ];
        let signs = [
            (1.0, 1.0, "the right direction"),
            (1.0, -1.0, "y up"),
            (
                -1.0,
                -1.0,
                "the direction from previous to current position",
            ),
            (
                -1.0,
                1.0,
                "the direction from previous to current position, y up",
            ),
        ];
        units.into_iter().flat_map(move |(x, y, unit)| {
            signs.map(|(right, down, direction)| Self {
                factors: [right * x, down * y],
                looks: [unit, direction],
                against,
            })
        })
    }

    /// Motion corrected for this mistake.
    fn undone(&self, motion: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|c| self.factors[c] * motion[c])
    }
}

impl Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let ([x, y], [unit, direction]) = (self.factors, self.looks);
        write!(
            f,
            "motion: expected previous minus current position in pixels, x right, y down; {} would agree better \
             with {unit} and {direction}: multiply x by {x} and y by {y} (`yester check` tells more)",
            self.against
        )
    }
}

/// How far the check has come in a sequence.
#[derive(Default)]
pub enum Check {
    #[default]
    Begin,
    Second {
        size: Size,
        camera: Option<Box<Camera>>,
        seen: Vec<Interleaved>,
    },
    Done,
}

impl Check {
    /// Takes the next frame of a sequence; at the second, returns the mistake if there is one.
    pub fn see(&mut self, frame: &Frame) -> Option<Mistake> {
        let camera = frame.camera.filter(|_| frame.geometry().is_some());
        match std::mem::replace(self, Self::Done) {
            Self::Begin => {
                // The check by cameras reads nothing of the first frame.
                let seen = buffers(frame).into_iter().filter(|_| camera.is_none());
                *self = Self::Second {
                    size: frame.color.size,
                    camera: frame.camera.map(Box::new),
                    seen: seen.map(Pixels::to_interleaved).collect(),
                };
                None
            }
            Self::Second {
                size,
                camera: previous,
                seen,
            } if size == frame.color.size => {
                let motion = frame.motion?;
                match camera.zip(previous) {
                    Some((camera, previous)) => by_cameras(frame, motion, &camera, &previous),
                    None => by_warp(motion, &seen, &buffers(frame)),
                }
            }
            _ => None,
        }
    }
}

/// Buffers that move with surfaces.
fn buffers<'a>(frame: &Frame<'a>) -> Vec<Pixels<'a>> {
    let surface = [frame.albedo, frame.surface.normal];
    let surface: Vec<_> = surface.into_iter().flatten().collect();
    match surface.is_empty() {
        true => vec![frame.color],
        false => surface,
    }
}

/// The grid's pixels with finite motion: place, index and motion.
fn moved(motion: Pixels) -> impl Iterator<Item = ([usize; 2], usize, [f64; 2])> {
    let Size { height, width } = motion.size;
    let rows = (0..height).step_by(height.div_ceil(GRID));
    let pixels = rows.flat_map(move |y| {
        (0..width)
            .step_by(width.div_ceil(GRID))
            .map(move |x| ([x, y], y * width + x))
    });
    pixels.filter_map(move |(place, pixel)| {
        let motion = [0, 1].map(|channel| f64::from(motion.at(pixel, channel)));
        let known = motion.iter().all(|v| v.is_finite());
        known.then_some((place, pixel, motion))
    })
}

fn by_cameras(
    frame: &Frame,
    motion: Pixels,
    camera: &Camera,
    previous: &Camera,
) -> Option<Mistake> {
    // Where nothing was hit, some renderers write a position at the origin, a depth of 0, or a depth of 1e10. Only the last
    // gives the right motion.
    let depth = frame.surface.depth;
    let geometry = depth.map(Geometry::Depth).or(frame.geometry());
    let expected = still_motion(frame.color.size, geometry?, camera, previous);
    let expected = expected.pixels();
    let placed = |pixel| depth.is_none_or(|depth| depth.at(pixel, 0) > 0.0);
    let pairs: Vec<_> = moved(motion)
        .filter(|&(_, pixel, _)| placed(pixel))
        .map(|(_, pixel, motion)| (motion, [0, 1].map(|c| f64::from(expected.at(pixel, c)))))
        .filter(|(_, [x, y])| x.hypot(*y) > 0.25)
        .collect();
    let error = |mistake: &Mistake| {
        let errors = pairs.iter().filter_map(|&(motion, [x, y])| {
            let [u, v] = mistake.undone(motion);
            let change = (u - motion[0]).hypot(v - motion[1]);
            (change >= 0.25).then_some((u - x).hypot(v - y) / change)
        });
        let mut errors: Vec<_> = errors.collect();
        let half = errors.len() / 2;
        (errors.len() >= VOTES).then(|| *errors.select_nth_unstable_by(half, f64::total_cmp).1)
    };
    Mistake::all(frame.color.size, "the cameras")
        .skip(1)
        .filter_map(|mistake| Some((error(&mistake)?, mistake)))
        .filter(|(error, _)| *error < 0.1)
        .min_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, mistake)| mistake)
}

fn by_warp(motion: Pixels, before: &[Interleaved], now: &[Pixels]) -> Option<Mistake> {
    let size = motion.size;
    let before: Vec<_> = before.iter().map(Interleaved::pixels).collect();
    let channels = |images: &[Pixels]| images.iter().map(|image| image.channels).collect();
    let [known, shown]: [Vec<_>; 2] = [channels(&before), channels(now)];
    if known != shown {
        return None;
    }
    let agrees = |[x, y]: [usize; 2], pixel: usize, [u, v]: [f64; 2]| -> Option<bool> {
        let (x, y) = (x as f64 + u, y as f64 + v);
        let inside = |at: f64, side: usize| (0.0..=side as f64 - 1.0).contains(&at);
        if !(inside(x, size.width) && inside(y, size.height)) {
            return None;
        }
        let [left, right, up, down] =
            [x.floor(), x.ceil(), y.floor(), y.ceil()].map(|at| at as usize);
        let taps = [[left, up], [right, up], [left, down], [right, down]];
        let taps = taps.map(|[x, y]| y * size.width + x);
        let near = |before: &Pixels, now: &Pixels, channel: usize| {
            let value = now.at(pixel, channel);
            let there = taps.map(|tap| before.at(tap, channel));
            let low = there.into_iter().fold(f32::INFINITY, f32::min);
            let high = there.into_iter().fold(f32::NEG_INFINITY, f32::max);
            let margin = 0.02 * value.abs() + 0.01;
            let near = (low - margin..=high + margin).contains(&value);
            near & value.is_finite() || value == low || value == high
        };
        let mut images = before.iter().zip(now);
        Some(images.all(|(before, now)| (0..now.channels).all(|c| near(before, now, c))))
    };
    // The fraction of pixels that agree once the mistake is corrected, if the evidence is clear.
    let share = |mistake: &Mistake| {
        let (mut all, mut inside, mut agreeing, mut gained, mut lost) = (0, 0, 0, 0, 0);
        for (place, pixel, motion) in moved(motion) {
            let undone = mistake.undone(motion);
            let answers = [motion, undone].map(|motion| agrees(place, pixel, motion));
            all += 1;
            if let [Some(given), Some(then)] = answers {
                inside += 1;
                agreeing += usize::from(then);
                let apart = (undone[0] - motion[0]).hypot(undone[1] - motion[1]) >= 1.0;
                gained += usize::from(apart & then & !given);
                lost += usize::from(apart & given & !then);
            }
        }
        let plain = gained >= VOTES && gained > 4 * lost;
        let most = 2 * inside > all && 4 * agreeing > 3 * inside;
        (plain && most).then_some(agreeing as f64 / inside as f64)
    };
    let mistakes = Mistake::all(size, "the first frame").skip(1);
    mistakes
        .filter_map(|mistake| Some((share(&mistake)?, mistake)))
        .min_by(|(a, _), (b, _)| b.total_cmp(a))
        .map(|(_, mistake)| mistake)
}
