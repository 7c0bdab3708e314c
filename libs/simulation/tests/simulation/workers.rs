//! Runs many seeds on two cores.

use std::sync::atomic::{AtomicU64, Ordering};

/// Number of cores of the smallest test machine.
const WORKERS: usize = 2;

/// Results of `work` for the seeds from 0 to `count - 1`, in the order of the seeds.
pub fn for_each_seed<T: Send>(count: u64, work: impl Fn(u64) -> T + Sync) -> Vec<T> {
    let next = AtomicU64::new(0);
    let (next, work) = (&next, &work);
    let mut done: Vec<(u64, T)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..WORKERS)
            .map(|_| {
                scope.spawn(move || {
                    let mut own = Vec::new();
                    loop {
                        let seed = next.fetch_add(1, Ordering::Relaxed);
                        if seed >= count {
                            return own;
                        }
                        own.push((seed, work(seed)));
                    }
                })
            })
            .collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
    });
    done.sort_by_key(|(seed, _)| *seed);
    done.into_iter().map(|(_, result)| result).collect()
}
