//! How long a computation goes on after it is cancelled.
//!
//! Whoever cancels at a random moment waits until the computation asks again. So the gaps between its questions, in its
//! own processor time, tell the distribution of that wait without cancelling: a wait is above x with the probability
//! Σ max(0, gap − x) / Σ gap.

use quadmuse_kernel::numerics::stop::{self, Stop};
use std::backtrace::Backtrace;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Gaps of more are shown with where they end.
const GAP_SHOWN_MS: f64 = 20.0;
/// So many of them at most.
const GAPS_SHOWN_MAX: usize = 12;
/// Lines of the kernel that are shown of each.
const PLACES_SHOWN: usize = 7;

/// The gaps between questions, in milliseconds, and where the long ones ended.
#[derive(Default)]
pub(crate) struct Gaps {
    all_ms: Vec<f64>,
    long: Vec<(f64, String)>,
}

impl Gaps {
    /// The wait that a share of all moments does not exceed.
    fn quantile_ms(&self, share: f64) -> f64 {
        let total: f64 = self.all_ms.iter().sum();
        let above = |x: f64| self.all_ms.iter().map(|gap| (gap - x).max(0.0)).sum::<f64>();
        let (mut low, mut high) = (0.0, self.all_ms.iter().copied().fold(0.0, f64::max));
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if above(middle) > (1.0 - share) * total { low = middle } else { high = middle }
        }
        high
    }

    /// Writes what was found to standard error.
    pub(crate) fn tell(mut self, name: &str) {
        let (total, longest) = (self.all_ms.iter().sum::<f64>(), self.all_ms.iter().copied().fold(0.0, f64::max));
        let [median, late] = [0.5, 0.99].map(|share| self.quantile_ms(share));
        eprintln!(
            "{name}: {total:.0} ms, a cancellation waits {median:.2} ms (p50), {late:.1} ms (p99), {longest:.1} ms at most"
        );
        self.long.sort_by(|a, b| b.0.total_cmp(&a.0));
        self.long.iter().take(GAPS_SHOWN_MAX).for_each(|(gap, place)| eprintln!("  {gap:.1} ms before {place}"));
    }
}

/// Processor time of this thread, in milliseconds; real time where the system doesn't tell.
fn now_ms(begun: Instant) -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = text.as_deref().and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or(begun.elapsed().as_secs_f64() * 1e3, |ns| ns / 1e6)
}

/// The lines of the kernel that were under way, the innermost first.
fn place() -> String {
    let frames = Backtrace::force_capture().to_string();
    let line = |frame: &str| Some(frame.split_once("server/kernel/src/")?.1.trim_end().to_owned());
    let mut lines: Vec<String> = frames.lines().filter_map(line).collect();
    lines.retain(|line| !line.starts_with("numerics/stop"));
    lines.truncate(PLACES_SHOWN);
    lines.join(" < ")
}

/// Runs a computation and tells its gaps; `stopped` is what it is to be given to ask beside its polls. Questions of other threads
/// than this one count for nothing.
pub(crate) fn asked<T>(work: impl FnOnce(Stop<'_>) -> T) -> (T, Gaps) {
    let begun = Instant::now();
    let state = Arc::new(Mutex::new((Gaps::default(), begun, now_ms(begun))));
    let inner = Arc::clone(&state);
    let caller = std::thread::current().id();
    let ask = Arc::new(move || {
        // Others that work for this thread have clocks of their own.
        if std::thread::current().id() != caller {
            return;
        }
        let (gaps, real, cpu) = &mut *inner.lock().unwrap_or_else(PoisonError::into_inner);
        // Cheap first: most gaps are far too short to matter.
        if real.elapsed().as_secs_f64() < 1e-3 {
            return;
        }
        let now = now_ms(begun);
        let gap = now - *cpu;
        gaps.all_ms.push(gap);
        if gap > GAP_SHOWN_MS {
            gaps.long.push((gap, place()));
        }
        // What telling took is not the computation's.
        (*real, *cpu) = (Instant::now(), now_ms(begun));
    });
    let made = stop::within(ask, || {
        let made = work(&|| {
            stop::ask();
            false
        });
        stop::ask();
        made
    });
    let gaps = std::mem::take(&mut state.lock().unwrap_or_else(PoisonError::into_inner).0);
    (made, gaps)
}
