//! Density: every polygon cut at its middle, which leaves quads only; and the same undone where a layout allows.
//!
//! A layout can be coarsened if its vertices fall into corners, edge middles and face middles of a coarser one: in each
//! quad, in turn, a corner, an edge middle, a face middle, an edge middle. *Ours, not the paper's.*

use super::net::Net;
use crate::mesh::Vec3;
use std::collections::BTreeMap;

/// Cuts each n-gon into n quads at its middle and the middles of its edges. Old vertices keep their numbers.
pub fn subdivide(net: &Net) -> Net {
    let mut positions = net.positions.clone();
    let mut middle_of: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let mut faces = Vec::new();
    for (_, c) in net.faces() {
        let n = c.len();
        let centre = c.iter().map(|&v| net.positions[v as usize]).sum::<Vec3>() / n as f64;
        let middles: Vec<u32> = (0..n)
            .map(|k| {
                let (a, b) = (c[k], c[(k + 1) % n]);
                *middle_of.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    positions.push((net.positions[a as usize] + net.positions[b as usize]) * 0.5);
                    positions.len() as u32 - 1
                })
            })
            .collect();
        positions.push(centre);
        let m = positions.len() as u32 - 1;
        faces.extend((0..n).map(|k| vec![c[k], middles[k], m, middles[(k + n - 1) % n]]));
    }
    Net::new(positions, faces)
}

/// What a vertex is of the coarser layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Corner,
    Edge,
    Face,
}

/// The coarser layout of which this net is the subdivision; `None` if it is none.
pub fn coarsen(net: &Net) -> Option<Net> {
    if net.faces().any(|(_, c)| c.len() != 4) {
        return None;
    }
    let mut role: Vec<Option<Role>> = vec![None; net.positions.len()];
    for start in 0..net.face_slots() as u32 {
        let &[a, b, ..] = net.face(start) else { continue };
        if role[a as usize].is_some() {
            continue;
        }
        // One of the four ways to begin, in a fixed order; an extraordinary vertex would only fit a corner.
        let ways = [(a, Role::Corner), (a, Role::Edge), (a, Role::Face), (b, Role::Corner)];
        let mut tries = ways.into_iter().filter_map(|(v, r)| spread(net, start, v, r, &role));
        role = tries.next()?;
    }
    let is = |v: u32, r: Role| role[v as usize] == Some(r);
    let mut faces = Vec::new();
    for m in (0..net.positions.len() as u32).filter(|&v| is(v, Role::Face)) {
        let fan = net.fan(m)?;
        let mut corners = Vec::new();
        for step in fan {
            match step {
                super::net::Step::Face(f) => {
                    corners.push(*net.face(f).iter().find(|&&v| is(v, Role::Corner))?);
                }
                super::net::Step::Gap => return None,
                super::net::Step::Edge(_) => {}
            }
        }
        let mut distinct = corners.clone();
        distinct.sort_unstable();
        distinct.dedup();
        if corners.len() < 3 || distinct.len() != corners.len() {
            return None;
        }
        faces.push(corners);
    }
    Some(Net::new(net.positions.clone(), faces))
}

/// Gives every vertex of a component its role, begun at one; `None` on a contradiction.
fn spread(net: &Net, face: u32, v: u32, r: Role, known: &[Option<Role>]) -> Option<Vec<Option<Role>>> {
    let mut role = known.to_vec();
    let mut seen = vec![false; net.face_slots()];
    // Within the first face one role leaves the other three open only where it is an edge's: a corner is put before it.
    let c = net.face(face);
    let k = c.iter().position(|&x| x == v)?;
    let turn = match r {
        Role::Corner => 0,
        Role::Edge => 1,
        Role::Face => 2,
    };
    let corner = c[(k + 4 - turn) % 4];
    role[corner as usize] = Some(Role::Corner);
    let mut todo = vec![(face, corner)];
    while let Some((f, corner)) = todo.pop() {
        if std::mem::replace(&mut seen[f as usize], true) {
            continue;
        }
        let c = net.face(f);
        let k = c.iter().position(|&x| x == corner)?;
        for (d, r) in [Role::Corner, Role::Edge, Role::Face, Role::Edge].into_iter().enumerate() {
            let slot = &mut role[c[(k + d) % 4] as usize];
            if slot.is_some_and(|old| old != r) {
                return None;
            }
            *slot = Some(r);
        }
        for d in 0..4 {
            let (a, b) = (c[d], c[(d + 1) % 4]);
            let Some(g) = net.face_along(b, a).filter(|&g| !seen[g as usize]) else { continue };
            // The corner of the neighbour: on the common edge, or across from the face middle on it.
            let on_edge = [a, b].into_iter().find(|&x| role[x as usize] == Some(Role::Corner));
            let at = match on_edge {
                Some(x) => x,
                None => {
                    let m = [a, b].into_iter().find(|&x| role[x as usize] == Some(Role::Face))?;
                    let h = net.face(g);
                    let i = h.iter().position(|&x| x == m)?;
                    *h.get((i + 2) % h.len())?
                }
            };
            todo.push((g, at));
        }
    }
    Some(role)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::net::tests::sheet;

    #[test]
    fn coarsening_undoes_subdividing() {
        for net in [sheet(4, 3), sheet(1, 1), sheet(5, 5)] {
            let fine = subdivide(&net);
            assert_eq!(fine.faces().count(), 4 * net.faces().count());
            let back = coarsen(&fine).expect("just subdivided");
            let sorted = |net: &Net| {
                let mut all: Vec<Vec<u32>> = net
                    .faces()
                    .map(|(_, c)| {
                        let mut c = c.to_vec();
                        c.sort_unstable();
                        c
                    })
                    .collect();
                all.sort();
                all
            };
            assert_eq!(sorted(&back), sorted(&net));
        }
    }

    #[test]
    fn odd_rows_cannot_be_coarsened() {
        assert!(coarsen(&sheet(4, 3)).is_none());
        assert!(coarsen(&sheet(4, 6)).is_some());
    }

    #[test]
    fn every_polygon_becomes_quads() {
        let mut net = sheet(2, 1);
        net.set_face(1, vec![1, 2, 5]);
        net.add_face(vec![1, 5, 4]);
        assert!(subdivide(&net).faces().all(|(_, c)| c.len() == 4));
    }
}
