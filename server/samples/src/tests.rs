//! Every sample is what it says it is.

use super::*;
use quadmuse_kernel::mesh::TriMesh;
use quadmuse_kernel::mesh::tri::prev;
use std::collections::BTreeSet;

/// Triangles of all polygons, as fans.
fn fans(mesh: &PolyMesh) -> TriMesh {
    let triangles = mesh.faces.iter().flat_map(|f| (1..f.len() - 1).map(|k| [f[0], f[k], f[k + 1]])).collect();
    TriMesh::from_triangles(mesh.positions.clone(), triangles).expect("manifold and oriented")
}

fn check_topology(sample: &Sample) {
    let name = &sample.name;
    let tri = fans(&sample.mesh);
    let (loops, edges) = (
        tri.boundary_loops(),
        (0..tri.twins.len()).filter(|&h| tri.twins[h] == NONE || (h as u32) < tri.twins[h]).count(),
    );
    let euler = tri.positions.len() as i64 - edges as i64 + tri.triangles.len() as i64;
    let expected = match sample.tags.last().map(String::as_str) {
        Some("disc") => (1, 1),
        Some("annulus") => (0, 2),
        Some("sphere") => (2, 0),
        other => panic!("{name}: the last tag must be the topology, found {other:?}"),
    };
    assert_eq!((euler, loops.len()), expected, "{name}");
    // One component, no isolated vertex, no vertex that joins two fans: walking reaches all, fans hold all.
    let mut fan = vec![0; tri.positions.len()];
    tri.triangles.iter().flatten().for_each(|&v| fan[v as usize] += 1);
    let out = tri.outgoing();
    for v in 0..tri.positions.len() {
        assert_ne!(out[v], NONE, "{name}: vertex {v} is isolated");
        let (mut h, mut count) = (out[v], 0);
        loop {
            count += 1;
            h = tri.twin(prev(h));
            if h == NONE || h == out[v] {
                break;
            }
        }
        assert_eq!(count, fan[v], "{name}: vertex {v} joins two fans");
    }
    let mut seen = vec![false; tri.triangles.len()];
    let mut queue = vec![0u32];
    while let Some(t) = queue.pop() {
        if !std::mem::replace(&mut seen[t as usize], true) {
            queue.extend((0..3).map(|k| tri.twin(3 * t + k)).filter(|&h| h != NONE).map(|h| h / 3));
        }
    }
    assert!(seen.iter().all(|&s| s), "{name} has more than one component");
}

/// Six times the volume between the surface and its centre: positive where the outside is outside.
fn volume(mesh: &PolyMesh) -> f64 {
    let centre = mesh.positions.iter().sum::<Vec3>() / mesh.positions.len() as f64;
    let tri = fans(mesh);
    tri.triangles
        .iter()
        .map(|t| t.map(|v| tri.positions[v as usize] - centre))
        .map(|[a, b, c]| a.cross(&b).dot(&c))
        .sum()
}

#[test]
fn every_sample_has_the_topology_it_names_and_faces_outwards() {
    let samples: Vec<Sample> = corpus().into_iter().chain(inputs()).collect();
    for sample in &samples {
        check_topology(sample);
        assert!(volume(&sample.mesh) > 0.0, "{} is inside out", sample.name);
    }
    let names: BTreeSet<&str> = samples.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names.len(), samples.len(), "names are unique");
}

#[test]
fn the_corpus_is_sixteen_or_more_pure_quad_meshes_of_an_artists_density() {
    let corpus = corpus();
    assert!(corpus.len() >= 16);
    for sample in &corpus {
        assert!(sample.mesh.faces.iter().all(|f| f.len() == 4), "{}", sample.name);
        assert!((300..=6_000).contains(&sample.mesh.faces.len()), "{}: {}", sample.name, sample.mesh.faces.len());
        assert!((0.0..=5.0).contains(&sample.relevance));
    }
    for topology in ["disc", "annulus", "sphere"] {
        let count = corpus.iter().filter(|s| s.tags.last().is_some_and(|t| t == topology)).count();
        assert!(count >= 3, "{topology}: {count}");
    }
}

#[test]
fn every_example_has_named_groups_and_a_uv_a_corner_within_the_unit_square() {
    for sample in corpus() {
        let (mesh, name) = (&sample.mesh, &sample.name);
        let groups = mesh.attributes.groups.as_ref().expect("groups");
        assert_eq!(groups.of_face.len(), mesh.faces.len());
        assert!(groups.names.len() >= 3, "{name}: {:?}", groups.names);
        let used: BTreeSet<u32> = groups.of_face.iter().copied().collect();
        assert!(used.into_iter().eq(0..groups.names.len() as u32), "{name}: each group is used");
        let uvs = mesh.attributes.uvs.as_ref().expect("uvs");
        assert_eq!(uvs.corners.len(), mesh.faces.corners().len());
        assert!(uvs.values.iter().flatten().all(|x| (0.0..=1.0).contains(x)), "{name}");
        let area = |f: usize| {
            let [a, b, c, d] = std::array::from_fn(|k| uvs.values[uvs.corners[4 * f + k] as usize]);
            (c[0] - a[0]) * (d[1] - b[1]) - (c[1] - a[1]) * (d[0] - b[0])
        };
        let collapsed = (0..mesh.faces.len()).filter(|&f| area(f).abs() < 1e-12).count();
        assert!(collapsed * 50 < mesh.faces.len(), "{name}: {collapsed} faces have no uv area");
    }
    let groups = |name: &str| {
        let sample = corpus().into_iter().find(|s| s.name == name).expect("a sample of that name");
        sample.mesh.attributes.groups.expect("groups").names
    };
    let man = groups("head_man");
    for part in ["neck", "eye_l", "eye_r", "mouth", "nose", "ear_l", "ear_r"] {
        assert!(man.iter().any(|g| g == part), "head_man has no {part}: {man:?}");
    }
}

#[test]
fn no_example_has_sliver_quads_or_is_its_own_mirror_image() {
    for sample in corpus() {
        let mesh = &sample.mesh;
        let place = |v: u32| mesh.positions[v as usize];
        let bad = mesh.faces.iter().filter(|f| {
            let [a, b, c, d] = [place(f[0]), place(f[1]), place(f[2]), place(f[3])];
            let area = 0.5 * (c - a).cross(&(d - b)).norm();
            let longest = [(b - a), (c - b), (d - c), (a - d)].iter().map(|e| e.norm_squared()).fold(0.0, f64::max);
            area < 0.02 * longest
        });
        let bad = bad.count();
        assert!(bad * 100 <= mesh.faces.len(), "{}: {bad} slivers of {}", sample.name, mesh.faces.len());
        let key = |p: &Vec3, side: f64| [side * p.x, p.y, p.z].map(|x| (x * 1e6).round() as i64);
        let all: BTreeSet<[i64; 3]> = mesh.positions.iter().map(|p| key(p, 1.0)).collect();
        let mirrored = mesh.positions.iter().filter(|p| all.contains(&key(p, -1.0))).count();
        assert!(mirrored * 10 < mesh.positions.len(), "{}: {mirrored} mirrored vertices", sample.name);
    }
}

#[test]
fn the_inputs_are_irregular_triangles_without_a_vertex_of_the_corpus() {
    let known: BTreeSet<[u64; 3]> = corpus()
        .iter()
        .flat_map(|s| s.mesh.positions.iter().map(|p| [p.x, p.y, p.z].map(f64::to_bits)).collect::<Vec<_>>())
        .collect();
    let inputs = inputs();
    assert_eq!(inputs.len(), 3);
    for sample in &inputs {
        let (mesh, name) = (&sample.mesh, &sample.name);
        assert!((8_000..=20_000).contains(&mesh.faces.len()), "{name}: {} triangles", mesh.faces.len());
        assert!(mesh.faces.iter().all(|f| f.len() == 3), "{name}");
        assert_eq!(mesh.attributes, Attributes::default(), "{name}");
        assert!(mesh.positions.iter().all(|p| !known.contains(&[p.x, p.y, p.z].map(f64::to_bits))), "{name}");
        let mut valence = vec![0usize; mesh.positions.len()];
        mesh.faces.corners().iter().for_each(|&v| valence[v as usize] += 1);
        let six = valence.iter().filter(|&&n| n == 6).count();
        // Cut quads have nearly all vertices of valence 6; an even remesh has some three quarters.
        assert!(six * 100 < 80 * valence.len(), "{name}: {six} of {} vertices are regular", valence.len());
        assert!(valence.iter().all(|&n| n <= 12), "{name}");
    }
}

#[test]
fn the_demo_is_the_same_every_time() {
    let (a, b) = (inputs(), inputs());
    assert!(a.iter().zip(&b).all(|(x, y)| x.mesh == y.mesh));
    assert_eq!(corpus()[0].mesh, corpus()[0].mesh);
}
