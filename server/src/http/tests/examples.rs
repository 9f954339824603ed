//! `/v1/examples`.

use super::*;
use serde_json::json;
use std::sync::atomic::Ordering;

#[tokio::test]
async fn an_example_is_added_once_and_described() {
    let bench = Bench::new();
    let first =
        bench.post("/v1/examples?name=ear&tag=head&tag=ear&relevance=4", "segment disc 1\nsegment annulus 2").await;
    assert_eq!(first.status, StatusCode::CREATED);
    let example = first.json();
    let id = example["id"].as_str().expect("an id");
    assert_eq!(first.header("location"), format!("/v1/examples/{id}"));
    assert_eq!((&example["name"], &example["tags"]), (&json!("ear"), &json!(["ear", "head"])));
    assert_eq!((&example["relevance"], &example["format"]), (&json!(4.0), &json!("obj")));
    assert_eq!(example["counts"], json!({"vertices": 4, "faces": 2, "triangles": 0, "quads": 2}));
    let segment = json!({"segment": 1, "topology": "annulus", "k": 1.0, "faces": 1, "features": 0});
    assert_eq!(example["segments"][1], segment);
    let again = bench.post("/v1/examples?name=other", "segment disc 1\nsegment annulus 2").await;
    assert_eq!((again.status, again.json()), (StatusCode::OK, example.clone()));
    assert_eq!(bench.get(&format!("/v1/examples/{id}")).await.json(), example);
}

/// The numbers of an example's segments that are parts.
fn parts(example: &Value) -> Vec<u64> {
    let segments = example["segments"].as_array().expect("segments").iter();
    segments.filter(|s| s["is_part"] == true).map(|s| s["segment"].as_u64().expect("a number")).collect()
}

const ANIMAL: &str = "segment sphere 1\npart disc 2\npart disc nan\npart annulus 3";

#[tokio::test]
async fn an_example_is_kept_whole_and_by_its_parts_unless_told_otherwise() {
    let bench = Bench::new();
    let added = bench.post("/v1/examples?name=both", ANIMAL).await;
    assert_eq!(added.status, StatusCode::CREATED);
    let both = added.json();
    // The part that can't be encoded is left out, and those after it move up.
    assert_eq!(parts(&both), [1, 2]);
    assert_eq!(both["segments"][0]["topology"], "sphere");
    assert!(both["segments"][0].get("is_part").is_none());
    assert_eq!(both["segments"][2]["topology"], "annulus");
    for (n, how) in ["parts=none", "parts=4", "parts=auto", "segments=whole", "segments=groups"].iter().enumerate() {
        let other = bench.post(&format!("/v1/examples?{how}"), &format!("{ANIMAL}\nslow {n}")).await;
        assert_eq!((other.status, parts(&other.json())), (StatusCode::CREATED, vec![]), "{how}");
    }
    for parts in ["some", "waist"] {
        bench.post(&format!("/v1/examples?parts={parts}"), ANIMAL).await.problem(400, "parameter_invalid");
    }
    // Its parts make it no sphere less, and no disc.
    let listed = |page: Value| page["items"].as_array().expect("items").len();
    assert_eq!(listed(bench.get("/v1/examples?topology=sphere").await.json()), 6);
    assert_eq!(listed(bench.get("/v1/examples?topology=disc").await.json()), 0);
}

#[tokio::test]
async fn the_same_mesh_whole_or_with_parts_is_one_example_as_it_was_added_first() {
    let bench = Bench::new();
    let whole = bench.post("/v1/examples?parts=none", ANIMAL).await.json();
    let again = bench.post("/v1/examples", ANIMAL).await;
    assert_eq!((again.status, again.json()), (StatusCode::OK, whole));
    let other = &format!("{ANIMAL}\nslow 1");
    let both = bench.post("/v1/examples", other).await.json();
    let again = bench.post("/v1/examples?parts=none", other).await;
    assert_eq!((again.status, again.json()), (StatusCode::OK, both));
}

#[tokio::test]
async fn a_query_lists_an_example_once_by_its_best_segment() {
    let bench = Bench::new();
    bench.post("/v1/examples?name=animal", "segment disc 9\npart disc 2\npart disc 1").await;
    bench.post("/v1/examples?name=arm", "segment disc 4").await;
    let entries = async |mesh: &str| -> Vec<(String, u64)> {
        let path = bench.query("top=1", mesh).await;
        bench.ended(&path).await;
        let ranking = bench.get(&format!("{path}/ranking?segment=0")).await.json();
        let all = ranking["entries"].as_array().expect("entries").iter().filter(|e| e["template"].is_null());
        all.map(|e| (e["name"].as_str().expect("a name").into(), e["example_segment"].as_u64().expect("a number")))
            .collect()
    };
    // A scan that falls into parts is compared with parts, too, and one that is whole with what is whole.
    assert_eq!(entries("segment disc 1\nsegment disc 7").await, [("animal".into(), 2), ("arm".into(), 0)]);
    assert_eq!(entries("segment disc 1").await, [("arm".into(), 0), ("animal".into(), 0)]);
}

#[tokio::test]
async fn the_list_is_filtered_and_paged() {
    let bench = Bench::new();
    for n in 0..5 {
        let topology = if n == 3 { "sphere" } else { "disc" };
        let tag = if n % 2 == 0 { "even" } else { "odd" };
        bench.post(&format!("/v1/examples?name={n}&tag={tag}"), &format!("segment {topology} {n}")).await;
    }
    let names = |page: &Value| -> Vec<String> {
        page["items"].as_array().expect("items").iter().map(|e| e["name"].as_str().expect("a name").into()).collect()
    };
    assert_eq!(names(&bench.get("/v1/examples?tag=even").await.json()), ["0", "2", "4"]);
    assert_eq!(names(&bench.get("/v1/examples?topology=sphere").await.json()), ["3"]);
    let mut path = "/v1/examples?limit=2".to_owned();
    let mut seen = Vec::new();
    for _ in 0..3 {
        let page = bench.get(&path).await.json();
        seen.extend(names(&page));
        match page["next"].as_str() {
            Some(next) => path = format!("/v1/examples?limit=2&cursor={next}"),
            None => break,
        }
    }
    assert_eq!(seen, ["0", "1", "2", "3", "4"]);
    assert!(bench.get("/v1/examples?limit=5").await.json().get("next").is_none());
    for wrong in ["limit=0", "limit=501", "limit=x", "topology=klein", "cursor=x", "limit=1&limit=2"] {
        bench.get(&format!("/v1/examples?{wrong}")).await.problem(400, "parameter_invalid");
    }
}

#[tokio::test]
async fn annotations_change_what_is_named_and_nothing_else() {
    let bench = Bench::new();
    let path = format!("/v1/examples/{}", bench.add("a", "segment disc 1").await);
    let kind = [("content-type", "application/json")];
    let answer = bench.request(Method::PATCH, &path, &kind, r#"{"relevance": 5, "tags": ["b", "a", "b"]}"#).await;
    assert_eq!(answer.status, StatusCode::OK);
    assert_eq!((&answer.json()["name"], &answer.json()["relevance"]), (&json!("a"), &json!(5.0)));
    assert_eq!(bench.get(&path).await.json()["tags"], json!(["a", "b"]));
    for wrong in [r#"{"relevance": 5.5}"#, r#"{"tags": [" "]}"#, r#"{"name": 7}"#, r#"{"nam": ""}"#, "{", ""] {
        let status = bench.request(Method::PATCH, &path, &kind, wrong).await.status;
        assert_eq!(status, StatusCode::BAD_REQUEST, "{wrong}");
    }
    let kind = [("content-type", "text/csv")];
    bench.request(Method::PATCH, &path, &kind, "{}").await.problem(415, "format_unknown");
}

#[tokio::test]
async fn what_somebody_else_changed_is_not_overwritten_unnoticed() {
    let bench = Bench::new();
    let path = format!("/v1/examples/{}", bench.add("a", "segment disc 1").await);
    assert_eq!(bench.get(&path).await.json()["revision"], json!(1));
    let kind = [("content-type", "application/json")];
    let change = |name: &str| format!(r#"{{"name": "{name}", "revision": 1}}"#);
    let mine = bench.request(Method::PATCH, &path, &kind, change("mine")).await;
    assert_eq!((mine.status, &mine.json()["revision"]), (StatusCode::OK, &json!(2)));
    let yours = bench.request(Method::PATCH, &path, &kind, change("yours")).await;
    assert!(yours.json()["detail"].as_str().is_some_and(|detail| detail.contains('2')), "{}", yours.json());
    yours.problem(409, "conflict");
    assert_eq!(bench.get(&path).await.json()["name"], "mine");
}

#[tokio::test]
async fn an_example_keeps_its_author_its_licence_notes_and_named_landmarks() {
    let bench = Bench::new();
    let path = format!("/v1/examples/{}", bench.add("a", "segment disc 1").await);
    let before = bench.get(&path).await.json();
    assert_eq!([&before["author"], &before["licence"], &before["notes"]], [""; 3]);
    assert_eq!(before["landmarks"], json!([]));
    let patch = async |body: &Value| {
        let kind = [("content-type", "application/json")];
        bench.request(Method::PATCH, &path, &kind, body.to_string()).await
    };
    let said = json!({"author": "Ada", "licence": "CC0-1.0", "notes": "neutral\nmouth open", "landmarks": [
        {"name": "corner", "vertex": 2}, {"name": "middle", "point": [0.5, 0.25, 9]}
    ]});
    let answer = patch(&said).await;
    assert_eq!(answer.status, StatusCode::OK, "{}", answer.text());
    let now = answer.json();
    assert_eq!([&now["author"], &now["licence"], &now["notes"]], ["Ada", "CC0-1.0", "neutral\nmouth open"]);
    // A vertex tells its point, and a point is moved to the surface.
    let placed = json!([
        {"name": "corner", "vertex": 2, "point": [1.0, 1.0, 0.0]}, {"name": "middle", "point": [0.5, 0.25, 0.0]}
    ]);
    assert_eq!(now["landmarks"], placed);
    // What was answered may be sent again; what is not named stays.
    let mut expected = now.clone();
    expected["revision"] = json!(3);
    assert_eq!(patch(&json!({"landmarks": placed})).await.json(), expected);
    assert_eq!(patch(&json!({"name": "b"})).await.json()["landmarks"], placed);
    assert_eq!(bench.get(&path).await.json()["author"], "Ada");
    for wrong in [
        json!({"landmarks": [{"name": "a"}]}),
        json!({"landmarks": [{"name": " ", "vertex": 0}]}),
        json!({"landmarks": [{"name": "a\u{202e}", "vertex": 0}]}),
        json!({"landmarks": [{"name": "a", "vertex": 4}]}),
        json!({"landmarks": [{"name": "a", "vertex": 0}, {"name": "a", "vertex": 1}]}),
        json!({"landmarks": [{"name": "a".repeat(65), "vertex": 0}]}),
        json!({"landmarks": (0..129).map(|k| json!({"name": k.to_string(), "vertex": 0})).collect::<Vec<_>>()}),
        json!({"author": "a".repeat(257)}),
        json!({"licence": "a\nb"}),
        json!({"notes": "a".repeat(4097)}),
        json!({"notes": "\u{1b}[2J"}),
    ] {
        patch(&wrong).await.problem(400, "parameter_invalid");
    }
    assert_eq!(patch(&json!({"landmarks": []})).await.json()["landmarks"], json!([]));
}

#[tokio::test]
async fn what_is_removed_is_gone() {
    let bench = Bench::new();
    let path = format!("/v1/examples/{}", bench.add("a", "segment disc 1").await);
    let removed = bench.request(Method::DELETE, &path, &[], Body::empty()).await;
    assert_eq!((removed.status, removed.bytes.len()), (StatusCode::NO_CONTENT, 0));
    bench.get(&path).await.problem(404, "not_found");
    bench.request(Method::DELETE, &path, &[], Body::empty()).await.problem(404, "not_found");
    bench.get("/v1/examples/no-id").await.problem(404, "not_found");
}

#[tokio::test]
async fn the_mesh_comes_back_as_uploaded_or_in_another_format() {
    let bench = Bench::new();
    let path = format!("/v1/examples/{}/mesh", bench.add("a", "segment disc 1").await);
    let same = bench.get(&path).await;
    assert_eq!((same.text().as_str(), same.header("content-type")), ("segment disc 1", "model/obj"));
    let other = bench.get(&format!("{path}?format=ply")).await;
    assert_eq!((other.text().as_str(), other.header("content-type")), ("ply with 1 faces", "model/ply"));
    let accepted = bench.request(Method::GET, &path, &[("accept", "model/stl")], Body::empty()).await;
    assert_eq!(accepted.text(), "stl with 1 faces");
    let tag = other.header("etag").to_owned();
    let known =
        bench.request(Method::GET, &format!("{path}?format=ply"), &[("if-none-match", &tag)], Body::empty()).await;
    assert_eq!((known.status, known.bytes.len()), (StatusCode::NOT_MODIFIED, 0));
    let labelled = bench.get(&format!("{path}?format=ply&labels=true")).await;
    assert_eq!(labelled.status, StatusCode::OK);
    assert_ne!(labelled.header("etag"), tag, "it is another file");
    bench.get(&format!("{path}?format=obj&labels=true")).await.problem(400, "parameter_invalid");
    bench.get(&format!("{path}?format=ply&labels=yes")).await.problem(400, "parameter_invalid");
    bench.get(&format!("{path}?format=xyz")).await.problem(415, "format_unknown");
    bench.request(Method::GET, &path, &[("accept", "image/png")], Body::empty()).await.problem(406, "not_acceptable");
}

#[tokio::test]
async fn pictures_are_png_and_their_sizes_are_limited() {
    let bench = Bench::new();
    let path = format!("/v1/examples/{}", bench.add("a", "segment disc 1").await);
    for picture in ["thumbnail.png?size=32", "segments/0/encoding.png?level=64"] {
        let answer = bench.get(&format!("{path}/{picture}")).await;
        assert_eq!((answer.status, answer.header("content-type")), (StatusCode::OK, "image/png"));
        assert!(answer.bytes.starts_with(b"\x89PNG"));
    }
    for wrong in ["thumbnail.png?size=4", "thumbnail.png?size=1e9", "segments/0/encoding.png?level=48"] {
        bench.get(&format!("{path}/{wrong}")).await.problem(400, "parameter_invalid");
    }
    bench.get(&format!("{path}/segments/1/encoding.png")).await.problem(404, "not_found");
    let whole = bench.get(&format!("{path}/thumbnail.png?segment=0")).await;
    assert_eq!((whole.status, whole.header("content-type")), (StatusCode::OK, "image/png"));
    bench.get(&format!("{path}/thumbnail.png?segment=1")).await.problem(404, "not_found");
    bench.get(&format!("{path}/thumbnail.png?segment=x")).await.problem(400, "parameter_invalid");
    bench.get(&format!("{path}/segments/x/encoding.png")).await.problem(404, "not_found");
}

#[tokio::test]
async fn each_refusal_of_a_mesh_has_its_status_and_code() {
    let bench = Bench::new();
    for (mesh, status, code) in [
        ("gibberish", 422, "mesh_unreadable"),
        ("", 422, "mesh_empty"),
        ("refuse mesh_not_manifold", 422, "mesh_not_manifold"),
        ("refuse topology_unsupported", 422, "topology_unsupported"),
        ("refuse mesh_not_encodable", 422, "mesh_not_encodable"),
        ("refuse mesh_too_large", 413, "mesh_too_large"),
        ("refuse format_unknown", 415, "format_unknown"),
        ("panic read", 500, "internal"),
        ("segment disc 1\npanic encode", 500, "internal"),
    ] {
        for path in ["/v1/examples", "/v1/queries"] {
            if path == "/v1/examples" || !mesh.contains("encode") {
                bench.post(path, mesh).await.problem(status, code);
            }
        }
    }
    let detail = bench.post("/v1/examples", "segment disc 1\nsegment disc x").await.problem(422, "mesh_unreadable");
    assert!(detail.contains("line 2"), "{detail}");
    assert_eq!(bench.get("/v1/examples").await.json()["items"], json!([]));
}

#[tokio::test]
async fn wrong_annotations_are_refused_before_the_mesh_is_read() {
    let bench = Bench::new();
    let long = "x".repeat(300);
    for wrong in ["relevance=6", "relevance=NaN", "relevance=x", "tag=", &format!("name={long}"), "segments=half"] {
        bench.post(&format!("/v1/examples?{wrong}"), "panic read").await.problem(400, "parameter_invalid");
    }
}

#[tokio::test]
async fn a_full_disk_refuses_writes_and_reads_go_on() {
    let bench = Bench::stocked().await;
    bench.corpus.full.store(true, Ordering::Relaxed);
    bench.post("/v1/examples", "segment disc 9").await.problem(507, "storage_full");
    assert_eq!(bench.get("/v1/examples").await.json()["items"].as_array().map(Vec::len), Some(4));
    assert_eq!(bench.get("/readyz").await.json()["writable"], json!(false));
    bench.corpus.full.store(false, Ordering::Relaxed);
    assert_eq!(bench.post("/v1/examples", "segment disc 9").await.status, StatusCode::CREATED);
}

#[tokio::test]
async fn a_mesh_beyond_the_memory_is_too_large_and_a_full_house_is_overloaded() {
    let bench = Bench::with(Admission::new(2000, 32));
    bench.post("/v1/examples", &format!("segment disc 1{}", "\n".repeat(3000))).await.problem(413, "mesh_too_large");
    let bench = Bench::with(Admission::new(1 << 20, 0));
    let answer = bench.post("/v1/examples", "segment disc 1").await;
    answer.problem(503, "overloaded");
    assert!(answer.header("retry-after").parse::<u64>().expect("seconds") >= 1);
}
