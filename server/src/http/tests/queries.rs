//! `/v1/queries` and their rankings.

use super::*;
use serde_json::json;

/// The names of the examples, without the regular layout that ends every ranking.
fn names(ranking: &Value) -> Vec<&str> {
    let entries = ranking["entries"].as_array().expect("entries");
    let examples = entries.iter().filter(|e| e["template"].is_null());
    examples.map(|e| e["name"].as_str().expect("a name")).collect()
}

#[tokio::test]
async fn a_query_is_ranked_to_its_end() {
    let bench = Bench::stocked().await;
    let path = bench.query("top=1", "segment disc 2.1\nsegment disc 3.9").await;
    let query = bench.ended(&path).await;
    assert_eq!((&query["state"], &query["deadline_reached"]), (&json!("done"), &json!(false)));
    assert_eq!((&query["top"], &query["resolution"], &query["corpus_size"]), (&json!(1), &json!(128), &json!(8)));
    assert_eq!(query["progress"]["levels_done"], query["progress"]["levels"]);
    assert_eq!(query["segments"][1]["level"], json!(128));
    let ranking = bench.get(&format!("{path}/ranking?segment=1")).await.json();
    assert_eq!(names(&ranking), ["d", "c", "b", "a"]);
    assert_eq!((&ranking["segment"], &ranking["level"], &ranking["corpus_size"]), (&json!(1), &json!(128), &json!(4)));
    let first = &ranking["entries"][0];
    assert_eq!((&first["rank"], &first["state"], &first["resolution"]), (&json!(1), &json!("done"), &json!(128)));
    assert_eq!(first["flip"], json!({"u": false, "v": false}));
    assert_eq!(ranking["entries"][3]["state"], json!("locked"));
    let scores: Vec<f64> = ranking["entries"]
        .as_array()
        .expect("entries")
        .iter()
        .map(|e| e["score"].as_f64().expect("a number"))
        .collect();
    assert!(scores.is_sorted(), "{scores:?}");
    assert_eq!(names(&bench.get(&format!("{path}/ranking?limit=2")).await.json()), ["b", "c"]);
    bench.get(&format!("{path}/ranking?segment=2")).await.problem(404, "not_found");
    bench.get(&format!("{path}/ranking?segment=x")).await.problem(400, "parameter_invalid");
}

#[tokio::test]
async fn only_examples_with_the_tags_and_the_topology_are_ranked() {
    let bench = Bench::stocked().await;
    bench.post("/v1/examples?name=tagged&tag=x", "segment disc 7").await;
    bench.post("/v1/examples?name=tube&tag=x", "segment annulus 7").await;
    let path = bench.query("tag=x", "segment disc 1").await;
    bench.ended(&path).await;
    assert_eq!(names(&bench.get(&format!("{path}/ranking")).await.json()), ["tagged"]);
    let detail = bench.post("/v1/queries?tag=nobody", "segment disc 1").await.problem(409, "corpus_empty");
    assert!(detail.contains("nobody"), "{detail}");
    // A topology of which there is no example takes a regular layout.
    assert_eq!(bench.post("/v1/queries", "segment torus 1").await.status, StatusCode::ACCEPTED);
}

#[tokio::test]
async fn a_parameter_that_is_not_there_is_refused_with_the_nearest_name() {
    let bench = Bench::stocked().await;
    let path = bench.query("top=1&deadline_ms=60000", "segment disc 2.1").await;
    for (answer, said) in [
        (
            bench.post("/v1/queries?resolutoin=64", "segment disc 1").await,
            "found `resolutoin`; did you mean `resolution`?",
        ),
        (bench.post("/v1/examples?name=x&tags=y", "segment disc 1").await, "did you mean `tag`?"),
        (bench.get(&format!("{path}/ranking?segments=0")).await, "did you mean `segment`?"),
        (bench.get(&format!("{path}?colour=red")).await, "expected no parameters here, found `colour`"),
        (bench.get("/v1/examples?colour=red").await, "parameters out of tag, topology, limit, cursor, found `colour`"),
    ] {
        let detail = answer.problem(400, "parameter_invalid");
        assert!(detail.contains(said), "{detail}");
    }
    assert_eq!(bench.get("/healthz?from=probe").await.status, StatusCode::OK);
}

#[tokio::test]
async fn options_outside_their_range_are_refused() {
    let bench = Bench::stocked().await;
    for wrong in ["top=0", "top=65", "top=x", "resolution=100", "deadline_ms=0", "deadline_ms=3600001", "segments=x"] {
        bench.post(&format!("/v1/queries?{wrong}"), "segment disc 1").await.problem(400, "parameter_invalid");
    }
}

#[tokio::test]
async fn a_long_poll_answers_when_there_is_something_newer() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1\nslow 30").await;
    let mut revision = 0;
    let mut levels = Vec::new();
    loop {
        let ranking = bench.get(&format!("{path}/ranking?after={revision}&wait_ms=10000")).await.json();
        let newest = ranking["revision"].as_u64().expect("a revision");
        if newest == revision {
            assert_eq!(ranking["state"], json!("done"));
            break;
        }
        revision = newest;
        levels.push(ranking["level"].as_u64().expect("a level"));
    }
    assert!(levels.is_sorted() && levels.first() == Some(&32) && levels.last() == Some(&128), "{levels:?}");
    bench.get(&format!("{path}/ranking?after=0&wait_ms=60001")).await.problem(400, "parameter_invalid");
}

#[tokio::test]
async fn a_long_poll_gives_up_after_its_time() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1\nencode-slow 60000").await;
    let begun = Instant::now();
    let ranking = bench.get(&format!("{path}/ranking?after=0&wait_ms=50")).await.json();
    assert!(begun.elapsed() >= Duration::from_millis(50) && begun.elapsed() < Duration::from_secs(20));
    assert_eq!((&ranking["revision"], &ranking["entries"]), (&json!(0), &json!([])));
    bench.request(Method::DELETE, &path, &[], Body::empty()).await;
}

#[tokio::test]
async fn cancelling_frees_the_cores_and_the_query() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1\nslow 60000").await;
    tokio::time::sleep(Duration::from_millis(30)).await;
    let begun = Instant::now();
    assert_eq!(bench.request(Method::DELETE, &path, &[], Body::empty()).await.status, StatusCode::NO_CONTENT);
    bench.get(&path).await.problem(404, "not_found");
    let other = bench.query("", "segment disc 1").await;
    assert_eq!(bench.ended(&other).await["state"], json!("done"));
    assert!(begun.elapsed() < Duration::from_secs(20), "the cores were not free");
}

#[tokio::test]
async fn a_deadline_answers_with_the_best_so_far() {
    let bench = Bench::stocked().await;
    // A round of 300 ms at least for each of three levels.
    let path = bench.query("deadline_ms=700", "segment disc 1\nslow 300").await;
    let query = bench.ended(&path).await;
    assert_eq!((&query["state"], &query["deadline_reached"]), (&json!("done"), &json!(true)));
    let ranking = bench.get(&format!("{path}/ranking")).await.json();
    assert_eq!(names(&ranking).len(), 4);
    assert!(ranking["level"].as_u64() < Some(128));
}

#[tokio::test]
async fn a_query_that_cannot_be_encoded_fails_with_its_problem() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1\npanic encode").await;
    let query = bench.ended(&path).await;
    assert_eq!((&query["state"], &query["problem"]["code"]), (&json!("failed"), &json!("internal")));
}

#[tokio::test]
async fn an_example_that_panics_while_it_is_refined_is_passed_over() {
    let bench = Bench::stocked().await;
    bench.add("broken", "segment disc 2.01\npanic refine").await;
    let path = bench.query("top=2", "segment disc 2").await;
    assert_eq!(bench.ended(&path).await["state"], json!("done"));
    let ranking = bench.get(&format!("{path}/ranking")).await.json();
    assert_eq!((names(&ranking)[0], names(&ranking).len()), ("b", 5));
    let broken = ranking["entries"].as_array().expect("entries").iter().find(|e| e["name"] == "broken");
    assert_eq!(broken.map(|e| &e["state"]), Some(&json!("locked")));
}

#[tokio::test]
async fn an_example_that_panics_when_it_comes_to_the_top_at_last_is_passed_over() {
    let bench = Bench::stocked().await;
    bench.add("sound", "segment disc 3.2\nlarge\nagrees 0.5").await;
    bench.add("broken", "segment disc 3.4\nlarge\nagrees 0.9\npanic refine").await;
    let path = bench.query("top=2", "segment disc 2.5\nlarge\nagrees 1").await;
    assert_eq!(bench.ended(&path).await["state"], json!("done"));
    let ranking = bench.get(&format!("{path}/ranking")).await.json();
    let states =
        ranking["entries"].as_array().expect("entries").iter().map(|e| (e["name"].clone(), e["state"].clone()));
    assert!(
        states.clone().any(|entry| entry == (json!("broken"), json!("locked"))),
        "{:?}",
        states.collect::<Vec<_>>()
    );
}

#[tokio::test]
async fn a_query_sees_the_corpus_as_it_was_when_it_began() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 2\nslow 20").await;
    bench.add("late", "segment disc 2.0").await;
    bench.ended(&path).await;
    assert!(!names(&bench.get(&format!("{path}/ranking")).await.json()).contains(&"late"));
}

#[tokio::test]
async fn the_input_comes_back_and_queries_are_listed() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1").await;
    assert_eq!(bench.get(&format!("{path}/mesh?format=off")).await.text(), "off with 1 faces");
    let listed = bench.get("/v1/queries").await.json();
    assert_eq!(format!("/v1/queries/{}", listed["items"][0]["id"].as_str().expect("an id")), path);
}

#[tokio::test]
async fn an_idempotency_key_starts_one_query() {
    let bench = Bench::stocked().await;
    let headers = [("idempotency-key", "k1")];
    let first = bench.request(Method::POST, "/v1/queries?top=2", &headers, "segment disc 1").await;
    let again = bench.request(Method::POST, "/v1/queries?top=2", &headers, "segment disc 1").await;
    assert_eq!((again.status, first.header("location")), (StatusCode::ACCEPTED, again.header("location")));
    bench.request(Method::POST, "/v1/queries?top=3", &headers, "segment disc 1").await.problem(409, "conflict");
    bench
        .request(Method::POST, "/v1/queries", &[("idempotency-key", "")], "segment disc 1")
        .await
        .problem(400, "parameter_invalid");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_removed_by_many_at_once_is_removed_by_one_and_nothing_fails() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1\nslow 300").await;
    let example = bench.add("gone", "segment disc 9").await;
    let of = format!("/v1/examples/{example}");
    let there = &bench;
    let remove = |path: &str| {
        let path = path.to_owned();
        async move { there.request(Method::DELETE, &path, &[], Body::empty()).await.status.as_u16() }
    };
    let maps = format!("{path}/maps?wait=60");
    let work = futures_util::future::join_all((0..4).map(|_| bench.post_json(&maps, json!({"example": example}))));
    let removals = futures_util::future::join_all((0..8).map(|k| remove(if k % 2 == 0 { &path } else { &of })));
    let (made, mut removed) = futures_util::future::join(work, removals).await;
    removed.sort_unstable();
    assert_eq!(removed, [204, 204, 404, 404, 404, 404, 404, 404]);
    for answer in made {
        let status = answer.status.as_u16();
        assert!([201, 404, 409].contains(&status), "{status}: {}", answer.text());
    }
}

#[tokio::test]
async fn where_the_surfaces_do_not_bear_the_first_pictures_out_all_others_are_laid_too() {
    for (first, best) in [("-0.2", "third"), ("0.5", "first")] {
        let bench = Bench::new();
        for (name, number, agrees) in [("first", "2.1", first), ("second", "1.85", "-0.2"), ("third", "2.2", "0.6")] {
            bench.add(name, &format!("segment disc {number}\nagrees {agrees}")).await;
        }
        let path = bench.query("", "segment disc 2\nlarge\nagrees 0").await;
        bench.ended(&path).await;
        let ranking = bench.get(&format!("{path}/ranking")).await.json();
        assert_eq!(names(&ranking)[0], best, "{ranking}");
    }
}
