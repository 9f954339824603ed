//! Hostile files are refused with a typed problem that helps, and the server lives on.

use crate::Place;
use quadmuse_tests::{http, shared};
use serde_json::Value;
use std::{
    fmt::Write,
    path::Path,
    time::{Duration, Instant},
};

/// How long one file may occupy the server before it counts as hung: tenfold what it should, as others use the machine.
const FILE_TIME_MAX: Duration = Duration::from_secs(100);

/// Bad files, each with the code that it is to be refused with.
fn samples() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let mut fan = String::from("v 0 0 0\nv 0 0 1\n");
    for i in 0..40 {
        let _ = writeln!(fan, "v 1 {i} 0\nf 1 2 {}", i + 3);
    }
    let huge_counts = "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n\
                       property float z\nelement face 4000000000\nproperty list uchar int vertex_indices\nend_header\n";
    let mut huge_stl = vec![b' '; 80];
    huge_stl.extend(u32::MAX.to_le_bytes());
    vec![
        ("empty.obj", b"".to_vec(), "mesh_empty"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n".to_vec(), "mesh_empty"),
        ("range.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n".to_vec(), "mesh_unreadable"),
        ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec(), "mesh_unreadable"),
        ("garbage.obj", (0..=255).cycle().take(5000).collect(), "mesh_unreadable"),
        ("counts.ply", huge_counts.as_bytes().to_vec(), "mesh_too_large"),
        ("cut.stl", huge_stl, "mesh_unreadable"),
        ("counts.off", b"OFF\n4000000000 4000000000 0\n".to_vec(), "mesh_too_large"),
        ("not.glb", b"glTF\x02\0\0\0\xff\xff\xff\xff".to_vec(), "mesh_unreadable"),
        ("fan.obj", fan.into_bytes(), "mesh_not_manifold"),
    ]
}

/// Sees to it that an answer is success, or a refusal as RFC 9457 has it that says what and why.
fn check(name: &str, answer: &http::Answer) -> Option<Value> {
    assert!(answer.status < 500, "{name}: {} {}", answer.status, answer.text());
    if answer.status < 300 {
        return None;
    }
    let content_type = answer.header("content-type").unwrap_or_default();
    assert_eq!(content_type, "application/problem+json", "{name}");
    let problem: Value = serde_json::from_slice(&answer.body).unwrap_or_else(|_| panic!("{name}: {}", answer.text()));
    for field in ["type", "title", "detail", "code", "request_id"] {
        assert!(problem[field].as_str().is_some_and(|text| !text.is_empty()), "{name}: no {field} in {problem}");
    }
    assert_eq!(problem["status"], answer.status, "{name}");
    Some(problem)
}

#[test]
fn bad_files_are_refused_with_the_code_that_fits() {
    let place = Place::new();
    let (mut server, client) = place.serve();
    for (name, bytes, code) in samples() {
        for endpoint in ["/v1/examples", "/v1/queries"] {
            let media_type = quadmuse_proto::MeshFormat::from_file_name(name).expect("a format").media_type();
            let answer = http::post(server.address(), endpoint, media_type, &bytes).expect("an answer");
            let problem = check(name, &answer).unwrap_or_else(|| panic!("{name} was taken: {}", answer.text()));
            assert_eq!(problem["code"], code, "{name}: {problem}");
        }
    }
    assert!(server.is_alive(), "{}", server.log());
    // The client names the file and the reason.
    let bad = place.file("range.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    let good = place.heads(1).remove(0);
    let ran = crate::run(&client, &["add"], &[&bad, &good]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.notes.contains("range.obj") && ran.notes.contains('9') && ran.notes.contains('4'), "{}", ran.notes);
    assert!(ran.out.contains("head_0.obj"), "{}", ran.out);
}

#[test]
fn shared_hostile_files_never_cost_the_server_its_life() {
    let Some(shared) = shared::folder_or_say("the shared hostile files") else { return };
    let place = Place::new();
    let (mut server, _client) = place.serve();
    let folder = shared.join("meshes/hostile");
    let mut files: Vec<_> = std::fs::read_dir(&folder).expect("lists").flatten().map(|entry| entry.path()).collect();
    files.retain(|path| path.is_file() && !["csv", "md"].iter().any(|end| path.extension().is_some_and(|e| e == *end)));
    files.sort();
    let (mut refused, mut taken) = (0, 0);
    for path in &files {
        let bytes = std::fs::read(path).expect("reads");
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let begun = Instant::now();
        let answer = http::post(server.address(), "/v1/examples", media_type(path), &bytes).unwrap_or_else(|error| {
            panic!("{name}: no answer ({error}); the server is {}", if server.is_alive() { "alive" } else { "dead" })
        });
        assert!(begun.elapsed() < FILE_TIME_MAX, "{name} took {:?}", begun.elapsed());
        match check(&name, &answer) {
            Some(_) => refused += 1,
            None => taken += 1,
        }
    }
    assert!(server.is_alive(), "{}", server.log());
    eprintln!("{refused} hostile files refused, {taken} taken");
    assert!(refused >= 20, "only {refused} of {} were refused", files.len());
}

/// `count` triangles anywhere, none of which touches another, as binary STL.
fn loose_triangles(count: u32) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend(count.to_le_bytes());
    let mut state = 1u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1u32 << 24) as f32
    };
    for _ in 0..count {
        bytes.extend([0; 12]);
        (0..9).for_each(|_| bytes.extend(random().to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// Composes an input, sees that nothing was mapped for it, and returns what was written.
fn composed_without_maps(name: &str, bytes: &[u8]) -> String {
    let place = Place::new();
    let (mut server, client) = place.serve();
    crate::run(&client, &["add"], &[&place.heads(1)[0]]).ok().expect("added");
    let (input, out) = (place.path(name), place.path("out.obj"));
    std::fs::write(&input, bytes).expect("writes");
    let query = crate::values(&client, &["query"], &[&input]).remove(0);
    let id = crate::text(&query, "query").to_owned();
    let ran = crate::run(&client, &["compose", &id, "-o"], &[&out]);
    assert_eq!(ran.code, Some(0), "{}", ran.notes);
    let maps = http::get(server.address(), &format!("/v1/queries/{id}/maps")).expect("an answer").text();
    let maps: Value = serde_json::from_str(&maps).expect("JSON");
    assert_eq!(maps["items"].as_array().map(Vec::len), Some(0), "{maps}");
    assert!(server.is_alive(), "{}", server.log());
    std::fs::read_to_string(&out).expect("written")
}

#[test]
fn a_ragged_scan_of_loose_triangles_is_composed_without_a_map_for_each() {
    let made = composed_without_maps("loose.stl", &loose_triangles(40));
    assert!(made.lines().filter(|line| line.starts_with("f ")).all(|face| face.split(' ').count() == 5));
}

/// A sheet of so many cells a side, bent.
fn sheet(cells: u32) -> String {
    let mut text = String::new();
    for k in 0..(cells + 1) * (cells + 1) {
        let (x, y) = (k % (cells + 1), k / (cells + 1));
        let _ = writeln!(text, "v {x} {y} {}", f64::from((x * 3 + y * 5) % 7) * 0.1);
    }
    for k in 0..cells * cells {
        let first = k / cells * (cells + 1) + k % cells + 1;
        let _ = writeln!(text, "f {first} {} {} {}", first + 1, first + cells + 2, first + cells + 1);
    }
    text
}

#[test]
fn retopo_lays_nothing_on_a_scrap_one_example_on_a_few_faces_and_does_not_cut_them() {
    let place = Place::new();
    let (mut server, client) = place.serve();
    crate::run(&client, &["add"], &place.heads(2).iter().map(std::path::PathBuf::as_path).collect::<Vec<_>>())
        .ok()
        .expect("added");
    // A triangle, a tetrahedron, and sheets.
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_owned();
    let tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n".to_owned();
    let all = [("triangle", triangle, 0), ("tetrahedron", tetrahedron, 0), ("few", sheet(3), 0), ("more", sheet(6), 1)];
    for (name, mesh, maps) in all {
        let (input, out) = (place.file(&format!("{name}.obj"), &mesh), place.path(&format!("{name}_out.obj")));
        let ran = crate::run(&client, &["retopo"], &[&input, "-o".as_ref(), &out]);
        assert!(ran.code.is_some_and(|code| code < 2) && out.exists(), "{name}: {}", ran.notes);
        let get = |path: &str| -> Value {
            let text = http::get(server.address(), path).expect("an answer").text();
            serde_json::from_str(&text).expect("JSON")
        };
        let queries = get("/v1/queries");
        let newest = queries["items"].as_array().and_then(|items| items.last()).expect("a query");
        assert_eq!(newest["segments"][0]["tries"], maps, "{name}: {newest}");
        let made = get(&format!("/v1/queries/{}/maps", crate::text(newest, "id")));
        assert_eq!(made["items"].as_array().map(Vec::len), Some(maps), "{name}: {made}");
    }
    assert!(server.is_alive(), "{}", server.log());
}

fn media_type(path: &Path) -> &'static str {
    let format = quadmuse_proto::MeshFormat::from_file_name(&path.to_string_lossy());
    format.map_or("application/octet-stream", quadmuse_proto::MeshFormat::media_type)
}
