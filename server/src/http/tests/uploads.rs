//! Uploads piece by piece: the protocol, whose they are, what they are used for.

use super::access::Closed;
use super::*;
use quadmuse_proto::upload::OFFSET_OCTET_STREAM;

/// None of those of a stocked service.
const MESH: &str = "segment disc 9";
const TUS: (&str, &str) = ("tus-resumable", "1.0.0");

/// Begins an upload; its address.
async fn begun(bench: &Bench, length: usize) -> String {
    let length = length.to_string();
    let answer = bench.request(Method::POST, "/v1/uploads", &[TUS, ("upload-length", &length)], "").await;
    assert_eq!(answer.status, StatusCode::CREATED, "{}", answer.text());
    assert_eq!(answer.header("tus-resumable"), "1.0.0");
    assert!(answer.header("upload-expires").ends_with("GMT"), "{}", answer.header("upload-expires"));
    answer.header("location").to_owned()
}

async fn piece(bench: &Bench, path: &str, offset: usize, bytes: impl Into<Body>) -> Answer {
    let offset = offset.to_string();
    let headers = [TUS, ("upload-offset", &*offset), ("content-type", OFFSET_OCTET_STREAM)];
    bench.request(Method::PATCH, path, &headers, bytes).await
}

async fn offset(bench: &Bench, path: &str) -> String {
    let answer = bench.request(Method::HEAD, path, &[TUS], "").await;
    assert_eq!((answer.status, answer.header("cache-control")), (StatusCode::OK, "no-store"));
    answer.header("upload-offset").to_owned()
}

fn id(path: &str) -> &str {
    path.rsplit('/').next().expect("an id")
}

#[tokio::test]
async fn a_mesh_that_came_in_pieces_takes_the_place_of_a_body() {
    let bench = Bench::stocked().await;
    let path = begun(&bench, MESH.len()).await;
    let first = piece(&bench, &path, 0, &MESH[..4]).await;
    assert_eq!((first.status, first.header("upload-offset")), (StatusCode::NO_CONTENT, "4"));
    let early = bench.post(&format!("/v1/queries?upload={}", id(&path)), "").await;
    assert!(early.problem(409, "conflict").contains("found 4"), "{}", early.text());
    assert_eq!(offset(&bench, &path).await, "4");
    assert_eq!(piece(&bench, &path, 4, &MESH[4..]).await.header("upload-offset"), MESH.len().to_string());
    let beside = bench.post(&format!("/v1/queries?upload={}", id(&path)), "a body").await;
    beside.problem(400, "body_invalid");
    let query = bench.query(&format!("upload={}", id(&path)), "").await;
    assert_eq!(bench.ended(&query).await["state"], "done");
    // The headers say what it holds, as of a body.
    let headers = [("content-type", "model/ply")];
    let example = bench.request(Method::POST, &format!("/v1/examples?upload={}", id(&path)), &headers, "").await;
    assert_eq!(example.json()["format"], "ply", "{}", example.text());
    let removed = bench.request(Method::DELETE, &path, &[TUS], "").await;
    assert_eq!(removed.status, StatusCode::NO_CONTENT);
    assert_eq!(bench.request(Method::HEAD, &path, &[TUS], "").await.status, StatusCode::NOT_FOUND);
    bench.post(&format!("/v1/queries?upload={}", id(&path)), "").await.problem(404, "not_found");
    assert!(bench.work.pool.admission().used().bytes < 64 << 20);
}

#[tokio::test]
async fn a_packed_mesh_is_unpacked_and_a_bomb_refused_as_in_a_body() {
    let bench = Bench::stocked().await;
    for (text, status) in [(MESH.to_owned(), 202), ("\n".repeat(4 * LIMIT as usize), 413)] {
        let bytes = zstd::encode_all(text.as_bytes(), 3).expect("in memory");
        let path = begun(&bench, bytes.len()).await;
        assert_eq!(piece(&bench, &path, 0, bytes).await.status, StatusCode::NO_CONTENT);
        let headers = [("content-encoding", "zstd")];
        let path = format!("/v1/queries?upload={}", id(&path));
        assert_eq!(bench.request(Method::POST, &path, &headers, "").await.status.as_u16(), status);
    }
}

#[tokio::test]
async fn what_came_before_a_connection_broke_is_kept() {
    let bench = Bench::new();
    let whole = vec![b'x'; LIMIT as usize];
    let path = begun(&bench, whole.len()).await;
    let half = whole[..whole.len() / 2].to_vec();
    let broken = futures_util::stream::iter([Ok(half), Err(std::io::Error::other("the connection broke"))]);
    piece(&bench, &path, 0, Body::from_stream(broken)).await.problem(400, "body_invalid");
    let at: usize = offset(&bench, &path).await.parse().expect("a number");
    assert_eq!(at, whole.len() / 2);
    assert_eq!(piece(&bench, &path, at, whole[at..].to_vec()).await.header("upload-offset"), whole.len().to_string());
}

#[tokio::test]
async fn pieces_that_do_not_fit_are_refused_and_change_nothing() {
    let bench = Bench::new();
    let path = begun(&bench, 4).await;
    piece(&bench, &path, 1, "b").await.problem(409, "conflict");
    piece(&bench, &path, 0, "abcde").await.problem(413, "body_too_large");
    let chunks = futures_util::stream::iter([Ok::<_, std::io::Error>("abc"), Ok("de")]);
    piece(&bench, &path, 0, Body::from_stream(chunks)).await.problem(413, "body_too_large");
    let typed = [TUS, ("upload-offset", "0"), ("content-type", "application/octet-stream")];
    bench.request(Method::PATCH, &path, &typed, "abcd").await.problem(415, "format_unknown");
    let packed = [TUS, ("upload-offset", "0"), ("content-type", OFFSET_OCTET_STREAM), ("content-encoding", "gzip")];
    bench.request(Method::PATCH, &path, &packed, "abcd").await.problem(415, "format_unknown");
    for wrong in ["", "-1", "+0", "x", "99999999999999999999"] {
        let headers = [TUS, ("upload-offset", wrong), ("content-type", OFFSET_OCTET_STREAM)];
        bench.request(Method::PATCH, &path, &headers, "abcd").await.problem(400, "parameter_invalid");
        bench
            .request(Method::POST, "/v1/uploads", &[TUS, ("upload-length", wrong)], "")
            .await
            .problem(400, "parameter_invalid");
    }
    assert_eq!(offset(&bench, &path).await, "0");
}

#[tokio::test]
async fn the_protocol_is_told_and_another_version_refused() {
    let bench = Bench::new();
    let spoken = bench.request(Method::OPTIONS, "/v1/uploads", &[], "").await;
    assert_eq!(spoken.status, StatusCode::NO_CONTENT);
    assert_eq!((spoken.header("tus-version"), spoken.header("tus-max-size")), ("1.0.0", &*LIMIT.to_string()));
    assert_eq!(spoken.header("tus-extension"), "creation,expiration,termination");
    for version in ["0.2.2", "none"] {
        let headers = [("tus-resumable", version), ("upload-length", "1")];
        let refused = bench.request(Method::POST, "/v1/uploads", &headers, "").await;
        refused.problem(412, "parameter_invalid");
        assert_eq!((refused.header("tus-version"), refused.header("tus-resumable")), ("1.0.0", "1.0.0"));
    }
    let length = (LIMIT + 1).to_string();
    let large = bench.request(Method::POST, "/v1/uploads", &[TUS, ("upload-length", &length)], "").await;
    large.problem(413, "body_too_large");
    let said = [TUS, ("upload-length", "1"), ("upload-metadata", "filename aGVhZC5vYmo=,is_scan")];
    let path = bench.request(Method::POST, "/v1/uploads", &said, "").await.header("location").to_owned();
    let head = bench.request(Method::HEAD, &path, &[TUS], "").await;
    assert_eq!(head.header("upload-metadata"), said[2].1);
    for wrong in ["a b c", "a *", "a,a", ",", ""] {
        let headers = [TUS, ("upload-length", "1"), ("upload-metadata", wrong)];
        bench.request(Method::POST, "/v1/uploads", &headers, "").await.problem(400, "parameter_invalid");
    }
}

#[tokio::test]
async fn one_caller_is_told_to_wait_before_all_room_is_taken() {
    let bench = Bench::new();
    for _ in 0..4 {
        begun(&bench, LIMIT as usize).await;
    }
    let refused = bench.request(Method::POST, "/v1/uploads", &[TUS, ("upload-length", "1")], "").await;
    refused.problem(429, "overloaded");
    assert!(!refused.header("retry-after").is_empty());
}

#[tokio::test]
async fn an_upload_is_its_callers_own_and_the_foreign_answers_as_the_absent() {
    let closed = Closed::new().await;
    let bearer = |token: &str| format!("Bearer {token}");
    let (ann, bob, admin) = (bearer(&closed.ann), bearer(&closed.bob), bearer(&closed.admin));
    let ask = async |who: &str, method: Method, path: &str, body: &'static str| {
        let kind = if body.is_empty() { "application/octet-stream" } else { OFFSET_OCTET_STREAM };
        let headers =
            [TUS, ("authorization", who), ("upload-length", "14"), ("upload-offset", "0"), ("content-type", kind)];
        closed.bench.request(method, path, &headers, body).await
    };
    let path = ask(&ann, Method::POST, "/v1/uploads", "").await.header("location").to_owned();
    let absent = format!("/v1/uploads/{}", quadmuse_proto::UploadId::generate());
    // An answer to HEAD has no body to compare.
    for path in [&path, &absent] {
        assert_eq!(ask(&bob, Method::HEAD, path, "").await.status, StatusCode::NOT_FOUND);
    }
    for (method, body) in [(Method::PATCH, MESH), (Method::DELETE, "")] {
        let foreign = ask(&bob, method.clone(), &path, body).await;
        let none = ask(&bob, method, &absent, body).await;
        assert_eq!(super::access::shape(&foreign, id(&path)), super::access::shape(&none, id(&absent)));
        assert_eq!(foreign.status, StatusCode::NOT_FOUND);
    }
    assert_eq!(ask(&ann, Method::PATCH, &path, MESH).await.status, StatusCode::NO_CONTENT);
    let used = format!("/v1/queries?upload={}", id(&path));
    ask(&bob, Method::POST, &used, "").await.problem(404, "not_found");
    // A reader asks with it, and adds nothing by it.
    ask(&ann, Method::POST, &format!("/v1/examples?upload={}", id(&path)), "").await.problem(403, "forbidden");
    assert_eq!(ask(&ann, Method::POST, &used, "").await.status, StatusCode::ACCEPTED);
    assert_eq!(ask(&admin, Method::HEAD, &path, "").await.status, StatusCode::OK);
    let nobody = closed.bench.request(Method::POST, "/v1/uploads", &[TUS, ("upload-length", "1")], "").await;
    nobody.problem(401, "unauthorized");
}
