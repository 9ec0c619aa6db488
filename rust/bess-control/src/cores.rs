//! Independent work on all cores. Results are in the order of the items, so that they are the same for any number of threads.
//!
//! Each call starts its own threads. A thread pool, as in rayon, would not survive the fork that starts workers in Python's
//! multiprocessing.

use std::cell::Cell;
use std::sync::{Mutex, OnceLock};

thread_local! {
    /// Whether the thread is working on an item: nested calls stay on it.
    static IS_WORKER: Cell<bool> = const { Cell::new(false) };
}

/// Marks its thread as a worker until it is dropped, also by a panic.
struct Worker;

impl Worker {
    fn begin() -> Self {
        IS_WORKER.set(true);
        Self
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        IS_WORKER.set(false);
    }
}

/// Maximum number of threads: `OMP_NUM_THREADS` if set, or the cores that the process may use.
fn max_threads() -> usize {
    static CORES: OnceLock<usize> = OnceLock::new();
    let wanted = std::env::var("OMP_NUM_THREADS").ok();
    // OpenMP allows a list with one number for each level of nesting.
    let wanted = wanted.and_then(|n| n.split(',').next()?.trim().parse().ok()).filter(|n| *n > 0);
    wanted.unwrap_or_else(|| {
        *CORES.get_or_init(|| std::thread::available_parallelism().map_or(1, std::num::NonZero::get))
    })
}

/// Number of threads that [`map`] uses for so many items, at least one.
pub(crate) fn threads(items: usize) -> usize {
    if IS_WORKER.get() {
        1
    } else {
        max_threads().min(items).max(1)
    }
}

/// Results of `of` for every item, in order.
pub(crate) fn map<I: Send, T: Send>(items: Vec<I>, of: impl Fn(I) -> T + Sync) -> Vec<T> {
    let n_threads = threads(items.len());
    if n_threads < 2 {
        return items.into_iter().map(of).collect();
    }
    let mut results: Vec<Option<T>> = items.iter().map(|_| None).collect();
    let queue = Mutex::new(items.into_iter().enumerate());
    let take = || queue.lock().ok()?.next();
    let work = || {
        let _worker = Worker::begin();
        std::iter::from_fn(take).map(|(index, item)| (index, of(item))).collect::<Vec<(usize, T)>>()
    };
    std::thread::scope(|scope| {
        let others: Vec<_> = (1..n_threads).map(|_| scope.spawn(work)).collect();
        let mut done = work();
        for other in others {
            done.extend(other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        }
        done.into_iter().for_each(|(index, result)| results[index] = Some(result));
    });
    results.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_order_and_nested_calls_stay_on_their_thread() {
        let squares = |n: usize| map((0..n).collect(), |i| i * i);
        let rows = map((0..50).collect(), |i| (std::thread::current().id(), squares(i)));
        assert!(rows
            .iter()
            .enumerate()
            .all(|(i, (_, row))| *row == (0..i).map(|k| k * k).collect::<Vec<_>>()));
        assert_eq!(
            map(vec![(); 9], |()| map(vec![(); 3], |()| std::thread::current().id()))
                .iter()
                .filter(|ids| ids.windows(2).any(|pair| pair[0] != pair[1]))
                .count(),
            0
        );
    }

    #[test]
    fn a_thread_is_free_again_after_a_panic() {
        let panics = || map(vec![(); 4], |()| panic!("of an item"));
        assert!(std::panic::catch_unwind(panics).is_err());
        assert!(!IS_WORKER.get());
    }
}
