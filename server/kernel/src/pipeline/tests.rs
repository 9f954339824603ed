//! The way through the kernel on domes: read, encode, map, edit, cut alike, rejoin, stop.

use super::*;
use crate::mesh::bvh::Bvh;
use crate::mesh::{Format, Limits, Vec3};
use crate::topology::{Topology, tests::ball};
use std::fmt::Write;
use std::sync::Arc;

const GO_ON: Stop<'static> = &|| false;

/// n × n quads of two groups on a lopsided dome over a square, as OBJ.
fn dome(n: usize) -> String {
    dome_without(n, |_, _| false)
}

/// The same without the quads whose first corner is told to go, by its place in the square from −1 to 1.
fn dome_without(n: usize, is_gone: impl Fn(f64, f64) -> bool) -> String {
    let at = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
    let mut text = String::new();
    for (x, y) in (0..=n).flat_map(|j| (0..=n).map(move |i| (at(i), at(j)))) {
        let _ = writeln!(text, "v {x} {y} {}", 0.7 * (1.0 - x * x) * (1.0 - y * y) * (1.0 + 0.4 * x + 0.3 * y));
    }
    for (group, columns) in [("left", 0..n / 2), ("right", n / 2..n)] {
        let _ = writeln!(text, "g {group}");
        for (i, j) in columns.flat_map(|i| (0..n).map(move |j| (i, j))).filter(|&(i, j)| !is_gone(at(i), at(j))) {
            let v = |i: usize, j: usize| j * (n + 1) + i + 1;
            let _ = writeln!(text, "f {} {} {} {}", v(i, j), v(i + 1, j), v(i + 1, j + 1), v(i, j + 1));
        }
    }
    text
}

fn model(n: usize, way: CutMethod) -> Arc<Model> {
    let cut = Cut { way, ..Cut::default() };
    Arc::new(read(dome(n).as_bytes(), Some(Format::Obj), &cut, &Limits::default()).expect("a dome"))
}

fn side(n: usize) -> Side {
    let model = model(n, CutMethod::Whole);
    let encoded = Arc::new(encode(&model, 0, GO_ON).expect("encodable"));
    Side { model, segment: 0, encoded }
}

fn registered(example: &Side, query: &Side) -> Registered {
    let found = fitted::registration(&example.encoded.query, &query.encoded.query, GO_ON);
    found.expect("not stopped").expect("discs")
}

/// Takes from a map what an edit keeps of it.
fn before_edit(mapped: &Mapped) -> MapBeforeEdit {
    MapBeforeEdit {
        folds: mapped.folds,
        verdict: mapped.verdict,
        reasons: mapped.reasons.clone(),
        reach: mapped.reach.clone(),
        evidence: mapped.evidence,
        sureness: mapped.sureness,
    }
}

fn is_refused<T: std::fmt::Debug>(found: Result<T, PipelineError>, expected: Refusal) {
    assert!(matches!(&found, Err(PipelineError::Refused { refusal, .. }) if *refusal == expected), "{found:?}");
}

#[test]
fn a_coarse_dome_lies_on_a_fine_one_with_all_its_faces() {
    let (example, query) = (side(12), side(30));
    let mapped = map(&registered(&example, &query), &example, &query, GO_ON).expect("a map");
    assert!(mapped.mesh.faces == example.model.mesh.faces, "the faces are the example's own");
    assert_eq!((mapped.folds, mapped.verdict), (0, Verdict::Good), "{:?}", mapped.reasons);
    let tree = Bvh::new(query.model.surface());
    let off = mapped.mesh.positions.iter().map(|&x| (tree.closest(x).point - x).norm()).fold(0.0, f64::max);
    assert!(off < 1e-9, "{off}");
}

#[test]
fn a_map_that_leaves_some_bare_is_broken_by_itself_and_judged_without_that_where_it_is_stitched() {
    let (example, query) = (side(12), side(30));
    let whole = map(&registered(&example, &query), &example, &query, GO_ON).expect("a map");
    assert_eq!(whole.stitched, None);
    let short = |rows: usize| {
        let kept: Vec<&[u32]> = whole.mesh.faces.iter().skip(12 * rows).collect();
        let mesh = crate::mesh::PolyMesh { faces: kept.into_iter().collect(), ..(*whole.mesh).clone() };
        let mut mapped = Mapped { mesh: Arc::new(mesh), ..whole.clone() };
        sound::check(&mut mapped, &query);
        mapped
    };
    let mapped = short(4);
    assert_eq!((mapped.verdict, mapped.reasons.len()), (Verdict::Broken, 1), "{:?}", mapped.reasons);
    let stitched = mapped.stitched.expect("another");
    assert_eq!((stitched.verdict, stitched.reasons.len()), (Verdict::Good, 0));
}

#[test]
fn a_constraint_is_met_where_it_was_set_and_a_bad_one_is_refused() {
    let (example, query) = (side(12), side(30));
    let mapped = map(&registered(&example, &query), &example, &query, GO_ON).expect("a map");
    // The vertex in the middle is held a little beside where it lies.
    let (vertex, n) = (6 * 13 + 6, 12);
    let there = query.model.mesh.positions[16 * 31 + 15];
    let asked = |on_example: Place| ConstraintEdit {
        set: vec![NewConstraint { id: None, on_example: Some(on_example), on_input: Some(Place::Point(there.into())) }],
        ..ConstraintEdit::default()
    };
    let edit = |edit: &ConstraintEdit| {
        constrain::edit(&mapped.registration, &mapped.constraints, edit, &example, &query, GO_ON)
    };
    let moved = edit(&asked(Place::OnVertex { vertex })).expect("no fold");
    let after = edited(&moved, &before_edit(&mapped), &example, &query, GO_ON).expect("a map");
    let missed = (after.mesh.positions[vertex as usize] - there).norm();
    assert!(missed < 1e-6, "{missed}");
    assert_eq!(after.constraints.iter().filter(|c| c.origin == ConstraintOrigin::User).count(), 1);

    is_refused(edit(&asked(Place::OnVertex { vertex: 13 * 13 })), Refusal::ConstraintInvalid);
    let weights = Place::OnFace { face: n * n - 1, barycentric: vec![0.5, 0.5, 0.5, 0.5] };
    is_refused(edit(&asked(weights)), Refusal::ConstraintInvalid);
    is_refused(edit(&asked(Place::Point([f64::NAN; 3]))), Refusal::ConstraintInvalid);
    let unknown = ConstraintEdit { remove: vec!["c9".into()], ..ConstraintEdit::default() };
    is_refused(edit(&unknown), Refusal::ConstraintUnknown);
}

#[test]
fn a_scan_with_a_window_takes_an_example_without_one_to_its_place() {
    let window = |x: f64, y: f64| (-0.5..0.1).contains(&x) && (-0.1..0.5).contains(&y);
    let text = dome_without(40, window);
    let scan = read(text.as_bytes(), Some(Format::Obj), &Cut::default(), &Limits::default()).expect("a scan");
    let segment = scan.segments()[0];
    assert_eq!((scan.segments().len(), segment.topology, segment.holes), (1, Topology::Annulus, 0));
    assert!(
        ranked_against(segment.topology, true).contains(&Topology::Disc) && reaches(Topology::Disc, segment.topology)
    );
    let model = Arc::new(scan);
    let encoded = Arc::new(encode(&model, 0, GO_ON).expect("encodable"));
    let facing = |topology| encoded.query.facing(topology).map(|query| query.encoding().topology);
    let all = [Topology::Annulus, Topology::Disc, Topology::Sphere];
    assert_eq!(all.map(facing), all.map(Some), "it is compared with each as one of these");

    let (example, query) = (side(12), Side { model, segment: 0, encoded });
    let fitted = fit(None, &example, &query, &Wishes::default(), GO_ON).expect("a map").mapped;
    assert!(matches!(fitted.verdict, Verdict::Good | Verdict::Fair), "{:?}", fitted.reasons);
    let laid = fitted.mesh.positions.iter().zip(&example.model.mesh.positions);
    let off = laid.filter(|(_, own)| !window(own.x, own.y)).map(|(x, own)| (x - own).norm()).fold(0.0, f64::max);
    assert!(off < 0.1, "{off}");
}

/// The dome as a scan with a horn of a height and a radius.
fn with_horn(height: f64, radius: f64) -> Side {
    let mut text = String::new();
    for line in dome(80).lines() {
        let numbers: Vec<f64> = line.split(' ').skip(1).filter_map(|word| word.parse().ok()).collect();
        let _ = match (line.starts_with("v "), &numbers[..]) {
            (true, &[x, y, z]) => {
                let horn = height * (1.0 - (x - 0.25).hypot(y + 0.3) / radius).max(0.0);
                writeln!(text, "v {x} {y} {}", z + horn)
            }
            _ => writeln!(text, "{line}"),
        };
    }
    let scan = read(text.as_bytes(), Some(Format::Obj), &Cut::default(), &Limits::default()).expect("a scan");
    let model = Arc::new(scan);
    let encoded = Arc::new(encode(&model, 0, GO_ON).expect("encodable"));
    Side { model, segment: 0, encoded }
}

#[test]
fn a_map_that_is_broken_by_a_horn_that_it_misses_is_not_once_it_has_one() {
    let (example, query) = (side(12), with_horn(0.9, 0.12));
    let fitted = |beyond| {
        let wishes = Wishes { beyond, ..Wishes::default() };
        fit(None, &example, &query, &wishes, GO_ON).expect("a map")
    };
    let bare = fitted(Beyond::Leave).mapped;
    assert_eq!(bare.verdict, Verdict::Broken, "{:?}", bare.reasons);
    let Fitted { mapped, example, query } = fitted(Beyond::Extend);
    let after = edited(&mapped.registration, &before_edit(&mapped), &example, &query, GO_ON).expect("a map");
    for extended in [mapped, after] {
        assert!(extended.verdict < Verdict::Poor, "{:?}", extended.reasons);
        assert!(extended.mesh.faces.len() > bare.mesh.faces.len() && extended.stitched.is_none());
        let extruded = extended.reasons.iter().filter(|why| why.contains("extruded")).count();
        assert_eq!(extruded, 1, "{:?}", extended.reasons);
    }
}

#[test]
fn a_scan_with_a_horn_that_the_example_lacks_gets_one_before_and_after_an_edit() {
    let (example, query) = (side(12), with_horn(0.6, 0.08));
    let fitted = |beyond| {
        let wishes = Wishes { beyond, ..Wishes::default() };
        fit(None, &example, &query, &wishes, GO_ON).expect("a map")
    };
    let top = |mapped: &Mapped| {
        let near = |p: &&Vec3| (p.x - 0.25).hypot(p.y + 0.3) < 0.1;
        mapped.mesh.positions.iter().filter(near).map(|p| p.z).fold(0.0, f64::max)
    };
    let extruded = |mapped: &Mapped| mapped.reasons.iter().filter(|why| why.contains("extruded")).count();
    let bare = fitted(Beyond::Leave).mapped;
    let Fitted { mapped, example, query } = fitted(Beyond::Extend);
    assert_eq!(extruded(&bare), 0);
    let covers = [&bare, &mapped].map(|mapped| mapped.reach.covers.input);
    assert!(covers[0] < 0.99 && covers[0] < covers[1], "{covers:?}");
    assert!(mapped.verdict < Verdict::Poor && top(&mapped) > top(&bare) + 0.3, "{:?}", mapped.reasons);
    assert_eq!(extruded(&mapped), 1);
    let before = mapped.reach.unextruded.as_ref().expect("a mesh without the horn");
    assert!(before.faces == bare.mesh.faces && mapped.mesh.faces.len() > before.faces.len());
    assert!(mapped.reach.inspired.is_some_and(|share| (0.8..1.0).contains(&share)), "{:?}", mapped.reach.inspired);

    let after = edited(&mapped.registration, &before_edit(&mapped), &example, &query, GO_ON).expect("a map");
    assert_eq!(extruded(&after), 1, "{:?}", after.reasons);
    assert!(top(&after) > top(&bare) + 0.3);
}

#[test]
fn what_an_edit_keeps_of_a_map_that_settled_is_the_evidence_and_new_folds_make_it_fair() {
    let (example, query) = (side(12), side(30));
    let mapped = map(&registered(&example, &query), &example, &query, GO_ON).expect("a map");
    let before = |verdict, folds| MapBeforeEdit {
        folds,
        verdict,
        reasons: vec!["as it was".into()],
        reach: MapExtent { covers: Covers { example: 0.5, input: 0.25 }, own: Some((3, 1)), ..MapExtent::default() },
        evidence: Some(crate::settle::Evidence::default()),
        sureness: Some(0.4),
    };
    let folded = Mapped { folds: 2, ..mapped.clone() };
    let after = folded.after(&before(Verdict::Good, 0));
    assert_eq!((after.verdict, after.reasons.len()), (Verdict::Fair, 2), "{:?}", after.reasons);
    assert_eq!((after.reach.covers.input, after.reach.own), (0.25, None), "rows are laid anew");
    let undone = Mapped { folds: 0, registration: after.registration.clone(), ..mapped.clone() };
    let undone = undone.after(&MapBeforeEdit { reasons: after.reasons, ..before(Verdict::Fair, 2) });
    assert_eq!(
        (undone.verdict, undone.reasons),
        (Verdict::Good, vec!["as it was".to_owned()]),
        "as before the first edit"
    );
    let mended = mapped.clone().after(&before(Verdict::Broken, 0));
    assert_eq!(mended.verdict, Verdict::Poor, "whether it is broken is seen anew");
    let plain = mapped.after(&MapBeforeEdit { evidence: None, ..before(Verdict::Poor, 0) });
    assert_eq!(plain.verdict, Verdict::Good, "a map of charts is judged by itself");
}

#[test]
fn an_input_that_is_cut_as_an_example_is_takes_it_whole() {
    let (example, input) = (model(12, CutMethod::Groups), model(30, CutMethod::Whole));
    assert_eq!(example.segments().len(), 2);
    let cut = alike(&input, &example, GO_ON).expect("alike");
    assert_eq!(cut.segments().len(), 2);
    let labels = cut.labels.as_ref().expect("a segment of each face");
    // Where the groups of the example meet, at x = 0, those of the input do.
    let middle =
        |face: &[u32]| face.iter().map(|&v| input.mesh.positions[v as usize]).sum::<Vec3>() / face.len() as f64;
    let sides: Vec<(f64, i64)> = input.mesh.faces.iter().zip(labels).map(|(f, l)| (middle(f).x, *l)).collect();
    let left = sides.iter().filter(|(x, l)| *x < -0.2 && *l == 0).count();
    let right = sides.iter().filter(|(x, l)| *x > 0.2 && *l == 1).count();
    let far = sides.iter().filter(|(x, _)| x.abs() > 0.2).count();
    assert!(left + right == far || left + right == 0, "{left} + {right} of {far}");

    let empty = Arc::clone(&example.mesh);
    let part = |segment| OnePart { segment, example_segment: segment, mesh: Arc::clone(&empty), is_edited: false };
    let whole = rejoin(&cut, &example, &[part(0), part(1)]).expect("whole");
    assert!(whole.mesh.faces == example.mesh.faces && whole.standing == [LayoutOwner::Example; 2]);
    assert!(rejoin(&cut, &example, &[part(0)]).is_none(), "one part of two is no whole");
    is_refused(alike(&input, &input, GO_ON), Refusal::Unlike);
}

#[test]
fn a_regular_layout_of_a_whole_input_follows_it_and_says_where_it_does_not() {
    let whole = template(&side(16), 0, GO_ON).expect("a layout");
    assert!(whole.flaws.is_empty() && whole.mesh.faces.len() > 100, "{:?}", whole.flaws);
}

#[test]
fn what_is_whole_is_read_cut_and_unfolded_as_one_mesh() {
    // A ball has no boundary: triangles with all their vertices on one are split to be unfolded.
    let ball = ball(60);
    let vertices = ball.positions.iter().map(|x| format!("v {} {} {}\n", x.x, x.y, x.z));
    let faces = ball.triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    let text: String = vertices.chain(faces).collect();
    let model = read(text.as_bytes(), Some(Format::Obj), &Cut::default(), &Limits::default()).expect("a ball");
    let patch = model.patch(0).expect("one segment");
    assert!(Arc::ptr_eq(&model.prepared.mesh, &model.segmented.mesh));
    assert!(Arc::ptr_eq(&model.prepared.mesh, &patch.mesh));
    let encoded = encode(&model, 0, &|| false).expect("unfolded");
    assert!(Arc::ptr_eq(&patch.mesh, encoded.query.unfolder().mesh()));
}

#[test]
fn each_stage_ends_when_it_is_told_to_stop() {
    let (example, query) = (side(8), side(16));
    let from = registered(&example, &query);
    let enough: Stop = &|| true;
    let regular = [Part::Template(Arc::clone(&query.encoded))];
    let ended = [
        encode(&query.model, 0, enough).map(|_| ()),
        map(&from, &example, &query, enough).map(|_| ()),
        fit(Some(&from), &example, &query, &Wishes::default(), enough).map(|_| ()),
        template(&query, 0, enough).map(|_| ()),
        compose(&query.model, &regular, StitchOptions::default(), enough).map(|_| ()),
    ];
    assert!(ended.iter().all(|end| *end == Err(PipelineError::Stopped)), "{ended:?}");
}

#[test]
fn a_segment_that_is_not_there_and_labels_that_ask_for_too_many_are_told() {
    let (one, two) = (model(8, CutMethod::Whole), model(8, CutMethod::Groups));
    assert_eq!((one.segments().len(), two.segments().len()), (1, 2));
    assert!(matches!(encode(&one, 1, GO_ON), Err(PipelineError::Internal(_))));
    let labels: Vec<i64> = (0..=SEGMENTS_MAX as i64).collect();
    is_refused(few(&labels), Refusal::LabelsInvalid);
    assert!(few(&labels[1..]).is_ok());
}

#[test]
fn a_map_that_is_split_follows_its_input_more_closely_and_its_rims_stay_where_they_are() {
    let window = |x: f64, y: f64| (-0.4..0.2).contains(&x) && (-0.4..0.2).contains(&y);
    let query = model(60, CutMethod::Whole);
    let text = dome_without(10, window);
    let coarse = read(text.as_bytes(), Some(Format::Obj), &Cut::default(), &Limits::default()).expect("a ring");
    let whole = Stitched::as_it_is(Arc::clone(&coarse.mesh), vec![LayoutOwner::Example]);
    let whole_bridging = Stitched { bridging: vec![0, 3], ..whole.clone() };
    let made = split(&query, &whole_bridging, 0).expect("few faces");
    assert!(split(&query, &made, 2).is_none(), "twice is enough");
    assert_eq!(made.mesh.faces.len(), 4 * coarse.mesh.faces.len());
    assert_eq!(made.bridging, [0, 1, 2, 3, 12, 13, 14, 15]);
    assert!(made.notes[0].contains("split once"), "{:?}", made.notes);
    let tree = Bvh::new(query.surface());
    let own = coarse.mesh.positions.len();
    assert!(made.mesh.positions[..own] == coarse.mesh.positions[..]);
    assert!(made.mesh.positions[own..].iter().all(|p| tree.closest(*p).distance < 1e-9));
    // The window's rim is not drawn to the dome's.
    let is_at_rim = |p: &&Vec3| p.x.abs().max(p.y.abs()) > 1.0 - 1e-9;
    let at_rim = [&coarse.mesh, &made.mesh].map(|mesh| mesh.positions.iter().filter(is_at_rim).count());
    assert_eq!(at_rim, [40, 80]);
    let away = |made: &Stitched| appraise(&query, made, AllowedFlaws::default()).away;
    let [before, after] = [away(&whole), away(&Stitched { bridging: Vec::new(), ..made })];
    assert!(before > 0.002 && after < 0.35 * before, "{before} {after}");
}
