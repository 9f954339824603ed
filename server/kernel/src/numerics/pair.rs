//! Two computations side by side.
//!
//! A factorisation gains nothing from a second thread (measured), two of them at once do. The second thread lives only as
//! long as the call, and does not take up other work while it waits, as a pool's would: a caller may hold what that
//! work needs. Where other jobs, or other halves, keep all cores busy, there is none: it would only wait.

use super::stop;
use std::cell::Cell;
use std::sync::OnceLock;

/// Items of a microsecond each from which on a second thread is worth while: it starts some 100 µs late, and on a virtual machine
/// two halves of 200 µs each take as long as both on one thread (tests/records/threads-2026-11-28.md).
const MANY: usize = 1024;

thread_local! {
    static GOES_FIRST: Cell<bool> = const { Cell::new(false) };
}

/// Gives second halves of what this thread computes threads of their own from now on, though all cores compute: for a thread that the
/// system lets go before the others, and its second threads with it.
pub fn go_first() {
    GOES_FIRST.set(true);
}

/// Runs both, the second on a thread of its own where one can be had and a core is free, and returns both results; each is the same
/// whatever thread it ran on. The second is interrupted as the caller is, and its steps are counted as the caller's. A panic of
/// either goes on in the caller.
pub fn side_by_side<A, B: Send>(first: impl FnOnce() -> A, second: impl Fn() -> B + Sync) -> (A, B) {
    if stop::computing() >= cores() && !GOES_FIRST.get() {
        return (first(), second());
    }
    let ask = stop::asked();
    let apart = || {
        let before = stop::steps();
        let b = stop::asking(ask.clone(), &second);
        (b, stop::steps() - before)
    };
    std::thread::scope(|scope| {
        let other = std::thread::Builder::new().spawn_scoped(scope, apart);
        let a = first();
        let b = match other.map(std::thread::ScopedJoinHandle::join) {
            Ok(Ok((b, steps))) => {
                stop::count(steps);
                b
            }
            Ok(Err(panic)) => std::panic::resume_unwind(panic),
            Err(_) => second(),
        };
        (a, b)
    })
}

/// Cores that the process may use.
fn cores() -> usize {
    static CORES: OnceLock<usize> = OnceLock::new();
    *CORES.get_or_init(|| std::thread::available_parallelism().map_or(1, usize::from))
}

/// Computes a value of each item, of the second half of them on another thread, and returns the values in the items' order.
pub fn in_halves<'a, T: Sync, R: Send>(items: &'a [T], of: impl Fn(&'a T) -> R + Sync) -> Vec<R> {
    let all = |some: &'a [T]| some.iter().map(&of).collect::<Vec<R>>();
    let (some, others) = items.split_at(items.len().div_ceil(2));
    if others.is_empty() {
        return all(some);
    }
    let (mut found, others) = side_by_side(|| all(some), || all(others));
    found.extend(others);
    found
}

/// The same for items that take a microsecond or so each: few are computed on the caller's thread.
pub fn many_in_halves<'a, T: Sync, R: Send>(items: &'a [T], of: impl Fn(&'a T) -> R + Sync) -> Vec<R> {
    if items.len() < MANY { items.iter().map(of).collect() } else { in_halves(items, of) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_results_come_back_in_their_places() {
        let words = [String::from("u"), String::from("v")];
        let lengths = side_by_side(|| words[0].len() + 1, || words[1].clone());
        assert_eq!(lengths, (2, "v".to_owned()));
    }

    #[test]
    fn values_come_back_in_the_order_of_the_items() {
        for count in [0usize, 1, 2, 5, MANY - 1, MANY] {
            let items: Vec<usize> = (0..count).collect();
            assert_eq!(in_halves(&items, |k| k + 1), (1..=count).collect::<Vec<_>>());
            assert_eq!(many_in_halves(&items, |k| k + 1), (1..=count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_second_is_interrupted_as_the_caller_is_and_its_steps_count() {
        let before = stop::steps();
        side_by_side(|| (0..3).for_each(|_| stop::poll()), || (0..4).for_each(|_| stop::poll()));
        assert_eq!(stop::steps() - before, 7);
        let ask: stop::Ask = std::sync::Arc::new(|| std::panic::resume_unwind(Box::new("enough")));
        let both = std::panic::AssertUnwindSafe(|| stop::within(ask, || side_by_side(|| 1, stop::ask)));
        let caught = std::panic::catch_unwind(both);
        assert_eq!(caught.err().and_then(|p| p.downcast_ref::<&str>().copied()), Some("enough"));
    }

    /// Runs `work` while so many threads compute, or more.
    fn among(computing: usize, work: fn() -> bool) -> bool {
        if computing == 0 {
            return work();
        }
        stop::within(std::sync::Arc::new(|| ()), || among(computing - 1, work))
    }

    #[test]
    fn where_all_cores_compute_both_run_on_one_thread_unless_it_goes_first() {
        let is_one_thread = || {
            let id = || std::thread::current().id();
            let (one, two) = side_by_side(id, id);
            one == two
        };
        assert!(among(cores(), is_one_thread));
        let first = std::thread::spawn(move || {
            go_first();
            among(cores(), is_one_thread)
        });
        assert!(!first.join().expect("it ends"));
    }

    #[test]
    fn a_panic_of_the_second_reaches_the_caller() {
        let caught = std::panic::catch_unwind(|| side_by_side(|| 1, || std::panic::panic_any("singular")));
        assert_eq!(caught.err().and_then(|p| p.downcast_ref::<&str>().copied()), Some("singular"));
    }
}
