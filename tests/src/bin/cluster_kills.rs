//! Kills over all parts of a cluster under load, and what became of what was acknowledged.
//!
//! `cluster_kills [--kills 200] [--every 3]`: three nodes of a real engine and three servers, on loopback; three writers add
//! examples and rename them, a reader lists, and callers ask queries of one server, and maps of them, through another. Every few
//! seconds a part is killed (`kill -9`) and started again, or stopped for a while (SIGSTOP, as a split of the network looks to
//! the others): a server, a node, the next. At the end all servers, and one that joins afresh, are compared with what was
//! acknowledged, and every object is read. Ends with 1 if anything is missing, or if a map came late, came wrong, or was refused
//! without a problem that says why. Needs `nats-server`.

#[path = "../../../server/cluster/tests/support/nodes.rs"]
mod nodes;

use nodes::Nodes;
use quadmuse_tests::{
    binaries::program,
    http,
    kills::{self, Addresses, Maps, some},
    server::Server,
    shapes::{self, Faces},
    tool,
};
use std::{
    collections::BTreeMap,
    error::Error,
    net::SocketAddr,
    path::Path,
    process::{Command, ExitCode},
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

/// Servers, and nodes.
const COUNT: usize = 3;
/// For so long a part is away.
const AWAY: Duration = Duration::from_millis(1500);
/// Longest time for a server to start, however often it is tried.
const STARTS_WITHIN: Duration = Duration::from_secs(120);
/// Longest time until everything is quiet at the end.
const QUIET_WITHIN: Duration = Duration::from_secs(180);

/// What was acknowledged, and when.
#[derive(Default)]
struct History {
    /// The revision of each example that was acknowledged last.
    examples: Mutex<BTreeMap<String, u64>>,
    writes: Gaps,
    reads: Gaps,
    /// Reads that were older than the reader's own write.
    stale: AtomicU64,
    queries: [AtomicU64; 2],
    maps: Maps,
    is_over: AtomicBool,
}

/// The longest time between two successes.
struct Gaps(Mutex<(Instant, Duration, u64)>);

impl Default for Gaps {
    fn default() -> Self {
        Self(Mutex::new((Instant::now(), Duration::ZERO, 0)))
    }
}

impl Gaps {
    fn note(&self) {
        let mut now = self.0.lock().expect("not poisoned");
        *now = (Instant::now(), now.1.max(now.0.elapsed()), now.2 + 1);
    }

    fn summary(&self) -> (f64, u64) {
        let now = self.0.lock().expect("not poisoned");
        (now.1.as_secs_f64(), now.2)
    }
}

fn main() -> ExitCode {
    tool::ended(run(tool::number("--kills", 200), Duration::from_secs(tool::number("--every", 3))))
}

/// A server; one that ends while it starts is started again, as systemd does.
fn server(nodes: &Nodes, data: &Path) -> Result<Server, Box<dyn Error>> {
    let cluster = format!("QUADMUSE_CLUSTER={}", nodes.addresses());
    let words = ["env", &cluster, "QUADMUSE_BUCKET=studio", "QUADMUSE_LOG=error"];
    let begun = Instant::now();
    loop {
        match Server::start_under(&words, data) {
            Err(error) if begun.elapsed() < STARTS_WITHIN => eprintln!("started again: {error}"),
            started => return Ok(started?),
        }
    }
}

fn run(kills: u64, every: Duration) -> Result<bool, Box<dyn Error>> {
    let Some(mut nodes) = Nodes::start(COUNT) else { return Ok(true) };
    let dir = tempfile::tempdir()?;
    let data: Vec<_> = (0..COUNT).map(|at| dir.path().join(format!("server{at}"))).collect();
    let mut servers = data.iter().map(|data| server(&nodes, data).map(Some)).collect::<Result<Vec<_>, _>>()?;
    let addresses: Addresses = Mutex::new(servers.iter().map(|one| one.as_ref().map(Server::address)).collect());
    let history = History::default();
    let (begun, mut ended) = (Instant::now(), 0);
    std::thread::scope(|scope| -> Result<(), Box<dyn Error>> {
        for writer in 0..3 {
            let (history, addresses) = (&history, &addresses);
            scope.spawn(move || write(writer, addresses, history));
        }
        scope.spawn(|| read(&addresses, &history));
        scope.spawn(|| query(&addresses, &history));
        for caller in 0..COUNT {
            let (history, addresses) = (&history, &addresses);
            scope.spawn(move || kills::ask(caller, addresses, &history.maps, &history.is_over));
        }
        let struck = (0..kills).try_for_each(|kill| {
            std::thread::sleep(every);
            if kill % 20 == 0 {
                let [(_, writes), (_, reads)] = [history.writes.summary(), history.reads.summary()];
                eprintln!("{kill} kills, {:.0} s, {writes} writes, {reads} reads", begun.elapsed().as_secs_f64());
            }
            ended += note_ended(&mut servers, begun);
            strike(kill, &mut nodes, &mut servers, &data, &addresses)
        });
        history.is_over.store(true, Ordering::Relaxed);
        struck
    })?;
    println!("{kills} kills in {:.0} s; servers found ended before: {ended}", begun.elapsed().as_secs_f64());
    let is_whole = judged(&nodes, &history, dir.path(), servers.iter().flatten())?;
    Ok(is_whole && ended == 0)
}

/// Tells of servers that ended though nobody killed them: how many there are.
fn note_ended(servers: &mut [Option<Server>], begun: Instant) -> usize {
    let ended = servers.iter_mut().flatten().filter_map(|one| Some((one.ended()?, one)));
    ended
        .map(|(status, one)| {
            let (at, log) = (begun.elapsed().as_secs_f64(), one.log());
            eprintln!("at {at:.0} s the server at {} was found ended: {status}\n{log}", one.address());
        })
        .count()
}

/// One kill: in turn a server, a node, a server that is stopped, a node that is stopped.
fn strike(
    kill: u64,
    nodes: &mut Nodes,
    servers: &mut [Option<Server>],
    data: &[std::path::PathBuf],
    addresses: &Addresses,
) -> Result<(), Box<dyn Error>> {
    let at = (kill / 4) as usize % COUNT;
    match kill % 4 {
        0 => {
            addresses.lock().expect("not poisoned")[at] = None;
            if let Some(one) = servers[at].take() {
                one.kill()?;
            }
            std::thread::sleep(AWAY);
            let one = server(nodes, &data[at])?;
            addresses.lock().expect("not poisoned")[at] = Some(one.address());
            servers[at] = Some(one);
        }
        1 => {
            nodes.kill(at);
            std::thread::sleep(AWAY);
            nodes.revive(at);
        }
        2 => {
            if let Some(id) = servers[at].as_ref().map(|one| one.id().to_string()) {
                for signal in ["-STOP", "-CONT"] {
                    Command::new("kill").args([signal, &id]).status()?;
                    std::thread::sleep(AWAY);
                }
            }
        }
        _ => {
            nodes.signal(at, "-STOP");
            std::thread::sleep(2 * AWAY);
            nodes.signal(at, "-CONT");
        }
    }
    Ok(())
}

/// Adds an example and renames it twice, again and again, each on the next server.
fn write(writer: u32, addresses: &Addresses, history: &History) {
    for turn in 0.. {
        if history.is_over.load(Ordering::Relaxed) {
            return;
        }
        let Some(address) = some(addresses, turn) else { continue };
        let (mesh, name) = (kills::example(writer, turn), kills::name(writer, turn));
        let added = http::post(address, &format!("/v1/examples?name={name}"), "model/obj", mesh.as_bytes());
        let Some(example) = added.ok().filter(|answer| answer.status == 201).map(|answer| answer.json()) else {
            std::thread::sleep(Duration::from_millis(100));
            continue;
        };
        let id = example["id"].as_str().unwrap_or_default().to_owned();
        history.examples.lock().expect("not poisoned").insert(id.clone(), 1);
        history.writes.note();
        let path = format!("/v1/examples/{id}");
        for revision in 1..=2u64 {
            let body = format!("{{\"name\": \"{name}r{revision}\", \"revision\": {revision}}}");
            let length = body.len().to_string();
            let headers = [("content-type", "application/json"), ("content-length", length.as_str())];
            let renamed = http::ask(address, &format!("PATCH {path}"), &headers, body.as_bytes());
            if !renamed.is_ok_and(|answer| answer.status == 200) {
                break;
            }
            history.examples.lock().expect("not poisoned").insert(id.clone(), revision + 1);
            history.writes.note();
            if let Ok(answer) = http::get(address, &path)
                && (answer.status == 404 || answer.json()["revision"].as_u64().is_some_and(|found| found <= revision))
            {
                history.stale.fetch_add(1, Ordering::Relaxed);
                eprintln!("{id} is older than {} on the server that wrote it", revision + 1);
            }
        }
    }
}

fn read(addresses: &Addresses, history: &History) {
    for turn in 0.. {
        if history.is_over.load(Ordering::Relaxed) {
            return;
        }
        if let Some(address) = some(addresses, turn)
            && http::get(address, "/v1/examples?limit=1").is_ok_and(|answer| answer.status == 200)
        {
            history.reads.note();
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Asks queries of one server through the next; they end, or it is told that their server is gone.
fn query(addresses: &Addresses, history: &History) {
    let scan = shapes::vase(1, 16, 6, Faces::Triangles);
    for turn in 0.. {
        if history.is_over.load(Ordering::Relaxed) {
            return;
        }
        std::thread::sleep(Duration::from_millis(500));
        let Some(address) = some(addresses, turn) else { continue };
        let posted = http::post(address, "/v1/queries?resolution=32", "model/obj", scan.as_bytes());
        let Some(path) = posted.ok().filter(|a| a.status == 202).and_then(|a| a.header("location").map(str::to_owned))
        else {
            continue;
        };
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(30) {
            std::thread::sleep(Duration::from_millis(100));
            let Some(other) = some(addresses, turn + 1) else { continue };
            let Ok(answer) = http::get(other, &path) else { continue };
            let (state, code) = (answer.json()["state"].clone(), answer.json()["code"].clone());
            if state == "done" || code == "owner_gone" || answer.status == 404 {
                history.queries[usize::from(state != "done")].fetch_add(1, Ordering::Relaxed);
                break;
            }
        }
    }
}

fn listed(address: SocketAddr) -> Option<BTreeMap<String, u64>> {
    let (mut all, mut cursor) = (BTreeMap::new(), String::new());
    loop {
        let page = http::get(address, &format!("/v1/examples?limit=500{cursor}")).ok()?.json();
        for item in page["items"].as_array()? {
            all.insert(item["id"].as_str()?.to_owned(), item["revision"].as_u64()?);
        }
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return Some(all),
        }
    }
}

/// Compares all servers, and one that joins afresh, with what was acknowledged.
fn judged<'a>(
    nodes: &Nodes,
    history: &History,
    dir: &Path,
    servers: impl Iterator<Item = &'a Server>,
) -> Result<bool, Box<dyn Error>> {
    let fresh = server(nodes, &dir.join("fresh"))?;
    let addresses: Vec<SocketAddr> = servers.map(Server::address).chain([fresh.address()]).collect();
    let examples = history.examples.lock().expect("not poisoned").clone();
    let begun = Instant::now();
    let (lost, lists) = loop {
        let lists: Vec<_> = addresses.iter().map(|&address| listed(address).unwrap_or_default()).collect();
        let is_there = |(id, revision): &(&String, &u64)| lists.iter().all(|list| list.get(*id) >= Some(*revision));
        let lost: Vec<String> = examples.iter().filter(|one| !is_there(one)).map(|(id, _)| id.clone()).collect();
        let is_equal = lists.windows(2).all(|pair| pair[0] == pair[1]);
        if (lost.is_empty() && is_equal) || begun.elapsed() > QUIET_WITHIN {
            break (lost, lists);
        }
        std::thread::sleep(Duration::from_millis(500));
    };
    let is_equal = lists.windows(2).all(|pair| pair[0] == pair[1]);
    let check = Command::new(program("quadmuse-server")?)
        .args(["cluster", "check", "--bucket", "studio", "--cluster", &nodes.addresses()])
        .output()?;
    let ((write_gap, writes), (read_gap, reads)) = (history.writes.summary(), history.reads.summary());
    let [done, gone] = history.queries.each_ref().map(|count| count.load(Ordering::Relaxed));
    let stale = history.stale.load(Ordering::Relaxed);
    println!("acknowledged: {} examples, {writes} writes; longest time without one {write_gap:.1} s", examples.len());
    println!("reads: {reads}; longest time without one {read_gap:.1} s; older than the reader's own write: {stale}");
    println!("queries: {done} done, {gone} told that their server is gone");
    let (maps, are_maps_right) = history.maps.summary();
    println!("{maps}");
    println!("lost: {}; lists of all four servers equal: {is_equal} ({} examples)", lost.len(), lists[0].len());
    println!("check: {}", String::from_utf8_lossy(&check.stdout).trim());
    lost.iter().for_each(|id| eprintln!("lost, or at an older revision: {id}"));
    Ok(lost.is_empty() && is_equal && stale == 0 && are_maps_right && check.status.success())
}
