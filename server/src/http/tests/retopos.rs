//! Retopologies: which cut of a scan comes back, and what is freed.

use super::*;
use serde_json::json;

/// A service whose examples lie poorly on discs and well on annuli.
async fn bench() -> Bench {
    let bench = Bench::new();
    bench.add("poor", "segment disc 9\nlies poor 1").await;
    bench.add("good", "segment annulus 2\nlies good 1").await;
    bench
}

/// Makes quads for a scan; the retopology, and the path of its query.
async fn made(bench: &Bench, options: &str, scan: &str) -> (Value, String) {
    let path = bench.query(options, scan).await;
    let made = bench.post_json(&format!("{path}/retopos?wait=60"), json!({})).await;
    assert_eq!(made.status, StatusCode::CREATED, "{scan}: {}", made.text());
    assert_eq!(bench.get(made.header("location")).await.json(), made.json());
    (made.json(), path)
}

fn notes(made: &Value) -> String {
    made["notes"].to_string()
}

/// The path of the query that has the result.
fn result_query(made: &Value) -> String {
    format!("/v1/queries/{}", made["result_query"].as_str().expect("an id"))
}

async fn queries(bench: &Bench) -> usize {
    bench.get("/v1/queries").await.json()["items"].as_array().map_or(0, Vec::len)
}

#[tokio::test]
async fn a_scan_that_an_example_fits_is_not_cut() {
    let bench = bench().await;
    let (made, path) = made(&bench, "", "segment annulus 2\nlarge\nprotrusion annulus 2\nprotrusion annulus 3").await;
    assert_eq!((&made["verdict"], &made["inspired"]), (&json!("good"), &json!(1.0)));
    assert_eq!((result_query(&made), queries(&bench).await), (path.clone(), 1));
    let composition = made["result"]["composition"].as_str().expect("a composition");
    let mesh = bench.get(&format!("{path}/compositions/{composition}/mesh")).await;
    assert_eq!((mesh.status, mesh.text().as_str()), (StatusCode::OK, "obj with 1 faces"));
}

#[tokio::test]
async fn an_example_that_was_removed_since_the_ranking_is_passed_over() {
    let bench = bench().await;
    let best = bench.add("best", "segment annulus 2.5\nlies good 1").await;
    let path = bench.query("", "segment annulus 2.5\nlarge").await;
    bench.ended(&path).await;
    let gone = bench.request(Method::DELETE, &format!("/v1/examples/{best}"), &[], "").await;
    assert!(gone.status.is_success(), "{}", gone.text());
    let made = bench.post_json(&format!("{path}/retopos?wait=60"), json!({})).await;
    assert_eq!(made.status, StatusCode::CREATED, "{}", made.text());
    assert_eq!(made.json()["inspired"], json!(1.0), "the other's");
}

#[tokio::test]
async fn what_no_example_fits_as_a_whole_is_cut_and_ranked_anew() {
    let bench = bench().await;
    let scan = "segment disc 2\nlarge\nprotrusion annulus 2\nprotrusion annulus 3";
    let (made, path) = made(&bench, "", scan).await;
    let notes = notes(&made);
    assert!(notes.contains("the best example, poor, fits poorly as a whole"), "{notes}");
    assert!(notes.contains("cutting the mesh into parts"), "{notes}");
    assert_eq!((&made["verdict"], &made["inspired"]), (&json!("good"), &json!(1.0)));
    // The query of the result stays, and may be started again; that of the waist, which there is not, is freed.
    let of = result_query(&made);
    assert!(of != path && queries(&bench).await == 2, "{made}");
    let composition = bench.get(&format!("{of}/compositions")).await.json()["items"][0].clone();
    assert_eq!((&composition["id"], &composition["quads"]), (&made["result"]["composition"], &json!(2)));
    assert_eq!(bench.post(&format!("{of}/restart"), "").await.status, StatusCode::ACCEPTED);
}

#[tokio::test]
async fn a_figure_is_parted_from_its_base_where_a_side_is_more_like_an_example_than_the_whole() {
    // Where the whole is as like an example as a side is, that cut is not ranked to its end.
    for (number, is_parted) in [(2, true), (9, false)] {
        let bench = bench().await;
        let scan = format!("segment disc {number}\nlarge\nside annulus 2\nside disc 3");
        let (made, path) = made(&bench, "", &scan).await;
        assert_eq!(notes(&made).contains("parting it at its waist"), is_parted, "{made}");
        assert_eq!((result_query(&made) != path, queries(&bench).await), (is_parted, 1 + usize::from(is_parted)));
        assert_eq!(made["inspired"].as_f64() > Some(0.0), is_parted, "{made}");
    }
}

#[tokio::test]
async fn where_no_example_fits_there_is_a_regular_layout_of_the_whole_and_nothing_else_is_left() {
    let scan = "segment disc 2\nlarge\nprotrusion disc 3\nprotrusion disc 4";
    for (options, is_cut) in [("", true), ("segments=whole", false), ("parts=1", false)] {
        let bench = bench().await;
        let (made, path) = made(&bench, options, scan).await;
        assert_eq!((&made["verdict"], &made["inspired"]), (&json!("poor"), &json!(0.0)), "{made}");
        assert_eq!(notes(&made).contains("no example fits enough of its parts"), is_cut, "{options}: {made}");
        assert_eq!((result_query(&made), queries(&bench).await), (path, 1), "{options}");
    }
    let (made, _) = made(&bench().await, "", "segment disc 2\nlarge").await;
    assert!(notes(&made).contains("no parts were found"), "{made}");
}

#[tokio::test]
async fn what_is_no_longer_kept_is_not_cut_and_that_is_told() {
    let bench = bench().await;
    let path = bench.query("", "segment disc 2\nlarge\nprotrusion annulus 2\nprotrusion annulus 3").await;
    bench.ended(&path).await;
    let id = path.rsplit('/').next().expect("an id");
    let file = bench.dir.path().join("queries").join(id);
    let begun = Instant::now();
    while std::fs::remove_file(&file).is_err() {
        assert!(begun.elapsed() < Duration::from_secs(20), "expected the upload to be kept");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    let made = bench.post_json(&format!("{path}/retopos?wait=60"), json!({})).await.json();
    assert!(notes(&made).contains("is no longer kept"), "{made}");
    assert_eq!((result_query(&made), &made["inspired"]), (path, &json!(0.0)));
}

#[tokio::test]
async fn segments_with_too_few_faces_are_told_and_get_no_map() {
    let bench = bench().await;
    let few = vec!["segment annulus 2"; 40].join("\n");
    let (made, path) = made(&bench, "", &few).await;
    assert!(notes(&made).contains("of 40 segments have too few faces for an example"), "{made}");
    let maps = bench.get(&format!("{path}/maps")).await.json()["items"].as_array().map_or(0, Vec::len);
    assert!(0 < maps && maps < 40, "{maps}");
}

#[tokio::test]
async fn the_map_that_is_worth_most_is_taken_and_none_is_laid_after_one_that_is_good_enough() {
    // The share of the scan that the map of each example covers, which of them is taken, and how many are laid: after the first
    // two at a time, so that one more may be under way when one is good enough.
    let tried = [
        ([0.1, 0.3, 0.2], "b", 3..=3),
        ([0.1, 0.9, 1.0], "b", 2..=3),
        ([0.3, 0.1, 0.1], "a", 3..=3),
        ([0.9, 1.0, 1.0], "a", 1..=1),
    ];
    for (covered, taken, count) in tried {
        let bench = Bench::new();
        let mut ids = Vec::new();
        for ((name, number), share) in ["a", "b", "c"].into_iter().zip(1..).zip(covered) {
            ids.push((name, bench.add(name, &format!("segment disc {number}\nlies fair {share}")).await));
        }
        let (made, path) = made(&bench, "", "segment disc 1\nlarge").await;
        let maps = bench.get(&format!("{path}/maps")).await.json()["items"].clone();
        let maps = maps.as_array().expect("maps");
        assert!(count.contains(&maps.len()), "{covered:?}: {}", maps.len());
        let map = maps.iter().find(|map| map["id"] == made["result"]["map"]).expect("a map as it is");
        let (_, id) = ids.iter().find(|(name, _)| *name == taken).expect("an example");
        assert_eq!(map["example"], id.as_str(), "{covered:?}");
    }
}

#[tokio::test]
async fn a_map_that_is_broken_by_what_it_leaves_bare_is_stitched_and_not_handed_out() {
    // What is torn where examples stand on it is laid out anew.
    for (scan, verdict, inspired) in [("", "fair", 1.0), ("\ntears", "poor", 0.0)] {
        let bench = Bench::new();
        bench.add("short", "segment disc 1\nlies short 1").await;
        let (made, path) = made(&bench, "", &format!("segment disc 1\nlarge{scan}")).await;
        assert_eq!((&made["verdict"], &made["inspired"]), (&json!(verdict), &json!(inspired)), "{made}");
        assert!(made["result"]["composition"].is_string(), "{made}");
        let map = bench.get(&format!("{path}/maps")).await.json()["items"][0].clone();
        assert_eq!(map["verdict"], "broken");
    }
}

#[tokio::test]
async fn one_that_is_cancelled_frees_what_it_began() {
    let bench = bench().await;
    let scan = "segment disc 2\nlarge\nslow 30\nprotrusion annulus 2\nprotrusion annulus 3";
    let path = bench.query("", scan).await;
    let asked = bench.post_json(&format!("{path}/retopos"), json!({})).await;
    assert_eq!(asked.status, StatusCode::ACCEPTED, "{}", asked.text());
    let address = asked.header("location").to_owned();
    let begun = Instant::now();
    while queries(&bench).await < 2 {
        assert!(begun.elapsed() < Duration::from_secs(20), "expected the scan to be cut");
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    let gone = bench.request(Method::DELETE, &address, &[], Body::empty()).await;
    assert_eq!(gone.status, StatusCode::NO_CONTENT);
    while queries(&bench).await > 1 {
        assert!(begun.elapsed() < Duration::from_secs(20), "expected the cut query to be freed");
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    assert_eq!(bench.get(&address).await.json()["state"], "cancelled");
}

#[tokio::test]
async fn what_is_wrong_with_the_request_is_told_at_once() {
    let bench = bench().await;
    let path = bench.query("", "segment annulus 2").await;
    let retopos = format!("{path}/retopos");
    for (field, value) in [("density", 9), ("smoothing", 1000), ("colour", 1)] {
        let refused = bench.post_json(&retopos, json!({ field: value })).await;
        assert_eq!(refused.status, StatusCode::BAD_REQUEST, "{field}: {}", refused.text());
    }
    bench.get(&format!("{retopos}/01ARZ3NDEKTSV4RRFFQ69G5FAV")).await.problem(404, "not_found");
    let denser = bench.post_json(&format!("{retopos}?wait=60"), json!({"density": 1})).await.json();
    let composition = denser["result"]["composition"].as_str().expect("a composition");
    assert_eq!(bench.get(&format!("{path}/compositions/{composition}")).await.json()["density"], 1);
}
