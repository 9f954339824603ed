//! Maps, constraints and compositions.

use super::*;
use serde_json::json;

/// A service, a finished query and the id of the example `b`.
async fn mapped() -> (Bench, String, String) {
    let bench = Bench::stocked().await;
    let path = bench.query("top=1", "segment disc 2\nsegment disc 3").await;
    bench.ended(&path).await;
    let entries = bench.get(&format!("{path}/ranking")).await.json()["entries"].clone();
    let example = entries.as_array().expect("entries").iter().find(|e| e["name"] == "a").expect("a")["example"].clone();
    (bench, path, example.as_str().expect("an id").to_owned())
}

#[tokio::test]
async fn a_locked_example_is_resumed_and_mapped() {
    let (bench, path, example) = mapped().await;
    let made = bench.post_json(&format!("{path}/maps?wait=60"), json!({"segment": 0, "example": example})).await;
    assert_eq!(made.status, StatusCode::CREATED, "{}", made.text());
    let map = made.json();
    let address = made.header("location").to_owned();
    assert_eq!(address, format!("{path}/maps/{}", map["id"].as_str().expect("an id")));
    assert_eq!((&map["resolution"], &map["verdict"], &map["revision"]), (&json!(128), &json!("good"), &json!(1)));
    assert_eq!(bench.get(&address).await.json(), map);
    assert_eq!(bench.get(&format!("{address}/mesh?format=obj")).await.text(), "obj with 1 faces");
    assert!(bench.get(&format!("{address}/preview.png?size=32")).await.bytes.starts_with(b"\x89PNG"));
    let ranking = bench.get(&format!("{path}/ranking")).await.json();
    let entry =
        ranking["entries"].as_array().expect("entries").iter().find(|e| e["example"] == example.as_str()).expect("a");
    assert_eq!((&entry["state"], &entry["resolution"]), (&json!("done"), &json!(128)));
    assert_eq!(bench.get(&format!("{path}/maps")).await.json()["items"][0], map);
}

#[tokio::test]
async fn a_mesh_is_sent_in_the_size_that_is_asked_for() {
    let (bench, path, example) = mapped().await;
    let made = bench.post_json(&format!("{path}/maps?wait=60"), json!({"segment": 0, "example": example})).await;
    let address = made.header("location").to_owned();
    let sized = bench.get(&format!("{address}/mesh?quads=600")).await;
    // The engine of these tests leaves meshes as they are, and says so.
    assert_eq!(
        (sized.status, sized.header("quadmuse-faces"), sized.header("quadmuse-within")),
        (StatusCode::OK, "1", "0.0000")
    );
    let near = bench.get(&format!("{address}/mesh?tolerance=0.5&format=ply")).await;
    assert_eq!((near.status, near.text().as_str()), (StatusCode::OK, "ply with 1 faces"));
    assert_ne!(sized.header("etag"), near.header("etag"));
    for refused in ["quads=5", "quads=1000001", "quads=many", "tolerance=0", "tolerance=NaN", "quads=9&tolerance=1"] {
        let answer = bench.get(&format!("{address}/mesh?{refused}")).await;
        assert_eq!(answer.status, StatusCode::BAD_REQUEST, "{refused}: {}", answer.text());
    }
}

/// Asks until what is made under an address is over.
async fn over(bench: &Bench, address: &str) -> Value {
    loop {
        let now = bench.get(&format!("{address}?wait=1")).await.json();
        if !["queued", "running"].contains(&now["state"].as_str().expect("a state")) {
            return now;
        }
    }
}

#[tokio::test]
async fn long_work_is_answered_at_once_and_told_of_until_it_is_there() {
    let bench = Bench::stocked().await;
    let path = bench.query("top=1&resolution=32", "segment disc 2\nslow 150").await;
    bench.ended(&path).await;
    let example = bench.get(&format!("{path}/ranking")).await.json()["entries"][0]["example"].clone();
    for (product, of, body) in [
        ("map", "maps", json!({"example": example})),
        ("composition", "compositions", json!({})),
        ("retopo", "retopos", json!({})),
    ] {
        // What was laid for the one before would be there at once.
        for map in bench.get(&format!("{path}/maps")).await.json()["items"].as_array().expect("maps") {
            let address = format!("{path}/maps/{}", map["id"].as_str().expect("an id"));
            bench.request(Method::DELETE, &address, &[], Body::empty()).await;
        }
        let asked = bench.post_json(&format!("{path}/{of}"), body).await;
        assert_eq!(asked.status, StatusCode::ACCEPTED, "{}", asked.text());
        let (making, address) = (asked.json(), asked.header("location").to_owned());
        assert_eq!(address, format!("{path}/{of}/{}", making["id"].as_str().expect("an id")));
        let state = making["state"].as_str().expect("a state");
        assert!(["queued", "running"].contains(&state) && making["progress"].as_f64() < Some(1.0), "{making}");
        assert_eq!(making["product"], product);
        let listed = bench.get(&path).await.json()["making"][0].clone();
        assert_eq!((&listed["id"], &listed["stage"].is_string()), (&making["id"], &true));
        // Its stream goes on to its end, and is there afterwards, too.
        let lines = [("accept", "application/x-ndjson")];
        let stream = format!("{address}/stream");
        let events = bench.request(Method::GET, &stream, &lines, Body::empty()).await.text();
        let last: Value = serde_json::from_str(events.lines().last().expect("a line")).expect("JSON");
        assert_eq!((&last["event"], &last["state"], &last["id"]), (&json!("end"), &json!("done"), &making["id"]));
        assert!(events.lines().count() > 1 && events.contains(r#""event":"progress""#), "{events}");
        let made = over(&bench, &address).await;
        assert_eq!(
            (&made["state"], &made["progress"], &made["verdict"]),
            (&json!("done"), &json!(1.0), &json!("good"))
        );
        assert_eq!(bench.get(&path).await.json().get("making"), None);
        let again = bench.request(Method::GET, &stream, &lines, Body::empty()).await.text();
        assert_eq!(again.lines().count(), 1, "{again}");
        assert!(bench.get(&format!("{path}/{of}")).await.text().contains(making["id"].as_str().expect("an id")));
        let gone = bench.request(Method::DELETE, &address, &[], Body::empty()).await;
        assert_eq!(gone.status, StatusCode::NO_CONTENT);
        bench.get(&address).await.problem(404, "not_found");
        bench.get(&stream).await.problem(404, "not_found");
        bench.request(Method::DELETE, &address, &[], Body::empty()).await.problem(404, "not_found");
    }
    let waited = bench.post_json(&format!("{path}/maps?wait=60"), json!({"example": example})).await;
    assert_eq!((waited.status, &waited.json()["state"]), (StatusCode::CREATED, &json!("done")));
    for wrong in ["wait=-1", "wait=x", "wait=nan", "wait=86401", "wait=1&wait=2"] {
        bench
            .post_json(&format!("{path}/maps?{wrong}"), json!({"example": example}))
            .await
            .problem(400, "parameter_invalid");
    }
}

#[tokio::test]
async fn what_belongs_to_a_map_that_is_made_waits_for_it() {
    let bench = Bench::stocked().await;
    let path = bench.query("top=1&resolution=32", "segment disc 2\nslow 100").await;
    bench.ended(&path).await;
    let example = bench.get(&format!("{path}/ranking")).await.json()["entries"][0]["example"].clone();
    let maps = format!("{path}/maps");
    let asked = async || bench.post_json(&maps, json!({"example": example})).await.json()["id"].clone();
    let id = asked().await;
    let mesh = bench.get(&format!("{maps}/{}/mesh", id.as_str().expect("an id"))).await;
    assert_eq!((mesh.status, mesh.text().as_str()), (StatusCode::OK, "obj with 1 faces"));
    let parts = json!({"parts": [{"segment": 0, "map": asked().await}]});
    let composed = bench.post_json(&format!("{path}/compositions?wait=60"), parts).await;
    assert_eq!(composed.status, StatusCode::CREATED, "{}", composed.text());
    // A composition is begun at once, and waits for its maps by itself; what only they can tell is told then.
    let compositions = format!("{path}/compositions");
    for (segment, state) in [(0, "done"), (1, "failed")] {
        let map = asked().await;
        let begun = bench.post_json(&compositions, json!({"parts": [{"segment": segment, "map": map}]})).await;
        assert_eq!(begun.status, StatusCode::ACCEPTED, "{}", begun.text());
        let ended = over(&bench, begun.header("location")).await;
        assert_eq!(ended["state"], state, "{ended}");
        if state == "failed" {
            assert_eq!(ended["problem"]["code"], "parameter_invalid", "{ended}");
        }
    }
}

#[tokio::test]
async fn what_is_made_is_cancelled_and_what_fails_tells_why() {
    let bench = Bench::stocked().await;
    let path = bench.query("top=1&resolution=64", "segment disc 2\nslow 200").await;
    bench.ended(&path).await;
    let maps = format!("{path}/maps");
    let late = bench.add("late", "segment disc 9\npanic refine").await;
    let example = bench.get(&format!("{path}/ranking")).await.json()["entries"][0]["example"].clone();
    let asked = bench.post_json(&maps, json!({"example": example})).await;
    let address = asked.header("location").to_owned();
    let delete = async || bench.request(Method::DELETE, &address, &[], Body::empty()).await;
    assert_eq!(delete().await.status, StatusCode::NO_CONTENT);
    let cancelled = bench.get(&address).await.json();
    assert_eq!((&cancelled["state"], &cancelled["stage"]), (&json!("cancelled"), &json!("cancelled")));
    let detail = bench.get(&format!("{address}/mesh")).await.problem(409, "conflict");
    assert!(detail.contains("cancelled"), "{detail}");
    assert_eq!(delete().await.status, StatusCode::NO_CONTENT);
    bench.get(&address).await.problem(404, "not_found");
    // The same as a refusal where the answer is held, and as a state where it is not.
    let wanted = json!({"example": late});
    let detail = bench.post_json(&format!("{maps}?wait=60"), wanted.clone()).await.problem(500, "internal");
    let asked = bench.post_json(&maps, wanted).await;
    assert_eq!(asked.status, StatusCode::ACCEPTED, "{}", asked.text());
    let failed = over(&bench, asked.header("location")).await;
    assert_eq!((&failed["state"], &failed["problem"]["detail"]), (&json!("failed"), &json!(detail)));
    assert_eq!(failed["problem"]["code"], "internal");
    // What is wrong from the first is refused at once.
    bench.post_json(&maps, json!({"example": late, "segment": 9})).await.problem(404, "not_found");
    let tube = bench.add("tube", "segment annulus 1").await;
    bench.post_json(&maps, json!({"example": tube})).await.problem(400, "parameter_invalid");
    // With its query all of it ends.
    let asked = bench.post_json(&maps, json!({"example": example})).await;
    bench.request(Method::DELETE, &path, &[], Body::empty()).await;
    bench.get(asked.header("location")).await.problem(404, "not_found");
}

#[tokio::test]
async fn so_many_are_made_of_a_query_at_a_time() {
    let bench = Bench::stocked().await;
    let path = bench.query("top=1&resolution=32", "segment disc 2\nslow 400").await;
    bench.ended(&path).await;
    let example = bench.get(&format!("{path}/ranking")).await.json()["entries"][0]["example"].clone();
    let maps = format!("{path}/maps");
    let mut refused = 0;
    for _ in 0..18 {
        let asked = bench.post_json(&maps, json!({"example": example})).await;
        if asked.status != StatusCode::ACCEPTED {
            asked.problem(503, "overloaded");
            assert!(!asked.header("retry-after").is_empty());
            refused += 1;
        }
    }
    assert_eq!(refused, 2);
    bench.request(Method::DELETE, &path, &[], Body::empty()).await;
}

#[tokio::test]
async fn what_is_not_there_is_not_mapped() {
    let (bench, path, example) = mapped().await;
    let maps = format!("{path}/maps?wait=60");
    let unknown = "01ARZ3NDEKTSV4RRFFQ69G5FAV";
    bench.post_json(&maps, json!({"segment": 9, "example": example})).await.problem(404, "not_found");
    bench.post_json(&maps, json!({"segment": 0, "example": unknown})).await.problem(404, "not_found");
    let wanted = json!({"segment": 0, "example": example, "example_segment": 3});
    bench.post_json(&maps, wanted).await.problem(404, "not_found");
    bench.post_json(&maps, json!({"segment": 0})).await.problem(400, "body_invalid");
    bench.post_json(&maps, json!({"example": "not an id"})).await.problem(400, "body_invalid");
    bench.get(&format!("{path}/maps/{unknown}")).await.problem(404, "not_found");
    bench
        .post_json(&format!("/v1/queries/{unknown}/maps"), json!({"example": example}))
        .await
        .problem(404, "not_found");
    let tube = bench.add("tube", "segment annulus 1").await;
    bench.post_json(&maps, json!({"example": tube})).await.problem(400, "parameter_invalid");
}

#[tokio::test]
async fn landmarks_of_the_example_are_found_by_their_names() {
    let (bench, path, example) = mapped().await;
    let maps = format!("{path}/maps?wait=60");
    let names = json!({"nose": [1, 2, 3], "chin": [4, 5, 6], "ear": {"u": 0.5, "v": 0.25}});
    let wanted = json!({"example": example, "names": names});
    let detail = bench.post_json(&maps, wanted.clone()).await.problem(400, "parameter_invalid");
    assert!(detail.contains("PATCH"), "{detail}");
    let kind = [("content-type", "application/json")];
    let landmarks =
        json!([{"name": "brow", "vertex": 0}, {"name": "chin", "vertex": 2}, {"name": "nose", "vertex": 1}]);
    let patch = json!({"landmarks": landmarks}).to_string();
    bench.request(Method::PATCH, &format!("/v1/examples/{example}"), &kind, patch).await;
    let made = bench.post_json(&maps, wanted).await;
    assert_eq!(made.status, StatusCode::CREATED, "{}", made.text());
    let ends =
        |constraint: &Value| (constraint["on_example"]["point"].clone(), constraint["on_input"]["point"].clone());
    let found: Vec<_> = made.json()["constraints"].as_array().expect("constraints").iter().map(ends).collect();
    let chin = (json!([1.0, 1.0, 0.0]), json!([4.0, 5.0, 6.0]));
    assert_eq!(found, [chin, (json!([1.0, 0.0, 0.0]), json!([1.0, 2.0, 3.0]))]);
    let wanted = json!({"example": example, "names": {"nostril": [0, 0, 0]}});
    let detail = bench.post_json(&maps, wanted).await.problem(400, "parameter_invalid");
    assert!(detail.contains("brow, chin, nose") && detail.contains("found nostril"), "{detail}");
    // Pairs alone will do, whatever else is named.
    let pair = json!({"on_example": [0, 0, 0], "on_input": [0, 0, 1]});
    let wanted = json!({"example": example, "names": {"nostril": [0, 0, 0]}, "landmarks": [pair]});
    assert_eq!(bench.post_json(&maps, wanted).await.json()["constraints"].as_array().map(Vec::len), Some(1));
    let many: serde_json::Map<String, Value> = (0..129).map(|k| (k.to_string(), json!([0, 0, 0]))).collect();
    bench.post_json(&maps, json!({"example": example, "names": many})).await.problem(400, "parameter_invalid");
    let template = json!({"example": quadmuse_proto::ExampleId::TEMPLATE, "names": names});
    bench.post_json(&maps, template).await.problem(400, "parameter_invalid");
}

#[tokio::test]
async fn an_example_added_after_the_query_can_be_mapped() {
    let (bench, path, _) = mapped().await;
    let late = bench.add("late", "segment disc 2.5").await;
    let made = bench.post_json(&format!("{path}/maps?wait=60"), json!({"example": late})).await;
    assert_eq!(made.status, StatusCode::CREATED, "{}", made.text());
}

#[tokio::test]
async fn constraints_are_edited_as_a_whole() {
    let (bench, path, example) = mapped().await;
    let made = bench.post_json(&format!("{path}/maps?wait=60"), json!({"example": example})).await;
    let address = format!("{}/constraints", made.header("location"));
    let edit = async |edit: Value| {
        let kind = [("content-type", "application/json")];
        bench.request(Method::PATCH, &address, &kind, edit.to_string()).await
    };
    let set = json!({"set": [{"on_example": [0, 0, 0], "on_input": {"u": 0.5, "v": 0.5}}]});
    let map = edit(set).await.json();
    assert_eq!((&map["revision"], map["constraints"].as_array().map(Vec::len)), (&json!(2), Some(1)));
    let id = map["constraints"][0]["id"].as_str().expect("an id").to_owned();
    edit(json!({"set": [{"on_example": [0, 0, 0], "on_input": {"u": 0, "v": 2}}], "remove": [id]}))
        .await
        .problem(422, "constraint_folds");
    edit(json!({"remove": ["nobody"]})).await.problem(404, "not_found");
    edit(json!({"put": []})).await.problem(400, "body_invalid");
    assert_eq!(bench.get(made.header("location")).await.json(), map);
    let many: Vec<Value> = (0..300).map(|_| json!({"on_example": [0, 0, 0], "on_input": [0, 0, 0]})).collect();
    edit(json!({"set": many})).await.problem(400, "parameter_invalid");
    assert_eq!(edit(json!({"remove": [id]})).await.json()["constraints"], json!([]));
}

#[tokio::test]
async fn maps_are_composed() {
    let (bench, path, example) = mapped().await;
    let mut parts = Vec::new();
    for segment in [0, 1] {
        let made =
            bench.post_json(&format!("{path}/maps?wait=60"), json!({"segment": segment, "example": example})).await;
        parts.push(json!({"segment": segment, "map": made.json()["id"]}));
    }
    let compositions = format!("{path}/compositions?wait=60");
    let made = bench.post_json(&compositions, json!({"parts": parts, "smoothing": 3})).await;
    assert_eq!(made.status, StatusCode::CREATED, "{}", made.text());
    let composition = made.json();
    assert_eq!(
        (&composition["quads"], &composition["triangles"], &composition["smoothing"]),
        (&json!(2), &json!(0), &json!(3))
    );
    assert_eq!(bench.get(made.header("location")).await.json(), composition);
    assert_eq!(bench.get(&format!("{}/mesh?format=obj", made.header("location"))).await.text(), "obj with 2 faces");
    let picture = format!("{}/preview.png", made.header("location"));
    assert!(bench.get(&format!("{picture}?size=32")).await.bytes.starts_with(b"\x89PNG"));
    bench.get(&format!("{picture}?size=2048")).await.problem(400, "parameter_invalid");
    // Segments that are not named take their best example.
    let filled = bench.post_json(&compositions, json!({})).await.json();
    assert_eq!(filled["parts"].as_array().map(Vec::len), Some(2));
    bench.post_json(&compositions, json!({"density": 9})).await.problem(400, "parameter_invalid");
    bench.post_json(&compositions, json!({"keep": [9]})).await.problem(404, "not_found");
    bench.post_json(&compositions, json!({"parts": parts, "smoothing": 1000})).await.problem(400, "parameter_invalid");
    let twice = json!({"parts": [parts[0], parts[0]]});
    bench.post_json(&compositions, twice).await.problem(400, "parameter_invalid");
    let crossed = json!({"parts": [{"segment": 1, "map": parts[0]["map"]}]});
    bench.post_json(&compositions, crossed).await.problem(400, "parameter_invalid");
    bench.get(&format!("{path}/compositions/01ARZ3NDEKTSV4RRFFQ69G5FAV")).await.problem(404, "not_found");
}

#[tokio::test]
async fn examples_on_which_a_composition_is_broken_give_way_unless_they_were_chosen() {
    let bench = Bench::stocked().await;
    let headline = |made: &Value| (made["verdict"].clone(), made["inspired"].clone());
    let path = bench.query("", "segment disc 2").await;
    bench.ended(&path).await;
    let sound = bench.post_json(&format!("{path}/compositions?wait=60"), json!({})).await.json();
    assert_eq!((headline(&sound), &sound["reasons"]), ((json!("good"), json!(1.0)), &json!([])));
    let path = bench.query("", "segment disc 2\ntears").await;
    bench.ended(&path).await;
    let mended = bench.post_json(&format!("{path}/compositions?wait=60"), json!({})).await.json();
    assert_eq!(headline(&mended), (json!("poor"), json!(0.0)), "{mended}");
    assert!(mended["reasons"][0].as_str().expect("a reason").starts_with("no example was used: "), "{mended}");
    let note = "examples gave way to regular layouts on segments 0: it is torn";
    assert_eq!((&mended["notes"], &mended["templates"]), (&json!([note]), &json!([0])), "{mended}");
    let chosen = bench.post_json(&format!("{path}/compositions?wait=60"), json!({"keep": [0]})).await.json();
    assert_eq!((headline(&chosen), &chosen["reasons"]), ((json!("broken"), json!(1.0)), &json!(["it is torn"])));
}

#[tokio::test]
async fn examples_that_make_a_poor_composition_give_way_to_a_regular_layout_unless_they_were_chosen() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 2\ncrumples").await;
    bench.ended(&path).await;
    let compositions = format!("{path}/compositions?wait=60");
    let regular = bench.post_json(&compositions, json!({})).await.json();
    let headline = |made: &Value| (made["verdict"].clone(), made["inspired"].clone(), made["templates"].clone());
    assert_eq!(headline(&regular), (json!("poor"), json!(0.0), json!([0])), "{regular}");
    assert_eq!(regular["parts"], json!([]), "{regular}");
    let note = regular["notes"].as_array().and_then(|all| all.last()?.as_str()).expect("a note");
    assert!(note.starts_with("examples gave way to a regular layout of all of it: 50 % of its area is"), "{regular}");
    let chosen = bench.post_json(&compositions, json!({"keep": [0]})).await.json();
    assert_eq!(headline(&chosen), (json!("poor"), json!(1.0), json!([])), "{chosen}");
    assert_eq!(chosen["parts"].as_array().map(Vec::len), Some(1), "{chosen}");
}

#[tokio::test]
async fn examples_stay_where_a_regular_layout_of_all_of_it_is_as_crumpled_beside_them() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 2\nbristles").await;
    bench.ended(&path).await;
    let made = bench.post_json(&format!("{path}/compositions?wait=60"), json!({})).await.json();
    assert_eq!((&made["verdict"], &made["inspired"]), (&json!("fair"), &json!(1.0)), "{made}");
    assert!(made["reasons"][0].as_str().expect("a reason").starts_with("50 % of its area is crumpled"), "{made}");
}

#[tokio::test]
async fn a_map_is_delivered_alone_where_what_is_laid_around_it_is_crumpled() {
    for (flaw, is_laid_out_around) in [("", true), ("\nwrinkles", false)] {
        let bench = Bench::new();
        bench.add("face", "segment disc 2\nlies fair 0.9").await;
        let path = bench.query("", &format!("segment disc 2\nrest annulus 7{flaw}")).await;
        bench.ended(&path).await;
        let made = bench.post_json(&format!("{path}/compositions?wait=60"), json!({})).await.json();
        assert_eq!((&made["verdict"], &made["parts"][0]["segment"]), (&json!("fair"), &json!(0)), "{made}");
        let inspired = made["inspired"].as_f64().expect("a share");
        assert_eq!(inspired < 1.0, is_laid_out_around, "{made}");
    }
}

#[tokio::test]
async fn of_several_segments_the_map_of_most_is_laid_out_around_where_it_leaves_much_bare_and_nobody_named_it() {
    for (rest, is_laid_out_around) in [("\nrest annulus 7", true), ("", false)] {
        let bench = Bench::new();
        bench.add("face", "segment disc 2\nlies fair 0.5").await;
        let path = bench.query("", &format!("segment disc 2\nsegment disc 3{rest}")).await;
        bench.ended(&path).await;
        let compositions = format!("{path}/compositions?wait=60");
        let made = bench.post_json(&compositions, json!({})).await.json();
        let mapped = |made: &Value| made["parts"].as_array().map_or(0, Vec::len);
        assert_eq!(mapped(&made), if is_laid_out_around { 1 } else { 2 }, "{made}");
        assert_eq!(made["templates"], if is_laid_out_around { json!([1]) } else { json!([]) }, "{made}");
        // What is named is stitched as it is.
        let named = bench.post_json(&compositions, json!({"parts": made["parts"]})).await.json();
        assert_eq!((mapped(&named), &named["templates"]), (2, &json!([])), "{named}");
    }
}

#[tokio::test]
async fn examples_that_would_make_up_too_little_are_not_stitched_first() {
    let bench = Bench::new();
    bench.add("thumb", "segment disc 2\nlies fair 0.05").await;
    let path = bench.query("", "segment disc 2\nsegment disc 3").await;
    bench.ended(&path).await;
    let made = bench.post_json(&format!("{path}/compositions?wait=60"), json!({})).await.json();
    assert_eq!((&made["inspired"], &made["templates"]), (&json!(0.0), &json!([0, 1])), "{made}");
    let note = "examples gave way to a regular layout of all of it: they make up 5 % of it";
    assert_eq!(made["notes"], json!([note]), "{made}");
}

#[tokio::test]
async fn where_no_mesh_of_the_whole_is_sound_the_map_of_most_of_it_is_delivered_alone() {
    let bench = Bench::stocked().await;
    for flaw in ["ragged", "wrinkles"] {
        let path = bench.query("", &format!("segment disc 2\nsegment disc 9\n{flaw}")).await;
        bench.ended(&path).await;
        let alone = bench.post_json(&format!("{path}/compositions?wait=60"), json!({})).await.json();
        assert_eq!((&alone["verdict"], &alone["templates"]), (&json!("fair"), &json!([])), "{alone}");
        assert_eq!(alone["parts"].as_array().map(Vec::len), Some(1), "{alone}");
        let last = alone["reasons"].as_array().and_then(|all| all.last()?.as_str()).expect("a reason");
        assert!(last.starts_with("the smaller parts of the scan are left bare, "), "{alone}");
        assert!(last.ends_with(" % of it: with them the mesh was broken or crumpled, or lost the example"), "{alone}");
    }
    // Nor does one stand that leaves more than half of its segment bare.
    let little = Bench::new();
    little.add("ear", "segment disc 2\nlies fair 0.4").await;
    let path = little.query("", "segment disc 9\nsegment disc 2\nragged").await;
    little.ended(&path).await;
    let made = little.post_json(&format!("{path}/compositions?wait=60"), json!({})).await.json();
    assert_ne!(made["verdict"], json!("fair"), "{made}");
    // Of three alike none is most of it.
    let path = bench.query("", "segment disc 2\nsegment disc 9\nsegment disc 9\nragged").await;
    bench.ended(&path).await;
    let broken = bench.post_json(&format!("{path}/compositions?wait=60"), json!({})).await.json();
    assert_eq!(broken["verdict"], json!("broken"), "{broken}");
}

#[tokio::test]
async fn a_map_that_stands_as_it_is_and_is_too_coarse_for_the_scan_is_split_until_it_follows() {
    let bench = Bench::stocked().await;
    for (flaws, quads, note) in [("ragged", 1, "the map follows the input as it is"), ("ragged\ncoarse", 4, "split 1")]
    {
        let path = bench.query("", &format!("segment disc 2\n{flaws}")).await;
        bench.ended(&path).await;
        let made = bench.post_json(&format!("{path}/compositions?wait=60"), json!({})).await.json();
        assert_eq!((&made["quads"], &made["notes"]), (&json!(quads), &json!([note])), "{made}");
        let kept = bench.post_json(&format!("{path}/compositions?wait=60"), json!({"keep": [0]})).await.json();
        assert_eq!(kept["quads"], json!(1), "{kept}");
    }
}

#[tokio::test]
async fn ended_queries_make_room_for_a_map_the_longest_unused_first() {
    // The fake engine asks for 1,000 bytes and those of the file; an ended query keeps that.
    // One user alone may have three of four parts.
    let bench = Bench::with(Admission::new(5400, 32));
    let example = bench.add("a", "segment disc 1").await;
    let mut queries = Vec::new();
    for _ in 0..3 {
        let path = bench.query("", "segment disc 1").await;
        bench.ended(&path).await;
        queries.push(path);
    }
    let wanted = json!({"segment": 0, "example": example, "example_segment": 0});
    let answer = bench.post_json(&format!("{}/maps?wait=60", queries[0]), wanted).await;
    assert_eq!(answer.status, StatusCode::CREATED, "{}", answer.text());
    let mut there = Vec::new();
    for path in &queries {
        there.push(bench.get(path).await.status);
    }
    assert_eq!(there, [StatusCode::OK, StatusCode::GONE, StatusCode::OK]);
    let never = format!("/v1/queries/{}", quadmuse_proto::QueryId::generate());
    bench.get(&never).await.problem(404, "not_found");
    let gone = bench.get(&queries[1]).await.problem(410, "query_expired");
    assert!(gone.contains("post it again"), "{gone}");
}

#[tokio::test]
async fn what_nobody_asks_for_is_let_go_and_what_was_made_of_it_is_held_longer() {
    let bench = Bench::with(Admission::new(1 << 20, 32));
    let example = bench.add("a", "segment disc 1").await;
    let [ranked, mapped] = [bench.query("", "segment disc 1").await, bench.query("", "segment disc 1").await];
    bench.ended(&ranked).await;
    bench.ended(&mapped).await;
    let wanted = json!({"segment": 0, "example": example, "example_segment": 0});
    let answer = bench.post_json(&format!("{mapped}/maps?wait=60"), wanted).await;
    assert_eq!(answer.status, StatusCode::CREATED, "{}", answer.text());
    let (none, day) = (Duration::ZERO, Duration::from_secs(86_400));
    let queries = &bench.work.queries;
    assert_eq!(queries.let_idle_go(day, day), 0);
    let taken = bench.work.pool.admission().used().bytes;
    assert_eq!(queries.let_idle_go(none, day), 1);
    assert!(bench.work.pool.admission().used().bytes < taken);
    bench.get(&ranked).await.problem(410, "query_expired");
    assert_eq!(bench.get(&mapped).await.status, StatusCode::OK);
    assert_eq!(queries.let_idle_go(none, none), 1);
    bench.get(&mapped).await.problem(410, "query_expired");
    // The upload may still be put away, for who starts the query again.
    assert!(bench.work.pool.admission().used().bytes < 100);
}
