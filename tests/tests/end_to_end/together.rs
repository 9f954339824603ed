//! Several servers behind a proxy that knows nothing of them: each answers for all. Left out where there is no `nats-server`.

use crate::{Place, cluster::join, nodes::Nodes, proxies::Proxy, text};
use quadmuse_tests::{
    client::Client,
    http::{self, Answer},
    shapes::{self, Faces},
};
use serde_json::Value;
use std::{
    net::SocketAddr,
    time::{Duration, Instant},
};

/// Longest time for what is asked again and again to hold.
const HOLDS_WITHIN: Duration = Duration::from_secs(60);

/// A file that is longer than what the client sends at once.
const LONG: usize = 17 << 20;

fn json(answer: &Answer) -> Value {
    serde_json::from_slice(&answer.body).unwrap_or_else(|error| panic!("{error}: {}", answer.text()))
}

fn get(address: SocketAddr, path: &str) -> Answer {
    http::get(address, path).expect("answered")
}

fn post(address: SocketAddr, path: &str, kind: &str, body: &str) -> Answer {
    http::post(address, path, kind, body.as_bytes()).expect("answered")
}

/// Polls until a query is done.
fn done(address: SocketAddr, path: &str) -> Value {
    let begun = Instant::now();
    loop {
        let query = json(&get(address, path));
        match text(&query, "state") {
            "done" => return query,
            state => assert!(begun.elapsed() < HOLDS_WITHIN && state != "failed", "{query}"),
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn best(address: SocketAddr, query: &str) -> Value {
    json(&get(address, &format!("{query}/ranking")))["entries"].clone()
}

#[test]
fn any_server_answers_for_all_and_a_query_outlives_its_server() {
    let Some(nodes) = Nodes::start(3) else { return };
    let (place, first_place, second_place) = (Place::new(), Place::new(), Place::new());
    let (a, one) = join(&nodes, &first_place.data());
    let (b, two) = join(&nodes, &second_place.data());
    for file in place.heads(3) {
        one.run(["add".as_ref(), file.as_os_str()]).expect("it runs").ok().expect("added");
    }
    let begun = Instant::now();
    while crate::listed(&two).len() < 3 {
        assert!(begun.elapsed() < HOLDS_WITHIN, "not seen");
        std::thread::sleep(Duration::from_millis(50));
    }

    // The whole path through a proxy that takes each server in turn.
    let scan = place.file("scan.obj", &shapes::head(1, 20, Faces::Triangles));
    let proxy = Proxy::start(first_place.folder.path(), [a.address(), b.address()]);
    let through = Client::new(format!("http://{}", proxy.address));
    let out = place.path("out.obj");
    let words = ["retopo".as_ref(), scan.as_os_str(), "-o".as_ref(), out.as_os_str()];
    through.run(words).expect("it runs").ok().unwrap_or_else(|error| panic!("{error}"));
    assert!(std::fs::read_to_string(&out).expect("a mesh").contains("\nf "));
    // A long file goes piece by piece, each to the next server.
    let long = [shapes::head(3, 16, Faces::Quads), "# a line that is read by nobody\n".repeat(LONG / 32)].concat();
    let long = place.file("long.obj", &long);
    through.run(["add".as_ref(), long.as_os_str()]).expect("it runs").ok().unwrap_or_else(|error| panic!("{error}"));

    // Of one server, asked through the other.
    let mesh = std::fs::read_to_string(&scan).expect("a file");
    let posted = post(a.address(), "/v1/queries?resolution=64", "model/obj", &mesh);
    assert_eq!(posted.status, 202, "{}", posted.text());
    let query = posted.header("location").expect("an address").to_owned();
    done(b.address(), &query);
    let entries = best(b.address(), &query);
    let ndjson = [("accept", "application/x-ndjson")];
    for address in [b.address(), proxy.address, proxy.address] {
        let stream = http::ask(address, &format!("GET {query}/stream"), &ndjson, &[]).expect("answered");
        assert!(stream.text().lines().last().is_some_and(|line| line.contains("\"end\"")), "{}", stream.text());
    }
    let wanted = format!(
        "{{\"segment\": 0, \"example\": {}, \"example_segment\": {}}}",
        entries[0]["example"], entries[0]["example_segment"]
    );
    let map = post(b.address(), &format!("{query}/maps?wait=120"), "application/json", &wanted);
    assert_eq!(map.status, 201, "{}", map.text());
    let map = map.header("location").expect("an address").to_owned();
    for path in [query.clone(), format!("{query}/ranking"), format!("{query}/mesh"), map.clone(), format!("{map}/mesh")]
    {
        let [here, there] = [get(a.address(), &path), get(b.address(), &path)];
        assert_eq!((here.status, there.status), (200, 200), "{path}");
        assert!(here.body == there.body, "{path}");
    }
    assert_eq!(http::ask(b.address(), &format!("DELETE {map}"), &[], &[]).expect("answered").status, 204);
    assert_eq!(get(a.address(), &map).status, 404);

    // Nobody starts again what was never there; what was is kept soon after it was posted.
    let nothing = post(b.address(), "/v1/queries/01ARZ3NDEKTSV4RRFFQ69G5FAV/restart", "text/plain", "");
    assert_eq!((nothing.status, text(&json(&nothing), "code")), (404, "not_found"));
    let begun = Instant::now();
    while post(b.address(), &format!("{query}/restart"), "text/plain", "").status != 202 {
        assert!(begun.elapsed() < HOLDS_WITHIN, "not kept");
        std::thread::sleep(Duration::from_millis(50));
    }
    a.kill().expect("killed");
    let begun = Instant::now();
    let gone = get(b.address(), &format!("{query}/ranking?after=9&wait_ms=20000"));
    assert_eq!((gone.status, text(&json(&gone), "code")), (503, "owner_gone"), "{}", gone.text());
    assert!(gone.header("retry-after").is_some());
    assert!(begun.elapsed() < Duration::from_secs(10), "{:?}", begun.elapsed());
    // The proxy may still give it to the server that is gone, and then to the next: it is told in either case.
    for _ in 0..2 {
        let gone = get(proxy.address, &query);
        assert_eq!((gone.status, text(&json(&gone), "code")), (503, "owner_gone"), "{}", gone.text());
    }

    let again = post(b.address(), &format!("{query}/restart"), "text/plain", "");
    assert_eq!(again.status, 202, "{}", again.text());
    let again = again.header("location").expect("an address").to_owned();
    done(b.address(), &again);
    let order = |entries: &Value| -> Vec<String> {
        entries.as_array().expect("a list").iter().map(|entry| text(entry, "example").to_owned()).collect()
    };
    assert_eq!(order(&best(b.address(), &again)), order(&entries));

    // A server that starts where one died is another: what that one had is still gone.
    let (new, _) = join(&nodes, &first_place.data());
    assert_eq!(text(&json(&get(new.address(), &query)), "code"), "owner_gone");
}
