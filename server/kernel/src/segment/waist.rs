//! The waist of a surface: the cut that is shortest for what it divides, such as that between a figure and its base.
//!
//! No example has a base, and no limb's neck parts a figure from what it stands on with four legs. The slow modes of the
//! surface's Laplacian are nearly constant on both sides of a bottleneck and steep within it, however many loops it has: of
//! their level sets that is taken whose length is least for the smaller side, as length / √area (the isoperimetric ratio).
//! *Source:* Cheeger (1970), a lower bound for the smallest eigenvalue of the Laplacian; Spielman and Teng (1996), sweeps over
//! its eigenvector. *Ours, not the paper's:* what becomes of both sides.

use super::centrality::vertex_areas;
use super::mended::{SMALL_COMPONENTS_SHARE, by_area};
use super::{Order, Segmented, cut_at_zero, merge};
use crate::mesh::tri::{TriMesh, next, prev};
use crate::numerics::sparse::Pattern;
use crate::numerics::stop;
use crate::topology::{self, Patch, Topology, primitive};

/// Modes that are swept. *Untuned.*
const MODES: usize = 3;
/// Rounds of inverse iteration: modes need not be exact to be steep where the surface is narrow.
const ROUNDS: usize = 24;
/// The mass that makes the Laplacian definite, as a share of that which the first mode would have on a sphere.
const SHIFT: f64 = 1e-3;
/// Cotangents are kept within these: a sliver neither parts the surface nor welds it.
const COTANGENT: [f64; 2] = [1e-4, 50.0];
/// Levels of each mode, at equal shares of the area.
const LEVELS: usize = 96;
/// The smaller side has at least this share of the area. *Untuned.*
const SIDE_MIN: f64 = 0.1;
/// A cut of a larger length / √area is no waist: four legs have some 0.5, a neck 1, and a cut through a trunk 2. *Untuned.*
const RATIO_MAX: f64 = 1.1;

/// A surface cut at its waist into two parts, the larger first, in both of which the openings that the cut leaves count as
/// filled if there are several; a single one is the part's end. Small components beside the largest are left out. `None`
/// where it has no waist, or a side of it is no primitive even so.
pub(super) fn waist(surface: &TriMesh) -> Option<Segmented> {
    let sets = by_area(surface);
    let total: f64 = sets.iter().map(|set| set.0).sum();
    let left_out = sets.len().checked_sub(1)?;
    let (_, triangle_of) = sets.into_iter().next().filter(|first| first.0 >= (1.0 - SMALL_COMPONENTS_SHARE) * total)?;
    let (mesh, _) = topology::submesh(surface, &triangle_of);
    let field = shortest_level(&mesh)?;
    let (cut, mut labels) = cut_at_zero(&mesh, &field).ok()?;
    merge::absorb_small_components(&cut.mesh, &mut labels);
    let mut made = Segmented::assemble(&mesh, cut, &labels, Order::Largest);
    if made.parts.len() != 2 {
        return None;
    }
    for part in &mut made.parts {
        (part.topology, part.holes) = meant(&made.mesh, part)?;
    }
    made.parts[0].left_out = left_out;
    made.is_waist = true;
    Some(made)
}

/// What a side is with its openings filled, unless a single one is its only end, and which loops these are.
fn meant(mesh: &TriMesh, part: &Patch) -> Option<(Topology, Vec<Vec<u32>>)> {
    let is_opening = |edges: &[u32]| edges.iter().any(|&h| part.borders_on_another(mesh, h));
    let loops = part.mesh.boundary_loops();
    let openings = loops.iter().filter(|edges| is_opening(edges)).count();
    let (gaps, _) = primitive::gaps(&part.mesh, &is_opening);
    let has_end = loops.len() > openings + gaps.len();
    let is_filled = |edges: &Vec<u32>| gaps.contains(edges) || (is_opening(edges) && (openings > 1 || has_end));
    let (holes, ends): (Vec<_>, Vec<_>) = loops.into_iter().partition(is_filled);
    let topology = primitive::with_ends(&part.mesh, ends.len()).ok()?;
    Some((topology, holes))
}

/// The mode, less a level, whose level set at 0 has the least length / √area of the smaller side; `None` where that is no waist.
fn shortest_level(mesh: &TriMesh) -> Option<Vec<f64>> {
    let best = modes(mesh)?.into_iter().filter_map(|mode| best_level(mesh, mode)).min_by(|a, b| a.0.total_cmp(&b.0))?;
    (best.0 <= RATIO_MAX).then_some(best.1)
}

/// The slow modes of the Laplacian of a connected surface, the constant excepted, about in order: by inverse iteration of a
/// few functions at a time, kept orthogonal.
fn modes(mesh: &TriMesh) -> Option<Vec<Vec<f64>>> {
    let n = mesh.positions.len();
    let mass = vertex_areas(mesh);
    let area: f64 = mass.iter().sum();
    let entries = || (0..mesh.twins.len() as u32).map(|h| (mesh.tail(h), mesh.head(h), -weight(mesh, h)));
    let pattern = Pattern::new(n, entries().map(|(a, b, _)| (a, b))).ok()?;
    let mut diagonal: Vec<f64> = mass.iter().map(|m| (SHIFT / area) * m.max(1e-12 * area / n as f64)).collect();
    for (a, b, w) in entries() {
        diagonal[a as usize] -= w;
        diagonal[b as usize] -= w;
    }
    let factored = pattern.factor(&diagonal, entries(), &vec![false; n]).ok()?;
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).zip(&mass).map(|((x, y), m)| m * x * y).sum::<f64>();
    // Coordinates are about as slow as anything on the surface.
    let mut modes: Vec<Vec<f64>> = (0..MODES).map(|k| mesh.positions.iter().map(|p| p[k % 3]).collect()).collect();
    for _ in 0..ROUNDS {
        stop::poll();
        for k in 0..modes.len() {
            let mut mode: Vec<f64> = modes[k].iter().zip(&mass).map(|(x, m)| m * x).collect();
            factored.solve(&mut mode);
            let mean = mode.iter().zip(&mass).map(|(x, m)| x * m).sum::<f64>() / area;
            mode.iter_mut().for_each(|x| *x -= mean);
            for before in &modes[..k] {
                let along = dot(&mode, before);
                mode.iter_mut().zip(before).for_each(|(x, y)| *x -= along * y);
            }
            let size = dot(&mode, &mode).sqrt();
            if size.is_nan() || size <= 0.0 {
                return None;
            }
            mode.iter_mut().for_each(|x| *x /= size);
            modes[k] = mode;
        }
    }
    Some(modes)
}

/// Half the cotangent of the angle opposite a halfedge.
fn weight(mesh: &TriMesh, h: u32) -> f64 {
    let at = |h: u32| mesh.positions[mesh.tail(h) as usize];
    let (a, b, tip) = (at(h), at(next(h)), at(prev(h)));
    let (to_a, to_b) = (a - tip, b - tip);
    let cotangent = to_a.dot(&to_b) / to_a.cross(&to_b).norm().max(1e-300);
    0.5 * cotangent.clamp(COTANGENT[0], COTANGENT[1])
}

/// The least length / √area of the smaller side over the level sets of a mode, and the mode less that level.
fn best_level(mesh: &TriMesh, mode: Vec<f64>) -> Option<(f64, Vec<f64>)> {
    let mut by_value: Vec<(f64, f64)> = mode.iter().copied().zip(vertex_areas(mesh)).collect();
    by_value.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = by_value.iter().map(|x| x.1).sum();
    let mut levels: Vec<(f64, f64)> = Vec::new();
    let mut below = 0.0;
    for pair in by_value.windows(2) {
        below += pair[0].1;
        let next = SIDE_MIN + (1.0 - 2.0 * SIDE_MIN) * levels.len() as f64 / LEVELS as f64;
        if below >= next * total && below <= (1.0 - SIDE_MIN) * total && pair[0].0 < pair[1].0 {
            levels.push((0.5 * (pair[0].0 + pair[1].0), below.min(total - below)));
        }
    }
    let mut lengths = vec![0.0; levels.len()];
    for corners in &mesh.triangles {
        stop::pass(1);
        let mut sorted = corners.map(|v| (mode[v as usize], mesh.positions[v as usize]));
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let [low, middle, high] = sorted;
        let first = levels.partition_point(|level| level.0 <= low.0);
        for (length, level) in lengths[first..].iter_mut().zip(&levels[first..]) {
            if level.0 >= high.0 {
                break;
            }
            let on = |from: (f64, crate::mesh::Vec3), to: (f64, crate::mesh::Vec3)| {
                let share = (level.0 - from.0) / (to.0 - from.0).max(1e-300);
                from.1 + (to.1 - from.1) * share.clamp(0.0, 1.0)
            };
            let bent = if level.0 < middle.0 { on(low, middle) } else { on(middle, high) };
            *length += (on(low, high) - bent).norm();
        }
    }
    let ratios = lengths.iter().zip(&levels).map(|(length, (level, area))| (length / area.sqrt(), *level));
    let (ratio, level) = ratios.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some((ratio, mode.into_iter().map(|x| x - level).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Vec3;
    use crate::topology::tests::{grid, voxels};

    /// A tube of 40 × 80 squares along z from 0 to 1, closed by its shape at both ends, with a radius at each height.
    fn tube(radius: &dyn Fn(f64) -> f64) -> TriMesh {
        let flat = grid(40, 80, true, false);
        let place = |v: u32| {
            let turn = std::f64::consts::TAU * f64::from(v % 40) / 40.0;
            let z = f64::from(v / 40) / 80.0;
            Vec3::new(radius(z) * turn.cos(), radius(z) * turn.sin(), z)
        };
        let positions = (0..flat.positions.len() as u32).map(place).collect();
        TriMesh::from_triangles(positions, flat.triangles.clone()).expect("a tube")
    }

    #[test]
    fn an_hourglass_is_cut_where_it_is_narrowest() {
        let hourglass = tube(&|z| 0.06 + 0.2 * (std::f64::consts::TAU * (z - 0.1)).sin().abs());
        let cut = waist(&hourglass).expect("a waist");
        assert!(cut.is_waist && cut.parts.len() == 2);
        for part in &cut.parts {
            // Its own end stays one, and the opening at the waist counts as filled.
            assert_eq!((part.topology, part.holes.len()), (Topology::Disc, 1));
        }
        let of_waist = cut.seams.iter().flat_map(|seam| &seam.vertices).map(|&v| cut.mesh.positions[v as usize].z);
        assert!(of_waist.clone().count() > 20 && of_waist.clone().all(|z| (z - 0.6).abs() < 0.03));
    }

    #[test]
    fn a_plain_tube_has_no_waist() {
        assert!(waist(&tube(&|_| 0.3)).is_none());
    }

    #[test]
    fn four_legs_are_cut_at_once_and_both_sides_are_closed() {
        // Two slabs of a grid of voxels, joined by four legs.
        let is_solid = |[x, y, z]: [i32; 3]| {
            let within = (0..12).contains(&x) && (0..20).contains(&y);
            let is_leg = |x: i32, n: i32| (2..4).contains(&x) || (n - 4..n - 2).contains(&x);
            within
                && ((0..5).contains(&z)
                    || (9..14).contains(&z)
                    || ((5..9).contains(&z) && is_leg(x, 12) && is_leg(y, 20)))
        };
        let quads = voxels(&is_solid, [12, 20, 14]);
        let surface = crate::mesh::prepare(&quads).expect("a closed surface").mesh;
        let cut = waist(&surface).expect("a waist");
        let parts: Vec<_> = cut.parts.iter().map(|part| (part.topology, part.holes.len())).collect();
        assert_eq!(parts, [(Topology::Sphere, 4), (Topology::Sphere, 4)]);
        let area: f64 = cut.parts.iter().map(|part| part.mesh.total_area()).sum();
        assert!((area / cut.mesh.total_area() - 1.0).abs() < 1e-9);
    }
}
