//! The upgrade of servers that share a corpus, rehearsed: an older program and this one side by side, each with its own
//! encoder, under writers and queries.
//!
//! `cluster_upgrade --older PROGRAM [--examples 12]`: three nodes of a real engine, and three servers of the older program,
//! which take EXAMPLES. Then one server after the other is ended and started as this program, while a writer adds to each in
//! turn and a caller asks queries of each in turn. What the older encoder made has to be encoded again by the newer one, and
//! never the other way round. At the end all servers, and one that joins afresh, are compared with what was acknowledged, and
//! every object is read. Ends with 1 if anything is missing. Needs `nats-server`.

#[path = "../../../server/cluster/tests/support/nodes.rs"]
mod nodes;

use nodes::Nodes;
use quadmuse_tests::{
    binaries::program,
    http,
    server::Server,
    shapes::{self, Faces},
    tool,
};
use std::{
    collections::BTreeSet,
    error::Error,
    net::SocketAddr,
    path::Path,
    process::{Command, ExitCode},
    sync::{
        Mutex,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

const SERVERS: usize = 3;
/// For so long the servers work side by side after each step.
const SIDE_BY_SIDE: Duration = Duration::from_secs(10);
/// Longest time for a query, and for what an older encoder made to be encoded again.
const ENDS_WITHIN: Duration = Duration::from_secs(180);

fn main() -> ExitCode {
    let Some(older) = tool::word("--older") else {
        eprintln!("expected --older PROGRAM, the server of an older release");
        return ExitCode::FAILURE;
    };
    tool::ended(run(Path::new(&older), tool::number("--examples", 12)))
}

/// A record of what happened while the servers were exchanged.
#[derive(Default)]
struct History {
    servers: Mutex<Vec<Option<SocketAddr>>>,
    added: Mutex<BTreeSet<String>>,
    refused: Mutex<Vec<String>>,
    queries: Mutex<u32>,
    is_over: AtomicBool,
}

impl History {
    /// A server that is up; while one is exchanged the proxy sends nobody there.
    fn server(&self, turn: usize) -> Option<SocketAddr> {
        self.servers.lock().expect("not poisoned")[turn % SERVERS]
    }

    fn refuse(&self, what: String) {
        self.refused.lock().expect("not poisoned").push(what);
    }
}

fn encoder(address: SocketAddr) -> Option<u64> {
    http::get(address, "/readyz").ok()?.json()["encoder_version"].as_u64()
}

/// A number of `/metrics`: the sum over all lines that begin so and hold these words.
fn metric(address: SocketAddr, name: &str, words: &[&str]) -> u64 {
    let Ok(answer) = http::get(address, "/metrics") else { return 0 };
    let text = answer.text();
    let lines = text.lines().filter(|line| line.starts_with(name) && words.iter().all(|word| line.contains(word)));
    lines.filter_map(|line| line.rsplit(' ').next()?.parse::<u64>().ok()).sum()
}

fn encoded_again(address: SocketAddr) -> u64 {
    metric(address, "quadmuse_jobs_total", &["kind=\"encode\"", "outcome=\"done\""])
}

fn add(address: SocketAddr, number: usize) -> Result<String, String> {
    // Each is another mesh.
    let mesh = format!("# {number}\n{}", shapes::vase(number as u32 % 6, 10, 6, Faces::Quads));
    let path = format!("/v1/examples?name=e{number}");
    let answer = http::post(address, &path, "model/obj", mesh.as_bytes()).map_err(|error| error.to_string())?;
    let id = answer.json()["id"].as_str().map(str::to_owned);
    id.filter(|_| answer.status == 201).ok_or_else(|| format!("{} {}", answer.status, answer.text()))
}

fn listed(address: SocketAddr) -> Option<BTreeSet<String>> {
    let page = http::get(address, "/v1/examples?limit=500").ok()?.json();
    page["items"].as_array()?.iter().map(|item| Some(item["id"].as_str()?.to_owned())).collect()
}

/// Asks a query of a server, and follows it to its end.
fn ask(address: SocketAddr) -> Result<(), String> {
    let scan = shapes::vase(1, 16, 6, Faces::Triangles);
    let posted = http::post(address, "/v1/queries?resolution=32", "model/obj", scan.as_bytes());
    let posted = posted.map_err(|error| error.to_string())?;
    let path = posted.header("location").ok_or_else(|| posted.text())?.to_owned();
    let begun = Instant::now();
    while begun.elapsed() < ENDS_WITHIN {
        let query = http::get(address, &path).map_err(|error| error.to_string())?.json();
        match query["state"].as_str() {
            Some("done") => {
                let ranking = http::get(address, &format!("{path}/ranking")).map_err(|e| e.to_string())?.json();
                let is_ranked = ranking["entries"].as_array().is_some_and(|entries| !entries.is_empty());
                return if is_ranked { Ok(()) } else { Err(format!("nothing ranked: {ranking}")) };
            }
            Some("failed") | None => return Err(query.to_string()),
            Some(_) => std::thread::sleep(Duration::from_millis(50)),
        }
    }
    Err("no end of a query".into())
}

fn run(older: &Path, examples: usize) -> Result<bool, Box<dyn Error>> {
    let Some(nodes) = Nodes::start(3) else { return Ok(true) };
    let newer = program("quadmuse-server")?;
    let dir = tempfile::tempdir()?;
    let cluster = format!("QUADMUSE_CLUSTER={}", nodes.addresses());
    let words = ["env", &cluster, "QUADMUSE_BUCKET=studio", "QUADMUSE_LOG=error"];
    let data: Vec<_> = (0..=SERVERS).map(|at| dir.path().join(format!("server{at}"))).collect();
    let start = |program: &Path, at: usize| Server::start_program(program, &words, &data[at]);
    let mut servers = (0..SERVERS).map(|at| start(older, at)).collect::<Result<Vec<_>, _>>()?;
    let history = History::default();
    *history.servers.lock().expect("not poisoned") = servers.iter().map(|one| Some(one.address())).collect();
    for number in 0..examples {
        let id = add(servers[number % SERVERS].address(), number)?;
        history.added.lock().expect("not poisoned").insert(id);
    }
    let old = encoder(servers[0].address());
    std::thread::scope(|scope| -> Result<(), Box<dyn Error>> {
        scope.spawn(|| {
            work(&history, |address, turn| {
                let id = add(address, examples + turn)?;
                history.added.lock().expect("not poisoned").insert(id);
                Ok(())
            })
        });
        scope.spawn(|| {
            work(&history, |address, _| {
                ask(address)?;
                *history.queries.lock().expect("not poisoned") += 1;
                Ok(())
            })
        });
        let ended = (0..SERVERS).try_for_each(|at| -> Result<(), Box<dyn Error>> {
            std::thread::sleep(SIDE_BY_SIDE);
            // As a proxy does: nobody new goes there, and what is under way ends.
            history.servers.lock().expect("not poisoned")[at] = None;
            std::thread::sleep(Duration::from_secs(3));
            servers[at].terminate(ENDS_WITHIN)?;
            servers[at] = start(&newer, at)?;
            history.servers.lock().expect("not poisoned")[at] = Some(servers[at].address());
            let encoders: Vec<_> = servers.iter().map(|one| encoder(one.address())).collect();
            println!("encoders of the servers: {encoders:?}");
            Ok(())
        });
        std::thread::sleep(SIDE_BY_SIDE);
        history.is_over.store(true, Ordering::Relaxed);
        ended
    })?;
    let new = encoder(servers[0].address());
    let addresses: Vec<SocketAddr> = servers.iter().map(Server::address).collect();
    println!("encoder {old:?} before, {new:?} after");
    judged(&nodes, &history, &addresses, &|| start(&newer, SERVERS))
}

/// Does something on each server in turn, until it is over.
fn work(history: &History, what: impl Fn(SocketAddr, usize) -> Result<(), String>) {
    for turn in 0.. {
        if history.is_over.load(Ordering::Relaxed) {
            return;
        }
        std::thread::sleep(Duration::from_millis(100));
        let Some(address) = history.server(turn) else { continue };
        if let Err(error) = what(address, turn)
            // Its server was being exchanged.
            && history.server(turn) == Some(address)
        {
            history.refuse(error);
        }
    }
}

fn judged(
    nodes: &Nodes,
    history: &History,
    addresses: &[SocketAddr],
    join: &dyn Fn() -> Result<Server, quadmuse_tests::server::ServerError>,
) -> Result<bool, Box<dyn Error>> {
    let begun = Instant::now();
    let again = || addresses.iter().map(|&address| encoded_again(address)).sum::<u64>();
    // Quiet: nothing waits, and for longer than between two looks for what is old nothing was encoded again.
    let (mut last, mut since) = (again(), Instant::now());
    while begun.elapsed() < ENDS_WITHIN && since.elapsed() < Duration::from_secs(40) {
        std::thread::sleep(Duration::from_secs(1));
        let now = again();
        if now != last {
            (last, since) = (now, Instant::now());
        }
    }
    let fresh = join()?;
    std::thread::sleep(Duration::from_secs(10));
    let more = encoded_again(fresh.address());
    let lists: Vec<_> = addresses.iter().chain([&fresh.address()]).map(|&address| listed(address)).collect();
    let added = history.added.lock().expect("not poisoned").clone();
    let is_whole = lists.iter().all(|list| list.as_ref() == Some(&added));
    let check = Command::new(program("quadmuse-server")?)
        .args(["cluster", "check", "--bucket", "studio", "--cluster", &nodes.addresses()])
        .output()?;
    let refused = history.refused.lock().expect("not poisoned").clone();
    println!(
        "{} examples, the same on all servers: {is_whole}; {} queries done; encoded again by the newer servers: {last}, by one that joins then: {more}",
        added.len(),
        history.queries.lock().expect("not poisoned")
    );
    println!("check: {}", String::from_utf8_lossy(&check.stdout).trim());
    refused.iter().for_each(|error| println!("failed: {error}"));
    Ok(is_whole && refused.is_empty() && more == 0 && last > 0 && check.status.success())
}
