//! Maps to the unit disc that fold nothing: each inner vertex is a weighted mean of its neighbours, with positive weights.

use crate::mesh::tri::{NONE, TriMesh};
use crate::numerics::Pattern;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Smallest weight of an edge: the sum of cotangents may be negative, and a map with such weights may fold.
const WEIGHT_MIN: f64 = 1e-3;
const WEIGHT_MAX: f64 = 1e3;

/// The harmonic map of a disc to the unit disc, its border on the circle by length. One point a vertex.
pub(super) fn harmonic(sheet: &TriMesh) -> Option<Vec<[f64; 2]>> {
    let border = border(sheet)?;
    let at = |v: u32| sheet.positions[v as usize];
    let step = |k: usize| (at(border[(k + 1) % border.len()]) - at(border[k])).norm();
    let length: f64 = (0..border.len()).map(step).sum();
    if length <= 0.0 || !length.is_finite() {
        return None;
    }
    let mut fixed: BTreeMap<u32, [f64; 2]> = BTreeMap::new();
    let mut along = 0.0;
    for (k, &v) in border.iter().enumerate() {
        let (sin, cos) = (TAU * along / length).sin_cos();
        fixed.insert(v, [cos, sin]);
        along += step(k);
    }
    let cotangent = |h: u32| {
        let (t, k) = (h as usize / 3, h as usize % 3);
        let [a, b, o] = [0, 1, 2].map(|i| sheet.triangles[t][(k + i) % 3]);
        let (p, q) = (at(a) - at(o), at(b) - at(o));
        p.dot(&q) / p.cross(&q).norm().max(f64::MIN_POSITIVE)
    };
    let edge = |h: u32| {
        let (a, b, twin) = (sheet.tail(h), sheet.head(h), sheet.twin(h));
        let other = if twin == NONE { 0.0 } else { cotangent(twin) };
        let is_first = twin == NONE || h < twin;
        let weight = (0.5 * cotangent(h) + 0.5 * other).clamp(WEIGHT_MIN, WEIGHT_MAX);
        is_first.then_some((a.min(b), a.max(b), weight))
    };
    let mut weighted: Vec<(u32, u32, f64)> = (0..sheet.twins.len() as u32).filter_map(edge).collect();
    weighted.sort_unstable_by_key(|e| (e.0, e.1));
    means(sheet.positions.len(), &weighted, &fixed)
}

/// Tutte's embedding of faces whose rim is given: `rim` its vertices and their places. The places of `inner`, in order.
pub(super) fn tutte(faces: &[&[u32]], (rim, places): (&[u32], &[[f64; 2]]), inner: &[u32]) -> Option<Vec<[f64; 2]>> {
    let mut vertices: Vec<u32> = rim.iter().chain(inner).copied().collect();
    vertices.sort_unstable();
    let number = |v: u32| vertices.binary_search(&v).ok().map(|k| k as u32);
    let fixed = rim.iter().zip(places).map(|(&v, &p)| Some((number(v)?, p))).collect::<Option<BTreeMap<_, _>>>()?;
    let mut edges = Vec::new();
    for c in faces {
        for k in 0..c.len() {
            let (a, b) = (number(c[k])?, number(c[(k + 1) % c.len()])?);
            edges.push((a.min(b), a.max(b), 1.0));
        }
    }
    edges.sort_unstable_by_key(|e| (e.0, e.1));
    edges.dedup_by_key(|e| (e.0, e.1));
    let all = means(vertices.len(), &edges, &fixed)?;
    inner.iter().map(|&v| all.get(number(v)? as usize).copied()).collect()
}

/// Points of `count` vertices, each but the fixed ones the mean of its neighbours by the weights of the edges to them.
fn means(count: usize, edges: &[(u32, u32, f64)], fixed: &BTreeMap<u32, [f64; 2]>) -> Option<Vec<[f64; 2]>> {
    let mut is_fixed = vec![false; count];
    fixed.keys().for_each(|&v| is_fixed[v as usize] = true);
    let mut diagonal = vec![0.0; count];
    let mut sums = [vec![0.0; count], vec![0.0; count]];
    for &(a, b, w) in edges {
        for (v, other) in [(a, b), (b, a)] {
            diagonal[v as usize] += w;
            if let Some(p) = fixed.get(&other).filter(|_| !is_fixed[v as usize]) {
                (0..2).for_each(|k| sums[k][v as usize] += w * p[k]);
            }
        }
    }
    let pattern = Pattern::new(count, edges.iter().map(|e| (e.0, e.1))).ok()?;
    let factor = pattern.factor(&diagonal, edges.iter().map(|&(a, b, w)| (a, b, -w)), &is_fixed).ok()?;
    for (k, column) in sums.iter_mut().enumerate() {
        fixed.iter().for_each(|(&v, p)| column[v as usize] = p[k]);
        factor.solve(column);
    }
    let [xs, ys] = sums;
    Some(xs.into_iter().zip(ys).map(|(x, y)| [x, y]).collect())
}

/// The border of a disc, counter-clockwise.
fn border(sheet: &TriMesh) -> Option<Vec<u32>> {
    let next: BTreeMap<u32, u32> = (0..sheet.twins.len() as u32)
        .filter(|&h| sheet.twin(h) == NONE)
        .map(|h| (sheet.tail(h), sheet.head(h)))
        .collect();
    let &first = next.keys().next()?;
    let mut found = vec![first];
    while let Some(&v) = next.get(found.last()?) {
        if v == first {
            return (found.len() == next.len()).then_some(found);
        }
        if found.len() > next.len() {
            break;
        }
        found.push(v);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::tests::grid;

    #[test]
    fn a_sheet_fills_the_disc_without_a_fold() {
        let sheet = grid(8, 8, false, false);
        let flat = harmonic(&sheet).expect("a disc");
        let area = |c: &[u32; 3]| {
            let [a, b, c] = c.map(|v| flat[v as usize]);
            (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        };
        assert!(sheet.triangles.iter().map(area).fold(f64::INFINITY, f64::min) > -1e-12);
        let all: f64 = sheet.triangles.iter().map(|c| 0.5 * area(c)).sum();
        assert!((all - std::f64::consts::PI).abs() < 0.1, "{all}");
    }

    #[test]
    fn the_middle_of_a_wheel_is_the_mean_of_its_rim() {
        let rim = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -0.2]];
        let faces: [&[u32]; 4] = [&[0, 1, 9], &[1, 2, 9], &[2, 3, 9], &[3, 0, 9]];
        let found = tutte(&faces, (&[0, 1, 2, 3], &rim), &[9]).expect("solvable");
        assert!(found[0][0].abs() < 1e-12 && (found[0][1] - 0.2).abs() < 1e-12, "{found:?}");
    }
}
