//! An engine in memory that is unreliable in every way the real one may be: it delivers late, twice, in the wrong order or not
//! at all, ends followings, loses requests and answers, and reads what was written before. What it acknowledged it keeps.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use quadmuse_cluster::{Deliveries, Delivery, Engine, EngineError, Entry, Job, Written};

/// How unreliable it is: of how many calls or deliveries one fails, each way; 0: none does.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Faults {
    pub(crate) delivered_late: u32,
    pub(crate) delivered_twice: u32,
    pub(crate) delivered_in_the_wrong_order: u32,
    pub(crate) not_delivered: u32,
    pub(crate) following_ended: u32,
    pub(crate) request_lost: u32,
    pub(crate) answer_lost: u32,
    /// A leader that has just been elected, or was one, gives the entry before the newest, or none.
    pub(crate) read_behind: u32,
}

impl Faults {
    /// One of a few, each way.
    pub(crate) fn many() -> Self {
        Self {
            delivered_late: 5,
            delivered_twice: 4,
            delivered_in_the_wrong_order: 5,
            not_delivered: 6,
            following_ended: 12,
            request_lost: 6,
            answer_lost: 6,
            read_behind: 6,
        }
    }
}

#[derive(Default)]
struct World {
    /// Every entry ever written, in order: its position is its place here, from 1.
    log: Vec<(String, Vec<u8>)>,
    newest: HashMap<String, u64>,
    objects: HashMap<String, (Vec<u8>, SystemTime)>,
    uploads: HashMap<String, Vec<u8>>,
    /// By kind and name.
    jobs: BTreeMap<(String, String), Waiting>,
    dice: u64,
    /// Counts the elections.
    term: u64,
    /// A position that is not delivered.
    passed_over: Option<u64>,
    /// A position at which a copy of the log, from which entries are delivered, has what stood under the key before.
    differing: Option<u64>,
    /// By how much its clock is behind the servers'.
    clock_behind: Duration,
}

/// For so long nobody else gets a job of which nothing is heard.
pub(crate) const LEASE: Duration = Duration::from_millis(300);

#[derive(Clone, Debug)]
struct Waiting {
    payload: Vec<u8>,
    times_taken: u64,
    /// Nobody gets it before.
    not_before: Instant,
}

impl World {
    /// Finds what stood under the key of the entry at a position before it.
    fn before(&self, position: u64) -> Vec<u8> {
        let (earlier, key) = (&self.log[..position as usize - 1], &self.log[position as usize - 1].0);
        earlier.iter().rfind(|(other, _)| other == key).expect("another entry of the key").1.clone()
    }

    fn now(&self) -> SystemTime {
        SystemTime::now() - self.clock_behind
    }

    /// Whether it happens, once in `often` times.
    fn happens(&mut self, often: u32) -> bool {
        self.dice ^= self.dice << 13;
        self.dice ^= self.dice >> 7;
        self.dice ^= self.dice << 17;
        often > 0 && self.dice.is_multiple_of(u64::from(often))
    }
}

#[derive(Default)]
struct Shared {
    world: Mutex<World>,
    written: Condvar,
}

impl Shared {
    fn world(&self) -> MutexGuard<'_, World> {
        self.world.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A connection to it; clones lead to the same.
#[derive(Clone)]
pub(crate) struct FakeEngine {
    shared: Arc<Shared>,
    faults: Faults,
}

fn silent(doing: &'static str) -> EngineError {
    EngineError::Silent { doing, reason: "it is a fake".into() }
}

impl FakeEngine {
    pub(crate) fn new(seed: u64, faults: Faults) -> Self {
        let shared = Shared::default();
        shared.world().dice = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        Self { shared: Arc::new(shared), faults }
    }

    /// Damages, or takes away, an object.
    pub(crate) fn spoil(&self, name: &str, bytes: Option<&[u8]>) {
        let mut world = self.shared.world();
        let now = world.now();
        match bytes {
            Some(bytes) => drop(world.objects.insert(name.into(), (bytes.into(), now))),
            None => drop(world.objects.remove(name)),
        }
    }

    /// Loses the last entries, and an object, in an election.
    pub(crate) fn lose(&self, entries: usize, object: &str) {
        let mut world = self.shared.world();
        let left = world.log.len() - entries;
        world.log.truncate(left);
        world.newest = (1..).zip(&world.log).map(|(position, (key, _))| (key.clone(), position)).collect();
        world.objects.remove(object);
        world.term += 1;
    }

    /// Does not deliver the next entry to anybody, until all are delivered again.
    pub(crate) fn pass_over_next(&self) {
        let mut world = self.shared.world();
        world.passed_over = Some(world.log.len() as u64 + 1);
    }

    /// Delivers at the position of the newest entry what stood under its key before, as from a copy that differs.
    pub(crate) fn have_copies_differ(&self) {
        let mut world = self.shared.world();
        world.differing = Some(world.log.len() as u64);
    }

    /// Has the leader's newest entry be what stood under its key before, as on a copy that differs.
    pub(crate) fn have_leader_differ(&self) {
        let mut world = self.shared.world();
        let newest = world.log.len();
        let before = world.before(newest as u64);
        world.log[newest - 1].1 = before;
        world.term += 1;
    }

    /// Delivers all entries to those that follow anew.
    pub(crate) fn deliver_all(&self) {
        self.shared.world().passed_over = None;
    }

    /// Elects another leader.
    pub(crate) fn elect(&self) {
        self.shared.world().term += 1;
    }

    /// Sets its clock back, or, as one would see it from here, those of the servers ahead.
    pub(crate) fn set_clock_behind(&self, by: Duration) {
        self.shared.world().clock_behind = by;
    }

    pub(crate) fn object_count(&self) -> usize {
        self.shared.world().objects.len()
    }

    /// Loses the request, does it, or does it and loses the answer.
    fn call<T>(&self, doing: &'static str, what: impl FnOnce(&mut World) -> T) -> Result<T, EngineError> {
        let mut world = self.shared.world();
        if world.happens(self.faults.request_lost) {
            return Err(silent(doing));
        }
        let done = what(&mut world);
        let lost = world.happens(self.faults.answer_lost);
        drop(world);
        self.shared.written.notify_all();
        if lost { Err(silent(doing)) } else { Ok(done) }
    }
}

impl Engine for FakeEngine {
    fn put_object(&self, name: &str, bytes: &[u8]) -> Result<(), EngineError> {
        // The real one tries again by itself.
        let put = || {
            self.call("keep an object", |world| {
                let now = world.now();
                world.objects.insert(name.into(), (bytes.into(), now));
            })
        };
        (0..20).find_map(|_| put().ok()).ok_or_else(|| silent("keep an object"))
    }

    fn object(&self, name: &str) -> Result<Option<Vec<u8>>, EngineError> {
        let get = || self.call("give an object", |world| world.objects.get(name).map(|(bytes, _)| bytes.clone()));
        (0..20).find_map(|_| get().ok()).ok_or_else(|| silent("give an object"))
    }

    fn keep_upload(&self, name: &str, bytes: &[u8]) -> Result<(), EngineError> {
        self.call("keep an upload", |world| drop(world.uploads.insert(name.into(), bytes.into())))
    }

    fn upload(&self, name: &str) -> Result<Option<Vec<u8>>, EngineError> {
        self.call("give an upload", |world| world.uploads.get(name).cloned())
    }

    fn remove_upload(&self, name: &str) -> Result<(), EngineError> {
        self.call("remove an upload", |world| drop(world.uploads.remove(name)))
    }

    fn write(&self, key: &str, expected: u64, bytes: &[u8]) -> Result<Written, EngineError> {
        self.call("keep an entry", |world| {
            if world.newest.get(key).copied().unwrap_or(0) != expected {
                return Written::Elsewhere;
            }
            world.log.push((key.into(), bytes.into()));
            let position = world.log.len() as u64;
            world.newest.insert(key.into(), position);
            Written::At(position)
        })
    }

    fn read(&self, key: &str) -> Result<Option<Entry>, EngineError> {
        self.call("give an entry", |world| {
            let newest = world.newest.get(key).copied()?;
            let position = if world.happens(self.faults.read_behind) {
                world.log[..newest as usize - 1].iter().rposition(|(other, _)| other == key)? as u64 + 1
            } else {
                newest
            };
            let bytes = world.log[position as usize - 1].1.clone();
            Some(Entry { position, bytes })
        })
    }

    fn keys(&self) -> Result<u64, EngineError> {
        self.call("count its keys", |world| world.newest.len() as u64)
    }

    fn key_names(&self) -> Result<Vec<String>, EngineError> {
        self.call("name its keys", |world| world.newest.keys().cloned().collect())
    }

    fn leader(&self) -> Result<String, EngineError> {
        self.call("tell its leader", |world| world.term.to_string())
    }

    fn newest(&self) -> Result<u64, EngineError> {
        let newest = || self.call("tell its newest entry", |world| world.log.len() as u64);
        (0..20).find_map(|_| newest().ok()).ok_or_else(|| silent("tell its newest entry"))
    }

    fn follow(&self, after: u64) -> Result<Box<dyn Deliveries>, EngineError> {
        self.call("be followed", |_| ())?;
        Ok(Box::new(Followed { engine: self.clone(), position: after, number: 0, waiting: VecDeque::new() }))
    }

    fn add_job(&self, kind: &str, name: &str, payload: &[u8]) -> Result<bool, EngineError> {
        self.call("take a job", |world| {
            let key = (kind.to_owned(), name.to_owned());
            let is_new = !world.jobs.contains_key(&key);
            let fresh = || Waiting { payload: payload.into(), times_taken: 0, not_before: Instant::now() };
            world.jobs.entry(key).or_insert_with(fresh);
            is_new
        })
    }

    fn take_job(&self, kind: &str, wait: Duration) -> Result<Option<Box<dyn Job>>, EngineError> {
        let begun = Instant::now();
        // A request is lost once or not at all, however long it waits.
        self.call("give a job", |_| ())?;
        loop {
            let taken = {
                let mut world = self.shared.world();
                let mut waiting = world.jobs.iter_mut().filter(|((own, _), _)| own == kind);
                waiting.find(|(_, job)| job.not_before <= Instant::now()).map(|((kind, name), job)| {
                    (job.times_taken, job.not_before) = (job.times_taken + 1, Instant::now() + LEASE);
                    Taken { engine: self.clone(), key: (kind.clone(), name.clone()), job: job.clone() }
                })
            };
            if let Some(taken) = taken {
                return Ok(Some(Box::new(taken)));
            }
            if begun.elapsed() >= wait {
                return Ok(None);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn jobs(&self) -> Result<u64, EngineError> {
        self.call("count its jobs", |world| world.jobs.len() as u64)
    }

    fn clock(&self) -> Result<SystemTime, EngineError> {
        self.call("tell its time", |world| world.now())
    }

    fn collect(&self, before: SystemTime, is_used: &dyn Fn(&str) -> bool) -> Result<u64, EngineError> {
        self.call("remove objects", |world| {
            let count = world.objects.len();
            world.objects.retain(|name, (_, put)| *put >= before || is_used(name));
            (count - world.objects.len()) as u64
        })
    }
}

struct Taken {
    engine: FakeEngine,
    key: (String, String),
    job: Waiting,
}

impl Taken {
    fn put_off(&self, doing: &'static str, pause: Duration) -> Result<(), EngineError> {
        self.engine.call(doing, |world| {
            // Of somebody else meanwhile, or done: what is said comes too late.
            if let Some(job) = world.jobs.get_mut(&self.key).filter(|job| job.times_taken == self.job.times_taken) {
                job.not_before = Instant::now() + pause;
            }
        })
    }
}

impl Job for Taken {
    fn name(&self) -> &str {
        &self.key.1
    }

    fn payload(&self) -> &[u8] {
        &self.job.payload
    }

    fn times_taken(&self) -> u64 {
        self.job.times_taken
    }

    fn goes_on(&self) -> Result<(), EngineError> {
        self.put_off("hear that a job goes on", LEASE)
    }

    fn done(&self) -> Result<(), EngineError> {
        self.engine.call("hear that a job is done", |world| drop(world.jobs.remove(&self.key)))
    }

    fn give_back(&self, pause: Duration) -> Result<(), EngineError> {
        self.put_off("take a job back", pause)
    }
}

struct Followed {
    engine: FakeEngine,
    position: u64,
    number: u64,
    waiting: VecDeque<Delivery>,
}

impl Followed {
    /// Takes what is new from the log, as the network would bring it.
    fn fetch(&mut self, world: &mut World) {
        let faults = self.engine.faults;
        while self.position < world.log.len() as u64 {
            self.position += 1;
            let (key, mut bytes) = world.log[self.position as usize - 1].clone();
            if world.differing == Some(self.position) {
                bytes = world.before(self.position);
            }
            // Of each key the newest entry is kept.
            let is_passed_over = world.passed_over == Some(self.position);
            if world.newest[&key] != self.position || is_passed_over {
                continue;
            }
            self.number += 1;
            let (number, left) = (self.number, world.log.len() as u64 - self.position);
            let delivery = Delivery { number, key, entry: Entry { position: self.position, bytes }, left };
            if world.happens(faults.not_delivered) {
                continue;
            }
            if world.happens(faults.delivered_twice) {
                self.waiting.push_back(delivery.clone());
            }
            if world.happens(faults.delivered_in_the_wrong_order) && !self.waiting.is_empty() {
                let before_the_last = self.waiting.len() - 1;
                self.waiting.insert(before_the_last, delivery);
            } else {
                self.waiting.push_back(delivery);
            }
        }
    }
}

impl Deliveries for Followed {
    fn next(&mut self, wait: Duration) -> Result<Option<Delivery>, EngineError> {
        let begun = Instant::now();
        let shared = Arc::clone(&self.engine.shared);
        let mut world = shared.world();
        if world.happens(self.engine.faults.following_ended) {
            return Err(silent("deliver"));
        }
        loop {
            self.fetch(&mut world);
            if let Some(delivery) = self.waiting.pop_front() {
                let late = world.happens(self.engine.faults.delivered_late);
                drop(world);
                if late {
                    std::thread::sleep(Duration::from_millis(10));
                }
                return Ok(Some(delivery));
            }
            let Some(left) = wait.checked_sub(begun.elapsed()) else { return Ok(None) };
            world = shared.written.wait_timeout(world, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}
