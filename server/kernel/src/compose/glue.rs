//! Parts become one net: vertices at junctions and matched vertices along arcs are merged, what stays open between two
//! matched pairs is filled.
//!
//! *Source:* paper §6 (merging, hole filling). *Ours, not the paper's:* which vertices are merged is told by the arcs
//! ([`super::seam`]). Where p edges lie against one, two of them are folded onto each other, so that the two faces beside
//! them become one; where that can't be, the hole is filled by 3 : 1 quads, p odd, or by these and a triangle, p even.

use super::layout::{Curve, Layout};
use super::net::Net;
use super::rim::{Rim, lay, pair_loops, place_junctions};
use super::seam::{ArcRow, match_closed, match_open};
use crate::mesh::Vec3;
use crate::mesh::tri::NONE;
use crate::numerics::stop;
use std::collections::BTreeMap;

/// Parts in one net.
#[derive(Clone, Debug, Default)]
pub struct Glued {
    /// The net: quads, triangles and what polygons the parts had.
    pub net: Net,
    /// Vertices on seams.
    pub seam: Vec<u32>,
    /// Faces that fill holes.
    pub filled: usize,
    /// Pairs of vertices that were merged along arcs.
    pub merged: usize,
}

/// Why parts could not be joined as they are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Misfit {
    /// A part's loops are not those of its segment.
    Loops {
        /// The segment.
        segment: usize,
    },
    /// A part has too few boundary vertices, or edges, for its segment's arcs: it has to be subdivided.
    TooCoarse {
        /// The segment.
        segment: usize,
    },
    /// Merging made a face that has a vertex twice, or an edge of more than two faces, with these parts involved.
    Pinched {
        /// The segments.
        segments: Vec<usize>,
    },
}

/// The boundary loops of a part, laid on its segment's curves: one a curve, with vertices chosen for the junctions.
///
/// # Errors
/// [`Misfit::Loops`], [`Misfit::TooCoarse`].
pub fn rims(net: &Net, curves: &[Curve], segment: usize) -> Result<Vec<Rim>, Misfit> {
    let loops = net.loops().ok_or(Misfit::Loops { segment })?;
    let curve_of = pair_loops(net, &loops, curves).ok_or(Misfit::Loops { segment })?;
    let mut of_part: Vec<Option<Rim>> = vec![None; curves.len()];
    for (ring, &c) in loops.iter().zip(&curve_of) {
        let mut rim = lay(net, ring, &curves[c]);
        if !place_junctions(&mut rim, &curves[c]) {
            return Err(Misfit::TooCoarse { segment });
        }
        of_part[c] = Some(rim);
    }
    Ok(of_part.into_iter().flatten().collect())
}

/// Joins the parts; `rims[s][l]` lies on `layout.curves[s][l]`.
///
/// # Errors
/// [`Misfit::TooCoarse`].
pub fn glue(parts: &[Net], rims: &[Vec<Rim>], layout: &Layout, junction_points: &[Vec3]) -> Result<Glued, Misfit> {
    stop::ask();
    let mut first = vec![0u32];
    for part in parts {
        first.push(first[first.len() - 1] + part.positions.len() as u32);
    }
    let mut merging = Merging::new(parts, &first);
    for (s, of_part) in rims.iter().enumerate() {
        for (l, rim) in of_part.iter().enumerate() {
            for (k, &place) in rim.starts.iter().enumerate() {
                merging.at_junction(layout.curves[s][l].runs[k].junction, first[s] + rim.vertices[place]);
            }
        }
    }
    let mut holes: Vec<Vec<u32>> = Vec::new();
    let mut merged = 0;
    for arc in &layout.arcs {
        let &[x, y] = &arc.sides[..] else { continue };
        let side = |[s, l, r]: [u32; 3]| {
            let curve = &layout.curves[s as usize][l as usize];
            let (vertices, at) = rims[s as usize][l as usize].run(curve, r as usize);
            let edges = vertices.iter().map(|&v| parts[s as usize].at(v).len() as u32 + 1).collect();
            let vertices: Vec<u32> = vertices.into_iter().map(|v| first[s as usize] + v).collect();
            (vertices, ArcRow { at, edges }, curve.runs[r as usize].length)
        };
        let ((a, s, length), (mut b, mut t, other)) = (side(x), side(y));
        b.reverse();
        t.at.reverse();
        t.edges.reverse();
        t.at.iter_mut().for_each(|t| *t = (other - *t) * length / other.max(f64::MIN_POSITIVE));
        let is_closed = layout.curves[x[0] as usize][x[1] as usize].runs[x[2] as usize].junction == NONE;
        let found = if is_closed { match_closed(&s, &t, length) } else { match_open(&s, &t) };
        let coarser = if a.len() < b.len() { x[0] } else { y[0] };
        let (_, pairs) = found.ok_or(Misfit::TooCoarse { segment: coarser as usize })?;
        let pairs = zipped(
            &pairs,
            &ArcSide::new(&parts[x[0] as usize], &a, first[x[0] as usize]),
            &ArcSide::new(&parts[y[0] as usize], &b, first[y[0] as usize]),
        );
        merged += pairs.len() - 1;
        let (n, m) = (a.len(), b.len());
        for &(i, j) in &pairs {
            merging.unite(a[i % n], b[j % m]);
        }
        for w in pairs.windows(2) {
            let ((i, j), (i1, j1)) = (w[0], w[1]);
            // Against the edges of both parts: along the second side, back along the first.
            let mut hole: Vec<u32> = (j..j1).map(|k| b[k % m]).collect();
            hole.extend((i + 1..=i1).rev().map(|k| a[k % n]));
            if hole.len() > 2 {
                holes.push(hole);
            }
        }
    }
    let mut glued = merging.build(parts, &first, junction_points);
    glued.1.merged = merged;
    fill_all(&mut glued.1, &holes, &glued.0);
    Ok(glued.1)
}

/// One side of an arc: its vertices, and the part that they belong to.
struct ArcSide<'a> {
    part: &'a Net,
    vertices: &'a [u32],
    first: u32,
}

impl<'a> ArcSide<'a> {
    fn new(part: &'a Net, vertices: &'a [u32], first: u32) -> Self {
        Self { part, vertices, first }
    }

    fn vertex(&self, k: usize) -> u32 {
        self.vertices[k % self.vertices.len()] - self.first
    }

    /// What it costs to fold two edges of the boundary onto each other over the vertex between them; `None` where that
    /// would not leave two faces to be made one.
    fn fold(&self, k: usize) -> Option<usize> {
        let [a, v, b] = [k - 1, k, k + 1].map(|k| self.vertex(k));
        let common: Vec<u32> =
            self.part.neighbours(a).into_iter().filter(|&w| self.part.neighbours(b).contains(&w)).collect();
        self.part.at(v).len().checked_sub(2).filter(|_| a != b && common == [v])
    }
}

/// Blocks of three or more edges against one, with pairs of edges folded onto each other where that can be done: of two
/// faces beside them one is left, and two vertices are extraordinary instead of four.
fn zipped(pairs: &[(usize, usize)], a: &ArcSide<'_>, b: &ArcSide<'_>) -> Vec<(usize, usize)> {
    let mut all = vec![pairs[0]];
    for w in pairs.windows(2) {
        let ((i, j), (i1, j1)) = (w[0], w[1]);
        let mut fold = |side: &ArcSide<'_>, k: usize, to: usize, pair: &dyn Fn(usize, usize) -> (usize, usize)| {
            let (early, late) = (side.fold(k + 1), side.fold(to - 1));
            match (to - k, early, late) {
                (3, Some(x), y) if y.is_none_or(|y| x <= y) => all.push(pair(k + 2, 0)),
                (3, _, Some(_)) => all.push(pair(k + 1, 1)),
                (4, Some(_), _) => all.push(pair(k + 2, 0)),
                (5, Some(_), Some(_)) => all.extend([pair(k + 2, 0), pair(k + 3, 1)]),
                _ => {}
            }
        };
        if i1 - i > 2 {
            fold(a, i, i1, &|i, on| (i, j + on));
        } else if j1 - j > 2 {
            fold(b, j, j1, &|j, on| (i + on, j));
        }
        all.push((i1, j1));
    }
    all
}

/// Which vertices become one.
struct Merging {
    parent: Vec<u32>,
    junctions: BTreeMap<u32, u32>,
}

impl Merging {
    fn new(parts: &[Net], first: &[u32]) -> Self {
        let count = parts.last().map_or(0, |p| first[first.len() - 2] + p.positions.len() as u32);
        Self { parent: (0..count).collect(), junctions: BTreeMap::new() }
    }

    fn root(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            self.parent[v as usize] = self.parent[self.parent[v as usize] as usize];
            v = self.parent[v as usize];
        }
        v
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    fn at_junction(&mut self, junction: u32, v: u32) {
        match self.junctions.get(&junction).copied() {
            Some(other) => self.unite(v, other),
            None => {
                self.junctions.insert(junction, v);
            }
        }
    }

    /// The net of all parts' faces, and for each old vertex its number there.
    fn build(mut self, parts: &[Net], first: &[u32], junction_points: &[Vec3]) -> (Vec<u32>, Glued) {
        let count = self.parent.len();
        let mut number = vec![NONE; count];
        let mut sums: Vec<(Vec3, f64)> = Vec::new();
        let mut old = parts.iter().flat_map(|p| p.positions.iter());
        for v in 0..count as u32 {
            let root = self.root(v) as usize;
            if number[root] == NONE {
                number[root] = sums.len() as u32;
                sums.push((Vec3::zeros(), 0.0));
            }
            number[v as usize] = number[root];
            let sum = &mut sums[number[root] as usize];
            sum.0 += old.next().copied().unwrap_or_default();
            sum.1 += 1.0;
        }
        let mut positions: Vec<Vec3> = sums.iter().map(|(p, n)| p / *n).collect();
        for (junction, &v) in &self.junctions {
            if let Some(&p) = junction_points.get(*junction as usize) {
                positions[number[v as usize] as usize] = p;
            }
        }
        let seam = (0..positions.len() as u32).filter(|&v| sums[v as usize].1 > 1.0).collect();
        let faces = parts.iter().zip(first).flat_map(|(part, &start)| {
            let number = &number;
            part.faces().map(move |(_, c)| c.iter().map(|&v| number[(start + v) as usize]).collect::<Vec<u32>>())
        });
        let net = Net::new(positions, faces.collect());
        (number, Glued { net, seam, ..Glued::default() })
    }
}

fn fill_all(glued: &mut Glued, holes: &[Vec<u32>], number: &[u32]) {
    for hole in holes {
        let hole: Vec<u32> = hole.iter().map(|&v| number[v as usize]).collect();
        glued.seam.extend(&hole);
        glued.filled += fill(&mut glued.net, hole);
    }
    glued.seam.sort_unstable();
    glued.seam.dedup();
}

/// Fills a hole that is a row of edges against one: the longer row is shortened by quads over three edges each.
fn fill(net: &mut Net, mut hole: Vec<u32>) -> usize {
    let mut faces = 0;
    // The one edge of the shorter side runs between the ends of the row: it is closed last. Either side may be first.
    while hole.len() > 4 {
        let n = hole.len();
        let length = |k: usize| (net.positions[hole[(k + 1) % n] as usize] - net.positions[hole[k] as usize]).norm();
        let lone = (0..n).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
        hole.rotate_left((lone + 1) % n);
        let mut shorter = vec![hole[0]];
        let mut k = 0;
        while k + 1 < n {
            let step = if k + 3 < n && !(shorter.len() == 1 && k + 3 == n - 1) { 3 } else { 1 };
            if step == 3 && !net.joined(hole[k], hole[k + 3]) {
                net.add_face(hole[k..=k + 3].to_vec());
                faces += 1;
                k += 3;
            } else {
                k += 1;
            }
            shorter.push(hole[k]);
        }
        if shorter.len() == n {
            break;
        }
        hole = shorter;
    }
    net.add_face(hole);
    faces + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_against_one_is_filled_by_quads_and_at_most_one_triangle() {
        for p in 2..=27u32 {
            // A fan of points over one edge, as on a curve.
            let positions: Vec<Vec3> = (0..=p)
                .map(|k| {
                    let a = std::f64::consts::PI * f64::from(k) / f64::from(p);
                    Vec3::new(-a.cos(), 0.1 * a.sin(), 0.0)
                })
                .collect();
            let mut net = Net::new(positions, Vec::new());
            let count = fill(&mut net, (0..=p).collect());
            let triangles = net.faces().filter(|(_, c)| c.len() == 3).count();
            assert_eq!(triangles, usize::from(p % 2 == 0), "{p} against one");
            assert!(net.faces().all(|(_, c)| c.len() <= 4));
            assert_eq!(count, net.faces().count());
            let loops = net.loops().expect("one");
            assert_eq!((loops.len(), loops[0].len()), (1, p as usize + 1));
        }
    }
}
