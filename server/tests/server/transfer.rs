//! An input cut as an example is cut: on a mesh made by code, and on two horses in different poses.

use quadmuse_kernel::mesh::bvh::Bvh;
use quadmuse_kernel::mesh::{Format, Limits, PolyMesh, Vec3, prepare, read, write};
use quadmuse_proto::{ConstraintEdit, MeshFormat, NewConstraint, Parts, Place};
use quadmuse_server::demo;
use quadmuse_server::pool::Stop;
use quadmuse_server::work::engine::kernel::KernelEngine;
use quadmuse_server::work::engine::{
    Cut, Engine, EngineError, Grain, Mapped, Model, Part, Refusal, Side, StitchOptions,
};
use std::path::PathBuf;
use std::sync::Arc;

/// The parts of example and input agree on so much of the area.
const OVERLAP_MIN: f64 = 0.9;

/// The query is so many times as large.
const LARGER: f64 = 3.0;

fn model(bytes: &[u8], cut: Cut) -> Model {
    let format = match Format::sniff(bytes) {
        Some(Format::Ply) => MeshFormat::Ply,
        _ => MeshFormat::Obj,
    };
    KernelEngine::default().read(bytes, Some(format), &cut, &Stop::new(None)).expect("a mesh")
}

/// Cut into its protrusions, between faces, as an example is.
fn parted(bytes: &[u8]) -> Model {
    model(bytes, Cut { parts: Some(Parts::Auto), grain: Grain::Faces, ..Cut::default() })
}

fn whole(bytes: &[u8]) -> Model {
    model(bytes, Cut::default())
}

fn labels(model: &Model) -> &[i64] {
    model.labels.as_deref().expect("labels")
}

fn corners<'a>(mesh: &'a PolyMesh, face: &'a [u32]) -> impl Iterator<Item = Vec3> + 'a {
    face.iter().map(|&v| mesh.positions[v as usize])
}

/// The share of the area of triangles at which `of_face` tells the wanted label, and the least such share of a part.
fn overlap(mesh: &PolyMesh, of_face: &[i64], wanted: &[i64]) -> (f64, f64) {
    let area = |face: &[u32]| {
        let x: Vec<Vec3> = corners(mesh, face).collect();
        (2..x.len()).map(|k| (x[k - 1] - x[0]).cross(&(x[k] - x[0])).norm() / 2.0).sum::<f64>()
    };
    let parts = wanted.iter().max().map_or(0, |m| *m as usize + 1);
    let (mut both, mut either) = (vec![0.0; parts], vec![0.0; parts]);
    for ((face, &is), &should) in mesh.faces.iter().zip(of_face).zip(wanted) {
        let area = area(face);
        either[should as usize] += area;
        if is == should {
            both[is as usize] += area;
        } else if let Some(other) = either.get_mut(is as usize) {
            *other += area;
        }
    }
    let least = both.iter().zip(&either).map(|(b, e)| b / e).fold(1.0, f64::min);
    let total: f64 = mesh.faces.iter().map(area).sum();
    (both.iter().sum::<f64>() / total, least)
}

/// The mesh in triangles, two for each quad, and larger.
fn in_triangles(mesh: &PolyMesh) -> PolyMesh {
    let fan = mesh.faces.iter().flat_map(|f| (2..f.len()).map(move |k| [f[0], f[k - 1], f[k]]));
    let triangles: Vec<[u32; 3]> = fan.collect();
    PolyMesh {
        positions: mesh.positions.iter().map(|x| x * LARGER).collect(),
        faces: triangles.iter().map(|t| &t[..]).collect(),
        ..PolyMesh::default()
    }
}

/// A sample that is cut into several parts.
fn sample() -> (PolyMesh, Model) {
    let cut = |mesh: &PolyMesh| parted(&write(mesh, Format::Obj).expect("writes"));
    let several = demo::corpus().into_iter().map(|s| (cut(&s.mesh), s.mesh)).find(|(cut, _)| cut.segments.len() > 2);
    let (cut, mesh) = several.expect("a sample with protrusions");
    (mesh, cut)
}

#[test]
fn a_made_body_is_cut_as_the_same_body_of_other_triangles() {
    let (mesh, example) = sample();
    let triangles = in_triangles(&mesh);
    let query = whole(&write(&triangles, Format::Obj).expect("writes"));
    let alike = KernelEngine::default().alike(&query, &example, &Stop::new(None)).expect("cut alike");
    let topologies = |m: &Model| m.segments.iter().map(|s| s.topology).collect::<Vec<_>>();
    assert_eq!(topologies(&alike), topologies(&example));
    let wanted: Vec<i64> =
        mesh.faces.iter().zip(labels(&example)).flat_map(|(f, &l)| std::iter::repeat_n(l, f.len() - 2)).collect();
    let (all, least) = overlap(&triangles, labels(&alike), &wanted);
    assert!(all > OVERLAP_MIN, "parts agree on {all:.3} of the area, the worst on {least:.3}");
}

/// The sample, cut, and the same in triangles, cut alike.
fn cut_alike() -> (PolyMesh, Arc<Model>, Arc<Model>) {
    let (mesh, example) = sample();
    let query = whole(&write(&in_triangles(&mesh), Format::Obj).expect("writes"));
    let query = KernelEngine::default().alike(&query, &example, &Stop::new(None)).expect("cut alike");
    (mesh, Arc::new(example), Arc::new(query))
}

fn side(model: &Arc<Model>, segment: u32) -> Side {
    let encoded = KernelEngine::default().encode(model, segment, &Stop::new(None)).expect("encodes");
    Side { model: Arc::clone(model), segment, encoded: Arc::new(encoded) }
}

/// Segment k of an example on segment k of a query that was cut alike.
fn mapped(example: &Side, query: &Side) -> Mapped {
    let (engine, stop) = (KernelEngine::default(), Stop::new(None));
    let (one, two) = (&example.encoded.encoding, &query.encoded.encoding);
    let coarse = engine.coarse(one, two, &stop).expect("registers");
    let finished = engine.finish(&coarse, one, two, &stop).expect("registers");
    engine.map(&finished, example, query, &stop).expect("maps")
}

/// The vertices of the example that a part's faces use, in order.
fn vertices(example: &Model, part: u32) -> Vec<usize> {
    let mut used = vec![false; example.mesh.positions.len()];
    for (face, _) in example.mesh.faces.iter().zip(labels(example)).filter(|(_, l)| **l == i64::from(part)) {
        face.iter().for_each(|&v| used[v as usize] = true);
    }
    (0..used.len()).filter(|&v| used[v]).collect()
}

#[test]
fn parts_of_that_example_lie_where_it_lies_whole_and_hang_together_beside_another() {
    let (engine, stop) = (KernelEngine::default(), Stop::new(None));
    let (mesh, example, query) = cut_alike();
    let count = example.segments.len() as u32;
    let sides: Vec<(Side, Side)> = (0..count).map(|s| (side(&example, s), side(&query, s))).collect();
    let maps: Vec<Mapped> = sides.iter().map(|(one, two)| mapped(one, two)).collect();
    // What two parts share they take to one place, though each was mapped on its own segment.
    let mut places: Vec<Vec<Vec3>> = vec![Vec::new(); mesh.positions.len()];
    for (part, map) in (0..count).zip(&maps) {
        assert!(map.is_of_whole);
        vertices(&example, part).into_iter().zip(&map.mesh.positions).for_each(|(v, x)| places[v].push(*x));
    }
    let shared: Vec<f64> = places.iter().filter(|p| p.len() > 1).map(|p| (p[0] - p[1]).norm()).collect();
    let size = LARGER * mesh.positions.iter().map(|x| x.norm()).fold(0.0, f64::max);
    let near = |share: f64| shared.iter().filter(|d| **d < share * size).count();
    assert!(10 * near(0.02) > 9 * shared.len() && near(0.06) == shared.len(), "{shared:?} of {size}");
    // One part gives way to a regular layout: of the others every face stays.
    let given = count - 1;
    let part = |s: u32| match s == given {
        true => Part::Template(Arc::clone(&sides[s as usize].1.encoded)),
        false => Part::OfWhole(Arc::clone(&maps[s as usize].part)),
    };
    let parts: Vec<Part> = (0..count).map(part).collect();
    let made = engine.compose(&query, &parts, StitchOptions { smoothing: 5, density: 0 }, &stop).expect("stitches");
    let kept = labels(&example).iter().filter(|l| **l != i64::from(given)).count();
    let found = made.mesh.faces.iter().filter(|f| f.len() == 4).count();
    assert_eq!(found, made.mesh.faces.len());
    assert!(found > kept && found < kept + 4000, "{found} quads, {kept} kept; {:?}", made.notes);
    assert_eq!(made.notes, [format!("segment {given} is a regular layout")]);
}

#[test]
fn an_edit_bends_what_the_whole_laid_near_the_constraint() {
    let (engine, stop) = (KernelEngine::default(), Stop::new(None));
    let (mesh, example, query) = cut_alike();
    let (one, two) = (side(&example, 0), side(&query, 0));
    let before = mapped(&one, &two);
    // A vertex inside is moved to where its neighbour lies.
    let own = vertices(&example, 0);
    let at = |v: u32| own.iter().position(|&w| w == v as usize).map(|k| before.mesh.positions[k]);
    // Its faces close around it, and are all of this part.
    let is_inside = |v: &usize| {
        let v = *v as u32;
        let around = || example.mesh.faces.iter().zip(labels(&example)).filter(|(f, _)| f.contains(&v));
        let mut ends: Vec<u32> = around()
            .flat_map(|(f, _)| {
                let k = f.iter().position(|&w| w == v).unwrap_or(0);
                [f[(k + 1) % f.len()], f[(k + f.len() - 1) % f.len()]]
            })
            .collect();
        ends.sort_unstable();
        ends.dedup();
        around().all(|(_, l)| *l == 0) && around().count() == ends.len()
    };
    let inner = own.iter().copied().find(is_inside).expect("a vertex inside") as u32;
    let face = example.mesh.faces.iter().find(|f| f.contains(&inner)).expect("its face");
    let k = face.iter().position(|&v| v == inner).expect("a corner");
    let (from, beside) = (at(inner).expect("mapped"), at(face[(k + 1) % face.len()]).expect("mapped"));
    let to = from + (beside - from) * 0.6;
    let set = NewConstraint {
        id: None,
        on_example: Some(Place::Point(mesh.positions[inner as usize].into())),
        on_input: Some(Place::Point(to.into())),
    };
    let edit = ConstraintEdit { set: vec![set], ..ConstraintEdit::default() };
    let edited = |map: &Mapped, edit: &ConstraintEdit| {
        let registration = engine.constrain(map, edit, &one, &two, &stop).expect("an edit");
        engine.map(&registration, &one, &two, &stop).expect("maps")
    };
    let after = edited(&before, &edit);
    assert!(!after.is_of_whole);
    assert_eq!(after.mesh.faces, before.mesh.faces);
    let moves = |a: &Mapped, b: &Mapped| -> Vec<f64> {
        a.mesh.positions.iter().zip(&b.mesh.positions).map(|(a, b)| (a - b).norm()).collect()
    };
    let moved = moves(&before, &after);
    let k = own.iter().position(|&v| v == inner as usize).expect("mapped");
    assert!((after.mesh.positions[k] - to).norm() < 0.2 * (to - from).norm(), "{moved:?}");
    // Far from it nothing moves.
    let (still, all) = (moved.iter().filter(|d| **d < 0.05 * (to - from).norm()).count(), moved.len());
    assert!(4 * still > all, "{still} of {all} stay");
    // Undone, all is as it was; a feature that is removed is listed no more, and nothing moves.
    let undone = edited(&after, &ConstraintEdit { undo: vec!["c1".into()], ..ConstraintEdit::default() });
    assert!(undone.is_of_whole && moves(&before, &undone).iter().all(|d| *d == 0.0));
    let less = edited(&before, &ConstraintEdit { remove: vec!["f0".into()], ..ConstraintEdit::default() });
    assert!(moves(&before, &less).iter().all(|d| *d == 0.0));
    let lists = |map: &Mapped, id: &str| map.constraints.iter().any(|c| c.id == id);
    assert!(lists(&before, "f0") && !lists(&less, "f0"));
}

#[test]
fn what_cannot_be_cut_alike_is_refused_in_words() {
    let (mesh, example) = sample();
    let engine = KernelEngine::default();
    let refused = |query: &Model, example: &Model| match engine.alike(query, example, &Stop::new(None)) {
        Err(EngineError::Refused { refusal: Refusal::Unlike, detail }) => detail,
        other => panic!("expected a refusal, found {other:?}"),
    };
    let uncut = whole(&write(&mesh, Format::Obj).expect("writes"));
    assert!(refused(&uncut, &uncut).contains("several segments"));
    let ring = demo::corpus().into_iter().map(|s| whole(&write(&s.mesh, Format::Obj).expect("writes")));
    let other = ring.into_iter().find(|m| m.segments[0].topology != uncut.segments[0].topology).expect("another kind");
    assert!(refused(&other, &example).contains("found a"), "{}", refused(&other, &example));
}

#[test]
fn a_horse_is_cut_as_a_horse_in_another_pose() {
    let Some(shared) = std::env::var_os("QUADMUSE_SHARED").map(PathBuf::from).filter(|p| p.is_dir()) else {
        eprintln!("left out: no shared meshes (set QUADMUSE_SHARED)");
        return;
    };
    let folder = shared.join("meshes/groundtruth");
    let pair = "animal_horse_jump_f18__animal_horse_run_f10.obj";
    let bytes = |name: String| std::fs::read(folder.join(name)).expect("reads");
    let example = parted(&bytes("example_animal_horse_jump_f18.obj".into()));
    let query = whole(&bytes(format!("input_{pair}")));
    let alike = KernelEngine::default().alike(&query, &example, &Stop::new(None)).expect("cut alike");
    // The truth has the example's faces at the input's places: each face of the input belongs where the nearest does.
    let truth = read(&bytes(format!("truth_{pair}")), Some(Format::Obj), &Limits::default()).expect("reads");
    let surface = prepare(&truth).expect("manifold").mesh;
    let bvh = Bvh::new(&surface);
    let middle = |face: &[u32]| corners(&query.mesh, face).sum::<Vec3>() / face.len() as f64;
    let wanted: Vec<i64> = query
        .mesh
        .faces
        .iter()
        .map(|f| labels(&example)[surface.polygon_of[bvh.closest(middle(f)).triangle as usize] as usize])
        .collect();
    let (all, least) = overlap(&query.mesh, labels(&alike), &wanted);
    eprintln!("{} parts agree on {all:.3} of the area, the worst on {least:.3}", alike.segments.len());
    assert!(all > OVERLAP_MIN, "parts agree on {all:.3} of the area, the worst on {least:.3}");
}
