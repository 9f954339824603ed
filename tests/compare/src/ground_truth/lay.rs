//! Lays an example on an input by one of the methods, and measures how far off it is.

use super::case::Case;
use super::loaded::Loaded;
use super::method::Method;
use quadmuse_kernel::encode::index::PlanarIndex;
use quadmuse_kernel::map::atlas::Atlas;
use quadmuse_kernel::map::reembed::{InputChart, settle};
use quadmuse_kernel::map::snap::lines::SharpLines;
use quadmuse_kernel::map::snap::{SnapCounts, creases_on, snap};
use quadmuse_kernel::map::untangle::untangle;
use quadmuse_kernel::map::{CrossMap, cross_map, folded_faces};
use quadmuse_kernel::measure::coverage::{coverage, feature_points};
use quadmuse_kernel::measure::{self, BURDENED_DEG, Distortion, Grade, MapMeasurements};
use quadmuse_kernel::mesh::Vec3;
use quadmuse_kernel::register::entry::{Hypothesis, PROTRUSIONS_MANY};
use quadmuse_kernel::register::{Entry, Query, Solver};
use quadmuse_kernel::unfold::{Chart, UnfoldOptions};
use std::sync::OnceLock;
use std::time::Instant;

/// Level to which everything is registered.
const SIDE: usize = 128;

/// A map against the truth.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Median distance of a vertex from where it belongs, in % of √area of the input.
    pub median_pct: f64,
    /// 95th percentile of that.
    pub p95_pct: f64,
    /// Whether the map mirrors.
    pub mirrored: bool,
    /// Whether several charts made it.
    pub atlas: bool,
    /// Faces turned over in the domain and in space.
    pub folds: usize,
    /// What the verdict is made of.
    pub evidence: MapMeasurements,
    /// The verdict.
    pub verdict: Grade,
    /// Distortion as one number.
    pub badness: f64,
    /// What was snapped.
    pub snapped: SnapCounts,
    /// Mean distance of the example's sharp edges from the input's, in % of √area; `None` where one has none.
    pub edges_off_pct: Option<f64>,
    /// Seconds for unfolding both, registration, and mapping.
    pub seconds: [f64; 3],
}

struct UnmeasuredMap {
    cross: CrossMap,
    mirrored: bool,
    cost: f64,
    in_domain: Vec<u32>,
    distortion: Distortion,
    /// 95th percentile of the angle distortion before the polish.
    laid_angle_deg: f64,
    snapped: SnapCounts,
}

/// Maps a case by a method.
///
/// # Errors
/// What failed; a sentence.
pub fn lay(case: &Case, method: Method) -> Result<Outcome, String> {
    let Case { example, input, truth } = case;
    let truth = example.in_order_of(truth);
    let begun = Instant::now();
    let options = UnfoldOptions::default();
    let one = Query::new(&example.patch, &options).map_err(|e| e.to_string())?;
    let two = Query::new(&input.patch, &options).map_err(|e| e.to_string())?;
    let unfolded = Instant::now();
    let solver = method.solver();
    let mut entry = registered(&one, &two, method, solver.as_ref())?;
    let registered = Instant::now();
    let mut laid = by_chart(example, &one, &two, &entry, method)?;
    let burdened = laid.laid_angle_deg > BURDENED_DEG;
    if method.refines_poles() && two.protrusions().len() < PROTRUSIONS_MANY && burdened {
        unburden(example, &one, &two, &mut entry, method)?;
        laid = by_chart(example, &one, &two, &entry, method)?;
    }
    let mut atlas = false;
    if method.has_atlas()
        && let Some(other) = by_atlas(example, &one, &two, method)?
        && other.distortion.badness() < laid.distortion.badness()
    {
        (laid, atlas) = (other, true);
    }
    let badness = laid.distortion.badness();
    let seconds = [unfolded - begun, registered - unfolded, registered.elapsed()].map(|d| d.as_secs_f64());
    let folds = laid.in_domain.iter().filter(|f| laid.distortion.inward.binary_search(f).is_ok()).count();
    let evidence = MapMeasurements {
        cost: laid.cost,
        modulus_log: (one.chart.modulus / two.chart.modulus).ln(),
        turned_share: laid.distortion.inward.len() as f64 / laid.distortion.faces.max(1) as f64,
        angle_p95_deg: laid.distortion.angle_deg.p95,
        laid_angle_p95_deg: laid.laid_angle_deg,
        coverage: coverage(
            &example.patch.mesh,
            &laid.cross,
            &input.patch.mesh,
            &feature_points(&two.encoding().features, &two.chart, two.index()),
        ),
        is_flat: [example.patch.mesh.is_flat(), input.patch.mesh.is_flat()],
        is_ring: measure::is_ring(&one.chart),
    };
    let (verdict, _) = measure::verdict(&evidence);
    let [median_pct, p95_pct] = errors(&laid.cross.positions, &truth, input.patch.mesh.total_area());
    let edges_off_pct = edges_off(example, &laid.cross, input);
    let (mirrored, snapped) = (laid.mirrored, laid.snapped);
    Ok(Outcome {
        median_pct,
        p95_pct,
        mirrored,
        atlas,
        folds,
        evidence,
        verdict,
        badness,
        snapped,
        edges_off_pct,
        seconds,
    })
}

/// Where the vertices of the example's surface go on the input, as where the service cuts an input as an example is.
///
/// # Errors
/// What failed; a sentence.
pub fn positions(example: &Loaded, input: &Loaded) -> Result<Vec<Vec3>, String> {
    let (method, options) = (Method::NoSnap, UnfoldOptions::default());
    let one = Query::new(&example.patch, &options).map_err(|e| e.to_string())?;
    let two = Query::new(&input.patch, &options).map_err(|e| e.to_string())?;
    let entry = registered(&one, &two, method, method.solver().as_ref())?;
    let single = by_chart(example, &one, &two, &entry, method)?;
    let many = by_atlas(example, &one, &two, method)?;
    let better = many.filter(|m| m.distortion.badness() < single.distortion.badness());
    Ok(better.unwrap_or(single).cross.positions)
}

fn registered(one: &Query, two: &Query, method: Method, solver: &dyn Solver) -> Result<Entry, String> {
    let never = || false;
    let unlike = || "expected two surfaces of the same topology".to_owned();
    let mut entry = Entry::coarse(two, one.encoding(), solver, &never).ok_or_else(unlike)?;
    while entry.side() < SIDE {
        entry.advance(two, one.encoding(), solver, &never).map_err(|e| e.to_string())?;
    }
    if method.refines_poles() {
        entry.refine_poles(two, one.encoding(), solver, &never).map_err(|e| e.to_string())?;
    }
    Ok(entry)
}

/// Seeks the poles again where the map distorts much, as the service does.
fn unburden(example: &Loaded, one: &Query, two: &Query, entry: &mut Entry, method: Method) -> Result<(), String> {
    let burden = |h: &Hypothesis| measure::burden(&example.patch.mesh, &one.chart, two, h);
    let solver = method.solver();
    entry.unburden_poles(two, one.encoding(), solver.as_ref(), &burden, &|| false).map_err(|e| e.to_string())
}

fn by_chart(
    example: &Loaded,
    one: &Query,
    two: &Query,
    entry: &Entry,
    method: Method,
) -> Result<UnmeasuredMap, String> {
    let best = entry.best();
    let input = two.chart_for(&best.unfolded.poles).map_err(|e| e.to_string())?;
    let index = PlanarIndex::new(&input);
    let mut cross = cross_map(&best.registration, &one.chart, &input, &index);
    let mirrored = best.registration.flip.is_mirror();
    let sign = if mirrored { -1.0 } else { 1.0 };
    let laid_angle_deg = settled(method, example, &mut cross, &[InputChart { chart: &input, index: &index }], sign);
    let snapped = snapped(method, example, &mut cross, &input, sign);
    let distortion = measure::distortion(&example.patch.mesh, &cross, &input, sign);
    let in_domain = folded_faces(&best.registration, &one.chart, &example.patch.mesh);
    Ok(UnmeasuredMap { cross, mirrored, cost: best.cost(), in_domain, distortion, laid_angle_deg, snapped })
}

fn by_atlas(example: &Loaded, one: &Query, two: &Query, method: Method) -> Result<Option<UnmeasuredMap>, String> {
    let Some(atlas) = Atlas::build(one, two, method.solver().as_ref(), &|| false).map_err(|e| e.to_string())? else {
        return Ok(None);
    };
    let mut cross = atlas.cross_map(&[]).map_err(|e| e.to_string())?;
    let input = atlas.input().ok_or("expected an atlas with charts")?;
    let sign = if atlas.mirrored { -1.0 } else { 1.0 };
    let laid_angle_deg = settled(method, example, &mut cross, &atlas.grounds(), sign);
    let snapped = snapped(method, example, &mut cross, input, sign);
    let distortion = measure::distortion(&example.patch.mesh, &cross, input, sign);
    let in_domain = atlas.folded_faces(&example.patch.mesh);
    Ok(Some(UnmeasuredMap {
        cross,
        mirrored: atlas.mirrored,
        cost: atlas.mean_cost(),
        in_domain,
        distortion,
        laid_angle_deg,
        snapped,
    }))
}

fn snapped(method: Method, example: &Loaded, cross: &mut CrossMap, input: &Chart, sign: f64) -> SnapCounts {
    let given = creases_on(&example.poly.attributes.creases, &example.prepared.vertex_of, &example.patch);
    snap(&example.patch.mesh, &given, cross, input, sign, method.snaps())
}

/// Mean distance of the vertices on the example's sharp edges from the nearest sharp edge of the input, in % of √area.
fn edges_off(example: &Loaded, cross: &CrossMap, input: &Loaded) -> Option<f64> {
    let (own, mesh) = (SharpLines::of(&example.patch.mesh, &[]), &input.patch.mesh);
    let there = SharpLines::of(mesh, &[]);
    let ends = |h: &u32| [mesh.tail(*h), mesh.head(*h)].map(|v| mesh.positions[v as usize]);
    let segments: Vec<[Vec3; 2]> = there.edges.iter().map(ends).collect();
    let away = |x: &Vec3, [a, b]: &[Vec3; 2]| {
        let share = ((x - a).dot(&(b - a)) / (b - a).norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (a.lerp(b, share) - x).norm()
    };
    let nearest = |v: &u32| {
        let x = &cross.positions[*v as usize];
        segments.iter().map(|s| away(x, s)).fold(f64::INFINITY, f64::min)
    };
    let all: Vec<f64> = own.neighbours.keys().map(nearest).collect();
    let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
    (!all.is_empty() && mean.is_finite()).then(|| 100.0 * mean / mesh.total_area().sqrt())
}

/// Median and 95th percentile of the distances, in % of √area.
fn errors(mapped: &[Vec3], truth: &[Vec3], area: f64) -> [f64; 2] {
    let mut all: Vec<f64> = mapped.iter().zip(truth).map(|(a, b)| 100.0 * (a - b).norm() / area.sqrt()).collect();
    all.sort_by(f64::total_cmp);
    let at = |share: usize| all.get(all.len() * share / 100).copied().unwrap_or(f64::NAN);
    [at(50), at(95)]
}

/// Lets the map come to rest, as the service does. The 95th percentile of the angle distortion before that.
fn settled(method: Method, example: &Loaded, cross: &mut CrossMap, grounds: &[InputChart], sign: f64) -> f64 {
    let laid = measure::angle_distortion(&example.patch.mesh, cross).p95;
    if method.polishes() {
        settle(&example.patch.mesh, cross, grounds, sign);
    } else if let Some(ground) = grounds.first() {
        untangle(&example.patch.mesh, cross, ground.chart, sign, &OnceLock::new());
    }
    laid
}
