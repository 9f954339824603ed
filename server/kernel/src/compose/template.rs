//! Regular layouts for the four primitives, in the domain of the input's own chart: what a segment takes that has no
//! example.
//!
//! *Annulus, torus:* rows × columns; the chart is conformal, so with R = n·m rows of n columns (m the modulus) the quads
//! are nearly square. *Disc:* rings of n columns around a square cap of a × b quads, 2(a + b) = n, in place of a pole with
//! n edges: four vertices of three edges and no other. v is the share of area below, so rings of n quads are n/N wide in
//! v, N the number of quads: all have the same area. *Sphere:* such a cap at each pole. *Ours, not the paper's.*

use super::net::Net;
use super::smooth::{Plan, Target};
use crate::encode::index::PlanarIndex;
use crate::mesh::PolyMesh;
use crate::mesh::tri::TriMesh;
use crate::topology::Topology;
use crate::unfold::{Chart, Uv};

/// Fewest columns.
const COLUMNS_MIN: usize = 8;
/// Most columns, and most rows.
const COLUMNS_MAX: usize = 400;
/// Rounds in which a cap rounds its corners off.
const CAP_ROUNDS: u32 = 20;
/// A tube whose quads would be larger than this many times the area asked for gets more columns.
const BULGE_MAX: f64 = 3.0;

/// Rows and columns of a template.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Quads around.
    pub columns: usize,
    /// Rings of quads between the caps or boundaries.
    pub rows: usize,
    /// Sides of each cap; 0 for annuli and tori.
    pub cap: [usize; 2],
}

impl Grid {
    /// Quads in all.
    pub fn quads(&self, topology: Topology) -> usize {
        let caps = match topology {
            Topology::Disc => 1,
            Topology::Sphere => 2,
            Topology::Annulus | Topology::Torus => 0,
        };
        self.columns * self.rows + caps * self.cap[0] * self.cap[1]
    }
}

/// The grid whose edges are about `edge` long.
pub fn grid_for(chart: &Chart, edge: f64) -> Grid {
    let mesh = &*chart.mesh;
    let area = mesh.total_area();
    let edge = if edge > 0.0 && edge.is_finite() { edge } else { area.sqrt() / 16.0 };
    let wanted = area / (edge * edge);
    let loops: Vec<f64> = mesh.boundary_loops().iter().map(|ring| ring_length(mesh, ring)).collect();
    let around = match chart.topology {
        Topology::Disc => loops.iter().sum::<f64>() / edge,
        Topology::Annulus => {
            let mean = loops.iter().sum::<f64>() / loops.len().max(1) as f64 / edge;
            mean.max((wanted / (BULGE_MAX * chart.modulus.max(1e-3))).sqrt().min(3.0 * mean))
        }
        Topology::Sphere => 4.0 * (wanted / 6.0).sqrt(),
        Topology::Torus => (wanted / chart.modulus.max(1e-3)).sqrt(),
    };
    let columns = 2 * ((around / 2.0).round() as usize).clamp(COLUMNS_MIN / 2, COLUMNS_MAX / 2);
    let cap = [columns / 4, columns / 2 - columns / 4];
    let rows = match chart.topology {
        Topology::Disc => (wanted - (cap[0] * cap[1]) as f64) / columns as f64,
        Topology::Sphere => (wanted - (2 * cap[0] * cap[1]) as f64) / columns as f64,
        Topology::Annulus | Topology::Torus => columns as f64 * chart.modulus,
    };
    let least = if chart.topology == Topology::Torus { 3 } else { 1 };
    let rows = (rows.round().max(0.0) as usize).clamp(least, COLUMNS_MAX);
    match chart.topology {
        Topology::Disc | Topology::Sphere => Grid { columns, rows, cap },
        Topology::Annulus | Topology::Torus => Grid { columns, rows, cap: [0, 0] },
    }
}

fn ring_length(mesh: &TriMesh, ring: &[u32]) -> f64 {
    let p = |v: u32| mesh.positions[v as usize];
    ring.iter().map(|&h| (p(mesh.head(h)) - p(mesh.tail(h))).norm()).sum()
}

/// A layout in the domain: points and quads, counter-clockwise.
fn layout(topology: Topology, grid: Grid) -> (Vec<Uv>, Vec<Vec<u32>>, Vec<u32>) {
    let (n, rows) = (grid.columns, grid.rows);
    let total = grid.quads(topology) as f64;
    let cap_share = (grid.cap[0] * grid.cap[1]) as f64 / total;
    let bottom = if topology == Topology::Sphere { cap_share } else { 0.0 };
    let height = match topology {
        Topology::Disc | Topology::Sphere => (n * rows) as f64 / total,
        Topology::Annulus | Topology::Torus => 1.0,
    };
    let lines = if topology == Topology::Torus { rows } else { rows + 1 };
    let mut points: Vec<Uv> = Vec::new();
    for j in 0..lines {
        let v = bottom + height * j as f64 / rows as f64;
        points.extend((0..n).map(|i| [i as f64 / n as f64, v]));
    }
    let at = |i: usize, j: usize| ((j % lines) * n + i % n) as u32;
    let mut quads: Vec<Vec<u32>> = (0..rows)
        .flat_map(|j| (0..n).map(move |i| (i, j)))
        .map(|(i, j)| vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
        .collect();
    let mut inner = Vec::new();
    if matches!(topology, Topology::Disc | Topology::Sphere) {
        let ring: Vec<u32> = (0..n).map(|i| at(i, rows)).collect();
        inner.extend(cap(&ring, grid.cap, cap_share, &mut points, &mut quads, |u, share| [u, 1.0 - share]));
    }
    if topology == Topology::Sphere {
        // Seen from the bottom pole, u runs clockwise.
        let ring: Vec<u32> = (0..n).map(|i| at(n - i, 0)).collect();
        inner.extend(cap(&ring, grid.cap, cap_share, &mut points, &mut quads, |u, share| {
            [(1.0 - u).rem_euclid(1.0), share]
        }));
    }
    (points, quads, inner)
}

/// A square cap inside a ring of columns, counter-clockwise; `place` gives the point at an angle inside which a share of
/// the area lies. Gives the cap's vertices.
fn cap(
    ring: &[u32],
    [a, b]: [usize; 2],
    share: f64,
    points: &mut Vec<Uv>,
    quads: &mut Vec<Vec<u32>>,
    place: impl Fn(f64, f64) -> Uv,
) -> Vec<u32> {
    let n = ring.len();
    // Places on the ring of a point of the square's border, from its lower left corner, counter-clockwise.
    let on_ring = |x: usize, y: usize| match (x, y) {
        (x, 0) => x,
        (x, y) if x == a => a + y,
        (x, y) if y == b => a + b + (a - x),
        (_, y) => 2 * a + b + (b - y),
    };
    let mut number = vec![0u32; (a + 1) * (b + 1)];
    let mut all = Vec::new();
    for y in 0..=b {
        for x in 0..=a {
            let on_border = x == 0 || y == 0 || x == a || y == b;
            number[y * (a + 1) + x] = if on_border {
                ring[on_ring(x, y) % n]
            } else {
                let (p, q) = (2.0 * x as f64 / a as f64 - 1.0, 2.0 * y as f64 / b as f64 - 1.0);
                let rho = p.abs().max(q.abs());
                let around = border_place(p / rho.max(1e-12), q / rho.max(1e-12), a as f64, b as f64);
                points.push(place(around / n as f64, share * rho * rho));
                points.len() as u32 - 1
            };
            all.push(number[y * (a + 1) + x]);
        }
    }
    for y in 0..b {
        for x in 0..a {
            let at = |x: usize, y: usize| number[y * (a + 1) + x];
            quads.push(vec![at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
    }
    all
}

/// Length along the border of a square of a × b columns, of a point with max(|p|, |q|) = 1, from the lower left corner.
fn border_place(p: f64, q: f64, a: f64, b: f64) -> f64 {
    let (s, t) = ((p + 1.0) / 2.0, (q + 1.0) / 2.0);
    if q <= -1.0 + 1e-9 {
        a * s
    } else if p >= 1.0 - 1e-9 {
        a + b * t
    } else if q >= 1.0 - 1e-9 {
        a + b + a * (1.0 - s)
    } else {
        2.0 * a + b + b * (1.0 - t)
    }
}

/// The template of a grid on a chart's surface. `index` is the chart's.
pub fn template(chart: &Chart, index: &PlanarIndex, grid: Grid) -> PolyMesh {
    let (points, quads, inner) = layout(chart.topology, grid);
    let place = |uv: &Uv| index.locate(chart, [uv[0].rem_euclid(1.0), uv[1].clamp(0.0, 1.0)]).point(chart);
    let mut net = Net::new(points.iter().map(place).collect(), quads);
    if !inner.is_empty() {
        let target = Target::new(&chart.mesh);
        Plan::new(&net, &inner).run(&mut net, &target, CAP_ROUNDS);
    }
    net.into_mesh().0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compose::check::{Shape, check_structure, extraordinary};
    use crate::topology::{tests::grid, whole};
    use crate::unfold::{UnfoldOptions, signed_area, unfold};

    #[test]
    fn layouts_are_quads_of_their_topology_with_eight_or_fewer_extraordinary_vertices() {
        let cases = [
            (Topology::Disc, Shape { components: 1, boundary_loops: 1, euler: 1 }, 4),
            (Topology::Annulus, Shape { components: 1, boundary_loops: 2, euler: 0 }, 0),
            (Topology::Sphere, Shape { components: 1, boundary_loops: 0, euler: 2 }, 8),
            (Topology::Torus, Shape { components: 1, boundary_loops: 0, euler: 0 }, 0),
        ];
        for (topology, shape, irregular) in cases {
            for columns in [8, 10, 12, 22] {
                let cap = if irregular > 0 { [columns / 4, columns / 2 - columns / 4] } else { [0, 0] };
                let grid = Grid { columns, rows: 5, cap };
                let (points, quads, _) = layout(topology, grid);
                assert_eq!(quads.len(), grid.quads(topology));
                for q in &quads {
                    let x = q.iter().map(|&v| points[v as usize]).collect::<Vec<_>>();
                    let near = |y: Uv| {
                        [
                            y[0] - (y[0] - x[0][0]).round(),
                            y[1] - if topology == Topology::Torus { (y[1] - x[0][1]).round() } else { 0.0 },
                        ]
                    };
                    let on_rows = x.iter().all(|p| (p[1] - x[0][1]).abs() < 0.5);
                    let narrow = x.iter().all(|p| (near(*p)[0] - x[0][0]).abs() < 0.2);
                    assert!(
                        !(on_rows && narrow) || signed_area(&[x[0], near(x[1]), near(x[2])]) > -1e-9,
                        "{topology:?} {x:?}"
                    );
                }
                let positions = points.iter().map(|p| crate::mesh::Vec3::new(p[0], p[1], 0.0)).collect();
                let mesh = Net::new(positions, quads).into_mesh().0;
                assert_eq!(check_structure(&mesh, shape), Ok(()), "{topology:?}, {columns} columns");
                assert_eq!(extraordinary(&mesh), irregular);
            }
        }
    }

    #[test]
    fn a_template_lies_on_its_disc_and_its_boundary_on_the_boundary() {
        let mesh = grid(24, 24, false, false);
        let patch = whole(&mesh).expect("a disc");
        let chart = unfold(&patch, &UnfoldOptions::default()).expect("solvable");
        let index = PlanarIndex::new(&chart);
        let grid = grid_for(&chart, 0.1);
        let made = template(&chart, &index, grid);
        assert!((grid.quads(Topology::Disc) as f64 - 100.0).abs() < 60.0, "{grid:?}");
        let net = Net::from_mesh(&made);
        for v in net.loops().expect("one").remove(0) {
            let p = net.positions[v as usize];
            assert!(p.x.min(1.0 - p.x).min(p.y).min(1.0 - p.y) < 1e-9);
        }
        // All quads look the same way.
        for (_, c) in net.faces() {
            let p = |k: usize| net.positions[c[k] as usize];
            assert!((p(2) - p(0)).cross(&(p(3) - p(1))).z > 0.0);
        }
    }
}
