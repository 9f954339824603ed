//! Who may do what: roles, what is one's own, tokens over HTTP, the audit log.

use super::*;
use crate::auth::Role;
use quadmuse_proto::NewToken;
use serde_json::json;

/// A service with tokens: two readers, a contributor and an admin.
pub(super) struct Closed {
    pub(super) bench: Bench,
    pub(super) ann: String,
    pub(super) bob: String,
    contributor: String,
    pub(super) admin: String,
}

impl Closed {
    pub(super) async fn new() -> Self {
        let bench = Bench::stocked().await;
        let tokens = Tokens::beside(bench.dir.path());
        let create = |role, name: &str| {
            tokens.create(&NewToken { role, name: name.into(), ..NewToken::default() }).expect("created").0
        };
        let (ann, bob) = (create(Role::Reader, "ann"), create(Role::Reader, "bob"));
        let (contributor, admin) = (create(Role::Contributor, "con"), create(Role::Admin, "ada"));
        // The service looks at the list once a second.
        tokio::time::sleep(crate::auth::RELOAD).await;
        Self { bench, ann, bob, contributor, admin }
    }

    async fn ask(&self, token: &str, method: Method, path: &str, body: &str) -> Answer {
        let bearer = format!("Bearer {token}");
        let kind = if body.starts_with('{') { "application/json" } else { "application/octet-stream" };
        let headers = [("authorization", bearer.as_str()), ("content-type", kind), ("idempotency-key", "k")];
        self.bench.request(method, path, &headers, body.to_owned()).await
    }

    async fn get(&self, token: &str, path: &str) -> Answer {
        self.ask(token, Method::GET, path, "").await
    }

    async fn query(&self, token: &str, mesh: &str) -> String {
        let answer = self.ask(token, Method::POST, "/v1/queries", mesh).await;
        assert_eq!(answer.status, StatusCode::ACCEPTED, "{}", answer.text());
        answer.header("location").to_owned()
    }
}

/// What an answer says, without what differs between any two.
pub(super) fn shape(answer: &Answer, id: &str) -> (u16, String) {
    let mut problem = answer.json();
    problem["request_id"] = json!(null);
    (answer.status.as_u16(), problem.to_string().replace(id, "ID"))
}

#[tokio::test]
async fn a_reader_sees_and_deletes_only_their_own_and_the_foreign_answers_as_the_absent() {
    let closed = Closed::new().await;
    let query = closed.query(&closed.ann, "segment disc 1").await;
    let id = query.rsplit('/').next().expect("an id").to_owned();
    let absent = quadmuse_proto::QueryId::generate().to_string();
    let below = [
        "",
        "/mesh",
        "/ranking",
        "/stream",
        "/maps",
        "/maps/01ARZ3NDEKTSV4RRFFQ69G5FAV",
        "/maps/01ARZ3NDEKTSV4RRFFQ69G5FAV/stream",
        "/compositions",
        "/compositions/01ARZ3NDEKTSV4RRFFQ69G5FAV/stream",
        "/retopos",
        "/retopos/01ARZ3NDEKTSV4RRFFQ69G5FAV/stream",
    ];
    // An escaped letter is the same address.
    let escaped = format!("%{:02X}{}", id.as_bytes()[0], &id[1..]);
    for spelt in [&id, &escaped] {
        for path in below {
            let foreign = closed.get(&closed.bob, &format!("/v1/queries/{spelt}{path}")).await;
            let none = closed.get(&closed.bob, &format!("/v1/queries/{absent}{path}")).await;
            assert_eq!(shape(&foreign, &id), shape(&none, &absent), "{path}");
            assert_eq!(foreign.status, StatusCode::NOT_FOUND);
        }
        for (method, path, body) in [
            (Method::DELETE, "", ""),
            (Method::PATCH, "", r#"{"segments": [{"segment": 0, "name": "theirs"}]}"#),
            (Method::DELETE, "/maps/01ARZ3NDEKTSV4RRFFQ69G5FAV", ""),
            (Method::POST, "/maps", r#"{"segment": 0, "example": "01ARZ3NDEKTSV4RRFFQ69G5FAV", "example_segment": 0}"#),
            (Method::POST, "/compositions", r#"{"parts": []}"#),
            (Method::POST, "/retopos", "{}"),
        ] {
            let foreign = closed.ask(&closed.bob, method, &format!("/v1/queries/{spelt}{path}"), body).await;
            foreign.problem(404, "not_found");
        }
    }
    for (who, count) in [(&closed.ann, 1), (&closed.bob, 0), (&closed.contributor, 0), (&closed.admin, 1)] {
        let list = closed.get(who, "/v1/queries").await.json();
        assert_eq!(list["items"].as_array().map(Vec::len), Some(count));
    }
    let theirs = closed.get(&closed.admin, &query).await;
    assert!(theirs.status == StatusCode::OK && theirs.json()["segments"][0]["name"].is_null(), "{}", theirs.text());
    assert_eq!(closed.ask(&closed.ann, Method::DELETE, &query, "").await.status, StatusCode::NO_CONTENT);
}

#[tokio::test]
async fn an_idempotency_key_is_its_callers_own() {
    let closed = Closed::new().await;
    let first = closed.query(&closed.ann, "segment disc 1").await;
    assert_eq!(closed.query(&closed.ann, "segment disc 1").await, first);
    assert_ne!(closed.query(&closed.bob, "segment disc 1").await, first);
    let other = closed.ask(&closed.bob, Method::POST, "/v1/queries", "segment disc 2").await;
    other.problem(409, "conflict");
}

#[tokio::test]
async fn an_admin_creates_limits_lists_and_revokes_tokens() {
    let closed = Closed::new().await;
    for token in [&closed.ann, &closed.contributor] {
        closed.get(token, "/v1/tokens").await.problem(403, "forbidden");
        closed.ask(token, Method::POST, "/v1/tokens", r#"{"role": "admin"}"#).await.problem(403, "forbidden");
    }
    let wish = r#"{"name": "eve", "role": "contributor", "expires_in_s": 3600, "quota": {"jobs": 2}}"#;
    let made = closed.ask(&closed.admin, Method::POST, "/v1/tokens", wish).await;
    assert_eq!(made.status, StatusCode::CREATED, "{}", made.text());
    let (made, at) = (made.json(), made.header("location").to_owned());
    let secret = made["secret"].as_str().expect("a secret");
    assert_eq!((&made["token"]["name"], &made["token"]["quota"]["jobs"]), (&json!("eve"), &json!(2)));
    assert_eq!(closed.get(secret, "/v1/examples").await.status, StatusCode::OK);
    let list = closed.get(&closed.admin, "/v1/tokens").await;
    assert!(!list.text().contains(secret) && !list.text().contains("hash"));
    assert_eq!(list.json()["items"].as_array().map(Vec::len), Some(5));
    let changed = closed.ask(&closed.admin, Method::PATCH, &at, r#"{"quota": {"requests_per_second": 9}}"#).await;
    assert_eq!(changed.json()["quota"], json!({"requests_per_second": 9}));
    assert_eq!(closed.ask(&closed.admin, Method::DELETE, &at, "").await.status, StatusCode::NO_CONTENT);
    closed.get(secret, "/v1/examples").await.problem(401, "unauthorized");
    closed.ask(&closed.admin, Method::DELETE, &at, "").await.problem(404, "not_found");
    let typo = closed.ask(&closed.admin, Method::POST, "/v1/tokens", r#"{"name": "a\nb"}"#).await;
    typo.problem(400, "parameter_invalid");
}

#[tokio::test]
async fn an_open_service_has_no_admin() {
    let bench = Bench::new();
    bench.get("/v1/tokens").await.problem(403, "forbidden");
    bench.post_json("/v1/tokens", json!({"role": "admin"})).await.problem(403, "forbidden");
    assert_eq!(bench.get("/v1/examples").await.status, StatusCode::OK);
}

#[tokio::test]
async fn a_service_that_loses_its_list_lets_in_nobody() {
    let closed = Closed::new().await;
    assert_eq!(closed.get(&closed.admin, "/v1/examples").await.status, StatusCode::OK);
    std::fs::remove_file(closed.bench.dir.path().join("tokens.json")).expect("removed");
    tokio::time::sleep(crate::auth::RELOAD).await;
    for path in ["/v1/examples", "/v1/queries", "/metrics"] {
        closed.bench.get(path).await.problem(401, "unauthorized");
        closed.get(&closed.admin, path).await.problem(401, "unauthorized");
    }
    assert_eq!(closed.bench.get("/healthz").await.status, StatusCode::OK);
}

#[tokio::test]
async fn whatever_is_no_mere_read_is_in_the_audit_log() {
    let closed = Closed::new().await;
    closed.get(&closed.ann, "/v1/examples").await;
    let made = closed.ask(&closed.contributor, Method::POST, "/v1/examples", "segment disc 9").await;
    closed.ask(&closed.ann, Method::DELETE, made.header("location"), "").await.problem(403, "forbidden");
    closed.ask("qm_wrong", Method::POST, "/v1/queries", "segment disc 1").await.problem(401, "unauthorized");
    let path = closed.bench.dir.path().join(crate::audit::FILE);
    let lines = || -> Vec<Value> {
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        text.lines()
            .filter_map(|line| serde_json::from_str(line).ok())
            .filter(|l: &Value| l["user"] != "open")
            .collect()
    };
    let begun = Instant::now();
    while lines().len() < 3 && begun.elapsed() < Duration::from_secs(10) {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    let logged: Vec<_> =
        lines().iter().map(|l| (l["name"].clone(), l["action"].clone(), l["status"].clone())).collect();
    let expected = [("con", "POST", 201), ("ann", "DELETE", 403), ("", "POST", 401)];
    assert_eq!(logged, expected.map(|(name, action, status)| (json!(name), json!(action), json!(status))));
    assert_eq!(lines()[0]["made"], json!(made.header("location")));
    assert!(!std::fs::read_to_string(&path).expect("a log").contains("qm_"));
}

#[tokio::test]
async fn names_and_tags_are_free_of_control_and_direction_characters() {
    let bench = Bench::new();
    for bad in ["name=a%0ab", "name=%1b%5b2J", "name=%e2%80%aegnp.exe", "tag=%e2%81%a6x", "tag=a%00"] {
        let detail =
            bench.post(&format!("/v1/examples?{bad}"), "segment disc 1").await.problem(400, "parameter_invalid");
        assert!(detail.contains("U+"), "{detail}");
    }
    let id = bench.add("%E9%A6%AC", "segment disc 1").await;
    let path = format!("/v1/examples/{id}");
    let kind = [("content-type", "application/json")];
    let patch = bench.request(Method::PATCH, &path, &kind, json!({"name": "a\u{202e}b"}).to_string()).await;
    patch.problem(400, "parameter_invalid");
    assert_eq!(bench.get(&path).await.json()["name"], "馬");
}

#[tokio::test]
async fn only_an_admin_checks_backs_up_and_sees_how_the_service_is() {
    let closed = Closed::new().await;
    for (method, path) in
        [(Method::GET, "/v1/admin/status"), (Method::POST, "/v1/admin/check"), (Method::GET, "/v1/admin/backup")]
    {
        closed.ask(&closed.contributor, method.clone(), path, "").await.problem(403, "forbidden");
        closed.bench.request(method.clone(), path, &[], Body::empty()).await.problem(401, "unauthorized");
        let answer = closed.ask(&closed.admin, method, path, "").await;
        assert_eq!(answer.status, StatusCode::OK, "{path}: {}", answer.text());
    }
    let status = closed.get(&closed.admin, "/v1/admin/status").await.json();
    assert_eq!(status["memory_limit_bytes"], json!(64 << 20));
    assert!(status["memory_allocated_bytes"].as_u64().is_some_and(|bytes| bytes > 1 << 20), "{status}");
}
