//! Views of a range scanner that were never joined: sheets that lie over each other are fused into one surface.
//!
//! Signed distances to the views, the nearer the heavier, are sampled on a grid as fine as the scan, where there is a view near
//! by; the surface where their mean is 0 is drawn by surface nets, and its vertices go to the mean of what the views say.
//! *Source:* Curless and Levoy 1996 (the volume of distances), Gibson 1998 (surface nets). *Ours, not the paper's:* when it is
//! done at all.

use crate::mesh::bvh::Bvh;
use crate::mesh::disjoint::Sets;
use crate::mesh::tri::NONE;
use crate::mesh::{PolyMesh, Prepared, Repair, RepairKind, TriMesh, Vec3, bounding_box, prepare};
use crate::numerics::stop;
use crate::topology::{pieces, submesh};
use std::collections::HashMap;
use std::sync::Arc;

/// A sheet with less of the area is no view.
const VIEW_SHARE: f64 = 0.05;
/// Of the rim of each of two views so much lies on the other: hair ends on a head, and a horn on a skull, but the head does not end on
/// the hair.
const OVERLAP: f64 = 0.25;
/// A point lies on a sheet when it is so near, in edges of the scan.
const ON: f64 = 2.0;
/// Distances are sampled so far from the views, in cells: a vertex that is drawn has views within a cell of all corners about it.
const REACH: f64 = 2.0;
/// A point is not over a view when it lies farther beside its rim than this, in cells.
const BESIDE: f64 = 0.7;
/// Views whose normals differ by more than this cosine see two sides of something thin; the nearer counts.
const ALIKE: f64 = 0.5;
/// Of the views' area so much at most is not in the surface drawn of them: where more is lost they see two sides of something thin.
/// Two views of a face lose .002, a boot and its lining .16 (tests/records/outside-2026-11-29.md).
const LOST_MAX: f64 = 0.01;
/// A triangle of a view is lost when its middle lies farther from the surface drawn than this, in cells, or behind it.
const LOST_FROM: f64 = 1.5;
/// Samples for each triangle of the views, at most: more are needed only where some triangles are far larger than others, and
/// then this is no range scan.
const SAMPLES_PER_TRIANGLE: usize = 2000;

/// The scan with its views fused; `None` where no two sheets are views of one thing.
pub fn fused(scan: &Prepared) -> Option<Prepared> {
    let mesh = &scan.mesh;
    let (sets, views): (Vec<Vec<u32>>, Vec<ScanView>) = views(mesh)?.into_iter().unzip();
    let of_scan: Vec<u32> = sets.iter().flatten().copied().collect();
    let cell = usual_edge(mesh);
    let drawn = DistanceGrid::new(&views, cell)?.drawn(&views);
    let fused = prepare(&drawn).ok()?.mesh;
    if lost_share(&views, &fused, cell) > LOST_MAX {
        return None;
    }
    // What belongs to no view stays as it is.
    let mut is_fused = vec![false; mesh.triangles.len()];
    of_scan.iter().for_each(|&t| is_fused[t as usize] = true);
    let rest: Vec<u32> = (0..mesh.triangles.len() as u32).filter(|&t| !is_fused[t as usize]).collect();
    let tree = Bvh::new(mesh);
    let mesh_of_all = Arc::new(beside(with_polygons(Arc::unwrap_or_clone(fused), mesh, &tree), mesh, &rest));
    let vertex_of = carried(scan, &mesh_of_all);
    let first = of_scan.iter().map(|&t| mesh.polygon_of[t as usize]).min().unwrap_or(0);
    let mut repairs = scan.repairs.clone();
    repairs.push(Repair { kind: RepairKind::FusedViews, count: sets.len() as u64, first });
    Some(Prepared { mesh: mesh_of_all, vertex_of, reversed: scan.reversed.clone(), repairs })
}

/// The sheets that are views of one thing, each with its triangles, the largest sheet among them; `None` where that one stands alone.
fn views(mesh: &TriMesh) -> Option<Vec<(Vec<u32>, ScanView)>> {
    let area = |set: &[u32]| set.iter().map(|&t| mesh.area(t as usize)).sum::<f64>();
    let all = mesh.total_area();
    let is_open = |set: &[u32]| set.iter().any(|t| (0..3).any(|side| mesh.twin(3 * t + side) == NONE));
    let mut sheets: Vec<Vec<u32>> =
        pieces(mesh).into_iter().filter(|set| area(set) >= VIEW_SHARE * all && is_open(set)).collect();
    if sheets.len() < 2 {
        return None;
    }
    sheets.sort_by(|a, b| area(b).total_cmp(&area(a)).then(a.cmp(b)));
    let near = ON * usual_edge(mesh);
    let views: Vec<ScanView> = sheets.iter().map(|set| ScanView::new(submesh(mesh, set).0)).collect();
    let mut together = Sets::new(sheets.len());
    for k in 0..views.len() {
        for other in k + 1..views.len() {
            let ends_on = |a: usize, b: usize| views[a].share_of_rim_on(&views[b], near) >= OVERLAP;
            if ends_on(k, other) && ends_on(other, k) {
                together.join(k as u32, other as u32);
            }
        }
    }
    let first = together.root(0);
    let mut with_first = Vec::new();
    for (k, sheet) in (0u32..).zip(sheets.into_iter().zip(views)) {
        if together.root(k) == first {
            with_first.push(sheet);
        }
    }
    (with_first.len() > 1).then_some(with_first)
}

/// The share of the views' area that the surface drawn of them does not come near, facing as they do.
fn lost_share(views: &[ScanView], drawn: &TriMesh, cell: f64) -> f64 {
    let drawn = ScanView::new(drawn.clone());
    let (mut all, mut lost) = (0.0, 0.0);
    for view in views {
        for (t, corners) in view.mesh.triangles.iter().enumerate() {
            stop::poll();
            let middle = corners.iter().map(|&v| view.mesh.positions[v as usize]).sum::<Vec3>() / 3.0;
            let across = view.mesh.area_vector(t);
            all += across.norm();
            let is_near =
                |seen: &ViewSample| (middle - seen.at).norm() <= LOST_FROM * cell && across.dot(&seen.normal) > 0.0;
            if !drawn.seen_from(middle).is_some_and(|seen| is_near(&seen)) {
                lost += across.norm();
            }
        }
    }
    lost / all
}

/// The median length of edges.
fn usual_edge(mesh: &TriMesh) -> f64 {
    mesh.median_length(0..mesh.twins.len() as u32)
}

/// A view of a scanner: one sheet of the scan.
struct ScanView {
    mesh: TriMesh,
    tree: Bvh,
    /// Of its vertices, by the areas about them.
    normals: Vec<Vec3>,
}

/// The point of a view that is nearest to a point, and how far that is.
struct ViewSample {
    /// The point of the view that is nearest, and the normal there.
    at: Vec3,
    normal: Vec3,
    /// Signed along the normal.
    distance: f64,
    /// Across it: 0 but for points beyond the rim.
    beside: f64,
}

impl ScanView {
    fn new(mesh: TriMesh) -> Self {
        Self { tree: Bvh::new(&mesh), normals: mesh.vertex_area_vectors(), mesh }
    }

    fn seen_from(&self, x: Vec3) -> Option<ViewSample> {
        let near = self.tree.closest(x);
        let corners = self.mesh.triangles.get(near.triangle as usize)?;
        let normal: Vec3 = (0..3).map(|k| self.normals[corners[k] as usize] * near.barycentric[k]).sum();
        let normal = normal.try_normalize(0.0)?;
        let way = x - near.point;
        let distance = way.dot(&normal);
        Some(ViewSample { at: near.point, normal, distance, beside: (way - normal * distance).norm() })
    }

    /// The share of its rim's vertices that lie on another view.
    fn share_of_rim_on(&self, other: &Self, near: f64) -> f64 {
        let rim = self.mesh.boundary_vertices();
        let (mut count, mut met) = (0usize, 0usize);
        for v in (0..rim.len()).filter(|v| rim[*v]) {
            stop::poll();
            count += 1;
            let Some(seen) = other.seen_from(self.mesh.positions[v]) else { continue };
            let faces = self.normals[v].try_normalize(0.0).is_some_and(|n| n.dot(&seen.normal) > ALIKE);
            met += usize::from(faces && seen.distance.abs() <= near && seen.beside <= BESIDE * near / ON);
        }
        met as f64 / count.max(1) as f64
    }
}

/// Averages what the views say of a point: its signed distance, and the place on them.
fn mean(views: &[ScanView], x: Vec3, reach: f64, cell: f64) -> Option<(f64, Vec3)> {
    stop::poll();
    let is_over = |seen: &ViewSample| seen.distance.abs() <= reach && seen.beside <= BESIDE * cell;
    let seen: Vec<ViewSample> = views.iter().filter_map(|view| view.seen_from(x)).filter(is_over).collect();
    let nearest = seen.iter().min_by(|a, b| a.distance.abs().total_cmp(&b.distance.abs()))?;
    let (mut weight, mut distance, mut at) = (0.0, 0.0, Vec3::zeros());
    for one in seen.iter().filter(|one| one.normal.dot(&nearest.normal) >= ALIKE) {
        // Never 0, also at the reach's end.
        let near = (1.01 - one.distance.abs() / reach).powi(2);
        weight += near;
        distance += near * one.distance;
        at += near * one.at;
    }
    Some((distance / weight, at / weight))
}

/// A place of the grid.
type Cell = [i32; 3];

/// A grid of signed distances.
struct DistanceGrid {
    low: Vec3,
    cell: f64,
    /// By place, only where views are near.
    distances: HashMap<Cell, f64>,
    /// The places in order.
    places: Vec<Cell>,
}

const CORNERS: [Cell; 8] = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]];
/// The edges of a cell, as corners.
const EDGES: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

fn moved(at: Cell, by: Cell) -> Cell {
    [at[0] + by[0], at[1] + by[1], at[2] + by[2]]
}

impl DistanceGrid {
    /// Samples the distances; `None` where that takes far more than it does for a range scan.
    fn new(views: &[ScanView], cell: f64) -> Option<Self> {
        let [low, _] = bounding_box(views.iter().flat_map(|view| &view.mesh.positions))?;
        let low = low.add_scalar(-2.0 * REACH * cell);
        let triangles: usize = views.iter().map(|view| view.mesh.triangles.len()).sum();
        let most = SAMPLES_PER_TRIANGLE.saturating_mul(triangles);
        let mut places: Vec<Cell> = Vec::new();
        let mut samples = 0.0;
        for view in views {
            for corners in &view.mesh.triangles {
                let corners = corners.map(|v| (view.mesh.positions[v as usize] - low) / cell);
                let [from, to] = bounding_box(corners)?;
                let (from, to) = (from.add_scalar(-REACH), to.add_scalar(REACH));
                samples += (to - from).iter().map(|x| x + 1.0).product::<f64>();
                if samples.is_nan() || samples > most as f64 {
                    return None;
                }
                let range = |axis: usize| from[axis].ceil() as i32..=to[axis].floor() as i32;
                stop::pass(64);
                for x in range(0) {
                    for y in range(1) {
                        places.extend(range(2).map(|z| [x, y, z]));
                    }
                }
            }
            places.sort_unstable();
            places.dedup();
        }
        let point = |at: &Cell| low + Vec3::from(at.map(f64::from)) * cell;
        let known = places.iter().filter_map(|at| Some((*at, mean(views, point(at), REACH * cell, cell)?.0)));
        let distances: HashMap<Cell, f64> = known.collect();
        places.retain(|at| distances.contains_key(at));
        Some(Self { low, cell, distances, places })
    }

    /// The surface where the distance is 0.
    fn drawn(&self, views: &[ScanView]) -> PolyMesh {
        let mut positions = Vec::new();
        let mut vertex_of: HashMap<Cell, u32> = HashMap::new();
        for at in &self.places {
            if let Some(x) = self.crossed(*at) {
                let seen = mean(views, x, REACH * self.cell, self.cell);
                vertex_of.insert(*at, positions.len() as u32);
                positions.push(seen.map(|seen| seen.1).filter(|y| (y - x).norm() <= self.cell).unwrap_or(x));
            }
        }
        let mut faces: Vec<[u32; 4]> = Vec::new();
        for at in &self.places {
            let from = self.distances[at];
            for axis in 0..3 {
                let mut step = [0; 3];
                step[axis] = 1;
                let Some(to) = self.distances.get(&moved(*at, step)) else { continue };
                if (from < 0.0) == (*to < 0.0) {
                    continue;
                }
                // The four cells about the edge, counter-clockwise seen from its head.
                let mut one = [0; 3];
                let mut two = [0; 3];
                one[(axis + 1) % 3] = -1;
                two[(axis + 2) % 3] = -1;
                let about = [moved(*at, moved(one, two)), moved(*at, two), *at, moved(*at, one)];
                let Some(corners) = vertices(&vertex_of, about) else { continue };
                let [a, b, c, d] = corners;
                faces.push(if from < 0.0 { corners } else { [a, d, c, b] });
            }
        }
        PolyMesh { positions, faces: faces.iter().map(<[u32; 4]>::as_slice).collect(), ..PolyMesh::default() }
    }

    /// The mean of where the surface crosses a cell's edges; `None` where it does not, or where not all of the cell is known.
    fn crossed(&self, at: Cell) -> Option<Vec3> {
        let mut known = [0.0; 8];
        for (known, corner) in known.iter_mut().zip(CORNERS) {
            *known = *self.distances.get(&moved(at, corner))?;
        }
        let point = |corner: usize| Vec3::from(moved(at, CORNERS[corner]).map(f64::from));
        let (mut count, mut sum) = (0.0, Vec3::zeros());
        for [a, b] in EDGES {
            if (known[a] < 0.0) != (known[b] < 0.0) {
                sum += point(a) + (point(b) - point(a)) * (known[a] / (known[a] - known[b]));
                count += 1.0;
            }
        }
        (count > 0.0).then(|| self.low + sum / count * self.cell)
    }
}

fn vertices(of: &HashMap<Cell, u32>, cells: [Cell; 4]) -> Option<[u32; 4]> {
    let mut found = [0; 4];
    for (found, cell) in found.iter_mut().zip(cells) {
        *found = *of.get(&cell)?;
    }
    Some(found)
}

/// The mesh whose triangles name the polygons of a scan that they lie on.
fn with_polygons(mut mesh: TriMesh, scan: &TriMesh, tree: &Bvh) -> TriMesh {
    let centre = |t: &[u32; 3]| t.iter().map(|&v| mesh.positions[v as usize]).sum::<Vec3>() / 3.0;
    let of = |t: &[u32; 3]| {
        stop::poll();
        scan.polygon_of.get(tree.closest(centre(t)).triangle as usize).copied().unwrap_or(0)
    };
    mesh.polygon_of = mesh.triangles.iter().map(of).collect();
    mesh.phantom = vec![false; 3 * mesh.triangles.len()];
    mesh
}

/// Puts some triangles of a scan beside a mesh.
fn beside(mut mesh: TriMesh, scan: &TriMesh, some: &[u32]) -> TriMesh {
    let (own, _) = submesh(scan, some);
    let (vertices, halfedges) = (mesh.positions.len() as u32, mesh.twins.len() as u32);
    mesh.positions.extend(&own.positions);
    mesh.triangles.extend(own.triangles.iter().map(|t| t.map(|v| v + vertices)));
    mesh.twins.extend(own.twins.iter().map(|&h| if h == NONE { NONE } else { h + halfedges }));
    mesh.phantom.extend(&own.phantom);
    mesh.polygon_of.extend(&own.polygon_of);
    mesh
}

/// The vertex of a mesh that is nearest to each vertex of the upload.
fn carried(scan: &Prepared, mesh: &TriMesh) -> Vec<u32> {
    let tree = Bvh::new(mesh);
    let nearest = |v: u32| {
        stop::poll();
        tree.closest(scan.mesh.positions[v as usize]).vertex(mesh).unwrap_or(NONE)
    };
    let of_vertex: Vec<u32> = (0..scan.mesh.positions.len() as u32).map(nearest).collect();
    scan.vertex_of.iter().map(|&v| if v == NONE { NONE } else { of_vertex[v as usize] }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::{components, invariants};

    /// A bumpy dome seen in a window of longitudes, its vertices moved along the normal by `noise`.
    fn view(window: [f64; 2], noise: f64, away: Vec3) -> PolyMesh {
        const ROWS: usize = 60;
        const COLUMNS: usize = 90;
        let point = |(i, j): (usize, usize)| {
            let height = 0.1 + 1.3 * i as f64 / ROWS as f64;
            let angle = window[0] + (window[1] - window[0]) * j as f64 / COLUMNS as f64;
            let radius =
                1.0 + 0.1 * (3.0 * angle).sin() * height.sin() + noise * f64::from((i * 7 + j * 13) as u32 % 5);
            Vec3::new(angle.cos() * height.sin(), angle.sin() * height.sin(), height.cos()) * radius + away
        };
        let positions = (0..=ROWS).flat_map(|i| (0..=COLUMNS).map(move |j| (i, j))).map(point).collect();
        let number = |i: usize, j: usize| (i * (COLUMNS + 1) + j) as u32;
        let quad = |(i, j)| [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
        let faces: Vec<[u32; 4]> = (0..ROWS).flat_map(|i| (0..COLUMNS).map(move |j| (i, j))).map(quad).collect();
        PolyMesh { positions, faces: faces.iter().map(<[u32; 4]>::as_slice).collect(), ..PolyMesh::default() }
    }

    fn both(one: PolyMesh, two: &PolyMesh) -> Prepared {
        let first = one.positions.len() as u32;
        let faces: Vec<Vec<u32>> = one
            .faces
            .iter()
            .map(<[u32]>::to_vec)
            .chain(two.faces.iter().map(|face| face.iter().map(|v| v + first).collect()))
            .collect();
        let positions = one.positions.iter().chain(&two.positions).copied().collect();
        prepare(&PolyMesh { positions, faces: faces.iter().map(Vec::as_slice).collect(), ..PolyMesh::default() })
            .expect("two sheets")
    }

    #[test]
    fn two_views_of_a_dome_become_one_sheet_that_lies_on_both() {
        let scan = both(view([0.0, 2.4], 0.0, Vec3::zeros()), &view([1.8, 4.2], 1e-3, Vec3::zeros()));
        assert_eq!(components(&scan.mesh).1, 2);
        let one = fused(&scan).expect("views");
        let found = invariants(&one.mesh);
        assert_eq!((components(&one.mesh).1, found.genus, found.boundary_loops), (1, 0, 1), "{found:?}");
        assert_eq!(crate::mesh::validate(&one.mesh), Ok(()));
        let tree = Bvh::new(&scan.mesh);
        let away = |x: &Vec3| tree.closest(*x).distance;
        assert!(one.mesh.positions.iter().map(away).fold(0.0, f64::max) < 0.01);
        // It looks where the views look, and takes the area that they show.
        let outward = (0..one.mesh.triangles.len())
            .filter(|&t| one.mesh.area_vector(t).dot(&one.mesh.positions[one.mesh.triangles[t][0] as usize]) > 0.0);
        assert_eq!(outward.count(), one.mesh.triangles.len());
        let whole = prepare(&view([0.0, 4.2], 0.0, Vec3::zeros())).expect("a sheet").mesh.total_area();
        assert!((one.mesh.total_area() / whole - 1.0).abs() < 0.06, "{}", one.mesh.total_area() / whole);
        assert!(one.repairs.last().expect("a repair").to_string().starts_with("2 views"));
        assert!(one.vertex_of.iter().all(|v| (*v as usize) < one.mesh.positions.len()));
        assert!(fused(&scan) == Some(one));
    }

    #[test]
    fn what_lies_on_a_thing_is_no_view_of_it() {
        // A cap whose rim lies on the dome, which ends elsewhere.
        let dome = view([0.0, 4.2], 0.0, Vec3::zeros());
        let cap = view([1.0, 3.0], 1e-3, Vec3::zeros());
        let high = |face: &&[u32]| face.iter().all(|&v| cap.positions[v as usize].z > 0.5);
        let faces = cap.faces.iter().filter(high).collect();
        assert!(fused(&both(dome, &PolyMesh { faces, ..cap.clone() })).is_none());
    }

    #[test]
    fn what_a_surface_leaves_out_or_shows_from_behind_is_lost() {
        let mesh = |window| prepare(&view(window, 0.0, Vec3::zeros())).expect("a sheet").mesh;
        let whole = mesh([0.0, 2.4]);
        let cell = usual_edge(&whole);
        let lost = |drawn: &TriMesh| lost_share(&[ScanView::new(TriMesh::clone(&whole))], drawn, cell);
        assert!(lost(&whole) < 1e-9);
        assert!((lost(&mesh([0.0, 1.2])) - 0.5).abs() < 0.1, "{}", lost(&mesh([0.0, 1.2])));
        let mut behind = view([0.0, 2.4], 0.0, Vec3::zeros());
        let turned: Vec<Vec<u32>> = behind.faces.iter().map(|face| face.iter().rev().copied().collect()).collect();
        behind.faces = turned.iter().map(Vec::as_slice).collect();
        assert!(lost(&prepare(&behind).expect("a sheet").mesh) > 0.99);
    }

    #[test]
    fn things_side_by_side_are_not_views_of_one() {
        let one = view([0.0, 2.4], 0.0, Vec3::zeros());
        for away in [Vec3::new(3.0, 0.0, 0.0), Vec3::new(0.0, 0.0, 1.5)] {
            assert!(fused(&both(one.clone(), &view([0.0, 2.4], 0.0, away))).is_none());
        }
        assert!(fused(&prepare(&one).expect("a sheet")).is_none());
    }
}
