//! Names and `@last` where ids are asked for.

use crate::{
    fake::{Asked, Fake, Reply},
    messages::{example, example_id, map, map_id, query, query_id},
    run_with,
};
use quadmuse_proto::{Code, Constraint, ConstraintOrigin, Example, Location, Map, Page, Query, QueryPatch, QueryState};

/// A corpus of a head, a hand and two feet, and one query with one map.
fn service(asked: &Asked) -> Reply {
    let path = asked.line.split(['?', ' ']).nth(1).unwrap_or_default().to_owned();
    let named = |k: u8, name: &str| Example { id: example_id(k), name: name.into(), ..example(k) };
    let all = [named(1, "head"), named(2, "hand"), named(3, "foot"), named(4, "foot")];
    let one = all.iter().find(|example| path.ends_with(&example.id.to_string()));
    match (asked.line.split(' ').next().unwrap_or_default(), path.as_str(), one) {
        ("GET", "/v1/examples", _) => Reply::json(200, &Page { items: all.to_vec(), next: None }),
        ("GET" | "PATCH", _, Some(example)) => Reply::json(200, example),
        ("POST", "/v1/queries", _) => Reply::json(202, &query(QueryState::Queued, 1)),
        ("GET", "/v1/queries", _) => Reply::json(200, &Page { items: vec![query(QueryState::Done, 1)], next: None }),
        ("GET", path, _) if path.ends_with("/maps") => Reply::json(200, &Page { items: vec![map()], next: None }),
        ("GET", path, _) if path.ends_with(&query_id().to_string()) => Reply::json(200, &query(QueryState::Done, 1)),
        ("PATCH", path, _) if path.ends_with("/constraints") => Reply::json(200, &map()),
        ("GET", path, _) if path.ends_with("/mesh") => Reply::bytes("model/obj", "v 0 0 0\n"),
        _ => Reply::problem(Code::NotFound, 404, &asked.line),
    }
}

#[tokio::test]
async fn an_example_is_found_by_its_name_and_the_beginning_of_it() {
    let (server, state) = (Fake::start(service), tempfile::tempdir().expect("a folder"));
    for (line, k) in [("rate head 4", 1), ("show ha", 2), ("tag hand +x", 2)] {
        let ran = run_with(&server.url, state.path(), line).await;
        assert_eq!(ran.code(), 0, "{line}: {}", ran.notes);
        assert!(server.lines().iter().any(|asked| asked.contains(&example_id(k).to_string())), "{line}");
    }
    let ran = run_with(&server.url, state.path(), "remove head foot").await;
    assert_eq!(ran.code(), 1);
    let both = [3, 4].map(|k| format!("{} (foot)", example_id(k))).join(", ");
    assert!(ran.notes.contains(&format!("found `foot`, which may be {both}")), "{}", ran.notes);
    assert!(!server.lines().iter().any(|asked| asked.starts_with("DELETE")), "nothing is removed");
    let ran = run_with(&server.url, state.path(), "show nose").await;
    assert!(ran.code() == 1 && ran.notes.contains("found `nose`, which none has"), "{}", ran.notes);
}

#[tokio::test]
async fn the_last_query_goes_by_a_name_of_its_own() {
    let (server, state) = (Fake::start(service), tempfile::tempdir().expect("a folder"));
    let mesh = tempfile::Builder::new().suffix(".ply").tempfile().expect("a file");
    let out = state.path().join("out.obj");
    let ran = run_with(&server.url, state.path(), "ranking @last").await;
    assert!(ran.code() == 1 && ran.notes.contains("none is remembered"), "{}", ran.notes);
    let ran = run_with(&server.url, state.path(), &format!("query {} --no-follow", mesh.path().display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let begins = |id: String| id[..12].to_owned();
    let (query, map) = (begins(query_id().to_string()), begins(map_id().to_string()));
    for name in ["@last", &query] {
        let line = format!("constrain {name} {map} --remove f1 --force -o {}", out.display());
        let ran = run_with(&server.url, state.path(), &line).await;
        assert_eq!(ran.code(), 0, "{line}: {}", ran.notes);
        let asked = format!("/v1/queries/{}/maps/{}/constraints", query_id(), map_id());
        assert!(server.lines().iter().any(|line| line.contains(&asked)), "{line}");
    }
}

#[tokio::test]
async fn a_constraint_that_the_map_has_not_is_told_with_those_it_has() {
    let place = || Location { point: [0.0; 3], u: 0.0, v: 0.0 };
    let has = move |id: &str| Constraint {
        id: id.into(),
        origin: ConstraintOrigin::Feature,
        on_example: place(),
        on_input: place(),
    };
    let server = Fake::start(move |asked| match asked.line.starts_with("PATCH") {
        true => Reply::problem(Code::NotFound, 404, "expected a constraint that was set, found `nose`, which is none"),
        false => Reply::json(
            200,
            &Page { items: vec![Map { constraints: vec![has("f0"), has("c1")], ..map() }], next: None },
        ),
    });
    let state = tempfile::tempdir().expect("a folder");
    let out = state.path().join("out.obj");
    let line = format!("constrain {} {} --set nose:1,2,3=4,5,6 -o {}", query_id(), map_id(), out.display());
    let ran = run_with(&server.url, state.path(), &line).await;
    assert_eq!(ran.code(), 1);
    assert!(
        ran.notes.contains("that the map has (f0, c1), found `nose`; leave the id out to add one"),
        "{}",
        ran.notes
    );
    let ran = run_with(&server.url, state.path(), &format!("--json {line}")).await;
    assert_eq!(ran.json_lines()[0]["code"], "not_found");
}

/// A query of three segments, of which some have names.
fn parts(names: [Option<&str>; 3]) -> Query {
    let mut query = query(QueryState::Done, 3);
    query.segments.iter_mut().zip(names).for_each(|(segment, name)| segment.name = name.map(str::to_owned));
    query
}

#[tokio::test]
async fn parts_are_named_and_listed() {
    let server = Fake::start(|asked| match asked.line.split(' ').next() {
        Some("PATCH") => Reply::json(200, &parts([Some("arm"), None, Some("lower leg")])),
        _ => Reply::json(200, &parts([Some("arm"), Some("old"), None])),
    });
    let state = tempfile::tempdir().expect("a folder");
    let ran = run_with(&server.url, state.path(), &format!("name {}", query_id())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert!(ran.out.contains("arm") && ran.out.contains("old") && ran.out.lines().count() == 5, "{}", ran.out);
    assert!(server.lines().iter().all(|line| line.starts_with("GET")), "listing changes nothing");
    // A part goes by the name that it has, too.
    let ran = run_with(&server.url, state.path(), &format!("--json name {} 2=leg old=", query_id())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let patch = server.asked().into_iter().find(|asked| asked.line.starts_with("PATCH")).expect("it is sent");
    assert_eq!(patch.line, format!("PATCH /v1/queries/{}", query_id()));
    let sent: QueryPatch = serde_json::from_slice(&patch.body).expect("a patch");
    let sent: Vec<(u32, &str)> = sent.segments.iter().map(|s| (s.segment, s.name.as_str())).collect();
    assert_eq!(sent, [(2, "leg"), (1, "")]);
    let segments = &ran.json_lines()[0]["segments"];
    assert_eq!((&segments[0]["name"], &segments[1]["name"]), (&serde_json::json!("arm"), &serde_json::json!(null)));
    let ran = run_with(&server.url, state.path(), &format!("name {} nose=x", query_id())).await;
    assert!(ran.code() == 1 && ran.notes.contains("found `nose`, which none has"), "{}", ran.notes);
}

#[tokio::test]
async fn a_part_goes_by_its_name_where_a_segment_is_asked_for() {
    let server = Fake::start(|asked| match asked.line.split(['?', ' ']).nth(1).unwrap_or_default() {
        path if path.ends_with(&query_id().to_string()) => {
            Reply::json(200, &parts([Some("arm"), Some("leg left"), Some("leg right")]))
        }
        _ => crate::queries::service(asked, 3),
    });
    let state = tempfile::tempdir().expect("a folder");
    let out = state.path().join("out.obj");
    let mapped = |server: &Fake| {
        let asked = server.asked().into_iter().rfind(|asked| asked.line.contains("/maps?")).expect("a map");
        serde_json::from_slice::<serde_json::Value>(&asked.body).expect("JSON")["segment"].clone()
    };
    let run = async |line: &str| run_with(&server.url, state.path(), line).await;
    let ran = run(&format!("map {} --segment arm --force -o {}", query_id(), out.display())).await;
    assert_eq!((ran.code(), mapped(&server)), (0, serde_json::json!(0)), "{}", ran.notes);
    let ran = run(&format!("map {} --segment leg --force -o {}", query_id(), out.display())).await;
    assert!(ran.code() == 1 && ran.notes.contains("1 (leg left), 2 (leg right); give its number"), "{}", ran.notes);
    let ran = run(&format!("ranking {} --segment arm", query_id())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert!(server.lines().last().is_some_and(|line| line.contains("segment=0")), "{:?}", server.lines());
    let uses = format!("--use arm={}:4", example_id(3));
    let ran = run(&format!("compose {} {uses} --force -o {}", query_id(), out.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let chosen = server.asked().into_iter().filter(|asked| asked.line.contains("/maps?"));
    let chosen = chosen.filter_map(|asked| serde_json::from_slice::<serde_json::Value>(&asked.body).ok());
    assert!(chosen.into_iter().any(|new| new["example_segment"] == 4 && new["segment"] == 0));
    assert!(ran.notes.contains("segment 0, arm (1 of 1, disc)"), "{}", ran.notes);
    let ran = run(&format!("compose {} --use nose={} --force -o {}", query_id(), example_id(3), out.display())).await;
    assert!(ran.code() == 1 && ran.notes.contains("found `nose`, which none has"), "{}", ran.notes);
}
