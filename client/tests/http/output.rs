//! What is read and written: standard input and output, files that are there already, pictures, pages.

use crate::{
    fake::{Fake, Reply},
    messages::{map_id, query_id},
    queries::{mesh_file, service},
    run, run_answering,
};
use quadmuse_proto::Code;
use std::{
    fs,
    io::{Read, Write},
    process::{Command, Output, Stdio},
};

/// Runs the program itself, with something on its standard input.
fn process(server: &str, line: &str, input: &[u8]) -> Output {
    let state = tempfile::tempdir().expect("a folder");
    let mut command = Command::new(env!("CARGO_BIN_EXE_quadmuse"));
    command.args(line.split_whitespace()).env("QUADMUSE_SERVER", server).env("QUADMUSE_STATE", state.path());
    let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = piped.spawn().expect("starts");
    child.stdin.take().expect("a pipe").write_all(input).expect("reads all");
    child.wait_with_output().expect("ends")
}

#[test]
fn a_scan_from_a_pipe_ends_as_a_mesh_in_a_pipe_and_nothing_else() {
    let server = Fake::start(|asked| service(asked, 1));
    for line in ["retopo - -o -", "--json retopo - -o - --format ply"] {
        let ran = process(&server.url, line, b"scan");
        assert_eq!(ran.status.code(), Some(0), "{line}: {}", String::from_utf8_lossy(&ran.stderr));
        assert_eq!(ran.stdout, b"v 0 0 0\n", "{line}");
        let notes = String::from_utf8_lossy(&ran.stderr);
        assert!(notes.contains("written") || notes.contains("\"file\":\"standard output\""), "{notes}");
    }
    let asked = server.asked();
    let upload = asked.iter().find(|asked| asked.line.starts_with("POST /v1/queries")).expect("an upload");
    assert_eq!(
        (upload.body.as_slice(), upload.header("content-type")),
        (&b"scan"[..], Some("application/octet-stream"))
    );
    let downloads: Vec<&str> =
        asked.iter().filter_map(|asked| asked.line.split_once("mesh?format=")).map(|(_, format)| format).collect();
    assert_eq!(downloads, ["obj", "ply"]);
    let ran = process(&server.url, "query - --no-follow", b"scan");
    assert_eq!(String::from_utf8_lossy(&ran.stdout), format!("{}\n", query_id()));
}

#[tokio::test]
async fn a_file_that_is_there_is_asked_about_at_a_terminal_and_kept_from_scripts() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj");
    let line = format!("map {} -o {}", query_id(), out.display());
    let server = Fake::start(|asked| service(asked, 1));
    for (answers, flags, replaced) in [
        (Some("n\n"), "", false),
        (Some("y\n"), "", true),
        (Some("n\n"), "--force", true),
        // A script has nobody to ask.
        (None, "", false),
        (None, "--json", false),
        (None, "--force", true),
    ] {
        fs::write(&out, "old").expect("writes");
        let (line, asked) = (format!("{line} {flags}"), server.lines().len());
        let ran = match answers {
            Some(answers) => run_answering(&server.url, &line, answers).await,
            None => run(&server.url, &line).await,
        };
        assert_eq!((fs::read(&out).expect("reads") != b"old", ran.code() == 0), (replaced, replaced), "{}", ran.notes);
        // Who says no has waited for nothing.
        assert_eq!(server.lines().len() > asked, replaced, "{answers:?} {flags}");
        assert_eq!(ran.notes.contains("overwrite it?"), answers.is_some() && flags.is_empty(), "{}", ran.notes);
        assert_eq!(ran.notes.contains("or --force"), answers.is_none() && !replaced, "{}", ran.notes);
    }
    fs::remove_file(&out).expect("is there");
    let ran = run_answering(&server.url, &line, "n\n").await;
    assert!(ran.code() == 0 && !ran.notes.contains("overwrite"), "a new file is no question: {}", ran.notes);
}

#[tokio::test]
async fn a_mesh_is_compressed_where_its_name_says_so_and_has_the_format_asked_for() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.obj.gz");
    let server = Fake::start(|asked| service(asked, 1));
    let ran = run(&server.url, &format!("map {} -o {} --format off", query_id(), out.display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    let mut text = String::new();
    let packed = fs::File::open(&out).expect("opens");
    flate2::read::GzDecoder::new(packed).read_to_string(&mut text).expect("unpacks");
    assert_eq!(text, "v 0 0 0\n");
    assert!(server.lines().iter().any(|line| line.ends_with("mesh?format=off")), "{:?}", server.lines());
}

#[tokio::test]
async fn a_result_is_drawn_where_that_is_asked_for() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, picture) = (folder.path().join("out.obj"), folder.path().join("out.png"));
    let (out, mesh, path) = (out.display(), mesh_file(), picture.display());
    for (segments, line, drawn) in [
        (
            1,
            format!("map {} --force -o {out} --picture {path}", query_id()),
            format!("/Q/maps/{}/preview.png", map_id()),
        ),
        (2, format!("retopo {} --force -o {out} --picture {path}", mesh.path().display()), "/Q/compositions/".into()),
    ] {
        let server = Fake::start(move |asked| service(asked, segments));
        let ran = run(&server.url, &line).await;
        assert_eq!(ran.code(), 0, "{line}: {}", ran.notes);
        let written = fs::read_to_string(&picture).expect("a picture");
        assert!(written.starts_with(&drawn) && written.ends_with("/preview.png"), "{line}: {written}");
        fs::remove_file(&picture).expect("is there");
    }
}

#[tokio::test]
async fn the_page_of_a_query_is_told_if_there_is_such_a_query() {
    let server = Fake::start(|asked| service(asked, 1));
    let url = format!("{}/#{}", server.url, query_id());
    assert_eq!(run(&server.url, &format!("open {}", query_id())).await.out, format!("{url}\n"));
    let ran = run(&server.url, &format!("--json open {}", query_id())).await;
    assert_eq!(ran.json_lines()[0]["url"], url);
    let server = Fake::start(|_| Reply::problem(Code::NotFound, 404, "expected a query of this server, found none"));
    let ran = run(&server.url, &format!("open {}", query_id())).await;
    assert_eq!((ran.code(), ran.out.as_str()), (1, ""), "{}", ran.notes);
}

#[tokio::test]
async fn completions_and_manual_pages_need_no_server() {
    let nowhere = "http://127.0.0.1:1";
    for (shell, says) in
        [("bash", "complete -F _quadmuse"), ("zsh", "#compdef quadmuse"), ("fish", "complete -c quadmuse")]
    {
        let ran = run(nowhere, &format!("completions {shell}")).await;
        assert!(ran.code() == 0 && ran.out.contains(says) && ran.out.contains("retopo"), "{shell}: {}", ran.out);
    }
    let ran = run(nowhere, "man retopo").await;
    assert!(ran.code() == 0 && ran.out.contains(".TH QUADMUSE-RETOPO"), "{}", ran.out);
    assert_eq!(run(nowhere, "man retop").await.code(), 2);
    let folder = tempfile::tempdir().expect("a folder");
    let ran = run(nowhere, &format!("man --dir {}/new", folder.path().display())).await;
    assert_eq!(ran.code(), 0, "{}", ran.notes);
    assert!(folder.path().join("new/quadmuse.1").is_file() && folder.path().join("new/quadmuse-batch.1").is_file());
}
