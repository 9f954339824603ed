//! Maps, compositions and retopologies while they are made: each on a task of its own, which goes on when its request is gone.

use super::query::{LiveQuery, rfc3339};
use super::{Work, WorkError};
use crate::telemetry::traces;
use quadmuse_proto::making::{MakingState, Product};
use std::collections::BTreeMap;
use std::future::Future;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::sync::watch;
use tokio::task::AbortHandle;
use tracing::Instrument;

/// Most of them that are made of a query at a time.
pub const UNDER_WAY_MAX: usize = 16;
/// Most that failed or were cancelled and are remembered, of a query.
const ENDED_MAX: usize = 64;

/// Is told what is being done, and how far it is, 0–1.
pub type Tell<'a> = &'a (dyn Fn(&'static str, f64) + Send + Sync);

/// For those who tell nobody.
pub fn tell_nobody(_: &'static str, _: f64) {}

/// One that is made.
pub struct Making {
    /// The id it has, too, once it is there.
    pub id: String,
    /// What it is.
    pub product: Product,
    /// When it was asked for.
    pub created: String,
    stand: watch::Sender<MakingStatus>,
    task: OnceLock<AbortHandle>,
}

/// The status of something that is made.
#[derive(Clone, Debug)]
pub struct MakingStatus {
    /// Its state.
    pub state: MakingState,
    /// What is being done.
    pub stage: &'static str,
    /// How far it is, 0–1.
    pub progress: f64,
    /// Why it failed.
    pub failure: Option<Arc<WorkError>>,
}

impl Making {
    fn new(id: String, product: Product) -> Self {
        let stand =
            MakingStatus { state: MakingState::Queued, stage: "waiting for its turn", progress: 0.0, failure: None };
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let created = rfc3339(u64::try_from(now.as_millis()).unwrap_or(u64::MAX));
        Self { id, product, created, stand: watch::Sender::new(stand), task: OnceLock::new() }
    }

    /// Where it stands now.
    pub fn stand(&self) -> MakingStatus {
        self.stand.borrow().clone()
    }

    /// Where it stands, to be waited for.
    pub fn watch(&self) -> watch::Receiver<MakingStatus> {
        self.stand.subscribe()
    }

    /// Notes what is being done; progress never goes back.
    fn tell(&self, stage: &'static str, progress: f64) {
        self.change(|stand| {
            stand.state = MakingState::Running;
            stand.stage = stage;
            stand.progress = stand.progress.max(progress);
        });
    }

    fn end(&self, state: MakingState, failure: Option<WorkError>) {
        self.change(|stand| {
            stand.state = state;
            stand.stage = match state {
                MakingState::Done => "done",
                MakingState::Cancelled => "cancelled",
                _ => "failed",
            };
            if state == MakingState::Done {
                stand.progress = 1.0;
            }
            stand.failure = failure.map(Arc::new);
        });
    }

    /// Writes, unless it is over.
    fn change(&self, change: impl FnOnce(&mut MakingStatus)) {
        self.stand.send_if_modified(|stand| {
            let is_open = !stand.state.is_final();
            if is_open {
                change(stand);
            }
            is_open
        });
    }

    /// Stops it, unless it is over.
    pub fn cancel(&self) {
        self.end(MakingState::Cancelled, None);
        if let Some(task) = self.task.get() {
            task.abort();
        }
    }

    /// Waits until it is over; where it stands then.
    pub async fn over(&self) -> MakingStatus {
        // It is the sender itself, so the wait cannot end without a stand.
        let _ = self.watch().wait_for(|stand| stand.state.is_final()).await;
        self.stand()
    }

    /// Waits until it is over, at most so long; where it stands then.
    pub async fn within(&self, time: Duration) -> MakingStatus {
        tokio::time::timeout(time, self.over()).await.unwrap_or_else(|_| self.stand())
    }
}

/// Cancels what is made when whoever waits for it goes away before it has been told of it.
pub struct CancelOnDrop(Option<Arc<Making>>);

impl CancelOnDrop {
    /// Waits on behalf of somebody who does not know of it yet.
    pub fn new(making: &Arc<Making>) -> Self {
        Self(Some(Arc::clone(making)))
    }

    /// Notes that the callers know of it: from now on it goes on without them.
    pub fn announced(mut self) {
        self.0 = None;
    }
}

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        if let Some(making) = &self.0 {
            making.cancel();
        }
    }
}

/// Ends what is made even where its task does not come to its end: it was aborted, or it panicked.
struct EndOnDrop(Arc<Making>);

impl Drop for EndOnDrop {
    fn drop(&mut self) {
        self.0.end(MakingState::Failed, Some(WorkError::Lost));
    }
}

/// What is made of a query, and what of it failed or was cancelled.
#[derive(Default)]
pub struct Makings(Mutex<BTreeMap<String, Arc<Making>>>);

impl Makings {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Making>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// One of them.
    pub fn get(&self, product: Product, id: &str) -> Option<Arc<Making>> {
        self.lock().get(id).filter(|making| making.product == product).cloned()
    }

    /// One of them, if it is not over.
    pub fn under_way(&self, product: Product, id: &impl ToString) -> Option<Arc<Making>> {
        self.get(product, &id.to_string()).filter(|making| !making.stand().state.is_final())
    }

    /// All of them, the oldest first.
    pub fn all(&self) -> Vec<Arc<Making>> {
        self.lock().values().cloned().collect()
    }

    /// Why what has this id is not there, if it was ever begun.
    pub fn missing(&self, product: Product, id: &impl ToString) -> Option<WorkError> {
        let making = self.get(product, &id.to_string())?;
        let state = making.stand().state.as_str();
        Some(WorkError::NotMade { product: product.as_str(), id: making.id.clone(), state })
    }

    /// Cancels one that is made, or forgets one that is over; whether there was one.
    pub fn remove(&self, product: Product, id: &impl ToString) -> bool {
        let Some(making) = self.get(product, &id.to_string()) else { return false };
        match making.stand().state {
            // It is found as what it is from now on.
            MakingState::Done => return false,
            MakingState::Failed | MakingState::Cancelled => self.forget(&making.id),
            MakingState::Queued | MakingState::Running => making.cancel(),
        }
        true
    }

    /// Forgets one that is over.
    pub fn forget(&self, id: &str) {
        self.lock().remove(id);
    }

    /// Cancels all of them.
    pub fn cancel_all(&self) {
        self.all().iter().for_each(|making| making.cancel());
    }

    /// Takes one in. Ids sort by time, so the first that ended is the oldest.
    fn begin(&self, making: Making) -> Result<Arc<Making>, WorkError> {
        let mut all = self.lock();
        let (ended, open): (Vec<_>, Vec<_>) = all.values().partition(|making| making.stand().state.is_final());
        if open.len() >= UNDER_WAY_MAX {
            return Err(WorkError::MakingsFull { limit: UNDER_WAY_MAX });
        }
        let oldest = ended.first().filter(|_| ended.len() >= ENDED_MAX).map(|making| making.id.clone());
        if let Some(oldest) = oldest {
            all.remove(&oldest);
        }
        let making = Arc::new(making);
        all.insert(making.id.clone(), Arc::clone(&making));
        Ok(making)
    }
}

/// Makes something of a query on a task of its own. `make` is told whom to tell; what it makes it keeps with the query before it ends.
///
/// # Errors
/// [`WorkError::MakingsFull`].
pub fn start<F, M>(
    work: &Arc<Work>,
    live: &Arc<LiveQuery>,
    (product, id): (Product, String),
    make: M,
) -> Result<Arc<Making>, WorkError>
where
    M: FnOnce(Arc<dyn Fn(&'static str, f64) + Send + Sync>) -> F,
    F: Future<Output = Result<(), WorkError>> + Send + 'static,
{
    let making = live.makings.begin(Making::new(id, product))?;
    let teller = Arc::clone(&making);
    let made = make(Arc::new(move |stage, progress| teller.tell(stage, progress)));
    let (ends, live) = (EndOnDrop(Arc::clone(&making)), Arc::clone(live));
    let traced = traces::behind(product.as_str(), &making.id);
    let run = async move {
        let result = made.await;
        match result {
            Ok(()) => {
                // From now on it is found as what it is.
                ends.0.end(MakingState::Done, None);
                live.makings.forget(&ends.0.id);
            }
            Err(error) => ends.0.end(MakingState::Failed, Some(error)),
        }
    };
    let task = work.background.spawn(run.instrument(traced));
    // Set once: nobody else has it yet.
    let _ = making.task.set(task.abort_handle());
    if making.stand().state == MakingState::Cancelled {
        task.abort();
    }
    Ok(making)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_over_stays_as_it_is_and_progress_never_goes_back() {
        let making = Making::new("a".into(), Product::Map);
        making.tell("one", 0.5);
        making.tell("two", 0.25);
        let stand = making.stand();
        assert_eq!((stand.state, stand.stage), (MakingState::Running, "two"));
        assert!((stand.progress - 0.5).abs() < 1e-12);
        making.cancel();
        making.tell("three", 0.9);
        making.end(MakingState::Done, None);
        assert_eq!((making.stand().state, making.stand().stage), (MakingState::Cancelled, "cancelled"));
    }

    #[test]
    fn so_many_are_made_at_a_time_and_the_oldest_that_ended_is_forgotten() {
        let makings = Makings::default();
        for k in 0..UNDER_WAY_MAX {
            makings.begin(Making::new(format!("{k:03}"), Product::Map)).expect("room");
        }
        let refused = makings.begin(Making::new("x".into(), Product::Map));
        assert!(matches!(refused, Err(WorkError::MakingsFull { limit: UNDER_WAY_MAX })));
        makings.cancel_all();
        for k in UNDER_WAY_MAX..ENDED_MAX + 8 {
            makings.begin(Making::new(format!("{k:03}"), Product::Map)).expect("room").cancel();
        }
        assert_eq!(makings.all().len(), ENDED_MAX);
        assert!(makings.get(Product::Map, "000").is_none());
        assert!(makings.get(Product::Map, "070").is_some() && makings.get(Product::Composition, "070").is_none());
    }

    #[tokio::test]
    async fn whoever_goes_away_untold_cancels_and_whoever_was_told_does_not() {
        let making = Arc::new(Making::new("a".into(), Product::Map));
        CancelOnDrop::new(&making).announced();
        assert_eq!(making.within(Duration::ZERO).await.state, MakingState::Queued);
        drop(CancelOnDrop::new(&making));
        assert_eq!(making.within(Duration::from_secs(5)).await.state, MakingState::Cancelled);
    }
}
