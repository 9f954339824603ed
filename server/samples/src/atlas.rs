//! UVs: each group is laid flat (or unrolled, where it is round) and put into its own cell of a square atlas.

use nalgebra::{Matrix3, SymmetricEigen};
use quadmuse_kernel::mesh::{CornerLayer, FaceLabels, PolyMesh, Vec3};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

/// A group faces one way, and is projected, when its mean normal is longer than this part of a flat one's.
const FLAT: f64 = 0.45;
/// Part of a cell that its chart fills.
const FILL: f64 = 0.94;

/// UVs (0–1) for a mesh with groups; faces without a group share a cell.
pub(super) fn unwrap(mesh: &PolyMesh, groups: &FaceLabels) -> CornerLayer<[f64; 2]> {
    let cells = groups.names.len() + 1;
    let side = (1..).find(|n| n * n >= cells).unwrap_or(1);
    let mut values = Vec::new();
    let mut corners = vec![0u32; mesh.faces.corners().len()];
    for cell in 0..cells {
        let of_cell = |f: &usize| groups.of_face.get(*f).is_some_and(|&g| (g as usize).min(cells - 1) == cell);
        let faces: Vec<usize> = (0..mesh.faces.len()).filter(of_cell).collect();
        let chart = Chart::of(mesh, &faces);
        let first = values.len();
        let mut known: BTreeMap<(u32, i64), u32> = BTreeMap::new();
        for &f in &faces {
            for (k, (v, uv, turns)) in chart.face(mesh, f).into_iter().enumerate() {
                let index = *known.entry((v, turns)).or_insert_with(|| {
                    values.push(uv);
                    (values.len() - 1) as u32
                });
                corners[mesh.faces.start(f) + k] = index;
            }
        }
        fit(&mut values[first..], [(cell % side) as f64, (cell / side) as f64], 1.0 / side as f64);
    }
    CornerLayer { values, corners }
}

enum Chart {
    /// Two directions in the plane.
    Flat(Vec3, Vec3),
    /// A point of the axis, the axis, two directions across it, and the mean radius.
    Round(Vec3, [Vec3; 3], f64),
}

impl Chart {
    fn of(mesh: &PolyMesh, faces: &[usize]) -> Self {
        let (mut sum, mut total, mut spread, mut middle) = (Vec3::zeros(), 1e-30, Matrix3::zeros(), Vec3::zeros());
        for &f in faces {
            let (normal, centre) = face_normal(mesh, f);
            let area = normal.norm();
            sum += normal;
            total += area;
            spread += normal * normal.transpose() / area.max(1e-30);
            middle += centre * area;
        }
        middle /= total;
        if sum.norm() > FLAT * total {
            let (u, v) = across(&sum.normalize());
            return Self::Flat(u, v);
        }
        let eigen = SymmetricEigen::new(spread);
        let axis: Vec3 = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
        let axis = if axis[axis.iamax()] < 0.0 { -axis } else { axis };
        let (u, v) = across(&axis);
        let reach = |&f: &usize| (face_normal(mesh, f).1 - middle).cross(&axis).norm();
        let radius = faces.iter().map(reach).sum::<f64>() / faces.len().max(1) as f64;
        Self::Round(middle, [axis, u, v], radius)
    }

    /// Vertex, UV and number of turns of each corner of a face.
    fn face(&self, mesh: &PolyMesh, f: usize) -> Vec<(u32, [f64; 2], i64)> {
        let place = |v: u32| mesh.positions[v as usize];
        let corners = mesh.faces.face(f).iter().copied();
        match self {
            Self::Flat(u, v) => corners.map(|c| (c, [place(c).dot(u), place(c).dot(v)], 0)).collect(),
            Self::Round(middle, [axis, u, v], radius) => {
                let angle = |p: Vec3| (p - middle).dot(v).atan2((p - middle).dot(u));
                let mine = angle(face_normal(mesh, f).1);
                corners
                    .map(|c| {
                        let own = angle(place(c));
                        // The corner's angle next to the face's: the seam runs between faces, never through one.
                        let turns = ((mine - own + PI) / TAU).floor();
                        (c, [(own + turns * TAU) * radius, (place(c) - middle).dot(axis)], turns as i64)
                    })
                    .collect()
            }
        }
    }
}

fn face_normal(mesh: &PolyMesh, f: usize) -> (Vec3, Vec3) {
    let points: Vec<Vec3> = mesh.faces.face(f).iter().map(|&v| mesh.positions[v as usize]).collect();
    let normal = points.windows(2).map(|w| (w[0] - points[0]).cross(&(w[1] - points[0]))).sum::<Vec3>();
    (normal * 0.5, points.iter().sum::<Vec3>() / points.len().max(1) as f64)
}

/// Two unit vectors across `n`, the second as upright as can be.
fn across(n: &Vec3) -> (Vec3, Vec3) {
    let up = if n.y.abs() < 0.9 { Vec3::y() } else { -Vec3::z() };
    let v = (up - n * n.dot(&up)).normalize();
    (v.cross(n), v)
}

/// Scales and moves a chart into its cell.
fn fit(values: &mut [[f64; 2]], cell: [f64; 2], size: f64) {
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    for value in values.iter() {
        for k in 0..2 {
            (low[k], high[k]) = (low[k].min(value[k]), high[k].max(value[k]));
        }
    }
    let extent = (high[0] - low[0]).max(high[1] - low[1]).max(1e-30);
    for value in values {
        for k in 0..2 {
            let centred = (value[k] - 0.5 * (low[k] + high[k])) / extent;
            value[k] = (cell[k] + 0.5 + FILL * centred) * size;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_kernel::mesh::Polygons;

    #[test]
    fn a_tube_is_unrolled_without_a_face_across_the_seam() {
        let (n, rows) = (12u32, 4u32);
        let positions = (0..n * rows).map(|k| {
            let a = TAU * f64::from(k % n) / f64::from(n);
            Vec3::new(a.sin(), f64::from(k / n), a.cos())
        });
        let mut faces = Polygons::default();
        for k in 0..n * (rows - 1) {
            let (r, c) = (k / n, k % n);
            faces.push(&[r * n + c, r * n + (c + 1) % n, (r + 1) * n + (c + 1) % n, (r + 1) * n + c]);
        }
        let mesh = PolyMesh { positions: positions.collect(), faces, ..PolyMesh::default() };
        let groups = FaceLabels { names: vec!["tube".into()], of_face: vec![0; mesh.faces.len()] };
        let uvs = unwrap(&mesh, &groups);
        assert_eq!(uvs.values.len(), ((n + 1) * rows) as usize, "one column of vertices is doubled at the seam");
        for f in 0..mesh.faces.len() {
            let corner = |k: usize| uvs.values[uvs.corners[4 * f + k] as usize];
            let (a, b, c) = (corner(0), corner(1), corner(3));
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            assert!(area > 0.0 && area < 0.02, "face {f} has uv area {area}");
        }
    }
}
