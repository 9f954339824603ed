//! `retopo` of scans that no example fits as a whole.

use crate::{
    fake::{Asked, Fake, Reply},
    messages::{map, query, query_id, ranking},
    queries::{composition, mesh_file, service},
    run,
};
use quadmuse_proto::{Code, Composition, Map, Query, QueryState, Verdict};
use std::sync::{
    Arc,
    atomic::{AtomicBool, AtomicU32, Ordering},
};

#[tokio::test]
async fn retopo_cuts_what_no_example_fits_as_a_whole() {
    let mesh = mesh_file();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let poor = Map { verdict: Verdict::Poor, ..map() };
    let segments = Arc::new(AtomicU32::new(1));
    let server = Fake::start(move |asked| {
        if asked.line.starts_with("POST") && asked.line.contains("parts=auto") {
            segments.store(3, Ordering::Relaxed);
        }
        match asked.line.contains("/maps?") {
            true => Reply::json(201, &poor),
            false => service(asked, segments.load(Ordering::Relaxed)),
        }
    });
    let ran = run(&server.url, &format!("retopo {} -o {}", mesh.path().display(), out.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert!(
        ran.notes.contains("the best example, example 1, fits poorly as a whole\ncutting the mesh"),
        "{}",
        ran.notes
    );
    let posted: Vec<Asked> = server.asked().into_iter().filter(|asked| asked.line.starts_with("POST")).collect();
    let cuts = posted.iter().filter(|asked| asked.line.starts_with("POST /v1/queries?"));
    assert!(cuts.map(|asked| asked.line.contains("parts=waist")).eq([true, false]), "first at its waist");
    let last = posted.last().expect("a composition");
    assert!(last.line.contains("/compositions?"), "{}", last.line);
    let composed: serde_json::Value = serde_json::from_slice(&last.body).expect("JSON");
    assert_eq!(composed["parts"], serde_json::json!([]), "poor maps that nobody chose are not stitched");
    assert_eq!(
        ran.notes.matches("fits poorly\n").count(),
        3,
        "a line a segment, and the service says the rest: {}",
        ran.notes
    );
    assert!(ran.out.contains("4 quads"), "{}", ran.out);
}

#[tokio::test]
async fn retopo_parts_a_figure_from_its_base_and_cuts_further_only_where_that_helps_little() {
    let mesh = mesh_file();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    // The share of the scan that the figure's example makes up, whether there is a waist, how much worse the whole scores, and
    // which cuts are tried.
    let all = [(0.6, true, 1.0, [1, 0]), (0.2, true, 1.0, [1, 1]), (0.6, false, 1.0, [1, 1]), (0.6, true, 0.0, [1, 1])];
    for (inspired, waist, worse, tried) in all {
        let (segments, is_waist) = (AtomicU32::new(1), AtomicBool::new(false));
        let server = Fake::start(move |asked| {
            if asked.line.starts_with("POST") && asked.line.contains("parts=") {
                segments.store(2, Ordering::Relaxed);
                is_waist.store(waist && asked.line.contains("parts=waist"), Ordering::Relaxed);
            }
            let (segments, waist) = (segments.load(Ordering::Relaxed), is_waist.load(Ordering::Relaxed));
            let path = asked.line.split(['?', ' ']).nth(1).unwrap_or_default();
            match path.rsplit('/').next() {
                Some("ranking") if !waist => {
                    let mut found = ranking(0, 3, 128, QueryState::Done);
                    found.entries.iter_mut().for_each(|entry| entry.score += worse);
                    Reply::json(200, &found)
                }
                Some("maps") => {
                    Reply::json(201, &Map { verdict: if waist { Verdict::Fair } else { Verdict::Poor }, ..map() })
                }
                Some("compositions") => {
                    Reply::json(201, &Composition { inspired: if waist { inspired } else { 0.1 }, ..composition() })
                }
                Some("queries") => Reply::json(202, &Query { waist, ..query(QueryState::Queued, segments) }),
                Some(id) if id == query_id().to_string() && asked.line.starts_with("GET") => {
                    Reply::json(200, &Query { waist, ..query(QueryState::Done, segments) })
                }
                _ => service(asked, segments),
            }
        });
        let ran = run(&server.url, &format!("retopo {} --force -o {}", mesh.path().display(), out.display())).await;
        assert_eq!(ran.code(), 0, "{}", ran.notes);
        let lines = server.lines();
        let cuts =
            ["waist", "auto"].map(|cut| lines.iter().filter(|line| line.contains(&format!("parts={cut}"))).count());
        assert_eq!(cuts, tried, "{inspired} {waist}: {}", ran.notes);
        assert_eq!(ran.notes.contains("parting it at its waist"), waist && worse > 0.0, "{}", ran.notes);
    }
}

#[tokio::test]
async fn retopo_says_where_it_found_no_parts_to_cut() {
    let mesh = mesh_file();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let poor = Map { verdict: Verdict::Poor, ..map() };
    let server = Fake::start(move |asked| match asked.line.contains("/maps?") {
        true => Reply::json(201, &poor),
        false => service(asked, 1),
    });
    let ran = run(&server.url, &format!("retopo {} -o {}", mesh.path().display(), out.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert_eq!(ran.notes.matches("fits poorly").count(), 1, "{}", ran.notes);
    assert!(ran.notes.ends_with("no parts were found\n"), "{}", ran.notes);
    let freed = server.lines().iter().filter(|line| line.starts_with("DELETE")).count();
    assert_eq!(freed, 2, "what was not cut is not ranked again");
}

#[tokio::test]
async fn retopo_delivers_a_map_whose_stitching_takes_too_long() {
    let mesh = mesh_file();
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let server = Fake::start(|asked| match asked.line.contains("/compositions") {
        true => Reply::problem(Code::Deadline, 504, "expected it to end in its time"),
        false => service(asked, 1),
    });
    let ran = run(&server.url, &format!("retopo {} -o {}", mesh.path().display(), out.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert!(ran.notes.contains("it is as it was mapped"), "{}", ran.notes);
    let written = server.lines().into_iter().rfind(|line| line.contains("/mesh")).expect("a mesh is asked for");
    assert!(written.contains("/maps/"), "{written}");
    assert!(out.exists());
}
