//! Several servers that hold one corpus in memory together: the answer is that of one server, or says what it is without.

use super::forward::{Server, Shared};
use super::*;
use quadmuse_proto::{ExampleId, Share};

fn share(text: &str) -> Share {
    text.parse().expect("a share")
}

/// A corpus of so many examples.
async fn stocked(count: usize) -> Arc<MemoryCorpus> {
    let corpus: Arc<MemoryCorpus> = Arc::default();
    let dir = tempfile::tempdir().expect("a directory");
    let together = ClusterHandles {
        kept: KeptQueries::on(Arc::new(Files::beside(dir.path()))),
        peers: None,
        signs: Arc::default(),
    };
    let bench = Bench::holding(None, Arc::clone(&corpus), Admission::new(64 << 20, 32), dir, together);
    for number in 1..=count {
        let tag = if number % 2 == 0 { "even" } else { "odd" };
        let path = format!("/v1/examples?name=e{number}&tag={tag}");
        let answer = bench.post(&path, &format!("segment disc {number}")).await;
        assert_eq!(answer.status, StatusCode::CREATED, "{}", answer.text());
    }
    corpus
}

/// The query once it has ended, and its ranking.
async fn ranked(server: &Server, options: &str) -> (Value, Value) {
    let answer = server.ask(Method::POST, &format!("/v1/queries{options}"), &[], "segment disc 7").await;
    assert_eq!(answer.status, StatusCode::ACCEPTED, "{}", answer.text());
    let path = answer.header("location").to_owned();
    let query = server.bench.ended(&path).await;
    (query, server.get(&format!("{path}/ranking?limit=500")).await.json())
}

fn ids(ranking: &Value) -> Vec<ExampleId> {
    let entries = ranking["entries"].as_array().expect("entries").iter();
    let id = |entry: &Value| entry["example"].as_str().and_then(|id| id.parse().ok()).expect("an id");
    entries.map(id).filter(|id| *id != ExampleId::TEMPLATE).collect()
}

#[tokio::test]
async fn three_servers_with_a_share_each_answer_bit_for_bit_as_one_with_everything() {
    let (shared, corpus) = (Shared::new(), stocked(60).await);
    let alone = Shared::new().holding(None, Arc::clone(&corpus)).await;
    let mut servers = Vec::new();
    for text in ["1/3", "2/3", "3/3"] {
        servers.push(shared.holding(Some(share(text)), Arc::clone(&corpus)).await);
    }
    for options in ["", "?tag=even", "?top=9&resolution=64"] {
        let (query, whole) = ranked(&alone, options).await;
        assert!(ids(&whole).len() >= 30, "{whole}");
        for server in &servers {
            let (its_query, its) = ranked(server, options).await;
            // As texts: numbers are equal to the last bit.
            assert_eq!(its["entries"].to_string(), whole["entries"].to_string(), "{options}");
            assert_eq!(its["corpus_size"], whole["corpus_size"]);
            assert_eq!(its_query["corpus_size"], query["corpus_size"]);
            assert!(its.get("incomplete").is_none() && its_query.get("incomplete").is_none(), "{its_query}");
        }
    }
    let held: Vec<usize> = servers.iter().map(held_of).collect();
    assert_eq!(held.iter().sum::<usize>(), 60);
    assert!(held.iter().all(|held| *held < 60), "{held:?}");
}

/// Pictures that a server has in memory.
fn held_of(server: &Server) -> usize {
    use crate::work::catalogue::Stock;
    let snapshot = server.bench.work.catalogue.snapshot();
    let blocks = snapshot.row_blocks(quadmuse_proto::Topology::Disc, Stock::Wholes);
    let chunks = blocks.map(|blocks| blocks.chunks().iter()).into_iter().flatten();
    chunks.map(|chunk| chunk.residents().iter().flatten().count()).sum()
}

#[tokio::test]
async fn a_share_that_nobody_answers_for_is_told_and_the_rest_is_ranked() {
    let (shared, corpus) = (Shared::new(), stocked(40).await);
    let one = shared.holding(Some(share("1/3")), Arc::clone(&corpus)).await;
    let two = shared.holding(Some(share("2/3")), Arc::clone(&corpus)).await;
    let _three = shared.holding(Some(share("3/3")), Arc::clone(&corpus)).await;
    let all = ids(&ranked(&one, "").await.1);
    two.die().await;

    let (query, ranking) = ranked(&one, "").await;
    assert_eq!(query["incomplete"], serde_json::json!(["2/3"]), "{query}");
    assert_eq!(ranking["incomplete"], serde_json::json!(["2/3"]), "{ranking}");
    let left: Vec<ExampleId> = all.iter().copied().filter(|id| !share("2/3").holds(*id)).collect();
    assert!(left.len() < all.len() && !left.is_empty());
    assert_eq!(ids(&ranking), left);
    let metrics = one.get("/metrics").await.text();
    assert!(metrics.contains("quadmuse_shares_asked_total{outcome=\"missing\"}"), "{metrics}");
}

#[tokio::test]
async fn servers_with_the_same_share_stand_in_for_each_other() {
    let (shared, corpus) = (Shared::new(), stocked(40).await);
    let one = shared.holding(Some(share("1/2")), Arc::clone(&corpus)).await;
    let two = shared.holding(Some(share("2/2")), Arc::clone(&corpus)).await;
    let twin = shared.holding(Some(share("2/2")), Arc::clone(&corpus)).await;
    let whole = ranked(&one, "").await.1;
    two.die().await;
    // Whoever's turn it is.
    for _ in 0..3 {
        let (query, ranking) = ranked(&one, "").await;
        assert!(query.get("incomplete").is_none(), "{query}");
        assert_eq!(ranking["entries"].to_string(), whole["entries"].to_string());
    }
    twin.die().await;
    assert_eq!(ranked(&one, "").await.0["incomplete"], serde_json::json!(["2/2"]));
    // Whoever holds everything answers for any share.
    let _whole = shared.holding(None, Arc::clone(&corpus)).await;
    let (query, ranking) = ranked(&one, "").await;
    assert!(query.get("incomplete").is_none(), "{query}");
    assert_eq!(ranking["entries"].to_string(), whole["entries"].to_string());
}

#[tokio::test]
async fn what_was_added_or_removed_through_one_server_is_ranked_so_by_all() {
    let (shared, corpus) = (Shared::new(), stocked(10).await);
    let one = shared.holding(Some(share("1/2")), Arc::clone(&corpus)).await;
    let two = shared.holding(Some(share("2/2")), Arc::clone(&corpus)).await;
    let mut added = Vec::new();
    // Ids fall to the shares by chance: of ten all may fall to one.
    let has_both = |added: &[ExampleId]| ["1/2", "2/2"].iter().all(|of| added.iter().any(|id| share(of).holds(*id)));
    for number in 100..130 {
        if added.len() >= 10 && has_both(&added) {
            break;
        }
        added.push(one.bench.add("late", &format!("segment disc {number}")).await.parse::<ExampleId>().expect("an id"));
    }
    assert!(has_both(&added));
    let found = ids(&ranked(&one, "").await.1);
    assert!(added.iter().all(|id| found.contains(id)), "{found:?}");
    two.bench.work.catalogue.follow();
    let found = ids(&ranked(&two, "").await.1);
    assert!(added.iter().all(|id| found.contains(id)), "{found:?}");
    for id in &added {
        let gone = one.ask(Method::DELETE, &format!("/v1/examples/{id}"), &[], Body::empty()).await;
        assert_eq!(gone.status, StatusCode::NO_CONTENT);
    }
    assert_eq!(ids(&ranked(&one, "").await.1).len(), 10);
}

#[tokio::test]
async fn only_servers_of_the_corpus_are_answered_and_only_what_they_asked() {
    let (shared, corpus) = (Shared::new(), stocked(3).await);
    let server = shared.holding(Some(share("1/2")), corpus).await;
    let other = shared.join("http://other:1", Some(share("2/2")));
    let to = server.bench.work.server.expect("a number");
    let target = |question: &[u8]| format!("/peers/share?question={}", blake3::hash(question).to_hex());
    server.ask(Method::POST, &target(b"x"), &[], "x").await.problem(404, "not_found");
    let sealed = other.seal(to, None, "POST", &target(b"x"));
    let headers = [("quadmuse-passed", sealed.as_str())];
    // The question is another than the one that was sealed.
    server.ask(Method::POST, &target(b"x"), &headers, "y").await.problem(404, "not_found");
    server.ask(Method::POST, &target(b"y"), &headers, "y").await.problem(404, "not_found");
    // Sealed, and no question.
    server.ask(Method::POST, &target(b"x"), &headers, "x").await.problem(400, "parameter_invalid");
    let stranger = Shared::new().join("http://other:1", None).seal(to, None, "POST", &target(b"x"));
    server.ask(Method::POST, &target(b"x"), &[("quadmuse-passed", &stranger)], "x").await.problem(404, "not_found");
}
