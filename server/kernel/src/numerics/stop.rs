//! How a computation is interrupted, and how much of it was done.
//!
//! Whoever starts a computation gives it something to ask ([`within`]); the computation asks it now and then ([`poll`]),
//! where a piece of work of some microseconds begins: a search for the nearest triangle, a solve, a round of smoothing.
//! What is asked ends the computation by unwinding, so that no function between has to hand an error on. Without it
//! nothing happens, and a poll costs a few nanoseconds.
//!
//! The polls of a thread are counted ([`steps`]): a measure of work that is the same on every machine, where time is not.

use std::cell::{Cell, RefCell};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Asked now and then, on any thread, by what takes long: true once it is to stop. Once true it stays so.
pub type Stop<'a> = &'a (dyn Fn() -> bool + Sync);

/// What a poll asks: it returns, or unwinds.
pub type Ask = Arc<dyn Fn() + Send + Sync>;

/// A poll asks once in so many.
const ASK_EVERY: u64 = 16;

/// Passing asks once in so many elements; at some ten to a hundred nanoseconds each, within a fraction of a millisecond.
const PASS_EVERY: u64 = 4096;

thread_local! {
    static ASK: RefCell<Option<Ask>> = const { RefCell::new(None) };
    static STEPS: Cell<u64> = const { Cell::new(0) };
    static PASSED: Cell<u64> = const { Cell::new(0) };
}

/// Threads that run a computation now.
static COMPUTING: AtomicUsize = AtomicUsize::new(0);

/// Puts back what was asked before when it is dropped, also when the computation unwinds.
struct RestoreOnDrop(Option<Ask>);

impl Drop for RestoreOnDrop {
    fn drop(&mut self) {
        COMPUTING.fetch_sub(1, Ordering::Relaxed);
        ASK.with(|now| *now.borrow_mut() = self.0.take());
    }
}

/// Runs a computation whose polls, on this thread, ask `ask`.
pub fn within<T>(ask: Ask, work: impl FnOnce() -> T) -> T {
    asking(Some(ask), work)
}

/// Runs a computation whose polls, on this thread, ask what those of another thread ask, as [`asked`] there.
pub(super) fn asking<T>(ask: Option<Ask>, work: impl FnOnce() -> T) -> T {
    COMPUTING.fetch_add(1, Ordering::Relaxed);
    let _before = RestoreOnDrop(ASK.with(|now| std::mem::replace(&mut *now.borrow_mut(), ask)));
    work()
}

/// How many threads run a computation now, here and in all other jobs.
pub(super) fn computing() -> usize {
    COMPUTING.load(Ordering::Relaxed)
}

/// Returns what the polls of this thread ask.
pub(super) fn asked() -> Option<Ask> {
    ASK.with(|now| now.borrow().clone())
}

/// Asks whether to go on; unwinds if not.
#[inline]
pub fn poll() {
    let steps = STEPS.get().wrapping_add(1);
    STEPS.set(steps);
    if steps.is_multiple_of(ASK_EVERY) {
        ask();
    }
}

/// Counts steps that another thread made for this one, and asks whether to go on.
pub fn count(steps: u64) {
    STEPS.set(STEPS.get().wrapping_add(steps));
    ask();
}

/// Asks whether to go on once in a while as a pass over many elements comes by so many of them. Counts no steps: how much
/// work is allowed does not depend on where passes are interrupted.
#[inline]
pub fn pass(elements: usize) {
    let passed = PASSED.get() + elements as u64;
    if passed < PASS_EVERY {
        PASSED.set(passed);
    } else {
        PASSED.set(0);
        ask();
    }
}

/// Asks at once: before what takes long by itself.
pub fn ask() {
    // Cloned, so that nothing is borrowed while it unwinds.
    if let Some(ask) = asked() {
        ask();
    }
}

/// The polls of this thread so far; differences tell how much work was done.
pub fn steps() -> u64 {
    STEPS.get()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn a_computation_that_polls_is_interrupted_and_the_next_is_not() {
        let asked = AtomicU64::new(0);
        let ask: Ask = Arc::new(move || {
            if asked.fetch_add(1, Ordering::Relaxed) == 2 {
                resume_unwind(Box::new("enough"));
            }
        });
        let mut polls = 0u64;
        let endless = || loop {
            polls += 1;
            poll();
        };
        let ended = catch_unwind(AssertUnwindSafe(|| within(ask, endless)));
        let words: Result<(), _> = ended;
        assert_eq!(words.err().and_then(|words| words.downcast_ref::<&str>().copied()), Some("enough"));
        assert!((2 * ASK_EVERY..=3 * ASK_EVERY).contains(&polls), "{polls}");
        (0..1000).for_each(|_| poll());
    }

    #[test]
    fn a_pass_is_interrupted_too() {
        let mut passed = 0;
        let ask: Ask = Arc::new(|| resume_unwind(Box::new(())));
        let endless = || loop {
            passed += 1;
            pass(1);
        };
        let ended: Result<(), _> = catch_unwind(AssertUnwindSafe(|| within(ask, endless)));
        assert!(ended.is_err() && passed <= PASS_EVERY, "{passed}");
    }

    #[test]
    fn steps_count_the_polls_of_this_thread() {
        let before = steps();
        (0..100).for_each(|_| poll());
        pass(1_000_000);
        std::thread::spawn(|| (0..100).for_each(|_| poll())).join().expect("it ends");
        assert_eq!(steps() - before, 100);
    }

    #[test]
    fn what_was_asked_before_is_asked_again_after() {
        let asked = Arc::new(AtomicU64::new(0));
        let adds = |more: u64| -> Ask {
            let asked = Arc::clone(&asked);
            Arc::new(move || {
                asked.fetch_add(more, Ordering::Relaxed);
            })
        };
        within(adds(1), || {
            within(adds(100), ask);
            ask();
        });
        ask();
        assert_eq!(asked.load(Ordering::Relaxed), 101);
    }
}
