//! Runs of pixels, split by whether their history is contiguous in memory.

use std::ops::Range;

use crate::image::SEGMENT;
use crate::lanes::LANES;

/// A part of a run, and whether the pixels that it fetches are contiguous in memory.
pub struct Span {
    pub part: Range<usize>,
    pub contiguous: bool,
}

/// A run, split into spans with contiguous fetches and spans without. Where motion is smooth, neighbours come from
/// neighbours, so that vector loads can replace gathers.
pub struct Spans {
    /// The end of each span, a multiple of the vector but for the last, and whether it is contiguous.
    ends: [(u16, bool); SEGMENT / LANES + 1],
    count: usize,
}

impl Spans {
    pub fn none() -> Self {
        Self {
            ends: [(0, false); _],
            count: 0,
        }
    }

    /// Splits a run that fetches these pixels.
    #[inline(always)]
    pub fn find(&mut self, pixels: &[u32]) {
        self.count = 0;
        let mut last = None;
        for (k, chunk) in pixels.chunks(LANES).enumerate() {
            let contiguous = match chunk.first_chunk::<{ LANES }>() {
                Some(chunk) => {
                    let steps = chunk.iter().zip(chunk[0]..).map(|(&at, next)| at ^ next);
                    steps.fold(0, |any, step| any | step) == 0
                }
                None => false,
            };
            let goes_on = match last {
                Some((true, next)) => contiguous && next == chunk[0],
                Some((false, _)) => !contiguous,
                None => false,
            };
            self.count += usize::from(!goes_on);
            let end = k * LANES + chunk.len();
            self.ends[self.count - 1] = (end as u16, contiguous);
            last = Some((contiguous, chunk[chunk.len() - 1].wrapping_add(1)));
        }
    }

    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = Span> {
        let mut start = 0;
        self.ends[..self.count]
            .iter()
            .map(move |&(end, contiguous)| {
                let part = start..usize::from(end);
                start = part.end;
                Span { part, contiguous }
            })
    }
}
