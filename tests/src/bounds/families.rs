//! Families of input that are legal or nearly so, and hard: each of any size, so that what it costs can be seen to grow.

use std::f64::consts::TAU;
use std::fmt::Write;

/// A family: its name, what its size counts, the size it is measured at first, and how to make one.
pub struct Family {
    /// Its name.
    pub name: &'static str,
    /// What its size counts.
    pub counts: &'static str,
    /// The smaller of the two sizes it is measured at.
    pub size: usize,
    /// Makes one as OBJ.
    pub make: fn(usize) -> String,
}

/// All of them.
pub const FAMILIES: [Family; 13] = [
    Family { name: "fan", counts: "valence", size: 100_000, make: fan },
    Family { name: "coincident", counts: "vertices, all at one place", size: 50_000, make: coincident },
    Family { name: "slivers", counts: "triangles", size: 50_000, make: slivers },
    Family { name: "loops", counts: "boundary loops", size: 50_000, make: loops },
    Family { name: "book", counts: "faces at one edge", size: 10_000, make: book },
    Family { name: "ribbon", counts: "vertices", size: 20_000, make: ribbon },
    Family { name: "tube", counts: "rows of a tube of girth 4", size: 10_000, make: tube },
    Family { name: "rag", counts: "loose triangles", size: 20_000, make: ragged },
    Family { name: "handles", counts: "handles", size: 200, make: handles },
    Family { name: "noise", counts: "triangles", size: 50_000, make: noise },
    Family { name: "polygon", counts: "corners of one face", size: 20_000, make: polygon },
    Family { name: "bowties", counts: "triangles that meet in vertices", size: 20_000, make: bowties },
    Family { name: "copies", counts: "copies of a face", size: 100_000, make: copies },
];

/// A number in 0–1 from a counter, always the same.
pub(crate) fn random(i: usize) -> f64 {
    let mut x = (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x1234_5678_9abc_def1);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

fn vertex(text: &mut String, [x, y, z]: [f64; 3]) {
    let _ = writeln!(text, "v {x} {y} {z}");
}

fn face(text: &mut String, corners: &[usize]) {
    text.push('f');
    for corner in corners {
        let _ = write!(text, " {}", corner + 1);
    }
    text.push('\n');
}

/// Triangles of a grid of `columns` by `rows` cells, those left out that `keeps` refuses.
fn grid(
    columns: usize,
    rows: usize,
    at: impl Fn(usize, usize) -> [f64; 3],
    keeps: impl Fn(usize, usize) -> bool,
) -> String {
    let mut text = String::new();
    for row in 0..=rows {
        (0..=columns).for_each(|column| vertex(&mut text, at(column, row)));
    }
    let corner = |column: usize, row: usize| row * (columns + 1) + column;
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        if keeps(column, row) {
            let [a, b] = [corner(column, row), corner(column + 1, row)];
            let [c, d] = [corner(column + 1, row + 1), corner(column, row + 1)];
            face(&mut text, &[a, b, c]);
            face(&mut text, &[a, c, d]);
        }
    }
    text
}

fn side(count: usize) -> usize {
    (count as f64).sqrt().ceil() as usize
}

fn fan(valence: usize) -> String {
    let mut text = String::from("v 0 0 0\n");
    for i in 0..valence {
        let angle = TAU * i as f64 / valence as f64;
        vertex(&mut text, [angle.cos(), angle.sin(), 0.1 * (9.0 * angle).sin()]);
    }
    (0..valence).for_each(|i| face(&mut text, &[0, 1 + i, 1 + (i + 1) % valence]));
    text
}

fn coincident(vertices: usize) -> String {
    let n = side(vertices);
    grid(n, n, |_, _| [1.0, 2.0, 3.0], |_, _| true)
}

/// Cells a million times as long as they are high.
fn slivers(triangles: usize) -> String {
    let n = side(triangles / 2);
    grid(n, n, |c, r| [c as f64, r as f64 * 1e-6, 0.0], |_, _| true)
}

/// A plane with holes: every other cell of every other row is missing.
fn loops(count: usize) -> String {
    let n = side(count);
    grid(2 * n + 1, 2 * n + 1, |c, r| [c as f64, r as f64, 0.0], |c, r| c % 2 == 0 || r % 2 == 0)
}

fn book(faces: usize) -> String {
    let mut text = String::from("v 0 0 0\nv 0 0 1\n");
    for i in 0..faces {
        let angle = TAU * i as f64 / faces as f64;
        vertex(&mut text, [angle.cos(), angle.sin(), 0.5]);
        face(&mut text, &[0, 1, 2 + i]);
    }
    text
}

fn ribbon(vertices: usize) -> String {
    grid(vertices / 2, 1, |c, r| [c as f64, r as f64, 3.0 * (c as f64 / 40.0).sin()], |_, _| true)
}

fn tube(rows: usize) -> String {
    let at = |i: usize| [(i % 4) as f64 * TAU / 4.0, (i / 4) as f64];
    let mut text = String::new();
    (0..4 * (rows + 1)).map(at).for_each(|[angle, z]| vertex(&mut text, [angle.cos(), angle.sin(), z]));
    for i in 0..4 * rows {
        let next = i - i % 4 + (i + 1) % 4;
        face(&mut text, &[i, next, next + 4]);
        face(&mut text, &[i, next + 4, i + 4]);
    }
    text
}

fn ragged(triangles: usize) -> String {
    let mut text = String::new();
    for i in 0..triangles {
        (0..3).for_each(|k| vertex(&mut text, [0, 1, 2].map(|axis| random(9 * i + 3 * k + axis))));
        face(&mut text, &[3 * i, 3 * i + 1, 3 * i + 2]);
    }
    text
}

/// A closed plate with holes through it, four cells to a hole and its rim.
fn handles(count: usize) -> String {
    let n = side(count);
    let cells = 2 * n + 1;
    let solid = |c: i64, r: i64| {
        let inside = |x: i64| (0..cells as i64).contains(&x);
        inside(c) && inside(r) && (c % 2 == 0 || r % 2 == 0)
    };
    let corner = |c: usize, r: usize, z: usize| (z * (cells + 1) + r) * (cells + 1) + c;
    let mut text = String::new();
    for (z, r) in (0..2).flat_map(|z| (0..=cells).map(move |r| (z, r))) {
        (0..=cells).for_each(|c| vertex(&mut text, [c as f64, r as f64, z as f64]));
    }
    let mut quad = |[a, b, c, d]: [usize; 4]| {
        face(&mut text, &[a, b, c]);
        face(&mut text, &[a, c, d]);
    };
    for (r, c) in (0..cells).flat_map(|r| (0..cells).map(move |c| (r, c))) {
        if !solid(c as i64, r as i64) {
            continue;
        }
        let around = [(c, r), (c + 1, r), (c + 1, r + 1), (c, r + 1)];
        quad(around.map(|(c, r)| corner(c, r, 1)));
        let [a, b, d, e] = around.map(|(c, r)| corner(c, r, 0));
        quad([e, d, b, a]);
        // A wall wherever nothing is on the other side.
        for (side, (dc, dr)) in [(0, -1), (1, 0), (0, 1), (-1, 0)].into_iter().enumerate() {
            if !solid(c as i64 + dc, r as i64 + dr) {
                let [(c0, r0), (c1, r1)] = [around[side], around[(side + 1) % 4]];
                quad([corner(c0, r0, 0), corner(c1, r1, 0), corner(c1, r1, 1), corner(c0, r0, 1)]);
            }
        }
    }
    text
}

fn noise(triangles: usize) -> String {
    let n = side(triangles / 2);
    grid(n, n, |c, r| [c as f64, r as f64, 4.0 * random(r * (n + 1) + c)], |_, _| true)
}

/// One face whose outline is a star.
fn polygon(corners: usize) -> String {
    let mut text = String::new();
    for i in 0..corners {
        let angle = TAU * i as f64 / corners as f64;
        let radius = if i % 2 == 0 { 1.0 } else { 0.6 };
        vertex(&mut text, [radius * angle.cos(), radius * angle.sin(), 0.0]);
    }
    face(&mut text, &(0..corners).collect::<Vec<_>>());
    text
}

fn bowties(triangles: usize) -> String {
    let mut text = String::from("v 0 0 0\n");
    for i in 0..triangles {
        let x = i as f64;
        vertex(&mut text, [x + 0.5, 1.0, 0.0]);
        vertex(&mut text, [x + 1.0, 0.0, 0.0]);
        face(&mut text, &[2 * i, 2 * i + 1, 2 * i + 2]);
    }
    text
}

fn copies(count: usize) -> String {
    let mut text = String::from("v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    (0..count).for_each(|_| face(&mut text, &[0, 1, 2]));
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faces(text: &str) -> Vec<Vec<usize>> {
        let corners = |line: &str| line.split(' ').map(|corner| corner.parse().expect("a number")).collect();
        text.lines().filter_map(|line| line.strip_prefix("f ")).map(corners).collect()
    }

    #[test]
    fn every_family_names_only_vertices_that_it_has_and_grows_with_its_size() {
        for family in &FAMILIES {
            let [small, large] = [64, 256].map(family.make);
            for text in [&small, &large] {
                let vertices = text.lines().filter(|line| line.starts_with("v ")).count();
                let faces = faces(text);
                assert!(faces.iter().flatten().all(|&corner| (1..=vertices).contains(&corner)), "{}", family.name);
            }
            assert!(large.len() > 3 * small.len() / 2, "{}", family.name);
        }
    }

    #[test]
    fn a_plate_with_handles_is_closed_and_has_as_many_as_asked_for() {
        let text = handles(9);
        let faces = faces(&text);
        let mut edges = std::collections::HashMap::new();
        for (face, i) in faces.iter().flat_map(|face| (0..3).map(move |i| (face, i))) {
            *edges.entry((face[i], face[(i + 1) % 3])).or_insert(0) += 1;
        }
        assert!(edges.iter().all(|(&(a, b), &count)| count == 1 && edges.get(&(b, a)) == Some(&1)));
        let used: std::collections::HashSet<_> = faces.iter().flatten().collect();
        let euler = used.len() as i64 - edges.len() as i64 / 2 + faces.len() as i64;
        assert_eq!(euler, 2 - 2 * 9);
    }
}
