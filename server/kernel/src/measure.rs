//! How good a map is: fold-overs, distortion against the example's own shape, and one honest word.

pub mod coverage;
pub mod sound;
mod way;

use crate::encode::index::PlanarIndex;
use crate::map::untangle::inward;
use crate::map::{CrossMap, cross_map};
use crate::mesh::Vec3;
use crate::mesh::tri::TriMesh;
use crate::register::Query;
use crate::register::entry::Hypothesis;
use crate::topology::Topology;
use crate::unfold::Chart;
pub use coverage::Coverage;

/// Bins of a histogram.
pub const BINS: usize = 24;

/// A map of one chart that changes angles by more than this for one face in twenty, before its polish, has its poles
/// sought again. Heads mapped well have 10–22°.
pub const BURDENED_DEG: f64 = 25.0;

/// A distribution over the example's area.
#[derive(Clone, Debug, PartialEq)]
pub struct Distribution {
    /// Left end of the first bin.
    pub low: f64,
    /// Right end of the last bin.
    pub high: f64,
    /// Share of the area in each of [`BINS`] equal bins; what lies outside counts in the end bins.
    pub shares: Vec<f64>,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile of the magnitude.
    pub p95: f64,
    /// Largest magnitude.
    pub max: f64,
}

/// Distortion of a map against the example's own geometry.
#[derive(Clone, Debug, PartialEq)]
pub struct Distortion {
    /// By how much right angles change, in degrees, 0–90.
    pub angle_deg: Distribution,
    /// log₂ of how much larger a face is on the input than on the example, each as a share of its surface.
    pub area_log2: Distribution,
    /// Polygons that look into the input, in order.
    pub inward: Vec<u32>,
    /// Polygons in all.
    pub faces: usize,
}

impl Distortion {
    /// One number to compare maps of the same pair by: the lower the better.
    pub fn badness(&self) -> f64 {
        let turned = self.inward.len() as f64 / self.faces.max(1) as f64;
        self.angle_deg.mean + self.angle_deg.p95 / 3.0 + 10.0 * self.area_log2.p95 / 3.0 + 100.0 * turned
    }
}

/// [`Distortion::badness`] of the map that a hypothesis makes of the example's patch `mesh`, before any polish; infinite
/// where its poles can't be charted. What [`Entry::unburden_poles`](crate::register::Entry::unburden_poles) weighs.
pub fn burden(mesh: &TriMesh, example: &Chart, query: &Query, hypothesis: &Hypothesis) -> f64 {
    let Some(chart) = query.quick_chart(&hypothesis.unfolded.poles) else { return f64::INFINITY };
    let registration = &hypothesis.registration;
    let cross = cross_map(registration, example, &chart, &PlanarIndex::new(&chart));
    let mirror = if registration.flip.is_mirror() { -1.0 } else { 1.0 };
    distortion(mesh, &cross, &chart, mirror).badness()
}

/// Compares each triangle of the example with its image. `mirror` is −1 for mirrored maps, which turn
/// every face.
pub fn distortion(example: &TriMesh, cross: &CrossMap, input: &Chart, mirror: f64) -> Distortion {
    let (area_1, area_2) = (example.total_area(), input.mesh.total_area());
    let mut polygons = example.polygon_of.clone();
    polygons.sort_unstable();
    polygons.dedup();
    let area = |([s1, s2], weight): ([f64; 2], f64)| ((s1 * s2 * area_1 / area_2).max(1e-12).log2(), weight);
    Distortion {
        angle_deg: angle_distortion(example, cross),
        area_log2: distribution(stretches(example, cross).map(area).collect(), -3.0, 3.0),
        inward: inward(example, cross, input, mirror),
        faces: polygons.len(),
    }
}

/// [`Distortion::angle_deg`] alone.
pub fn angle_distortion(example: &TriMesh, cross: &CrossMap) -> Distribution {
    let angle = |([s1, s2], weight): ([f64; 2], f64)| {
        (if s1 > 0.0 { 90.0 - 2.0 * (s2 / s1).atan().to_degrees() } else { 90.0 }, weight)
    };
    distribution(stretches(example, cross).map(angle).collect(), 0.0, 60.0)
}

/// By how much a map changes the angles that matter to a layout, as a distribution like [`Distortion::angle_deg`]. Along a ring or
/// torus a layout may be drawn out: there it is by how much the angle between rows (constant v) and columns changes, in degrees;
/// `chart` is the example's.
pub fn layout_distortion(example: &TriMesh, cross: &CrossMap, chart: &Chart) -> Distribution {
    if !is_ring(chart) {
        return angle_distortion(example, cross);
    }
    let sheared = |(t, corners): (usize, &[u32; 3])| {
        let v = corners.map(|c| chart.uv[c as usize][1]);
        let beside = |to: f64| to - v[0] - if chart.topology == Topology::Torus { (to - v[0]).round() } else { 0.0 };
        let before = flat(corners.map(|v| example.positions[v as usize]));
        let jacobian = jacobian(before, flat(corners.map(|v| cross.positions[v as usize])))?;
        Some((shear_deg(before, jacobian, [beside(v[1]), beside(v[2])]), example.area(t)))
    };
    distribution(example.triangles.iter().enumerate().filter_map(sheared).collect(), 0.0, 60.0)
}

/// By how much the angles at the corners of the example's polygons change where its vertices go to `positions`: the mean in degrees,
/// 0–180, each polygon weighed by its area on the example. Rows that are drawn out or pressed together keep their angles.
pub fn corner_change(example: &TriMesh, positions: &[Vec3]) -> f64 {
    // A diagonal parts the angle at a corner: the changes of a polygon's triangles there add up. Each tells a third of its triangle's area.
    let mut corners: Vec<(u32, u32, f64, f64)> = Vec::with_capacity(3 * example.triangles.len());
    for (t, triangle) in example.triangles.iter().enumerate() {
        for k in 0..3 {
            let [v, next, last] = [0, 1, 2].map(|step| triangle[(k + step) % 3] as usize);
            let angle = |at: &[Vec3]| (at[next] - at[v]).angle(&(at[last] - at[v]));
            let change = angle(positions) - angle(&example.positions);
            corners.push((example.polygon_of[t], triangle[k], change, example.area(t) / 3.0));
        }
    }
    corners.sort_by_key(|&(polygon, vertex, ..)| (polygon, vertex));
    let (mut sum, mut weight) = (0.0, 0.0);
    for polygon in corners.chunk_by(|a, b| a.0 == b.0) {
        let at_corner = |one: &[(u32, u32, f64, f64)]| one.iter().map(|c| c.2).sum::<f64>().abs();
        let changes: Vec<f64> = polygon.chunk_by(|a, b| a.1 == b.1).map(at_corner).collect();
        let area: f64 = polygon.iter().map(|c| c.3).sum();
        sum += area * changes.iter().sum::<f64>() / changes.len() as f64;
        weight += area;
    }
    (sum / weight.max(f64::MIN_POSITIVE)).to_degrees()
}

/// Tells whether a surface goes round, as a ring or a torus does.
pub fn is_ring(chart: &Chart) -> bool {
    matches!(chart.topology, Topology::Annulus | Topology::Torus)
}

/// By how much the angle between the lines of constant v and those across them changes, in degrees; `rise`: v at the second and the
/// third corner, from the first.
fn shear_deg([l, a, h]: [f64; 3], [x, y, z]: [f64; 3], rise: [f64; 2]) -> f64 {
    let (along, across) = (rise[0] / l, (rise[1] - a * rise[0] / l) / h);
    let carried = |[p, q]: [f64; 2]| [x * p + y * q, z * q];
    let (one, two) = (carried([along, across]), carried([-across, along]));
    let lengths = one[0].hypot(one[1]) * two[0].hypot(two[1]);
    if lengths > 0.0 {
        ((one[0] * two[0] + one[1] * two[1]) / lengths).abs().min(1.0).asin().to_degrees()
    } else {
        90.0
    }
}

/// The singular values of the map of each triangle that has an area, and that area.
fn stretches(example: &TriMesh, cross: &CrossMap) -> impl Iterator<Item = ([f64; 2], f64)> {
    example.triangles.iter().enumerate().filter_map(|(t, corners)| {
        let before = corners.map(|v| example.positions[v as usize]);
        let after = corners.map(|v| cross.positions[v as usize]);
        Some((singular_values(before, after)?, example.area(t)))
    })
}

/// A triangle in its own plane: the length of its first edge, and the third corner along and across it.
fn flat(p: [Vec3; 3]) -> [f64; 3] {
    let (e, f) = (p[1] - p[0], p[2] - p[0]);
    let length = e.norm();
    let along = if length > 0.0 { e.dot(&f) / length } else { 0.0 };
    [length, along, (f.norm_squared() - along * along).max(0.0).sqrt()]
}

/// The linear map (x y; 0 z) between two triangles in their planes; `None` for a triangle without area.
fn jacobian([l, a, h]: [f64; 3], [m, b, g]: [f64; 3]) -> Option<[f64; 3]> {
    (l > 0.0 && h > 0.0).then(|| [m / l, (b - a * m / l) / h, g / h])
}

/// Singular values (greater first) of the linear map between two triangles; `None` for a triangle without area.
fn singular_values(before: [Vec3; 3], after: [Vec3; 3]) -> Option<[f64; 2]> {
    let [x, y, z] = jacobian(flat(before), flat(after))?;
    let (sum, difference) = ((x + z).hypot(y), (x - z).hypot(y));
    Some([0.5 * (sum + difference), 0.5 * (sum - difference).abs()])
}

fn distribution(mut samples: Vec<(f64, f64)>, low: f64, high: f64) -> Distribution {
    samples.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = samples.iter().map(|s| s.1).sum::<f64>().max(1e-300);
    let mut shares = vec![0.0; BINS];
    for (x, weight) in &samples {
        let bin = ((x - low) / (high - low) * BINS as f64).clamp(0.0, BINS as f64 - 1.0) as usize;
        shares[bin] += weight / total;
    }
    let mean = samples.iter().map(|(x, w)| x * w).sum::<f64>() / total;
    let median = quantile(&samples, 0.5 * total);
    samples.iter_mut().for_each(|s| s.0 = s.0.abs());
    samples.sort_by(|a, b| a.0.total_cmp(&b.0));
    let p95 = quantile(&samples, 0.95 * total);
    Distribution { low, high, shares, mean, median, p95, max: samples.last().map_or(0.0, |s| s.0) }
}

/// The value below which `weight` lies, of sorted (value, weight) samples.
fn quantile(samples: &[(f64, f64)], weight: f64) -> f64 {
    let mut sum = 0.0;
    let reached = samples.iter().find(|s| {
        sum += s.1;
        sum >= weight
    });
    reached.or(samples.last()).map_or(0.0, |s| s.0)
}

/// The grade of a map, in one plain word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// Use it.
    Good,
    /// Look at it.
    Fair,
    /// Do not trust it.
    Poor,
}

/// The measurements from which a map's grade is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapMeasurements {
    /// E / variance at the finest level reached.
    pub cost: f64,
    /// log of the ratio of the moduli.
    pub modulus_log: f64,
    /// Share of faces that are turned over.
    pub turned_share: f64,
    /// 95th percentile of the angle distortion.
    pub angle_p95_deg: f64,
    /// The same before the polish, which hides what was laid wrongly: it smooths a map wherever it lies.
    pub laid_angle_p95_deg: f64,
    /// What of the input the map leaves out.
    pub coverage: Coverage,
    /// True for the example, and for the input, where they are flat.
    pub is_flat: [bool; 2],
    /// True for rings and tori. Their pictures are mostly flat, so that neither these nor their features tell much, and a layout may
    /// be drawn out along them.
    pub is_ring: bool,
}

/// How much longer, as a logarithm, a ring may be than the example's whose layout is drawn out on it: good, and fair. *Untuned:* its
/// quads become rectangles of 3 : 2, and of 3 : 1.
const RING_LIMITS: (f64, f64) = (0.41, 1.1);

/// Each measure with the limits below which it is good, or fair. Calibrated in tests/records.
const LIMITS: [(&str, f64, f64); 7] = [
    ("the surfaces' pictures differ by {} of their variance", 0.12, 0.35),
    ("the surfaces' proportions differ (log modulus {})", 0.15, 0.4),
    ("the share {} of the faces look inward", 0.002, 0.02),
    ("angles change by {}° for one face in twenty", 35.0, 55.0),
    ("before its faces were smoothed the map changed angles by {}° for one face in twenty", 25.0, 90.0),
    ("the share {} of the input has no face near it", 0.05, 0.2),
    ("the share {} of the input's features is missing in the example", 0.1, 0.5),
];

/// Said where no measure alone makes a map poor, but all of them together do.
const TOGETHER: &str = "each of these is doubtful, and together they are too much";

/// Tells whether a map may be good by what is known of it before it settles: its cost, and how it changes angles, in degrees, for one
/// face in twenty.
pub fn may_be_good(cost: f64, laid_angle_p95_deg: f64, is_ring: bool) -> bool {
    let [(_, cost_good, _), .., (_, angle_good, _), _, _] = LIMITS;
    (is_ring || cost <= cost_good) && laid_angle_p95_deg <= angle_good
}

/// The verdict with a sentence for each measure that is not good. Doubts add up: with each measure as a share of the way from where
/// it is good to where it is fair, a map is fair within the unit ball. Of maps with no measure beyond its limit right ones had a norm
/// of up to .85, and wrong ones 1.04 and 1.32 (tests/records/corpus-2026-11-29.md).
pub fn verdict(evidence: &MapMeasurements) -> (Grade, Vec<String>) {
    let of_pictures = |value: f64| if evidence.is_ring { 0.0 } else { value };
    let values = [
        of_pictures(evidence.cost),
        evidence.modulus_log.abs(),
        evidence.turned_share,
        evidence.angle_p95_deg,
        evidence.laid_angle_p95_deg,
        evidence.coverage.uncovered_share,
        of_pictures(evidence.coverage.missing as f64 / evidence.coverage.features.max(1) as f64),
    ];
    let mut limits = LIMITS;
    if evidence.is_ring {
        (limits[1].1, limits[1].2) = RING_LIMITS;
    }
    let (mut word, mut reasons, mut doubt) = (Grade::Good, Vec::new(), 0.0);
    let (flat, other) = if evidence.is_flat[0] { ("example", "scan") } else { ("scan", "example") };
    if evidence.is_flat[0] != evidence.is_flat[1] {
        word = Grade::Poor;
        reasons.push(format!("the {flat} is flat, and the {other} is not"));
    }
    for ((text, good, fair), value) in limits.into_iter().zip(values) {
        if value <= good {
            continue;
        }
        let poor = value > fair || value.is_nan();
        word = word.max(if poor { Grade::Poor } else { Grade::Fair });
        doubt += ((value - good) / (fair - good)).powi(2);
        let shown = if value < 1.0 { format!("{value:.3}") } else { format!("{value:.0}") };
        reasons.push(format!("{} (good up to {good}, fair up to {fair})", text.replace("{}", &shown)));
    }
    if word == Grade::Fair && doubt > 1.0 {
        word = Grade::Poor;
        reasons.push(TOGETHER.to_owned());
    }
    (word, reasons)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(points: [[f64; 2]; 3]) -> [Vec3; 3] {
        points.map(|[x, y]| Vec3::new(x, y, 0.0))
    }

    #[test]
    fn singular_values_of_a_stretch_are_its_factors() {
        let before = triangle([[0.0, 0.0], [1.0, 0.2], [0.3, 1.1]]);
        let after = before.map(|p| Vec3::new(3.0 * p.x, 0.5 * p.y, 0.0));
        let [s1, s2] = singular_values(before, after).expect("area");
        assert!((s1 - 3.0).abs() < 1e-12 && (s2 - 0.5).abs() < 1e-12);
    }

    #[test]
    fn corners_change_by_shear_and_not_where_rows_are_drawn_out() {
        let mut mesh = crate::topology::tests::grid(6, 6, false, false);
        mesh.polygon_of = (0..mesh.triangles.len() as u32).map(|t| t / 2).collect();
        let changed =
            |map: &dyn Fn(&Vec3) -> Vec3| corner_change(&mesh, &mesh.positions.iter().map(map).collect::<Vec<_>>());
        assert!(changed(&|p| Vec3::new(4.0 * p.x, p.y, 0.0)) < 1e-9);
        let turned = std::f64::consts::FRAC_PI_6.tan();
        assert!((changed(&|p| Vec3::new(p.x + turned * p.y, p.y, 0.0)) - 30.0).abs() < 1e-9);
    }

    #[test]
    fn drawn_out_along_a_ring_rows_and_columns_stay_at_right_angles() {
        let before = triangle([[0.0, 0.0], [1.0, 0.2], [0.3, 1.1]]);
        // v rises along y.
        let rise = [0.2, 1.1];
        let sheared = |map: &dyn Fn(Vec3) -> Vec3| {
            let jacobian = jacobian(flat(before), flat(before.map(map))).expect("area");
            shear_deg(flat(before), jacobian, rise)
        };
        assert!(sheared(&|p| Vec3::new(p.x, 3.0 * p.y, 0.0)) < 1e-9);
        assert!((sheared(&|p| Vec3::new(p.x + p.y, p.y, 0.0)) - 45.0).abs() < 1e-9);
    }

    #[test]
    fn a_ring_may_be_longer_than_the_example() {
        let coverage = Coverage { uncovered_share: 0.0, features: 4, missing: 4 };
        let longer = MapMeasurements {
            cost: 0.9,
            modulus_log: 0.7,
            turned_share: 0.0,
            angle_p95_deg: 20.0,
            laid_angle_p95_deg: 22.0,
            coverage,
            is_flat: [false; 2],
            is_ring: true,
        };
        assert_eq!(verdict(&longer).0, Grade::Fair);
        assert_eq!(verdict(&MapMeasurements { modulus_log: 1.4, ..longer }).0, Grade::Poor);
        assert_eq!(verdict(&MapMeasurements { is_ring: false, ..longer }).0, Grade::Poor);
    }

    #[test]
    fn a_bad_match_is_called_poor_with_its_reason() {
        let good = MapMeasurements {
            cost: 0.05,
            modulus_log: 0.02,
            turned_share: 0.0,
            angle_p95_deg: 20.0,
            laid_angle_p95_deg: 22.0,
            coverage: Coverage { uncovered_share: 0.0, features: 4, missing: 0 },
            is_flat: [false; 2],
            is_ring: false,
        };
        assert_eq!(verdict(&good), (Grade::Good, Vec::new()));
        let (word, reasons) = verdict(&MapMeasurements { cost: 0.9, ..good });
        assert_eq!((word, reasons.len()), (Grade::Poor, 1));
        assert!(reasons[0].contains("0.900"), "{}", reasons[0]);
        assert_eq!(verdict(&MapMeasurements { laid_angle_p95_deg: 30.0, ..good }).0, Grade::Fair);
        let doubtful = MapMeasurements { cost: 0.3, ..good };
        assert_eq!(verdict(&doubtful).0, Grade::Fair);
        let (word, reasons) = verdict(&MapMeasurements { modulus_log: -0.35, ..doubtful });
        assert_eq!((word, reasons.last().map(String::as_str)), (Grade::Poor, Some(TOGETHER)), "doubts add up");
        let flat = |is_flat| verdict(&MapMeasurements { is_flat, ..good });
        assert_eq!((flat([true; 2]).0, flat([true, false]).0), (Grade::Good, Grade::Poor));
        assert_eq!(flat([false, true]).1, ["the scan is flat, and the example is not"]);
        let bare = Coverage { uncovered_share: 0.3, ..good.coverage };
        assert_eq!(verdict(&MapMeasurements { coverage: bare, ..good }).0, Grade::Poor);
    }

    #[test]
    fn what_is_known_before_a_map_settles_may_rule_out_that_it_is_good() {
        let judged = |cost, laid_angle_p95_deg, is_ring| {
            let coverage = Coverage { uncovered_share: 0.0, features: 4, missing: 0 };
            let (modulus_log, turned_share, angle_p95_deg, is_flat) = (0.0, 0.0, 20.0, [false; 2]);
            let all = MapMeasurements {
                cost,
                modulus_log,
                turned_share,
                angle_p95_deg,
                laid_angle_p95_deg,
                coverage,
                is_flat,
                is_ring,
            };
            verdict(&all).0 == Grade::Good
        };
        for (cost, angle) in [(0.1, 24.0), (0.13, 24.0), (0.1, 26.0), (0.9, 90.0)] {
            for is_ring in [false, true] {
                assert_eq!(may_be_good(cost, angle, is_ring), judged(cost, angle, is_ring), "{cost} {angle}");
            }
        }
    }

    #[test]
    fn a_distribution_knows_its_quantiles() {
        let d = distribution((0..=100).map(|k| (f64::from(k), 1.0)).collect(), 0.0, 100.0);
        assert_eq!((d.median, d.p95, d.max), (50.0, 95.0, 100.0));
        assert!((d.shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
