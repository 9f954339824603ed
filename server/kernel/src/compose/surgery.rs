//! Two triangles become quads: the mesh is cut along a path of edges between them, and a strip of quads put in.
//!
//! *Source:* paper §6, Fig. 11. *Ours, not the paper's:* the shortest path is the one that costs least, where an edge
//! costs the quad that it adds and a turn the extraordinary vertices that it makes (a straight path through regular
//! vertices makes none); a true boundary may take the place of one of the triangles, and gets one edge more.

use super::net::{Net, Step};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

/// Cost of an edge of a path: one more quad.
const EDGE_COST: u32 = 4;
/// Cost of one unit by which valences move away from four.
const VALENCE_COST: u32 = 3;
/// Cost of ending at a boundary rather than at another triangle.
const BOUNDARY_COST: u32 = 12;

/// Where a path ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Goal {
    Triangle(u32),
    Boundary,
}

/// A path from a triangle to another, or to a boundary.
#[derive(Clone, Debug)]
pub struct SurgeryPath {
    vertices: Vec<u32>,
    from: u32,
    to: Goal,
    /// What it costs.
    pub cost: u32,
}

impl SurgeryPath {
    /// The triangle at which it ends, if it does not end at a boundary.
    pub fn partner(&self) -> Option<u32> {
        match self.to {
            Goal::Triangle(f) => Some(f),
            Goal::Boundary => None,
        }
    }
}

/// The steps strictly between two others, counter-clockwise.
fn between(fan: &[Step], from: Step, to: Step) -> Vec<Step> {
    let Some(k) = fan.iter().position(|s| *s == from) else { return Vec::new() };
    (1..fan.len()).map(|j| fan[(k + j) % fan.len()]).take_while(|s| *s != to).collect()
}

fn edges(steps: &[Step]) -> i64 {
    steps.iter().filter(|s| matches!(s, Step::Edge(_))).count() as i64
}

/// By how much valences move away from four when a vertex is split between two steps. `ends` counts the edges that
/// both copies get beside those on their own side: across, and along the path.
fn split_cost(fan: &[Step], from: Step, to: Step, ends: i64) -> u32 {
    if fan.contains(&Step::Gap) {
        return VALENCE_COST;
    }
    let off = |n: i64| (n - 4).abs();
    let before = off(edges(fan));
    let after = off(edges(&between(fan, from, to)) + ends) + off(edges(&between(fan, to, from)) + ends);
    VALENCE_COST * (after - before).max(0) as u32
}

/// A vertex on the way, with the vertex the path came from (itself at the start).
type State = (u32, u32);

/// The cheapest cut from a triangle to any other, or to a boundary. `None` if there is neither.
pub fn cheapest(net: &Net, triangle: u32) -> Option<SurgeryPath> {
    let mut best: HashMap<State, (u32, State)> = HashMap::new();
    let mut heap = BinaryHeap::new();
    for &v in net.face(triangle) {
        best.insert((v, v), (0, (v, v)));
        heap.push(Reverse((0u32, v, v, 0u32)));
    }
    // The last number of an entry tells a vertex on the way (0) from an end: 1 the boundary, 2 + f triangle f.
    while let Some(Reverse((cost, v, came, kind))) = heap.pop() {
        let state = (v, came);
        if kind > 0 {
            let to = if kind == 1 { Goal::Boundary } else { Goal::Triangle(kind - 2) };
            return Some(SurgeryPath { vertices: trace(&best, state), from: triangle, to, cost });
        }
        if best.get(&state).is_none_or(|b| b.0 < cost) {
            continue;
        }
        let Some(fan) = net.fan(v) else { continue };
        let start = if came == v { Step::Face(triangle) } else { Step::Edge(came) };
        let is_border = fan.contains(&Step::Gap);
        if is_border {
            heap.push(Reverse((cost + BOUNDARY_COST, v, came, 1)));
        }
        for step in &fan {
            match *step {
                Step::Face(f) if f != triangle && net.face(f).len() == 3 => {
                    let ends = if came == v { 1 } else { 2 };
                    heap.push(Reverse((cost + split_cost(&fan, start, *step, ends), v, came, 2 + f)));
                }
                Step::Edge(w) if w != came && !is_border && !net.face(triangle).contains(&w) => {
                    let further = cost + EDGE_COST + split_cost(&fan, start, *step, if came == v { 2 } else { 3 });
                    if best.get(&(w, v)).is_none_or(|b| b.0 > further) {
                        best.insert((w, v), (further, state));
                        heap.push(Reverse((further, w, v, 0)));
                    }
                }
                _ => {}
            }
        }
    }
    None
}

fn trace(best: &HashMap<State, (u32, State)>, mut state: State) -> Vec<u32> {
    let mut vertices = vec![state.0];
    while state.0 != state.1 {
        let Some(&(_, before)) = best.get(&state) else { break };
        state = before;
        vertices.push(state.0);
    }
    vertices.reverse();
    vertices
}

/// Cuts and fills. Gives the vertices that were split, old and new; `None`, the net untouched, if the cut doesn't fit.
pub fn apply(net: &mut Net, cut: &SurgeryPath) -> Option<Vec<u32>> {
    let path = &cut.vertices;
    let mut distinct = path.clone();
    distinct.sort_unstable();
    distinct.dedup();
    if distinct.len() != path.len() {
        return None;
    }
    let last = path.len() - 1;
    let mut right = Vec::with_capacity(path.len());
    for (i, &v) in path.iter().enumerate() {
        let fan = net.fan(v)?;
        let back = if i == 0 { Step::Face(cut.from) } else { Step::Edge(path[i - 1]) };
        let ahead = match (i == last, cut.to) {
            (false, _) => Step::Edge(path[i + 1]),
            (true, Goal::Triangle(f)) => Step::Face(f),
            (true, Goal::Boundary) => Step::Gap,
        };
        if !fan.contains(&back) || !fan.contains(&ahead) {
            return None;
        }
        right.push(between(&fan, back, ahead));
    }
    let copies: Vec<u32> = path.iter().map(|&v| net.add_vertex(net.positions[v as usize])).collect();
    for (i, steps) in right.iter().enumerate() {
        for step in steps {
            if let Step::Face(f) = *step {
                let corners = net.face(f).iter().map(|&c| if c == path[i] { copies[i] } else { c }).collect();
                net.set_face(f, corners);
            }
        }
    }
    // The triangle at the start has its earlier corner on the right of the path, that at the end its later one.
    insert(net, cut.from, path[0], [copies[0], path[0]]);
    if let Goal::Triangle(f) = cut.to {
        insert(net, f, path[last], [path[last], copies[last]]);
    }
    for i in 0..last {
        net.add_face(vec![copies[i], copies[i + 1], path[i + 1], path[i]]);
    }
    Some(path.iter().chain(&copies).copied().collect())
}

fn insert(net: &mut Net, f: u32, at: u32, two: [u32; 2]) {
    let corners = net.face(f).iter().flat_map(|&c| if c == at { two.to_vec() } else { vec![c] }).collect();
    net.set_face(f, corners);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;

    /// A sheet whose strip of cells between columns `from` and `to` of row 2 is squeezed together: two triangles stay.
    fn squeezed(from: u32, to: u32) -> Net {
        let mut net = sheet(9, 5);
        let (low, high) = (20, 30);
        for f in 18 + from + 1..18 + to {
            net.remove_face(f);
        }
        for v in from + 1..=to {
            for f in net.at(high + v).to_vec() {
                let mut corners: Vec<u32> =
                    net.face(f).iter().map(|&c| if c == high + v { low + v } else { c }).collect();
                corners.dedup();
                if corners.first() == corners.last() {
                    corners.pop();
                }
                net.set_face(f, corners);
            }
        }
        net
    }

    fn is_sound(net: &Net) -> bool {
        (0..net.positions.len() as u32).all(|v| net.fan(v).is_some()) && net.loops().is_some_and(|l| l.len() == 1)
    }

    fn triangles(net: &Net) -> Vec<u32> {
        net.faces().filter(|(_, c)| c.len() == 3).map(|(f, _)| f).collect()
    }

    #[test]
    fn a_squeezed_strip_is_put_back_without_extraordinary_vertices() {
        for (from, to) in [(3, 4), (3, 5), (2, 6)] {
            let mut net = squeezed(from, to);
            let two = triangles(&net);
            assert_eq!((two.len(), is_sound(&net)), (2, true));
            let cut = cheapest(&net, two[0]).expect("the other one");
            assert_eq!(cut.partner(), Some(two[1]));
            assert_eq!(cut.cost, EDGE_COST * (to - from - 1));
            assert!(apply(&mut net, &cut).is_some());
            assert_eq!((net.faces().count(), triangles(&net).len(), is_sound(&net)), (45, 0, true));
            let irregular = (0..net.positions.len() as u32)
                .filter(|&v| !net.at(v).is_empty() && !net.on_boundary(v) && net.neighbours(v).len() != 4);
            assert_eq!(irregular.count(), 0);
        }
    }

    #[test]
    fn a_lone_triangle_gets_its_edge_back_from_the_boundary() {
        let mut net = sheet(4, 4);
        net.set_face(1, vec![1, 7, 6]);
        net.set_face(2, vec![1, 3, 8, 7]);
        assert_eq!(net.loops().expect("one loop")[0].len(), 15);
        let cut = cheapest(&net, 1).expect("the boundary");
        assert_eq!(cut.partner(), None);
        assert!(apply(&mut net, &cut).is_some());
        assert!(is_sound(&net) && triangles(&net).is_empty());
        assert_eq!(net.loops().expect("one loop")[0].len(), 16);
    }
}
