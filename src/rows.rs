//! The only place with threads and SIMD dispatch.
//!
//! A kernel is written once, over bands of rows. [`run`] cuts the image into bands, hands the bands to the threads, and
//! calls the kernel for each band inside a function that is compiled for the best instruction set of this CPU:
//! everything marked `#[inline(always)]` below that call is compiled again for each set. Kernels are plain loops over
//! slices, which the compiler vectorises, or explicit vectors ([`crate::lanes`]) where it would not.
//!
//! Rust contracts `a * b + c` only where a kernel says `mul_add`, which then rounds once at every level, in software where the
//! CPU has no such instruction. Reductions use a fixed number of partial sums, however wide the vectors, and each pixel
//! depends on the inputs alone: therefore the results have the same bits at every level, thread count and band height.

use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use pulp::WithSimd;
pub use pulp::{NullaryFnOnce as Outlined, Simd};
use rayon::prelude::*;

use crate::error::{Error, Result};

/// Rows of a band. Few enough to balance the load between threads, many enough that dispatch costs nothing.
pub const BAND: usize = 16;

/// The bands of an image of `height` rows, from top to bottom.
pub fn bands(height: usize) -> impl Iterator<Item = Range<usize>> {
    (0..height)
        .step_by(BAND)
        .map(move |y| y..(y + BAND).min(height))
}

/// A computation on bands of rows.
pub trait Kernel: Sync {
    /// One band of every output.
    type Out: Send;

    /// Computes these rows. `simd` is for kernels with explicit vectors; the others ignore it. Implementations are
    /// `#[inline(always)]`, as is everything they call per pixel: a function that is not inlined is compiled for the
    /// baseline only.
    fn rows<S: Simd>(&self, simd: S, rows: Range<usize>, out: Self::Out);
}

/// A range of rows and the outputs of these rows: the work of one thread at a time.
pub type Job<O> = (Range<usize>, O);

/// Runs a kernel over an image of `height` rows, band by band; `outs` yields the outputs of the [`bands`] in their order.
pub fn run<K: Kernel>(kernel: &K, height: usize, outs: impl Iterator<Item = K::Out>) {
    run_jobs(kernel, jobs(height, outs));
}

/// Runs a kernel over jobs that the caller has cut.
pub fn run_jobs<K: Kernel>(kernel: &K, jobs: Vec<Job<K::Out>>) {
    let level = Settings::get().level;
    let call = |(rows, out)| level.call(Call { kernel, rows, out });
    match pool().and_then(|pool| pool.threads.as_ref()) {
        Some(threads) if jobs.len() > 1 => {
            threads.install(|| jobs.into_par_iter().for_each(call));
        }
        _ => jobs.into_iter().for_each(call),
    }
}

/// Runs work that calls many kernels, such as a frame, on a thread of the pool. From any other thread, each call would wake the
/// pool and wait to be woken, a sixth of the time of small frames. Only one frame has the pool at a time, and others run on
/// their callers' threads: while a thread of the pool waits, it begins other work that is due, and many frames nested in this
/// way would exhaust its stack.
pub fn together<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    struct Leave<'a>(&'a AtomicBool);
    impl Drop for Leave<'_> {
        fn drop(&mut self) {
            self.0.store(false, Ordering::Release);
        }
    }
    let Some(Pool { threads, taken, .. }) = pool() else {
        return work();
    };
    match threads {
        Some(threads) if !taken.swap(true, Ordering::Acquire) => {
            let _leave = Leave(taken);
            threads.install(work)
        }
        _ => work(),
    }
}

/// A job for each band. Every output is paired with its rows here and nowhere else: one band too few, which `zip` would
/// drop in silence, or one too many is a panic. Iterators over several outputs may be zipped before: the shortest counts.
fn jobs<O>(height: usize, mut outs: impl Iterator<Item = O>) -> Vec<Job<O>> {
    let pair = |rows| {
        let out = outs.next().expect("every band of rows has its outputs");
        (rows, out)
    };
    let jobs = bands(height).map(pair).collect();
    assert!(outs.next().is_none(), "outputs end with the last row");
    jobs
}

/// The bands of an output that may be absent: `None` for every band then, otherwise as many as there are, so that one too
/// few is noticed like any other.
pub fn optional<I: Iterator>(outs: Option<I>) -> impl Iterator<Item = Option<I::Item>> {
    let mut outs = outs;
    std::iter::from_fn(move || match &mut outs {
        Some(outs) => outs.next().map(Some),
        None => Some(None),
    })
}

/// Jobs of several bands each, for kernels whose windows reach `reach` rows beyond their own: the rows in the halo, which
/// both neighbours compute, stay few beside the job's own.
pub fn tall_jobs<O>(
    height: usize,
    reach: usize,
    outs: impl Iterator<Item = O>,
) -> Vec<Job<Vec<O>>> {
    let per_thread = height.div_ceil(Settings::get().threads);
    let least = 10 * reach.max(1);
    let turns = ((per_thread + least / 2) / least).clamp(1, 8);
    let bands = per_thread.div_ceil(turns).div_ceil(BAND);
    let mut tall: Vec<Job<Vec<O>>> = vec![];
    for (index, (rows, out)) in jobs(height, outs).into_iter().enumerate() {
        if index % bands == 0 {
            tall.push((rows.clone(), vec![]));
        }
        if let Some((all, outs)) = tall.last_mut() {
            all.end = rows.end;
            outs.push(out);
        }
    }
    tall
}

/// The rows of a job with their lines of an output that holds `len` elements a row; panics unless the output has exactly
/// these rows.
#[inline(always)]
pub fn lines<T>(
    rows: Range<usize>,
    out: &mut [T],
    len: usize,
) -> impl Iterator<Item = (usize, &mut [T])> {
    assert_eq!(out.len(), rows.len() * len);
    rows.zip(out.chunks_exact_mut(len))
}

/// Rows of a job where every thread gets six jobs: enough to balance the load, if the image is high enough for them.
pub fn rows_per_job(height: usize) -> usize {
    height.div_ceil(6 * Settings::get().threads).max(BAND)
}

/// Calls a part of a kernel as a function of its own that is compiled for the same instruction set. Kernels that share
/// the part compile it once, and none grows so large that the compiler stops vectorising it.
pub fn outline(part: impl Outlined<Output = ()>) {
    Settings::get().level.call(part);
}

struct Call<'k, K: Kernel> {
    kernel: &'k K,
    rows: Range<usize>,
    out: K::Out,
}

impl<K: Kernel> WithSimd for Call<'_, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.kernel.rows(simd, self.rows, self.out);
    }
}

/// Instruction sets, each a superset of the one before. The baseline is what every CPU of the target has (SSE2, NEON).
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

    /// The level of this name; the next lower one if the architecture lacks it.
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

/// Threads and instruction set: those of this machine, lowered by the environment.
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
        Self::from_environment().unwrap_or_else(|error| panic!("{error}"))
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
    /// `None` if the system could start no threads: the caller's thread then does all the work.
    threads: Option<rayon::ThreadPool>,
    /// Whether [`together`] runs in it.
    taken: AtomicBool,
    next: OnceLock<Box<Pool>>,
}

/// Bytes of a thread's stack. Unoptimised builds, in which the locals of inlined functions share no stack slots, overflow
/// the usual 2 MB.
const STACK: usize = 8 << 20;

fn pool() -> Option<&'static Pool> {
    static FIRST: OnceLock<Box<Pool>> = OnceLock::new();
    let threads = Settings::get().threads;
    if threads == 1 {
        return None;
    }
    let process = std::process::id();
    let mut slot = &FIRST;
    loop {
        let entry = slot.get_or_init(|| {
            let threads = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .thread_name(|i| format!("yester-{i}"))
                .stack_size(STACK)
                .build();
            Box::new(Pool {
                process,
                threads: threads.ok(),
                taken: AtomicBool::new(false),
                next: OnceLock::new(),
            })
        });
        if entry.process == process {
            return Some(entry);
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
    fn works_of_several_threads_and_of_one_within_another_are_done() {
        let within = || together(|| together(|| 1));
        std::thread::scope(|scope| {
            let works: Vec<_> = (0..32).map(|_| scope.spawn(within)).collect();
            let done = works.into_iter().map(|work| work.join().unwrap());
            assert_eq!(done.sum::<i32>(), 32);
        });
    }

    #[test]
    fn after_a_panic_the_pool_is_free() {
        let panics = || together(|| -> () { std::panic::resume_unwind(Box::new("in a pass")) });
        let payload = std::panic::catch_unwind(panics).unwrap_err();
        assert_eq!(*payload.downcast::<&str>().unwrap(), "in a pass");
        if let Some(pool) = pool() {
            // Tests of other threads may take the pool, but not for long.
            let free = || !pool.taken.load(Ordering::Acquire);
            let wait = || std::thread::sleep(std::time::Duration::from_millis(1));
            assert!((0..10_000).any(|_| free() || {
                wait();
                false
            }));
        }
    }

    struct Fill;

    impl Kernel for Fill {
        type Out = &'static mut [u8];

        fn rows<S: Simd>(&self, _: S, rows: Range<usize>, out: Self::Out) {
            lines(rows, out, 1).for_each(|(_, line)| line.fill(1));
        }
    }

    fn fill(height: usize, lengths: &[usize]) {
        let outs = lengths.iter().map(|&len| vec![0; len].leak());
        run(&Fill, height, outs);
    }

    #[test]
    fn outputs_of_every_band_are_written() {
        fill(40, &[16, 16, 8]);
    }

    #[test]
    #[should_panic(expected = "every band of rows has its outputs")]
    fn a_missing_band_panics() {
        fill(40, &[16, 16]);
    }

    #[test]
    #[should_panic(expected = "outputs end with the last row")]
    fn a_band_too_many_panics() {
        fill(40, &[16, 16, 8, 16]);
    }

    #[test]
    #[should_panic(expected = "assertion")]
    fn a_short_band_panics() {
        fill(40, &[16, 16, 7]);
    }

    #[test]
    #[should_panic(expected = "every band of rows has its outputs")]
    fn zipped_outputs_panic_where_one_is_short() {
        tall_jobs(40, 1, [(); 3].iter().zip(&[(); 2]));
    }

    #[test]
    #[should_panic(expected = "every band of rows has its outputs")]
    fn optional_outputs_panic_where_they_are_short() {
        jobs(40, optional(Some([(); 2].iter())));
    }

    #[test]
    fn optional_outputs_may_be_absent() {
        let absent = optional(None::<std::slice::Iter<()>>).zip([(); 3]);
        assert!(jobs(40, absent).iter().all(|(_, (out, ()))| out.is_none()));
    }

    #[test]
    fn tall_jobs_cover_every_band_once() {
        for height in (1..200).step_by(13) {
            let count = bands(height).count();
            let jobs = tall_jobs(height, 1, 0..count);
            assert!(jobs.iter().flat_map(|(rows, _)| rows.clone()).eq(0..height));
            assert!(jobs.into_iter().flat_map(|(_, outs)| outs).eq(0..count));
        }
    }

    #[test]
    fn levels_have_names() {
        assert_eq!(Level::named("baseline"), Some(Level::Baseline));
        assert_eq!(Level::named("sse9"), None);
    }
}
