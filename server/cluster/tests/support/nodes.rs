//! Three nodes of a real engine on loopback, each a process that can be killed and started again.
#![allow(dead_code, reason = "each suite uses a part of it")]

use std::net::TcpListener;
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

struct Node {
    port: u16,
    config: PathBuf,
    process: Option<Child>,
}

pub(crate) struct Nodes {
    program: PathBuf,
    nodes: Vec<Node>,
    _dir: tempfile::TempDir,
}

impl Drop for Nodes {
    fn drop(&mut self) {
        (0..self.nodes.len()).for_each(|at| self.kill(at));
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
        let dir = tempfile::tempdir().expect("a directory");
        let ports = free_ports(2 * count);
        let routes: Vec<String> = ports[count..].iter().map(|port| format!("nats-route://127.0.0.1:{port}")).collect();
        let node = |at: usize| {
            let (port, cluster) = (ports[at], ports[count + at]);
            let data = dir.path().join(format!("node{at}"));
            let clustered = format!(
                "cluster {{ name: test, listen: \"127.0.0.1:{cluster}\", routes: [{}] }}\n",
                routes.iter().map(|route| format!("\"{route}\"")).collect::<Vec<_>>().join(", ")
            );
            let text = format!(
                "server_name: node{at}\nlisten: \"127.0.0.1:{port}\"\njetstream {{ store_dir: \"{}\", max_file: {room}, max_mem: 256MB }}\n{settings}{}",
                data.display(),
                if count > 1 { &clustered } else { "" }
            );
            let config = dir.path().join(format!("node{at}.conf"));
            std::fs::write(&config, text).expect("written");
            Node { port, config, process: None }
        };
        let nodes = (0..count).map(node).collect();
        let mut started = Self { program, nodes, _dir: dir };
        (0..count).for_each(|at| started.revive(at));
        Some(started)
    }

    /// Addresses of all nodes.
    pub(crate) fn addresses(&self) -> String {
        self.nodes.iter().map(|node| format!("nats://127.0.0.1:{}", node.port)).collect::<Vec<_>>().join(",")
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
        let mut command = Command::new(&self.program);
        command.arg("-c").arg(&node.config).stdin(Stdio::null()).stdout(Stdio::null());
        command.stderr(log.map_or_else(|_| Stdio::null(), Stdio::from));
        node.process = Some(command.spawn().expect("started"));
        let begun = Instant::now();
        while std::net::TcpStream::connect(("127.0.0.1", node.port)).is_err() {
            assert!(begun.elapsed() < Duration::from_secs(20), "a node does not start");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}
