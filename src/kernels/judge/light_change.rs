//! Change of light: the factor by which all light has changed, where it is one factor: of an exposure, a fade, a lamp that
//! lights everything.
//!
//! The image has 64 blocks, 8 across and 8 down. With Σy and Σh the sums of luminance of the new samples and of the history
//! over a block's pixels where both are known,
//!   r = ln Σy − ln Σh,  m = median r,  d = third quartile of |r − m|,
//! over the blocks that know a sixteenth of their pixels, if there are 16. The factor is exp(m) where |m| > 5/4 d, d < 3/20 and
//! |m| < ln 10⁶, and 1 elsewhere: where blocks disagree by more, another light has changed, or the samples are too noisy to
//! tell. Of H rows, every ⌊H/128⌋th is looked at, or the next odd number: steps of an even number would see even rows alone, of
//! which frames that are traced in part may have none.
//!
//! Inputs: colour (3), history (3), its coverage (1), of which more than 0.9 is known. Output: a number above 0.

use std::ops::Range;

use crate::image::{BandMut, Image, Pixels, Run, SEGMENT, Size, View, segments};
use crate::kernels::fetch::reproject::{Fetch, Fetched};
use crate::math::{is_present, luminance};
use crate::pixels::{MotionLanes, Row};
use crate::rows::{self, Kernel, Simd};

/// Blocks along each side.
const BLOCKS: usize = 8;
/// Rows of which all are looked at.
const ROWS: usize = 128;
/// Coverage above which history is known.
const KNOWN: f32 = 0.9;
/// A block takes part if history is known in at least one of so many of its inspected pixels.
const SPARSE: f32 = 16.0;
/// Fewest blocks that must take part.
const FEWEST: usize = BLOCKS * BLOCKS / 4;
/// A change must be more than so many times the spread of the blocks' changes: it is none if a quarter of the blocks did not
/// change.
const BEYOND: f64 = 1.25;
/// Spread between blocks from which on no single factor describes the change.
const SPREAD: f64 = 0.15;
/// Larger factors are not followed: moments are multiplied by the square, which must not overflow.
const MOST: f64 = 1e6;

/// The history that new samples are compared with.
#[derive(Clone, Copy)]
enum Known<'a> {
    /// At the pixels of the samples, with its coverage, by default everywhere.
    Here(Pixels<'a>, Option<View<'a>>),
    /// To be fetched along a motion; with the colour first of so many channels.
    Along(&'a Fetch<'a>, Pixels<'a>, usize),
}

/// The factor by which all light has changed since the history, which is that of the pixels; 1 if it is not one factor.
pub fn light_change(color: Pixels, history: Pixels, coverage: Option<View>) -> f32 {
    factor(color, Known::Here(history, coverage))
}

/// [`light_change`] for a history that is to be fetched along the motion, of which the first three of so many channels are
/// colour.
pub(crate) fn light_change_along(
    color: Pixels,
    history: &Fetch,
    motion: Pixels,
    channels: usize,
) -> f32 {
    factor(color, Known::Along(history, motion, channels))
}

fn factor(color: Pixels, known: Known) -> f32 {
    let Size { height, width } = color.size;
    let step = (height / ROWS) | 1;
    let size = Size {
        height: height.div_ceil(step),
        width: BLOCKS,
    };
    let mut sums = Image::new(size, 3);
    let kernel = Sums { color, known, step };
    rows::run(&kernel, size.height, sums.bands());

    let mut blocks = [[0.0; 3]; BLOCKS * BLOCKS];
    for row in 0..size.height {
        let down = row * step * BLOCKS / height * BLOCKS;
        for (across, block) in blocks[down..][..BLOCKS].iter_mut().enumerate() {
            for (channel, sum) in block.iter_mut().enumerate() {
                *sum += f64::from(sums.view().row(channel, row)[across]);
            }
        }
    }
    let looked_at = (size.height * width) as f32 / (BLOCKS * BLOCKS) as f32;
    let tells = |&[now, before, count]: &[f64; 3]| {
        let enough = count >= f64::from(looked_at / SPARSE);
        (enough && now > 0.0 && before > 0.0).then(|| libm::log(now) - libm::log(before))
    };
    let mut changes: Vec<_> = blocks.iter().filter_map(tells).collect();
    if changes.len() < FEWEST {
        return 1.0;
    }
    let change = quantile(&mut changes, 0.5);
    (changes.iter_mut()).for_each(|other| *other = (*other - change).abs());
    let spread = quantile(&mut changes, 0.75);
    let one = change.abs() > BEYOND * spread && spread < SPREAD;
    if one && change.abs() < libm::log(MOST) {
        libm::exp(change) as f32
    } else {
        1.0
    }
}

/// The value below which this share of all is, interpolated linearly.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    let place = share * last as f64;
    let [below, above] = [
        values[place as usize],
        values[(place as usize + 1).min(last)],
    ];
    below + (place - place.floor()) * (above - below)
}

/// Writes, for each row that is looked at, the blocks' sums of luminance, now and before, and numbers of pixels.
struct Sums<'a> {
    color: Pixels<'a>,
    known: Known<'a>,
    step: usize,
}

/// Scratch for history.
struct Scratch {
    color: [Row; 3],
    coverage: Row,
    motion: MotionLanes,
    fetched: Option<Fetched>,
}

impl<'a> Kernel for Sums<'a> {
    type Out = BandMut<'a>;

    #[inline(always)]
    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, mut sums: BandMut<'a>) {
        let width = self.color.size.width;
        let mut colors = [[0.0; SEGMENT]; 3];
        let mut history = Scratch {
            color: [[0.0; SEGMENT]; 3],
            coverage: [1.0; SEGMENT],
            motion: MotionLanes::zeroed(),
            fetched: match &self.known {
                Known::Here(..) => None,
                Known::Along(fetch, ..) => Some(fetch.scratch()),
            },
        };
        for row in rows {
            let [now, before, count] = sums.rows::<3>(row);
            for run in segments(row * self.step, width) {
                self.color.read_rows(run, &mut colors);
                self.known.read(run, &mut history);
                for i in 0..run.len {
                    let [own, known] =
                        [&colors, &history.color].map(|rows| [0, 1, 2].map(|c| rows[c][i]));
                    if is_present(own) && is_present(known) && history.coverage[i] > KNOWN {
                        let block = (run.x + i) * BLOCKS / width;
                        now[block] += luminance(own[0], own[1], own[2]);
                        before[block] += luminance(known[0], known[1], known[2]);
                        count[block] += 1.0;
                    }
                }
            }
        }
    }
}

impl Known<'_> {
    #[inline(always)]
    fn read(&self, run: Run, into: &mut Scratch) {
        match (self, &mut into.fetched) {
            (Self::Along(fetch, motion, channels), Some(fetched)) => {
                fetch.run(run, into.motion.load(motion, run), fetched);
                let records = fetched.values(0).chunks_exact(*channels);
                for (i, record) in records.take(run.len).enumerate() {
                    for (row, value) in into.color.iter_mut().zip(record) {
                        row[i] = *value;
                    }
                }
                into.coverage = fetched.coverage;
            }
            (Self::Here(color, coverage), _) => {
                color.read_rows(run, &mut into.color);
                if let Some(coverage) = coverage {
                    Pixels::from(*coverage).load(run, 0, &mut into.coverage[..run.len]);
                }
            }
            _ => {}
        }
    }
}
