//! Shapes with sharp edges, mapped onto their own surface in another mesh.

use super::case::{Case, poly};
use super::loaded::Loaded;
use quadmuse_kernel::mesh::{PolyMesh, Polygons, Vec3};
use quadmuse_kernel::unfold::refine::{split_edges, split_triangles};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

/// A shape made by code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A closed box of 2 × 3 × 4.
    Box,
    /// The same without its lid.
    Open,
    /// A closed cylinder with its two rims.
    Cylinder,
    /// An angle of two plates, one longer than the other.
    Bracket,
}

/// Faces a unit of length of the example, and of the input.
const DENSITY: [usize; 2] = [5, 8];

impl Shape {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Box, Self::Open, Self::Cylinder, Self::Bracket];

    /// The shape, with `n` faces a unit of length.
    fn mesh(self, n: usize) -> PolyMesh {
        match self {
            Self::Box => blocks(n, [2, 3, 4], |_| true, |_| true),
            Self::Open => blocks(n, [2, 3, 4], |_| true, |normal_up| !normal_up),
            Self::Bracket => blocks(n, [4, 2, 3], |[x, _, z]| x < 1 || z < 1, |_| true),
            Self::Cylinder => cylinder(6 * n, 3 * n, n),
        }
    }
}

/// A shape made by code, on itself in an independent mesh.
///
/// # Errors
/// A sentence.
pub fn made(shape: Shape) -> Result<Case, String> {
    let example = Loaded::cut(shape.mesh(DENSITY[0]))?;
    let mut input = shape.mesh(DENSITY[1]);
    input.positions.iter_mut().for_each(|p| *p = posed(*p));
    let truth = example.poly.positions.iter().map(|p| posed(*p)).collect();
    Ok(Case { input: Loaded::cut(input)?, truth, example })
}

/// A file's mesh on its own surface: the edges of its triangles halved, and some of the triangles split once more.
///
/// # Errors
/// A sentence.
pub fn itself(path: &Path) -> Result<Case, String> {
    let example = Loaded::cut(poly(path)?)?;
    let halved = split_edges(&example.patch.mesh, &vec![true; example.patch.mesh.twins.len()]);
    let mut finer = split_triangles(&halved, |t| t % 3 == 0);
    finer.positions.iter_mut().for_each(|p| *p = posed(*p));
    let faces = finer.triangles.iter().map(|t| &t[..]).collect();
    let truth = example.poly.positions.iter().map(|p| posed(*p)).collect();
    let input = Loaded::cut(PolyMesh { positions: finer.positions, faces, ..PolyMesh::default() })?;
    Ok(Case { example, input, truth })
}

/// Another pose and size.
fn posed(p: Vec3) -> Vec3 {
    let (sin, cos) = 0.7f64.sin_cos();
    1.7 * Vec3::new(cos * p.x - sin * p.z, p.y, sin * p.x + cos * p.z) + Vec3::new(3.0, -1.0, 2.0)
}

/// The surface of the unit cubes of a block of `size` for which `is_solid` holds, `n` quads along each unit; faces that
/// look up (true) or elsewhere (false) are kept where `keeps` says so.
fn blocks(n: usize, size: [i64; 3], is_solid: impl Fn([i64; 3]) -> bool, keeps: impl Fn(bool) -> bool) -> PolyMesh {
    let cells = size.map(|s| s * n as i64);
    let solid =
        |c: [i64; 3]| (0..3).all(|k| (0..cells[k]).contains(&c[k])) && is_solid(c.map(|x| x.div_euclid(n as i64)));
    let (mut positions, mut number) = (Vec::new(), BTreeMap::new());
    let mut faces = Polygons::default();
    let cubes = (0..cells[0]).flat_map(|x| (0..cells[1]).flat_map(move |y| (0..cells[2]).map(move |z| [x, y, z])));
    for c in cubes.filter(|c| solid(*c)) {
        for axis in 0..3 {
            for outwards in [false, true] {
                let mut beside = c;
                beside[axis] += if outwards { 1 } else { -1 };
                if solid(beside) || !keeps(axis == 1 && outwards) {
                    continue;
                }
                let mut face = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[a, b]| {
                    let mut at = c;
                    at[axis] += i64::from(outwards);
                    at[(axis + 1) % 3] += a;
                    at[(axis + 2) % 3] += b;
                    *number.entry(at).or_insert_with(|| {
                        positions.push(Vec3::from(at.map(|x| x as f64 / n as f64)));
                        positions.len() as u32 - 1
                    })
                });
                if !outwards {
                    face.reverse();
                }
                faces.push(&face);
            }
        }
    }
    PolyMesh { positions, faces, ..PolyMesh::default() }
}

/// A closed cylinder of radius 1 and height 3: `around` × `along` quads, its ends `across` rings of quads about a fan.
fn cylinder(around: usize, along: usize, across: usize) -> PolyMesh {
    // From the middle of the lower end outwards, up, and inwards again: radius and height.
    let lower = (1..across).map(|k| [k as f64 / across as f64, 0.0]);
    let side = (0..=along).map(|k| [1.0, 3.0 * k as f64 / along as f64]);
    let upper = (1..across).rev().map(|k| [k as f64 / across as f64, 3.0]);
    let profile: Vec<[f64; 2]> = lower.chain(side).chain(upper).collect();
    let mut positions = vec![Vec3::zeros(), Vec3::new(0.0, 3.0, 0.0)];
    for [r, y] in &profile {
        positions.extend((0..around).map(|k| {
            let (sin, cos) = (TAU * k as f64 / around as f64).sin_cos();
            Vec3::new(r * cos, *y, r * sin)
        }));
    }
    let at = |ring: usize, k: usize| (2 + ring * around + k % around) as u32;
    let mut faces = Polygons::default();
    for k in 0..around {
        faces.push(&[0, at(0, k), at(0, k + 1)]);
        for ring in 1..profile.len() {
            faces.push(&[at(ring - 1, k), at(ring, k), at(ring, k + 1), at(ring - 1, k + 1)]);
        }
        faces.push(&[1, at(profile.len() - 1, k + 1), at(profile.len() - 1, k)]);
    }
    PolyMesh { positions, faces, ..PolyMesh::default() }
}
