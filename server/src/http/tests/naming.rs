//! Tests of the names that segments of a query are given.

use super::forward::Shared;
use super::*;
use serde_json::json;

const TWO: &str = "segment disc 1\nsegment disc 2";

impl Bench {
    async fn name(&self, path: &str, segments: Value) -> Answer {
        let kind = [(header::CONTENT_TYPE.as_str(), "application/json")];
        self.request(Method::PATCH, path, &kind, json!({ "segments": segments }).to_string()).await
    }

    /// The names that a query's resource tells, in the order of its segments.
    async fn names(&self, path: &str) -> Vec<Value> {
        of(&self.get(path).await.json())
    }
}

fn of(query: &Value) -> Vec<Value> {
    query["segments"].as_array().expect("segments").iter().map(|segment| segment["name"].clone()).collect()
}

#[tokio::test]
async fn segments_are_named_one_by_one_and_lose_their_names_again() {
    let bench = Bench::stocked().await;
    let path = bench.query("", TWO).await;
    assert!(!bench.get(&path).await.text().contains("\"name\""), "absent where there is none");
    let answer = bench.name(&path, json!([{"segment": 1, "name": "linker Arm"}])).await;
    assert_eq!((answer.status, of(&answer.json())), (StatusCode::OK, vec![json!(null), json!("linker Arm")]));
    // Another leaves it as it is; two may be called the same.
    bench.name(&path, json!([{"segment": 0, "name": "linker Arm"}])).await;
    assert_eq!(bench.names(&path).await, ["linker Arm", "linker Arm"]);
    bench.name(&path, json!([{"segment": 0, "name": "馬"}, {"segment": 1, "name": ""}])).await;
    assert_eq!(bench.names(&path).await, [json!("馬"), json!(null)]);
    // All who tell of the query tell it: its list, and the end of its stream.
    assert_eq!(of(&bench.get("/v1/queries").await.json()["items"][0])[0], "馬");
    bench.ended(&path).await;
    let accept = [("accept", "application/x-ndjson")];
    let stream = bench.request(Method::GET, &format!("{path}/stream"), &accept, Body::empty()).await;
    let last = stream.text().lines().last().map(serde_json::from_str::<Value>).expect("an end").expect("JSON");
    assert_eq!(of(&last["summary"])[0], "馬");
    assert_eq!(bench.request(Method::PATCH, &path, &[("content-type", "application/json")], "{}").await.status, 200);
    assert_eq!(bench.names(&path).await[0], "馬");
}

#[tokio::test]
async fn names_that_are_no_names_are_refused_and_none_of_the_others_is_given() {
    let bench = Bench::stocked().await;
    let path = bench.query("", TWO).await;
    let most = "ä".repeat(60);
    for (second, said) in [
        (json!({"segment": 1, "name": format!("{most}x")}), "at most 60 characters, found 61"),
        (json!({"segment": 1, "name": "  "}), "not only blanks"),
        (json!({"segment": 1, "name": "a\nb"}), "U+000A"),
        (json!({"segment": 1, "name": "a\u{202e}b"}), "U+202E"),
        (json!({"segment": 0, "name": "b"}), "each segment once, found 0 twice"),
    ] {
        let answer = bench.name(&path, json!([{"segment": 0, "name": "a"}, second])).await;
        let detail = answer.problem(400, "parameter_invalid");
        assert!(detail.contains("`segments`") && detail.contains(said), "{detail}");
    }
    let unknown = bench.name(&path, json!([{"segment": 0, "name": "a"}, {"segment": 2, "name": "b"}])).await;
    assert!(unknown.problem(404, "not_found").contains("below 2, found 2"));
    let many: Vec<Value> = (0..257).map(|k| json!({"segment": k, "name": "a"})).collect();
    assert!(bench.name(&path, json!(many)).await.problem(400, "parameter_invalid").contains("at most 256"));
    for wrong in [json!([{"segment": 0}]), json!([{"name": "a"}]), json!([{"segment": 0, "name": "a", "x": 1}])] {
        bench.name(&path, wrong).await.problem(400, "body_invalid");
    }
    assert_eq!(bench.names(&path).await, [json!(null), json!(null)]);
    assert_eq!(bench.name(&path, json!([{"segment": 0, "name": most}])).await.status, StatusCode::OK);
    let absent = format!("/v1/queries/{}", quadmuse_proto::QueryId::generate());
    bench.name(&absent, json!([])).await.problem(404, "not_found");
}

#[tokio::test]
async fn names_are_paid_for_as_long_as_they_are_held() {
    let bench = Bench::stocked().await;
    let live = bench.idle_query();
    let path = format!("/v1/queries/{}", live.id);
    let used = || bench.work.pool.admission().used().bytes;
    let before = used();
    bench.name(&path, json!([{"segment": 0, "name": "x".repeat(60)}])).await;
    assert_eq!((live.names.bytes(), used()), (124, before + 124));
    bench.name(&path, json!([{"segment": 0, "name": "x"}])).await;
    assert_eq!((live.names.bytes(), used()), (65, before + 65));
    // Where there is no room it is told, and the old name stays.
    let (mut rest, mut piece) = (Vec::new(), 32 << 20);
    while piece > 0 {
        match bench.work.pool.admission().hold(User(0), piece) {
            Ok(held) => rest.push(held),
            Err(_) => piece /= 2,
        }
    }
    bench.name(&path, json!([{"segment": 0, "name": "longer"}])).await.problem(429, "overloaded");
    assert_eq!(bench.names(&path).await, ["x"]);
    drop(rest);
    bench.name(&path, json!([{"segment": 0, "name": ""}])).await;
    assert_eq!((live.names.bytes(), used()), (0, before));
}

#[tokio::test]
async fn a_query_that_is_started_again_has_the_names_it_had() {
    let bench = Bench::stocked().await;
    let path = bench.query("", TWO).await;
    bench.name(&path, json!([{"segment": 1, "name": "old"}])).await;
    bench.name(&path, json!([{"segment": 1, "name": "arm"}])).await;
    bench.ended(&path).await;
    let begun = Instant::now();
    let again = async |path: &str| loop {
        let again = bench.post(&format!("{path}/restart"), "").await;
        if again.status == StatusCode::ACCEPTED && of(&again.json())[1] == "arm" {
            break again.header("location").to_owned();
        }
        assert!(begun.elapsed() < Duration::from_secs(20), "{}", again.text());
        tokio::time::sleep(Duration::from_millis(5)).await;
    };
    let second = again(&path).await;
    bench.ended(&second).await;
    // What was let go for its memory is told by what is kept.
    while !bench.work.queries.is_empty() {
        bench.work.queries.let_idle_go(Duration::ZERO, Duration::ZERO);
        assert!(begun.elapsed() < Duration::from_secs(20), "still held");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    bench.get(&second).await.problem(410, "query_expired");
    let third = again(&second).await;
    assert_eq!(bench.names(&third).await, [json!(null), json!("arm")]);
    // With the query all goes that is kept of it.
    bench.request(Method::DELETE, &third, &[], Body::empty()).await;
    let id = third.rsplit('/').next().expect("an id").to_owned();
    let folder = bench.dir.path().join("queries");
    let is_kept = || {
        let mut files = std::fs::read_dir(&folder).expect("a folder").flatten();
        files.any(|file| file.file_name().to_string_lossy().starts_with(&id))
    };
    while is_kept() {
        assert!(begun.elapsed() < Duration::from_secs(20), "still kept");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn names_are_given_through_any_server_and_outlive_the_one_that_had_them() {
    let shared = Shared::new();
    let (a, b) = (shared.server().await, shared.server().await);
    let query = a.query(TWO).await;
    shared.until_kept(&query, KeptKind::Upload).await;
    let kind = [("content-type", "application/json")];
    let body = json!({"segments": [{"segment": 0, "name": "arm"}]}).to_string();
    let named = b.ask(Method::PATCH, &query, &kind, body).await;
    assert_eq!((named.status, of(&named.json())), (StatusCode::OK, vec![json!("arm"), json!(null)]));
    assert_eq!(of(&a.get(&query).await.json())[0], "arm");
    shared.until_kept(&query, KeptKind::Names).await;
    a.die().await;
    let again = b.ask(Method::POST, &format!("{query}/restart"), &[], "").await;
    assert_eq!(of(&again.json()), [json!("arm"), json!(null)], "{}", again.text());
}
