//! `query`, `ranking`, `map`, `compose`, `retopo`.

use crate::{
    fake::{Asked, Fake, Reply},
    messages::{example, example_id, map, map_id, query, query_id, ranking},
    run,
};
use quadmuse_proto::{
    Begin, Code, Composition, CompositionId, CompositionPart, End, EndState, Event, Making, MakingState, Map, Page,
    Problem, Product, Query, QueryId, QueryState, Retopo, RetopoId, RetopoResult, Verdict,
};
use std::sync::atomic::{AtomicU32, Ordering};

/// Says what a service makes of its query.
#[derive(Clone)]
pub(crate) struct Makes {
    pub(crate) map: Map,
    pub(crate) composition: Composition,
    pub(crate) retopo: Retopo,
}

impl Makes {
    /// A good map, and a composition of it, to which a retopology comes.
    pub(crate) fn new() -> Self {
        Self::of(map(), composition())
    }

    pub(crate) fn of(map: Map, composition: Composition) -> Self {
        let retopo = Retopo {
            id: RetopoId::from_bytes([70; 16]),
            query: query_id(),
            state: MakingState::Done,
            progress: 1.0,
            result_query: query_id(),
            result: RetopoResult::Composition(composition.id),
            verdict: composition.verdict,
            inspired: composition.inspired,
            reasons: composition.reasons.clone(),
            covers: composition.covers,
            notes: Vec::new(),
            total_ms: 1.0,
        };
        Self { map, composition, retopo }
    }

    /// The same, where a retopology comes to the map as it is.
    pub(crate) fn mapped(self) -> Self {
        let result = RetopoResult::Map(self.map.id);
        Self { retopo: Retopo { result, ..self.retopo }, ..self }
    }
}

/// A service whose ranking is refined with every poll, until it is done at revision 3.
pub(crate) fn service(asked: &Asked, segments: u32) -> Reply {
    service_making(asked, segments, &Makes::new())
}

/// The same, and what it makes.
pub(crate) fn service_making(asked: &Asked, segments: u32, makes: &Makes) -> Reply {
    let path = asked.line.split(['?', ' ']).nth(1).unwrap_or_default();
    let parameter = |name: &str| {
        let (_, rest) = asked.line.split_once(&format!("{name}="))?;
        rest.split('&').next()?.parse::<u32>().ok()
    };
    let rest = path.trim_start_matches("/v1/queries").replace(&query_id().to_string(), "Q");
    match (asked.line.split(' ').next().unwrap_or_default(), rest.as_str()) {
        ("POST", "") => Reply::json(202, &query(QueryState::Queued, segments)),
        ("GET", "/Q") => Reply::json(200, &query(QueryState::Done, segments)),
        ("GET", "/Q/ranking") => {
            let revision = parameter("after").map_or(3, |after| (after + 1).min(3));
            let state = if revision == 3 { QueryState::Done } else { QueryState::Ranking };
            let segment = parameter("segment").unwrap_or_default();
            Reply::json(200, &ranking(segment, revision.into(), 16 << revision, state))
        }
        ("DELETE", "/Q") => Reply { status: 204, headers: Vec::new(), body: Vec::new() },
        ("POST", "/Q/maps") => Reply::json(201, &makes.map),
        ("GET", "/Q/maps") => Reply::json(200, &Page { items: vec![makes.map.clone()], next: None }),
        ("PATCH", rest) if rest.ends_with("/constraints") => Reply::json(200, &map()),
        ("POST", "/Q/compositions") => Reply::json(201, &makes.composition),
        ("POST", "/Q/retopos") => Reply::json(201, &makes.retopo),
        ("GET", rest) if rest.ends_with("/mesh") => Reply::bytes("model/obj", "v 0 0 0\n"),
        ("GET", rest) if rest.ends_with("/preview.png") => Reply::bytes("image/png", rest),
        ("GET", rest) if rest == format!("/Q/maps/{}", makes.map.id) => Reply::json(200, &makes.map),
        ("GET", rest) if rest == format!("/Q/compositions/{}", makes.composition.id) => {
            Reply::json(200, &makes.composition)
        }
        ("GET", rest) if rest == format!("/v1/examples/{}", makes.map.example) => Reply::json(200, &example(1)),
        _ => Reply::problem(Code::NotFound, 404, &asked.line),
    }
}

pub(crate) fn composition() -> Composition {
    Composition {
        id: CompositionId::from_bytes([60; 16]),
        query: query_id(),
        state: MakingState::Done,
        progress: 1.0,
        verdict: Verdict::Good,
        inspired: 0.8,
        reasons: vec![],
        covers: quadmuse_proto::Covers::default(),
        parts: vec![CompositionPart { segment: 0, map: map_id() }],
        templates: vec![],
        smoothing: 5,
        density: 0,
        vertices: 9,
        quads: 4,
        triangles: 0,
        extraordinary_vertices: 1,
        extraordinary_before: 1,
        notes: vec![],
        total_ms: 1.0,
    }
}

pub(crate) fn mesh_file() -> tempfile::NamedTempFile {
    let file = tempfile::Builder::new().suffix(".ply").tempfile().expect("a file");
    std::fs::write(file.path(), "ply").expect("writes");
    file
}

#[tokio::test]
async fn query_prints_a_line_a_level_then_the_ranking_and_the_id_last() {
    let server = Fake::start(|asked| service(asked, 1));
    let mesh = mesh_file();
    let flags = "--top 8 --tag head --resolution 256 --deadline 1.5 --segments whole";
    let ran = run(&server.url, &format!("query {} {flags}", mesh.path().display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    for level in ["level 32 of 128", "level 64 of 128", "level 128 of 128"] {
        let line = format!("segment 0 · {level} · best: example 1, score 0.1000 ({})", example_id(1));
        assert_eq!(ran.out.lines().filter(|found| *found == line).count(), 1, "{level} in {}", ran.out);
    }
    assert_eq!(ran.out.matches("example 3").count(), 1, "one table: {}", ran.out);
    assert_eq!(ran.out.lines().last(), Some(query_id().to_string().as_str()));
    let first = server.lines().remove(0);
    assert_eq!(first, "POST /v1/queries?tag=head&top=8&resolution=256&deadline_ms=1500&segments=whole");
}

#[tokio::test]
async fn query_prints_events_for_programs_of_every_segment() {
    let server = Fake::start(|asked| service(asked, 3));
    let mesh = mesh_file();
    let ran = run(&server.url, &format!("--json query {}", mesh.path().display())).await;
    let lines = ran.json_lines();
    let names: Vec<&str> = lines.iter().filter_map(|line| line["event"].as_str()).collect();
    assert_eq!(names.len(), lines.len());
    assert_eq!((names[0], names[names.len() - 1]), ("begin", "end"));
    assert_eq!(names.iter().filter(|name| **name == "level").count(), 9);
    assert_eq!(lines[0]["query"], query_id().to_string());
    assert_eq!(lines[lines.len() - 1]["state"], "done");
}

#[tokio::test]
async fn query_need_not_be_followed() {
    let server = Fake::start(|asked| service(asked, 1));
    let mesh = mesh_file();
    let ran = run(&server.url, &format!("query {} --no-follow", mesh.path().display())).await;
    assert_eq!(ran.out, format!("{}\n", query_id()));
    assert_eq!(server.asked().len(), 1);
}

#[tokio::test]
async fn a_query_that_fails_is_a_failure_with_its_reason() {
    let server = Fake::start(|asked| {
        let mut failed = query(QueryState::Failed, 1);
        failed.problem = Some(Problem::new(Code::MeshNotEncodable, 422, "expected an area, found none"));
        if asked.line.contains("ranking") {
            let mut early = ranking(0, 0, 0, QueryState::Failed);
            early.entries.clear();
            return Reply::json(200, &early);
        }
        Reply::json(200, &failed)
    });
    let mesh = mesh_file();
    let ran = run(&server.url, &format!("query {}", mesh.path().display())).await;
    assert_eq!(ran.code(), 1);
    assert!(ran.notes.contains("expected an area, found none"), "{}", ran.notes);
}

fn events() -> Vec<Event> {
    let begin = Begin { query: query_id(), segments: 1, resolution: 128, corpus_size: 3 };
    let summary = query(QueryState::Done, 1);
    let end = End { query: query_id(), state: EndState::Done, revision: 2, summary };
    vec![
        Event::Begin(begin),
        Event::Level(ranking(0, 1, 32, QueryState::Ranking)),
        Event::Level(ranking(0, 2, 64, QueryState::Ranking)),
        Event::End(Box::new(end)),
    ]
}

#[tokio::test]
async fn a_ranking_is_followed_by_its_stream_across_a_broken_connection() {
    for content_type in ["application/x-ndjson", "text/event-stream"] {
        let server = Fake::start(move |asked| {
            if !asked.line.ends_with("/stream") {
                return service(asked, 1);
            }
            // The first connection ends after the first level; the second goes on behind it.
            let events = events();
            let part = if asked.header("last-event-id") == Some("1") { &events[2..] } else { &events[..2] };
            let text: String = part
                .iter()
                .map(|event| serde_json::to_string(event).expect("prints"))
                .map(|json| {
                    if content_type == "text/event-stream" { format!("data: {json}\n\n") } else { format!("{json}\n") }
                })
                .collect();
            Reply::bytes(content_type, text)
        });
        let ran = run(&server.url, &format!("--json ranking {} --follow", query_id())).await;
        assert_eq!(ran.code(), 0, "{}", ran.notes);
        let names: Vec<_> = ran.json_lines().iter().map(|line| line["event"].as_str().map(str::to_owned)).collect();
        assert_eq!(names, ["begin", "level", "level", "end"].map(|name| Some(name.to_owned())), "{content_type}");
    }
}

#[tokio::test]
async fn a_stream_that_never_ends_well_is_given_up() {
    let server = Fake::start(|asked| {
        if asked.line.ends_with("/stream") { Reply::bytes("application/x-ndjson", "") } else { service(asked, 1) }
    });
    let ran = run(&server.url, &format!("ranking {} --follow", query_id())).await;
    assert_eq!(ran.code(), 1);
    assert!(ran.notes.contains("the end of the stream"), "{}", ran.notes);
}

#[tokio::test]
async fn map_lays_the_best_entry_and_writes_the_format_of_the_extension() {
    let server = Fake::start(|asked| service(asked, 1));
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.ply");
    let ran = run(&server.url, &format!("map {} -o {}", query_id(), out.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let lines: Vec<&str> = ran.out.lines().collect();
    assert!(lines[0].starts_with("verdict    good (100 % of it an example's; "), "{}", ran.out);
    assert_eq!(lines[1], "           – little distortion");
    assert_eq!(std::fs::read(&out).expect("reads"), b"v 0 0 0\n");
    let asked = server.asked();
    let posted = asked.iter().find(|asked| asked.line.starts_with("POST")).expect("a map was asked for");
    let body: serde_json::Value = serde_json::from_slice(&posted.body).expect("JSON");
    let expected = serde_json::json!({"segment": 0, "example": example_id(1).to_string(), "example_segment": 0, "beyond": "leave"});
    assert_eq!(body, expected);
    assert!(asked.last().expect("a request").line.ends_with(&format!("/maps/{}/mesh?format=ply", map_id())));
}

#[tokio::test]
async fn a_result_is_written_with_as_many_quads_as_are_asked_for_and_the_client_tells_how_many_there_are() {
    let server = Fake::start(|asked| {
        let mut reply = service(asked, 1);
        if asked.line.contains("quads=") || asked.line.contains("tolerance=") {
            reply.headers.extend(["quadmuse-faces: 6000".to_owned(), "quadmuse-within: 0.4".to_owned()]);
        }
        reply
    });
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let requested = async |flags: &str| {
        let ran = run(&server.url, &format!("map {} --force -o {} {flags}", query_id(), out.display())).await;
        assert_eq!(ran.code(), 0, "{}", ran.notes);
        assert!(ran.out.contains("6000 faces"), "{}", ran.out);
        (server.lines().last().expect("a request").clone(), ran.notes)
    };
    let (line, notes) = requested("--quads 6000").await;
    assert!(line.ends_with("/mesh?format=obj&quads=6000") && !notes.contains("6000"), "{line} {notes}");
    let (_, notes) = requested("--quads 500").await;
    assert!(notes.contains("6000 quads is as near to 500 as the layout's rows allow"), "{notes}");
    let (line, notes) = requested("--tolerance 0.1%").await;
    assert!(line.ends_with("/mesh?format=obj&tolerance=0.1"), "{line}");
    assert!(notes.contains("no nearer than 0.400 %"), "{notes}");
}

#[tokio::test]
async fn less_than_is_required_is_written_and_exits_with_1() {
    let mesh = mesh_file();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let (query, file) = (query_id(), out.display().to_string());
    for (line, map_is, composition_is, code, said) in [
        (
            format!("map {query} --require good --force -o {file}"),
            Verdict::Fair,
            Verdict::Good,
            1,
            "that is good (--require)",
        ),
        (format!("map {query} --require fair --force -o {file}"), Verdict::Fair, Verdict::Good, 0, ""),
        (
            format!("map {query} --force -o {file}"),
            Verdict::Broken,
            Verdict::Good,
            1,
            "a broken one: little distortion",
        ),
        (
            format!("compose {query} --require inspired --force -o {file}"),
            Verdict::Good,
            Verdict::Poor,
            1,
            "20 % of it",
        ),
        (format!("compose {query} --require inspired --force -o {file}"), Verdict::Good, Verdict::Good, 0, ""),
        (format!("compose {query} --force -o {file}"), Verdict::Good, Verdict::Broken, 1, "a broken one: edges cross"),
        (
            format!("retopo {} --force -o {file}", mesh.path().display()),
            Verdict::Good,
            Verdict::Broken,
            1,
            "a broken one",
        ),
    ] {
        let server = Fake::start(move |asked| {
            let inspired = if composition_is == Verdict::Poor { 0.2 } else { 0.8 };
            let reasons = vec!["edges cross".to_owned()];
            let composition = Composition { verdict: composition_is, inspired, reasons, ..composition() };
            service_making(asked, 1, &Makes::of(Map { verdict: map_is, ..map() }, composition))
        });
        let _ = std::fs::remove_file(&out);
        let ran = run(&server.url, &format!("--json {line}")).await;
        assert_eq!(ran.code(), code, "{line}: {}", ran.notes);
        assert!(out.exists(), "{line}: it is written all the same");
        assert!(ran.notes.contains(said) && (code == 0 || ran.notes.contains("all the same")), "{line}: {}", ran.notes);
        let lines = ran.json_lines();
        let answer = lines.last().expect("the result");
        assert!(
            answer["verdict"].is_string() && answer["inspired"].is_f64() && answer["reasons"].is_array(),
            "{answer}"
        );
    }
}

#[tokio::test]
async fn map_takes_the_example_that_is_told() {
    let server = Fake::start(|asked| service(asked, 1));
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let ran = run(&server.url, &format!("--json map {} {} -o {}", query_id(), example_id(2), out.display())).await;
    assert_eq!(ran.json_lines()[0]["verdict"], "good");
    assert_eq!(ran.json_lines()[0]["file"], out.display().to_string());
    let posted = server.asked().into_iter().find(|asked| asked.line.starts_with("POST")).expect("a map was asked for");
    assert!(String::from_utf8(posted.body).expect("text").contains(&example_id(2).to_string()));
}

#[tokio::test]
async fn a_segment_that_is_not_there_is_refused_before_anything_is_mapped() {
    let server = Fake::start(|asked| service(asked, 2));
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let ran = run(&server.url, &format!("map {} --segment 2 -o {}", query_id(), out.display())).await;
    assert_eq!(ran.code(), 1);
    assert!(ran.notes.contains("expected a segment below 2, found 2"), "{}", ran.notes);
    assert!(server.lines().iter().all(|line| !line.starts_with("POST")));
    assert!(!out.exists());
}

#[tokio::test]
async fn constraints_are_put_back_and_make_room() {
    let server = Fake::start(|asked| service(asked, 1));
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let flags = "--set f1:=1,2,3 --remove f2 --undo f3 --on-fold resolve";
    let ran = run(&server.url, &format!("constrain {} {} {flags} -o {}", query_id(), map_id(), out.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let edit = server.asked().into_iter().find(|asked| asked.line.starts_with("PATCH")).expect("an edit was asked for");
    let body: serde_json::Value = serde_json::from_slice(&edit.body).expect("JSON");
    assert_eq!(body["remove"], serde_json::json!(["f2"]));
    assert_eq!(body["undo"], serde_json::json!(["f3"]));
    assert_eq!(body["on_fold"], "resolve");
    assert_eq!(body["set"][0]["id"], "f1");
}

#[tokio::test]
async fn what_becomes_of_components_goes_with_every_upload() {
    let server = Fake::start(|asked| service(asked, 1));
    let mesh = mesh_file();
    let ran = run(&server.url, &format!("query {} --no-follow --components refuse", mesh.path().display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert_eq!(server.lines().remove(0), "POST /v1/queries?components=refuse");
}

#[tokio::test]
async fn a_folder_that_is_missing_is_noticed_before_anything_is_asked() {
    let server = Fake::start(|asked| service(asked, 1));
    let mesh = mesh_file();
    let ran = run(&server.url, &format!("retopo {} -o /no/such/folder/out.obj", mesh.path().display())).await;
    assert_eq!(ran.code(), 1);
    assert!(ran.notes.contains("/no/such/folder/out.obj"), "{}", ran.notes);
    assert_eq!(server.asked().len(), 0);
}

#[tokio::test]
async fn retopo_maps_one_segment_and_stitches_several() {
    let mesh = mesh_file();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    // A single map that was chosen by hand is written as it is.
    for (segments, compositions) in [(1, 0), (3, 1)] {
        let server = Fake::start(move |asked| service(asked, segments));
        let line = format!("retopo {} --force -o {} --use 0={}", mesh.path().display(), out.display(), example_id(3));
        let ran = run(&server.url, &line).await;
        assert_eq!(ran.code(), 0, "{}", ran.notes);
        let last = ran.out.lines().last().expect("a line");
        assert!(last.starts_with("written") && last.contains(&out.display().to_string()), "{last}");
        assert!(last.ends_with(if segments == 1 { "good, 4 faces" } else { "4 quads, parts: 1 good" }), "{last}");
        assert!(!ran.out.contains("level"), "nothing of the ranking: {}", ran.out);
        assert_eq!(ran.notes.contains("(1 of 1, disc): example 1"), segments > 1, "{}", ran.notes);
        let lines = server.lines();
        let count = |end: &str| lines.iter().filter(|line| line.starts_with("POST") && line.contains(end)).count();
        assert_eq!((count("/maps?"), count("/compositions?"), count("/retopos")), (1, compositions, 0));
    }
}

#[tokio::test]
async fn a_map_that_takes_longer_than_an_answer_may_is_waited_for() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let making = |state: MakingState| Making {
        id: map_id().to_string(),
        product: Product::Map,
        query: query_id(),
        state,
        progress: 0.4,
        stage: "laying the example on the scan".into(),
        created: "2025-01-01T00:00:00Z".into(),
        problem: None,
    };
    for (end, code) in [(MakingState::Done, 0), (MakingState::Failed, 1), (MakingState::Cancelled, 1)] {
        let polls = AtomicU32::new(0);
        let server = Fake::start(move |asked| match asked.line.split(' ').next() {
            Some("POST") if asked.line.contains("/maps?wait=") => Reply::json(202, &making(MakingState::Queued)),
            Some("GET") if asked.line.contains(&format!("/maps/{}?wait=", map_id())) => {
                let polled = polls.fetch_add(1, Ordering::SeqCst);
                match (polled, end) {
                    (0, _) => Reply::json(200, &making(MakingState::Running)),
                    (_, MakingState::Done) => Reply::json(200, &map()),
                    (_, MakingState::Failed) => {
                        let problem = Problem::new(Code::Deadline, 504, "expected no mistake");
                        Reply::json(200, &Making { problem: Some(problem), ..making(MakingState::Failed) })
                    }
                    (_, other) => Reply::json(200, &making(other)),
                }
            }
            _ => service(asked, 1),
        });
        let ran = run(&server.url, &format!("map {} --force -o {}", query_id(), out.display())).await;
        assert_eq!(ran.code(), code, "{end:?}: {}", ran.notes);
        assert_eq!(ran.notes.contains("expected no mistake"), end == MakingState::Failed, "{}", ran.notes);
        assert_eq!(ran.notes.contains("was cancelled"), end == MakingState::Cancelled, "{}", ran.notes);
    }
}

#[tokio::test]
async fn retopo_writes_what_the_service_came_to_and_tells_what_it_tried() {
    let mesh = mesh_file();
    let folder = tempfile::tempdir().expect("a folder");
    let (out, kept) = (folder.path().join("out.obj"), folder.path().join("kept.txt"));
    let notes = vec!["cutting the mesh into parts".to_owned()];
    for (is_map, ending) in [(false, "4 quads, parts: 1 good"), (true, "good, 4 faces")] {
        let makes = if is_map { Makes::new().mapped() } else { Makes::new() };
        let makes = Makes { retopo: Retopo { notes: notes.clone(), ..makes.retopo }, ..makes };
        let server = Fake::start(move |asked| service_making(asked, 1, &makes));
        let flags = format!("--beyond leave --smoothing 7 --kept {}", kept.display());
        let line = format!("retopo {} --force -o {} {flags}", mesh.path().display(), out.display());
        let ran = run(&server.url, &line).await;
        assert_eq!(ran.code(), 0, "{}", ran.notes);
        let last = ran.out.lines().last().expect("a line");
        assert!(last.ends_with(ending), "{last}");
        assert!(ran.notes.contains("cutting the mesh into parts"), "{}", ran.notes);
        assert_eq!(std::fs::read_to_string(&kept).expect("a file").lines().count(), 9);
        let posted: Vec<Asked> = server.asked().into_iter().filter(|asked| asked.line.starts_with("POST")).collect();
        assert_eq!(posted.len(), 2, "the scan, and the wish");
        let wanted: serde_json::Value = serde_json::from_slice(&posted[1].body).expect("JSON");
        assert_eq!(wanted, serde_json::json!({"beyond": "leave", "smoothing": 7, "density": null}));
    }
}

#[tokio::test]
async fn the_query_of_a_result_whose_scan_was_cut_anew_is_remembered() {
    let mesh = mesh_file();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let of = QueryId::from_bytes([101; 16]);
    let server = Fake::start(move |asked| {
        let makes = Makes::new();
        let composition = Composition { query: of, ..composition() };
        let makes = Makes { composition, retopo: Retopo { result_query: of, ..makes.retopo }, ..makes };
        let is_of = asked.line.contains(&of.to_string());
        let asked = Asked { line: asked.line.replace(&of.to_string(), &query_id().to_string()), ..asked.clone() };
        match asked.line == format!("GET /v1/queries/{}", query_id()) && is_of {
            true => Reply::json(200, &Query { id: of, ..query(QueryState::Done, 2) }),
            false => service_making(&asked, 1, &makes),
        }
    });
    let ran = run(&server.url, &format!("--json retopo {} -o {}", mesh.path().display(), out.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert_eq!(ran.json_lines().last().expect("a result")["query"], of.to_string());
    let asked = server.lines();
    let mesh = asked.iter().rfind(|line| line.contains("/mesh")).expect("a mesh is asked for");
    assert!(mesh.contains(&of.to_string()), "{mesh}");
}

#[tokio::test]
async fn retopo_writes_a_chosen_example_as_it_lies_however_poorly() {
    let mesh = mesh_file();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let server = Fake::start(move |asked| {
        service_making(asked, 1, &Makes::of(Map { verdict: Verdict::Poor, ..map() }, composition()))
    });
    let line = format!("retopo {} --force -o {} --use 0={}", mesh.path().display(), out.display(), example_id(3));
    let ran = run(&server.url, &line).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let last = ran.out.lines().last().expect("a line");
    assert!(last.ends_with("poor, 4 faces"), "{last}");
}

#[tokio::test]
async fn retopo_like_an_example_lays_it_on_every_segment_and_tells_the_quads_before() {
    let mesh = mesh_file();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let server = Fake::start(|asked| service(asked, 3));
    let flags = format!("--like {} --use 1={}:7 --density 1", example_id(3), example_id(2));
    let ran = run(&server.url, &format!("retopo {} -o {} {flags}", mesh.path().display(), out.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert!(ran.notes.contains("density 1: about"), "{}", ran.notes);
    let posted: Vec<Asked> = server.asked().into_iter().filter(|asked| asked.line.starts_with("POST")).collect();
    assert_eq!(posted[0].line, format!("POST /v1/queries?like={}", example_id(3)));
    let wanted = |k: usize| serde_json::from_slice::<serde_json::Value>(&posted[k].body).expect("JSON");
    let map = |segment: u32, example: u8, of: u32| serde_json::json!({"segment": segment, "example": example_id(example).to_string(), "example_segment": of, "beyond": "extend"});
    // Two segments are mapped at a time, in any order.
    let mut mapped = [wanted(1), wanted(2), wanted(3)];
    mapped.sort_by_key(|body| body["segment"].as_u64());
    assert_eq!(mapped, [map(0, 3, 0), map(1, 2, 7), map(2, 3, 2)]);
    assert_eq!(wanted(4)["density"], 1);
    let kept = wanted(4)["keep"].clone();
    assert!(kept.as_array().is_some_and(|of| of.contains(&1.into())), "{kept}");
}
