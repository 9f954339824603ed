//! add → list → query → ranking → map → restart → still there.

use crate::{Place, listed, run, text, values};
use quadmuse_tests::{
    http,
    shapes::{self, Faces},
};
use std::path::Path;

/// The corners of the faces of an OBJ, in their order.
fn faces(obj: &str) -> Vec<Vec<u32>> {
    let corner = |word: &str| word.split('/').next().and_then(|number| number.parse().ok()).expect("a vertex");
    obj.lines()
        .filter_map(|line| line.strip_prefix("f "))
        .map(|line| line.split_whitespace().map(corner).collect())
        .collect()
}

#[test]
fn a_mesh_is_found_again_on_a_scan_of_itself_and_laid_on_it() {
    let place = Place::new();
    let (server, client) = place.serve();
    let heads = place.heads(4);
    let vase = place.file("vase.obj", &shapes::vase(1, 24, 10, Faces::Quads));
    let mut files: Vec<&Path> = heads.iter().map(AsRef::as_ref).collect();
    files.push(&vase);
    let added = values(&client, &["add", "--tag", "test", "--relevance", "4"], &files);
    assert_eq!(added.len(), 5);
    let ids: Vec<String> = added.iter().map(|example| text(example, "id").to_owned()).collect();
    assert_eq!(added[4]["segments"][0]["topology"], "annulus");

    // The same bytes are the same example.
    let again = values(&client, &["add", "--tag", "test", "--relevance", "4"], &files);
    assert_eq!(again.iter().map(|example| text(example, "id").to_owned()).collect::<Vec<_>>(), ids);
    assert_eq!(values(&client, &["list", "--topology", "annulus"], &[])[0].as_array().map(Vec::len), Some(1));

    // Other triangles, another size of cells, the surface of the third head.
    let scan = place.file("scan.obj", &shapes::head(2, 27, Faces::Triangles));
    let events = values(&client, &["query", "--resolution", "64"], &[&scan]);
    assert_eq!((text(&events[0], "event"), text(events.last().expect("an end"), "event")), ("begin", "end"));
    let levels: Vec<_> = events.iter().filter(|event| event["event"] == "level").collect();
    assert_eq!(levels.last().expect("a level")["level"], 64);
    let best = &levels.last().expect("a level")["entries"][0];
    assert_eq!(text(best, "example"), ids[2], "{best}");
    assert_eq!(text(best, "name"), "head_2");

    let query = text(&events[0], "query");
    let ranking = values(&client, &["ranking", query], &[]).remove(0);
    assert_eq!(ranking["entries"][0]["example"], ids[2]);
    let out = place.path("out.obj");
    let map = values(&client, &["map", query, "-o"], &[&out]).remove(0);
    assert_eq!((text(&map, "example"), map["folds"].as_u64()), (ids[2].as_str(), Some(0)));
    let (mapped, example) = (std::fs::read_to_string(&out).expect("reads"), shapes::head(2, 16, Faces::Quads));
    assert_eq!(faces(&mapped), faces(&example));
    assert_eq!(mapped.lines().filter(|line| line.starts_with("v ")).count(), 17 * 17);

    // What was uploaded comes back to the byte, also after a restart.
    let mesh = |address| http::get(address, &format!("/v1/examples/{}/mesh", ids[2])).expect("an answer");
    assert_eq!(mesh(server.address()).text(), example);
    drop(server);
    let (server, client) = place.serve();
    // In order of creation, which is not that of the files: they are sent side by side.
    let mut created = ids.clone();
    created.sort();
    assert_eq!(listed(&client), created);
    assert_eq!(mesh(server.address()).text(), example);
    let events = values(&client, &["query", "--resolution", "64"], &[&scan]);
    let after: Vec<_> = events.iter().filter(|event| event["event"] == "level").collect();
    let scores = |level: &serde_json::Value| {
        let entries = level["entries"].as_array().expect("entries").iter();
        entries.map(|entry| (entry["example"].clone(), entry["score"].clone())).collect::<Vec<_>>()
    };
    assert_eq!(
        scores(after.last().expect("a level")),
        scores(levels.last().expect("a level")),
        "a restart changed the ranking"
    );
}

#[test]
fn a_ring_is_laid_on_another_mesh_of_itself() {
    let place = Place::new();
    let (_server, client) = place.serve();
    let rings = [0, 1].map(|kind| place.file(&format!("ring_{kind}.obj"), &shapes::ring(kind, 48, 24, Faces::Quads)));
    let added = values(&client, &["add"], &[&rings[0], &rings[1]]);
    assert_eq!(added[1]["segments"][0]["topology"], "torus");
    let scan = place.file("scan.obj", &shapes::ring(1, 61, 34, Faces::Triangles));
    let events = values(&client, &["query"], &[&scan]);
    let levels: Vec<_> = events.iter().filter(|event| event["event"] == "level").collect();
    let best = &levels.last().expect("a level")["entries"][0];
    assert_eq!(best["example"], added[1]["id"], "{best}");
    let out = place.path("out.obj");
    let map = values(&client, &["map", text(&events[0], "query"), "-o"], &[&out]).remove(0);
    assert_eq!((map["folds"].as_u64(), text(&map, "verdict")), (Some(0), "good"), "{map}");
    let (mapped, example) = (std::fs::read_to_string(&out).expect("reads"), shapes::ring(1, 48, 24, Faces::Quads));
    assert_eq!(faces(&mapped), faces(&example));
    // The same surface: each vertex comes back to where it was.
    let points = |obj: &str| -> Vec<Vec<f64>> {
        let rows = obj.lines().filter_map(|line| line.strip_prefix("v "));
        rows.map(|row| row.split_whitespace().filter_map(|x| x.parse().ok()).collect()).collect()
    };
    let apart = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt();
    let mut errors: Vec<f64> = points(&mapped).iter().zip(&points(&example)).map(apart).collect();
    errors.sort_by(f64::total_cmp);
    // √area is about 9: at most 0.25 % of it.
    assert!(errors[errors.len() / 2] < 0.0225, "median {}", errors[errors.len() / 2]);
}

#[test]
fn retopo_does_all_of_it_in_one_go_in_each_format() {
    let place = Place::new();
    let (_server, client) = place.serve();
    let heads = place.heads(2);
    values(&client, &["add"], &heads.iter().map(AsRef::as_ref).collect::<Vec<_>>());
    let scan = place.file("scan.obj", &shapes::head(1, 20, Faces::Triangles));
    for format in ["obj", "ply", "off", "stl", "glb"] {
        let out = place.path(&format!("out.{format}"));
        let ran = run(&client, &["retopo", "--resolution", "32", scan.to_str().expect("text"), "-o"], &[&out]);
        assert_eq!(ran.code, Some(0), "{format}: {}", ran.notes);
        // The map as it is, or what the service made of it where so few faces miss the input.
        let last = ran.out.lines().last().unwrap_or_default();
        assert!(last.starts_with("written") && last.contains("good"), "{}", ran.out);
        let bytes = std::fs::read(&out).expect("reads");
        let magic: &[u8] = match format {
            "ply" => b"ply",
            "off" => b"OFF",
            "glb" => b"glTF",
            _ => b"",
        };
        assert!(bytes.len() > 1000 && bytes.starts_with(magic), "{format}: {} bytes", bytes.len());
    }
}

#[test]
fn annotations_are_kept_and_examples_removed_for_good() {
    let place = Place::new();
    let (server, client) = place.serve();
    let heads = place.heads(2);
    let added = values(&client, &["add"], &heads.iter().map(AsRef::as_ref).collect::<Vec<_>>());
    let (first, second) = (text(&added[0], "id"), text(&added[1], "id"));
    values(&client, &["rate", first, "4.5"], &[]);
    values(&client, &["tag", first, "+hero", "+film"], &[]);
    values(&client, &["tag", first, "-film"], &[]);
    values(&client, &["remove", second], &[]);
    drop(server);
    let (_server, client) = place.serve();
    assert_eq!(listed(&client), [first]);
    let shown = values(&client, &["show", first], &[]).remove(0);
    assert_eq!((shown["relevance"].as_f64(), shown["tags"].to_string()), (Some(4.5), "[\"hero\"]".to_owned()));
    let gone = run(&client, &["--json", "show", second], &[]);
    assert_eq!((gone.code, text(&gone.last_value(), "code")), (Some(1), "not_found"));
}

#[test]
fn an_empty_corpus_is_told_with_the_way_out() {
    let place = Place::new();
    let (_server, client) = place.serve();
    let scan = place.file("scan.obj", &shapes::head(1, 10, Faces::Triangles));
    let out = place.path("out.obj");
    let ran = run(&client, &["retopo", scan.to_str().expect("text"), "-o"], &[&out]);
    assert_eq!(ran.code, Some(1), "{}", ran.out);
    assert!(ran.notes.contains("add"), "{}", ran.notes);
    assert!(!out.exists());
}
