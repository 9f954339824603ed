//! A real browser against the open default: a page of another origin, and one whose name leads to the service.
//!
//! Chromium is started without a window on a page of ours. The page tries what a hostile one would and writes what it
//! saw into its title, which `--dump-dom` prints. `QUADMUSE_BROWSER` names a Chromium that is not on the path.
//! `tests/run` runs this; it ends with a panic where the browser gets through.

use quadmuse_tests::{http, server::Server};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::process::{Command, Stdio};
use std::time::Duration;

/// The page: it sends a mesh without asking leave, then asks the service for what it holds, then deletes it.
const PAGE: &str = r#"<!doctype html><title>running</title><script>
const service = "SERVICE", told = [];
const tell = async (what, act) => { try { told.push(`${what}:${await act()}`); } catch { told.push(`${what}:blocked`); } };
(async () => {
  const mesh = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";
  for (const type of ["text/plain", "application/x-www-form-urlencoded", ""]) {
    const body = new Blob([mesh], { type });
    await tell("simple", async () => (await fetch(`${service}/v1/examples?name=planted`, { method: "POST", mode: "no-cors", body })).type);
  }
  const form = new FormData();
  form.append("mesh", new Blob([mesh]), "a.obj");
  await tell("form", async () => (await fetch(`${service}/v1/examples?name=form`, { method: "POST", mode: "no-cors", body: form })).type);
  await tell("list", async () => (await fetch(`${service}/v1/examples`)).status);
  await tell("delete", async () => (await fetch(`${service}/v1/examples/ID`, { method: "DELETE" })).status);
  await tell("image", () => new Promise((ok, no) => { const i = new Image(); i.onload = () => ok("shown"); i.onerror = no; i.src = `${service}/v1/examples/ID/thumbnail.png`; }));
  document.title = `done ${told.join(" ")}`;
})();
</script>"#;

fn browser() -> String {
    let named = std::env::var("QUADMUSE_BROWSER").ok();
    let usual = ["chromium", "chromium-browser", "google-chrome"].map(String::from);
    let all = named.into_iter().chain(usual);
    let works = |name: &String| {
        let version = Command::new(name).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        version.is_ok_and(|status| status.success())
    };
    all.into_iter().find(works).expect("a Chromium: install one, or name it by QUADMUSE_BROWSER")
}

/// Serves the page on a free port for as long as the test runs.
fn serve_page(page: String) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let _ = stream.set_read_timeout(Some(Duration::from_secs(2)));
            let _ = stream.read(&mut [0; 4096]);
            let head = format!(
                "HTTP/1.1 200 OK\r\ncontent-type: text/html\r\ncontent-length: {}\r\nconnection: close\r\n\r\n",
                page.len()
            );
            let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(page.as_bytes()));
        }
    });
    address
}

/// What a page printed, its title included, once it said that it was done.
fn dump(url: &str, resolver_rules: &str) -> String {
    let profile = tempfile::tempdir().expect("a directory");
    let output = Command::new("timeout")
        .arg("60")
        .arg(browser())
        .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"])
        .args(["--disable-background-networking", "--virtual-time-budget=15000", "--dump-dom"])
        .arg(format!("--host-resolver-rules={resolver_rules}"))
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(url)
        .stderr(Stdio::null())
        .output()
        .expect("a browser that starts");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn names(address: SocketAddr) -> String {
    http::get(address, "/v1/examples").expect("a list").text()
}

/// Requests of a method that came as far as the service and were refused: what was blocked in the browser alone shows nothing
/// of the service.
fn refused(address: SocketAddr, method: &str) -> u64 {
    let metrics = http::get(address, "/metrics").expect("metrics").text();
    let parts = ["quadmuse_requests_total{".to_owned(), format!("method=\"{method}\""), "status=\"4".to_owned()];
    let is_it = |line: &&str| parts.iter().all(|part| line.contains(part));
    metrics.lines().filter(is_it).filter_map(|line| line.rsplit(' ').next()?.parse::<u64>().ok()).sum()
}

/// A web page neither changes nor reads the corpus.
fn main() {
    let dir = tempfile::tempdir().expect("a directory");
    let server = Server::start(&dir.path().join("data")).expect("a server");
    let mesh = b"v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nf 1 2 3 4\n";
    let added = http::post(server.address(), "/v1/examples?name=mine", "model/obj", mesh).expect("an answer");
    assert_eq!(added.status, 201, "{}", added.text());
    let id = added.text().split("\"id\":\"").nth(1).and_then(|rest| rest.split('"').next()).expect("an id").to_owned();
    let before = names(server.address());

    // A page of another origin, by the service's address and by a name that leads to it.
    let rules = "MAP rebound.example 127.0.0.1, MAP elsewhere.example 127.0.0.1";
    let mut tried = 0;
    for service in [server.url(), format!("http://rebound.example:{}", server.address().port())] {
        let page = serve_page(PAGE.replace("SERVICE", &service).replace("ID", &id));
        for url in [format!("http://{page}/"), format!("http://elsewhere.example:{}/", page.port())] {
            let dom = dump(&url, rules);
            assert!(dom.contains("<title>done "), "expected the page to end, found {dom}");
            for what in ["list:blocked", "delete:blocked", "image:blocked"] {
                assert!(dom.contains(what), "{url} against {service}: {dom}");
            }
            assert_eq!(names(server.address()), before, "{url} against {service}");
            // The four that it needs no leave for, and the question for leave to delete, came as far as the service; a 421 is
            // tried again.
            tried += 1;
            let [posts, questions] = ["POST", "OPTIONS"].map(|method| refused(server.address(), method));
            assert!(posts >= 4 * tried && questions >= tried, "{url} against {service}: {posts}, {questions}");
        }
    }
    // A rebound name as the page's own origin: the service's very first answer is refused.
    let dom = dump(&format!("http://rebound.example:{}/v1/examples", server.address().port()), rules);
    assert!(dom.contains("forbidden") && !dom.contains("mine"), "{dom}");
    // The service's own page still works.
    let dom = dump(&format!("{}/#corpus", server.url()), rules);
    assert!(dom.contains("mine"), "expected the corpus on the page, found {dom}");
    println!("pages of other origins and rebound names: {tried} tried, nothing read, nothing changed");
}
