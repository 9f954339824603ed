//! A fake engine for tests: meshes are words, energies are differences of numbers.
//!
//! An upload is text, one directive a line: `segment TOPOLOGY NUMBER` (a segment whose encoding is NUMBER), `part TOPOLOGY
//! NUMBER` (the same of a part besides the one segment, where parts are wanted; one of NaN can't be encoded),
//! `slow MS` (every registration takes so long), `encode-slow MS`, `panic WHERE` with `WHERE` one of `read`, `encode`,
//! `refine`, `tears` (a composition on it is broken where an example stands), `crumples` (one is crumpled there),
//! `bristles` (one is crumpled where no example stands), `ragged` (one is broken but for a map as it is), `wrinkles`
//! (one is crumpled but for a map as it is), `coarse` (its faces leave what they lie on, by a quarter as much each time
//! that they are split), `lies VERDICT SHARE` (as an example it lies so on that share of an input; `short`: broken, but
//! fair where it is stitched), `large` (its segments have so many faces that several examples are tried), `rest
//! TOPOLOGY NUMBER` (what lies around a map on its one segment), `agrees SHARE` (it can be laid roughly on what has
//! this directive, too, and agrees by so much there), `side TOPOLOGY NUMBER` and `protrusion TOPOLOGY NUMBER` (its
//! segments where it is cut at its waist, and into protrusions), and `refuse CODE`. Anything else is unreadable. The
//! mesh is a unit square, one quad a segment.

use super::*;
use quadmuse_kernel::encode::Picture;
use quadmuse_kernel::mesh::{Polygons, Vec3};
use quadmuse_kernel::register::image::Image;
use quadmuse_kernel::register::spectra::Spectrum;
use quadmuse_proto::constraint::Place;
use quadmuse_proto::{Constraint, ConstraintOrigin, Distortion, Histogram, Location, MeshFormat, Parts, Verdict};
use std::time::{Duration, Instant};

/// The fake.
#[derive(Debug, Default)]
pub(crate) struct FakeEngine;

#[derive(Clone, Debug, Default)]
struct Script {
    numbers: Vec<f64>,
    slow: Duration,
    encode_slow: Duration,
    panics: Vec<String>,
    tears: bool,
    crumples: bool,
    bristles: bool,
    ragged: bool,
    wrinkles: bool,
    coarse: bool,
    lies: Option<(Verdict, f64)>,
    agrees: Option<f64>,
    rest: Option<ModelSegment>,
}

/// Faces of a segment: enough to be worth an example; and of one that several are tried on.
const FACES: u64 = 100;
const FACES_LARGE: u64 = 10_000;

/// How far what is coarse leaves what it lies on, as a share of the diagonal; and the note of what was split, before the times.
const FAR: f64 = 0.005;
const SPLIT: &str = "split ";

#[derive(Clone, Debug)]
struct FakeEncoding {
    number: f64,
    slow: Duration,
    panics_refine: bool,
}

fn sleep(time: Duration, stop: &Stop) -> Result<(), EngineError> {
    let end = Instant::now() + time;
    while Instant::now() < end {
        if let Some(reason) = stop.reason() {
            return Err(reason.into());
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(())
}

fn located(place: &Place) -> Location {
    match place {
        Place::Point(point) => Location { point: *point, u: 0.0, v: 0.0 },
        Place::Domain { u, v } => Location { point: [0.0; 3], u: *u, v: *v },
        _ => Location { point: [0.0; 3], u: 0.0, v: 0.0 },
    }
}

fn square(quads: usize) -> PolyMesh {
    let mut faces = Polygons::default();
    (0..quads).for_each(|_| faces.push(&[0, 1, 2, 3]));
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let positions = corners.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
    PolyMesh { positions, faces, ..PolyMesh::default() }
}

/// A flat picture, so that differences of numbers are differences of means.
fn flat(of: &Encoding) -> Result<Image, EngineError> {
    let number = of.inner.open::<FakeEncoding>()?.number as f32;
    let picture = Picture { side: 32, values: vec![number * number; 32 * 32] };
    Ok(Image::new(&picture, quadmuse_kernel::register::Flip::default(), false))
}

fn refusal(word: &str) -> Refusal {
    match word {
        "mesh_empty" => Refusal::Empty,
        "mesh_not_manifold" => Refusal::NotManifold,
        "topology_unsupported" => Refusal::TopologyUnsupported,
        "mesh_too_large" => Refusal::TooLarge,
        "format_unknown" => Refusal::FormatUnknown,
        "mesh_not_encodable" => Refusal::NotEncodable,
        _ => Refusal::Unreadable,
    }
}

impl Engine for FakeEngine {
    fn version(&self) -> u32 {
        7
    }

    fn memory_estimate(&self, bytes: u64) -> u64 {
        1000 + bytes
    }

    fn read(&self, bytes: &[u8], format: Option<MeshFormat>, cut: &Cut, _: &Stop) -> Result<Model, EngineError> {
        let text = str::from_utf8(bytes).map_err(|_| EngineError::refused(Refusal::FormatUnknown, "not text"))?;
        let (mut script, mut segments, mut parts) = (Script::default(), Vec::new(), 0);
        let faces = if text.lines().any(|line| line == "large") { FACES_LARGE } else { FACES };
        // The segments of a mesh that is cut as it is asked to be: its own where it can't be.
        let own = match cut.parts {
            Some(Parts::Waist) if text.contains("side ") => "side",
            Some(Parts::Auto) if text.contains("protrusion ") => "protrusion",
            _ => "segment",
        };
        let unreadable = |line: usize, what: &str| {
            EngineError::refused(Refusal::Unreadable, format!("expected a directive in line {line}, found `{what}`"))
        };
        for (at, line) in text.lines().enumerate() {
            let words: Vec<&str> = line.split_whitespace().collect();
            let number = |word: &str| word.parse::<f64>().map_err(|_| unreadable(at + 1, line));
            match words.as_slice() {
                [kind, topology, value] if *kind == own => {
                    script.numbers.push(number(value)?);
                    let topology = topology.parse().map_err(|_| unreadable(at + 1, line))?;
                    segments.push(ModelSegment::of(topology, faces));
                }
                ["segment" | "side" | "protrusion", _, _] | ["large"] => {}
                ["lies", verdict, share] => {
                    let verdict = match *verdict {
                        "good" => Verdict::Good,
                        "fair" => Verdict::Fair,
                        "short" => Verdict::Broken,
                        _ => Verdict::Poor,
                    };
                    script.lies = Some((verdict, number(share)?));
                }
                ["rest", topology, value] => {
                    script.numbers.push(number(value)?);
                    let topology = topology.parse().map_err(|_| unreadable(at + 1, line))?;
                    script.rest = Some(ModelSegment::of(topology, faces));
                }
                ["agrees", share] => script.agrees = Some(number(share)?),
                ["part", topology, value] if cut.besides != ExtraParts::Nothing => {
                    script.numbers.push(number(value)?);
                    let topology = topology.parse().map_err(|_| unreadable(at + 1, line))?;
                    segments.push(ModelSegment::of(topology, 50));
                    parts += 1;
                }
                ["part", _, _] => {}
                ["slow", ms] => script.slow = Duration::from_secs_f64(number(ms)? / 1e3),
                ["encode-slow", ms] => script.encode_slow = Duration::from_secs_f64(number(ms)? / 1e3),
                ["tears"] => script.tears = true,
                ["crumples"] => script.crumples = true,
                ["bristles"] => script.bristles = true,
                ["ragged"] => script.ragged = true,
                ["wrinkles"] => script.wrinkles = true,
                ["coarse"] => script.coarse = true,
                ["panic", "read"] => panic!("scripted to panic"),
                ["panic", place] => script.panics.push((*place).into()),
                ["refuse", code] => {
                    return Err(EngineError::refused(refusal(code), format!("refused in line {}", at + 1)));
                }
                _ => return Err(unreadable(at + 1, line)),
            }
        }
        if segments.is_empty() {
            return Err(EngineError::refused(Refusal::Empty, "expected a segment, found none"));
        }
        if cut.labels.as_ref().is_some_and(|labels| labels.len() != segments.len()) {
            let detail = format!("expected {} labels, one a face, found another number", segments.len());
            return Err(EngineError::refused(Refusal::LabelsInvalid, detail));
        }
        Ok(Model {
            mesh: Arc::new(square(segments.len())),
            format: format.unwrap_or(MeshFormat::Obj),
            repairs: Vec::new(),
            segments,
            labels: None,
            besides: (parts > 0).then(|| (0..=parts).collect()),
            is_waist: own == "side",
            inner: Opaque::new(script),
        })
    }

    fn encode(&self, model: &Model, segment: u32, stop: &Stop) -> Result<Encoded, EngineError> {
        let script: &Script = model.inner.open()?;
        sleep(script.encode_slow, stop)?;
        assert!(!script.panics.iter().any(|place| place == "encode"), "scripted to panic");
        let number = script.numbers[segment as usize];
        if number.is_nan() {
            return Err(EngineError::refused(Refusal::NotEncodable, format!("segment {segment}: scripted to refuse")));
        }
        let panics_refine = script.panics.iter().any(|place| place == "refine");
        let facts = SegmentFacts {
            topology: model.segments[segment as usize].topology,
            k: 1.0,
            faces: 1,
            features: 0,
            bending: None,
        };
        let encoding =
            Encoding { facts, inner: Opaque::new(FakeEncoding { number, slow: script.slow, panics_refine }) };
        Ok(Encoded { encoding, repairs: Vec::new() })
    }

    fn pack(&self, encoding: &Encoding) -> Result<PackedEncoding, EngineError> {
        let fake: &FakeEncoding = encoding.inner.open()?;
        let flag = if fake.panics_refine { 1.0 } else { 0.0 };
        let values = vec![fake.number as f32, fake.slow.as_secs_f32(), flag];
        let levels = quadmuse_proto::query::LEVELS.map(|level| (level, values.clone())).to_vec();
        Ok(PackedEncoding { facts: encoding.facts, features: Vec::new(), levels })
    }

    fn unpack(&self, packed: &PackedEncoding) -> Result<Encoding, EngineError> {
        let [number, slow, flag] = packed.levels[0].1[..] else { return Err(EngineError::Internal("not mine".into())) };
        let (slow, panics_refine) = (Duration::from_secs_f32(slow), flag > 0.0);
        let inner = Opaque::new(FakeEncoding { number: f64::from(number), slow, panics_refine });
        Ok(Encoding { facts: packed.facts, inner })
    }

    fn row(&self, example: &Encoding) -> Result<Row, EngineError> {
        let row = Row::new(&flat(example)?, quadmuse_kernel::topology::Topology::Disc);
        row.ok_or_else(|| EngineError::Internal("not of 32²".into()))
    }

    fn coarse_query(&self, query: &Encoding, _: Topology) -> Result<CoarseQuery, EngineError> {
        let spectra = Spectrum::new(&flat(query)?).map(|spectrum| (spectrum, query.facts.shape()));
        Ok(CoarseQuery::from_spectra(quadmuse_kernel::topology::Topology::Disc, spectra.into_iter().collect()))
    }

    fn coarse(&self, example: &Encoding, query: &Encoding, stop: &Stop) -> Result<Registration, EngineError> {
        let (one, two): (&FakeEncoding, &FakeEncoding) = (example.inner.open()?, query.inner.open()?);
        sleep(two.slow, stop)?;
        let energy = (one.number - two.number).abs();
        Ok(Registration { level: 32, energy, flip: Flip::default(), shift_u: 0.25, inner: Opaque::new(()) })
    }

    fn refine(
        &self,
        from: &Registration,
        example: &Encoding,
        query: &Encoding,
        stop: &Stop,
    ) -> Result<Registration, EngineError> {
        let (one, two): (&FakeEncoding, &FakeEncoding) = (example.inner.open()?, query.inner.open()?);
        sleep(two.slow, stop)?;
        assert!(!one.panics_refine, "scripted to panic");
        Ok(Registration { level: 2 * from.level, energy: from.energy * 0.9, ..from.clone() })
    }

    fn finish(&self, from: &Registration, _: &Encoding, _: &Encoding, _: &Stop) -> Result<Registration, EngineError> {
        Ok(from.clone())
    }

    fn score(&self, registration: &Registration, _: &SegmentFacts, _: &Encoding, relevance: f64) -> f64 {
        registration.energy * 5.0 / (relevance + 5.0)
    }

    fn map(&self, from: &Registration, example: &Side, query: &Side, stop: &Stop) -> Result<Mapped, EngineError> {
        sleep(query.encoded.encoding.inner.open::<FakeEncoding>()?.slow, stop)?;
        let constraints: Vec<Constraint> = match from.inner.open::<Vec<Constraint>>() {
            Ok(constraints) => constraints.clone(),
            Err(_) => Vec::new(),
        };
        let (verdict, share) = example.model.inner.open::<Script>()?.lies.unwrap_or((Verdict::Good, 1.0));
        let reached = || Judgement { verdict: Verdict::Fair, reasons: Vec::new() };
        Ok(Mapped {
            mesh: Arc::clone(&example.model.mesh),
            part: Arc::clone(&example.model.mesh),
            registration: from.clone(),
            is_of_whole: false,
            constraints,
            folds: 0,
            distortion: Distortion { angle: Histogram::default(), area: Histogram::default() },
            verdict,
            reasons: Vec::new(),
            stitched: (verdict == Verdict::Broken).then(reached),
            reach: MapExtent {
                covers: quadmuse_kernel::pipeline::Covers { example: 1.0, input: share },
                ..MapExtent::default()
            },
            evidence: None,
            sureness: None,
        })
    }

    fn fit(
        &self,
        from: Option<&Registration>,
        example: &Side,
        query: &Side,
        wishes: &Wishes,
        stop: &Stop,
    ) -> Result<Fitted, EngineError> {
        let from = from.ok_or_else(|| EngineError::Internal("expected surfaces of one topology".into()))?;
        let mut mapped = self.map(from, example, query, stop)?;
        for landmark in &wishes.landmarks {
            let (on_example, on_input) = (located(&landmark.on_example), located(&landmark.on_input));
            let id = format!("c{}", mapped.constraints.len());
            mapped.constraints.push(Constraint { id, on_example, on_input, origin: ConstraintOrigin::User });
        }
        Ok(Fitted { mapped, example: example.clone(), query: query.clone() })
    }

    fn constrain(
        &self,
        from: &Mapped,
        edit: &ConstraintEdit,
        _: &Side,
        _: &Side,
        _: &Stop,
    ) -> Result<Registration, EngineError> {
        let mut constraints = from.constraints.clone();
        for id in &edit.remove {
            let Some(at) = constraints.iter().position(|c| c.id == *id) else {
                return Err(EngineError::refused(
                    Refusal::ConstraintUnknown,
                    format!("expected a constraint, found `{id}`"),
                ));
            };
            constraints.remove(at);
        }
        for new in &edit.set {
            let place = |p: &Option<Place>| located(p.as_ref().unwrap_or(&Place::Point([0.0; 3])));
            if place(&new.on_input).v > 1.0 {
                return Err(EngineError::refused(Refusal::ConstraintFolds, "expected no fold, found one"));
            }
            let id = new.id.clone().unwrap_or_else(|| format!("c{}", constraints.len()));
            let (on_example, on_input) = (place(&new.on_example), place(&new.on_input));
            constraints.push(Constraint { id, on_example, on_input, origin: ConstraintOrigin::User });
        }
        Ok(Registration { inner: Opaque::new(constraints), ..from.registration.clone() })
    }

    fn compose(&self, _: &Model, parts: &[Part], _: StitchOptions, _: &Stop) -> Result<Stitched, EngineError> {
        let mesh = Arc::new(square(parts.len()));
        let standing = |part: &Part| match part {
            Part::Template(_) | Part::Poor(_) => LayoutOwner::Regular,
            _ => LayoutOwner::Example,
        };
        Ok(Stitched {
            mesh,
            standing: parts.iter().map(standing).collect(),
            bridging: Vec::new(),
            extraordinary_vertices: 0,
            extraordinary_before: 0,
            notes: Vec::new(),
        })
    }

    fn appraise(&self, query: &Model, made: &Stitched, _: AllowedFlaws) -> Result<Appraisal, EngineError> {
        let count = made.standing.len();
        let share = |k| if made.is_example(k) { 1.0 / count.max(1) as f64 } else { 0.0 };
        let examples: Vec<f64> = (0..count).map(share).collect();
        let is_any = made.standing.contains(&LayoutOwner::Example);
        let script = query.inner.open::<Script>()?;
        let splits = made.notes.iter().find_map(|note| note.strip_prefix(SPLIT)?.parse::<i32>().ok());
        let is_stitched = splits.is_none() && !made.notes.iter().any(|note| note == AS_MAPPED);
        let away = if script.coarse { FAR * 0.25f64.powi(splits.unwrap_or(0)) } else { 0.0 };
        let is_torn = script.tears && is_any || script.ragged && is_stitched;
        let flaws = if is_torn { vec!["it is torn".into()] } else { Vec::new() };
        let flawed = if is_torn { (0..count as u32).collect() } else { Vec::new() };
        let is_crumpled = (script.crumples || script.wrinkles && is_stitched) && is_any;
        let [turned, turned_of_examples] =
            [is_crumpled || script.bristles, is_crumpled].map(|is| if is { 0.5 } else { 0.0 });
        let crumpled = Appraisal { turned, turned_of_examples, ..Appraisal::default() };
        Ok(Appraisal { examples, covered: 1.0, away, flaws, flawed, ..crumpled })
    }

    fn split(&self, _: &Model, made: &Stitched, splits: u32) -> Result<Option<Stitched>, EngineError> {
        let mesh = Arc::new(square(4 * made.mesh.faces.len()));
        let notes = vec![format!("{SPLIT}{}", splits + 1)];
        Ok(Some(Stitched { notes, ..Stitched::as_it_is(mesh, made.standing.clone()) }))
    }

    fn posed(&self, model: &Model, segment: u32) -> Result<Option<Opaque>, EngineError> {
        self.ready_for_rough(model, segment)
    }

    fn ready_for_rough(&self, query: &Model, _: u32) -> Result<Option<Opaque>, EngineError> {
        Ok(query.inner.open::<Script>()?.agrees.map(|_| Opaque::new(())))
    }

    fn rough(
        &self,
        example: (&Model, u32),
        _: (&Model, u32, &Opaque),
        _: Option<[&Encoding; 2]>,
        _: Option<&RoughLead>,
        _: &Stop,
    ) -> Result<Option<RoughPlacement>, EngineError> {
        let agrees = example.0.inner.open::<Script>()?.agrees;
        Ok(agrees.map(|agreement| RoughPlacement { covered: 1.0, ..RoughPlacement::of(agreement) }))
    }

    /// One segment more than the map's own, where the query was cut at its waist, or is told to have a rest.
    fn around(&self, query: &Model, _: u32, mapped: &Mapped) -> Result<Option<(Model, Arc<PolyMesh>)>, EngineError> {
        let mut cut = Model { is_waist: false, ..query.clone() };
        let rest = query.inner.open::<Script>()?.rest;
        cut.segments.extend(rest);
        Ok((query.is_waist || rest.is_some()).then(|| (cut, Arc::clone(&mapped.part))))
    }

    fn template(&self, query: &Side, _: &Stop) -> Result<Mapped, EngineError> {
        let registration =
            Registration { level: 0, energy: 0.0, flip: Flip::default(), shift_u: 0.0, inner: Opaque::new(()) };
        Ok(Mapped {
            is_of_whole: false,
            mesh: Arc::clone(&query.model.mesh),
            part: Arc::clone(&query.model.mesh),
            registration,
            constraints: Vec::new(),
            folds: 0,
            distortion: Distortion { angle: Histogram::default(), area: Histogram::default() },
            verdict: Verdict::Fair,
            reasons: Vec::new(),
            stitched: None,
            reach: MapExtent::default(),
            evidence: None,
            sureness: None,
        })
    }

    fn write(&self, mesh: &PolyMesh, format: MeshFormat) -> Result<Vec<u8>, EngineError> {
        Ok(format!("{format} with {} faces", mesh.faces.len()).into_bytes())
    }
}
