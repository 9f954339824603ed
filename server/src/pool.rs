//! Where tokio hands work to rayon and gets the result back.
//!
//! One pool of all cores. Work is cut into *quanta* (one level of one segment, a chunk of the coarse pass), each a
//! plain sequential closure. A quantum waits in one of five lanes; in a lane, users take turns, so that one user's
//! hundred queries don't keep another waiting. Each rayon task takes whatever is most urgent at the moment it runs.
//! Edits have a thread beside those, which does nothing else and does not stand back: whoever drags a point waits neither for
//! a quantum of somebody's query to end nor for the cores.
//!
//! A quantum belongs to a [`Job`], which was admitted beforehand (a bounded number, their memory estimated), can be
//! stopped at any time and stops by itself when it is dropped. A panic in a quantum becomes [`PoolError::Panicked`].

mod admission;
mod lanes;
mod stop;
pub mod taken;

pub use admission::{Admission, Admitted, Used};
pub use stop::{Stop, StopReason};

use crate::telemetry::traces::TARGET;
use lanes::Lanes;
use quadmuse_kernel::numerics::{go_first, stop as interrupt};
use std::backtrace::Backtrace;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;
use tracing::field::Empty;

/// How urgent a quantum is; the first lane that has work goes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lane {
    /// Somebody drags a constraint, or looks at what came of it: fractions of a second.
    Edit,
    /// Somebody waits for a map or a composition: seconds.
    Lay,
    /// Encoding a query and its first level.
    Coarse,
    /// The finer levels.
    Fine,
    /// Encoding examples.
    Ingest,
}

impl Lane {
    /// Its name, as traces tell it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Edit => "edit",
            Self::Lay => "lay",
            Self::Coarse => "coarse",
            Self::Fine => "fine",
            Self::Ingest => "ingest",
        }
    }
}

/// Whose turn it is counted as: a number that stands for a token or an address.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct User(pub u64);

/// Why a quantum gave no result, or a job was not admitted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PoolError {
    /// Too many jobs.
    #[error("expected room for another job, found {waiting} jobs waiting already; try again in {} s", retry_after.as_secs())]
    Overloaded {
        /// So many jobs wait or run.
        waiting: usize,
        /// When to come back.
        retry_after: Duration,
    },
    /// The user has the share that is due already.
    #[error(
        "expected the caller to have at most {share} {what} at a time, found {used} in use; \
         let some end or remove some queries, and try again in {} s",
        retry_after.as_secs()
    )]
    OverShare {
        /// Of what.
        what: &'static str,
        /// In use by the user.
        used: u64,
        /// What the user may have.
        share: u64,
        /// When to come back.
        retry_after: Duration,
    },
    /// Too much memory is in use.
    #[error(
        "expected room for another job, found {used} of {limit} bytes of memory in use and {needed} needed; \
         try again in {} s",
        retry_after.as_secs()
    )]
    MemoryFull {
        /// In use, in bytes.
        used: u64,
        /// What may be in use, in bytes.
        limit: u64,
        /// What the job needs, in bytes.
        needed: u64,
        /// When to come back.
        retry_after: Duration,
    },
    /// The job alone would need more memory than the service may use.
    #[error(
        "expected a job of at most {limit} bytes of memory, found one of an estimated {estimate}; send a smaller mesh"
    )]
    TooLarge {
        /// The estimate, in bytes.
        estimate: u64,
        /// The limit, in bytes.
        limit: u64,
    },
    /// The job was stopped.
    #[error(transparent)]
    Stopped(#[from] StopReason),
    /// The work panicked: a bug of ours.
    #[error("expected the computation to end, found a panic: {message}")]
    Panicked {
        /// What the panic said, for the log.
        message: String,
    },
}

impl PoolError {
    /// When to come back, where there may be room then.
    pub fn retry_after(&self) -> Option<Duration> {
        match self {
            Self::OverShare { retry_after, .. }
            | Self::Overloaded { retry_after, .. }
            | Self::MemoryFull { retry_after, .. } => Some(*retry_after),
            _ => None,
        }
    }
}

/// A job that was admitted. Dropping it stops what is under way.
#[derive(Debug)]
pub struct Job {
    stop: Stop,
    user: User,
    /// The older the less.
    age: u64,
    admitted: Arc<Admitted>,
}

impl Job {
    /// Its stop flag.
    pub fn stop(&self) -> &Stop {
        &self.stop
    }

    /// The same job with a fresh stop flag and other time; this one can be dropped.
    pub fn renew(&self, time: Option<Duration>) -> Self {
        Self { stop: Stop::new(time), user: self.user, age: self.age, admitted: Arc::clone(&self.admitted) }
    }

    /// Gives back its place among the running jobs, but not its memory: it has nothing more to compute for now.
    pub fn rest(&self) {
        self.admitted.release_place();
    }

    /// Takes another share of the memory in place of its own; never refused, as what is there is there.
    pub fn take(&self, memory_bytes: u64) {
        self.admitted.take(memory_bytes);
    }

    /// What is kept of a job that is done: its place is given back, and its share of the memory becomes `memory_bytes`.
    /// This cannot fail, so that finished work is never lost to others' needs.
    pub fn kept(self, memory_bytes: u64) -> Self {
        self.rest();
        self.admitted.take(memory_bytes);
        self.renew(None)
    }
}

impl Drop for Job {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}

/// The pool.
pub struct Pool {
    lanes: Arc<Mutex<Lanes>>,
    threads: rayon::ThreadPool,
    /// The thread of edits.
    edits: rayon::ThreadPool,
    admission: Admission,
    admitted: AtomicU64,
}

/// Stack of a worker thread, in bytes.
const STACK_BYTES: usize = 8 << 20;

/// How far the computing threads stand back behind those that answer requests, in steps of `nice`.
const NICENESS: i32 = 5;

impl Pool {
    /// A pool of `threads` threads (0: one a core) that admits what `admission` allows.
    ///
    /// # Errors
    /// When the system gives no threads.
    pub fn new(threads: usize, admission: Admission) -> Result<Self, rayon::ThreadPoolBuildError> {
        let some = |count: usize, name: &'static str| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(count)
                .stack_size(STACK_BYTES)
                .thread_name(move |k| format!("{name}-{k}"))
                .panic_handler(|_| tracing::error!("a panic passed the pool's net"))
        };
        // On Linux this is the thread's own: those that answer requests go first. If refused, they share.
        let threads = some(threads, "compute").start_handler(|_| _ = rustix::process::nice(NICENESS)).build()?;
        let edits = some(1, "edit").start_handler(|_| go_first()).build()?;
        Ok(Self { lanes: Arc::default(), threads, edits, admission, admitted: AtomicU64::new(0) })
    }

    /// Number of worker threads, without that of edits.
    pub fn threads(&self) -> usize {
        self.threads.current_num_threads()
    }

    /// Quanta that wait for a thread.
    pub fn waiting(&self) -> usize {
        lock(&self.lanes).len()
    }

    /// What may be admitted.
    pub fn admission(&self) -> &Admission {
        &self.admission
    }

    /// Quanta that wait in each lane: edit, lay, coarse, fine, ingest.
    pub fn waiting_by_lane(&self) -> [usize; 5] {
        lock(&self.lanes).lengths()
    }

    /// Admits a job of `user` with an estimated need of memory, to end within `time` if one is given.
    ///
    /// # Errors
    /// [`PoolError::OverShare`], [`PoolError::Overloaded`], [`PoolError::MemoryFull`] and [`PoolError::TooLarge`].
    pub fn admit(&self, user: User, memory_bytes: u64, time: Option<Duration>) -> Result<Job, PoolError> {
        let admitted = Arc::new(self.admission.admit(user, memory_bytes)?);
        let age = self.admitted.fetch_add(1, Ordering::Relaxed);
        Ok(Job { stop: Stop::new(time), user, age, admitted })
    }

    /// Runs `work` on the pool. Dropping the future doesn't stop it; dropping or stopping the job does.
    ///
    /// # Errors
    /// [`PoolError::Stopped`] as soon as the job is stopped, [`PoolError::Panicked`].
    pub async fn run<T, F>(&self, job: &Job, lane: Lane, work: F) -> Result<T, PoolError>
    where
        T: Send + 'static,
        F: FnOnce(&Stop) -> T + Send + 'static,
    {
        let (send, receive) = oneshot::channel();
        let (stop, memory_bytes) = (job.stop.clone(), job.admitted.bytes());
        let span = tracing::info_span!(target: TARGET, "compute", lane = lane.as_str(), waited_ms = Empty);
        let asked = Instant::now();
        let quantum = move || {
            span.record("waited_ms", asked.elapsed().as_millis() as u64);
            let _computing = span.entered();
            // The receiver may be gone; then the result is dropped here, still within the net.
            let _ = send.send(guarded(&stop, memory_bytes, work));
        };
        lock(&self.lanes).push(lane, job.user, job.age, Box::new(quantum));
        if lane == Lane::Edit {
            let lanes = Arc::clone(&self.lanes);
            self.edits.spawn_fifo(move || run_next(&lanes, Lanes::pop_edit));
        }
        // Where an edit was taken by its own thread, this one finds something else to do, or nothing.
        let lanes = Arc::clone(&self.lanes);
        self.threads.spawn_fifo(move || run_next(&lanes, Lanes::pop));
        tokio::select! {
            biased;
            result = receive => result.unwrap_or_else(|_| Err(PoolError::Panicked { message: "its result was lost".into() })),
            reason = job.stop.stopped() => Err(reason.into()),
        }
    }
}

/// Ends a quantum from within, wherever the kernel asks whether to go on.
struct Interrupted(StopReason);

fn guarded<T>(stop: &Stop, memory_bytes: u64, work: impl FnOnce(&Stop) -> T) -> Result<T, PoolError> {
    if let Some(reason) = stop.reason() {
        return Err(reason.into());
    }
    let asked = stop.clone();
    let ask = move || {
        if let Some(reason) = asked.reason() {
            tell_if_late(&asked);
            resume_unwind(Box::new(Interrupted(reason)));
        }
    };
    let run = || taken::within(memory_bytes, || interrupt::within(Arc::new(ask), || work(stop)));
    catch_unwind(AssertUnwindSafe(run)).map_err(|panic| match panic.downcast_ref::<Interrupted>() {
        Some(Interrupted(reason)) => PoolError::Stopped(*reason),
        None => PoolError::Panicked { message: words_of(&*panic) },
    })
}

/// A quantum that asks later than this after it was cancelled holds its thread for too long.
const LATE: Duration = Duration::from_millis(50);

/// Logs where a quantum was that asked late, for whoever wants to know: to find the place takes far longer than it was late.
fn tell_if_late(stop: &Stop) {
    let late = stop.since_cancelled();
    if late > LATE && tracing::enabled!(tracing::Level::DEBUG) {
        let place = Backtrace::force_capture().to_string();
        tracing::debug!(ms = late.as_millis() as u64, %place, "went on after it was cancelled");
    }
}

fn run_next(lanes: &Mutex<Lanes>, pop: fn(&mut Lanes) -> Option<(User, lanes::Quantum)>) {
    let next = pop(&mut lock(lanes));
    if let Some((user, quantum)) = next {
        let begun = Instant::now();
        // Dropping an unwanted result can panic too; a panic that left a rayon task would abort the process.
        if catch_unwind(AssertUnwindSafe(quantum)).is_err() {
            tracing::error!("a panic while a result was dropped");
        }
        lock(lanes).ended(user, begun.elapsed());
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a panic said.
pub fn words_of(panic: &(dyn std::any::Any + Send)) -> String {
    let words = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    words.unwrap_or("no words").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    fn pool(threads: usize) -> Pool {
        Pool::new(threads, Admission::new(1 << 20, 64)).expect("threads")
    }

    fn until_stopped(stop: &Stop) -> Option<StopReason> {
        while stop.reason().is_none() {
            std::thread::yield_now();
        }
        stop.reason()
    }

    /// What ended it: whoever waits may hear of the stop before the result, or after.
    fn ended_by(result: Result<Option<StopReason>, PoolError>) -> Option<StopReason> {
        match result {
            Ok(seen) => seen,
            Err(PoolError::Stopped(reason)) => Some(reason),
            Err(_) => None,
        }
    }

    #[tokio::test]
    async fn a_result_comes_back() {
        let pool = pool(2);
        let job = pool.admit(User(1), 0, None).expect("room");
        assert_eq!(pool.run(&job, Lane::Fine, |_| 42).await, Ok(42));
    }

    #[tokio::test]
    async fn a_panic_is_an_error_and_the_pool_goes_on() {
        let pool = pool(1);
        let job = pool.admit(User(1), 0, None).expect("room");
        let failed = pool.run(&job, Lane::Fine, |_| -> u8 { panic!("broken {}", 7) }).await;
        assert_eq!(failed, Err(PoolError::Panicked { message: "broken 7".into() }));
        assert_eq!(pool.run(&job, Lane::Fine, |_| 1).await, Ok(1));
    }

    #[tokio::test]
    async fn what_is_more_urgent_overtakes_what_was_waiting() {
        let pool = pool(1);
        let job = pool.admit(User(1), 0, None).expect("room");
        let (open, gate) = mpsc::channel::<()>();
        let order = Arc::new(Mutex::new(Vec::new()));
        let note = |word: &'static str| {
            let order = Arc::clone(&order);
            move |_: &Stop| order.lock().expect("not poisoned").push(word)
        };
        let blocker = pool.run(&job, Lane::Ingest, move |_| gate.recv().is_ok());
        let (ingest, fine, lay) = (note("ingest"), note("fine"), note("lay"));
        let all = async {
            tokio::join!(
                blocker,
                pool.run(&job, Lane::Ingest, ingest),
                pool.run(&job, Lane::Fine, fine),
                pool.run(&job, Lane::Lay, lay),
                async {
                    while pool.waiting() < 3 {
                        tokio::task::yield_now().await;
                    }
                    open.send(()).expect("the blocker waits");
                }
            )
        };
        let (blocker, ingest, fine, lay, ()) = all.await;
        assert!([ingest, fine, lay].iter().all(Result::is_ok) && blocker == Ok(true));
        assert_eq!(*order.lock().expect("not poisoned"), ["lay", "fine", "ingest"]);
    }

    #[tokio::test]
    async fn an_edit_waits_for_nothing_that_is_under_way() {
        let pool = pool(1);
        let job = pool.admit(User(1), 0, None).expect("room");
        let (open, gate) = mpsc::channel::<()>();
        let (begun, begins) = oneshot::channel();
        let laying = pool.run(&job, Lane::Lay, move |_| {
            let _ = begun.send(());
            gate.recv().is_ok()
        });
        let (laying, edited) = tokio::join!(laying, async {
            begins.await.expect("it begins");
            let edited = pool.run(&job, Lane::Edit, |_| std::thread::current().name().map(str::to_owned)).await;
            open.send(()).expect("it waits");
            edited
        });
        assert_eq!((laying, edited), (Ok(true), Ok(Some("edit-0".into()))));
        // What was left for the other threads to find does no harm.
        assert_eq!(pool.run(&job, Lane::Fine, |_| 1).await, Ok(1));
    }

    #[tokio::test]
    async fn stopping_a_job_answers_at_once_and_skips_what_waits() {
        let pool = pool(1);
        let job = pool.admit(User(1), 0, None).expect("room");
        let stop = job.stop().clone();
        let (seen, was_run) = mpsc::channel();
        let busy = pool.run(&job, Lane::Fine, until_stopped);
        let waits = pool.run(&job, Lane::Fine, move |_| seen.send(()));
        let (first, second, ()) = tokio::join!(busy, waits, async {
            tokio::task::yield_now().await;
            stop.cancel();
        });
        assert_eq!(ended_by(first), Some(StopReason::Cancelled));
        assert!(matches!(second, Err(PoolError::Stopped(StopReason::Cancelled))));
        let other = pool.admit(User(1), 0, None).expect("room");
        assert_eq!(pool.run(&other, Lane::Ingest, |_| ()).await, Ok(()));
        assert!(was_run.try_recv().is_err());
    }

    #[tokio::test]
    async fn a_deadline_stops_a_job() {
        let pool = pool(1);
        let job = pool.admit(User(1), 0, Some(Duration::from_millis(20))).expect("room");
        let endless = pool.run(&job, Lane::Fine, until_stopped).await;
        assert_eq!(ended_by(endless), Some(StopReason::Deadline));
    }

    #[tokio::test]
    async fn what_the_kernel_computes_is_interrupted_wherever_it_asks() {
        let pool = pool(1);
        let job = pool.admit(User(1), 0, None).expect("room");
        let stop = job.stop().clone();
        let (begun, wait) = oneshot::channel();
        let endless = pool.run(&job, Lane::Fine, move |_| -> u8 {
            let _ = begun.send(());
            loop {
                interrupt::poll();
            }
        });
        let (ended, ()) = tokio::join!(endless, async {
            wait.await.expect("it begins");
            stop.cancel();
        });
        assert_eq!(ended, Err(PoolError::Stopped(StopReason::Cancelled)));
        let other = pool.admit(User(1), 0, None).expect("room");
        assert_eq!(pool.run(&other, Lane::Fine, |_| 1).await, Ok(1), "its thread is free again");
    }

    #[tokio::test]
    async fn what_takes_far_more_memory_than_it_was_admitted_with_is_stopped() {
        let pool = pool(1);
        let job = pool.admit(User(1), 1 << 20, None).expect("room");
        let hungry = |stop: &Stop| {
            let mut all: Vec<Vec<u8>> = Vec::new();
            while stop.reason().is_none() && all.len() < 2048 {
                all.push(vec![1; 1 << 20]);
            }
            (stop.reason(), all.len())
        };
        let (reason, megabytes) = pool.run(&job, Lane::Fine, hungry).await.expect("it ends by itself");
        assert_eq!(reason, Some(StopReason::Memory));
        assert!(megabytes < 500, "{megabytes}");
        assert_eq!(pool.run(&job, Lane::Fine, |stop| stop.reason()).await, Ok(None), "the next begins anew");
    }
}
