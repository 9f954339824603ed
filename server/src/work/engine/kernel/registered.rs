//! Registrations of the kernel, and the maps they make.

use super::super::{EngineError, Mapped, Opaque, Registration, Side};
use super::model::ModelInner;
use super::{fresh, internal};
use crate::pool::Stop;
use quadmuse_kernel::encode::index::{Location as Place, PlanarIndex};
use quadmuse_kernel::map::assemble::{Winding, assemble};
use quadmuse_kernel::map::{cross_map, edit};
use quadmuse_kernel::measure::{self, Distribution, Evidence};
use quadmuse_kernel::register::Entry;
use quadmuse_kernel::unfold::Chart;
use quadmuse_proto::{Constraint, ConstraintOrigin, Distortion, Flip, Histogram, Location, Verdict};
use std::sync::{Arc, OnceLock};

/// What a [`Registration`] of this engine holds.
#[derive(Clone, Debug)]
pub(super) struct Registered {
    /// The example against the query.
    pub(super) entry: Entry,
    /// After an edit: the registration with the caller's constraints, in place of the entry's best.
    pub(super) edited: Option<quadmuse_kernel::register::Registration>,
    /// Ids and origins of the constraints, in their order; empty until the first map.
    pub(super) names: Vec<(String, ConstraintOrigin)>,
    /// The query's surface unfolded with the poles of this registration, made with the first map.
    pub(super) input: Arc<OnceLock<Surface>>,
}

/// A chart that points can be located on.
#[derive(Debug)]
pub(super) struct Surface {
    /// The chart.
    pub(super) chart: Arc<Chart>,
    /// Its planar index.
    pub(super) index: PlanarIndex,
}

impl Registered {
    /// The registration to map with.
    pub(super) fn registration(&self) -> &quadmuse_kernel::register::Registration {
        self.edited.as_ref().unwrap_or(&self.entry.best().registration)
    }

    /// The query's surface for this registration.
    pub(super) fn surface(&self, query: &Side) -> Result<&Surface, EngineError> {
        if self.input.get().is_none() {
            let chart =
                fresh(&query.encoded.encoding)?.chart_for(&self.entry.best().unfolded.poles).map_err(internal)?;
            let index = PlanarIndex::new(&chart);
            let _ = self.input.set(Surface { chart, index });
        }
        self.input.get().ok_or_else(|| EngineError::Internal("expected the surface just made".into()))
    }

    /// Names of the constraints: those given, and one for each control that has none.
    pub(super) fn named(&self) -> Vec<(String, ConstraintOrigin)> {
        let count = self.registration().p.len();
        let mut names = self.names.clone();
        names.truncate(count);
        names.extend((names.len()..count).map(|k| (format!("f{k}"), ConstraintOrigin::Feature)));
        names
    }
}

/// A registration of an entry, unless its computation was stopped half-way.
pub(super) fn checked(entry: Entry, stop: &Stop) -> Result<Registration, EngineError> {
    if let Some(reason) = stop.reason() {
        return Err(reason.into());
    }
    Ok(describe(Registered { entry, edited: None, names: Vec::new(), input: Arc::default() }))
}

/// The registration as the service sees it.
pub(super) fn describe(registered: Registered) -> Registration {
    let best = registered.registration();
    Registration {
        level: registered.entry.side() as u32,
        energy: best.energy,
        flip: Flip { u: best.flip.u, v: best.flip.v },
        shift_u: best.shift_u(),
        inner: Opaque::new(registered),
    }
}

/// Maps every vertex of the example's segment.
pub(super) fn map(from: &Registration, example: &Side, query: &Side, stop: &Stop) -> Result<Mapped, EngineError> {
    let registered: &Registered = from.inner.open()?;
    let input = registered.surface(query)?;
    stop.reason().map_or(Ok(()), |reason| Err(EngineError::Stopped(reason)))?;
    let model: &ModelInner = example.model.inner.open()?;
    let patch = model.patch(example.segment)?;
    let chart = &fresh(&example.encoded.encoding)?.chart;
    let registration = registered.registration();
    let cross = cross_map(registration, chart, &input.chart, &input.index);
    let mirrored = registration.flip.is_mirror();
    let winding = if mirrored { Winding::Reversed } else { Winding::Kept };
    let prepared = &model.prepared;
    let mesh = assemble(&example.model.mesh, &prepared.mesh, &prepared.vertex_of, patch, &cross.positions, winding);
    let sign = if mirrored { -1.0 } else { 1.0 };
    let distortion = measure::distortion(&patch.mesh, &cross.positions, &cross.locations, &input.chart, sign);
    let evidence = Evidence {
        cost: registered.entry.best().cost(),
        modulus_log: (chart.modulus / input.chart.modulus).ln(),
        turned_share: distortion.turned_faces as f64 / distortion.faces.max(1) as f64,
        angle_p95_deg: distortion.angle_deg.p95,
    };
    let (word, reasons) = measure::verdict(&evidence);
    let named = registered.named();
    Ok(Mapped {
        mesh: Arc::new(mesh),
        constraints: constraints(registration, &named, chart, fresh(&example.encoded.encoding)?, input),
        registration: describe(Registered { names: named, ..registered.clone() }),
        folds: distortion.turned_faces as u64,
        // Every vertex is a point of a triangle of the input.
        distance_max: 0.0,
        distortion: Distortion {
            angle: histogram(&distortion.angle_deg, distortion.faces),
            area: histogram(&distortion.area_log2, distortion.faces),
        },
        verdict: match word {
            measure::Verdict::Good => Verdict::Good,
            measure::Verdict::Fair => Verdict::Fair,
            measure::Verdict::Poor => Verdict::Poor,
        },
        reasons,
    })
}

fn constraints(
    registration: &quadmuse_kernel::register::Registration,
    named: &[(String, ConstraintOrigin)],
    example: &Chart,
    query: &quadmuse_kernel::register::Query,
    input: &Surface,
) -> Vec<Constraint> {
    let at =
        |chart: &Chart, place: Place, uv: [f64; 2]| Location { point: place.point(chart).into(), u: uv[0], v: uv[1] };
    edit::constraints(registration)
        .into_iter()
        .zip(named)
        .map(|((p, q), (id, origin))| Constraint {
            id: id.clone(),
            on_example: at(example, query.index().locate(example, p), p),
            on_input: at(&input.chart, input.index.locate(&input.chart, q), q),
            origin: *origin,
        })
        .collect()
}

fn histogram(from: &Distribution, faces: usize) -> Histogram {
    let n = from.shares.len();
    let edge = |k: usize| from.low + (from.high - from.low) * k as f64 / n as f64;
    Histogram {
        edges: (0..=n).map(edge).collect(),
        counts: from.shares.iter().map(|share| (share * faces as f64).round() as u64).collect(),
        mean: from.mean,
        median: from.median,
        p95: from.p95,
        max: from.max,
    }
}
