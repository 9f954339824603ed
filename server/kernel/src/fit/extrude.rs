//! Protrusions of an input that a laid example lacks: its faces at the foot of a horn or a tail are extruded along it.
//!
//! The faces move to the tip, and rows of quads follow their rim from the foot up. So the example keeps all its faces and
//! vertices in their order; only at the corners of the foot and of the tip are there new extraordinary vertices, as where an artist
//! extrudes faces. *Ours, not the paper's.*

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};
use std::sync::Arc;

use super::beyond::{GrownMesh, Rows, RowsEnd, UnfoldedRest, from_polar, only_rim};
use crate::encode::index::PlanarIndex;
use crate::mesh::bvh::{Bvh, Closest};
use crate::mesh::tri::{NONE, TriMesh, nearest_share};
use crate::mesh::{PolyMesh, Polygons, Vec3, diagonal};
use crate::numerics::stop;
use crate::segment::segment_above;
use crate::topology::{Components, Topology, primitive};
use crate::unfold::{UnfoldOptions, unfold};

/// A vertex of the input is missed that is farther from the laid mesh than this share of the diagonal, and than so many of the mesh's
/// edges near by are long. *Untuned.*
const MISSED: f64 = 0.01;
const MISSED_EDGES: f64 = 2.0;
/// A protrusion begins so many edges, along the surface, from the vertex of the mesh that is nearest along it: the middle of a square is
/// .7 edges from its corners. *Untuned.*
const FOOT_EDGES: f64 = 1.0;
/// From its foot on it rises from the mesh by this share of what is missed. *Untuned.*
const FOOT: f64 = 0.125;
/// At the foot of a protrusion are the faces of whose corners such a share is nearest to it: all, three of four, or any.
const CORNERS: [f64; 3] = [1.0, 0.75, 0.0];
/// Protrusions at most, the largest first. *Untuned.*
const PROTRUSIONS_MAX: usize = 12;
/// A foot of more faces than these may not be so wide that the surface within its rim is larger than the protrusion by more than a
/// factor. *Untuned.*
const FEW_FACES: usize = 4;
const WIDE_MAX: f64 = 2.0;
/// The rim of a foot lies at the boundary of what it surrounds, on average within this share of its edges. *Untuned.*
const AWAY_MAX: f64 = 0.5;
/// New quads may be so many times as small as the mesh's on average. *Untuned.*
const FINE_MAX: f64 = 32.0;
/// Share of the area of what is extruded that may look into the surface. *Untuned.*
const INWARD_MAX: f64 = 0.15;
/// Steps in which faces move to a tip evenly.
const STEPS: usize = 200;

/// Tells what became of the protrusions of a surface that a laid mesh misses.
#[derive(Clone, Debug, Default)]
pub struct Extrusion {
    /// The mesh with faces extruded along them, and how many they are; `None` where no faces were. Vertices and faces keep their numbers;
    /// new ones follow.
    pub mesh: Option<(PolyMesh, usize)>,
    /// The share of the surface's area that is still missed, 0–1.
    pub missed: f64,
}

/// Extrudes the faces of a mesh that lies on `surface` along the protrusions of the surface that it misses.
pub fn extruded(mesh: &PolyMesh, surface: &TriMesh) -> Extrusion {
    let Some(laid) = LaidMesh::new(mesh, surface) else { return Extrusion::default() };
    let mut grown: Option<(PolyMesh, usize)> = None;
    let (mut taken, mut missed) = (BTreeSet::new(), 0.0);
    for protrusion in laid.protrusions() {
        let (before, count) = grown.as_ref().map_or((mesh, 0), |(grown, count)| (grown, *count));
        // All at the foot, or else the largest piece of that.
        let ways = [false, true].iter().flat_map(|piece| CORNERS.map(|share| (share, *piece)));
        let mut feet = ways.filter_map(|(share, piece)| laid.foot(&protrusion, share, piece));
        let made = feet.find_map(|foot| {
            let is_free = foot.faces.is_disjoint(&taken);
            is_free.then(|| Some((laid.extrude(before, &protrusion, &foot)?, foot.faces))).flatten()
        });
        match made {
            Some((made, faces)) => {
                grown = Some((made, count + 1));
                taken.extend(faces);
            }
            None => missed += protrusion.missed,
        }
    }
    Extrusion { mesh: grown, missed: missed / surface.total_area() }
}

/// The share of a surface's area, 0–1, that the protrusions have which a laid mesh misses.
pub fn missed(mesh: &PolyMesh, surface: &TriMesh) -> f64 {
    let Some(laid) = LaidMesh::new(mesh, surface) else { return 0.0 };
    laid.protrusions().iter().map(|one| one.missed).sum::<f64>() / surface.total_area()
}

/// A protrusion of the surface that the mesh misses.
struct Protrusion {
    vertices: BTreeSet<u32>,
    area: f64,
    /// The area of the part of it that rises from the mesh.
    missed: f64,
}

/// The faces at the foot of a protrusion, and the vertices around them, in the order in which their edges run on the faces beside.
struct Foot {
    faces: BTreeSet<u32>,
    rim: Vec<u32>,
}

/// A laid mesh beside the surface that it lies on.
struct LaidMesh<'a> {
    mesh: &'a PolyMesh,
    surface: &'a TriMesh,
    /// The face of each triangle of the laid mesh.
    face_of: Vec<u32>,
    /// Of each vertex of the surface the nearest place on the laid mesh.
    near: Vec<Closest>,
    /// How far it is from that, in units of what is missed.
    height: Vec<f64>,
    /// Of each vertex of the surface those beside it.
    beside: Vec<Vec<u32>>,
    /// The vertex of the laid mesh that is nearest to each vertex of the surface along that, and whether it is far for its edges.
    from: Vec<(u32, bool)>,
    /// Faces about each vertex of the laid mesh.
    about: Vec<Vec<u32>>,
    /// The vertices of its rims.
    on_rim: BTreeSet<u32>,
}

impl<'a> LaidMesh<'a> {
    fn new(mesh: &'a PolyMesh, surface: &'a TriMesh) -> Option<Self> {
        let (mut triangles, mut face_of) = (Vec::new(), Vec::new());
        let mut about = vec![Vec::new(); mesh.positions.len()];
        for (face, f) in mesh.faces.iter().zip(0u32..) {
            for k in 1..face.len().saturating_sub(1) {
                triangles.push([face[0], face[k], face[k + 1]]);
                face_of.push(f);
            }
            face.iter().for_each(|&v| about[v as usize].push(f));
        }
        if triangles.is_empty() || surface.triangles.is_empty() {
            return None;
        }
        let fan = TriMesh::from_triangles(mesh.positions.clone(), triangles).ok()?;
        let on_rim = (0u32..).zip(fan.boundary_vertices()).filter(|(_, is_on)| *is_on).map(|(v, _)| v).collect();
        let near = Bvh::new(&fan).closest_to_all(&surface.positions);
        let usual = mean_edges(mesh);
        let least = MISSED * diagonal(surface.positions.iter());
        let height = |at: &Closest| match face_of.get(at.triangle as usize) {
            Some(&f) => {
                let edge = mesh.faces.face(f as usize).iter().map(|&v| usual[v as usize]).fold(0.0, f64::max);
                at.distance / f64::max(least, MISSED_EDGES * edge).max(f64::MIN_POSITIVE)
            }
            None => 0.0,
        };
        let height: Vec<f64> = near.iter().map(height).collect();
        if height.iter().all(|height| *height <= 1.0) {
            return None;
        }
        let beside = surface.neighbours();
        let of = |(distance, v): (f64, u32)| match usual.get(v as usize) {
            Some(edge) => (v, distance > FOOT_EDGES * edge),
            None => (NONE, false),
        };
        let from = nearest_along(&mesh.positions, surface, &beside).into_iter().map(of).collect();
        Some(Self { mesh, surface, face_of, near, height, beside, from, about, on_rim })
    }

    fn nearest_face(&self, v: u32) -> Option<u32> {
        self.face_of.get(self.near[v as usize].triangle as usize).copied()
    }

    /// The vertices that are reached from `first` over those that are `one`.
    fn reached(&self, first: impl IntoIterator<Item = u32>, one: impl Fn(u32) -> bool) -> BTreeSet<u32> {
        let mut found: BTreeSet<u32> = first.into_iter().collect();
        let mut open: Vec<u32> = found.iter().copied().collect();
        while let Some(v) = open.pop() {
            stop::pass(1);
            for &w in &self.beside[v as usize] {
                if one(w) && found.insert(w) {
                    open.push(w);
                }
            }
        }
        found
    }

    /// The protrusions that are missed, the largest first.
    fn protrusions(&self) -> Vec<Protrusion> {
        let is_missed = |v: u32| self.height[v as usize] > 1.0 && self.from[v as usize].1;
        // What lies beyond the mesh's rim is left bare, and no protrusion of what the mesh covers.
        let is_beyond = |v: &&u32| self.on_rim.contains(&self.from[**v as usize].0);
        let mut is_seen = vec![false; self.height.len()];
        let mut number = vec![NONE; self.height.len()];
        let mut found: Vec<BTreeSet<u32>> = Vec::new();
        for v in (0..self.height.len() as u32).filter(|&v| is_missed(v)) {
            if !is_seen[v as usize] {
                let one = self.reached([v], |w| self.from[w as usize].1);
                one.iter().for_each(|&w| is_seen[w as usize] = true);
                if 2 * one.iter().filter(is_beyond).count() <= one.len() {
                    one.iter().for_each(|&w| number[w as usize] = found.len() as u32);
                    found.push(one);
                }
            }
        }
        let middles: Vec<Vec3> = found.iter().map(|one| self.middle_of_rim(one)).collect();
        // A protrusion's volume over the middle of its rim is positive, that of a hollow is not.
        let mut sizes = vec![(0.0, 0.0, 0.0); found.len()];
        for (t, corners) in self.surface.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(|v| number[v as usize]);
            if a != NONE && a == b && b == c {
                let across = self.surface.area_vector(t);
                let (volume, area, missed) = &mut sizes[a as usize];
                *volume += across.dot(&(self.surface.positions[corners[0] as usize] - middles[a as usize]));
                *area += across.norm();
                if corners.iter().all(|v| self.height[*v as usize] > FOOT) {
                    *missed += across.norm();
                }
            }
        }
        let mut found: Vec<(f64, Protrusion)> = found
            .into_iter()
            .zip(sizes)
            .filter(|(_, (volume, ..))| *volume > 0.0)
            .map(|(vertices, (volume, area, missed))| (volume, Protrusion { vertices, area, missed }))
            .collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.vertices.cmp(&b.1.vertices)));
        found.truncate(PROTRUSIONS_MAX);
        found.into_iter().map(|(_, one)| one).collect()
    }

    /// The middle of those of some vertices that are beside others.
    fn middle_of_rim(&self, vertices: &BTreeSet<u32>) -> Vec3 {
        let is_inside = |v: &&u32| self.beside[**v as usize].iter().all(|w| vertices.contains(w));
        let rim: Vec<Vec3> =
            vertices.iter().filter(|v| !is_inside(v)).map(|&v| self.surface.positions[v as usize]).collect();
        rim.iter().sum::<Vec3>() / rim.len().max(1) as f64
    }

    /// The faces of whose corners a `share` is nearest to a protrusion, or the largest piece of them; `None` where these are no disc inside
    /// of the mesh.
    fn foot(&self, protrusion: &Protrusion, share: f64, is_piece: bool) -> Option<Foot> {
        let rises = |v: u32| self.height[v as usize] > FOOT || self.from[v as usize].1;
        let from =
            self.reached(protrusion.vertices.iter().copied(), rises).into_iter().map(|v| self.from[v as usize].0);
        let nearest: BTreeSet<u32> = from.filter(|v| *v != NONE).collect();
        let is_at_foot = |face: &[u32]| {
            let count = face.iter().filter(|v| nearest.contains(v)).count();
            count > 0 && count as f64 >= share * face.len() as f64
        };
        let at_foot = (0u32..).zip(self.mesh.faces.iter()).filter(|(_, face)| is_at_foot(face));
        let mut faces: BTreeSet<u32> = at_foot.map(|(f, _)| f).collect();
        if is_piece {
            faces = self.largest_piece(faces);
        }
        self.fill(&mut faces);
        // A mesh may have other components, which no faces surround.
        if self.largest_piece(faces.clone()).len() < faces.len() {
            return None;
        }
        let rim = rim_around(&self.mesh.faces, &faces)?;
        let is_inside = |f: &u32| self.mesh.faces.face(*f as usize).iter().all(|v| !self.on_rim.contains(v));
        faces.iter().all(is_inside).then_some(Foot { faces, rim })
    }

    /// The largest of the pieces of some faces, which are joined by edges.
    fn largest_piece(&self, mut faces: BTreeSet<u32>) -> BTreeSet<u32> {
        let mut largest = BTreeSet::new();
        while let Some(first) = faces.pop_first() {
            let (mut piece, mut open) = (BTreeSet::from([first]), vec![first]);
            while let Some(f) = open.pop() {
                let face = self.mesh.faces.face(f as usize);
                for k in 0..face.len() {
                    let ends = [face[k], face[(k + 1) % face.len()]];
                    let beside =
                        self.about[ends[0] as usize].iter().filter(|g| self.about[ends[1] as usize].contains(g));
                    for g in beside {
                        if faces.remove(g) {
                            piece.insert(*g);
                            open.push(*g);
                        }
                    }
                }
            }
            if piece.len() > largest.len() {
                largest = piece;
            }
        }
        largest
    }

    /// Adds what faces surround: all pieces of the others but the largest.
    fn fill(&self, foot: &mut BTreeSet<u32>) {
        let mut piece_of = vec![NONE; self.mesh.faces.len()];
        let mut sizes = Vec::new();
        for first in 0..piece_of.len() as u32 {
            if piece_of[first as usize] != NONE || foot.contains(&first) {
                continue;
            }
            let (number, mut size, mut open) = (sizes.len() as u32, 0usize, vec![first]);
            piece_of[first as usize] = number;
            while let Some(f) = open.pop() {
                size += 1;
                for &g in self.mesh.faces.face(f as usize).iter().flat_map(|&v| &self.about[v as usize]) {
                    if piece_of[g as usize] == NONE && !foot.contains(&g) {
                        piece_of[g as usize] = number;
                        open.push(g);
                    }
                }
            }
            sizes.push(size);
        }
        let largest = (0u32..).zip(&sizes).max_by_key(|(_, size)| **size).map_or(NONE, |(number, _)| number);
        foot.extend((0u32..).zip(&piece_of).filter(|(_, piece)| **piece != NONE && **piece != largest).map(|(f, _)| f));
    }

    /// Extrudes the faces of the foot along a protrusion.
    fn extrude(&self, mesh: &PolyMesh, protrusion: &Protrusion, Foot { faces: foot, rim }: &Foot) -> Option<PolyMesh> {
        let rest = self.rest(rim, protrusion, foot)?;
        if foot.len() > FEW_FACES && rest.total_area() > WIDE_MAX * protrusion.area {
            return None;
        }
        let rest = primitive(&rest, Components::Largest).ok().filter(|rest| rest.topology == Topology::Disc)?;
        let chart = unfold(&rest, &UnfoldOptions::default()).ok()?;
        let index = PlanarIndex::new(&chart);
        let ground = UnfoldedRest { chart: &chart, index: &index };
        let along = ground.along(mesh, rim)?;
        let edges = (0..rim.len()).map(|k| [k, (k + 1) % rim.len()].map(|k| mesh.positions[rim[k] as usize]));
        let edge = edges.map(|[a, b]| (b - a).norm()).sum::<f64>() / rim.len() as f64;
        if along.away > AWAY_MAX * edge {
            return None;
        }
        // The faces of a square foot reach an eighth of its rim inward.
        let rows = ground.rows(mesh, rim, &along, RowsEnd::BeforePole(rim.len() as f64 / 8.0));
        let like = *foot.first()? as usize;
        let mut grown = GrownMesh::new(mesh, rim.clone(), like);
        rows.rows.iter().for_each(|row| grown.row(row));
        let moved: BTreeMap<u32, u32> = rim.iter().copied().zip(grown.rim.iter().copied()).collect();
        let places = self.at_tip(foot, rim, &rows.edge());
        let mut grown = grown.mesh;
        for (v, at) in places {
            grown.positions[v as usize] = ground.at(from_polar(at));
        }
        let renumbered = |(f, face): (u32, &[u32])| -> Vec<u32> {
            let of = |v: &u32| moved.get(v).copied().filter(|_| foot.contains(&f)).unwrap_or(*v);
            face.iter().map(of).collect()
        };
        let mut faces = Polygons::default();
        (0u32..).zip(grown.faces.iter()).for_each(|of| faces.push(&renumbered(of)));
        grown.faces = faces;
        let new = (grown.faces.len() - mesh.faces.len()) as f64;
        let [new, own] = [rest.mesh.total_area() / new, self.surface.total_area() / self.mesh.faces.len() as f64];
        (new * FINE_MAX > own && lies_outward(&ground, &rows, mesh, rim)).then_some(grown)
    }

    /// Cuts out the part of the surface that lies within the rim of a foot, with the protrusion on it.
    fn rest(&self, rim: &[u32], protrusion: &Protrusion, foot: &BTreeSet<u32>) -> Option<Arc<TriMesh>> {
        let ends = |k: usize| [rim[k], rim[(k + 1) % rim.len()]].map(|v| self.mesh.positions[v as usize]);
        let away = |v: u32| {
            stop::pass(rim.len());
            let x = self.surface.positions[v as usize];
            let of = |edge: [Vec3; 2]| (edge[0].lerp(&edge[1], nearest_share(edge, x)) - x).norm();
            (0..rim.len()).map(|k| of(ends(k))).fold(f64::INFINITY, f64::min)
        };
        let is_over = |v: u32| self.nearest_face(v).is_some_and(|f| foot.contains(&f));
        let within = self.reached(protrusion.vertices.iter().copied(), is_over);
        // Only beside the curve does it matter how far a vertex is.
        let beside = within.iter().flat_map(|&v| &self.beside[v as usize]).filter(|v| !within.contains(v));
        let beside: BTreeSet<u32> = beside.copied().collect();
        let mut field = vec![diagonal(self.surface.positions.iter()); self.surface.positions.len()];
        beside.iter().for_each(|&v| field[v as usize] = away(v));
        within.iter().for_each(|&v| field[v as usize] = -away(v));
        let mut cut = segment_above(self.surface, &field).ok()?;
        (cut.parts.len() == 2).then(|| cut.parts.swap_remove(1).mesh)
    }

    /// The places of the inner vertices of a foot within its rim, whose vertices are at `edge`, in the plane: each in the middle of those
    /// beside it.
    fn at_tip(&self, foot: &BTreeSet<u32>, rim: &[u32], edge: &[[f64; 2]]) -> BTreeMap<u32, [f64; 2]> {
        let mut places: BTreeMap<u32, [f64; 2]> = rim.iter().copied().zip(edge.iter().copied()).collect();
        let mut beside: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        for face in foot.iter().map(|&f| self.mesh.faces.face(f as usize)) {
            for (k, &a) in face.iter().enumerate() {
                let b = face[(k + 1) % face.len()];
                for (a, b) in [(a, b), (b, a)] {
                    if !rim.contains(&a) {
                        beside.entry(a).or_default().insert(b);
                    }
                }
            }
        }
        places.extend(beside.keys().map(|&v| (v, [0.0; 2])));
        for _ in 0..STEPS {
            for (v, others) in &beside {
                let sum = others.iter().map(|w| places[w]).fold([0.0; 2], |sum, at| [sum[0] + at[0], sum[1] + at[1]]);
                places.insert(*v, sum.map(|x| x / others.len() as f64));
            }
        }
        places.retain(|v, _| beside.contains_key(v));
        places
    }
}

/// Tells whether the quads of rows around a protrusion look out of the surface where they lie, but for a small share of their area.
fn lies_outward(ground: &UnfoldedRest, rows: &Rows, mesh: &PolyMesh, rim: &[u32]) -> bool {
    let n = rim.len();
    let first: Vec<Vec3> = rim.iter().map(|&v| mesh.positions[v as usize]).collect();
    let places: Vec<&Vec<Vec3>> = std::iter::once(&first).chain(&rows.rows).collect();
    let (mut all, mut inward) = (0.0, 0.0);
    for k in 0..rows.rows.len() {
        let v = 0.5 * (rows.depths[k] + rows.depths[k + 1]);
        for (i, j) in (0..n).map(|i| (i, (i + 1) % n)) {
            let corners = [places[k][j], places[k][i], places[k + 1][i], places[k + 1][j]];
            let normal = (corners[2] - corners[0]).cross(&(corners[3] - corners[1]));
            let step = |u: &[f64]| u[j] - u[i] - (u[j] - u[i]).round();
            let between = |u: &[f64]| u[i] + 0.5 * step(u);
            let u = 0.5 * (between(&rows.u[k]) + between(&rows.u[k + 1]));
            let there = ground.normal([u, v]);
            all += normal.norm();
            if normal.dot(&there) < 0.0 {
                inward += normal.norm();
            }
        }
    }
    inward <= INWARD_MAX * all
}

/// The mean length of the edges at each vertex.
fn mean_edges(mesh: &PolyMesh) -> Vec<f64> {
    let mut sums = vec![(0.0, 0usize); mesh.positions.len()];
    for face in mesh.faces.iter() {
        for (k, &a) in face.iter().enumerate() {
            let b = face[(k + 1) % face.len()];
            let length = (mesh.positions[b as usize] - mesh.positions[a as usize]).norm();
            for v in [a, b] {
                let sum = &mut sums[v as usize];
                *sum = (sum.0 + length, sum.1 + 1);
            }
        }
    }
    sums.into_iter().map(|(sum, count)| sum / count.max(1) as f64).collect()
}

/// Of each vertex of a surface the point that is nearest along its edges, and how far that is. Those that can't be reached have
/// [`NONE`]. *Source:* Dijkstra 1959.
fn nearest_along(points: &[Vec3], surface: &TriMesh, beside: &[Vec<u32>]) -> Vec<(f64, u32)> {
    let mut found = vec![(f64::INFINITY, NONE); surface.positions.len()];
    // Positive finite floats order like their bits, so the heap needs no float wrapper.
    let mut heap: BinaryHeap<Reverse<(u64, u32)>> = BinaryHeap::new();
    for ((point, v), at) in points.iter().zip(0u32..).zip(Bvh::new(surface).closest_to_all(points)) {
        let Some(corners) = surface.triangles.get(at.triangle as usize) else { continue };
        for &w in corners {
            let distance = (surface.positions[w as usize] - point).norm();
            if distance < found[w as usize].0 {
                found[w as usize] = (distance, v);
                heap.push(Reverse((distance.to_bits(), w)));
            }
        }
    }
    while let Some(Reverse((key, v))) = heap.pop() {
        stop::pass(1);
        let (distance, from) = found[v as usize];
        if f64::from_bits(key) > distance {
            continue;
        }
        for &w in &beside[v as usize] {
            let longer = distance + (surface.positions[w as usize] - surface.positions[v as usize]).norm();
            if longer < found[w as usize].0 {
                found[w as usize] = (longer, from);
                heap.push(Reverse((longer.to_bits(), w)));
            }
        }
    }
    found
}

/// The rim of the faces around some that are one disc, in the order in which its edges run on the faces around it; `None` where the
/// rim is no simple loop.
fn rim_around(faces: &Polygons, disc: &BTreeSet<u32>) -> Option<Vec<u32>> {
    let mut rim = only_rim(disc.iter().map(|&f| faces.face(f as usize)))?;
    rim.get_mut(1..)?.reverse();
    Some(rim)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    /// Quads of a cage of n × n over the middle of the unit square.
    fn cage(n: u32) -> PolyMesh {
        let at = |i: u32, j: u32| j * (n + 1) + i;
        let place = |k: u32| 0.1 + 0.8 * f64::from(k) / f64::from(n);
        let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| Vec3::new(place(i), place(j), 0.0))).collect();
        let mut faces = Polygons::default();
        (0..n * n).for_each(|k| {
            faces.push(&[at(k % n, k / n), at(k % n + 1, k / n), at(k % n + 1, k / n + 1), at(k % n, k / n + 1)])
        });
        PolyMesh { positions, faces, ..PolyMesh::default() }
    }

    /// The unit square with horns of a height at some points, .05 in radius.
    fn horned(points: &[[f64; 2]], height: f64) -> TriMesh {
        let mut sheet = grid(120, 120, false, false);
        for p in &mut sheet.positions {
            let away = points.iter().map(|[x, y]| (p.x - x).hypot(p.y - y)).fold(f64::INFINITY, f64::min);
            p.z = height * (1.0 - away / 0.05).max(0.0);
        }
        sheet
    }

    /// How often each edge is run along.
    fn halfedges(mesh: &PolyMesh) -> BTreeMap<(u32, u32), u32> {
        let mut count = BTreeMap::new();
        for face in mesh.faces.iter() {
            (0..face.len()).for_each(|k| *count.entry((face[k], face[(k + 1) % face.len()])).or_insert(0) += 1);
        }
        count
    }

    #[test]
    fn faces_are_extruded_along_two_horns_and_keep_their_numbers() {
        // In the middle of a face, and about a vertex.
        let (mesh, surface) = (cage(8), horned(&[[0.35, 0.35], [0.6, 0.6]], 0.5));
        let missed_before = missed(&mesh, &surface);
        assert!((0.03..0.3).contains(&missed_before), "{missed_before}");
        let Extrusion { mesh: Some((grown, 2)), missed } = extruded(&mesh, &surface) else { panic!("two horns") };
        assert!(missed < 1e-12);
        assert!(halfedges(&grown).values().all(|count| *count == 1), "it is manifold, and its faces turn alike");
        let open = |mesh: &PolyMesh| {
            let all = halfedges(mesh);
            all.keys().filter(|(a, b)| !all.contains_key(&(*b, *a))).count()
        };
        assert_eq!(open(&grown), open(&mesh), "there is no other rim");
        assert!(grown.faces.iter().all(|face| face.len() == 4));
        let moved = mesh.faces.iter().zip(grown.faces.iter()).filter(|(before, after)| before != after).count();
        assert!((2..=10).contains(&moved), "{moved} faces are at a tip");
        let stayed = mesh.positions.iter().zip(&grown.positions).filter(|(before, after)| before == after).count();
        assert!(stayed + 2 >= mesh.positions.len(), "{stayed}");
        for [x, y] in [[0.35, 0.35], [0.6, 0.6]] {
            let about = |p: &&Vec3| (p.x - x).hypot(p.y - y) < 0.06;
            let top = grown.positions.iter().filter(about).map(|p| p.z).fold(0.0, f64::max);
            assert!((0.3..=0.5).contains(&top), "{top}");
        }
        let (mesh, tree) = (grown, Bvh::new(&surface));
        let away = mesh.positions.iter().map(|p| tree.closest(*p).distance).fold(0.0, f64::max);
        assert!(away < 1e-6, "new vertices lie on the surface: {away}");
    }

    #[test]
    fn hollows_low_bumps_and_what_stands_beside_the_mesh_are_left_as_they_are() {
        let mesh = cage(8);
        let left = |points: &[[f64; 2]], height: f64| {
            let Extrusion { mesh: grown, missed } = extruded(&mesh, &horned(points, height));
            (grown.is_none(), missed > 0.02)
        };
        assert_eq!(left(&[[0.35, 0.35]], -0.5), (true, false), "a hollow");
        assert_eq!(left(&[[0.35, 0.35]], 0.15), (true, false), "lower than two edges are long");
        assert_eq!(left(&[[0.04, 0.04]], 0.5), (true, false), "beyond the rim");
        assert!(extruded(&PolyMesh::default(), &horned(&[], 0.0)).mesh.is_none(), "no faces");
    }

    #[test]
    fn a_ring_is_no_disc() {
        let mesh = cage(4);
        let all: BTreeSet<u32> = (0..16).collect();
        assert_eq!(rim_around(&mesh.faces, &all).map(|rim| rim.len()), Some(16));
        let ring: BTreeSet<u32> = all.into_iter().filter(|f| ![5, 6, 9, 10].contains(f)).collect();
        assert_eq!(rim_around(&mesh.faces, &ring), None);
    }
}
