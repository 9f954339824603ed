//! What all endpoints share: negotiation, ids, problems of the router, tokens, the contract.

use super::*;
use crate::auth::Role;
use quadmuse_proto::{Example, Health, NewToken, Page};
use serde_json::json;
use std::io::Read;

#[tokio::test]
async fn the_same_types_travel_as_json_and_as_messagepack() {
    let bench = Bench::stocked().await;
    let packed = bench.request(Method::GET, "/v1/examples", &[("accept", "application/msgpack")], Body::empty()).await;
    assert_eq!(packed.header("content-type"), "application/msgpack");
    let unpacked: Page<Example> = rmp_serde::from_slice(&packed.bytes).expect("a page");
    let plain: Page<Example> = serde_json::from_slice(&bench.get("/v1/examples").await.bytes).expect("a page");
    assert_eq!((unpacked.items.len(), &unpacked), (4, &plain));
    let path = format!("/v1/examples/{}", plain.items[0].id);
    let patch = rmp_serde::to_vec_named(&json!({"name": "new"})).expect("packs");
    let headers = [("content-type", "application/msgpack"), ("accept", "application/msgpack")];
    let answer = bench.request(Method::PATCH, &path, &headers, patch).await;
    let example: Example = rmp_serde::from_slice(&answer.bytes).expect("an example");
    assert_eq!(example.name, "new");
    bench.request(Method::PATCH, &path, &headers, vec![0xc1]).await.problem(400, "body_invalid");
    let headers = [("accept", "text/html")];
    bench.request(Method::GET, &path, &headers, Body::empty()).await.problem(406, "not_acceptable");
}

#[tokio::test]
async fn what_has_no_route_is_a_problem_too() {
    let bench = Bench::new();
    let detail = bench.get("/v1/nothing?x=1").await.problem(404, "not_found");
    assert!(detail.contains("/v1/nothing"), "{detail}");
    bench.get("/v1/queries/%00/ranking").await.problem(404, "not_found");
    let wrong = bench.request(Method::PUT, "/v1/examples", &[], Body::empty()).await;
    wrong.problem(405, "method_not_allowed");
    assert_eq!(wrong.header("allow"), "POST,GET,HEAD");
}

#[tokio::test]
async fn an_answer_carries_the_request_id() {
    let bench = Bench::new();
    let given = bench.request(Method::GET, "/healthz", &[("x-request-id", "mine-7")], Body::empty()).await;
    assert_eq!(given.header("x-request-id"), "mine-7");
    let (one, two) = (bench.get("/healthz").await, bench.get("/healthz").await);
    assert_eq!(one.header("x-request-id").len(), 26);
    assert_ne!(one.header("x-request-id"), two.header("x-request-id"));
    let long = "x".repeat(1000);
    let cut = bench.request(Method::GET, "/nothing", &[("x-request-id", &long)], Body::empty()).await;
    assert_eq!(cut.header("x-request-id").len(), 26);
    cut.problem(404, "not_found");
}

#[tokio::test]
async fn what_the_caller_has_is_not_sent_again() {
    let bench = Bench::stocked().await;
    for path in ["/v1/examples", "/openapi.json", "/", "/docs", "/web/index.js"] {
        let first = bench.get(path).await;
        assert_eq!(first.status, StatusCode::OK, "{path}");
        let tag = first.header("etag").to_owned();
        assert!(tag.starts_with('"'), "{path}");
        let again = bench.request(Method::GET, path, &[("if-none-match", &tag)], Body::empty()).await;
        assert_eq!((again.status, again.bytes.len()), (StatusCode::NOT_MODIFIED, 0), "{path}");
    }
    let tag = bench.get("/v1/examples").await.header("etag").to_owned();
    bench.add("more", "segment disc 77").await;
    let changed = bench.request(Method::GET, "/v1/examples", &[("if-none-match", &tag)], Body::empty()).await;
    assert_eq!(changed.status, StatusCode::OK);
}

#[tokio::test]
async fn texts_travel_packed_to_whoever_takes_that_and_streams_and_meshes_do_not() {
    let bench = Bench::stocked().await;
    let long = "n".repeat(200);
    for seed in 0..12 {
        bench.add(&long, &format!("segment disc {seed}9")).await;
    }
    let taking =
        |path: &'static str| bench.request(Method::GET, path, &[("accept-encoding", "gzip, br")], Body::empty());
    for path in ["/", "/docs", "/web/index.js", "/web/style.css", "/openapi.json", "/v1/examples?limit=500"] {
        let (plain, packed) = (bench.get(path).await, taking(path).await);
        assert!(!plain.headers.contains_key("content-encoding"), "{path}");
        assert_eq!(packed.header("content-encoding"), "gzip", "{path}");
        assert!(packed.bytes.len() < plain.bytes.len(), "{path}: {} of {}", packed.bytes.len(), plain.bytes.len());
        let mut unpacked = Vec::new();
        flate2::read::GzDecoder::new(&packed.bytes[..]).read_to_end(&mut unpacked).expect("gzip");
        assert!(unpacked == plain.bytes, "{path}");
        assert_ne!(plain.header("etag"), packed.header("etag"), "{path}");
        for answer in [&plain, &packed] {
            assert!(answer.header("vary").contains("accept-encoding"), "{path}: {}", answer.header("vary"));
        }
        let known = [("accept-encoding", "gzip"), ("if-none-match", packed.header("etag"))];
        let again = bench.request(Method::GET, path, &known, Body::empty()).await;
        assert_eq!((again.status, again.bytes.len()), (StatusCode::NOT_MODIFIED, 0), "{path}");
        assert_eq!(again.header("etag"), packed.header("etag"), "{path}");
    }
    assert!(!taking("/healthz").await.headers.contains_key("content-encoding"), "a short answer");
    let id = bench.get("/v1/examples").await.json()["items"][0]["id"].as_str().expect("an id").to_owned();
    let headers = [("accept-encoding", "gzip")];
    let mesh = bench.request(Method::GET, &format!("/v1/examples/{id}/mesh"), &headers, Body::empty()).await;
    assert!(mesh.status == StatusCode::OK && !mesh.headers.contains_key("content-encoding"));
    let query = bench.query("", "segment disc 1").await;
    let headers = [("accept-encoding", "gzip"), ("accept", "application/x-ndjson")];
    let stream = bench.request(Method::GET, &format!("{query}/stream"), &headers, Body::empty()).await;
    assert!(stream.status == StatusCode::OK && !stream.headers.contains_key("content-encoding"));
}

#[tokio::test]
async fn health_and_metrics_are_told() {
    let bench = Bench::stocked().await;
    let health: Health = serde_json::from_slice(&bench.get("/healthz").await.bytes).expect("health");
    assert_eq!(health.status, "ok");
    let ready = bench.get("/readyz").await;
    assert_eq!((ready.status, &ready.json()["examples"]), (StatusCode::OK, &json!(4)));
    assert_eq!((&ready.json()["segments"], &ready.json()["segments_waiting"]), (&json!(4), &json!(0)));
    let metrics = bench.get("/metrics").await;
    assert!(metrics.header("content-type").starts_with("text/plain"));
    assert!(metrics.text().contains("quadmuse_requests_total"), "{}", metrics.text());
    assert!(metrics.text().contains("route=\"/v1/examples\""));
}

#[tokio::test]
async fn tokens_open_what_their_role_allows() {
    let bench = Bench::new();
    let tokens = Tokens::beside(bench.dir.path());
    let create = |role| tokens.create(&NewToken { role, ..NewToken::default() }).expect("created");
    let (reader, _) = create(Role::Reader);
    let (contributor, _) = create(Role::Contributor);
    let ask = async |token: &str, method: Method, path: &str| {
        let bearer = format!("Bearer {token}");
        bench.request(method, path, &[("authorization", &bearer)], "segment disc 1").await
    };
    let refused = bench.get("/v1/examples").await;
    assert!(refused.problem(401, "unauthorized").contains("found none"));
    assert_eq!(refused.header("www-authenticate"), "Bearer");
    // A token that lets nobody in is not called none.
    let wrong = ask("qm_wrong", Method::GET, "/v1/examples").await.problem(401, "unauthorized");
    assert!(wrong.contains("found one that is unknown, expired or revoked"), "{wrong}");
    assert_eq!(ask(&reader, Method::GET, "/v1/examples").await.status, StatusCode::OK);
    ask(&reader, Method::POST, "/v1/examples").await.problem(403, "forbidden");
    assert_eq!(ask(&contributor, Method::POST, "/v1/examples").await.status, StatusCode::CREATED);
    assert_eq!(ask(&reader, Method::POST, "/v1/queries").await.status, StatusCode::ACCEPTED);
    assert_eq!(bench.get("/healthz").await.status, StatusCode::OK);
}

#[tokio::test]
async fn the_contract_names_every_route_and_resolves_every_reference() {
    let bench = Bench::new();
    let spec = bench.get("/openapi.json").await.json();
    assert!(spec["openapi"].as_str().is_some_and(|version| version.starts_with("3.1")), "{}", spec["openapi"]);
    let paths = spec["paths"].as_object().expect("paths");
    for (path, methods) in [
        ("/v1/examples", vec!["get", "post"]),
        ("/v1/examples/{id}", vec!["delete", "get", "patch"]),
        ("/v1/queries/{id}/stream", vec!["get"]),
        ("/v1/queries/{id}/maps/{map}/constraints", vec!["patch"]),
        ("/v1/queries/{id}/compositions", vec!["get", "post"]),
        ("/v1/queries/{id}/maps/{map}", vec!["delete", "get"]),
        ("/v1/samples/{number}/mesh", vec!["get"]),
        ("/readyz", vec!["get"]),
    ] {
        let mut found: Vec<&str> = paths[path].as_object().expect(path).keys().map(String::as_str).collect();
        found.sort_unstable();
        assert_eq!(found, methods, "{path}");
    }
    let text = spec.to_string();
    for reference in text.split("\"#/components/schemas/").skip(1) {
        let name = reference.split('"').next().expect("a name");
        assert!(!spec["components"]["schemas"][name].is_null(), "{name} is not described");
    }
    let operations = paths.values().flat_map(|path| path.as_object().expect("operations").values());
    let mut names: Vec<&str> = operations.map(|one| one["operationId"].as_str().expect("a name")).collect();
    let all = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), all, "{names:?}");
    for link in text.split(r#""links":{"#).skip(1).flat_map(|links| links.split(r#""operationId":""#).skip(1)) {
        let name = link.split('"').next().expect("a name");
        assert!(names.contains(&name), "{name} is no operation");
    }
    let picture = &paths["/v1/examples/{id}/thumbnail.png"]["get"]["responses"]["200"]["content"]["image/png"];
    assert_eq!(picture["schema"]["format"], "binary");
    let codes = &spec["components"]["schemas"]["Code"]["enum"];
    assert_eq!(codes.as_array().map(Vec::len), Some(quadmuse_proto::Code::ALL.len()));
}

#[tokio::test]
async fn pages_load_nothing_from_elsewhere() {
    let bench = Bench::new();
    for path in ["/", "/docs"] {
        let page = bench.get(path).await;
        assert_eq!(page.header("content-type"), "text/html; charset=utf-8");
        assert!(page.header("content-security-policy").contains("default-src 'none'"));
        assert!(!page.text().contains("http://") && !page.text().contains("https://"), "{path}");
        assert!(!page.text().contains(" style=") && !page.text().contains("<script>"), "{path}");
    }
    // Every script that a page or another script asks for is there, and asks for nothing else.
    let mut wanted = vec!["/web/index.js".to_owned(), "/web/docs.js".into()];
    let mut seen = 0;
    while let Some(path) = wanted.get(seen).cloned() {
        seen += 1;
        let script = bench.get(&path).await;
        assert_eq!((script.status, script.header("content-type")), (StatusCode::OK, "text/javascript; charset=utf-8"));
        assert!(!script.text().contains("http://") && !script.text().contains("https://"), "{path}");
        let text = script.text();
        let imports = text.lines().filter(|line| line.starts_with("import "));
        let imports = imports.filter_map(|line| line.split('"').nth(1)).map(str::to_owned);
        wanted.extend(imports.filter(|import| !wanted.contains(import)).collect::<Vec<_>>());
    }
    assert_eq!(seen, 45, "{wanted:?}");
    // Every file of the page is served.
    for entry in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/web")).expect("the page's folder") {
        let name = entry.expect("a file").file_name().into_string().expect("a name");
        if !name.ends_with(".html") {
            assert_eq!(bench.get(&format!("/web/{name}")).await.status, StatusCode::OK, "{name}");
        }
    }
    bench.get("/web/secret").await.problem(404, "not_found");
    bench.get("/web/..%2findex.js").await.problem(404, "not_found");
}

#[tokio::test]
async fn pages_of_other_origins_and_rebound_names_are_refused() {
    let bench = Bench::stocked().await;
    let here = ("host", "127.0.0.1:7979");
    let foreign = [("origin", "http://evil.example"), ("origin", "null"), ("sec-fetch-site", "cross-site")];
    for said in foreign {
        for (method, path) in
            [(Method::POST, "/v1/examples"), (Method::POST, "/v1/queries"), (Method::DELETE, "/v1/queries/x")]
        {
            let headers = [here, said, ("content-type", "text/plain")];
            let answer = bench.request(method, path, &headers, "segment disc 9").await;
            answer.problem(403, "forbidden");
        }
    }
    let rebound = ("host", "evil.example:7979");
    for path in ["/", "/v1/examples", "/healthz", "/openapi.json"] {
        bench.request(Method::GET, path, &[rebound], Body::empty()).await.problem(421, "forbidden");
    }
    assert_eq!(bench.get("/v1/examples").await.json()["items"].as_array().map(Vec::len), Some(4));
    let own = [here, ("origin", "http://127.0.0.1:7979"), ("sec-fetch-site", "same-origin")];
    let added = bench.request(Method::POST, "/v1/examples", &own, "segment disc 9").await;
    assert_eq!(added.status, StatusCode::CREATED, "{}", added.text());
}

#[tokio::test]
async fn pages_of_origins_that_are_allowed_may_ask_and_read() {
    let bench = Bench::stocked().await;
    let here = ("host", "127.0.0.1:7979");
    let asks = [("access-control-request-method", "PATCH"), ("access-control-request-headers", "authorization")];
    for (origin, allowed) in [("https://tools.example", "https://tools.example"), ("https://evil.example", "")] {
        let headers = [&[here, ("origin", origin)][..], &asks].concat();
        let asked = bench.request(Method::OPTIONS, "/v1/examples/x", &headers, Body::empty()).await;
        assert_eq!(asked.header("access-control-allow-origin"), allowed, "{origin}");
        let read = bench.request(Method::GET, "/v1/examples", &[here, ("origin", origin)], Body::empty()).await;
        assert_eq!(read.header("access-control-allow-origin"), allowed, "{origin}");
    }
    let foreign = [here, ("origin", "https://tools.example"), ("sec-fetch-site", "cross-site")];
    let added = bench.request(Method::POST, "/v1/examples", &foreign, "segment disc 9").await;
    assert_eq!(added.status, StatusCode::CREATED, "{}", added.text());
    assert_eq!(added.header("access-control-allow-origin"), "https://tools.example");
    assert!(added.header("access-control-expose-headers").contains("location"));
}

#[tokio::test]
async fn the_samples_are_listed_and_are_meshes() {
    let bench = Bench::new();
    let listed = bench.get("/v1/samples").await.json();
    let items = listed["items"].as_array().expect("items");
    let of = |kind: &str| items.iter().filter(|sample| sample["kind"] == kind).count();
    assert!(of("example") > 10 && of("scan") > 1 && items.len() == of("example") + of("scan"), "{listed}");
    for (number, sample) in items.iter().enumerate() {
        assert_eq!(sample["number"], number as u64);
        let mesh = bench.get(&format!("/v1/samples/{number}/mesh")).await;
        assert_eq!((mesh.status, mesh.header("content-type")), (StatusCode::OK, "model/obj"));
        let faces = mesh.text().lines().filter(|line| line.starts_with("f ")).count() as u64;
        assert_eq!(sample["faces"], faces, "{sample}");
    }
    bench.get(&format!("/v1/samples/{}/mesh", items.len())).await.problem(404, "not_found");
    bench.get("/v1/samples/x/mesh").await.problem(404, "not_found");
}

#[tokio::test]
async fn a_json_body_needs_its_content_type() {
    let bench = Bench::stocked().await;
    let id = bench.get("/v1/examples").await.json()["items"][0]["id"].as_str().expect("an id").to_owned();
    let path = format!("/v1/examples/{id}");
    for kind in [None, Some("text/plain"), Some("application/x-www-form-urlencoded"), Some("multipart/form-data")] {
        let headers: Vec<(&str, &str)> = kind.map(|kind| ("content-type", kind)).into_iter().collect();
        let answer = bench.request(Method::PATCH, &path, &headers, r#"{"name": "x"}"#).await;
        answer.problem(415, "format_unknown");
    }
}

#[tokio::test]
async fn no_answer_lets_a_browser_guess_its_type() {
    let bench = Bench::stocked().await;
    let id = bench.get("/v1/examples").await.json()["items"][0]["id"].as_str().expect("an id").to_owned();
    let mesh = format!("/v1/examples/{id}/mesh");
    for path in
        ["/", "/docs", "/web/index.js", "/v1/examples", &mesh, "/healthz", "/metrics", "/openapi.json", "/nothing"]
    {
        let answer = bench.get(path).await;
        assert_eq!(answer.header("x-content-type-options"), "nosniff", "{path}");
        assert_eq!(answer.header("cross-origin-resource-policy"), "same-origin", "{path}");
    }
}

#[tokio::test]
async fn invented_methods_make_no_new_metrics() {
    let bench = Bench::new();
    for n in 0..50 {
        let method = Method::from_bytes(format!("BREW{n}").as_bytes()).expect("a method");
        bench.request(method, "/v1/examples", &[], Body::empty()).await.problem(405, "method_not_allowed");
    }
    let metrics = bench.get("/metrics").await.text();
    assert!(!metrics.contains("BREW") && metrics.contains("method=\"other\""), "{metrics}");
    for name in [
        "quadmuse_request_seconds_bucket",
        "quadmuse_memory_bytes{kind=\"limit\"}",
        "quadmuse_quarantined",
        "quadmuse_writable",
        "quadmuse_lane_waiting{lane=\"coarse\"}",
    ] {
        assert!(metrics.contains(name), "{name} in {metrics}");
    }
}

#[test]
fn dashboard_and_alerts_name_metrics_that_there_are() {
    let sources = [
        include_str!("../health.rs"),
        include_str!("../watchful.rs"),
        include_str!("../forward.rs"),
        include_str!("../../work/scrub.rs"),
        include_str!("../../work/jobs.rs"),
        include_str!("../../work/search/scattered.rs"),
    ];
    let texts = [
        include_str!("../../../../docs/operations/grafana.json"),
        include_str!("../../../../docs/operations/alerts.yaml"),
    ];
    let is_part = |c: char| c.is_ascii_lowercase() || c == '_';
    let mut seen = 0;
    for text in texts {
        for (at, _) in text.match_indices("quadmuse_") {
            let name = &text[at..];
            let name = &name[..name.find(|c| !is_part(c)).unwrap_or(name.len())];
            let name = format!("\"{}\"", name.trim_end_matches("_bucket"));
            assert!(sources.iter().any(|source| source.contains(&name)), "{name}");
            seen += 1;
        }
    }
    assert!(seen > 20, "{seen}");
    serde_json::from_str::<Value>(texts[0]).expect("a dashboard");
}
