//! Writes again what the engine acknowledged and lost.
//!
//! A node that is killed while it catches up, and leads soon after, can make JetStream 2.9 lose the end of a stream,
//! acknowledged messages too (in 200 kills under more load than the machine could take: one entry, one object). Every
//! server therefore remembers for a while what was written, and looks whether it is there after another node has become
//! the leader. What is not there is written again: nothing else is, as each write names the position that it follows.
//!
//! A stream that lost its end gives its positions away again. So that none stands for two entries, it is filled up first
//! to where this server knows that it was, and followed anew from a little before.
//!
//! A follower, too, can be passed over: after a split JetStream 2.9 was seen not to deliver an entry to one of three servers,
//! and to deliver what came after it, also to a server that had just joined. So keys are counted at each look, and those that
//! are missing are read from the leader. All entries are followed again where many are missing, or where they are not too
//! many. A server that joins can't know how long ago the last election was; it looks as after one.
//!
//! After a split on a slow machine the copies of a stream were seen to differ: two servers knew one change of an example, and
//! one that joined was delivered another, which nobody had acknowledged. So what is known is compared with what the
//! leader of the stream has. A newer entry of the leader is taken in. Where two differ at one position, the one that was
//! acknowledged is written again: a new position is delivered to everybody, from whichever copy.

use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use quadmuse_store::ContentHash;

use crate::cache::Cache;
use crate::engine::{Engine, EngineError, Entry, Written};
use crate::follow::AGAIN;
use crate::inner::Inner;
use crate::manifest::DOCUMENT;

/// How long it is remembered what was written, and how much at most.
const REMEMBERED: Duration = Duration::from_secs(300);
const REMEMBERED_MAX: usize = 4096;
/// How often the engine is asked who leads.
const ASKED: Duration = Duration::from_secs(1);
/// How long after another node began to lead it is looked: at first it may not know all that it will.
pub(crate) const LOOKED_AFTER: [Duration; 3] =
    [Duration::from_secs(3), Duration::from_secs(15), Duration::from_secs(60)];
/// The document that a stream is filled up with.
const FILLER: &str = "filler";
/// Where there are no more keys, all entries are followed again after an election: 100,000 take some two seconds.
const FOLLOWED_AGAIN_MAX: u64 = 200_000;
/// Most entries that a stream is filled up with: more than a stream can lose in the time that is remembered.
const FILLED_MAX: u64 = 100_000;

/// An entry that came from the engine.
#[derive(Clone, Debug, PartialEq)]
struct Came {
    entry: Entry,
    /// True where the engine acknowledged it to this server, which told its caller so.
    is_own: bool,
}

/// What was written in the last minutes.
#[derive(Default)]
pub(crate) struct Recent {
    entries: Mutex<VecDeque<(Instant, String, Came)>>,
    objects: Mutex<VecDeque<(Instant, ContentHash)>>,
}

impl Recent {
    /// Remembers an entry that was delivered.
    pub(crate) fn came(&self, key: &str, entry: &Entry) {
        self.remember(key, Came { entry: entry.clone(), is_own: false });
    }

    /// Remembers an entry that this server wrote, and that the engine acknowledged.
    pub(crate) fn wrote(&self, key: &str, entry: &Entry) {
        self.remember(key, Came { entry: entry.clone(), is_own: true });
    }

    fn remember(&self, key: &str, came: Came) {
        let mut entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        entries.push_back((Instant::now(), key.to_owned(), came));
        forget(&mut entries, |(at, _, _)| *at);
    }

    /// Remembers an object that this server put.
    pub(crate) fn put(&self, name: ContentHash) {
        let mut objects = self.objects.lock().unwrap_or_else(PoisonError::into_inner);
        objects.push_back((Instant::now(), name));
        forget(&mut objects, |(at, _)| *at);
    }

    /// The newest entry of each key; of two at one position this server's own, or else the one that came last.
    fn entries(&self) -> HashMap<String, Came> {
        let entries = self.entries.lock().unwrap_or_else(PoisonError::into_inner);
        let mut newest: HashMap<String, Came> = HashMap::new();
        for (_, key, came) in entries.iter() {
            let counts = |there: &Came| (there.entry.position, there.is_own) <= (came.entry.position, came.is_own);
            if newest.get(key).is_none_or(counts) {
                newest.insert(key.clone(), came.clone());
            }
        }
        newest
    }

    fn objects(&self) -> Vec<ContentHash> {
        let objects = self.objects.lock().unwrap_or_else(PoisonError::into_inner);
        objects.iter().map(|(_, name)| *name).collect()
    }
}

fn forget<T>(remembered: &mut VecDeque<T>, at: impl Fn(&T) -> Instant) {
    while remembered.len() > REMEMBERED_MAX || remembered.front().is_some_and(|one| at(one).elapsed() > REMEMBERED) {
        remembered.pop_front();
    }
}

/// Looks after what was written.
pub(crate) struct Healer {
    pub(crate) engine: Arc<dyn Engine>,
    pub(crate) inner: Arc<Inner>,
    pub(crate) cache: Arc<Cache>,
    /// How long after another node began to lead it is looked, in ascending order.
    pub(crate) looked_after: [Duration; 3],
    pub(crate) stopping: Arc<AtomicBool>,
}

impl Healer {
    /// Asks who leads, and looks when that has changed, and at first, until it is stopped. Blocks.
    pub(crate) fn run(&self) {
        let mut leader: Option<String> = None;
        let mut due: VecDeque<Instant> = VecDeque::new();
        while !self.stopping.load(Ordering::Relaxed) {
            std::thread::park_timeout(ASKED);
            if let Ok(now) = self.engine.leader() {
                if leader.as_ref() != Some(&now) {
                    let begun = Instant::now();
                    due = self.looked_after.iter().map(|after| begun + *after).collect();
                }
                leader = Some(now);
            }
            if due.front().is_some_and(|due| *due <= Instant::now()) {
                due.pop_front();
                match self.look(due.len() + 1 == self.looked_after.len(), due.is_empty()) {
                    // Someone who knows too little looks on.
                    Ok(false) if due.is_empty() => {
                        due.extend(self.looked_after.last().map(|after| Instant::now() + *after))
                    }
                    // What is on its way is there at the next look.
                    Ok(_) => {}
                    Err(error) => {
                        tracing::debug!(%error, "what was written could not be looked for; that is tried again");
                    }
                }
            }
        }
    }

    /// Looks whether what was written lately is there, and writes again what is not; whether all is there now, and known here.
    /// `is_first`: others may not have looked yet. `is_last`: an engine that is still behind will not catch up.
    fn look(&self, is_first: bool, is_last: bool) -> Result<bool, EngineError> {
        let is_complete = self.inner.read_missing(&*self.engine)?;
        // A newer entry of a key that is known may be what did not come.
        let may_all = self.inner.state().keys() <= FOLLOWED_AGAIN_MAX;
        self.inner.follow_anew(if is_complete && !may_all { AGAIN } else { u64::MAX });
        if !is_complete {
            tracing::warn!("entries of the engine did not come; all are followed again");
        }
        for name in self.inner.recent.objects() {
            if self.is_stopping() {
                return Ok(false);
            }
            if self.engine.object(&name.to_string())?.is_none()
                && let Some(bytes) = self.cache.get(name)
            {
                tracing::warn!(%name, "the engine lost an object that it had acknowledged; it is put again");
                self.engine.put_object(&name.to_string(), &bytes)?;
            }
        }
        let known = self.inner.progress().position;
        let mut newest = self.engine.newest()?;
        if newest < known && is_last {
            tracing::warn!(newest, known, "the engine lost the end of its entries; it is filled up");
            newest = self.filled_to(known)?;
        }
        let mut all = is_complete && newest >= known;
        for (key, came) in self.inner.recent.entries() {
            if self.is_stopping() {
                return Ok(false);
            }
            // A newer one is known, or the engine may just be behind.
            if self.inner.state().position(&key) != came.entry.position || newest < came.entry.position {
                continue;
            }
            all &= self.compare(&key, came, is_first)?;
        }
        Ok(all)
    }

    /// Compares the newest entry of a key that is known with the one that the stream's leader has, and mends what
    /// differs; `false` if another server is at it, too.
    fn compare(&self, key: &str, came: Came, is_first: bool) -> Result<bool, EngineError> {
        let Came { entry, is_own } = came;
        let there = self.engine.read(key)?.unwrap_or(Entry::NONE);
        let again = match there.position.cmp(&entry.position) {
            std::cmp::Ordering::Less => {
                tracing::warn!(key, position = entry.position, "the engine lost an entry that it had acknowledged");
                entry.bytes
            }
            std::cmp::Ordering::Equal if there.bytes != entry.bytes => {
                tracing::warn!(key, position = entry.position, "the engine's copies of an entry differ");
                self.inner.take_in(&[(key, &there)]);
                match is_own {
                    true => entry.bytes,
                    // Who wrote it looks at first, and knows which of the two was acknowledged.
                    false if is_first => return Ok(true),
                    false => there.bytes,
                }
            }
            std::cmp::Ordering::Equal => return Ok(true),
            std::cmp::Ordering::Greater => {
                self.inner.take_in(&[(key, &there)]);
                return Ok(true);
            }
        };
        match self.engine.write(key, there.position, &again)? {
            Written::At(position) => {
                self.inner.wrote(key, &Entry { position, bytes: again });
                Ok(true)
            }
            Written::Elsewhere => Ok(false),
        }
    }

    /// Writes entries that mean nothing until the newest stands at `position`; where it stands then.
    fn filled_to(&self, position: u64) -> Result<u64, EngineError> {
        let key = format!("{DOCUMENT}{FILLER}");
        for _ in 0..FILLED_MAX {
            let newest = self.engine.newest()?;
            if newest >= position || self.is_stopping() {
                return Ok(newest);
            }
            let there = self.engine.read(&key)?.map_or(0, |there| there.position);
            self.engine.write(&key, there, b"")?;
        }
        self.engine.newest()
    }

    fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }
}
