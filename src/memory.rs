//! The memory of images, which a pipeline hands from frame to frame.
//!
//! Memory that is fresh from the system comes in pages that it has to find and to clear, which takes longer than several
//! passes over them. While a [`Reserve`] serves, images take what earlier ones have left. And large images ask for large
//! pages, of which there are fewer to find, and fewer for the processor to look up.

use std::any::Any;
use std::cell::RefCell;
use std::fmt::{self, Display};
use std::ops::{Deref, DerefMut};

use bytemuck::Pod;
use memmap2::MmapMut;

thread_local! {
    static SERVING: RefCell<Option<Reserve>> = const { RefCell::new(None) };
}

/// What is free, each a [`Room`] for numbers of some type.
#[derive(Default)]
pub struct Reserve {
    free: Vec<Box<dyn Any + Send + Sync>>,
}

impl Reserve {
    /// Does some work whose images are made of this memory, and leave theirs behind. If it panics, this memory is freed.
    pub fn serve<R>(&mut self, work: impl FnOnce() -> R) -> R {
        struct Served;
        impl Drop for Served {
            fn drop(&mut self) {
                SERVING.take();
            }
        }
        let served = Served;
        SERVING.set(Some(std::mem::take(self)));
        let result = work();
        *self = SERVING.take().unwrap_or_default();
        drop(served);
        result
    }

    /// The smallest piece that is large enough, unless it is far too large.
    fn take<T: Value>(&mut self, len: usize) -> Option<Room<T>> {
        let fits = |piece: &Box<dyn Any + Send + Sync>| {
            let capacity = piece.downcast_ref::<Room<T>>()?.len();
            (len..=len + len / 3)
                .contains(&capacity)
                .then_some(capacity)
        };
        let pieces = self.free.iter().enumerate();
        let (place, _) = pieces
            .filter_map(|(place, piece)| fits(piece).map(|capacity| (place, capacity)))
            .min_by_key(|&(_, capacity)| capacity)?;
        let piece = self.free.swap_remove(place).downcast();
        Some(*piece.expect("of this type, as it fits"))
    }
}

/// The panic of memory that cannot be had.
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

/// So many numbers, all zero.
fn zeroed<T: Value>(len: usize) -> Vec<T> {
    let mut numbers = vec![];
    if numbers.try_reserve_exact(len).is_err() {
        OutOfMemory::unwind(len.saturating_mul(size_of::<T>()));
    }
    numbers.resize(len, T::default());
    numbers
}

/// Asks for up to `len` numbers from `start` on, to be read or written soon, so that they come while others are worked on.
#[inline(always)]
pub fn prefetch<T>(data: &[T], start: usize, len: usize) {
    #[cfg(target_arch = "x86_64")]
    for at in (start..data.len().min(start + len)).step_by(LINE / size_of::<T>()) {
        safe_arch::prefetch_t0(&data[at]);
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (data, start, len);
}

/// Bytes that come at once.
#[cfg(target_arch = "x86_64")]
const LINE: usize = 64;

/// What images consist of.
pub trait Value: Pod + Default + Send + Sync {}

impl<T: Pod + Default + Send + Sync> Value for T {}

/// Where numbers can be.
#[derive(Debug)]
enum Room<T> {
    Small(Vec<T>),
    Large(MmapMut),
}

/// Bytes of a large page, and from which on they pay.
#[cfg(target_os = "linux")]
const LARGE_PAGE: usize = 1 << 21;
const LARGE: usize = 1 << 22;

impl<T: Value> Room<T> {
    /// For so many numbers, all zero, and some more for images that are hardly larger: memory that nobody has written to
    /// costs none.
    fn new(len: usize) -> Self {
        let wanted = len.saturating_mul(size_of::<T>());
        let len = len.saturating_add(len / 8);
        if wanted < LARGE {
            return Self::Small(zeroed(len));
        }
        let Ok(pages) = MmapMut::map_anon(len.saturating_mul(size_of::<T>())) else {
            OutOfMemory::unwind(wanted);
        };
        // Where large pages cannot be had, small ones do, and as well where the end of the last would be for nothing.
        #[cfg(target_os = "linux")]
        let _ = pages.advise_range(memmap2::Advice::HugePage, 0, wanted - wanted % LARGE_PAGE);
        Self::Large(pages)
    }
}

impl<T: Value> Deref for Room<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        match self {
            Self::Small(numbers) => numbers,
            Self::Large(pages) => bytemuck::cast_slice(pages),
        }
    }
}

impl<T: Value> DerefMut for Room<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut [T] {
        match self {
            Self::Small(numbers) => numbers,
            Self::Large(pages) => bytemuck::cast_slice_mut(pages),
        }
    }
}

/// So many numbers.
#[derive(Debug)]
pub struct Memory<T: Value> {
    /// Some, until it is dropped.
    room: Option<Room<T>>,
    len: usize,
    /// Whether it was made where a reserve served, to which it then returns: others would only pile up there.
    returns: bool,
}

impl<T: Value> Memory<T> {
    pub fn zeroed(len: usize) -> Self {
        Self::new(len, |data| data.fill(T::default()))
    }

    /// Whatever was there before, for who overwrites all of it.
    pub fn left(len: usize) -> Self {
        Self::new(len, |_| {})
    }

    fn new(len: usize, clear: impl FnOnce(&mut [T])) -> Self {
        SERVING.with_borrow_mut(|reserve| {
            let piece = reserve.as_mut().and_then(|reserve| reserve.take(len));
            let room = match piece {
                Some(mut room) => {
                    clear(&mut room[..len]);
                    room
                }
                None => Room::new(len),
            };
            Self {
                room: Some(room),
                len,
                returns: reserve.is_some(),
            }
        })
    }
}

impl<T: Value> From<&[T]> for Memory<T> {
    fn from(data: &[T]) -> Self {
        let mut copy = Self::left(data.len());
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
        &self.room.as_ref().expect("not dropped yet")[..self.len]
    }
}

impl<T: Value> DerefMut for Memory<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.room.as_mut().expect("not dropped yet")[..self.len]
    }
}

impl<T: Value> Drop for Memory<T> {
    fn drop(&mut self) {
        if self.returns
            && let Some(room) = self.room.take().filter(|room| !room.is_empty())
        {
            SERVING.with_borrow_mut(|reserve| {
                if let Some(reserve) = reserve {
                    reserve.free.push(Box::new(room));
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
        let mut reserve = Reserve::default();
        let place = |memory: &Memory<f32>| memory.as_ptr();
        let first = reserve.serve(|| {
            let mut memory = Memory::<f32>::zeroed(1000);
            memory.fill(1.0);
            place(&memory)
        });
        reserve.serve(|| {
            // Of another type, too small, too large: none of these take it.
            let others = (
                Memory::<u32>::zeroed(1000),
                Memory::<f32>::zeroed(2000),
                Memory::<f32>::zeroed(500),
            );
            assert!(place(&others.1) != first && place(&others.2) != first);
            let left = Memory::<f32>::left(900);
            assert_eq!((place(&left), left[899]), (first, 1.0));
            drop(left);
            assert!(Memory::<f32>::zeroed(1000).iter().all(|&v| v == 0.0));
        });
        assert_eq!(reserve.free.len(), 4);
    }

    #[test]
    fn large_memory_is_like_small() {
        let mut reserve = Reserve::default();
        let len = LARGE / size_of::<u32>() + 1;
        for _ in 0..2 {
            reserve.serve(|| {
                let mut memory = Memory::<u32>::zeroed(len);
                assert!(memory.len() == len && memory.iter().all(|&v| v == 0));
                memory.fill(7);
                assert_eq!(memory.clone()[len - 1], 7);
            });
        }
        assert_eq!(reserve.free.len(), 2);
    }

    #[test]
    fn a_panic_leaves_nothing_behind() {
        let mut reserve = Reserve::default();
        reserve.serve(|| drop(Memory::<f32>::zeroed(10)));
        let panic = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            reserve.serve(|| {
                let _image = Memory::<f32>::zeroed(10);
                Memory::<f32>::zeroed(usize::MAX)
            });
        }));
        assert!(panic.unwrap_err().is::<OutOfMemory>());
        assert!(reserve.free.is_empty() && SERVING.with_borrow(Option::is_none));
    }

    #[test]
    fn memory_from_elsewhere_does_not_pile_up() {
        let mut reserve = Reserve::default();
        let before = Memory::<f32>::zeroed(10);
        let kept = reserve.serve(|| {
            drop(before);
            Memory::<f32>::zeroed(10)
        });
        drop(kept);
        assert!(reserve.free.is_empty());
    }
}
