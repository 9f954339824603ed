//! Names and `@last` where ids are asked for.

use crate::{
    fake::{Asked, Fake, Reply},
    messages::{example, example_id, map, map_id, query, query_id},
    run_with,
};
use quadmuse_proto::{Code, Constraint, ConstraintOrigin, Example, Location, Map, Page, QueryState};

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
