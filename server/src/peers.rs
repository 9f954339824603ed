//! The servers that share a corpus: who they are, at which addresses they reach each other, and how one knows another.
//!
//! All stand in one document beside the corpus. Each start of a server takes the next number, which its ids carry
//! ([`ServerNumber`]); so an id of a server that was started anew is known to be of the one before. A server that starts
//! at an address takes the place of whoever stood there. Each says once a minute that it is alive; whether one answers is
//! found by asking it, though, not by these signs of life: they tell whom to ask for lists, and which lines to forget.
//!
//! What one server passes on to another is sealed with a secret of the document ([`Peers::seal`]), which is never sent.

mod list;

use list::{List, Record};
use quadmuse_proto::Share;
use quadmuse_proto::id::ServerNumber;
use quadmuse_store::{Documents, StoreError};
use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};
use tokio_util::sync::CancellationToken;

/// The document's name.
const NAME: &str = "servers";

/// How often a change of the document is tried while others change it, too.
const TRIES: usize = 32;

/// How often a server says that it is alive.
const RENEW_EVERY: Duration = Duration::from_secs(60);

/// A server that has not said for so long that it is alive is not asked for lists.
const SILENT_MAX: Duration = Duration::from_secs(300);

/// Shortest time between two questions for the document because of a number that nobody knows: invented ids cost no more.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Where what has an id lives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Whereabouts {
    /// On this server.
    Here,
    /// On the server that others reach at this address (`http://host:port`).
    There(ServerNumber, String),
    /// On a server that has ended.
    Gone(ServerNumber),
    /// The number is none of those there are.
    Unknown,
}

/// Says where a server keeps what an id leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StorageMedium {
    /// In its memory: it ends with the process.
    InMemory,
    /// On its disk: whoever starts there again has it.
    OnDisk,
}

/// Another server: its number and its address.
pub type Other = (ServerNumber, String);

/// Who has a share in memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HoldersOf {
    /// Those that hold this share.
    pub exact: Vec<Other>,
    /// Those that hold everything.
    pub whole: Vec<Other>,
    /// Either, of whom nothing was heard for long. They may have ended without a word.
    pub silent: Vec<Other>,
}

/// The servers that share a corpus, as this one of them knows them.
pub struct Peers {
    documents: Arc<dyn Documents>,
    own: ServerNumber,
    address: String,
    share: Option<Share>,
    secret: blake3::Hash,
    seen: Mutex<PeerListCache>,
}

/// The list of servers as it was read last.
#[derive(Default)]
struct PeerListCache {
    revision: u64,
    list: List,
    signs: Signs,
    looked: Option<Instant>,
}

impl Peers {
    /// Joins them as the one that the others reach at `address`, with a number of its own. It holds the whole corpus in
    /// memory. Blocks.
    ///
    /// # Errors
    /// As [`Peers::join_with`].
    pub fn join(documents: Arc<dyn Documents>, address: &str) -> Result<Self, StoreError> {
        Self::join_with(documents, address, None)
    }

    /// The same with a share of the corpus.
    ///
    /// # Errors
    /// [`StoreError`] if the engine does not answer, or holds something else.
    pub fn join_with(documents: Arc<dyn Documents>, address: &str, share: Option<Share>) -> Result<Self, StoreError> {
        let mut random = [0; 32];
        getrandom::fill(&mut random).map_err(|_| StoreError::Invalid {
            field: "the system's random source",
            expected: "to give bytes".into(),
            found: "none".into(),
        })?;
        let (own, list) = change(&*documents, |list| {
            list.secret.get_or_insert_with(|| blake3::Hash::from_bytes(random).to_hex().to_string());
            list.enter(address, share, now_s())
        })?;
        let secret = list.secret.as_deref().and_then(|secret| blake3::Hash::from_hex(secret).ok());
        let secret = secret.ok_or_else(|| StoreError::Invalid {
            field: "the secret of the servers",
            expected: "in hex".into(),
            found: "another text".into(),
        })?;
        let mut seen = PeerListCache { list, ..PeerListCache::default() };
        seen.signs.note(&seen.list, Instant::now(), now_s());
        let seen = Mutex::new(seen);
        Ok(Self { documents, own, address: address.to_owned(), share, secret, seen })
    }

    /// This server's number.
    pub fn own(&self) -> ServerNumber {
        self.own
    }

    /// Where what a server keeps is, as far as this one knows without asking anybody.
    pub fn place_of(&self, number: ServerNumber, kept: StorageMedium) -> Whereabouts {
        if number == self.own {
            return Whereabouts::Here;
        }
        let seen = self.now();
        let Some(found) = seen.list.record(number) else { return Whereabouts::Unknown };
        let stands = match kept {
            StorageMedium::InMemory => Some(found),
            StorageMedium::OnDisk => seen.list.newest_at(&found.address),
        };
        match stands {
            Some(record) if record.number == self.own => Whereabouts::Here,
            Some(record) if !record.has_left => Whereabouts::There(record.number, record.address.clone()),
            _ => Whereabouts::Gone(number),
        }
    }

    /// Asks the engine for the document, as one may have come that is not known yet; not more often than makes sense. Blocks.
    pub fn look_again(&self) {
        let is_soon = |seen: &PeerListCache| seen.looked.is_some_and(|looked| looked.elapsed() < LOOK_EVERY);
        {
            let mut seen = lock(&self.seen);
            if is_soon(&seen) {
                return;
            }
            seen.looked = Some(Instant::now());
        }
        match self.documents.read(NAME) {
            Ok(Some(document)) => lock(&self.seen).take(&document),
            Ok(None) => {}
            Err(error) => tracing::debug!(%error, "the servers are not known anew"),
        }
    }

    /// The others that are likely to answer: their numbers and addresses.
    pub fn others(&self) -> Vec<Other> {
        let (seen, now) = (self.now(), Instant::now());
        let alive = |record: &&Record| !record.has_left && !seen.signs.is_silent(record.number, now);
        let others = seen.list.servers.iter().filter(alive).filter(|record| record.number != self.own);
        others.map(|record| (record.number, record.address.clone())).collect()
    }

    /// The others that have a share in memory.
    pub fn holders(&self, share: Share) -> HoldersOf {
        let (seen, now) = (self.now(), Instant::now());
        let mut found = HoldersOf::default();
        let others = seen.list.servers.iter().filter(|record| !record.has_left && record.number != self.own);
        for record in others {
            let place = match record.share {
                _ if seen.signs.is_silent(record.number, now) => &mut found.silent,
                Some(own) if own == share => &mut found.exact,
                None => &mut found.whole,
                Some(_) => continue,
            };
            if record.share.is_none_or(|own| own == share) {
                place.push((record.number, record.address.clone()));
            }
        }
        found
    }

    fn now(&self) -> MutexGuard<'_, PeerListCache> {
        let known = self.documents.known(NAME);
        let mut seen = lock(&self.seen);
        if let Some(document) = known {
            seen.take(&document);
        }
        seen
    }

    /// Says that this server is alive. Blocks.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn renew(&self) -> Result<(), StoreError> {
        let (is_replaced, _) =
            change(&*self.documents, |list| list.renew(self.own, &self.address, self.share, now_s()))?;
        if is_replaced {
            tracing::error!(
                address = self.address,
                "another server was started under this server's address: what is passed on goes there; give each its own --advertise"
            );
        }
        Ok(())
    }

    /// Says that this server ends, so that nobody tries to reach it. Blocks.
    ///
    /// # Errors
    /// [`StoreError`].
    pub fn leave(&self) -> Result<(), StoreError> {
        change(&*self.documents, |list| list.leave(self.own)).map(drop)
    }

    /// What proves to the server `to` that this one passes on a request of `peer`: a line for a header. It holds for this
    /// method and target alone.
    pub fn seal(&self, to: ServerNumber, peer: Option<IpAddr>, method: &str, target: &str) -> String {
        let peer = peer.map_or_else(|| NOBODY.to_owned(), |peer| peer.to_string());
        let proof = self.proof(&to.to_string(), &peer, method, target);
        format!("{to} {peer} {}", proof.to_hex())
    }

    /// Whom a request was passed on to, and for whom; `None` if no server of the corpus sealed this.
    pub fn open(&self, sealed: &str, method: &str, target: &str) -> Option<ForwardedRequest> {
        let mut words = sealed.split(' ');
        let (to, peer, proof) = (words.next()?, words.next()?, words.next()?);
        let proof = blake3::Hash::from_hex(proof).ok()?;
        // Hashes are compared in constant time.
        let is_sealed = words.next().is_none() && proof == self.proof(to, peer, method, target);
        let to = to.parse().ok().and_then(ServerNumber::new);
        let peer = if peer == NOBODY { None } else { Some(peer.parse().ok()?) };
        is_sealed.then_some(ForwardedRequest { to: to?, peer })
    }

    fn proof(&self, to: &str, peer: &str, method: &str, target: &str) -> blake3::Hash {
        let mut hasher = blake3::Hasher::new_keyed(self.secret.as_bytes());
        for part in [to, peer, method, target] {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
        }
        hasher.finalize()
    }
}

/// Stands for a peer without an address.
const NOBODY: &str = "-";

/// A request that another server passed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ForwardedRequest {
    /// To whom.
    pub to: ServerNumber,
    /// The address of the client.
    pub peer: Option<IpAddr>,
}

impl PeerListCache {
    fn take(&mut self, document: &quadmuse_store::Document) {
        if document.revision <= self.revision {
            return;
        }
        self.revision = document.revision;
        match List::parse(&document.bytes) {
            Ok(list) => {
                self.list = list;
                self.signs.note(&self.list, Instant::now(), now_s());
            }
            Err(error) => tracing::error!(%error, "the list of servers can't be read; the one before holds"),
        }
    }
}

/// When the servers said last that they are alive, by this server's own time: no two clocks are compared, save for what
/// was said before it came.
#[derive(Default)]
struct Signs(HashMap<ServerNumber, Sign>);

struct Sign {
    /// As the server wrote it, by its clock.
    seen_s: u64,
    /// When that came here; `None`: long ago.
    came: Option<Instant>,
}

impl Signs {
    /// Takes in a list that came at `now`, which is `now_s` by this machine's clock.
    fn note(&mut self, list: &List, now: Instant, now_s: u64) {
        let is_first = self.0.is_empty();
        self.0.retain(|number, _| list.record(*number).is_some());
        for record in &list.servers {
            let is_old = is_first && record.seen_s + SILENT_MAX.as_secs() < now_s;
            let sign = Sign { seen_s: record.seen_s, came: (!is_old).then_some(now) };
            if self.0.get(&record.number).is_none_or(|before| before.seen_s != sign.seen_s) {
                self.0.insert(record.number, sign);
            }
        }
    }

    fn is_silent(&self, number: ServerNumber, now: Instant) -> bool {
        let came = self.0.get(&number).and_then(|sign| sign.came);
        came.is_none_or(|came| now.saturating_duration_since(came) > SILENT_MAX)
    }
}

/// Changes the document; what the change gives, and the list after it.
fn change<T>(documents: &dyn Documents, change: impl Fn(&mut List) -> T) -> Result<(T, List), StoreError> {
    for _ in 0..TRIES {
        let now = documents.read(NAME)?;
        let mut list = now.as_ref().map_or_else(|| Ok(List::default()), |document| List::parse(&document.bytes))?;
        let changed = change(&mut list);
        if documents.write(NAME, now.map_or(0, |document| document.revision), &list.to_bytes()?)? {
            return Ok((changed, list));
        }
    }
    Err(StoreError::Busy)
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn now_s() -> u64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |time| time.as_secs())
}

/// Says once a minute that this server is alive, until `stopping`.
pub async fn run(peers: Arc<Peers>, stopping: CancellationToken) {
    while stopping.run_until_cancelled(tokio::time::sleep(RENEW_EVERY)).await.is_some() {
        let peers = Arc::clone(&peers);
        if let Ok(Err(error)) = tokio::task::spawn_blocking(move || peers.renew()).await {
            tracing::warn!(%error, "not said that this server is alive");
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use quadmuse_store::Document;

    /// Documents in memory, as several servers would share them.
    #[derive(Default)]
    pub(crate) struct InMemory(Mutex<HashMap<String, Document>>);

    impl Documents for InMemory {
        fn known(&self, name: &str) -> Option<Document> {
            lock(&self.0).get(name).cloned()
        }

        fn read(&self, name: &str) -> Result<Option<Document>, StoreError> {
            Ok(self.known(name))
        }

        fn write(&self, name: &str, expected: u64, bytes: &[u8]) -> Result<bool, StoreError> {
            let mut all = lock(&self.0);
            let found = all.get(name).map_or(0, |document| document.revision);
            if found == expected {
                all.insert(name.into(), Document { revision: found + 1, bytes: bytes.into() });
            }
            Ok(found == expected)
        }
    }

    fn joined(documents: &Arc<InMemory>, address: &str) -> Peers {
        Peers::join(Arc::clone(documents) as Arc<_>, address).expect("joined")
    }

    #[test]
    fn each_start_has_a_number_and_takes_the_place_of_the_one_before() {
        let documents = Arc::new(InMemory::default());
        let (a, b) = (joined(&documents, "http://a:1"), joined(&documents, "http://b:1"));
        assert_eq!(a.place_of(a.own(), StorageMedium::InMemory), Whereabouts::Here);
        assert_eq!(a.place_of(b.own(), StorageMedium::InMemory), Whereabouts::There(b.own(), "http://b:1".into()));
        assert_eq!(b.others(), [(a.own(), "http://a:1".to_owned())]);

        let again = joined(&documents, "http://a:1");
        assert_eq!(b.place_of(a.own(), StorageMedium::InMemory), Whereabouts::Gone(a.own()));
        assert_eq!(again.place_of(a.own(), StorageMedium::InMemory), Whereabouts::Gone(a.own()));
        // What lies on the disk is there after a start.
        assert_eq!(b.place_of(a.own(), StorageMedium::OnDisk), Whereabouts::There(again.own(), "http://a:1".into()));
        assert_eq!(again.place_of(a.own(), StorageMedium::OnDisk), Whereabouts::Here);
        assert_eq!(b.others(), [(again.own(), "http://a:1".to_owned())]);

        again.leave().expect("left");
        assert_eq!(b.place_of(again.own(), StorageMedium::InMemory), Whereabouts::Gone(again.own()));
        assert_eq!(b.place_of(again.own(), StorageMedium::OnDisk), Whereabouts::Gone(again.own()));
        assert!(b.others().is_empty());
        let unknown = ServerNumber::new(9999).expect("not 0");
        assert_eq!(b.place_of(unknown, StorageMedium::InMemory), Whereabouts::Unknown);
    }

    #[test]
    fn who_holds_a_share_is_known_to_the_others_and_said_again_with_each_sign_of_life() {
        let documents = Arc::new(InMemory::default());
        let share = |text: &str| text.parse::<Share>().expect("a share");
        let join = |address: &str, share| Peers::join_with(Arc::clone(&documents) as Arc<_>, address, share);
        let a = join("http://a:1", Some(share("1/2"))).expect("joined");
        let b = join("http://b:1", Some(share("2/2"))).expect("joined");
        let c = join("http://c:1", Some(share("2/2"))).expect("joined");
        let whole = join("http://d:1", None).expect("joined");
        let numbers = |found: HoldersOf| {
            let of = |some: Vec<Other>| some.into_iter().map(|(number, _)| number).collect::<Vec<_>>();
            [of(found.exact), of(found.whole), of(found.silent)]
        };
        assert_eq!(numbers(a.holders(share("2/2"))), [vec![b.own(), c.own()], vec![whole.own()], vec![]]);
        assert_eq!(numbers(b.holders(share("2/2"))), [vec![c.own()], vec![whole.own()], vec![]]);
        assert_eq!(numbers(a.holders(share("2/3"))), [vec![], vec![whole.own()], vec![]]);
        b.leave().expect("left");
        assert_eq!(numbers(a.holders(share("2/2")))[0], [c.own()]);

        // An older release wrote the list without shares.
        let written = documents.known(NAME).expect("a list");
        let text = String::from_utf8(written.bytes.to_vec()).expect("text").replace("\"share\"", "\"unknown\"");
        assert!(documents.write(NAME, written.revision, text.as_bytes()).expect("written"));
        assert!(numbers(a.holders(share("2/2")))[0].is_empty());
        c.renew().expect("renewed");
        assert_eq!(numbers(a.holders(share("2/2")))[0], [c.own()]);

        // Of what a server said an hour before this one came, or whose clock is an hour behind, it is asked when nobody
        // else answers, and not before.
        let written = documents.known(NAME).expect("a list");
        let mut list = List::parse(&written.bytes).expect("a list");
        list.servers.iter_mut().for_each(|record| record.seen_s -= 3600 * u64::from(record.number == c.own()));
        assert!(documents.write(NAME, written.revision, &list.to_bytes().expect("bytes")).expect("written"));
        let late = join("http://e:1", None).expect("joined");
        let [exact, _, silent] = numbers(late.holders(share("2/2")));
        assert_eq!((exact, silent), (vec![], vec![c.own()]));
        assert!(late.others().iter().all(|(number, _)| *number != c.own()));
        c.renew().expect("renewed");
        assert_eq!(numbers(late.holders(share("2/2")))[0], [c.own()]);
        assert_eq!(late.others().len(), 3);
    }

    #[test]
    fn a_server_is_silent_when_it_says_nothing_whatever_its_clock_says() {
        let mut list = List::default();
        let (behind, ahead) = (list.enter("http://a:1", None, 1_000), list.enter("http://b:1", None, 90_000));
        let (mut signs, begun) = (Signs::default(), Instant::now());
        signs.note(&list, begun, 50_000);
        let is_silent = |signs: &Signs, now| [behind, ahead].map(|number| signs.is_silent(number, now));
        assert_eq!(is_silent(&signs, begun), [true, false]);
        // Each says something; the clock of the second has been set back by a day, and that of this machine to the future.
        let mut now = begun + SILENT_MAX;
        list.renew(behind, "http://a:1", None, 1_060);
        list.renew(ahead, "http://b:1", None, 3_600);
        signs.note(&list, now, 500_000);
        assert_eq!(is_silent(&signs, now + SILENT_MAX), [false, false]);
        // Only the second goes on.
        now += SILENT_MAX;
        list.renew(ahead, "http://b:1", None, 3_660);
        signs.note(&list, now, 500_060);
        assert_eq!(is_silent(&signs, now + Duration::from_secs(1)), [true, false]);
        assert_eq!(is_silent(&signs, now + 2 * SILENT_MAX), [true, true]);
    }

    #[test]
    fn only_a_server_of_the_corpus_seals_and_only_for_one_request() {
        let documents = Arc::new(InMemory::default());
        let (a, b) = (joined(&documents, "http://a:1"), joined(&documents, "http://b:1"));
        let peer = Some(IpAddr::from([10, 0, 0, 7]));
        let sealed = a.seal(b.own(), peer, "GET", "/v1/queries/x?y=z");
        assert_eq!(b.open(&sealed, "GET", "/v1/queries/x?y=z"), Some(ForwardedRequest { to: b.own(), peer }));
        let nobody = a.seal(b.own(), None, "GET", "/");
        assert_eq!(b.open(&nobody, "GET", "/"), Some(ForwardedRequest { to: b.own(), peer: None }));
        assert_eq!(b.open(&sealed, "DELETE", "/v1/queries/x?y=z"), None);
        assert_eq!(b.open(&sealed, "GET", "/v1/queries/y?y=z"), None);
        assert_eq!(b.open(&sealed.replace("10.0.0.7", "10.0.0.8"), "GET", "/v1/queries/x?y=z"), None);
        for forged in ["", "2", "2 10.0.0.7", "2 10.0.0.7 00", "0 - -", &format!("{sealed} x")] {
            assert_eq!(b.open(forged, "GET", "/v1/queries/x?y=z"), None, "{forged}");
        }
        let stranger = joined(&Arc::new(InMemory::default()), "http://b:1");
        assert_eq!(b.open(&stranger.seal(b.own(), peer, "GET", "/"), "GET", "/"), None);
    }
}
