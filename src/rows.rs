//! The only place with threads and SIMD dispatch.
//!
//! A kernel is written once, as plain loops over slices of rows. [`run`] cuts the image into bands of rows, hands the
//! bands to the threads, and calls the kernel for each band inside a function that is compiled for the best
//! instruction set that this CPU has: everything marked `#[inline(always)]` below that call is compiled again for it.
//! Rust never contracts `a * b + c`, no kernel reduces across lanes, and each pixel depends on the inputs alone:
//! therefore bits are the same at every level, thread count and band height.

use std::ops::Range;
use std::sync::OnceLock;

pub use pulp::NullaryFnOnce as Part;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use crate::error::{Error, Result};

/// Rows of one band. Small enough to balance threads, large enough that dispatch is free.
pub const BAND: usize = 16;

/// The bands of an image of so many rows, from top to bottom.
pub fn bands(height: usize) -> impl Iterator<Item = Range<usize>> {
    (0..height)
        .step_by(BAND)
        .map(move |y| y..(y + BAND).min(height))
}

/// A computation on bands of rows.
pub trait Kernel: Sync {
    /// The same band of every output.
    type Out: Send;

    /// Computes the given rows. Implementations are `#[inline(always)]`, as is all that they call per pixel, or the
    /// work would be compiled for the baseline only.
    fn rows(&self, rows: Range<usize>, out: Self::Out);
}

/// The same, written in registers ([`crate::lanes`]).
pub trait LanesKernel: Sync {
    type Out: Send;

    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, out: Self::Out);
}

/// Runs a kernel over an image of `height` rows; `outs` yields its outputs band by band, as [`bands`] does.
pub fn run<K: Kernel>(kernel: &K, height: usize, outs: impl Iterator<Item = K::Out>) {
    let level = Settings::get().level;
    each(height, BAND, outs, |rows, out| {
        level.call(Band { kernel, rows, out });
    });
}

/// The same for kernels that look up to `reach` rows beyond theirs: they get several bands at a time, so that little is
/// computed twice.
pub fn run_far<O: Send, K: Kernel<Out = Vec<O>>>(
    kernel: &K,
    height: usize,
    reach: usize,
    mut outs: impl Iterator<Item = O>,
) {
    let level = Settings::get().level;
    let fair = height.div_ceil(Settings::get().threads);
    let least = 10 * reach.max(1);
    let turns = ((fair + least / 2) / least).clamp(1, 8);
    let bands = fair.div_ceil(turns).div_ceil(BAND);
    let groups = std::iter::repeat_with(|| outs.by_ref().take(bands).collect());
    each(height, bands * BAND, groups, |rows, out| {
        level.call(Band { kernel, rows, out });
    });
}

/// The same for kernels in registers.
pub fn run_lanes<K: LanesKernel>(kernel: &K, height: usize, outs: impl Iterator<Item = K::Out>) {
    let level = Settings::get().level;
    each(height, BAND, outs, |rows, out| {
        level.call(LanesBand { kernel, rows, out });
    });
}

/// The same for parts of the image that the kernel's user has cut.
pub fn run_lane_parts<K: LanesKernel>(kernel: &K, parts: Vec<(Range<usize>, K::Out)>) {
    let level = Settings::get().level;
    hand_out(parts, |rows, out| {
        level.call(LanesBand { kernel, rows, out });
    });
}

/// The same for parts of the image that the kernel's user has cut.
pub fn run_parts<K: Kernel>(kernel: &K, parts: Vec<(Range<usize>, K::Out)>) {
    let level = Settings::get().level;
    hand_out(parts, |rows, out| {
        level.call(Band { kernel, rows, out });
    });
}

/// So many rows that every thread has six turns, if there are enough.
pub fn turn(height: usize) -> usize {
    height.div_ceil(6 * Settings::get().threads).max(BAND)
}

/// Hands bands of so many rows to the threads.
fn each<O: Send>(
    height: usize,
    band: usize,
    outs: impl Iterator<Item = O>,
    call: impl Fn(Range<usize>, O) + Sync,
) {
    let bands = (0..height).step_by(band).map(|y| y..(y + band).min(height));
    hand_out(bands.zip(outs).collect(), call);
}

fn hand_out<O: Send>(jobs: Vec<(Range<usize>, O)>, call: impl Fn(Range<usize>, O) + Sync) {
    match pool() {
        Some(pool) if jobs.len() > 1 => pool.install(|| {
            jobs.into_par_iter().for_each(|(rows, out)| call(rows, out));
        }),
        _ => jobs.into_iter().for_each(|(rows, out)| call(rows, out)),
    }
}

/// Calls a part of a kernel as a function of its own, compiled for the same instruction set: what several kernels have in
/// common is compiled once, and none grows so large that compilers no longer vectorise it.
pub fn apart(part: impl Part<Output = ()>) {
    Settings::get().level.call(part);
}

struct Band<'k, K: Kernel> {
    kernel: &'k K,
    rows: Range<usize>,
    out: K::Out,
}

impl<K: Kernel> Part for Band<'_, K> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.kernel.rows(self.rows, self.out);
    }
}

struct LanesBand<'k, K: LanesKernel> {
    kernel: &'k K,
    rows: Range<usize>,
    out: K::Out,
}

impl<K: LanesKernel> WithSimd for LanesBand<'_, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.kernel.rows(simd, self.rows, self.out);
    }
}

/// Instruction sets, each including those before it. What the target has anyway (SSE2, NEON) is the baseline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    Baseline,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Level {
    fn detected() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if pulp::x86::V4::is_available() {
                return Self::Avx512;
            }
            if pulp::x86::V3::is_available() {
                return Self::Avx2;
            }
        }
        Self::Baseline
    }

    /// The level of this name; one that this architecture does not have counts as the nearest below.
    fn named(name: &str) -> Option<Self> {
        match name {
            "baseline" | "neon" => Some(Self::Baseline),
            #[cfg(target_arch = "x86_64")]
            "avx2" => Some(Self::Avx2),
            #[cfg(target_arch = "x86_64")]
            "avx512" => Some(Self::Avx512),
            #[cfg(not(target_arch = "x86_64"))]
            "avx2" | "avx512" => Some(Self::Baseline),
            _ => None,
        }
    }

    fn call(self, job: impl WithSimd<Output = ()>) {
        match self {
            Self::Baseline => pulp::Scalar128b.vectorize(job),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                let simd = pulp::x86::V3::try_new();
                Simd::vectorize(simd.expect("never above the detected level"), job);
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                let simd = pulp::x86::V4::try_new();
                Simd::vectorize(simd.expect("never above the detected level"), job);
            }
        }
    }
}

/// What this machine has, lowered by the environment.
#[derive(Debug)]
pub struct Settings {
    /// At least 1.
    pub threads: usize,
    level: Level,
}

impl Settings {
    /// Reads `YESTER_THREADS` and `YESTER_SIMD` once. They lower what was detected, never raise it.
    pub fn from_environment() -> Result<&'static Self> {
        if let Some(settings) = SETTINGS.get() {
            return Ok(settings);
        }
        let available = std::thread::available_parallelism().map_or(1, usize::from);
        let threads = match variable("YESTER_THREADS") {
            None => available,
            Some(text) => match text.parse() {
                Ok(n) if n >= 1 => available.min(n),
                _ => {
                    return Err(Error::value(
                        "YESTER_THREADS",
                        "a whole number of threads, 1 or more",
                        text,
                    ));
                }
            },
        };
        let level = match variable("YESTER_SIMD") {
            None => Level::detected(),
            Some(text) => match Level::named(&text) {
                Some(level) => level.min(Level::detected()),
                None => {
                    return Err(Error::value(
                        "YESTER_SIMD",
                        "baseline, avx2, avx512 or neon",
                        text,
                    ));
                }
            },
        };
        Ok(SETTINGS.get_or_init(|| Self { threads, level }))
    }

    pub(crate) fn get() -> &'static Self {
        Self::from_environment().expect("the environment is checked before any kernel runs")
    }

    /// The instruction set's name, as `YESTER_SIMD` has it.
    pub fn level_name(&self) -> &'static str {
        match self.level {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => "avx2",
            Level::Baseline if cfg!(target_arch = "aarch64") => "neon",
            Level::Baseline => "baseline",
        }
    }
}

static SETTINGS: OnceLock<Settings> = OnceLock::new();

fn variable(name: &str) -> Option<String> {
    std::env::var_os(name)
        .filter(|text| !text.is_empty())
        .map(|text| text.to_string_lossy().into_owned())
}

/// The thread pool of one process. A forked process inherits the memory of its parent's pool but none of its threads,
/// and would wait for them for ever: it starts a pool of its own, next in the list. The list needs no lock that a fork
/// could copy in its locked state; the parent's pool is never dropped, since nobody is left to join.
struct Pool {
    process: u32,
    /// None where the system started no threads: the caller's does all.
    pool: Option<rayon::ThreadPool>,
    next: OnceLock<Box<Pool>>,
}

/// Bytes of a thread's stack. Unoptimised builds, in which nothing that is inlined shares its place, overflow the usual 2 MB.
const STACK: usize = 8 << 20;

fn pool() -> Option<&'static rayon::ThreadPool> {
    static FIRST: OnceLock<Box<Pool>> = OnceLock::new();
    let threads = Settings::get().threads;
    if threads == 1 {
        return None;
    }
    let process = std::process::id();
    let mut slot = &FIRST;
    loop {
        let entry = slot.get_or_init(|| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .thread_name(|i| format!("yester-{i}"))
                .stack_size(STACK)
                .build();
            Box::new(Pool {
                process,
                pool: pool.ok(),
                next: OnceLock::new(),
            })
        });
        if entry.process == process {
            return entry.pool.as_ref();
        }
        slot = &entry.next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_every_row_once() {
        for height in 0..100 {
            assert!(bands(height).flatten().eq(0..height));
        }
    }

    #[test]
    fn levels_have_names() {
        assert_eq!(Level::named("baseline"), Some(Level::Baseline));
        assert_eq!(Level::named("sse9"), None);
    }
}
