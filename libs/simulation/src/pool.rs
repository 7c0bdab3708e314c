//! Thread pool that returns its results in order.

use anyhow::{Context, Result};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::channel;

/// Runs `count` jobs on `jobs` threads and passes each result to `consume`, in order, as soon as it is complete.
///
/// Once `stop` is set, no new job starts. A job returns `None` if it was interrupted; later results are dropped, so
/// that the consumed results always are the first ones. Returns the number of consumed results.
///
/// # Errors
/// If a thread cannot be started, or the first error of `consume`, which stops the rest.
pub fn in_order<T: Send>(
    count: usize,
    jobs: usize,
    stop: &AtomicBool,
    work: impl Fn(usize) -> Option<T> + Sync,
    mut consume: impl FnMut(usize, T) -> Result<()>,
) -> Result<usize> {
    let next = AtomicUsize::new(0);
    let (next, work) = (&next, &work);
    std::thread::scope(|scope| {
        let (sender, results) = channel();
        let mut failed = Ok(());
        for _ in 0..jobs.min(count) {
            let sender = sender.clone();
            let started = std::thread::Builder::new().name("hapfic-simulate".to_owned()).spawn_scoped(scope, move || {
                while !stop.load(Ordering::Relaxed) {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        break;
                    }
                    let Some(result) = work(index) else { break };
                    if sender.send((index, result)).is_err() {
                        break;
                    }
                }
            });
            if let Err(e) = started {
                stop.store(true, Ordering::Relaxed);
                failed = Err(e).context("cannot start a thread for the simulations");
                break;
            }
        }
        drop(sender);
        failed?;
        let (mut waiting, mut consumed) = (BTreeMap::new(), 0);
        for (index, result) in results {
            waiting.insert(index, result);
            while let Some(result) = waiting.remove(&consumed) {
                if let Err(e) = consume(consumed, result) {
                    stop.store(true, Ordering::Relaxed);
                    return Err(e);
                }
                consumed += 1;
            }
        }
        Ok(consumed)
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn pool_any_thread_count_keeps_order() {
        for jobs in [1, 2, 7, 100] {
            let mut all = Vec::new();
            // Later jobs finish earlier.
            let work = |index: usize| {
                std::thread::sleep(std::time::Duration::from_micros(200 * (20 - index as u64)));
                Some(index * index)
            };
            let consumed = in_order(20, jobs, &AtomicBool::new(false), work, |index, result| {
                all.push((index, result));
                Ok(())
            });
            assert_eq!(consumed.unwrap(), 20);
            assert_eq!(all, (0..20).map(|index| (index, index * index)).collect::<Vec<_>>(), "{jobs} threads");
        }
    }

    #[test]
    fn pool_interrupted_job_ends_results() {
        let stop = AtomicBool::new(false);
        let work = |index: usize| {
            if index == 5 {
                stop.store(true, Ordering::Relaxed);
                return None;
            }
            Some(index)
        };
        let mut all = Vec::new();
        let consumed = in_order(1000, 3, &stop, work, |index, _| {
            all.push(index);
            Ok(())
        });
        assert_eq!((consumed.unwrap(), all), (5, vec![0, 1, 2, 3, 4]));
    }

    #[test]
    fn pool_consumer_error_stops_rest() {
        let (stop, done) = (AtomicBool::new(false), AtomicUsize::new(0));
        let work = |index: usize| {
            // Blocks later jobs until the error.
            while index > 10 && !stop.load(Ordering::Relaxed) {
                std::thread::yield_now();
            }
            Some(done.fetch_add(1, Ordering::Relaxed))
        };
        let error = in_order(1_000_000, 2, &stop, work, |index, _| match index {
            3 => anyhow::bail!("the disk is full"),
            _ => Ok(()),
        });
        assert_eq!(error.unwrap_err().to_string(), "the disk is full");
        assert!(stop.load(Ordering::Relaxed) && done.load(Ordering::Relaxed) < 100);
    }
}
