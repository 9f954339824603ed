//! Cutting a surface along the borders of smooth labels.
//!
//! Within a triangle the labels' shares are linear; where two labels change places an edge is split. A triangle in which
//! three labels meet gets a vertex inside. Cuts keep off the triangles' corners, so that no sliver is made.

use super::refined::{Builder, Refined, pieces};
use super::smooth::{Shares, winner};
use crate::mesh::tri::NONE;
use crate::numerics::stop;

/// How near to an end an edge is cut, as a share of its length.
const END: f64 = 0.12;

/// The refinement in which every border runs along edges, and the label of each of its triangles.
pub(super) fn cut(refined: &Refined, shares: &[Shares]) -> (Refined, Vec<u32>) {
    let mesh = &refined.mesh;
    let labels: Vec<u32> = shares.iter().map(winner).collect();
    let split = |h: u32| {
        let (a, b) = (mesh.tail(h) as usize, mesh.head(h) as usize);
        (labels[a] != labels[b]).then(|| {
            let lead = |v: usize| share(&shares[v], labels[a]) - share(&shares[v], labels[b]);
            let (at_a, at_b) = (lead(a), lead(b));
            (at_a / (at_a - at_b).max(1e-300)).clamp(END, 1.0 - END)
        })
    };
    let splits: Vec<Option<f64>> = (0..mesh.twins.len() as u32).map(split).collect();
    let mut out = Builder::new(refined);
    let on = out.split_edges(&splits);
    let mut label_of = Vec::new();
    for t in 0..mesh.triangles.len() as u32 {
        stop::pass(1);
        let corners = mesh.triangles[t as usize];
        let of = corners.map(|v| labels[v as usize]);
        if (0..3).all(|k| on[3 * t as usize + k] != NONE) {
            let middle =
                (0..3).map(|k| out.positions[on[3 * t as usize + k] as usize]).sum::<crate::mesh::Vec3>() / 3.0;
            let m = out.inside(middle);
            for k in 0..3u32 {
                let (after, before) = (on[(3 * t + k) as usize], on[(3 * t + (k + 2) % 3) as usize]);
                let v = corners[k as usize];
                out.extend(t, [[v, after, m], [v, m, before]]);
                label_of.extend([of[k as usize]; 2]);
            }
            continue;
        }
        let made = pieces(mesh, t, &on, &out.positions);
        let corner_label = |piece: &[u32; 3]| {
            let corner = piece.iter().find_map(|v| corners.iter().position(|c| c == v));
            corner.map_or(of[0], |k| of[k])
        };
        label_of.extend(made.iter().map(corner_label));
        out.extend(t, made);
    }
    (out.finish(), label_of)
}

fn share(shares: &Shares, label: u32) -> f64 {
    shares.iter().find(|s| s.0 == label).map_or(0.0, |s| s.1)
}
