use super::*;
use crate::pool::{Admission, Pool};
use crate::work::corpus::Corpus;
use crate::work::corpus::memory::MemoryCorpus;
use crate::work::engine::EngineError;
use crate::work::engine::fake::FakeEngine;
use quadmuse_cluster::EngineError as Unheard;
use std::collections::{BTreeMap, HashMap};
use std::sync::MutexGuard;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// For so long nobody else gets a job of which nothing is heard.
const SHORT_LEASE: Duration = Duration::from_millis(200);

/// A queue in memory, as several servers would share it.
#[derive(Clone, Default)]
struct InMemory(Arc<State>);

#[derive(Default)]
struct State {
    jobs: Mutex<BTreeMap<String, Waiting>>,
    kept: Mutex<HashMap<String, Vec<u8>>>,
    /// Jobs that were said to be done.
    done: AtomicU64,
    is_silent: AtomicBool,
}

#[derive(Clone)]
struct Waiting {
    payload: Vec<u8>,
    times_taken: u64,
    not_before: Instant,
}

struct Taken {
    queue: InMemory,
    key: String,
    job: Waiting,
}

impl InMemory {
    fn jobs(&self) -> MutexGuard<'_, BTreeMap<String, Waiting>> {
        self.0.jobs.lock().expect("not poisoned")
    }

    fn kept_all(&self) -> MutexGuard<'_, HashMap<String, Vec<u8>>> {
        self.0.kept.lock().expect("not poisoned")
    }

    fn heard(&self) -> Result<(), CorpusError> {
        match self.0.is_silent.load(Ordering::Relaxed) {
            true => Err(CorpusError::Unreachable("it is silent".into())),
            false => Ok(()),
        }
    }
}

impl Job for Taken {
    fn name(&self) -> &str {
        &self.key
    }

    fn payload(&self) -> &[u8] {
        &self.job.payload
    }

    fn times_taken(&self) -> u64 {
        self.job.times_taken
    }

    fn goes_on(&self) -> Result<(), Unheard> {
        self.give_back(SHORT_LEASE)
    }

    fn done(&self) -> Result<(), Unheard> {
        self.queue.jobs().remove(&self.key);
        self.queue.0.done.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    fn give_back(&self, pause: Duration) -> Result<(), Unheard> {
        if let Some(job) = self.queue.jobs().get_mut(&self.key) {
            job.not_before = Instant::now() + pause;
        }
        Ok(())
    }
}

impl Queue for InMemory {
    fn add(&self, kind: &str, name: &str, payload: &[u8]) -> Result<bool, CorpusError> {
        self.heard()?;
        let mut jobs = self.jobs();
        let key = format!("{kind}.{name}");
        let is_new = !jobs.contains_key(&key);
        let fresh = || Waiting { payload: payload.into(), times_taken: 0, not_before: Instant::now() };
        jobs.entry(key).or_insert_with(fresh);
        Ok(is_new)
    }

    fn take(&self, kind: &str, wait: Duration) -> Result<Option<Box<dyn Job>>, CorpusError> {
        let begun = Instant::now();
        while begun.elapsed() < wait {
            let mut jobs = self.jobs();
            let mut waiting = jobs.iter_mut().filter(|(key, _)| key.starts_with(&format!("{kind}.")));
            if let Some((key, job)) = waiting.find(|(_, job)| job.not_before <= Instant::now()) {
                (job.times_taken, job.not_before) = (job.times_taken + 1, Instant::now() + SHORT_LEASE);
                return Ok(Some(Box::new(Taken { queue: self.clone(), key: key.clone(), job: job.clone() })));
            }
            drop(jobs);
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(None)
    }

    fn count(&self) -> Result<u64, CorpusError> {
        Ok(self.jobs().len() as u64)
    }

    fn keep(&self, name: &str, bytes: &[u8]) -> Result<(), CorpusError> {
        self.heard()?;
        self.kept_all().insert(name.into(), bytes.into());
        Ok(())
    }

    fn kept(&self, name: &str) -> Result<Option<Vec<u8>>, CorpusError> {
        Ok(self.kept_all().get(name).cloned())
    }

    fn forget(&self, name: &str) -> Result<(), CorpusError> {
        self.kept_all().remove(name);
        Ok(())
    }
}

/// A server of a corpus and a queue.
fn server(corpus: &Arc<MemoryCorpus>, queue: &InMemory) -> Arc<Work> {
    let pool = Pool::new(2, Admission::new(64 << 20, 32)).expect("threads");
    let work = Work::new(pool, Arc::new(FakeEngine), Arc::<MemoryCorpus>::clone(corpus) as Arc<_>);
    assert!(work.queue.set(Arc::new(queue.clone())).is_ok());
    work
}

fn upload(text: &str) -> (Upload, Annotation) {
    let upload = Upload { bytes: Bytes::from(text.to_owned()), format: None, cut: Cut::default() };
    (upload, Annotation { name: "one".into(), tags: vec!["b".into(), "a".into()], relevance: 4.0 })
}

async fn add(work: &Arc<Work>, text: &str) -> Result<(Arc<Example>, PutOutcome), WorkError> {
    let (upload, annotation) = upload(text);
    ingest::add(work, Caller::default(), upload, annotation).await
}

#[tokio::test]
async fn an_upload_to_one_server_is_encoded_by_another_that_is_free() {
    let (corpus, queue) = (Arc::default(), InMemory::default());
    let (first, second) = (server(&corpus, &queue), server(&corpus, &queue));
    let stopping = CancellationToken::new();
    // The first does no jobs.
    let doing = tokio::spawn(run(Arc::clone(&second), stopping.clone()));
    let (example, put) = add(&first, "segment disc 1\nsegment annulus 2").await.expect("added");
    assert_eq!(
        (put, example.name.as_str(), example.relevance, example.segments.len()),
        (PutOutcome::Added, "one", 4.0, 2)
    );
    assert_eq!(example.tags, ["a", "b"]);
    assert!(first.catalogue.snapshot().segment(example.id, 1).is_some(), "who added it sees it");
    assert_eq!(queue.0.done.load(Ordering::Relaxed), 1);
    // Nothing of it is left in the queue, and the same again is no job.
    assert_eq!((queue.count().expect("counted"), queue.kept_all().len()), (0, 0));
    assert_eq!(add(&first, "segment disc 1\nsegment annulus 2").await.expect("there").1, PutOutcome::There);
    assert_eq!(queue.0.done.load(Ordering::Relaxed), 1);
    stopping.cancel();
    doing.await.expect("no panic");
}

#[tokio::test]
async fn the_job_of_a_taker_that_is_killed_is_done_by_another_and_once_with_effect() {
    let (corpus, queue) = (Arc::<MemoryCorpus>::default(), InMemory::default());
    let (first, second) = (server(&corpus, &queue), server(&corpus, &queue));
    let adding = tokio::spawn({
        let first = Arc::clone(&first);
        async move { add(&first, "segment disc 1").await }
    });
    // The first taker dies with it: before it has done anything, and after it has added the example and said nothing.
    for has_added in [false, true] {
        let (taking, kind) = (queue.clone(), kind(&second));
        let taken = tokio::task::spawn_blocking(move || taking.take(&kind, Duration::from_secs(20)));
        let job = taken.await.expect("no panic").expect("answered").expect("a job");
        if has_added {
            let Ok(Task::Add { upload }) = rmp_serde::from_slice(job.payload()) else { panic!("another task") };
            let outcome = encoded(&second, &(Arc::new(queue.clone()) as Arc<dyn Queue>), &upload).await;
            assert!(matches!(outcome, Ok(Some(Outcome::Added { is_new: true, .. }))));
        }
    }
    let stopping = CancellationToken::new();
    let doing = tokio::spawn(run(Arc::clone(&second), stopping.clone()));
    let (example, _) = adding.await.expect("no panic").expect("added");
    assert_eq!(corpus.list().iter().map(|example| example.id).collect::<Vec<_>>(), [example.id]);
    assert_eq!((queue.0.done.load(Ordering::Relaxed), queue.count().expect("counted")), (1, 0));
    stopping.cancel();
    doing.await.expect("no panic");
}

#[tokio::test]
async fn what_can_not_be_encoded_is_refused_as_on_one_server() {
    let (corpus, queue) = (Arc::<MemoryCorpus>::default(), InMemory::default());
    let first = server(&corpus, &queue);
    let stopping = CancellationToken::new();
    let doing = tokio::spawn(run(Arc::clone(&first), stopping.clone()));
    // Refused when it is read: no job.
    assert!(matches!(add(&first, "refuse mesh_empty").await, Err(WorkError::Engine(EngineError::Refused { .. }))));
    assert_eq!(queue.0.done.load(Ordering::Relaxed), 0);
    // And when it is encoded.
    let refused = add(&first, "segment disc nan").await;
    assert!(matches!(refused, Err(WorkError::Engine(EngineError::Refused { .. }))), "{refused:?}");
    assert_eq!((queue.0.done.load(Ordering::Relaxed), corpus.list().len()), (1, 0));
    stopping.cancel();
    doing.await.expect("no panic");
}

#[tokio::test]
async fn where_the_queue_does_not_answer_the_server_encodes_by_itself() {
    let (corpus, queue) = (Arc::default(), InMemory::default());
    let first = server(&corpus, &queue);
    queue.0.is_silent.store(true, Ordering::Relaxed);
    assert_eq!(add(&first, "segment disc 1").await.expect("added").1, PutOutcome::Added);
    assert_eq!(queue.0.done.load(Ordering::Relaxed), 0);
}

#[tokio::test]
async fn what_is_of_an_older_encoder_is_encoded_once_again_by_whoever_is_free() {
    let (corpus, queue) = (Arc::<MemoryCorpus>::default(), InMemory::default());
    let (first, second) = (server(&corpus, &queue), server(&corpus, &queue));
    for number in 1..=5 {
        let (upload, annotation) = upload(&format!("segment disc {number}"));
        ingest::add_here(&first, Caller::default(), upload, annotation).await.expect("added");
    }
    corpus.make_old();
    assert_eq!(corpus.stale(7).len(), 5);
    // However often, and on however many servers, it is noticed.
    for work in [&first, &second, &first] {
        reencode::round(work).await;
    }
    assert_eq!(queue.count().expect("counted"), 5);
    let stopping = CancellationToken::new();
    let doing = [&first, &second].map(|work| tokio::spawn(run(Arc::clone(work), stopping.clone())));
    let begun = Instant::now();
    while queue.count().expect("counted") > 0 {
        assert!(begun.elapsed() < Duration::from_secs(20), "not done");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    assert_eq!((corpus.stale(7), queue.0.done.load(Ordering::Relaxed)), (Vec::new(), 5));
    stopping.cancel();
    for doing in doing {
        doing.await.expect("no panic");
    }
}

#[tokio::test]
async fn a_server_that_stops_gives_its_job_back() {
    let (corpus, queue) = (Arc::<MemoryCorpus>::default(), InMemory::default());
    let first = server(&corpus, &queue);
    let adding = tokio::spawn({
        let first = Arc::clone(&first);
        async move { add(&first, "segment disc 1\nencode-slow 60000").await }
    });
    let stopping = CancellationToken::new();
    let doing = tokio::spawn(run(Arc::clone(&first), stopping.clone()));
    let begun = Instant::now();
    while !queue.jobs().values().any(|job| job.times_taken == 1) {
        assert!(begun.elapsed() < Duration::from_secs(20), "not taken");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    stopping.cancel();
    doing.await.expect("no panic");
    let is_free = |job: &Waiting| job.not_before <= Instant::now();
    assert!(queue.jobs().values().all(is_free) && queue.count().expect("counted") == 1);
    adding.abort();
}
