//! Shapes made by code: discs that look a little like heads, vases, pebbles, as OBJ.

use std::f64::consts::{PI, TAU};
use std::fmt::Write;

/// What the faces are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Faces {
    /// Four corners each.
    Quads,
    /// Three corners each.
    Triangles,
}

/// Height of a bump, where on the sphere, and how wide (radians).
type Bump = (f64, [f64; 3], f64);

/// The bumps of a head: nose, ears, chin, a bun that is on one side only; `kind` varies them.
fn bumps(kind: u32) -> [Bump; 6] {
    let vary = |n: u32| f64::from((kind * 7 + n * 13) % 11) / 11.0;
    [
        (0.35 + 0.2 * vary(1), [0.0, -1.0, 0.1], 0.22),
        (0.20 + 0.1 * vary(2), [1.0, 0.1, 0.1], 0.25),
        (0.20 + 0.1 * vary(2), [-1.0, 0.1, 0.1], 0.25),
        (0.15 + 0.2 * vary(3), [0.0, -0.8, -0.6], 0.3),
        (0.10 + 0.3 * vary(4), [0.5, 0.8, 0.4], 0.35),
        (-0.12, [0.0, -1.0, -0.2], 0.12),
    ]
}

/// The surface in the direction of a unit vector.
fn surface(direction: [f64; 3], kind: u32) -> [f64; 3] {
    let mut radius = 1.0;
    for (height, at, width) in bumps(kind) {
        let length = at.iter().map(|x| x * x).sum::<f64>().sqrt();
        let cosine = (0..3).map(|i| direction[i] * at[i]).sum::<f64>() / length;
        let angle = cosine.clamp(-1.0, 1.0).acos();
        radius += height * (-(angle / width).powi(2)).exp();
    }
    [direction[0] * radius * 0.8, direction[1] * radius, direction[2] * radius * 1.1]
}

/// A head cut off at the neck: a disc of `n` by `n` cells.
pub fn head(kind: u32, n: u32, faces: Faces) -> String {
    grid(n, n, faces, |s, t| {
        // The square onto the disc, the disc onto the sphere but for a cap below.
        let (x, y) = (2.0 * s - 1.0, 2.0 * t - 1.0);
        let (x, y) = (x * (1.0 - y * y / 2.0).sqrt(), y * (1.0 - x * x / 2.0).sqrt());
        let angle = x.hypot(y) * 0.8 * PI;
        let around = y.atan2(x);
        surface([angle.sin() * around.cos(), angle.sin() * around.sin(), angle.cos()], kind)
    })
}

fn grid(columns: u32, rows: u32, faces: Faces, at: impl Fn(f64, f64) -> [f64; 3]) -> String {
    let mut text = String::new();
    for row in 0..=rows {
        for column in 0..=columns {
            let [x, y, z] = at(f64::from(column) / f64::from(columns), f64::from(row) / f64::from(rows));
            let _ = writeln!(text, "v {x:.6} {y:.6} {z:.6}");
        }
    }
    let vertex = |column: u32, row: u32| row * (columns + 1) + column + 1;
    for row in 0..rows {
        for column in 0..columns {
            let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(c, r)| vertex(column + c, row + r));
            face(&mut text, corners, faces);
        }
    }
    text
}

fn face(text: &mut String, [a, b, c, d]: [u32; 4], faces: Faces) {
    let _ = match faces {
        Faces::Quads => writeln!(text, "f {a} {b} {c} {d}"),
        Faces::Triangles => writeln!(text, "f {a} {b} {c}\nf {a} {c} {d}"),
    };
}

/// A vase without a floor: an annulus of `around` by `up` cells.
pub fn vase(kind: u32, around: u32, up: u32, faces: Faces) -> String {
    let mut text = String::new();
    for row in 0..=up {
        let z = f64::from(row) / f64::from(up);
        for column in 0..around {
            let angle = TAU * f64::from(column) / f64::from(around);
            let belly = 0.5 + 0.2 * (PI * z * (1.0 + f64::from(kind % 3))).sin();
            let handle = 0.3 * (-((angle - 1.0) / 0.4).powi(2) - ((z - 0.4) / 0.2).powi(2)).exp();
            let radius = belly + handle;
            let _ = writeln!(text, "v {:.6} {:.6} {:.6}", radius * angle.cos(), radius * angle.sin(), 2.0 * z);
        }
    }
    for row in 0..up {
        for column in 0..around {
            let next = (column + 1) % around;
            let corners =
                [row * around + column, row * around + next, (row + 1) * around + next, (row + 1) * around + column];
            face(&mut text, corners.map(|corner| corner + 1), faces);
        }
    }
    text
}

/// A ring of uneven girth with lumps, a torus: `around` cells along the ring by `girth` cells around its tube. The cells
/// of rings with other numbers of them start elsewhere.
pub fn ring(kind: u32, around: u32, girth: u32, faces: Faces) -> String {
    let mut text = String::new();
    for row in 0..girth {
        for column in 0..around {
            let start = f64::from(around) / 7.0;
            let a = TAU * f64::from(column) / f64::from(around) + start;
            let b = TAU * f64::from(row) / f64::from(girth) + 0.4 * start;
            let lump = |at: f64, up: f64| (-(1.0 - (a - at).cos()) / 0.08 - (1.0 - (b - up).cos()) / 0.2).exp();
            let lumps = 0.5 * lump(0.0, 0.0) + 0.7 * lump(0.7, 1.5) + 0.9 * lump(1.4, 3.0) + 0.5 * lump(2.4, 4.4);
            let tube = 0.6 + 0.15 * a.sin() + 0.1 * (f64::from(1 + kind % 3) * a).cos() + lumps;
            let radius = 2.2 + tube * b.cos();
            let z = tube * b.sin() + 0.3 * (2.0 * a).sin();
            let _ = writeln!(text, "v {:.6} {:.6} {z:.6}", radius * a.cos(), radius * a.sin());
        }
    }
    for row in 0..girth {
        for column in 0..around {
            let (right, up) = ((column + 1) % around, (row + 1) % girth);
            let corners = [row * around + column, row * around + right, up * around + right, up * around + column];
            face(&mut text, corners.map(|corner| corner + 1), faces);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// Loops of border edges and Euler characteristic.
    fn topology(obj: &str) -> (usize, i64) {
        let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
        let (mut vertices, mut faces) = (0_i64, 0_i64);
        for line in obj.lines() {
            vertices += i64::from(line.starts_with("v "));
            let Some(corners) = line.strip_prefix("f ") else { continue };
            faces += 1;
            let corners: Vec<u32> = corners.split(' ').map(|corner| corner.parse().expect("a number")).collect();
            for (i, &a) in corners.iter().enumerate() {
                let b = corners[(i + 1) % corners.len()];
                *edges.entry((a.min(b), a.max(b))).or_default() += 1;
            }
        }
        assert!(edges.values().all(|&n| n <= 2), "not manifold");
        let border: HashMap<u32, Vec<u32>> =
            edges.iter().filter(|(_, n)| **n == 1).fold(HashMap::new(), |mut map, ((a, b), _)| {
                map.entry(*a).or_insert_with(Vec::new).push(*b);
                map.entry(*b).or_insert_with(Vec::new).push(*a);
                map
            });
        let mut seen = std::collections::HashSet::new();
        let loops = border.keys().filter(|start| {
            let (mut stack, is_new) = (vec![**start], !seen.contains(*start));
            while let Some(at) = stack.pop() {
                if seen.insert(at) {
                    stack.extend(&border[&at]);
                }
            }
            is_new
        });
        (loops.count(), vertices - edges.len() as i64 + faces)
    }

    #[test]
    fn heads_are_discs_and_vases_annuli() {
        for faces in [Faces::Quads, Faces::Triangles] {
            assert_eq!(topology(&head(1, 8, faces)), (1, 1));
            assert_eq!(topology(&vase(1, 12, 5, faces)), (2, 0));
        }
    }

    #[test]
    fn kinds_differ() {
        assert_ne!(head(1, 8, Faces::Quads), head(2, 8, Faces::Quads));
        assert_ne!(vase(1, 8, 4, Faces::Quads), vase(2, 8, 4, Faces::Quads));
    }
}
