//! `/v1/queries/{id}/stream` in its three forms.

use super::*;
use quadmuse_proto::Event;

async fn stream(bench: &Bench, path: &str, accept: &str, more: &[(&str, &str)]) -> Answer {
    let mut headers = vec![("accept", accept)];
    headers.extend(more);
    bench.request(Method::GET, &format!("{path}/stream"), &headers, Body::empty()).await
}

fn lines(answer: &Answer) -> Vec<Event> {
    let text = answer.text();
    text.lines().filter(|line| !line.is_empty()).map(|line| serde_json::from_str(line).expect("an event")).collect()
}

fn names(events: &[Event]) -> Vec<&'static str> {
    events.iter().map(Event::name).collect()
}

#[tokio::test]
async fn lines_begin_level_by_level_and_end() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1\nsegment disc 2\nslow 10").await;
    let answer = stream(&bench, &path, "application/x-ndjson", &[]).await;
    assert_eq!((answer.status, answer.header("content-type")), (StatusCode::OK, "application/x-ndjson"));
    let events = lines(&answer);
    assert_eq!((events[0].name(), events.last().map(Event::name)), ("begin", Some("end")));
    assert!(events[1..events.len() - 1].iter().all(|event| event.name() == "level"));
    let revisions: Vec<_> = events[1..].iter().filter_map(Event::revision).collect();
    assert!(revisions.windows(2).all(|pair| pair[0] <= pair[1]), "{revisions:?}");
    let finest = |segment: u32| {
        let levels = events.iter().filter_map(|event| match event {
            Event::Level(ranking) if ranking.segment == segment => Some(ranking.level),
            _ => None,
        });
        levels.max()
    };
    assert_eq!((finest(0), finest(1)), (Some(128), Some(128)));
}

#[tokio::test]
async fn the_three_forms_tell_the_same() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1").await;
    bench.ended(&path).await;
    let events = lines(&stream(&bench, &path, "application/x-ndjson", &[]).await);
    assert_eq!(names(&events), ["begin", "level", "end"]);
    let packed = stream(&bench, &path, "application/msgpack", &[]).await;
    let mut reader = rmp_serde::Deserializer::new(packed.bytes.as_slice());
    let unpacked: Vec<Event> =
        (0..3).map(|_| serde::Deserialize::deserialize(&mut reader).expect("an event")).collect();
    assert_eq!(unpacked, events);
    assert!(reader.get_ref().is_empty());
    let sse = stream(&bench, &path, "text/event-stream", &[]).await;
    assert_eq!(sse.header("content-type"), "text/event-stream");
    let text = sse.text();
    let frames: Vec<&str> = text.split_terminator("\n\n").collect();
    assert_eq!(frames.len(), 3);
    for (frame, event) in frames.iter().zip(&events) {
        let lines: Vec<&str> = frame.lines().collect();
        assert_eq!(lines[0], format!("event: {}", event.name()));
        assert_eq!(lines[1], format!("id: {}", event.revision().expect("a revision")));
        let data = lines[2].strip_prefix("data: ").expect("data");
        assert_eq!(&serde_json::from_str::<Event>(data).expect("an event"), event);
    }
    assert_eq!(stream(&bench, &path, "*/*", &[]).await.header("content-type"), "text/event-stream");
    stream(&bench, &path, "text/html", &[]).await.problem(406, "not_acceptable");
}

#[tokio::test]
async fn a_resumed_stream_goes_on_after_what_was_seen() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1").await;
    let revision = bench.ended(&path).await["revision"].as_u64().expect("a revision");
    let resume = async |id: &str| stream(&bench, &path, "application/x-ndjson", &[("last-event-id", id)]).await;
    assert_eq!(names(&lines(&resume("0").await)), ["level", "end"]);
    assert_eq!(names(&lines(&resume(&revision.to_string()).await)), ["end"]);
    resume("x").await.problem(400, "parameter_invalid");
}

#[tokio::test]
async fn each_way_to_end_is_told() {
    let bench = Bench::stocked().await;
    let state = |answer: &Answer| match lines(answer).pop() {
        Some(Event::End(end)) => serde_json::to_value(end.state).expect("a word").as_str().expect("a word").to_owned(),
        other => panic!("expected an end, found {other:?}"),
    };
    let path = bench.query("deadline_ms=50", "segment disc 1\nslow 1000").await;
    assert_eq!(state(&stream(&bench, &path, "application/x-ndjson", &[]).await), "deadline");
    let path = bench.query("", "segment disc 1\npanic encode").await;
    let answer = stream(&bench, &path, "application/x-ndjson", &[]).await;
    assert_eq!(state(&answer), "failed");
    let Some(Event::End(end)) = lines(&answer).pop() else { panic!("expected an end") };
    assert_eq!(end.summary.problem.map(|problem| problem.status), Some(500));
    let path = bench.query("", "segment disc 1\nslow 5000").await;
    let (answer, _) = tokio::join!(stream(&bench, &path, "application/x-ndjson", &[]), async {
        tokio::time::sleep(Duration::from_millis(30)).await;
        bench.request(Method::DELETE, &path, &[], Body::empty()).await
    });
    assert_eq!(state(&answer), "cancelled");
}

#[tokio::test]
async fn a_stopping_service_ends_its_streams_with_an_error() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1\nslow 60000").await;
    let (answer, ()) = tokio::join!(stream(&bench, &path, "application/x-ndjson", &[]), async {
        tokio::time::sleep(Duration::from_millis(30)).await;
        bench.stopping.cancel();
    });
    let Some(Event::Error(error)) = lines(&answer).pop() else { panic!("expected an error: {}", answer.text()) };
    assert_eq!((error.problem.status, error.problem.code), (503, quadmuse_proto::Code::Unavailable));
    assert_eq!(bench.get("/readyz").await.status, StatusCode::SERVICE_UNAVAILABLE);
    bench.request(Method::DELETE, &path, &[], Body::empty()).await;
}

#[tokio::test(start_paused = true)]
async fn a_silent_stream_shows_that_it_is_alive() {
    let bench = Bench::new();
    // No corpus is needed: the query is put there by hand and nobody ranks it.
    let live = bench.idle_query();
    let request =
        Request::builder().uri(format!("/v1/queries/{}/stream", live.id)).body(Body::empty()).expect("a request");
    let response = bench.router.clone().oneshot(request).await.expect("infallible");
    let mut body = response.into_body();
    let first = body.frame().await.expect("a frame").expect("whole").into_data().expect("data");
    assert!(first.starts_with(b"event: begin\n"));
    let second = body.frame().await.expect("a frame").expect("whole").into_data().expect("data");
    assert_eq!(&second[..], b":\n\n");
}

#[tokio::test]
async fn a_query_knows_that_a_stream_told_of_its_end() {
    let bench = Bench::stocked().await;
    let path = bench.query("", "segment disc 1").await;
    bench.ended(&path).await;
    let streamed = || bench.work.queries.all().iter().map(|query| query.end_was_streamed()).collect::<Vec<_>>();
    assert_eq!(streamed(), [false]);
    stream(&bench, &path, "application/x-ndjson", &[]).await;
    assert_eq!(streamed(), [true]);
}
