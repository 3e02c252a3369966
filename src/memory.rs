//! The memory of images, which a pipeline hands from frame to frame.
//!
//! Memory that is fresh from the system comes in pages that it has to find and to clear, which takes longer than several
//! passes over them. While a [`Reserve`] serves, images take what earlier ones have left.

use std::any::Any;
use std::cell::RefCell;
use std::ops::{Deref, DerefMut};

thread_local! {
    static SERVING: RefCell<Option<Reserve>> = const { RefCell::new(None) };
}

/// What is free, each a `Vec` of numbers of some type.
#[derive(Default)]
pub struct Reserve {
    free: Vec<Box<dyn Any + Send + Sync>>,
}

impl Reserve {
    /// Does some work whose images are made of this memory, and leave theirs behind.
    pub fn serve<R>(&mut self, work: impl FnOnce() -> R) -> R {
        SERVING.set(Some(std::mem::take(self)));
        let result = work();
        *self = SERVING.take().unwrap_or_default();
        result
    }

    /// The smallest piece that is large enough, unless it is far too large.
    fn take<T: 'static>(&mut self, len: usize) -> Option<Vec<T>> {
        let fits = |piece: &Box<dyn Any + Send + Sync>| {
            let capacity = piece.downcast_ref::<Vec<T>>()?.capacity();
            (len..=len + len / 4)
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

/// So many numbers.
#[derive(Debug)]
pub struct Memory<T: Send + Sync + 'static> {
    data: Vec<T>,
    /// Whether it was made where a reserve served, to which it then returns: others would only pile up there.
    returns: bool,
}

impl<T: Copy + Default + Send + Sync> Memory<T> {
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
            let data = match piece {
                Some(mut data) => {
                    data.resize(len, T::default());
                    clear(&mut data);
                    data
                }
                None => vec![T::default(); len],
            };
            Self {
                data,
                returns: reserve.is_some(),
            }
        })
    }

    pub fn into_vec(mut self) -> Vec<T> {
        std::mem::take(&mut self.data)
    }
}

impl<T: Copy + Default + Send + Sync> From<&[T]> for Memory<T> {
    fn from(data: &[T]) -> Self {
        let mut copy = Self::left(data.len());
        copy.copy_from_slice(data);
        copy
    }
}

impl<T: Copy + Default + Send + Sync> Clone for Memory<T> {
    fn clone(&self) -> Self {
        Self::from(&**self)
    }
}

impl<T: Send + Sync> Deref for Memory<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.data
    }
}

impl<T: Send + Sync> DerefMut for Memory<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.data
    }
}

impl<T: Send + Sync + 'static> Drop for Memory<T> {
    fn drop(&mut self) {
        if self.returns && self.data.capacity() > 0 {
            let data = std::mem::take(&mut self.data);
            SERVING.with_borrow_mut(|reserve| {
                if let Some(reserve) = reserve {
                    reserve.free.push(Box::new(data));
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
