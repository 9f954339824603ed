//! Where the vertices of the example's sharp edges go on the input's.
//!
//! A vertex of a line goes to the nearest point of the input's lines if that is nearer than most of an edge of the mapped
//! example and runs within [`DIRECTION_DEG`] of the mapped line, and if its neighbours along the line do so too; a corner
//! goes to the nearest corner. Ridges go to ridges, and valleys to valleys.

use std::collections::{BTreeMap, BTreeSet};

use super::lines::{SharpLines, bend};
use super::{CrossMap, Targets};
use crate::encode::index::Location;
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::unfold::Chart;

/// Farthest that a vertex is snapped, in edges of the mapped line there: a parallel line of the example may be one away.
const REACH: f64 = 0.7;
/// The same for corners.
const CORNER_REACH: f64 = 1.5;
/// Greatest angle between the two lines, in degrees.
const DIRECTION_DEG: f64 = 30.0;
/// A line of the example, given by its file, that bends less may be a ridge or a valley.
const BEND_MIN_DEG: f64 = 15.0;
/// Fewest vertices in a row.
const RUN_MIN: usize = 4;

/// Places for vertices on the example's lines `own`.
pub fn targets(mesh: &TriMesh, own: &SharpLines, cross: &CrossMap, input: &Chart) -> Targets {
    if own.edges.is_empty() {
        return Targets::new();
    }
    let there = SharpLines::of(&input.mesh, &[]);
    let segments = Segments::new(&input.mesh, &there);
    let on_boundary = mesh.boundary_vertices();
    let mut targets = corner_targets(own, &there, cross, input);
    targets.retain(|v, _| !on_boundary[*v as usize]);
    let mut taken: BTreeMap<u32, Location> = BTreeMap::new();
    for (&v, around) in &own.neighbours {
        if on_boundary[v as usize] || own.corners.contains(&v) {
            continue;
        }
        let [a, b] = around[..] else { continue };
        let [x, p, q] = [v, a, b].map(|v| cross.positions[v as usize]);
        let reach = REACH * 0.5 * ((p - x).norm() + (q - x).norm());
        if let Some(place) = segments.nearest(x, q - p, bend_of(own, v), reach) {
            taken.insert(v, place);
        }
    }
    targets.extend(taken);
    in_rows(own, &mut targets);
    targets
}

/// Leaves out the places of vertices that are not in a connected row of at least [`RUN_MIN`].
pub fn in_rows(own: &SharpLines, targets: &mut Targets) {
    let mut seen = BTreeSet::new();
    let mut short = BTreeSet::new();
    for &start in targets.keys() {
        if !seen.insert(start) {
            continue;
        }
        let (mut row, mut next) = (vec![start], 0);
        while let Some(v) = row.get(next) {
            next += 1;
            let along = own.neighbours.get(v).into_iter().flatten();
            row.extend(along.filter(|w| targets.contains_key(w) && seen.insert(**w)));
        }
        if row.len() < RUN_MIN {
            short.extend(row);
        }
    }
    targets.retain(|v, _| !short.contains(v));
}

/// How much the surface bends at a vertex of a line, positive on a ridge.
fn bend_of(lines: &SharpLines, v: u32) -> f64 {
    lines.bend_at.get(&v).copied().unwrap_or(0.0)
}

/// Whether two lines that bend so much may be the same.
fn alike(own: f64, there: f64) -> bool {
    own.abs() < BEND_MIN_DEG || own * there > 0.0
}

/// Places for corners: the nearest corner, if each is the other's nearest.
fn corner_targets(own: &SharpLines, there: &SharpLines, cross: &CrossMap, input: &Chart) -> Targets {
    let mut best: BTreeMap<u32, (f64, u32)> = BTreeMap::new();
    for &v in &own.corners {
        let x = cross.positions[v as usize];
        let around = own.neighbours.get(&v).into_iter().flatten();
        let lengths: Vec<f64> = around.map(|&w| (cross.positions[w as usize] - x).norm()).collect();
        let reach = CORNER_REACH * lengths.iter().sum::<f64>() / lengths.len().max(1) as f64;
        let away = |c: &u32| (input.mesh.positions[*c as usize] - x).norm();
        let fits = |c: &&u32| alike(bend_of(own, v), bend_of(there, **c));
        let Some(&c) = there.corners.iter().filter(fits).min_by(|a, b| away(a).total_cmp(&away(b))) else { continue };
        if away(&c) <= reach && best.get(&c).is_none_or(|(d, _)| away(&c) < *d) {
            best.insert(c, (away(&c), v));
        }
    }
    let halfedge = |c: u32| there.edges.iter().find(|&&h| input.mesh.tail(h) == c || input.mesh.head(h) == c).copied();
    let place = |(c, (_, v)): (u32, (f64, u32))| {
        let h = halfedge(c)?;
        Some((v, Location::on_edge(h, if input.mesh.tail(h) == c { 0.0 } else { 1.0 })))
    };
    best.into_iter().filter_map(place).collect()
}

/// The input's sharp edges in buckets.
struct Segments<'a> {
    mesh: &'a TriMesh,
    lines: &'a SharpLines,
    buckets: BTreeMap<[i64; 3], Vec<u32>>,
    cell: f64,
}

/// Cells of a bucket grid along √area.
const CELLS: f64 = 64.0;
/// Cells looked at in each direction at most.
const CELLS_AROUND_MAX: i64 = 4;

impl<'a> Segments<'a> {
    fn new(mesh: &'a TriMesh, lines: &'a SharpLines) -> Self {
        let cell = (mesh.total_area().sqrt() / CELLS).max(f64::MIN_POSITIVE);
        let mut buckets: BTreeMap<[i64; 3], Vec<u32>> = BTreeMap::new();
        for (k, &h) in lines.edges.iter().enumerate() {
            let [a, b] = [mesh.tail(h), mesh.head(h)].map(|v| mesh.positions[v as usize]);
            let steps = ((b - a).norm() / cell).ceil().clamp(1.0, 4096.0) as usize;
            let mut cells: Vec<[i64; 3]> =
                (0..=steps).map(|s| key(a.lerp(&b, s as f64 / steps as f64), cell)).collect();
            cells.dedup();
            cells.into_iter().for_each(|c| buckets.entry(c).or_default().push(k as u32));
        }
        Self { mesh, lines, buckets, cell }
    }

    /// The nearest point of an edge within `reach` that runs along `direction` and bends like `bend`.
    fn nearest(&self, x: Vec3, direction: Vec3, bend: f64, reach: f64) -> Option<Location> {
        let around = ((reach / self.cell).ceil() as i64).clamp(1, CELLS_AROUND_MAX);
        let [i, j, k] = key(x, self.cell);
        let mut best: Option<(f64, Location)> = None;
        for di in -around..=around {
            for dj in -around..=around {
                for dk in -around..=around {
                    for &s in self.buckets.get(&[i + di, j + dj, k + dk]).into_iter().flatten() {
                        let (away, place) = self.onto(self.lines.edges[s as usize], x, direction);
                        let fits = alike(bend, self.lines.bends[s as usize]);
                        if fits && away <= reach && best.as_ref().is_none_or(|(least, _)| away < *least) {
                            best = Some((away, place));
                        }
                    }
                }
            }
        }
        best.map(|(_, place)| place)
    }

    /// The nearest point of an edge, and how far it is; infinitely far if the edge runs another way.
    fn onto(&self, h: u32, x: Vec3, direction: Vec3) -> (f64, Location) {
        let [a, b] = [self.mesh.tail(h), self.mesh.head(h)].map(|v| self.mesh.positions[v as usize]);
        let share = self.mesh.nearest_share(h, x);
        let angle = bend(b - a, direction);
        let fits = angle.min(180.0 - angle) <= DIRECTION_DEG;
        let away = if fits { (self.mesh.point_on(h, share) - x).norm() } else { f64::INFINITY };
        (away, Location::on_edge(h, share))
    }
}

fn key(x: Vec3, cell: f64) -> [i64; 3] {
    [x.x, x.y, x.z].map(|x| (x / cell).floor() as i64)
}
