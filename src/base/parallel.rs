//! Work spread over all cores, on rayon.
//!
//! What is generic is compiled again at each use, and each of rayon's chains becomes some ten large functions. Here rayon sees nothing but
//! numbers: what is generic is the little around it that gives threads their parts of the elements, and closures are `dyn`. A call of such a
//! closure takes some nanoseconds: loops that take no longer for each element belong within the closure of [`for_each_chunk`].

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Enough parts for each thread that none is idle for long at the end, though some parts take longer than others.
const PARTS_PER_THREAD: usize = 64;

/// The number of elements in a part, but for the last, of `count` elements.
fn part_size(count: usize) -> usize {
    count.div_ceil(PARTS_PER_THREAD * rayon::current_num_threads()).max(1)
}

/// `of(0)`, `of(1)` and so on, `count` in all, in this order.
pub fn collect<T: Send>(count: usize, of: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    let size = part_size(count);
    let mut parts: Vec<Vec<T>> = (0..count.div_ceil(size)).map(|_| Vec::new()).collect();
    for_each_chunk(&mut parts, 1, &|index, part| {
        part[0] = (size * index..count.min(size * (index + 1))).map(of).collect();
    });
    let mut all = Vec::with_capacity(count);
    for mut part in parts {
        all.append(&mut part);
    }
    all
}

/// What becomes of each item, in their order.
pub fn map<I: Sync, T: Send>(items: &[I], of: &(dyn Fn(&I) -> T + Sync)) -> Vec<T> {
    collect(items.len(), &|index| of(&items[index]))
}

/// What becomes of each `size` items in a row, in their order; the last ones may be fewer.
pub fn map_chunks<I: Sync, T: Send>(items: &[I], size: usize, of: &(dyn Fn(&[I]) -> T + Sync)) -> Vec<T> {
    let chunk = |index: usize| &items[size * index..items.len().min(size * (index + 1))];
    collect(items.len().div_ceil(size), &|index| of(chunk(index)))
}

/// What becomes of each `size` items in a row, in their order; the last ones may be fewer. `of` gets their number among these chunks, and may
/// change them.
pub fn map_chunks_mut<I: Send, T: Send>(
    items: &mut [I],
    size: usize,
    of: &(dyn Fn(usize, &mut [I]) -> T + Sync),
) -> Vec<T> {
    let chunks = chunks(items, size);
    collect(chunks.len(), &|index| of(index, taken(&chunks[index])))
}

/// The numbers below `count` that are wanted, in ascending order.
pub fn filter(count: usize, is_wanted: &(dyn Fn(usize) -> bool + Sync)) -> Vec<usize> {
    (0..count).into_par_iter().filter(|&index| is_wanted(index)).collect()
}

/// Does something for each number below `count`.
pub fn for_each(count: usize, of: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(of);
}

/// Does something with each item and its index.
pub fn for_each_mut<T: Send>(items: &mut [T], of: &(dyn Fn(usize, &mut T) + Sync)) {
    let size = part_size(items.len());
    for_each_chunk(items, size, &|part, items| {
        for (index, item) in items.iter_mut().enumerate() {
            of(size * part + index, item);
        }
    });
}

/// Does something with each `size` items in a row and their number among these chunks; the last ones may be fewer.
pub fn for_each_chunk<T: Send>(items: &mut [T], size: usize, of: &(dyn Fn(usize, &mut [T]) + Sync)) {
    let chunks = chunks(items, size);
    for_each(chunks.len(), &|index| of(index, taken(&chunks[index])));
}

/// Chunks for threads to take.
fn chunks<T>(items: &mut [T], size: usize) -> Vec<Mutex<&mut [T]>> {
    items.chunks_mut(size).map(Mutex::new).collect()
}

/// A chunk, of which nothing is left for other threads.
fn taken<'a, T>(chunk: &Mutex<&'a mut [T]>) -> &'a mut [T] {
    // Nothing else runs while it is locked, so that no panic can poison it.
    std::mem::take(&mut *chunk.lock().unwrap_or_else(PoisonError::into_inner))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    use super::*;

    /// More than one thread takes at once.
    const COUNT: usize = 1000;

    #[test]
    fn collects_in_order() {
        assert_eq!(collect(COUNT, &|index| 3 * index), (0..COUNT).map(|index| 3 * index).collect::<Vec<_>>());
        assert!(collect(0, &|index| index).is_empty());
    }

    #[test]
    fn maps_in_order() {
        let words: Vec<String> = (0..COUNT).map(|index| index.to_string()).collect();
        assert_eq!(map(&words, &|word| word.parse().ok()), (0..COUNT).map(Some).collect::<Vec<_>>());
    }

    #[test]
    fn maps_chunks_in_order() {
        let items: Vec<usize> = (0..COUNT).collect();
        for size in [1, 7, COUNT, 2 * COUNT] {
            let chunks: Vec<Vec<usize>> = items.chunks(size).map(<[_]>::to_vec).collect();
            assert_eq!(map_chunks(&items, size, &<[_]>::to_vec), chunks);
        }
        assert!(map_chunks(&[0; 0], 4, &<[_]>::len).is_empty());
    }

    #[test]
    fn filters_in_order() {
        let wanted: Vec<usize> = (0..COUNT).filter(|index| index % 3 == 1).collect();
        assert_eq!(filter(COUNT, &|index| index % 3 == 1), wanted);
    }

    #[test]
    fn does_each_once() {
        let counts: Vec<AtomicUsize> = (0..COUNT).map(AtomicUsize::new).collect();
        for_each(COUNT, &|index| {
            counts[index].fetch_add(1, Relaxed);
        });
        let counts = counts.into_iter().map(AtomicUsize::into_inner);
        assert!(counts.eq(1..=COUNT));
    }

    #[test]
    fn changes_each_item() {
        let mut items: Vec<usize> = (0..COUNT).collect();
        for_each_mut(&mut items, &|index, item| *item += index);
        assert!(items.into_iter().eq((0..COUNT).map(|index| 2 * index)));
    }

    #[test]
    fn changes_each_chunk() {
        let mut items = vec![(0, 0); COUNT];
        for_each_chunk(&mut items, 7, &|number, chunk| {
            let length = chunk.len();
            chunk.fill((number, length));
        });
        let chunks = items.chunks(7).enumerate();
        assert!(chunks.into_iter().all(|(number, chunk)| chunk.iter().all(|item| *item == (number, chunk.len()))));
        let ends = map_chunks_mut(&mut items, 9, &|number, chunk| {
            chunk[0].0 = COUNT;
            (number, chunk.len())
        });
        assert_eq!(ends, items.chunks(9).map(<[_]>::len).enumerate().collect::<Vec<_>>());
        assert!(items.iter().enumerate().all(|(index, item)| (item.0 == COUNT) == (index % 9 == 0)));
    }
}
