//! Splitting a region that is no primitive.
//!
//! A handle loses an annulus around its shortest loop; a surface of genus 0 with three or more boundary loops is cut
//! into two discs along a tour of its loops, as clothes are cut along their side seams; whatever withstands, or has very
//! many handles, is halved.
//! Each step makes regions of fewer handles, fewer loops or fewer triangles, so that a repetition ends with primitives.
//! *Source:* Erickson and Whittlesey (2005), shortest homology basis by tree and cotree.

use super::boundary_tour;
use super::distance::spread;
use super::region::Region;
use crate::mesh::geodesic::Marcher;
use crate::mesh::tri::{NONE, TriMesh, next, prev};
use crate::numerics::stop;
use crate::topology::{self, Topology, invariants};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Vertices from which loops around handles are sought, at most and at least; fewer where there are many handles.
const BASES: [usize; 2] = [8, 2];
/// A handle's annulus has no boundary longer than this many times its loop, or twice as far away as the loop is long.
const WIDENING_MAX: f64 = 1.4;
/// A region with more handles is halved first: each handle costs a search of its whole region.
const HANDLES_MAX: i64 = 16;
/// Widths of the annulus that are tried.
const WIDTHS: usize = 16;

/// The primitives that a set of triangles is cut into.
pub(super) fn decompose(surface: &TriMesh, triangles: Vec<u32>) -> Vec<Vec<u32>> {
    let mut todo = vec![triangles];
    let mut done = Vec::new();
    while let Some(triangles) = todo.pop() {
        let region = Region::new(surface, triangles);
        if region.primitive().is_some() {
            done.push(region.triangle_of);
            continue;
        }
        let (_, components) = topology::components(&region.mesh);
        let groups = match components {
            1 => split(&region),
            _ => topology::pieces(&region.mesh)
                .into_iter()
                .map(|g| g.iter().map(|&t| region.triangle_of[t as usize]).collect())
                .collect(),
        };
        todo.extend(groups);
    }
    done.sort();
    done
}

fn split(region: &Region) -> Vec<Vec<u32>> {
    let found = invariants(&region.mesh);
    if found.genus > HANDLES_MAX {
        return halve(region);
    }
    let group_of =
        if found.genus > 0 { around_handle(&region.mesh, found.genus) } else { boundary_tour::halves(&region.mesh) };
    let groups = group_of.map(|g| region.groups(&g)).unwrap_or_default();
    if groups.len() > 1 { groups } else { halve(region) }
}

/// Two halves, each nearer to one of two vertices far from each other.
pub(super) fn halve(region: &Region) -> Vec<Vec<u32>> {
    let mesh = &region.mesh;
    let ends = spread(&Marcher::new(mesh), 2);
    let group_of: Vec<u32> = match &ends[..] {
        [(_, a), (_, b)] => {
            let side = |t: &[u32; 3]| {
                let sum = |d: &[f64]| t.iter().map(|&v| d[v as usize]).sum::<f64>();
                u32::from(sum(a) > sum(b))
            };
            mesh.triangles.iter().map(side).collect()
        }
        _ => vec![0; mesh.triangles.len()],
    };
    let groups = region.groups(&group_of);
    if groups.len() > 1 {
        return groups;
    }
    // Too few triangles to be told apart by their vertices: any triangle against the rest.
    let group_of: Vec<u32> = (0..mesh.triangles.len() as u32).map(|t| t.min(1)).collect();
    region.groups(&group_of)
}

/// Length and vertices of the shortest loop found that does not separate a surface of so many handles.
pub(super) fn shortest_ring(mesh: &TriMesh, genus: i64) -> Option<(f64, Vec<u32>)> {
    ring_by(&Marcher::new(mesh), mesh, genus)
}

fn ring_by(marcher: &Marcher, mesh: &TriMesh, genus: i64) -> Option<(f64, Vec<u32>)> {
    let mut best: Option<(f64, Vec<u32>)> = None;
    let bases_count = (BASES[0] / genus.max(1) as usize).max(BASES[1]);
    let mut bases: Vec<u32> = spread(marcher, bases_count).into_iter().map(|s| s.0).collect();
    let mut from = 0;
    while let Some(&base) = bases.get(from) {
        from += 1;
        let Some(found) = shortest_loop(mesh, base) else { continue };
        if best.as_ref().is_none_or(|b| found.0 < b.0 * (1.0 - 1e-9)) {
            // The loop is shortest through its base only: try again from its far side.
            if bases.len() < 2 * bases_count {
                bases.push(found.1[found.1.len() / 2]);
            }
            best = Some(found);
        }
    }
    best
}

/// Marks the triangles of an annulus around the shortest loop found that does not separate the surface.
fn around_handle(mesh: &TriMesh, genus: i64) -> Option<Vec<u32>> {
    let marcher = Marcher::new(mesh);
    let (length, ring) = ring_by(&marcher, mesh, genus)?;
    let distance = marcher.distances(&ring);
    let far = distance.iter().copied().filter(|d| d.is_finite()).fold(0.0, f64::max).min(2.0 * length);
    let mut widest = None;
    for k in 1..=WIDTHS {
        let reach = far * k as f64 / WIDTHS as f64;
        let inside = |t: &[u32; 3]| u32::from(t.iter().all(|&v| distance[v as usize] <= reach));
        let group_of: Vec<u32> = mesh.triangles.iter().map(inside).collect();
        let ring: Vec<u32> = (0..group_of.len() as u32).filter(|&t| group_of[t as usize] == 1).collect();
        if ring.len() == group_of.len() {
            break;
        }
        let (annulus, _) = topology::submesh(mesh, &ring);
        let girth = |ring: &Vec<u32>| {
            ring.iter()
                .map(|&h| {
                    (annulus.positions[annulus.head(h) as usize] - annulus.positions[annulus.tail(h) as usize]).norm()
                })
                .sum::<f64>()
        };
        if topology::classify(&annulus) == Ok(Topology::Annulus) {
            let widened = annulus.boundary_loops().iter().map(girth).fold(0.0, f64::max) > WIDENING_MAX * length;
            if widest.is_none() || !widened {
                widest = Some(group_of);
            }
            if widened {
                break;
            }
        }
    }
    widest
}

/// Length and vertices of the shortest loop through the tree of shortest paths from `base` that does not separate.
fn shortest_loop(mesh: &TriMesh, base: u32) -> Option<(f64, Vec<u32>)> {
    loops(mesh, base).pop().map(|found| (found.length, found.ring))
}

/// A loop along edges.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Loop {
    pub(super) length: f64,
    /// Its vertices.
    pub(super) ring: Vec<u32>,
    /// The halfedge at which two ways from the root meet.
    pub(super) closes_at: u32,
}

/// The loops through the tree of shortest paths from `base` that together do not separate, one for each way around or through a
/// handle; the shortest way from `base` last.
pub(super) fn loops(mesh: &TriMesh, base: u32) -> Vec<Loop> {
    let (distance, reached_from) = edge_paths(mesh, base);
    // Faces, and beyond them the boundary loops as if each were filled by one face.
    let faces = mesh.triangles.len();
    let mut face_beyond = vec![NONE; mesh.twins.len()];
    for (k, ring) in mesh.boundary_loops().iter().enumerate() {
        ring.iter().for_each(|&h| face_beyond[h as usize] = (faces + k) as u32);
    }
    let mut leader: Vec<u32> = (0..faces as u32 + mesh.boundary_loops().len() as u32).collect();
    let in_tree = |a: u32, b: u32| reached_from[a as usize] == b || reached_from[b as usize] == a;
    let length = |h: u32| {
        let (a, b) = (mesh.tail(h) as usize, mesh.head(h) as usize);
        distance[a] + distance[b] + (mesh.positions[a] - mesh.positions[b]).norm()
    };
    let is_first = |h: &u32| mesh.twin(*h) == NONE || *h < mesh.twin(*h);
    let mut edges: Vec<(f64, u32)> = (0..mesh.twins.len() as u32)
        .filter(is_first)
        .filter(|&h| !in_tree(mesh.tail(h), mesh.head(h)))
        .map(|h| (length(h), h))
        .collect();
    edges.sort_by(|x, y| y.0.total_cmp(&x.0).then(x.1.cmp(&y.1)));
    let mut closing = Vec::new();
    for (_, h) in edges {
        stop::pass(1);
        let beyond = if mesh.twin(h) == NONE { face_beyond[h as usize] } else { mesh.twin(h) / 3 };
        let (a, b) = (find(&mut leader, h / 3), find(&mut leader, beyond));
        match a == b {
            true => closing.push(h),
            false => leader[a as usize] = b,
        }
    }
    let chain = |mut v: u32| {
        let mut chain = vec![v];
        while reached_from[v as usize] != NONE {
            v = reached_from[v as usize];
            chain.push(v);
        }
        chain.reverse();
        chain
    };
    let ring = |h: u32| {
        let (one, two) = (chain(mesh.tail(h)), chain(mesh.head(h)));
        let shared = one.iter().zip(&two).take_while(|(a, b)| a == b).count();
        let mut ring: Vec<u32> = one.get(shared.saturating_sub(1)..)?.to_vec();
        ring.extend(two.get(shared..)?.iter().rev());
        let at = |k: usize| mesh.positions[ring[k % ring.len()] as usize];
        let length = (0..ring.len()).map(|k| (at(k + 1) - at(k)).norm()).sum();
        (ring.len() >= 3).then_some(Loop { length, ring, closes_at: h })
    };
    closing.into_iter().filter_map(ring).collect()
}

fn find(leader: &mut [u32], mut x: u32) -> u32 {
    while leader[x as usize] != x {
        leader[x as usize] = leader[leader[x as usize] as usize];
        x = leader[x as usize];
    }
    x
}

/// Distances along edges from a vertex, and the vertex that each was reached from.
fn edge_paths(mesh: &TriMesh, base: u32) -> (Vec<f64>, Vec<u32>) {
    let outgoing = mesh.outgoing();
    let mut distance = vec![f64::INFINITY; mesh.positions.len()];
    let mut from = vec![NONE; mesh.positions.len()];
    distance[base as usize] = 0.0;
    let mut heap = BinaryHeap::from([Reverse((0u64, base))]);
    while let Some(Reverse((key, v))) = heap.pop() {
        stop::pass(1);
        let d = f64::from_bits(key);
        if d > distance[v as usize] {
            continue;
        }
        let mut h = outgoing[v as usize];
        let start = h;
        while h != NONE {
            let mut reach = |w: u32| {
                let step = d + (mesh.positions[w as usize] - mesh.positions[v as usize]).norm();
                if step < distance[w as usize] {
                    (distance[w as usize], from[w as usize]) = (step, v);
                    heap.push(Reverse((step.to_bits(), w)));
                }
            };
            reach(mesh.head(h));
            reach(mesh.head(next(h)));
            h = mesh.twin(prev(h));
            if h == start {
                break;
            }
        }
    }
    (distance, from)
}
