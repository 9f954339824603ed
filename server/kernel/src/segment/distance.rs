//! Chooses vertices that are spread over a surface, by distances along it.

use crate::mesh::geodesic::Marcher;

/// `count` vertices, each the furthest from those before it; the first is the furthest from the first vertex. Beside
/// each, its distances.
pub(super) fn spread(marcher: &Marcher<'_>, count: usize) -> Vec<(u32, Vec<f64>)> {
    let farthest = |d: &[f64]| {
        let finite = (0..d.len()).filter(|&v| d[v].is_finite());
        finite.max_by(|&a, &b| d[a].total_cmp(&d[b]).then(b.cmp(&a))).unwrap_or(0) as u32
    };
    let mut found: Vec<(u32, Vec<f64>)> = Vec::new();
    let mut nearest = marcher.distances(&[0]);
    for k in 0..count {
        let v = farthest(&nearest);
        if k > 0 && nearest[v as usize] <= 0.0 {
            break;
        }
        let d = marcher.distances(&[v]);
        match k {
            0 => nearest.clone_from(&d),
            _ => nearest.iter_mut().zip(&d).for_each(|(n, d)| *n = n.min(*d)),
        }
        found.push((v, d));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn spread_vertices_lie_far_apart() {
        let mesh = grid(10, 10, false, false);
        let found = spread(&Marcher::new(&mesh), 4);
        let mut corners: Vec<u32> = found.iter().map(|f| f.0).collect();
        corners.sort_unstable();
        assert_eq!(corners, [0, 10, 110, 120]);
    }
}
