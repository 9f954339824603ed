//! Whether a mesh is an artist's layout at all. A scan that is taken as an example lies well on every scan, and spoils rankings.

use super::ingest::counts_of;
use quadmuse_kernel::compose::check::extraordinary;
use quadmuse_kernel::mesh::PolyMesh;

/// Share of quads among the faces below which a mesh is hardly a layout. Of 93 layouts of artists none has less than .75.
const QUADS_SHARE_MIN: f64 = 0.5;

/// Share of vertices with another number of edges than four above which a mesh of quads is hardly a layout. Of the same 93
/// none has more than .43, where few quads make a whole animal; triangles that were each cut into three quads come to .5.
const EXTRAORDINARY_SHARE_MAX: f64 = 0.45;

/// Vertices below which that share says nothing: a box has eight, each with three edges.
const VERTICES_MIN: u64 = 64;

/// Why a mesh may be no artist's layout, a sentence each; nothing where it looks like one.
pub(super) fn doubts(mesh: &PolyMesh) -> Vec<String> {
    let counts = counts_of(mesh);
    let quads = counts.quads as f64 / counts.faces.max(1) as f64;
    if quads < QUADS_SHARE_MIN {
        let percent = (100.0 * quads).floor();
        return vec![format!("only {percent} % of its faces are quads: it looks like a scan, not like a layout")];
    }
    let share = extraordinary(mesh) as f64 / counts.vertices.max(1) as f64;
    if counts.vertices >= VERTICES_MIN && share > EXTRAORDINARY_SHARE_MAX {
        let percent = (100.0 * share).round();
        return vec![format!(
            "{percent} % of its vertices have another number of edges than four: it looks like a scan in quads, not like a layout"
        )];
    }
    Vec::new()
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_kernel::mesh::{Format, Limits, read};

    /// A grid of `n` by `n` squares; `face` makes faces of the corners of each.
    fn grid(n: usize, face: impl Fn([usize; 4]) -> String) -> PolyMesh {
        let mut text: String = (0..=n).flat_map(|y| (0..=n).map(move |x| format!("v {x} {y} 0\n"))).collect();
        for (x, y) in (0..n).flat_map(|y| (0..n).map(move |x| (x, y))) {
            let a = y * (n + 1) + x + 1;
            text += &face([a, a + 1, a + n + 2, a + n + 1]);
        }
        read(text.as_bytes(), Some(Format::Obj), &Limits::default()).expect("a mesh")
    }

    #[test]
    fn a_layout_is_not_doubted_and_a_scan_is() {
        let quads = grid(8, |[a, b, c, d]| format!("f {a} {b} {c} {d}\n"));
        assert_eq!(doubts(&quads), Vec::<String>::new());
        let triangles = grid(8, |[a, b, c, d]| format!("f {a} {b} {c}\nf {a} {c} {d}\n"));
        assert_eq!(doubts(&triangles).len(), 1);
        assert!(doubts(&triangles)[0].starts_with("only 0 % of its faces are quads"), "{:?}", doubts(&triangles));
    }

    #[test]
    fn a_scan_whose_triangles_were_cut_into_quads_is_doubted() {
        // Each triangle is cut into three quads around its middle: every other vertex has three edges, or six and more.
        let n = 30;
        let corner = |x: usize, y: usize| (2 * y) * (2 * n + 1) + 2 * x;
        let mut text: String = (0..=2 * n).flat_map(|y| (0..=2 * n).map(move |x| format!("v {x} {y} 0\n"))).collect();
        let mut next = (2 * n + 1) * (2 * n + 1);
        let middle = |a: usize, b: usize| (a + b) / 2;
        for (x, y) in (0..n).flat_map(|y| (0..n).map(move |x| (x, y))) {
            let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
            for [p, q, r] in [[a, b, c], [a, c, d]] {
                text += &format!("v {} {} 0\n", x as f64 * 2.0 + if r == c { 1.3 } else { 0.7 }, y as f64 * 2.0 + 1.0);
                next += 1;
                let [pq, qr, rp] = [middle(p, q), middle(q, r), middle(r, p)].map(|v| v + 1);
                text += &format!(
                    "f {} {pq} {next} {rp}\nf {pq} {} {qr} {next}\nf {next} {qr} {} {rp}\n",
                    p + 1,
                    q + 1,
                    r + 1
                );
            }
        }
        let mesh = read(text.as_bytes(), Some(Format::Obj), &Limits::default()).expect("a mesh");
        assert!(
            doubts(&mesh).first().is_some_and(|doubt| doubt.contains("another number of edges")),
            "{:?}",
            doubts(&mesh)
        );
    }
}
