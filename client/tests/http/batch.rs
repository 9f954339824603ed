//! `batch`.

use crate::{
    fake::{Asked, Fake, Reply},
    messages::{example_id, map, query_id},
    queries::{Makes, composition, service_making},
    run, run_answering,
};
use quadmuse_proto::{Code, Composition, Map, Verdict};
use std::fs;
use tempfile::TempDir;

/// A folder of three scans and something else.
fn scans() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["a.ply", "bad.obj", "c.stl", "notes.txt"] {
        fs::write(folder.path().join(name), name).expect("writes");
    }
    folder
}

/// A service that refuses one of the scans, and lays an example fairly on the others.
fn refusing_one(asked: &Asked) -> Reply {
    if asked.line.starts_with("POST /v1/queries") && asked.body == b"bad.obj" {
        return Reply::problem(Code::MeshUnreadable, 422, "expected a vertex number, found \"x\"");
    }
    let fair = Map { verdict: Verdict::Fair, inspired: 0.75, ..map() };
    service_making(asked, 1, &Makes::of(fair, composition()).mapped())
}

#[tokio::test]
async fn a_batch_goes_on_past_a_bad_scan_and_reports_all() {
    let (server, folder) = (Fake::start(refusing_one), scans());
    let out = folder.path().join("out");
    let ran = run(&server.url, &format!("batch {} -o {} --pictures", folder.path().display(), out.display())).await;
    assert_eq!(ran.code(), 1, "{}", ran.notes);
    assert!(ran.notes.contains("1 of 3 failed; the other 2 are done"), "{}", ran.notes);
    let lines: Vec<&str> = ran.out.lines().collect();
    assert_eq!(lines.len(), 3, "{}", ran.out);
    assert!(lines[1].starts_with("bad.obj  failed  expected a vertex number"), "{}", ran.out);
    for name in ["a.obj", "a.png", "c.obj", "c.png"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    let report = fs::read_to_string(out.join("report.csv")).expect("a report");
    let rows: Vec<&str> = report.split("\r\n").collect();
    assert_eq!(rows[0], "scan,file,verdict,faces,inspired,seconds,query,reasons,error,within_percent");
    assert_eq!((rows.len(), rows[4]), (5, ""), "{report}");
    assert!(rows[2].starts_with("bad.obj,,,,,") && rows[2].contains(r#"found ""x"""#), "{report}");
    assert!(!out.join("bad.obj").exists());
}

#[tokio::test]
async fn what_is_less_than_is_required_counts_as_failed_and_is_written() {
    let (server, folder) = (Fake::start(refusing_one), scans());
    fs::remove_file(folder.path().join("bad.obj")).expect("is there");
    let out = folder.path().join("out");
    let line = format!("batch {} -o {} --force --require", folder.path().display(), out.display());
    for (required, code) in [("inspired", 0), ("fair", 0), ("good", 1)] {
        let ran = run(&server.url, &format!("{line} {required} --json")).await;
        assert_eq!(ran.code(), code, "{required}: {}", ran.notes);
        let lines = ran.json_lines();
        assert_eq!(lines.len(), 2, "{}", ran.out);
        assert_eq!((lines[0]["scan"].as_str(), lines[0]["verdict"].as_str()), (Some("a.ply"), Some("fair")));
        assert_eq!((lines[0]["inspired"].as_f64(), lines[0]["faces"].as_u64()), (Some(0.75), Some(4)));
        assert_eq!(lines[0]["query"], query_id().to_string());
        assert_eq!(lines[0]["error"].is_null(), code == 0, "{}", ran.out);
        assert!(out.join("a.obj").is_file());
    }
}

#[tokio::test]
async fn a_batch_takes_the_wishes_of_retopo_for_every_scan() {
    let server = Fake::start(|asked| {
        let mut reply = refusing_one(asked);
        if asked.line.contains("tolerance=") || asked.line.contains("quads=") {
            reply.headers.extend(["quadmuse-faces: 6000".to_owned(), "quadmuse-within: 0.4".to_owned()]);
        }
        reply
    });
    let folder = scans();
    fs::remove_file(folder.path().join("bad.obj")).expect("is there");
    let out = folder.path().join("out");
    let line = format!("batch {} -o {} --force --tag head", folder.path().display(), out.display());
    for flag in ["--quads 6000", "--tolerance 0.1%"] {
        let before = server.asked().len();
        let ran = run(&server.url, &format!("{line} {flag} --use 0={}:7", example_id(3))).await;
        assert_eq!(ran.code(), 0, "{}", ran.notes);
        assert_eq!(ran.out.matches("   6000 faces").count(), 2, "{}", ran.out);
        assert_eq!(ran.out.matches("within 0.400 %").count(), 2, "{}", ran.out);
        let asked = server.asked().split_off(before);
        let posted: Vec<&Asked> = asked.iter().filter(|asked| asked.line.contains("/maps?")).collect();
        assert_eq!(posted.len(), 2, "a map a scan");
        for map in posted {
            let body: serde_json::Value = serde_json::from_slice(&map.body).expect("JSON");
            assert_eq!(body["example"], example_id(3).to_string());
            assert_eq!(body["example_segment"], 7);
        }
        let wanted = format!("&{}", flag.trim_start_matches("--").replace(' ', "=").trim_end_matches('%'));
        let meshes = asked.iter().filter(|asked| asked.line.contains("/mesh?"));
        assert!(meshes.map(|mesh| mesh.line.ends_with(&wanted)).eq([true; 2]), "{wanted}: {:?}", server.lines());
        assert_eq!(asked.iter().filter(|asked| asked.line == "POST /v1/queries?tag=head").count(), 2);
        let report = fs::read_to_string(out.join("report.csv")).expect("a report");
        let rows: Vec<&str> = report.split("\r\n").collect();
        assert!(rows[1].contains(",6000,0.7500,") && rows[1].ends_with(",0.4"), "{report}");
    }
}

#[tokio::test]
async fn a_size_that_was_asked_for_counts_all_faces_of_a_composition() {
    let server = Fake::start(|asked| {
        let makes = Makes::of(map(), Composition { quads: 40, triangles: 2, ..composition() });
        let mut reply = service_making(asked, 3, &makes);
        if asked.line.contains("/mesh") && asked.line.contains("quads=") {
            reply.headers.extend(["quadmuse-faces: 90".to_owned(), "quadmuse-within: 0.4".to_owned()]);
        }
        reply
    });
    let folder = scans();
    let line = format!("batch {0} -o {0}/out --force --json", folder.path().display());
    for (flags, faces) in [("", 42), (" --quads 88", 90)] {
        let ran = run(&server.url, &format!("{line}{flags}")).await;
        assert!(ran.json_lines().iter().all(|line| line["faces"] == faces), "{flags}: {}", ran.out);
    }
}

#[tokio::test]
async fn an_example_that_is_misspelt_is_told_before_a_batch_sends_anything() {
    let (server, folder) = (Fake::start(refusing_one), scans());
    let ran =
        run(&server.url, &format!("batch {0} -o {0}/out --use arm={1}", folder.path().display(), example_id(3))).await;
    assert_eq!(ran.code(), 1, "{}", ran.notes);
    assert!(ran.notes.contains("found `arm`"), "{}", ran.notes);
    assert_eq!(server.lines().len(), 0);
}

#[tokio::test]
async fn a_batch_overwrites_nothing_that_its_user_wants_to_keep() {
    let (server, folder) = (Fake::start(refusing_one), scans());
    let out = folder.path().join("out");
    fs::create_dir(&out).expect("makes");
    fs::write(out.join("c.obj"), "old").expect("writes");
    let line = format!("batch {} -o {}", folder.path().display(), out.display());
    let ran = run_answering(&server.url, &line, "n\n").await;
    assert_eq!((ran.code(), server.lines().len()), (1, 0), "{}", ran.notes);
    assert_eq!(fs::read(out.join("c.obj")).expect("reads"), b"old");
    // Nobody can be asked where a program runs it: for one mesh, for a picture, or for the report alone.
    for name in ["c.obj", "c.png", "report.csv"] {
        fs::remove_dir_all(&out).expect("is there");
        fs::create_dir(&out).expect("makes");
        fs::write(out.join(name), "old").expect("writes");
        let ran = run(&server.url, &format!("{line} --pictures")).await;
        assert_eq!((ran.code(), server.lines().len()), (1, 0), "{}", ran.notes);
        assert!(ran.notes.contains(name) && ran.notes.contains("--force"), "{}", ran.notes);
        assert_eq!(fs::read(out.join(name)).expect("reads"), b"old");
    }
    let ran = run(&server.url, &format!("{line} --force")).await;
    assert!(ran.notes.contains("1 of 3 failed"), "{}", ran.notes);
    assert_ne!(fs::read(out.join("report.csv")).expect("reads"), b"old");
    let asked = server.lines().len();
    // Results in the folder of the scans would replace scans.
    let same = format!(
        "batch {0} -o {0}/../{1}",
        folder.path().display(),
        folder.path().file_name().expect("a name").display()
    );
    let ran = run(&server.url, &same).await;
    assert_eq!((ran.code(), server.lines().len()), (2, asked), "{}", ran.notes);
}

#[tokio::test]
async fn a_folder_without_scans_is_told() {
    let (server, folder) = (Fake::start(refusing_one), tempfile::tempdir().expect("a folder"));
    let ran = run(&server.url, &format!("batch {0} -o {0}/out", folder.path().display())).await;
    assert_eq!(ran.code(), 1);
    assert!(ran.notes.contains("expected mesh files in"), "{}", ran.notes);
}

#[tokio::test]
async fn without_a_server_no_other_scan_is_tried() {
    let folder = scans();
    let line = format!("batch {0} -o {0}/out", folder.path().display());
    let ran = run("http://127.0.0.1:1", &line).await;
    assert_eq!((ran.code(), ran.out.as_str()), (3, ""), "{}", ran.notes);
    assert_eq!(ran.notes.matches("error:").count(), 1, "{}", ran.notes);
}
