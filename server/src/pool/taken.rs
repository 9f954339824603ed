//! How much memory a quantum has taken, as the allocator counts it for its thread, and how much the process has.
//!
//! Jobs are admitted by estimates. One that is wrong by far costs others nothing if the quantum ends that it is wrong for:
//! its stop flag says so as soon as the thread has taken [`TIMES`] the estimate and [`BESIDE_BYTES`] beside it. What was
//! freed on another thread than it was taken on is counted wrongly; quanta are sequential, so little is.

use std::cell::Cell;
use tikv_jemalloc_ctl::{epoch, stats, thread};

/// An estimate may be too low by this factor.
const TIMES: u64 = 4;
/// And by so many bytes beside.
const BESIDE_BYTES: u64 = 384 << 20;

thread_local! {
    static COUNTERS: Option<(thread::ThreadLocal<u64>, thread::ThreadLocal<u64>)> =
        thread::allocatedp::read().ok().zip(thread::deallocatedp::read().ok());
    /// What the thread had taken when its quantum began, and what it may have taken.
    static BUDGET: Cell<Option<(i64, i64)>> = const { Cell::new(None) };
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

/// Takes the budget back, also where the quantum unwinds.
struct Ended;

impl Drop for Ended {
    fn drop(&mut self) {
        BUDGET.set(None);
    }
}

/// Runs a quantum that was admitted with an estimate.
pub fn within<T>(estimate_bytes: u64, quantum: impl FnOnce() -> T) -> T {
    let most = estimate_bytes.saturating_mul(TIMES).saturating_add(BESIDE_BYTES);
    BUDGET.set(Some((taken_bytes(), i64::try_from(most).unwrap_or(i64::MAX))));
    let _ended = Ended;
    quantum()
}

/// Whether this thread's quantum has taken far more than it was admitted with.
pub fn is_too_much() -> bool {
    BUDGET.get().is_some_and(|(before, most)| taken_bytes().saturating_sub(before) > most)
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
