//! Messages to answer with.

use quadmuse_proto::{
    Covers, Distortion, Entry, EntryState, Example, ExampleId, ExampleSegment, Flip, Histogram, MakingState, Map,
    MapId, MapTimings, MeshCounts, Progress, Query, QueryId, QuerySegment, QueryState, QueryTimings, Ranking, Topology,
    Verdict,
};

/// The `n`th example.
pub(crate) fn example_id(n: u8) -> ExampleId {
    ExampleId::from_bytes([n; 16])
}

/// The query.
pub(crate) fn query_id() -> QueryId {
    QueryId::from_bytes([100; 16])
}

/// The map.
pub(crate) fn map_id() -> MapId {
    MapId::from_bytes([50; 16])
}

/// The `n`th example.
pub(crate) fn example(n: u8) -> Example {
    Example {
        id: example_id(n),
        revision: 1,
        name: format!("example {n}"),
        tags: vec!["head".into(), "wip".into()],
        relevance: 3.0,
        author: String::new(),
        licence: String::new(),
        notes: String::new(),
        landmarks: Vec::new(),
        hash: "00".into(),
        format: "obj".into(),
        bytes: 100,
        counts: MeshCounts { vertices: 9, faces: 4, triangles: 0, quads: 4 },
        segments: vec![ExampleSegment {
            segment: 0,
            is_part: false,
            topology: Topology::Disc,
            k: 0.5,
            faces: 4,
            features: 3,
        }],
        repairs: Vec::new(),
        doubts: Vec::new(),
        created: "2025-01-01T00:00:00Z".into(),
        template: None,
    }
}

/// The query, with so many segments.
pub(crate) fn query(state: QueryState, segments: u32) -> Query {
    let segment = |segment| QuerySegment {
        segment,
        name: None,
        topology: Topology::Disc,
        faces: 100,
        holes: 0,
        tries: 3,
        k: Some(0.5),
        features: Some(4),
        level: None,
        corpus_size: 3,
    };
    Query {
        id: query_id(),
        state,
        deadline_reached: false,
        top: 4,
        resolution: 128,
        deadline_ms: None,
        tags: Vec::new(),
        counts: MeshCounts::default(),
        repairs: Vec::new(),
        waist: false,
        segments: (0..segments).map(segment).collect(),
        progress: Progress::default(),
        timings: QueryTimings::default(),
        revision: 0,
        corpus_size: u64::from(segments) * 3,
        incomplete: Vec::new(),
        created: "2025-01-01T00:00:00Z".into(),
        problem: None,
        making: Vec::new(),
    }
}

/// A ranking of three examples.
pub(crate) fn ranking(segment: u32, revision: u64, level: u32, state: QueryState) -> Ranking {
    let entry = |rank: u8| Entry {
        rank: rank.into(),
        example: example_id(rank),
        example_segment: 0,
        name: format!("example {rank}"),
        score: f64::from(rank) / 10.0,
        energy: 0.5,
        k: 0.5,
        relevance: 3.0,
        flip: Flip::default(),
        shift_u: 0.0,
        resolution: level,
        state: EntryState::Refining,
        likeness: None,
        agreement: None,
        similar_to: None,
        turn: Some(1),
        template: None,
    };
    let entries = (1..=3).map(entry).collect();
    let (query, incomplete) = (query_id(), Vec::new());
    let segment_name = None;
    Ranking {
        query,
        segment,
        segment_name,
        revision,
        level,
        resolution: 128,
        state,
        entries,
        corpus_size: 3,
        incomplete,
    }
}

/// The map.
pub(crate) fn map() -> Map {
    let distortion = Distortion { angle: Histogram::default(), area: Histogram::default() };
    Map {
        id: map_id(),
        query: query_id(),
        state: MakingState::Done,
        progress: 1.0,
        segment: 0,
        example: example_id(1),
        example_segment: 0,
        revision: 1,
        flip: Flip::default(),
        shift_u: 0.0,
        energy: 0.5,
        resolution: 128,
        constraints: Vec::new(),
        vertices: 9,
        faces: 4,
        folds: 0,
        distortion,
        verdict: Verdict::Good,
        evidence: None,
        own_vertices: 9,
        own_faces: 4,
        kept: None,
        covers: Covers::default(),
        inspired: 1.0,
        reasons: vec!["little distortion".into()],
        timings: MapTimings::default(),
    }
}
