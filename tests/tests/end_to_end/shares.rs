//! Servers that hold one corpus in memory together. Left out where there is no `nats-server`.

use crate::{Place, cluster::join_with, listed, nodes::Nodes, text};
use quadmuse_proto::{ExampleId, Share};
use quadmuse_tests::{
    http,
    server::Server,
    shapes::{self, Faces},
};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Longest time for a query to end.
const ENDS_WITHIN: Duration = Duration::from_secs(60);

fn get(server: &Server, path: &str) -> Value {
    serde_json::from_str(&http::get(server.address(), path).expect("answered").text()).expect("JSON")
}

/// The query once it has ended, and its ranking.
fn ranked(server: &Server, mesh: &str) -> (Value, Value) {
    let posted = http::post(server.address(), "/v1/queries?resolution=64", "model/obj", mesh.as_bytes());
    let posted = posted.expect("answered");
    assert_eq!(posted.status, 202, "{}", posted.text());
    let path = posted.header("location").expect("an address").to_owned();
    let begun = Instant::now();
    loop {
        let query = get(server, &path);
        match text(&query, "state") {
            "done" => return (query, get(server, &format!("{path}/ranking?limit=500"))),
            state => assert!(begun.elapsed() < ENDS_WITHIN && state != "failed", "{query}"),
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn three_servers_with_a_third_each_answer_as_one_does_and_say_what_is_missing_when_one_is_killed() {
    let Some(nodes) = Nodes::start(3) else { return };
    let places: Vec<Place> = (0..6).map(|_| Place::new()).collect();
    let (mut whole, client) = join_with(&nodes, &places[0].data(), &[]);
    let add = |kind: u32| {
        let mesh = shapes::vase(kind % 6, 12 + kind, 8, Faces::Quads);
        let file = places[0].file(&format!("v{kind}.obj"), &mesh);
        client.run(["add".as_ref(), file.as_os_str()]).expect("it runs").ok().expect("added");
    };
    (0..12).for_each(add);
    // Ids fall where they may: once in some forty runs a third would have none of a dozen.
    let shares = ["1/3", "2/3", "3/3"].map(|share| share.parse::<Share>().expect("a share"));
    let ids = || listed(&client).into_iter().map(|id| id.parse().expect("an id")).collect::<Vec<ExampleId>>();
    let is_spread = || shares.iter().all(|share| ids().iter().any(|id| share.holds(*id)));
    (12..36).take_while(|_| !is_spread()).for_each(add);
    let count = ids().len();
    let holding =
        |place: &Place, share: &str| join_with(&nodes, &place.data(), &[&format!("QUADMUSE_SHARD={share}")]).0;
    let mut servers: Vec<Server> = (1..=3).map(|number| holding(&places[number], &format!("{number}/3"))).collect();
    let scan = shapes::vase(3, 24, 10, Faces::Triangles);
    let (query, ranking) = ranked(&whole, &scan);
    assert_eq!(ranking["corpus_size"], count, "{ranking}");
    // From here on nobody holds everything.
    whole.terminate(ENDS_WITHIN).expect("terminated");
    for server in &servers {
        let (its_query, its) = ranked(server, &scan);
        assert_eq!(its["entries"].to_string(), ranking["entries"].to_string());
        assert_eq!((&its["corpus_size"], &its["incomplete"]), (&ranking["corpus_size"], &Value::Null));
        assert_eq!((&its_query["corpus_size"], &its_query["incomplete"]), (&query["corpus_size"], &Value::Null));
        // It has the pictures of its own share alone; what is known of the others is there, too.
        assert_eq!(get(server, "/readyz")["segments"], count);
    }

    servers.remove(1).kill().expect("killed");
    for server in &servers {
        let (query, ranking) = ranked(server, &scan);
        assert_eq!((&query["incomplete"], &ranking["incomplete"]), (&json!(["2/3"]), &json!(["2/3"])));
        assert!(ranking["entries"].as_array().is_some_and(|entries| (1..=count).contains(&entries.len())), "{ranking}");
    }
    // Two that hold it stand in for each other.
    let twins = [holding(&places[4], "2/3"), holding(&places[5], "2/3")];
    for _ in 0..2 {
        assert_eq!(ranked(&servers[0], &scan).1["entries"].to_string(), ranking["entries"].to_string());
    }
    let [one, _other] = twins;
    one.kill().expect("killed");
    for _ in 0..2 {
        let its = ranked(&servers[1], &scan).1;
        assert_eq!((its["entries"].to_string(), &its["incomplete"]), (ranking["entries"].to_string(), &Value::Null));
    }
}
