//! `add`, `list`, `remove`, `rate`, `tag`, and what is said when things go wrong.

use crate::{
    fake::{Asked, Fake, Reply},
    messages::{example, example_id},
    run, run_answering,
};
use quadmuse_proto::{Code, Example, ExampleSegment, NamedPoint, Page};
use std::{
    path::PathBuf,
    sync::atomic::{AtomicU32, Ordering},
};
use tempfile::TempDir;

#[tokio::test]
async fn annotate_sends_what_is_named_and_keeps_the_other_landmarks() {
    let server = Fake::start(|_| {
        let mut answer = example(1);
        let point = |name: &str, x: f64| NamedPoint { name: name.into(), vertex: None, point: Some([x, 0.0, 0.0]) };
        answer.landmarks = vec![point("chin", 1.0), point("nose", 2.0)];
        Reply::json(200, &answer)
    });
    let id = example_id(1);
    let ran =
        run(&server.url, &format!("annotate {id} --author Ada --license CC0 --landmark nose=v7 --forget chin")).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert!(ran.out.contains("landmarks  chin, nose"), "{}", ran.out);
    let sent = server.asked().into_iter().find(|asked| asked.line.starts_with("PATCH")).expect("a patch");
    let patch: serde_json::Value = serde_json::from_slice(&sent.body).expect("JSON");
    assert_eq!(
        patch,
        serde_json::json!({"author": "Ada", "licence": "CC0", "landmarks": [{"name": "nose", "vertex": 7}]})
    );
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("points.json");
    std::fs::write(&file, r#"{"nose": [1, 2, 3], "brow": 12}"#).expect("writes");
    let ran = run(&server.url, &format!("annotate {id} --landmarks {}", file.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let sent = server.asked().into_iter().rfind(|asked| asked.line.starts_with("PATCH")).expect("a patch");
    let patch: serde_json::Value = serde_json::from_slice(&sent.body).expect("JSON");
    let all = serde_json::json!([{"name": "brow", "vertex": 12}, {"name": "nose", "point": [1.0, 2.0, 3.0]}]);
    assert_eq!(patch["landmarks"], all);
    let ran = run(&server.url, &format!("annotate {id} --forget brow")).await;
    assert!(ran.code() == 1 && ran.notes.contains("(chin, nose), found `brow`"), "{}", ran.notes);
}

fn files(names: &[&str]) -> (TempDir, Vec<PathBuf>) {
    let folder = tempfile::tempdir().expect("a folder");
    let paths = names.iter().map(|name| folder.path().join(name)).collect::<Vec<_>>();
    for path in &paths {
        std::fs::write(path, path.file_name().expect("a name").to_string_lossy().as_bytes()).expect("writes");
    }
    (folder, paths)
}

#[tokio::test]
async fn add_goes_on_past_a_bad_file_names_it_and_exits_with_1() {
    let server = Fake::start(|asked| {
        let bad = "expected a vertex number on line 3, found `x`";
        if asked.line.contains("name=bad") {
            Reply::problem(Code::MeshUnreadable, 422, bad)
        } else {
            Reply::json(201, &example(1))
        }
    });
    let (folder, _) = files(&["a.obj", "bad.ply", "c.stl"]);
    let at = folder.path().display();
    let ran = run(
        &server.url,
        &format!("add {at}/a.obj {at}/bad.ply {at}/c.stl {at}/missing.obj --tag x --tag y --relevance 4"),
    )
    .await;
    assert_eq!(ran.code(), 1);
    assert_eq!(ran.out.matches("added").count(), 2, "{}", ran.out);
    assert!(ran.notes.contains("bad.ply: expected a vertex number on line 3, found `x`"), "{}", ran.notes);
    assert!(ran.notes.contains("missing.obj: expected a file"), "{}", ran.notes);
    assert!(ran.notes.contains("2 of 4 failed"), "{}", ran.notes);
    let asked = server.asked();
    let first = asked.iter().find(|asked| asked.line.contains("name=a")).expect("it was sent");
    assert_eq!(first.line, "POST /v1/examples?name=a&tag=x&tag=y&relevance=4");
    assert_eq!((first.header("content-type"), first.body.as_slice()), (Some("model/obj"), b"a.obj".as_slice()));
}

#[tokio::test]
async fn programs_get_a_line_a_file_in_the_order_of_the_files() {
    let server = Fake::start(|asked| {
        // The first takes longest.
        if asked.line.contains("name=a") {
            std::thread::sleep(std::time::Duration::from_millis(200));
            return Reply::json(200, &example(1));
        }
        Reply::problem(Code::MeshEmpty, 422, "expected a face, found none")
    });
    let (folder, _) = files(&["a.obj", "b.obj"]);
    let at = folder.path().display();
    let ran = run(&server.url, &format!("--json add {at}/a.obj {at}/b.obj")).await;
    let lines = ran.json_lines();
    assert_eq!(lines.len(), 2);
    assert_eq!(lines[0]["id"], example_id(1).to_string());
    assert_eq!((lines[1]["code"].as_str(), lines[1]["status"].as_u64()), (Some("mesh_empty"), Some(422)));
    assert!(lines[1]["file"].as_str().expect("a name").ends_with("b.obj"));
}

#[tokio::test]
async fn an_example_is_kept_whole_alone_where_that_is_asked_and_its_parts_are_told() {
    let server = Fake::start(|asked| {
        let mut added = example(1);
        if !asked.line.contains("parts=none") {
            let part = |segment| ExampleSegment { segment, is_part: true, ..added.segments[0].clone() };
            let parts = [part(1), part(2)];
            added.segments.extend(parts);
        }
        Reply::json(201, &added)
    });
    let (folder, _) = files(&["a.obj"]);
    let at = folder.path().display();
    let both = run(&server.url, &format!("add {at}/a.obj")).await;
    assert!(both.out.contains("(disc and 2 parts of it, "), "{}", both.out);
    let whole = run(&server.url, &format!("add {at}/a.obj --whole-only")).await;
    assert!(whole.out.contains("(disc, "), "{}", whole.out);
    let lines: Vec<String> = server.asked().into_iter().map(|asked| asked.line).collect();
    assert_eq!(lines, ["POST /v1/examples?name=a", "POST /v1/examples?name=a&parts=none"]);
}

#[tokio::test]
async fn labels_of_faces_travel_beside_the_mesh() {
    let server = Fake::start(|_| Reply::json(201, &example(1)));
    let (folder, _) = files(&["a.obj", "labels.txt"]);
    let at = folder.path().display();
    let ran = run(&server.url, &format!("add {at}/a.obj --segments {at}/labels.txt")).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let asked = server.asked().remove(0);
    assert!(asked.header("content-type").expect("a type").starts_with("multipart/form-data; boundary="));
    let body = String::from_utf8(asked.body).expect("text");
    assert!(body.contains("name=\"mesh\"") && body.contains("name=\"segments\""), "{body}");
}

#[tokio::test]
async fn a_list_is_read_page_by_page() {
    let server = Fake::start(|asked| {
        let (n, next) = if asked.line.contains("cursor=more") { (2, None) } else { (1, Some("more".to_owned())) };
        Reply::json(200, &Page { items: vec![example(n)], next })
    });
    let ran = run(&server.url, "list --tag a&b --topology disc --json").await;
    assert_eq!(ran.json_lines()[0].as_array().expect("a list").len(), 2);
    assert_eq!(
        server.lines(),
        [
            "GET /v1/examples?limit=500&tag=a%26b&topology=disc",
            "GET /v1/examples?limit=500&tag=a%26b&topology=disc&cursor=more"
        ]
    );
}

#[tokio::test]
async fn tags_and_relevance_are_patched() {
    let server = Fake::start(|_| Reply::json(200, &example(1)));
    let id = example_id(1);
    assert_eq!(run(&server.url, &format!("tag {id} +hero -wip")).await.code(), 0);
    assert_eq!(run(&server.url, &format!("rate {id} 4.5")).await.code(), 0);
    let asked = server.asked();
    assert_eq!(asked[1].line, format!("PATCH /v1/examples/{id}"));
    assert_eq!(asked[1].body, br#"{"tags":["head","hero"]}"#);
    assert_eq!(asked[2].body, br#"{"relevance":4.5}"#);
}

#[tokio::test]
async fn remove_goes_on_past_an_example_that_is_not_there() {
    let server = Fake::start(|asked| {
        if asked.line.ends_with(&example_id(1).to_string()) {
            return Reply::problem(Code::NotFound, 404, "expected an example, found none");
        }
        Reply { status: 204, headers: Vec::new(), body: Vec::new() }
    });
    let ran = run(&server.url, &format!("remove {} {}", example_id(1), example_id(2))).await;
    assert_eq!(ran.code(), 1);
    assert!(ran.out.contains(&format!("{}  removed", example_id(2))), "{}", ran.out);
    assert!(ran.notes.contains("1 of 2 failed"), "{}", ran.notes);
}

#[tokio::test]
async fn a_busy_server_is_asked_again_under_the_same_key() {
    let count = AtomicU32::new(0);
    let server = Fake::start(move |_| match count.fetch_add(1, Ordering::Relaxed) {
        0 => {
            let mut reply = Reply::problem(Code::Overloaded, 503, "too much to do");
            reply.headers.push("Retry-After: 0".into());
            reply
        }
        _ => Reply::json(201, &example(1)),
    });
    let (_folder, paths) = files(&["a.obj"]);
    let ran = run(&server.url, &format!("add {}", paths[0].display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let asked = server.asked();
    assert_eq!(asked.len(), 2);
    assert_eq!(asked[0].header("idempotency-key"), asked[1].header("idempotency-key"));
}

#[tokio::test]
async fn a_connection_that_breaks_is_tried_once_more() {
    let count = AtomicU32::new(0);
    let server = Fake::start(move |_| match count.fetch_add(1, Ordering::Relaxed) {
        0 => Reply::none(),
        _ => Reply::json(201, &example(1)),
    });
    let (_folder, paths) = files(&["a.obj"]);
    let ran = run(&server.url, &format!("add {}", paths[0].display())).await;
    assert_eq!((ran.code(), server.asked().len()), (0, 2), "{}", ran.notes);

    let server = Fake::start(|_| Reply::none());
    let ran = run(&server.url, "list").await;
    assert_eq!((ran.code(), server.asked().len()), (3, 2), "{}", ran.notes);
    assert!(ran.notes.contains("broke off"), "{}", ran.notes);
}

#[tokio::test]
async fn a_server_out_of_reach_is_named_with_the_way_out_and_exit_code_3() {
    let free = std::net::TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address");
    let ran = run(&format!("http://{free}"), "list").await;
    assert_eq!(ran.code(), 3);
    for part in [free.to_string().as_str(), "quadmuse-server --data DIR", "QUADMUSE_SERVER", "refused"] {
        assert!(ran.notes.contains(part), "{part} is missing in {}", ran.notes);
    }
}

#[tokio::test]
async fn another_server_than_quadmuse_is_told_from_one() {
    let server = Fake::start(|_| Reply::bytes("text/html", "<html>It works!</html>"));
    let ran = run(&server.url, "list").await;
    assert_eq!(ran.code(), 1);
    assert!(ran.notes.contains("It works!") && ran.notes.contains("expected a page of examples"), "{}", ran.notes);
}

#[tokio::test]
async fn the_problem_reaches_programs_too() {
    let server = Fake::start(|_| Reply::problem(Code::Unauthorized, 401, "expected a token, found none"));
    let ran = run(&server.url, "list --json").await;
    assert_eq!(ran.code(), 1);
    assert_eq!(ran.json_lines()[0]["code"], "unauthorized");
    assert!(ran.notes.contains("--token or QUADMUSE_TOKEN"), "{}", ran.notes);
}

/// A corpus of three examples, each of which can be removed.
fn of_three(asked: &Asked) -> Reply {
    let listed = asked.line.contains("/v1/examples?");
    match asked.line.split(' ').next().unwrap_or_default() {
        "DELETE" => Reply { status: 204, headers: Vec::new(), body: Vec::new() },
        "GET" if listed && asked.line.contains("tag=none") => {
            Reply::json(200, &Page::<Example> { items: Vec::new(), next: None })
        }
        "GET" if listed => Reply::json(200, &Page { items: vec![example(1), example(2), example(3)], next: None }),
        "GET" => Reply::json(200, &example(1)),
        _ => Reply::problem(Code::NotFound, 404, &asked.line),
    }
}

fn removals(server: &Fake) -> usize {
    server.lines().iter().filter(|line| line.starts_with("DELETE")).count()
}

#[tokio::test]
async fn remove_asks_at_a_terminal_and_takes_only_a_yes() {
    for (answers, flags, removed, code) in
        [("n\n", "", 0, 1), ("\n", "", 0, 1), ("y\n", "", 1, 0), ("n\n", "--yes", 1, 0)]
    {
        let server = Fake::start(of_three);
        let ran = run_answering(&server.url, &format!("remove {} {flags}", example_id(1)), answers).await;
        assert_eq!((removals(&server), ran.code()), (removed, code), "{answers:?} {flags}: {}", ran.notes);
        assert_eq!(ran.notes.contains("remove example 1 for good? [y/N]"), flags.is_empty(), "{}", ran.notes);
    }
}

#[tokio::test]
async fn remove_takes_all_of_a_tag_once_somebody_has_said_yes() {
    let server = Fake::start(of_three);
    let ran = run(&server.url, "remove --tag head").await;
    assert_eq!((removals(&server), ran.code()), (0, 2), "{}", ran.notes);
    assert!(ran.notes.contains("--yes") && ran.notes.contains("3 examples would be removed"), "{}", ran.notes);
    let ran = run(&server.url, "remove --tag head --yes").await;
    assert_eq!((removals(&server), ran.code()), (3, 0), "{}", ran.notes);
    let ran = run_answering(&server.url, "remove --tag head", "yes\n").await;
    assert_eq!((removals(&server), ran.code()), (6, 0), "{}", ran.notes);
    let ran = run(&server.url, "remove --tag none --yes").await;
    assert_eq!(ran.code(), 1);
    assert!(ran.notes.contains("expected examples with the tag none, found none"), "{}", ran.notes);
}

#[tokio::test]
async fn add_takes_a_line_a_file_and_tells_repairs_where_they_are_asked_for() {
    let repaired = || Example { repairs: vec!["a hole was filled".into(); 5], ..example(1) };
    let server = Fake::start(move |_| Reply::json(201, &repaired()));
    let (folder, _) = files(&["a.obj", "b.obj"]);
    let line = format!("add {0}/a.obj {0}/b.obj", folder.path().display());
    let ran = run(&server.url, &line).await;
    assert_eq!((ran.out.lines().count(), ran.notes.as_str()), (2, ""), "{}", ran.out);
    assert_eq!(ran.out.matches("4 faces, 5 repairs)").count(), 2, "{}", ran.out);
    let ran = run(&server.url, &format!("{line} --verbose")).await;
    assert_eq!(ran.notes.matches("a hole was filled").count(), 10, "{}", ran.notes);
}

#[tokio::test]
async fn add_warns_of_what_looks_like_a_scan_and_tells_the_way_out() {
    let doubted = || Example { doubts: vec!["only 0 % of its faces are quads".into()], ..example(1) };
    let server = Fake::start(move |_| Reply::json(201, &doubted()));
    let (folder, _) = files(&["a.obj"]);
    let at = folder.path().display();
    let ran = run(&server.url, &format!("add {at}/a.obj")).await;
    assert_eq!((ran.out.lines().count(), ran.code()), (1, 0), "{}", ran.notes);
    let way_out = format!("`quadmuse remove {}` takes it out", example_id(1));
    assert!(ran.notes.starts_with("warning: ") && ran.notes.contains("only 0 %"), "{}", ran.notes);
    assert!(ran.notes.contains(&way_out), "{}", ran.notes);
    // A program reads it in the answer.
    let ran = run(&server.url, &format!("--json add {at}/a.obj")).await;
    assert_eq!(
        (ran.json_lines()[0]["doubts"][0].as_str(), ran.notes.as_str()),
        (Some("only 0 % of its faces are quads"), "")
    );
}

#[tokio::test]
async fn a_compressed_mesh_travels_as_it_is_and_beside_labels_unpacked() {
    let server = Fake::start(|_| Reply::json(201, &example(1)));
    let (folder, _) = files(&["labels.txt"]);
    let at = folder.path().display();
    let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    std::io::Write::write_all(&mut packer, b"v 0 0 0").expect("packs");
    let packed = packer.finish().expect("packs");
    std::fs::write(folder.path().join("head.obj.gz"), &packed).expect("writes");
    for flags in [String::new(), format!("--segments {at}/labels.txt")] {
        let ran = run(&server.url, &format!("add {at}/head.obj.gz {flags}")).await;
        assert_eq!(ran.code(), 0, "{}", ran.notes);
    }
    let [plain, labelled] = &server.asked()[..] else { panic!("two requests") };
    assert!(plain.line.contains("name=head") && !plain.line.contains("name=head."), "{}", plain.line);
    let kinds = (plain.header("content-encoding"), plain.header("content-type"));
    assert_eq!((kinds, &plain.body), ((Some("gzip"), Some("model/obj")), &packed));
    assert_eq!(labelled.header("content-encoding"), None);
    assert!(String::from_utf8_lossy(&labelled.body).contains("v 0 0 0"));
}

#[tokio::test]
async fn one_name_is_for_one_file() {
    let server = Fake::start(|_| Reply::json(201, &example(1)));
    let (folder, _) = files(&["a.obj", "b.obj"]);
    let at = folder.path().display();
    assert_eq!(run(&server.url, &format!("add {at}/a.obj --name nose")).await.code(), 0);
    assert!(server.lines()[0].contains("name=nose"), "{:?}", server.lines());
    let ran = run(&server.url, &format!("add {at}/a.obj {at}/b.obj --name nose")).await;
    assert_eq!((ran.code(), server.lines().len()), (2, 1), "{}", ran.notes);
}

#[tokio::test]
async fn a_filter_that_nothing_passes_is_not_called_an_empty_corpus() {
    let server = Fake::start(of_three);
    let ran = run(&server.url, "list --tag none --topology disc").await;
    assert_eq!(ran.out, "no example with the tag none, and a segment that is a disc; `quadmuse list` shows all\n");
    let server =
        Fake::start(|_| Reply::problem(Code::CorpusEmpty, 409, "expected examples with tags [\"x\"], found none"));
    let ran = run(&server.url, "list").await;
    assert!(ran.notes.contains("`quadmuse list` shows what is there"), "{}", ran.notes);
    assert!(!ran.notes.contains("fill the corpus"), "{}", ran.notes);
}

#[tokio::test]
async fn the_only_file_that_fails_is_told_once() {
    let server = Fake::start(|_| Reply::problem(Code::MeshEmpty, 422, "expected a face, found none"));
    let (folder, _) = files(&["a.obj"]);
    let ran = run(&server.url, &format!("add {}/a.obj", folder.path().display())).await;
    assert_eq!((ran.code(), ran.notes.lines().count()), (1, 1), "{}", ran.notes);
}
