//! A proxy that stands in front of several servers, and knows nothing of them: Debian's haproxy with the project's own settings, where
//! it is installed, or a few lines that do the same.

use quadmuse_tests::walls::tree;
use std::{
    io::{Read, Write},
    net::{SocketAddr, TcpListener, TcpStream},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::atomic::{AtomicUsize, Ordering},
    time::{Duration, Instant},
};

/// Longest time for haproxy to start.
const STARTS_WITHIN: Duration = Duration::from_secs(20);

/// A proxy that gives each request to the next server in turn, and none to one that takes no connection.
pub(crate) struct Proxy {
    pub(crate) address: SocketAddr,
    process: Option<Child>,
}

impl Drop for Proxy {
    fn drop(&mut self) {
        if let Some(process) = &mut self.process {
            // Gone already, or going now.
            let _ = (process.kill(), process.wait());
        }
    }
}

impl Proxy {
    /// In front of two servers; its settings are written to `folder`.
    pub(crate) fn start(folder: &Path, servers: [SocketAddr; 2]) -> Self {
        match haproxy() {
            Some(program) => Self::haproxy(&program, folder, servers),
            None => {
                println!("a proxy of a few lines: there is no haproxy (Debian: apt-get install haproxy)");
                Self { address: few_lines(servers), process: None }
            }
        }
    }

    fn haproxy(program: &Path, folder: &Path, servers: [SocketAddr; 2]) -> Self {
        let free = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = free.local_addr().expect("an address");
        let settings =
            std::fs::read_to_string(tree::root().join("docker/haproxy.cfg")).expect("the project's settings");
        let [first, second] = servers.map(|server| server.to_string());
        let mut own = settings;
        for (there, here) in [
            ("bind :7979", format!("bind {address}")),
            ("quadmuse1:7979", first),
            ("quadmuse2:7979", second),
            ("    server quadmuse3 quadmuse3:7979", String::new()),
        ] {
            assert!(own.contains(there), "docker/haproxy.cfg has no `{there}`");
            own = own.replace(there, &here);
        }
        let file = folder.join("haproxy.cfg");
        std::fs::write(&file, own).expect("written");
        drop(free);
        let mut process =
            Command::new(program).arg("-f").arg(&file).stdin(Stdio::null()).spawn().expect("haproxy starts");
        let begun = Instant::now();
        while TcpStream::connect(address).is_err() {
            assert!(process.try_wait().expect("asked").is_none(), "haproxy ended");
            assert!(begun.elapsed() < STARTS_WITHIN, "haproxy does not listen");
            std::thread::sleep(Duration::from_millis(20));
        }
        Self { address, process: Some(process) }
    }
}

/// Debian puts it where only root looks.
fn haproxy() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let places = std::env::split_paths(&path).chain(["/usr/sbin".into()]);
    places.map(|place| place.join("haproxy")).find(|program| program.is_file())
}

fn few_lines(servers: [SocketAddr; 2]) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    std::thread::spawn(move || {
        let turn = AtomicUsize::new(0);
        for client in listener.incoming().flatten() {
            let connect = |_| TcpStream::connect(servers[turn.fetch_add(1, Ordering::Relaxed) % servers.len()]).ok();
            if let Some(server) = (0..servers.len()).find_map(connect) {
                std::thread::spawn(move || pass(client, server));
            }
        }
    });
    address
}

/// One request and its answer; both ends close the connection after it, so that the next goes elsewhere.
fn pass(mut client: TcpStream, mut server: TcpStream) {
    let (mut head, mut byte) = (Vec::new(), [0]);
    while !head.ends_with(b"\r\n\r\n") {
        if !client.read(&mut byte).is_ok_and(|read| read == 1) {
            return;
        }
        head.push(byte[0]);
    }
    head.truncate(head.len() - 2);
    head.extend_from_slice(b"connection: close\r\n\r\n");
    let (mut from, mut to) = (client.try_clone().expect("a handle"), server.try_clone().expect("a handle"));
    if to.write_all(&head).is_err() {
        return;
    }
    std::thread::spawn(move || {
        let _ = std::io::copy(&mut from, &mut to);
    });
    let _ = std::io::copy(&mut server, &mut client);
    let _ = client.shutdown(std::net::Shutdown::Both);
}
