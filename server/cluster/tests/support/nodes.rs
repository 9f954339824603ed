//! Three nodes of a real engine on loopback, each a process that can be killed and started again.
#![allow(dead_code, reason = "each suite uses a part of it")]

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The engine's program: Debian puts it where only root looks.
pub(crate) fn program() -> Option<PathBuf> {
    let named = std::env::var_os("QUADMUSE_NATS_SERVER").map(PathBuf::from);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let places = std::env::split_paths(&path).chain(["/usr/sbin".into(), "/usr/local/sbin".into()]);
    named.into_iter().chain(places.map(|place| place.join("nats-server"))).find(|program| program.is_file())
}

/// The addresses of a node that is to be started.
struct Place {
    clients: String,
    nodes: String,
    /// Where it tells of itself over HTTP, if it does.
    monitor: Option<String>,
    space: Option<PathBuf>,
}

struct Node {
    /// The address for clients.
    address: String,
    /// Where it tells of itself over HTTP, if it does.
    monitor: Option<String>,
    /// The network namespace that it is in, if it has one of its own.
    space: Option<PathBuf>,
    config: PathBuf,
    process: Option<Child>,
}

/// A network link of a node that has a namespace of its own.
#[derive(Clone, Copy)]
pub(crate) enum Link {
    Clients,
    Nodes,
}

impl Link {
    /// The name of this end of a node's link, and of the bridge that it is on.
    fn names(self, at: usize) -> (String, &'static str) {
        match self {
            Self::Clients => (format!("c{at}"), "clients"),
            Self::Nodes => (format!("n{at}"), "nodes"),
        }
    }

    fn network(self) -> &'static str {
        match self {
            Self::Clients => "10.77.1",
            Self::Nodes => "10.77.2",
        }
    }
}

/// Runs `ip` with these words.
fn ip(words: &str) {
    let done = Command::new("ip").args(words.split(' ')).status().expect("ip runs");
    assert!(done.success(), "ip {words}");
}

pub(crate) struct Nodes {
    program: PathBuf,
    nodes: Vec<Node>,
    _dir: tempfile::TempDir,
}

impl Drop for Nodes {
    fn drop(&mut self) {
        (0..self.nodes.len()).for_each(|at| self.kill(at));
        if std::thread::panicking() {
            // The folder with the logs goes with the test.
            for node in &self.nodes {
                let log = std::fs::read_to_string(node.config.with_extension("log")).unwrap_or_default();
                let lines: Vec<&str> = log.lines().collect();
                eprintln!("{} logged last:\n{}", node.address, lines[lines.len().saturating_sub(30)..].join("\n"));
            }
        }
    }
}

fn free_ports(count: usize) -> Vec<u16> {
    // All at once, so that none is given twice.
    let held: Vec<TcpListener> = (0..count).map(|_| TcpListener::bind("127.0.0.1:0").expect("a port")).collect();
    held.iter().map(|listener| listener.local_addr().expect("an address").port()).collect()
}

impl Nodes {
    /// Starts `count` nodes; `None`, with a word to whoever reads the test's output, where there is no engine.
    pub(crate) fn start(count: usize) -> Option<Self> {
        Self::start_with(count, "4GB")
    }

    /// The same with room for so much on each.
    pub(crate) fn start_with(count: usize, room: &str) -> Option<Self> {
        Self::start_configured(count, room, "")
    }

    /// The same with more settings.
    pub(crate) fn start_configured(count: usize, room: &str, settings: &str) -> Option<Self> {
        let Some(program) = program() else {
            eprintln!("left out: there is no nats-server (Debian: apt-get install nats-server)");
            return None;
        };
        let ports = free_ports(3 * count);
        let local = |at: usize| format!("127.0.0.1:{}", ports[at]);
        let places: Vec<Place> = (0..count)
            .map(|at| Place {
                clients: local(at),
                nodes: local(count + at),
                monitor: Some(local(2 * count + at)),
                space: None,
            })
            .collect();
        Some(Self::start_at(program, &places, room, settings))
    }

    /// The same, each node in a network namespace of its own. The caller has a network, and a `/run`, that nobody else uses.
    pub(crate) fn start_apart(count: usize) -> Option<Self> {
        let program = program()?;
        for link in [Link::Clients, Link::Nodes] {
            let bridge = link.names(0).1;
            ip(&format!("link add {bridge} type bridge"));
            ip(&format!("addr add {}.254/24 dev {bridge}", link.network()));
            ip(&format!("link set {bridge} up"));
        }
        let place = |at: usize| {
            let space = format!("node{at}");
            ip(&format!("netns add {space}"));
            ip(&format!("-n {space} link set lo up"));
            let address = |link: Link, port: u16| {
                let ((end, bridge), host) = (link.names(at), format!("{}.{}", link.network(), at + 1));
                ip(&format!("link add {end} type veth peer name {bridge} netns {space}"));
                ip(&format!("link set {end} master {bridge} up"));
                ip(&format!("-n {space} addr add {host}/24 dev {bridge}"));
                ip(&format!("-n {space} link set {bridge} up"));
                format!("{host}:{port}")
            };
            let (clients, nodes) = (address(Link::Clients, 4222), address(Link::Nodes, 6222));
            Place { clients, nodes, monitor: None, space: Some(PathBuf::from("/run/netns").join(space)) }
        };
        Some(Self::start_at(program, &(0..count).map(place).collect::<Vec<_>>(), "4GB", ""))
    }

    fn start_at(program: PathBuf, places: &[Place], room: &str, settings: &str) -> Self {
        let dir = tempfile::tempdir().expect("a directory");
        let count = places.len();
        let routes: Vec<String> = places.iter().map(|place| format!("nats-route://{}", place.nodes)).collect();
        let node = |at: usize| {
            let Place { clients, nodes: cluster, monitor, space } = &places[at];
            let data = dir.path().join(format!("node{at}"));
            let clustered = format!(
                "cluster {{ name: test, listen: \"{cluster}\", routes: [{}] }}\n",
                routes.iter().map(|route| format!("\"{route}\"")).collect::<Vec<_>>().join(", ")
            );
            let monitored = monitor.as_ref().map(|address| format!("http: \"{address}\"\n")).unwrap_or_default();
            let text = format!(
                "server_name: node{at}\nlisten: \"{clients}\"\n{monitored}jetstream {{ store_dir: \"{}\", max_file: {room}, max_mem: 256MB }}\n{settings}{}",
                data.display(),
                if count > 1 { &clustered } else { "" }
            );
            let config = dir.path().join(format!("node{at}.conf"));
            std::fs::write(&config, text).expect("written");
            Node { address: clients.clone(), monitor: monitor.clone(), space: space.clone(), config, process: None }
        };
        let nodes = (0..count).map(node).collect();
        let mut started = Self { program, nodes, _dir: dir };
        (0..count).for_each(|at| started.revive(at));
        started
    }

    /// Takes a link of a node away: what is sent over it vanishes.
    pub(crate) fn cut(&self, at: usize, link: Link) {
        ip(&format!("link set {} down", link.names(at).0));
    }

    /// Brings it back.
    pub(crate) fn mend(&self, at: usize, link: Link) {
        ip(&format!("link set {} up", link.names(at).0));
    }

    /// Addresses of all nodes.
    pub(crate) fn addresses(&self) -> String {
        (0..self.nodes.len()).map(|at| self.address(at)).collect::<Vec<_>>().join(",")
    }

    /// The address of one.
    pub(crate) fn address(&self, at: usize) -> String {
        format!("nats://{}", self.nodes[at].address)
    }

    /// Counts the messages that a node itself holds, by the name of their stream. The engine tells its clients what the
    /// stream's leader holds, never how far a copy is. Empty where the node does not answer.
    pub(crate) fn held(&self, at: usize) -> BTreeMap<String, u64> {
        let monitored = || -> Option<serde_json::Value> {
            let mut stream = TcpStream::connect(self.nodes[at].monitor.as_ref()?).ok()?;
            stream.write_all(b"GET /jsz?streams=true HTTP/1.0\r\n\r\n").ok()?;
            let mut answer = String::new();
            stream.read_to_string(&mut answer).ok()?;
            serde_json::from_str(answer.split_once("\r\n\r\n")?.1).ok()
        };
        let monitored = monitored().unwrap_or_default();
        let list = |value: &serde_json::Value| value.as_array().cloned().unwrap_or_default();
        let streams =
            list(&monitored["account_details"]).into_iter().flat_map(|account| list(&account["stream_detail"]));
        let held = |stream: serde_json::Value| {
            Some((stream["name"].as_str()?.to_owned(), stream["state"]["messages"].as_u64()?))
        };
        streams.filter_map(held).collect()
    }

    /// Ends a node without a word.
    pub(crate) fn kill(&mut self, at: usize) {
        if let Some(mut process) = self.nodes[at].process.take() {
            // Gone already, or going now.
            let _ = process.kill();
            let _ = process.wait();
        }
    }

    /// Stops a node without ending it, as a split of the network would look to the others, or lets it go on.
    pub(crate) fn signal(&self, at: usize, signal: &str) {
        let id = self.nodes[at].process.as_ref().map(|process| process.id().to_string()).expect("it runs");
        let done = Command::new("kill").args([signal, &id]).status().expect("kill runs");
        assert!(done.success(), "kill {signal} {id}");
    }

    /// Starts a node; it is up when this returns.
    pub(crate) fn revive(&mut self, at: usize) {
        let node = &mut self.nodes[at];
        let log = std::fs::OpenOptions::new().create(true).append(true).open(node.config.with_extension("log"));
        let mut command = match &node.space {
            None => Command::new(&self.program),
            Some(space) => {
                let mut command = Command::new("nsenter");
                command.arg(format!("--net={}", space.display())).arg(&self.program);
                command
            }
        };
        command.arg("-c").arg(&node.config).stdin(Stdio::null()).stdout(Stdio::null());
        command.stderr(log.map_or_else(|_| Stdio::null(), Stdio::from));
        node.process = Some(command.spawn().expect("started"));
        let begun = Instant::now();
        while TcpStream::connect(&node.address).is_err() {
            assert!(begun.elapsed() < Duration::from_secs(20), "a node does not start");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}
