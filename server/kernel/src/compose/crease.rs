//! A net is snapped to the sharp lines of its input: corners get a vertex, lines a chain of edges.
//!
//! Corners first: each is given the nearest free vertex. Then each line ([`lines`]), the longest first, gets a path of edges
//! between its corners ([`path`]), which is laid onto it; what is around follows ([`settle`]). Where there is no path, or it
//! turns faces over, or makes the angles around worse by more than [`WORSE_DEG`], each half of the line is tried, and at
//! last it is left alone. *Ours, not the paper's.*

pub mod lines;
pub mod path;
pub mod settle;

use super::check::quad_area_vector;
use super::net::Net;
use super::smooth::Target;
use super::square::deviation_deg;
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use lines::{InteriorOrBorder, Line, LineCorner, Lines};
use path::{Occupancy, path};
use settle::{LaidLine, settle};

/// How far a corner's vertex may be, in edges of the net.
const CORNER_REACH: f64 = 2.0;
/// Rounds in which what is around a corner or a line follows, and around all of them at the end.
const ROUNDS: usize = 8;
const LAST_ROUNDS: usize = 12;
/// By how much the mean deviation from right angles around a line may grow for it, in degrees, before all comes to rest.
const WORSE_DEG: f64 = 4.0;
/// A line with so many vertices on its path may turn over one face.
const TURNED_EVERY: usize = 12;
/// Sine by which a corner has to be concave for its face to count as turned over.
const CONCAVE: f64 = 0.2;
/// Times that a line is halved, and least length of one that is, in edges.
const SPLITS: usize = 2;
const SPLIT_MIN: f64 = 8.0;
/// A surface with more lines is rough, and has none.
const LINES_MAX: usize = 600;
/// Starts of a closed path that are tried.
const STARTS: usize = 6;

/// Tells which vertices lie on sharp lines after snapping, and how much of the lines' length has edges on it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SnappedLines {
    /// Whether each vertex lies on a line or a corner now.
    pub on_line: Vec<bool>,
    /// Length of the lines.
    pub length: f64,
    /// Length of them that has a path of edges.
    pub met: f64,
}

/// Snaps a net to the sharp lines of its input, whose sharp edges are given by a halfedge of each; vertices for which `stays`
/// holds don't move.
pub fn snap(
    net: &mut Net,
    surface: &TriMesh,
    sharp: &[u32],
    target: &Target,
    stays: &dyn Fn(u32) -> bool,
) -> SnappedLines {
    let found = Lines::of(surface, sharp, net);
    let mut snapper = Snapper::new(net, surface, target, stays);
    if found.lines.is_empty() || found.lines.len() > LINES_MAX {
        return snapper.snapped;
    }
    let vertices = snapper.corners(&found.corners);
    let mut order: Vec<usize> = (0..found.lines.len()).collect();
    let length = |k: usize| found.lines[k].length();
    order.sort_by(|&a, &b| length(b).total_cmp(&length(a)).then(a.cmp(&b)));
    for k in order {
        let line = &found.lines[k];
        let laid = match line.ends {
            Some(ends) => snapper.open_line(line, ends.map(|end| vertices.get(end).copied().flatten()), SPLITS),
            None => snapper.closed_line(line),
        };
        snapper.snapped.met += laid;
        snapper.snapped.length += line.length();
    }
    snapper.finish()
}

struct Snapper<'a> {
    net: &'a mut Net,
    surface: &'a TriMesh,
    target: &'a Target,
    taken: Vec<Occupancy>,
    stays: Vec<bool>,
    met: Vec<LaidLine>,
    snapped: SnappedLines,
}

/// How good the faces at some vertices are.
#[derive(Clone, Copy, Debug)]
struct Quality {
    turned: usize,
    deviation_deg: f64,
}

impl<'a> Snapper<'a> {
    fn new(net: &'a mut Net, surface: &'a TriMesh, target: &'a Target, stays: &dyn Fn(u32) -> bool) -> Self {
        let count = net.positions.len() as u32;
        let stays: Vec<bool> = (0..count).map(|v| net.at(v).is_empty() || stays(v)).collect();
        let taken = |v: u32| if stays[v as usize] || net.on_boundary(v) { Occupancy::Taken } else { Occupancy::Free };
        let taken = (0..count).map(taken).collect();
        let snapped = SnappedLines { on_line: vec![false; count as usize], ..SnappedLines::default() };
        Self { net, surface, target, taken, stays, met: Vec::new(), snapped }
    }

    /// Gives each corner the nearest free vertex, the nearest pairs first.
    fn corners(&mut self, corners: &[LineCorner]) -> Vec<Option<u32>> {
        let border: Vec<bool> = (0..self.net.positions.len() as u32).map(|v| self.net.on_boundary(v)).collect();
        let mut pairs: Vec<(f64, usize, u32)> = Vec::new();
        for (c, corner) in corners.iter().enumerate() {
            for (v, p) in self.net.positions.iter().enumerate() {
                let away = (p - corner.point).norm();
                let fits = border[v] == (corner.place == InteriorOrBorder::Border) && !self.stays[v];
                if fits && away <= CORNER_REACH * corner.edge {
                    pairs.push((away, c, v as u32));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut given: Vec<Option<u32>> = vec![None; corners.len()];
        let mut used = vec![false; self.net.positions.len()];
        for (_, c, v) in pairs {
            if given[c].is_some() || used[v as usize] {
                continue;
            }
            used[v as usize] = true;
            given[c] = Some(v);
            self.taken[v as usize] = Occupancy::Taken;
        }
        given
    }

    /// Lays a path onto a line between two vertices, or onto parts of it; gives the length that is met. Where an end has no
    /// vertex, or no path leads along the whole, the line is halved.
    fn open_line(&mut self, line: &Line, ends: [Option<u32>; 2], splits: usize) -> f64 {
        if let [Some(a), Some(b)] = ends
            && a != b
            && let Some(found) = path(self.net, line, [a, b], &self.taken)
            && self.lay(line.clone(), found)
        {
            return line.length();
        }
        if splits == 0 || line.length() < SPLIT_MIN * line.edge {
            return 0.0;
        }
        let middle = 0.5 * line.length();
        let Some(v) = self.nearest_free(line.point(middle), CORNER_REACH * line.edge) else { return 0.0 };
        let old = std::mem::replace(&mut self.taken[v as usize], Occupancy::Taken);
        let at = line.nearest(self.net.positions[v as usize]).at.clamp(0.5 * middle, 1.5 * middle);
        let first = self.open_line(&line.part(0.0, at), [ends[0], Some(v)], splits - 1);
        let second = self.open_line(&line.part(at, line.length()), [Some(v), ends[1]], splits - 1);
        if first + second <= 0.0 {
            self.taken[v as usize] = old;
        }
        first + second
    }

    fn nearest_free(&self, x: Vec3, reach: f64) -> Option<u32> {
        let away = |v: u32| (self.net.positions[v as usize] - x).norm_squared();
        let free = (0..self.net.positions.len() as u32).filter(|&v| self.taken[v as usize] == Occupancy::Free);
        free.min_by(|&a, &b| away(a).total_cmp(&away(b))).filter(|&v| away(v) <= reach * reach)
    }

    /// A closed line has no corner to begin at: the free vertices nearest to points of it are tried in turn.
    fn closed_line(&mut self, line: &Line) -> f64 {
        for k in 0..STARTS {
            let x = line.point(k as f64 / STARTS as f64 * line.length());
            let Some(start) = self.nearest_free(x, CORNER_REACH * line.edge) else { continue };
            let turned = line.turned(line.nearest(self.net.positions[start as usize]).at);
            if let Some(found) = path(self.net, &turned, [start, start], &self.taken)
                && self.lay(turned, found)
            {
                return line.length();
            }
        }
        0.0
    }

    /// Lays a path onto its line, unless that makes what is around worse.
    fn lay(&mut self, line: Line, path: Vec<u32>) -> bool {
        let before = self.snapped.on_line.clone();
        path.iter().for_each(|&v| self.snapped.on_line[v as usize] = true);
        let is_laid = self.tried(LaidLine::new(self.net, line, path.clone()));
        if is_laid {
            path.iter().for_each(|&v| self.taken[v as usize] = Occupancy::Taken);
        } else {
            self.snapped.on_line = before;
        }
        is_laid
    }

    /// Lays a path and lets what is around follow; undoes it where faces turn over or become much worse.
    fn tried(&mut self, met: LaidLine) -> bool {
        let allowed = met.path.len() / TURNED_EVERY;
        let at = met.path.clone();
        let mut met = vec![met];
        let is_good = self.settled_if(&mut met, &at, ROUNDS, |before, after| {
            after.turned <= before.turned + allowed && after.deviation_deg - before.deviation_deg <= WORSE_DEG
        });
        if is_good {
            self.met.extend(met);
        }
        is_good
    }

    /// Lets lines and what is around come to rest if the quality before and after says that this is good; whether it is.
    fn settled_if(
        &mut self,
        met: &mut [LaidLine],
        at: &[u32],
        rounds: usize,
        is_good: impl Fn(Quality, Quality) -> bool,
    ) -> bool {
        let old = self.net.positions.clone();
        let (stays, on_line) = (&self.stays, &self.snapped.on_line);
        let moved = settle(self.net, met, at, &|v| stays[v as usize] || on_line[v as usize], self.target, rounds);
        let faces = self.faces(&moved);
        let after = self.quality(&faces);
        let new = std::mem::replace(&mut self.net.positions, old);
        let is_good = is_good(self.quality(&faces), after);
        if is_good {
            self.net.positions = new;
        }
        is_good
    }

    fn faces(&self, vertices: &[u32]) -> Vec<u32> {
        let mut faces: Vec<u32> = vertices.iter().flat_map(|&v| self.net.at(v)).copied().collect();
        faces.sort_unstable();
        faces.dedup();
        faces
    }

    fn quality(&self, faces: &[u32]) -> Quality {
        let mut quality = Quality { turned: 0, deviation_deg: 0.0 };
        for &f in faces {
            let &[a, b, c, d] = self.net.face(f) else { continue };
            let p = [a, b, c, d].map(|v| self.net.positions[v as usize]);
            let normal = quad_area_vector(p);
            let t = self.target.triangle(p.iter().sum::<Vec3>() / 4.0);
            let is_there = (t as usize) < self.surface.triangles.len();
            let outward = if is_there { self.surface.area_vector(t as usize) } else { normal };
            let is_concave = (0..4).any(|k| {
                let (e, g) = (p[(k + 1) % 4] - p[k], p[(k + 3) % 4] - p[k]);
                e.cross(&g).dot(&normal) < -CONCAVE * e.norm() * g.norm() * normal.norm()
            });
            quality.turned += usize::from(is_concave || normal.dot(&outward) < 0.0);
            quality.deviation_deg += deviation_deg(p);
        }
        quality.deviation_deg /= faces.len().max(1) as f64;
        quality
    }

    /// All lines come to rest together, if that is no worse.
    fn finish(mut self) -> SnappedLines {
        let on: Vec<u32> = (0..).zip(&self.snapped.on_line).filter(|(_, on)| **on).map(|(v, _)| v).collect();
        let mut met = std::mem::take(&mut self.met);
        self.settled_if(&mut met, &on, LAST_ROUNDS, |before, after| {
            after.turned <= before.turned && after.deviation_deg <= before.deviation_deg
        });
        self.snapped
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::check::{TopologyCounts, check};
    use crate::map::snap::lines::sharp_edges;
    use std::collections::BTreeMap;

    /// The cube of side 2 as twelve triangles.
    fn cube() -> TriMesh {
        let net = lattice(1);
        let triangles = net.faces().flat_map(|(_, c)| [[c[0], c[1], c[2]], [c[0], c[2], c[3]]]).collect();
        TriMesh::from_triangles(net.positions.clone(), triangles).expect("a cube")
    }

    /// The same as n × n quads a side.
    fn lattice(n: u32) -> Net {
        let (mut net, mut number) = (Net::default(), BTreeMap::new());
        for (axis, side) in (0..3).flat_map(|axis| [(axis, 0), (axis, n)]) {
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let mut quad: Vec<u32> = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                    .map(|(i, j)| {
                        let mut at = [side; 3];
                        (at[(axis + 1) % 3], at[(axis + 2) % 3]) = (i, j);
                        let point = Vec3::from(at.map(|k| 2.0 * f64::from(k) / f64::from(n) - 1.0));
                        *number.entry(at).or_insert_with(|| net.add_vertex(point))
                    })
                    .into();
                if side == 0 {
                    quad.reverse();
                }
                net.add_face(quad);
            }
        }
        net
    }

    /// A cube's lattice turned by some degrees about an oblique axis and put back onto the cube: rows cross its edges.
    fn turned(n: u32, degrees: f64, target: &Target) -> Net {
        let mut net = lattice(n);
        let axis = Vec3::new(1.0, 2.0, 3.0).normalize() * degrees.to_radians();
        net.positions.iter_mut().for_each(|p| *p = target.onto_surface(*p + axis.cross(p)));
        net
    }

    fn is_on_edge(p: &Vec3) -> bool {
        p.iter().filter(|x| (x.abs() - 1.0).abs() < 1e-9).count() >= 2
    }

    #[test]
    fn corners_and_edges_of_a_box_are_met() {
        let surface = cube();
        let target = Target::new(&surface);
        let mut net = turned(12, 4.0, &target);
        let snapped = snap(&mut net, &surface, &sharp_edges(&surface, &[]), &target, &|_| false);
        assert!((snapped.length - 24.0).abs() < 1e-9 && (snapped.met - 24.0).abs() < 1e-9, "{snapped:?}");
        let on: Vec<&Vec3> =
            net.positions.iter().zip(&snapped.on_line).filter(|(_, on)| **on).map(|(p, _)| p).collect();
        assert!(on.iter().all(|p| is_on_edge(p)));
        assert!(on.len() >= 8 + 12 * 10, "{}", on.len());
        for corner in &surface.positions {
            assert_eq!(on.iter().filter(|p| (**p - corner).norm() < 1e-9).count(), 1);
        }
        let (mesh, _) = net.into_mesh();
        assert_eq!(check(&mesh, TopologyCounts::of(&surface)), Ok(()));
        // No face is cut by an edge of the box.
        let is_flat = |c: &[u32]| (0..3).any(|k| c.iter().all(|&v| mesh.positions[v as usize][k].abs() > 1.0 - 1e-9));
        assert!(mesh.faces.iter().all(is_flat));
    }

    #[test]
    fn what_stays_is_not_moved_and_the_rest_of_its_line_may_be_met() {
        let surface = cube();
        let target = Target::new(&surface);
        let mut net = turned(12, 4.0, &target);
        let before = net.positions.clone();
        let snapped = snap(&mut net, &surface, &sharp_edges(&surface, &[]), &target, &|v| before[v as usize].x > 0.5);
        assert!(snapped.met > 8.0 && snapped.met < 20.0, "{snapped:?}");
        let held = (0..before.len()).filter(|&v| before[v].x > 0.5);
        assert!(held.into_iter().all(|v| net.positions[v] == before[v] && !snapped.on_line[v]));
    }

    #[test]
    fn nothing_is_snapped_on_a_smooth_or_a_rough_sphere() {
        for noise in [0.0, 0.004] {
            let mut fine = lattice(24);
            let unit = |net: &mut Net| net.positions.iter_mut().for_each(|p| *p = p.normalize());
            unit(&mut fine);
            for (v, p) in fine.positions.iter_mut().enumerate() {
                *p *= 1.0 + noise * (v as f64 * 12.9898).sin() * 2.0;
            }
            let triangles = fine.faces().flat_map(|(_, c)| [[c[0], c[1], c[2]], [c[0], c[2], c[3]]]).collect();
            let surface = TriMesh::from_triangles(fine.positions.clone(), triangles).expect("a sphere");
            let mut net = lattice(10);
            unit(&mut net);
            let before = net.positions.clone();
            let snapped = snap(&mut net, &surface, &sharp_edges(&surface, &[]), &Target::new(&surface), &|_| false);
            assert_eq!((snapped.length, snapped.on_line.contains(&true)), (0.0, false), "{noise}");
            assert_eq!(net.positions, before);
        }
    }
}
