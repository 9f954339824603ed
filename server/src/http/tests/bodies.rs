//! Bodies: limits, packing, forms.

use super::*;
use serde_json::json;
use std::io::Write;

const MESH: &str = "segment disc 1\nsegment disc 2";

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(bytes).expect("in memory");
    encoder.finish().expect("in memory")
}

fn form(parts: &[(&str, &str, &str)]) -> (String, String) {
    let mut body = String::new();
    for (name, file, content) in parts {
        let file = if file.is_empty() { String::new() } else { format!("; filename=\"{file}\"") };
        body.push_str(&format!("--XX\r\ncontent-disposition: form-data; name=\"{name}\"{file}\r\n\r\n{content}\r\n"));
    }
    body.push_str("--XX--\r\n");
    ("multipart/form-data; boundary=XX".into(), body)
}

async fn post_form(bench: &Bench, parts: &[(&str, &str, &str)]) -> Answer {
    let (kind, body) = form(parts);
    bench.request(Method::POST, "/v1/examples", &[("content-type", &kind)], body).await
}

#[tokio::test]
async fn packed_bodies_are_unpacked() {
    let bench = Bench::new();
    let zstd = zstd::encode_all(MESH.as_bytes(), 3).expect("in memory");
    for (coding, bytes) in [("gzip", gzip(MESH.as_bytes())), ("zstd", zstd)] {
        let answer = bench.request(Method::POST, "/v1/examples", &[("content-encoding", coding)], bytes).await;
        assert!(answer.status.is_success(), "{coding}: {}", answer.text());
        assert_eq!(answer.json()["bytes"], json!(MESH.len()));
    }
    let headers = [("content-encoding", "br")];
    bench.request(Method::POST, "/v1/examples", &headers, MESH).await.problem(415, "format_unknown");
    let headers = [("content-encoding", "gzip")];
    bench.request(Method::POST, "/v1/examples", &headers, MESH).await.problem(400, "body_invalid");
    let mut cut = gzip(&vec![b' '; 4000]);
    cut.truncate(cut.len() - 10);
    bench.request(Method::POST, "/v1/examples", &headers, cut).await.problem(400, "body_invalid");
}

#[tokio::test]
async fn a_bomb_is_refused_by_its_unpacked_size() {
    let bench = Bench::new();
    let bomb = gzip(&vec![b'\n'; 64 << 20]);
    assert!((bomb.len() as u64) < 2 * LIMIT, "a bomb is small: {} bytes", bomb.len());
    let small = gzip(&vec![b'\n'; 4 * LIMIT as usize]);
    for bytes in [bomb, small] {
        for path in ["/v1/examples", "/v1/queries"] {
            let headers = [("content-encoding", "gzip")];
            bench.request(Method::POST, path, &headers, bytes.clone()).await.problem(413, "body_too_large");
        }
    }
}

#[tokio::test]
async fn a_body_over_the_limit_is_refused_in_every_shape() {
    let bench = Bench::new();
    let big = "\n".repeat(LIMIT as usize + 1);
    bench.post("/v1/examples", &big).await.problem(413, "body_too_large");
    let chunks = (0..20).map(|_| Ok::<_, std::io::Error>(vec![b'\n'; LIMIT as usize / 10]));
    let chunked = Body::from_stream(futures_util::stream::iter(chunks));
    bench.request(Method::POST, "/v1/examples", &[], chunked).await.problem(413, "body_too_large");
    post_form(&bench, &[("mesh", "a.obj", &big)]).await.problem(413, "body_too_large");
    let exact = "\n".repeat(LIMIT as usize);
    bench.post("/v1/examples", &exact).await.problem(422, "mesh_unreadable");
}

#[tokio::test]
async fn a_form_brings_a_mesh_and_its_labels() {
    let bench = Bench::new();
    let answer = post_form(&bench, &[("mesh", "a.ply", MESH), ("segments", "", "0\n1\n")]).await;
    assert_eq!((answer.status, &answer.json()["format"]), (StatusCode::CREATED, &json!("ply")));
    post_form(&bench, &[("mesh", "", MESH), ("segments", "", "0\n")]).await.problem(400, "parameter_invalid");
    let detail =
        post_form(&bench, &[("mesh", "", MESH), ("segments", "", "0\nx\n")]).await.problem(400, "parameter_invalid");
    assert!(detail.contains("line 2"), "{detail}");
}

#[tokio::test]
async fn bad_forms_are_refused() {
    let bench = Bench::new();
    post_form(&bench, &[("segments", "", "0\n")]).await.problem(400, "body_invalid");
    post_form(&bench, &[("mesh", "", MESH), ("mesh", "", MESH)]).await.problem(400, "body_invalid");
    let detail = post_form(&bench, &[("other", "", "x")]).await.problem(400, "body_invalid");
    assert!(detail.contains("other"), "{detail}");
    for kind in ["multipart/form-data", "multipart/form-data; boundary=YY"] {
        let (_, body) = form(&[("mesh", "", MESH)]);
        bench.request(Method::POST, "/v1/examples", &[("content-type", kind)], body).await.problem(400, "body_invalid");
    }
    let cut = "--XX\r\ncontent-disposition: form-data; name=\"mesh\"\r\n\r\nsegment disc 1";
    let headers = [("content-type", "multipart/form-data; boundary=XX")];
    bench.request(Method::POST, "/v1/examples", &headers, cut).await.problem(400, "body_invalid");
}

#[tokio::test]
async fn the_format_is_named_or_recognised() {
    let bench = Bench::new();
    for (n, (path, kind, format)) in [
        ("/v1/examples?format=off", "model/ply", "off"),
        ("/v1/examples", "model/gltf-binary", "glb"),
        ("/v1/examples", "application/octet-stream", "obj"),
        ("/v1/examples", "application/x-www-form-urlencoded", "obj"),
    ]
    .into_iter()
    .enumerate()
    {
        let mesh = format!("segment disc {n}");
        let answer = bench.request(Method::POST, path, &[("content-type", kind)], mesh).await;
        assert_eq!(answer.json()["format"], json!(format));
    }
    bench.post("/v1/examples?format=doc", MESH).await.problem(415, "format_unknown");
    let headers = [("content-type", "image/png")];
    bench.request(Method::POST, "/v1/examples", &headers, MESH).await.problem(415, "format_unknown");
}

#[tokio::test]
async fn an_empty_body_is_told_so_whatever_it_is_said_to_be() {
    let bench = Bench::stocked().await;
    for path in ["/v1/examples", "/v1/queries", "/v1/examples?format=obj"] {
        for kind in ["application/octet-stream", "model/ply"] {
            let answer = bench.request(Method::POST, path, &[("content-type", kind)], Body::empty()).await;
            let detail = answer.problem(422, "mesh_empty");
            assert!(detail.contains("no bytes"), "{detail}");
        }
    }
    let empty = post_form(&bench, &[("mesh", "a.obj", "")]).await;
    empty.problem(422, "mesh_empty");
}

#[tokio::test]
async fn a_small_file_of_many_segments_is_refused() {
    let bench = Bench::stocked().await;
    let most = crate::work::ingest::SEGMENTS_MAX;
    let mesh = |count: usize| (0..count).map(|n| format!("segment disc {n}")).collect::<Vec<_>>().join("\n");
    for path in ["/v1/examples", "/v1/queries"] {
        let detail = bench.post(path, &mesh(most + 1)).await.problem(400, "parameter_invalid");
        assert!(detail.contains(&most.to_string()), "{detail}");
        assert!(bench.post(path, &mesh(most)).await.status.is_success());
    }
}
