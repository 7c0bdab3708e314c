//! Work on many threads whose results come in order.

use anyhow::{Context, Result};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::channel;

/// Does `count` pieces of work on `jobs` threads, and gives each result on as soon as all before it have been given.
///
/// Once `stop` is set no new piece is begun, and work that gives `None` was not done to its end: what comes behind it is given
/// no more. So what was given is always a beginning of the whole. Returns how many were given.
///
/// # Errors
/// If a thread cannot be started, or the first error of `give`, which stops the rest.
pub fn in_order<T: Send>(
    count: usize,
    jobs: usize,
    stop: &AtomicBool,
    work: impl Fn(usize) -> Option<T> + Sync,
    mut give: impl FnMut(usize, T) -> Result<()>,
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
                    let place = next.fetch_add(1, Ordering::Relaxed);
                    if place >= count {
                        break;
                    }
                    let Some(result) = work(place) else { break };
                    if sender.send((place, result)).is_err() {
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
        let (mut waiting, mut given) = (BTreeMap::new(), 0);
        for (place, result) in results {
            waiting.insert(place, result);
            while let Some(result) = waiting.remove(&given) {
                if let Err(e) = give(given, result) {
                    stop.store(true, Ordering::Relaxed);
                    return Err(e);
                }
                given += 1;
            }
        }
        Ok(given)
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_order_whatever_the_number_of_threads() {
        for jobs in [1, 2, 7, 100] {
            let mut all = Vec::new();
            // The later the sooner.
            let work = |place: usize| {
                std::thread::sleep(std::time::Duration::from_micros(200 * (20 - place as u64)));
                Some(place * place)
            };
            let given = in_order(20, jobs, &AtomicBool::new(false), work, |place, result| {
                all.push((place, result));
                Ok(())
            });
            assert_eq!(given.unwrap(), 20);
            assert_eq!(all, (0..20).map(|place| (place, place * place)).collect::<Vec<_>>(), "{jobs} threads");
        }
    }

    #[test]
    fn work_that_was_stopped_ends_what_is_given() {
        let stop = AtomicBool::new(false);
        let work = |place: usize| {
            if place == 5 {
                stop.store(true, Ordering::Relaxed);
                return None;
            }
            Some(place)
        };
        let mut all = Vec::new();
        let given = in_order(1000, 3, &stop, work, |place, _| {
            all.push(place);
            Ok(())
        });
        assert_eq!((given.unwrap(), all), (5, vec![0, 1, 2, 3, 4]));
    }

    #[test]
    fn an_error_of_the_one_who_is_given_stops_the_rest() {
        let (stop, done) = (AtomicBool::new(false), AtomicUsize::new(0));
        let work = |place: usize| {
            // However fast they are, they are not done before the error.
            while place > 10 && !stop.load(Ordering::Relaxed) {
                std::thread::yield_now();
            }
            Some(done.fetch_add(1, Ordering::Relaxed))
        };
        let error = in_order(1_000_000, 2, &stop, work, |place, _| match place {
            3 => anyhow::bail!("the disk is full"),
            _ => Ok(()),
        });
        assert_eq!(error.unwrap_err().to_string(), "the disk is full");
        assert!(stop.load(Ordering::Relaxed) && done.load(Ordering::Relaxed) < 100);
    }
}
