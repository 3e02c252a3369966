//! The memory of images, and the scratch that a pipeline reuses from frame to frame.
//!
//! Fresh memory is expensive: the operating system has to find and clear every page at its first use, which takes longer
//! than several passes over the image. Inside of [`Scratch::install`], images therefore reuse the memory of earlier images.
//! Large images also ask for huge pages: fewer page faults, fewer misses of the translation look-aside buffer.
//!
//! The scratch is installed per thread for the time of a step, not passed as an argument: kernels allocate their
//! intermediate images themselves, and are the same functions with a pipeline and without one.

use std::cell::RefCell;
use std::fmt::{self, Display};
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

use bytemuck::Pod;
use memmap2::MmapMut;

thread_local! {
    /// The scratch of the step that runs on this thread.
    static CURRENT: RefCell<Option<Scratch>> = const { RefCell::new(None) };
}

/// Memory that no image uses at the moment.
#[derive(Default)]
pub struct Scratch {
    free: Vec<Block>,
}

impl Scratch {
    /// Runs `work`. Its images on this thread take their memory from here, and return it when they are dropped. A panic
    /// frees all of the scratch. A thread that waits in one step may begin another: the scratch of the first waits, too.
    pub fn install<R>(&mut self, work: impl FnOnce() -> R) -> R {
        struct Restore(Option<Scratch>);
        impl Drop for Restore {
            fn drop(&mut self) {
                CURRENT.set(self.0.take());
            }
        }
        let outer = Restore(CURRENT.replace(Some(std::mem::take(self))));
        let result = work();
        *self = CURRENT.take().unwrap_or_default();
        drop(outer);
        result
    }

    /// The smallest free block that holds so many bytes. Blocks more than half too large are left for larger images.
    fn take(&mut self, len: usize) -> Option<Block> {
        let fits = |block: &Block| (len..=len.saturating_add(len / 2)).contains(&block.len());
        let blocks = self.free.iter().enumerate();
        let (index, _) = blocks
            .filter(|(_, block)| fits(block))
            .min_by_key(|(_, block)| block.len())?;
        Some(self.free.swap_remove(index))
    }
}

/// The payload of the panic when an image cannot be allocated.
#[derive(Debug)]
pub struct OutOfMemory {
    bytes: usize,
}

impl OutOfMemory {
    fn unwind(bytes: usize) -> ! {
        std::panic::resume_unwind(Box::new(Self { bytes }))
    }
}

impl Display for OutOfMemory {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "an image of {} bytes cannot be allocated", self.bytes)
    }
}

impl std::error::Error for OutOfMemory {}

/// Prefetches up to `len` elements from `start` on into the second-level cache; the part beyond the slice is left out. The
/// first level is too small for all that a kernel fetches ahead, and can wait for few lines at once: a core then stalls.
#[inline(always)]
pub fn prefetch<T>(data: &[T], start: usize, len: usize) {
    #[cfg(target_arch = "x86_64")]
    for at in (start..data.len().min(start + len)).step_by(LINE / size_of::<T>()) {
        safe_arch::prefetch_t1(&data[at]);
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (data, start, len);
}

/// Bytes of a cache line.
#[cfg(target_arch = "x86_64")]
const LINE: usize = 64;

/// The type of an image's elements.
pub trait Value: Pod + Default + Send + Sync {}

impl<T: Pod + Default + Send + Sync> Value for T {}

/// An allocation: on the heap, where words align any element, or pages of its own.
#[derive(Debug)]
enum Block {
    Small(Vec<u64>),
    Large(MmapMut),
}

/// Bytes of a huge page, and of the smallest block that gets huge pages.
#[cfg(target_os = "linux")]
const HUGE_PAGE: usize = 1 << 21;
const LARGE: usize = 1 << 22;

impl Block {
    /// Zeros for so many bytes and an eighth more, so that slightly larger images can reuse the block. Pages that are never
    /// written to take no memory.
    fn new(wanted: usize) -> Self {
        let len = wanted.saturating_add(wanted / 8);
        if wanted < LARGE {
            let len = len.div_ceil(size_of::<u64>());
            let mut words = vec![];
            if words.try_reserve_exact(len).is_err() {
                OutOfMemory::unwind(wanted);
            }
            words.resize(len, 0);
            return Self::Small(words);
        }
        let Ok(pages) = MmapMut::map_anon(len) else {
            OutOfMemory::unwind(wanted);
        };
        // Advice only: the system may still use small pages. The last partial page stays small, or most of a huge page
        // would be wasted.
        #[cfg(target_os = "linux")]
        let _ = pages.advise_range(memmap2::Advice::HugePage, 0, wanted - wanted % HUGE_PAGE);
        Self::Large(pages)
    }

    /// Bytes.
    fn len(&self) -> usize {
        match self {
            Self::Small(words) => size_of_val(&**words),
            Self::Large(pages) => pages.len(),
        }
    }

    /// The first elements.
    #[inline]
    fn elements<T: Value>(&self, count: usize) -> &[T] {
        let bytes = match self {
            Self::Small(words) => bytemuck::cast_slice(words),
            Self::Large(pages) => pages,
        };
        bytemuck::cast_slice(&bytes[..count * size_of::<T>()])
    }

    #[inline]
    fn elements_mut<T: Value>(&mut self, count: usize) -> &mut [T] {
        let bytes = match self {
            Self::Small(words) => bytemuck::cast_slice_mut(words),
            Self::Large(pages) => pages,
        };
        bytemuck::cast_slice_mut(&mut bytes[..count * size_of::<T>()])
    }
}

/// The elements of an image.
#[derive(Debug)]
pub struct Memory<T: Value> {
    /// `None` only while it is dropped.
    block: Option<Block>,
    len: usize,
    /// True if it was allocated while a scratch was installed. Only such memory returns to one: foreign memory, such as that
    /// of the caller's images, would pile up there frame by frame.
    returns: bool,
    element: PhantomData<T>,
}

impl<T: Value> Memory<T> {
    pub fn zeroed(len: usize) -> Self {
        Self::new(len, |data| data.fill(T::default()))
    }

    /// Uninitialised: zeros or the elements of an earlier image. The caller must write every element.
    pub fn stale(len: usize) -> Self {
        Self::new(len, |_| {})
    }

    fn new(len: usize, clear: impl FnOnce(&mut [T])) -> Self {
        let bytes = len.saturating_mul(size_of::<T>());
        CURRENT.with_borrow_mut(|scratch| {
            let block = scratch.as_mut().and_then(|scratch| scratch.take(bytes));
            let block = match block {
                Some(mut block) => {
                    clear(block.elements_mut(len));
                    block
                }
                None => Block::new(bytes),
            };
            Self {
                block: Some(block),
                len,
                returns: scratch.is_some(),
                element: PhantomData,
            }
        })
    }
}

impl<T: Value> From<&[T]> for Memory<T> {
    fn from(data: &[T]) -> Self {
        let mut copy = Self::stale(data.len());
        copy.copy_from_slice(data);
        copy
    }
}

impl<T: Value> Clone for Memory<T> {
    fn clone(&self) -> Self {
        Self::from(&**self)
    }
}

impl<T: Value> Deref for Memory<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        let block = self.block.as_ref().expect("not dropped yet");
        block.elements(self.len)
    }
}

impl<T: Value> DerefMut for Memory<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut [T] {
        let block = self.block.as_mut().expect("not dropped yet");
        block.elements_mut(self.len)
    }
}

impl<T: Value> Drop for Memory<T> {
    fn drop(&mut self) {
        if self.returns
            && let Some(block) = self.block.take().filter(|block| block.len() > 0)
        {
            // Another thread-local that holds images may be dropped after this one: then the block is freed.
            let _ = CURRENT.try_with(|current| {
                if let Some(scratch) = &mut *current.borrow_mut() {
                    scratch.free.push(block);
                }
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_handed_on() {
        let mut scratch = Scratch::default();
        let place = |memory: &Memory<f32>| memory.as_ptr();
        let first = scratch.install(|| {
            let mut memory = Memory::<f32>::zeroed(1000);
            memory.fill(1.0);
            place(&memory)
        });
        scratch.install(|| {
            // Too small, too large: neither takes it.
            let others = [2000, 500].map(Memory::<f32>::zeroed);
            assert!(others.iter().all(|other| place(other) != first));
            let stale = Memory::<f32>::stale(900);
            assert_eq!((place(&stale), stale[899]), (first, 1.0));
            drop(stale);
            // Of another type.
            let bytes = Memory::<u8>::stale(4000);
            assert_eq!(
                (bytes.as_ptr(), &bytes[..4]),
                (first.cast(), &1f32.to_ne_bytes()[..])
            );
            drop(bytes);
            assert!(Memory::<f32>::zeroed(1000).iter().all(|&v| v == 0.0));
        });
        assert_eq!(scratch.free.len(), 3);
    }

    #[test]
    fn large_memory_is_like_small() {
        let mut scratch = Scratch::default();
        let len = LARGE / size_of::<u32>() + 1;
        for _ in 0..2 {
            scratch.install(|| {
                let mut memory = Memory::<u32>::zeroed(len);
                assert!(memory.len() == len && memory.iter().all(|&v| v == 0));
                memory.fill(7);
                assert_eq!(memory.clone()[len - 1], 7);
            });
        }
        assert_eq!(scratch.free.len(), 2);
    }

    #[test]
    fn the_outer_scratch_waits_for_the_inner() {
        let [mut outer, mut inner] = [Scratch::default(), Scratch::default()];
        outer.install(|| {
            drop(Memory::<f32>::zeroed(10));
            inner.install(|| drop(Memory::<f32>::zeroed(10)));
        });
        assert_eq!((outer.free.len(), inner.free.len()), (1, 1));
    }

    #[test]
    fn a_panic_leaves_nothing_behind() {
        let mut scratch = Scratch::default();
        scratch.install(|| drop(Memory::<f32>::zeroed(10)));
        let panic = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            scratch.install(|| {
                let _image = Memory::<f32>::zeroed(10);
                Memory::<f32>::zeroed(usize::MAX)
            });
        }));
        assert!(panic.unwrap_err().is::<OutOfMemory>());
        assert!(scratch.free.is_empty() && CURRENT.with_borrow(Option::is_none));
    }

    #[test]
    fn memory_from_elsewhere_does_not_pile_up() {
        let mut scratch = Scratch::default();
        let before = Memory::<f32>::zeroed(10);
        let kept = scratch.install(|| {
            drop(before);
            Memory::<f32>::zeroed(10)
        });
        drop(kept);
        assert!(scratch.free.is_empty());
    }
}
