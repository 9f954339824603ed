//! Moves the vertices of a net so that its faces, and not its vertices alone, lie on the input.
//!
//! Between vertices on a curved surface the faces lie inside of it, by 2/3 of the sagitta on average. With x_k points of
//! the faces, w_kv their weights of the corners, a_k the area that each stands for, r_k = π(x_k) − x_k, and likewise the
//! input's sample points with r_k from the nearest point of the net, the moves d_v = t_v·n_v along the vertices' normals
//! that make Σ_k a_k |r_k − Σ_v w_kv d_v|² small are sought by simultaneous steps, π taken anew in each round:
//!
//! t_v = s · Σ_k a_k w_kv (n_v·r_k) / Σ_k a_k w_kv.
//!
//! The vertices then lie a little outside where the surface bulges, and the surface cuts through the faces: a layout of
//! half the quads follows the input as closely. *Ours, not the paper's.*

use super::net::Net;
use super::smooth::Target;
use crate::mesh::Vec3;
use crate::mesh::bvh::Bvh;
use crate::numerics::side_by_side;

/// Rounds.
const ROUNDS: u32 = 8;
/// Step s: the sums are convex, so that up to 2 is stable.
const STEP: f64 = 1.5;
/// Points of a quad along each side, at ±1/√3 of its half.
const GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
/// A point farther from the other surface than this share of its face's size has no say: it looks at another sheet.
const BELIEVED: f64 = 0.6;

/// Which vertices stay where they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held<'a> {
    /// None.
    Nothing,
    /// Those on the net's boundary.
    Boundary,
    /// Those on the net's boundary, and those told, by their numbers.
    BoundaryAnd(&'a [bool]),
}

/// What the points ask of a vertex.
#[derive(Clone, Copy, Default)]
struct Asked {
    sum: Vec3,
    weight: f64,
}

/// Moves a net's vertices along their normals; `points` are spread evenly by area over the surface.
pub fn fit_surface(net: &mut Net, points: &[Vec3], target: &Target, held: Held<'_>) {
    let is_held = |v: u32| match held {
        Held::Nothing => false,
        Held::Boundary => net.on_boundary(v),
        Held::BoundaryAnd(told) => told.get(v as usize) == Some(&true) || net.on_boundary(v),
    };
    let moving: Vec<bool> = (0..net.positions.len() as u32).map(|v| !net.at(v).is_empty() && !is_held(v)).collect();
    for _ in 0..ROUNDS {
        let (by_faces, by_points) = side_by_side(|| by_faces(net, target), || by_points(net, points));
        let normals = normals(net);
        for v in (0..net.positions.len()).filter(|&v| moving[v]) {
            let (n, weight) = (normals[v], by_faces[v].weight + by_points[v].weight);
            if weight > 0.0 {
                net.positions[v] += n * (STEP * n.dot(&(by_faces[v].sum + by_points[v].sum)) / weight);
            }
        }
    }
}

fn ask(asked: &mut [Asked], v: u32, r: Vec3, weight: f64) {
    asked[v as usize].sum += r * weight;
    asked[v as usize].weight += weight;
}

/// Points of the faces look for the surface; returns what they ask of each vertex.
fn by_faces(net: &Net, target: &Target) -> Vec<Asked> {
    let mut asked = vec![Asked::default(); net.positions.len()];
    let of_quads: Vec<Vec<f64>> = GAUSS.iter().flat_map(|&s| GAUSS.map(|t| bilinear(s, t))).collect();
    let samples = |c: &[u32]| match c.len() {
        4 => of_quads.clone(),
        n => vec![vec![1.0 / n as f64; n]],
    };
    let point = |c: &[u32], weights: &[f64]| c.iter().zip(weights).map(|(&v, w)| net.positions[v as usize] * *w).sum();
    let points = net.faces().flat_map(|(_, c)| samples(c).into_iter().map(move |weights| point(c, &weights)));
    let points: Vec<Vec3> = points.collect();
    let mut met = points.iter().zip(target.all_onto_surface(&points));
    for (_, c) in net.faces() {
        let area = area_vector(net, c).norm();
        let samples = samples(c);
        let share = area / samples.len() as f64;
        for (weights, (x, on)) in samples.iter().zip(met.by_ref()) {
            let r = on - x;
            if r.norm_squared() > BELIEVED * BELIEVED * area {
                continue;
            }
            c.iter().zip(weights).for_each(|(&v, w)| ask(&mut asked, v, r, share * w));
        }
    }
    asked
}

fn bilinear(s: f64, t: f64) -> Vec<f64> {
    vec![(1.0 - s) * (1.0 - t), s * (1.0 - t), s * t, (1.0 - s) * t]
}

/// Points of the surface look for the net; returns what they ask of each vertex.
fn by_points(net: &Net, points: &[Vec3]) -> Vec<Asked> {
    let mut asked = vec![Asked::default(); net.positions.len()];
    let fans = net.fans();
    let areas: Vec<f64> = fans.face.iter().map(|&f| area_vector(net, net.face(f)).norm()).collect();
    let share = fans.mesh.total_area() / points.len().max(1) as f64;
    let bvh = Bvh::new(&fans.mesh);
    for (x, near) in points.iter().zip(bvh.closest_to_all(points)) {
        let Some(&area) = areas.get(near.triangle as usize) else { continue };
        if near.distance * near.distance > BELIEVED * BELIEVED * area {
            continue;
        }
        let corners = fans.mesh.triangles[near.triangle as usize];
        corners.iter().zip(near.barycentric).for_each(|(&v, w)| ask(&mut asked, v, x - near.point, share * w));
    }
    asked
}

/// Normal of a polygon, as long as its area.
fn area_vector(net: &Net, c: &[u32]) -> Vec3 {
    let p = |v: u32| net.positions[v as usize];
    let Some(&first) = c.first() else { return Vec3::zeros() };
    (2..c.len()).map(|k| (p(c[k - 1]) - p(first)).cross(&(p(c[k]) - p(first)))).sum::<Vec3>() * 0.5
}

/// Unit normals of the vertices; zero where there is none.
fn normals(net: &Net) -> Vec<Vec3> {
    let mut sums = vec![Vec3::zeros(); net.positions.len()];
    for (_, c) in net.faces() {
        let normal = area_vector(net, c);
        c.iter().for_each(|&v| sums[v as usize] += normal);
    }
    sums.into_iter().map(|n| n.try_normalize(0.0).unwrap_or_default()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::fit::Measured;
    use crate::compose::net::tests::sheet;
    use crate::mesh::tri::TriMesh;
    use crate::topology::tests::grid;

    /// A piece of a sphere over a square, and a coarse net with its vertices on it.
    fn dome() -> (TriMesh, Net) {
        let height = |p: &Vec3| (1.0 - (p.x - 0.5).powi(2) - (p.y - 0.5).powi(2)).sqrt();
        let mut surface = grid(60, 60, false, false);
        surface.positions.iter_mut().for_each(|p| p.z = height(p));
        let mut net = sheet(6, 6);
        net.positions.iter_mut().for_each(|p| *p /= 6.0);
        net.positions.iter_mut().for_each(|p| p.z = height(p));
        (surface, net)
    }

    #[test]
    fn faces_of_a_dome_come_to_lie_on_both_sides_of_it() {
        let (surface, net) = dome();
        let (measured, target) = (Measured::new(&surface), Target::new(&surface));
        let before = measured.fit(&net.clone().into_mesh().0).worst();
        for (held, left) in [(Held::Nothing, 0.45), (Held::Boundary, 0.8)] {
            let mut moved = net.clone();
            fit_surface(&mut moved, measured.points(), &target, held);
            let after = measured.fit(&moved.clone().into_mesh().0).worst();
            assert!(after < left * before, "{held:?}: {before} to {after}");
            let stays = (0..49u32).filter(|&v| moved.positions[v as usize] == net.positions[v as usize]).count();
            assert_eq!(stays, if held == Held::Boundary { 24 } else { 0 });
        }
    }
}
