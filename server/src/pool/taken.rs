//! How much memory a quantum has taken, as the allocator counts it for its thread, and how much the process has.
//!
//! Jobs are admitted by estimates. One that is wrong by far costs others nothing if the quantum ends that it is wrong for:
//! its stop flag says so as soon as the thread has taken [`TIMES`] the estimate and [`BESIDE_BYTES`] beside it. What was
//! freed on another thread than it was taken on is counted wrongly; quanta are sequential, so little is. Where the process as
//! a whole has more than it promised, less is enough: whoever has taken more than was admitted ends.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tikv_jemalloc_ctl::{epoch, stats, thread};

/// An estimate may be too low by this factor.
const TIMES: u64 = 4;
/// And by so many bytes beside.
const BESIDE_BYTES: u64 = 384 << 20;

/// While memory is short an estimate may be too low by so many bytes.
const BESIDE_WHEN_SHORT_BYTES: u64 = 32 << 20;

/// Beside five quarters of the limit so many bytes may be taken before memory is short; what is promised is 256 MiB beside it, of
/// which the allocator's own and what is taken until somebody looks are a part.
const BESIDE_LIMIT_BYTES: u64 = 96 << 20;

/// The least and the longest time between two looks whether memory is short. A look costs a millisecond of processor time.
const LOOK_AFTER: (Duration, Duration) = (Duration::from_millis(25), Duration::from_millis(500));
/// Nobody takes so many bytes a second: until what is left could be taken, nobody needs to look. Two cores that fill fresh
/// memory take half as much.
const TAKEN_PER_S: f64 = (4u64 << 30) as f64;

/// The process has taken more than it promised.
static IS_SHORT: AtomicBool = AtomicBool::new(false);

thread_local! {
    static COUNTERS: Option<(thread::ThreadLocal<u64>, thread::ThreadLocal<u64>)> =
        thread::allocatedp::read().ok().zip(thread::deallocatedp::read().ok());
    static BUDGET: Cell<Option<Budget>> = const { Cell::new(None) };
}

/// The memory that a quantum may take.
#[derive(Clone, Copy)]
struct Budget {
    /// Its thread had taken so many bytes when it began.
    before: i64,
    /// It may have taken so many bytes since.
    most: i64,
    /// The same while memory is short.
    most_when_short: i64,
}

/// What this thread has taken and not given back, in bytes; may be negative, where it freed what others took.
fn taken_bytes() -> i64 {
    COUNTERS.with(|counters| {
        let counted = |(taken, freed): &(thread::ThreadLocal<u64>, thread::ThreadLocal<u64>)| {
            taken.get().wrapping_sub(freed.get()).cast_signed()
        };
        counters.as_ref().map_or(0, counted)
    })
}

/// Takes the budget back when it is dropped, also where the quantum unwinds.
struct BudgetGuard;

impl Drop for BudgetGuard {
    fn drop(&mut self) {
        BUDGET.set(None);
    }
}

/// Runs a quantum that was admitted with an estimate.
pub fn within<T>(estimate_bytes: u64, quantum: impl FnOnce() -> T) -> T {
    let signed = |bytes: u64| i64::try_from(bytes).unwrap_or(i64::MAX);
    let most = signed(estimate_bytes.saturating_mul(TIMES).saturating_add(BESIDE_BYTES));
    let most_when_short = signed(estimate_bytes.saturating_add(BESIDE_WHEN_SHORT_BYTES));
    BUDGET.set(Some(Budget { before: taken_bytes(), most, most_when_short }));
    let _ended = BudgetGuard;
    quantum()
}

/// Whether this thread's quantum has taken far more than it was admitted with.
pub fn is_too_much() -> bool {
    is_too_much_when(IS_SHORT.load(Ordering::Relaxed))
}

fn is_too_much_when(is_short: bool) -> bool {
    BUDGET.get().is_some_and(|budget| {
        let most = if is_short { budget.most_when_short } else { budget.most };
        taken_bytes().saturating_sub(budget.before) > most
    })
}

/// Looks again and again whether the process has taken more than goes with `limit_bytes`; never ends.
pub async fn watch(limit_bytes: u64) {
    let most = limit_bytes.saturating_add(limit_bytes / 4).saturating_add(BESIDE_LIMIT_BYTES);
    loop {
        let allocated = of_process().allocated;
        IS_SHORT.store(allocated > most, Ordering::Relaxed);
        tokio::time::sleep(look_after(most.saturating_sub(allocated))).await;
    }
}

/// When to look again while so many bytes are left.
fn look_after(left: u64) -> Duration {
    Duration::from_secs_f64(left as f64 / TAKEN_PER_S).clamp(LOOK_AFTER.0, LOOK_AFTER.1)
}

/// Memory of the process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProcessMemory {
    /// Taken and not given back, in bytes.
    pub allocated: u64,
    /// Held by the allocator in memory, in bytes.
    pub resident: u64,
}

/// What the process has, as the allocator counts it.
pub fn of_process() -> ProcessMemory {
    // The counts are as of the last time that they were asked to be brought up to date.
    let read = || -> tikv_jemalloc_ctl::Result<ProcessMemory> {
        epoch::advance()?;
        Ok(ProcessMemory { allocated: stats::allocated::read()? as u64, resident: stats::resident::read()? as u64 })
    };
    read().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantum_may_take_less_beyond_its_estimate_while_memory_is_short() {
        let taken = |bytes: usize| {
            within(1 << 20, || {
                let _held = std::hint::black_box(vec![1u8; bytes]);
                [false, true].map(is_too_much_when)
            })
        };
        assert_eq!(taken(8 << 20), [false, false]);
        assert_eq!(taken(64 << 20), [false, true]);
        assert!(!is_too_much_when(true), "nothing runs");
    }

    #[test]
    fn memory_is_looked_at_before_what_is_left_could_be_taken() {
        assert_eq!([look_after(0), look_after(64 << 20)], [LOOK_AFTER.0; 2]);
        assert_eq!(look_after(1 << 30), Duration::from_millis(250));
        assert_eq!(look_after(64 << 30), LOOK_AFTER.1);
    }
}
