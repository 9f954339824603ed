//! What holds of jobs on any engine.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::time::Duration;

use quadmuse_cluster::{Engine, EngineError, Job};

const SOON: Duration = Duration::from_millis(200);

/// An engine that loses requests and answers is asked again, as a server does.
fn again<T>(what: impl Fn() -> Result<T, EngineError>) -> T {
    (0..50).find_map(|_| what().ok()).expect("answered at last")
}

/// It becomes true within five seconds.
fn soon(is_so: impl Fn() -> bool) -> bool {
    (0..50).any(|_| {
        is_so() || {
            std::thread::sleep(SOON / 2);
            false
        }
    })
}

fn take(engine: &dyn Engine, kind: &str, wait: Duration) -> Option<Box<dyn Job>> {
    again(|| engine.take_job(kind, wait))
}

/// The suite; `lease` is for how long nobody else gets a job of which nothing is heard. Those where an answer may be lost add
/// and take more than once.
pub(crate) fn all(engines: [&dyn Engine; 2], lease: Duration, is_reliable: bool) {
    let [one, other] = engines;
    // A kind at a time, so that what one part leaves is nobody else's.
    each_job_is_done_though_its_takers_die(engines, lease);
    for name in ["a", "b"] {
        again(|| one.add_job("once", name, name.as_bytes()));
    }
    assert!(take(other, "another", Duration::from_millis(50)).is_none(), "of another kind");
    if is_reliable {
        assert!(!other.add_job("once", "a", b"again").expect("answered"), "it waits already");
        let taken = take(other, "once", lease).expect("a job");
        assert_eq!((taken.name(), taken.payload(), taken.times_taken()), ("a", &b"a"[..], 1));
        assert!(!one.add_job("once", "a", b"again").expect("answered"), "it is being done");
        // Given back, it comes again, and not before its time.
        taken.give_back(Duration::ZERO).expect("answered");
        let mut names: Vec<(String, u64)> = (0..2)
            .map(|_| take(one, "once", 2 * lease).expect("a job"))
            .map(|job| {
                job.done().expect("answered");
                (job.name().to_owned(), job.times_taken())
            })
            .collect();
        names.sort();
        assert_eq!(names, [("a".to_owned(), 2), ("b".to_owned(), 1)]);
        // The node that keeps the jobs may hear of it a moment later than the one that answered.
        assert!(soon(|| one.add_job("once", "a", b"later").expect("answered")), "the one before is done");
        take(one, "once", lease).expect("a job").done().expect("answered");
        assert!(take(one, "once", lease + SOON).is_none(), "all are done");
        a_job_that_goes_on_is_nobody_elses(one, lease);
        // A replica may count a moment late.
        assert!(soon(|| other.jobs().expect("answered") == 0), "all are done");
    }
}

/// Four takers, of whom every third forgets what it took, as one does that is killed.
fn each_job_is_done_though_its_takers_die([one, other]: [&dyn Engine; 2], lease: Duration) {
    let names: Vec<String> = (0..12).map(|number| format!("job-{number}")).collect();
    for name in &names {
        again(|| one.add_job("work", name, name.as_bytes()));
    }
    let done: Mutex<BTreeMap<String, u64>> = Mutex::default();
    let is_over = || done.lock().expect("not poisoned").len() == names.len();
    std::thread::scope(|scope| {
        for (number, engine) in [one, other, one, other].into_iter().enumerate() {
            let (done, is_over) = (&done, &is_over);
            scope.spawn(move || {
                for turn in number.. {
                    if is_over() {
                        break;
                    }
                    let Ok(Some(job)) = engine.take_job("work", SOON) else { continue };
                    assert_eq!(job.payload(), job.name().as_bytes());
                    if turn % 3 == 0 && job.times_taken() < 3 {
                        continue;
                    }
                    *done.lock().expect("not poisoned").entry(job.name().to_owned()).or_default() += 1;
                    again(|| job.done());
                }
            });
        }
    });
    // What is done stays so.
    assert!(take(one, "work", lease + SOON).is_none(), "a job came again after it was done");
}

/// As long as is said that it goes on.
fn a_job_that_goes_on_is_nobody_elses(engine: &dyn Engine, lease: Duration) {
    engine.add_job("long", "x", b"").expect("added");
    let taken = take(engine, "long", lease).expect("a job");
    for _ in 0..4 {
        assert!(take(engine, "long", lease / 2).is_none(), "it goes on");
        taken.goes_on().expect("answered");
    }
    // And then somebody's.
    let next = take(engine, "long", 3 * lease).expect("it comes again");
    assert_eq!(next.times_taken(), 2);
    next.done().expect("answered");
}
