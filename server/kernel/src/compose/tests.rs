//! Parts made by code, stitched: spheres of discs, tori of annuli, junctions, true boundaries, unlike densities.

use super::*;
use crate::mesh::Vec3;
use crate::topology::tests::grid;
use check::{TopologyCounts, check};
use layout::Curve;
use smooth::Target;

/// Composes mapped parts, as dense as they are.
fn laid(input: Input<'_>, parts: &[PolyMesh]) -> Result<Composed, ComposeError> {
    let pieces: Vec<Piece<'_>> = parts.iter().map(Piece::Mapped).collect();
    compose(input, &pieces, Options { closeness: Closeness::AsBrought, ..Options::default() }, &|| false)
}

/// A sphere of triangles: a subdivided octahedron.
fn sphere(rounds: usize) -> TriMesh {
    let mut positions: Vec<Vec3> = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
        .map(|p| Vec3::from(p.map(f64::from)))
        .into();
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for (x, sx) in [(0, 1), (1, -1)] {
        for (y, sy) in [(2, 1), (3, -1)] {
            for (z, sz) in [(4, 1), (5, -1)] {
                triangles.push(if sx * sy * sz > 0 { [x, y, z] } else { [x, z, y] });
            }
        }
    }
    for _ in 0..rounds {
        let mut middle = std::collections::BTreeMap::new();
        let mut finer = Vec::new();
        for t in &triangles {
            let m = [0, 1, 2].map(|k| {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                *middle.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    positions.push((positions[a as usize] + positions[b as usize]).normalize());
                    positions.len() as u32 - 1
                })
            });
            finer.extend([[t[0], m[0], m[2]], [t[1], m[1], m[0]], [t[2], m[2], m[1]], m]);
        }
        triangles = finer;
    }
    TriMesh::from_triangles(positions, triangles).expect("a sphere")
}

fn centre(mesh: &TriMesh, t: usize) -> Vec3 {
    mesh.triangles[t].iter().map(|&v| mesh.positions[v as usize]).sum::<Vec3>() / 3.0
}

fn owners(mesh: &TriMesh, of: impl Fn(Vec3) -> u32) -> Vec<u32> {
    (0..mesh.triangles.len()).map(|t| of(centre(mesh, t))).collect()
}

/// A disc of k × k quads inside a curve, its columns ending on the curve at even distances from `offset`.
fn disc(curve: &Curve, k: u32, offset: f64, target: &Target) -> PolyMesh {
    let middle = curve.points.iter().sum::<Vec3>() / curve.points.len() as f64;
    let middle = target.onto_surface(middle);
    let mut positions = Vec::new();
    for y in 0..=k {
        for x in 0..=k {
            let (p, q) = (2.0 * f64::from(x) / f64::from(k) - 1.0, 2.0 * f64::from(y) / f64::from(k) - 1.0);
            let rho = p.abs().max(q.abs());
            let (a, b) = (p / rho.max(1e-9), q / rho.max(1e-9));
            let around = if b <= -1.0 + 1e-9 {
                (a + 1.0) / 2.0
            } else if a >= 1.0 - 1e-9 {
                1.0 + (b + 1.0) / 2.0
            } else if b >= 1.0 - 1e-9 {
                2.0 + (1.0 - a) / 2.0
            } else {
                3.0 + (1.0 - b) / 2.0
            };
            let border = curve.point(curve.length() * around / 4.0 + offset);
            let inside = middle + (border - middle) * rho;
            positions.push(if rho > 1.0 - 1e-9 { border } else { target.onto_surface(inside) });
        }
    }
    let at = |x: u32, y: u32| y * (k + 1) + x;
    let cells = (0..k).flat_map(|y| (0..k).map(move |x| (x, y)));
    let faces = cells.map(|(x, y)| vec![at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]).collect();
    Net::new(positions, faces).into_mesh().0
}

/// Stitches discs of k × k quads, one a segment, and checks them anew.
fn of_discs(mesh: &TriMesh, owner: &[u32], sizes: &[u32]) -> Composed {
    let found = layout::layout(mesh, owner, sizes.len());
    let target = Target::new(mesh);
    let parts: Vec<PolyMesh> =
        sizes.iter().enumerate().map(|(s, &k)| disc(&found.curves[s][0], k, 0.013 * s as f64, &target)).collect();
    let input = Input { surface: mesh, owner, count: sizes.len() };
    let made = laid(input, &parts).expect("valid parts");
    assert_eq!(check(&made.mesh, TopologyCounts::of(mesh)), Ok(()));
    made
}

#[test]
fn two_half_spheres_of_like_counts_are_merged_row_to_row() {
    let mesh = sphere(4);
    let owner = owners(&mesh, |p| u32::from(p.z > 0.0));
    let made = of_discs(&mesh, &owner, &[6, 6]);
    let report = made.report;
    assert_eq!((report.way, report.merged, report.filled, report.resolved.cuts), (Way::Direct, 24, 0, 0));
    assert_eq!(made.mesh.faces.len(), 72);
    // The corners of the squares lie on the seam; beside them every vertex is regular.
    assert!(report.extraordinary_after <= 8, "{}", report.extraordinary_after);
}

#[test]
fn half_spheres_of_unlike_counts_are_stitched_with_few_extraordinary_vertices() {
    let mesh = sphere(4);
    let owner = owners(&mesh, |p| u32::from(p.z > 0.0));
    for (a, b) in [(6, 7), (5, 8), (4, 12), (12, 4), (3, 16), (1, 12), (2, 40)] {
        let made = of_discs(&mesh, &owner, &[a, b]);
        let most = 8 + 10 * a.abs_diff(b) as usize;
        assert!(made.report.extraordinary_after <= most, "{a}, {b}: {:?}", made.report);
        assert_eq!(made.report.way.max(Way::PartsSubdivided), Way::PartsSubdivided, "{a}, {b}");
    }
}

#[test]
fn parts_close_where_three_and_four_of_them_meet() {
    let mesh = sphere(4);
    let eight = owners(&mesh, |p| u32::from(p.x > 0.0) + 2 * u32::from(p.y > 0.0) + 4 * u32::from(p.z > 0.0));
    of_discs(&mesh, &eight, &[4; 8]);
    of_discs(&mesh, &eight, &[4, 5, 6, 7, 3, 9, 2, 1]);
    let three = owners(&mesh, |p| ((p.y.atan2(p.x) / std::f64::consts::TAU + 0.5) * 3.0).min(2.9) as u32);
    of_discs(&mesh, &three, &[5, 6, 7]);
    of_discs(&mesh, &three, &[1, 1, 1]);
}

#[test]
fn true_boundaries_are_open_again_at_the_end() {
    let mesh = grid(16, 16, false, false);
    let owner = owners(&mesh, |p| if p.x < 0.5 { 0 } else { 1 + u32::from(p.y > 0.5) });
    for sizes in [[4, 4, 4], [3, 5, 4], [7, 2, 3], [6, 5, 5]] {
        let made = of_discs(&mesh, &owner, &sizes);
        let off = made.mesh.positions.iter().map(|p| p.z.abs()).fold(0.0, f64::max);
        assert!(off < 1e-12);
    }
}

/// A ring of a torus between two angles, as quads.
fn ring(columns: u32, rows: u32, from: f64, to: f64) -> PolyMesh {
    let tau = std::f64::consts::TAU;
    let mut positions = Vec::new();
    for j in 0..=rows {
        let a = tau * (from + (to - from) * f64::from(j) / f64::from(rows));
        for i in 0..columns {
            let b = tau * f64::from(i) / f64::from(columns);
            positions.push(Vec3::new((2.0 + b.cos()) * a.cos(), (2.0 + b.cos()) * a.sin(), b.sin()));
        }
    }
    let at = |i: u32, j: u32| j * columns + i % columns;
    let cells = (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j)));
    let quad = |(i, j)| vec![at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
    Net::new(positions, cells.map(quad).collect()).into_mesh().0
}

#[test]
fn rings_make_a_torus_of_genus_one() {
    let mesh = grid(48, 24, true, true);
    let angle = |t: usize| (t / 2 % 48) as u32;
    for cuts in [vec![0, 24], vec![0, 10, 30]] {
        let owner: Vec<u32> =
            (0..mesh.triangles.len()).map(|t| cuts.iter().filter(|&&c| c <= angle(t)).count() as u32 - 1).collect();
        for (columns, rows) in [([12, 12, 12], 6), ([12, 14, 9], 4), ([8, 30, 12], 3), ([10, 10, 10], 1)] {
            let ends = |s: usize| cuts.get(s).copied().unwrap_or(48) as f64 / 48.0;
            let parts: Vec<PolyMesh> = (0..cuts.len()).map(|s| ring(columns[s], rows, ends(s), ends(s + 1))).collect();
            let input = Input { surface: &mesh, owner: &owner, count: cuts.len() };
            let made = laid(input, &parts).expect("valid parts");
            assert_eq!(check(&made.mesh, TopologyCounts::of(&mesh)), Ok(()));
            let is_even = columns.iter().take(cuts.len()).all(|c| *c == columns[0]);
            if is_even && rows > 1 {
                assert_eq!(made.report.extraordinary_after, 0, "{cuts:?} {columns:?}: {:?}", made.report);
            }
        }
    }
}

#[test]
fn a_part_turned_inside_out_is_turned_back() {
    let mesh = sphere(3);
    let owner = owners(&mesh, |p| u32::from(p.z > 0.0));
    let found = layout::layout(&mesh, &owner, 2);
    let target = Target::new(&mesh);
    let mut parts: Vec<PolyMesh> = (0..2).map(|s| disc(&found.curves[s][0], 6, 0.0, &target)).collect();
    parts[1].faces = parts[1]
        .faces
        .iter()
        .map(|f| f.iter().rev().copied().collect::<Vec<u32>>())
        .collect::<Vec<_>>()
        .iter()
        .map(|f| &f[..])
        .collect();
    let input = Input { surface: &mesh, owner: &owner, count: 2 };
    let made = laid(input, &parts).expect("valid parts");
    assert_eq!((check(&made.mesh, TopologyCounts::of(&mesh)), made.report.way), (Ok(()), Way::Direct));
}

#[test]
fn triangles_and_polygons_of_the_parts_are_resolved() {
    let mesh = sphere(4);
    let owner = owners(&mesh, |p| u32::from(p.z > 0.0));
    let found = layout::layout(&mesh, &owner, 2);
    let target = Target::new(&mesh);
    let mut parts: Vec<PolyMesh> = (0..2).map(|s| disc(&found.curves[s][0], 8, 0.0, &target)).collect();
    let mut net = Net::from_mesh(&parts[0]);
    for f in [9, 27, 44] {
        let c = net.face(f).to_vec();
        net.set_face(f, vec![c[0], c[1], c[2]]);
        // The other half and the quad beside it make a pentagon.
        let beside = net.face_along(c[3], c[2]).expect("inside");
        let mut wide = net.face(beside).to_vec();
        let k = wide.iter().position(|&v| v == c[3]).expect("a corner");
        wide.insert(k + 1, c[0]);
        wide.rotate_left(k);
        net.set_face(beside, wide);
    }
    parts[0] = net.into_mesh().0;
    let input = Input { surface: &mesh, owner: &owner, count: 2 };
    let made = laid(input, &parts).expect("valid parts");
    assert_eq!(check(&made.mesh, TopologyCounts::of(&mesh)), Ok(()));
    assert!(made.report.way <= Way::PartsSubdivided);
}

#[test]
fn a_part_of_another_topology_gives_way_to_a_regular_layout_and_the_others_stay() {
    let mesh = sphere(4);
    let owner = owners(&mesh, |p| u32::from(p.z > 0.0));
    let found = layout::layout(&mesh, &owner, 2);
    let good = disc(&found.curves[0][0], 6, 0.0, &Target::new(&mesh));
    let input = Input { surface: &mesh, owner: &owner, count: 2 };
    let made = laid(input, &[good, ring(8, 2, 0.0, 0.3)]).expect("a valid surface");
    let report = &made.report;
    assert_eq!((report.way, &report.replaced[..], &report.own[..]), (Way::PartsReplaced, &[1][..], &[][..]));
    assert_eq!(check(&made.mesh, TopologyCounts::of(&mesh)), Ok(()));
    // The layout ends in the part's own vertices.
    assert_eq!((report.filled, report.resolved.cuts, report.subdivided[0]), (0, 0, 0));
    assert!(report.extraordinary_after <= report.extraordinary_before + 8, "{report:?}");
}

#[test]
fn nothing_but_regular_layouts_closes_and_follows_the_surface() {
    let mesh = sphere(4);
    let eight = owners(&mesh, |p| u32::from(p.x > 0.0) + 2 * u32::from(p.y > 0.0) + 4 * u32::from(p.z > 0.0));
    let input = Input { surface: &mesh, owner: &eight, count: 8 };
    let options = Options { edge_scale: 4.0, ..Options::default() };
    let made = compose(input, &[Piece::Nothing; 8], options, &|| false).expect("a valid surface");
    assert_eq!(check(&made.mesh, TopologyCounts::of(&mesh)), Ok(()));
    assert_eq!((made.report.way, made.report.filled), (Way::Direct, 0), "{:?}", made.report);
    assert!(made.report.fit.worst() < 0.0025, "{:?}", made.report);
}

#[test]
fn where_all_parts_give_way_the_layout_is_that_of_an_input_for_which_nothing_was_brought() {
    let mesh = sphere(4);
    let owner = owners(&mesh, |p| u32::from(p.z > 0.0));
    let found = layout::layout(&mesh, &owner, 2);
    let far = |s: usize| {
        let mut part = disc(&found.curves[s][0], 6, 0.0, &Target::new(&mesh));
        part.positions.iter_mut().for_each(|p| *p *= 3.0);
        part
    };
    let (low, high) = (far(0), far(1));
    let input = Input { surface: &mesh, owner: &owner, count: 2 };
    let with = |pieces: [Piece<'_>; 2]| compose(input, &pieces, Options::default(), &|| false).expect("valid parts");
    let made = with([Piece::Mapped(&low), Piece::Mapped(&high)]);
    assert_eq!((made.report.way, made.report.missing.len()), (Way::PartsReplaced, 2), "{:?}", made.report);
    assert_eq!(made.mesh, with([Piece::Nothing; 2]).mesh);
}

#[test]
fn what_misses_the_surface_is_made_finer_there_and_the_whole_is_not_subdivided() {
    let mut mesh = grid(80, 80, false, false);
    let wave = |p: &Vec3| if p.x > 0.5 { 0.03 * (60.0 * p.x).sin() * (60.0 * p.y).sin() } else { 0.0 };
    mesh.positions.iter_mut().for_each(|p| p.z = wave(p));
    let owner = owners(&mesh, |p| u32::from(p.x > 0.5));
    let input = Input { surface: &mesh, owner: &owner, count: 2 };
    // Beside an example, a segment without one takes a template; without any, both would be laid out as one.
    let example = disc(&layout::layout(&mesh, &owner, 2).curves[0][0], 8, 0.0, &Target::new(&mesh));
    let quads = |edge_scale: f64, closeness: Closeness| {
        let options = Options { edge_scale, closeness, ..Options::default() };
        let pieces = [Piece::Mapped(&example), Piece::Nothing];
        let made = compose(input, &pieces, options, &|| false).expect("a valid surface");
        let middle = |c: &[u32]| c.iter().map(|&v| made.mesh.positions[v as usize].x).sum::<f64>() / c.len() as f64;
        let rough = made.mesh.faces.iter().filter(|c| middle(c) > 0.5).count();
        ([made.mesh.faces.len() - rough, rough], made.report)
    };
    let ([flat, rough], coarse) = quads(2.0, Closeness::AsBrought);
    assert!(coarse.fit.worst() > 0.0025, "{coarse:?}");
    let ([_, finer], followed) = quads(2.0, Closeness::Followed);
    assert!(followed.fit.worst() < 0.002 && followed.refined == 0, "{followed:?}");
    assert!(2 * finer > 3 * rough && finer < 8 * rough, "{flat}, {rough} to {finer}");
}

#[test]
fn a_coarse_part_is_subdivided_to_follow_the_surface_unless_its_layout_was_chosen() {
    let mesh = sphere(4);
    let owner = owners(&mesh, |p| u32::from(p.z > 0.0));
    let found = layout::layout(&mesh, &owner, 2);
    let target = Target::new(&mesh);
    let [low, high] = [0, 1].map(|s| disc(&found.curves[s][0], 4, 0.0, &target));
    let input = Input { surface: &mesh, owner: &owner, count: 2 };
    let with = |pieces: [Piece<'_>; 2]| compose(input, &pieces, Options::default(), &|| false).expect("valid parts");
    let followed = with([Piece::Mapped(&low), Piece::Mapped(&high)]);
    assert!(followed.report.subdivided.iter().all(|&n| n > 0) && followed.report.fit.worst() < 0.0025);
    let kept = with([Piece::Kept(&low), Piece::Kept(&high)]);
    assert_eq!((kept.mesh.faces.len(), &kept.report.subdivided[..], kept.report.refined), (32, &[0, 0][..], 0));
    assert!(kept.report.fit.worst() > 0.0025, "it says so: {:?}", kept.report.fit);
    let one = with([Piece::Kept(&low), Piece::Mapped(&high)]);
    assert_eq!((one.report.subdivided[0], one.report.refined), (0, 0));
    assert!(one.report.subdivided[1] > 0, "{:?}", one.report);
}

#[test]
fn an_example_of_many_faces_that_is_to_keep_its_density_does_not_become_finer_to_fit_a_scrap() {
    let mesh = sphere(4);
    let input = Input { surface: &mesh, owner: &vec![0; mesh.triangles.len()], count: 1 };
    for (n, is_small) in [(20, true), (60, false)] {
        let sheet = grid(n, n, false, false);
        let faces = sheet.triangles.iter().map(<[u32; 3]>::as_slice).collect();
        let part = PolyMesh { positions: sheet.positions.clone(), faces, ..PolyMesh::default() };
        let site = |piece| site::Site::new(input, 0, piece, Net::from_mesh(&part), 0.1);
        assert_eq!(site(Piece::Kept(&part)).may_be_finer(), is_small);
        assert!(site(Piece::Mapped(&part)).may_be_finer());
    }
}

#[test]
fn a_mesh_of_slivers_has_a_layout_of_as_few_quads_as_it_has_area_for() {
    let mut mesh = grid(101, 101, false, false);
    mesh.positions.iter_mut().for_each(|p| p.y *= 1e-8);
    let input = Input { surface: &mesh, owner: &vec![0; mesh.triangles.len()], count: 1 };
    let made = compose(input, &[Piece::Nothing], Options::default(), &|| false).expect("a mesh");
    assert_eq!((made.report.way, &made.report.own[..]), (Way::Direct, &[][..]));
    assert!(made.mesh.faces.len() < 4 * REGULAR_QUADS as usize, "{}", made.mesh.faces.len());
}

#[test]
fn slivers_of_segments_that_have_no_layout_are_cut_into_quads_as_they_are() {
    let mut mesh = grid(101, 101, false, false);
    mesh.positions.iter_mut().for_each(|p| p.y *= 1e-8);
    let owner: Vec<u32> = (0..mesh.triangles.len() as u32).map(|t| (t / 2 + t / 202) % 2).collect();
    let input = Input { surface: &mesh, owner: &owner, count: 2 };
    let made = compose(input, &[Piece::Nothing; 2], Options::default(), &|| false).expect("a mesh");
    assert_eq!((made.report.way, made.mesh.faces.len()), (Way::InputSubdivided, 3 * mesh.triangles.len()));
    assert_eq!(made.mesh.positions[..mesh.positions.len()], mesh.positions);
}

#[test]
fn holes_smaller_than_a_quad_are_closed_where_no_layout_goes_around_them() {
    let whole = sphere(4);
    let triangles: Vec<[u32; 3]> =
        whole.triangles.iter().enumerate().filter(|(t, _)| t % 512 != 7).map(|(_, t)| *t).collect();
    let holes = whole.triangles.len() - triangles.len();
    let mesh = TriMesh::from_triangles(whole.positions.clone(), triangles).expect("a sphere with holes");
    let input = Input { surface: &mesh, owner: &vec![0; mesh.triangles.len()], count: 1 };
    let laid = |edge_scale| {
        let options = Options { edge_scale, ..Options::default() };
        compose(input, &[Piece::Nothing], options, &|| false).expect("a composition")
    };
    let coarse = laid(4.0);
    assert_eq!((coarse.report.closed, coarse.report.way), (holes, Way::Direct));
    assert_eq!(check::check(&coarse.mesh, check::TopologyCounts::of(&whole)), Ok(()));
    assert!(coarse.mesh.faces.len() < 500, "{}", coarse.mesh.faces.len());
    // What is fine enough goes around them.
    let fine = laid(0.5);
    assert_eq!((fine.report.closed, check::check(&fine.mesh, check::TopologyCounts::of(&mesh))), (0, Ok(())));
}

#[test]
fn what_is_thinner_than_a_quad_has_quads_around_it() {
    let mut mesh = sphere(4);
    mesh.positions.iter_mut().for_each(|p| (p.y, p.z) = (0.01 * p.y, 0.01 * p.z));
    let round = sphere(3);
    let thin = mesh.triangles.len();
    let first = mesh.positions.len() as u32;
    let positions = mesh.positions.iter().copied().chain(round.positions.iter().map(|p| p.add_scalar(3.0))).collect();
    let triangles =
        mesh.triangles.iter().copied().chain(round.triangles.iter().map(|t| t.map(|v| v + first))).collect();
    let both = TriMesh::from_triangles(positions, triangles).expect("a needle beside a ball");
    let owner: Vec<u32> = (0..both.triangles.len()).map(|t| u32::from(t >= thin)).collect();
    let input = Input { surface: &both, owner: &owner, count: 2 };
    let options = Options { edge_scale: 2.0, ..Options::default() };
    let made = compose(input, &[Piece::Nothing; 2], options, &|| false).expect("a composition");
    assert_eq!((made.report.way, &made.report.own[..]), (Way::Direct, &[][..]));
    assert!(made.mesh.faces.len() < thin, "{}", made.mesh.faces.len());
}

#[test]
fn a_tube_that_is_thinner_than_a_quad_is_not_laid_flat() {
    let (rows, girth) = (400u32, 4u32);
    let at = |row: u32, k: u32| girth * row + k % girth;
    let angle = |k: u32| std::f64::consts::TAU * f64::from(k) / f64::from(girth);
    let corners = (0..=rows).flat_map(|row| (0..girth).map(move |k| (row, k)));
    let positions = corners.map(|(row, k)| Vec3::new(angle(k).cos(), angle(k).sin(), f64::from(row))).collect();
    let cells = (0..rows).flat_map(|row| (0..girth).map(move |k| (row, k)));
    let halves = |(i, k)| [[at(i, k), at(i, k + 1), at(i + 1, k + 1)], [at(i, k), at(i + 1, k + 1), at(i + 1, k)]];
    let tube = TriMesh::from_triangles(positions, cells.flat_map(halves).collect()).expect("a tube");
    let input = Input { surface: &tube, owner: &vec![0; tube.triangles.len()], count: 1 };
    let options = Options { edge_scale: 3.0, ..Options::default() };
    let made = compose(input, &[Piece::Nothing], options, &|| false).expect("a composition");
    assert_eq!(check(&made.mesh, TopologyCounts::of(&tube)), Ok(()));
    let area: f64 = made
        .mesh
        .faces
        .iter()
        .map(|c| check::quad_area([0, 1, 2, 3].map(|k| made.mesh.positions[c[k] as usize])))
        .sum();
    assert!(area > 0.8 * tube.total_area(), "{area} of {}", tube.total_area());
    assert!(made.mesh.faces.len() < 2 * tube.triangles.len(), "{}", made.mesh.faces.len());
}

#[test]
fn components_are_in_two_groups_of_about_as_many_triangles() {
    let mesh = sphere(2);
    let pieces = |counts: &[usize]| {
        let of = |&count: &usize| apart::Component {
            surface: TriMesh { triangles: vec![[0; 3]; count], ..mesh.clone() },
            owner: vec![0; count],
            segments: vec![0],
        };
        counts.iter().map(of).collect::<Vec<_>>()
    };
    assert_eq!(apart::in_two_groups(&pieces(&[5, 40, 20, 30])), [vec![1, 0], vec![3, 2]]);
    assert_eq!(apart::in_two_groups(&pieces(&[7])), [vec![0], Vec::new()]);
}

#[test]
fn labels_and_parts_are_counted() {
    let mesh = sphere(1);
    let input = Input { surface: &mesh, owner: &[0; 3], count: 1 };
    assert!(matches!(laid(input, &[]), Err(ComposeError::Parts { expected: 1, found: 0 })));
    assert!(matches!(laid(input, &[PolyMesh::default()]), Err(ComposeError::Owners { .. })));
}

#[test]
fn a_caller_that_asks_to_stop_gets_no_mesh() {
    let mesh = sphere(2);
    let halves = owners(&mesh, |p| u32::from(p.x > 0.0));
    let input = Input { surface: &mesh, owner: &halves, count: 2 };
    let stopped = compose(input, &[Piece::Nothing; 2], Options::default(), &|| true);
    assert!(matches!(stopped, Err(ComposeError::Stopped)));
}

#[test]
fn a_lone_triangle_is_cut_into_quads_that_lie_flat_on_it() {
    let positions = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0)).into();
    let surface = TriMesh::from_triangles(positions, vec![[0, 1, 2]]).expect("a triangle");
    let made =
        compose(Input { surface: &surface, owner: &[0], count: 1 }, &[Piece::Nothing], Options::default(), &|| false);
    let made = made.expect("a composition");
    assert_eq!((made.mesh.faces.len(), made.report.own), (48, vec![0]));
    let area = |corners: &[u32]| {
        let corner = |k: usize| made.mesh.positions[corners[k % 4] as usize];
        (0..4).map(|k| corner(k).x * corner(k + 1).y - corner(k + 1).x * corner(k).y).sum::<f64>() / 2.0
    };
    let areas: Vec<f64> = made.mesh.faces.iter().map(area).collect();
    assert!(areas.iter().all(|&area| area > 0.0) && (areas.iter().sum::<f64>() - 0.5).abs() < 1e-12);
}
