//! Registrations, and the maps they make.

use super::constraint::{Constraint, ConstraintOrigin, LocatedPoint};
use super::error::{PipelineError, Refusal, Stop, internal, stopped};
use super::from_whole::{PositionedMap, from_whole};
use super::mapped::{MapBeforeEdit, Mapped, Verdict};
use super::measured::{distortion, measured};
use super::settled::{Laying, PolishShift, settle};
use super::side::Side;
use crate::encode::index::{Location, PlanarIndex};
use crate::map::assemble::{Winding, assemble};
use crate::map::atlas::Atlas;
use crate::map::reembed::InputChart;
use crate::map::snap::{Snap, creases_on};
use crate::map::untangle::untangle;
use crate::map::{CrossMap, cross_map, edit, leave_fillings};
use crate::measure;
use crate::mesh::bvh::Bvh;
use crate::mesh::{PolyMesh, Vec3};
use crate::numerics::side_by_side;
use crate::register::entry::{Hypothesis, PROTRUSIONS_MANY};
use crate::register::{Entry, LevenbergMarquardt};
use crate::unfold::Chart;
use std::sync::{Arc, OnceLock};

/// An example laid on a query segment, at some level, with what was made for maps of it: clones share that.
#[derive(Clone, Debug)]
pub struct Registered {
    /// The example against the query.
    pub(crate) entry: Entry,
    /// After an edit: the registration with the caller's constraints, in place of the entry's best.
    pub(crate) edited: Option<crate::register::Registration>,
    /// Ids and origins of the constraints, in their order; empty until the first map.
    pub(crate) names: Vec<(String, ConstraintOrigin)>,
    /// The query's surface unfolded with the poles of this registration, made with the first map.
    pub(crate) input: Arc<OnceLock<IndexedChart>>,
    /// The example's tree of boxes, made with the first constraint that is given in space.
    pub(crate) example_bvh: Arc<OnceLock<Bvh>>,
    /// Where the surfaces have protrusions: the atlas that maps instead, made with the first map.
    pub(crate) atlas: Arc<OnceLock<Option<Atlas>>>,
    /// Where the query was cut as the example is: the map that the whole makes, made with the first map.
    pub(crate) of_whole: Arc<OnceLock<PositionedMap>>,
    /// With an atlas, or where the whole was laid: the caller's constraints, each with its name.
    pub(crate) pinned: Vec<(String, (Location, Location))>,
    /// Features that the caller removed from such a map. They hold nothing, and are not listed.
    pub(crate) removed: Vec<String>,
    /// Where the example settled anew to make room for constraints: the map before that.
    pub(crate) before_room: Option<Arc<OnceLock<PositionedMap>>>,
    /// Where the polish took the vertices of the first map.
    pub(crate) settled: Arc<OnceLock<PolishShift>>,
    /// Faces of the first map that look into the input where it spans gaps: they are no folds.
    pub(crate) turned_there: u64,
    /// After an edit: the map before the first one.
    pub(crate) unedited: Option<Arc<MapBeforeEdit>>,
}

/// A chart with its indices, so that points can be located on it.
#[derive(Debug)]
pub(crate) struct IndexedChart {
    /// The chart.
    pub(crate) chart: Arc<Chart>,
    /// Its planar index.
    pub(crate) index: PlanarIndex,
    /// Its tree of boxes, made with the first constraint that is given in space.
    pub(crate) bvh: OnceLock<Bvh>,
}

impl IndexedChart {
    /// Its tree of boxes.
    pub(crate) fn tree(&self) -> &Bvh {
        self.bvh.get_or_init(|| Bvh::new(&self.chart.mesh))
    }

    /// What vertices settle on.
    pub(crate) fn ground(&self) -> InputChart<'_> {
        InputChart { chart: &self.chart, index: &self.index }
    }
}

impl Registered {
    /// An entry of which nothing has been made yet.
    pub fn of(entry: Entry) -> Self {
        Self {
            entry,
            edited: None,
            names: Vec::new(),
            input: Arc::default(),
            example_bvh: Arc::default(),
            atlas: Arc::default(),
            of_whole: Arc::default(),
            pinned: Vec::new(),
            removed: Vec::new(),
            before_room: None,
            settled: Arc::default(),
            turned_there: 0,
            unedited: None,
        }
    }

    /// The example against the query.
    pub fn entry(&self) -> &Entry {
        &self.entry
    }

    /// The registration to map with.
    pub fn registration(&self) -> &crate::register::Registration {
        self.edited.as_ref().unwrap_or(&self.entry.best().registration)
    }

    /// The query's surface for this registration.
    pub(crate) fn surface(&self, query: &Side) -> Result<&IndexedChart, PipelineError> {
        if self.input.get().is_none() {
            let chart = query.encoded.query.chart_for(&self.entry.best().unfolded.poles).map_err(internal)?;
            let index = PlanarIndex::new(&chart);
            let _ = self.input.set(IndexedChart { chart, index, bvh: OnceLock::new() });
        }
        self.input.get().ok_or_else(|| PipelineError::Internal("expected the surface just made".into()))
    }

    /// The atlas, if these surfaces have one and it distorts less than a single chart does.
    pub(crate) fn atlas(&self, example: &Side, query: &Side, stop: Stop) -> Result<Option<&Atlas>, PipelineError> {
        if self.atlas.get().is_none() {
            let (one, two) = (&example.encoded.query, &query.encoded.query);
            let made = Atlas::build(one, two, &LevenbergMarquardt::default(), stop).map_err(internal)?;
            if stop() {
                return Ok(None);
            }
            let better = match &made {
                Some(atlas) => {
                    let distorts = |laid: Result<UnmeasuredMap<'_>, PipelineError>| distortion(&laid?, example);
                    let (many, single) = side_by_side(
                        || distorts(by_atlas(atlas, self, example, query)),
                        || distorts(by_chart(self, example, query)),
                    );
                    many?.badness() < single?.badness()
                }
                None => false,
            };
            let _ = self.atlas.set(made.filter(|_| better));
        }
        Ok(self.atlas.get().and_then(Option::as_ref))
    }

    /// Before the first map, where one chart maps and distorts much: this registration with its poles sought again.
    fn unburdened(&self, example: &Side, query: &Side, stop: Stop) -> Result<Option<Self>, PipelineError> {
        let is_first = self.edited.is_none() && self.names.is_empty() && self.settled.get().is_none();
        let (one, two) = (&example.encoded.query, &query.encoded.query);
        if !is_first || two.protrusions().len() >= PROTRUSIONS_MANY {
            return Ok(None);
        }
        let as_is = distortion(&by_chart(self, example, query)?, example)?;
        if as_is.angle_deg.p95 <= measure::BURDENED_DEG {
            return Ok(None);
        }
        let model = &*example.model;
        let mesh = &model.patch(example.segment)?.mesh;
        let burden = |h: &Hypothesis| measure::burden(mesh, &one.chart, two, h);
        let mut entry = self.entry.clone();
        entry.unburden_poles(two, one.encoding(), &LevenbergMarquardt::default(), &burden, stop).map_err(internal)?;
        Ok(Some(Self { entry, input: Arc::default(), atlas: Arc::default(), ..self.clone() }))
    }

    /// Names of the constraints: those given, and one for each control that has none.
    pub(crate) fn named(&self) -> Vec<(String, ConstraintOrigin)> {
        let count = self.registration().p.len();
        let mut names = self.names.clone();
        names.truncate(count);
        names.extend((names.len()..count).map(|k| (format!("f{k}"), ConstraintOrigin::Feature)));
        names
    }
}

/// A registration of an entry, unless its computation was stopped half-way.
pub(crate) fn checked(entry: Entry, stop: Stop) -> Result<Registered, PipelineError> {
    stopped(stop)?;
    Ok(Registered::of(entry))
}

/// What a map is made of before it is measured.
pub(crate) struct UnmeasuredMap<'a> {
    pub(crate) cross: CrossMap,
    /// Where the vertices go in a part to be stitched, with the boundary on the segment's, if that is elsewhere.
    pub(crate) as_part: Option<Vec<Vec3>>,
    /// What the example is laid by.
    pub(crate) way: LaidBy<'a>,
    /// The chart on whose mesh the vertices lie.
    pub(crate) input: &'a Chart,
    pub(crate) mirrored: bool,
    pub(crate) cost: f64,
    /// Log of the ratio of the moduli.
    pub(crate) modulus_log: f64,
    pub(crate) constraints: Vec<Constraint>,
    pub(crate) registered: Registered,
}

/// By what an example is laid.
#[derive(Clone, Copy)]
pub(crate) enum LaidBy<'a> {
    /// The registration of the two charts.
    Chart,
    /// A chart for each protrusion.
    Atlas(&'a Atlas),
    /// The map of the whole that the query was cut by.
    Whole,
}

/// An example that was laid whole.
pub(crate) struct LaidWhole {
    /// Where each vertex of the example's segment goes.
    pub(crate) positions: Vec<Vec3>,
    /// Its faces there.
    pub(crate) mesh: PolyMesh,
    /// Whether it lies mirrored.
    pub(crate) mirrored: bool,
    /// Cost of the registration, and log of the ratio of the moduli.
    pub(crate) cost: f64,
    pub(crate) modulus_log: f64,
}

/// Lays an example whole.
pub(crate) fn whole(from: &Registered, example: &Side, query: &Side, stop: Stop) -> Result<LaidWhole, PipelineError> {
    let atlas = from.atlas(example, query, stop)?;
    let (mut laid, _) = lay(atlas, from, example, query, stop)?;
    let positions = laid.cross.positions.clone();
    leave_fillings(&mut laid.cross, laid.input, f64::INFINITY);
    let mesh = assembled(&laid, example)?;
    Ok(LaidWhole { positions, mesh, mirrored: laid.mirrored, cost: laid.cost, modulus_log: laid.modulus_log })
}

/// Where the vertices of the example's segment go before they settle, and whether they lie mirrored.
pub(crate) fn start(
    from: &Registered,
    example: &Side,
    query: &Side,
    stop: Stop,
) -> Result<(Vec<Vec3>, bool), PipelineError> {
    let (laid, _) = unsettled(from.atlas(example, query, stop)?, from, example, query)?;
    Ok((laid.cross.positions, laid.mirrored))
}

/// The faces of the example's segment where it is laid, as its file has them.
pub(crate) fn assembled(laid: &UnmeasuredMap<'_>, example: &Side) -> Result<PolyMesh, PipelineError> {
    let model = &*example.model;
    let patch = model.patch(example.segment)?;
    let (surface, vertex_of) = (&model.segmented.mesh, &model.prepared.vertex_of);
    Ok(assemble(&example.model.mesh, surface, vertex_of, patch, &laid.cross.positions, winding(laid)))
}

pub(crate) fn winding(laid: &UnmeasuredMap<'_>) -> Winding {
    if laid.mirrored { Winding::Reversed } else { Winding::Kept }
}

/// Lays the example by the atlas, if there is one, and lets it settle. The number is the 95th percentile of the angle
/// distortion before that, in degrees.
pub(crate) fn lay<'a>(
    atlas: Option<&'a Atlas>,
    registered: &'a Registered,
    example: &Side,
    query: &Side,
    stop: Stop,
) -> Result<(UnmeasuredMap<'a>, f64), PipelineError> {
    stopped(stop)?;
    let (mut laid, angle_p95_deg) = unsettled(atlas, registered, example, query)?;
    settle_laid(&mut laid, atlas, registered, (example, query))?;
    Ok((laid, angle_p95_deg))
}

/// Lays the example by the atlas, if there is one, as [`lay`] does, but doesn't let it settle.
fn unsettled<'a>(
    atlas: Option<&'a Atlas>,
    registered: &'a Registered,
    example: &Side,
    query: &Side,
) -> Result<(UnmeasuredMap<'a>, f64), PipelineError> {
    let laid = match atlas {
        Some(atlas) => by_atlas(atlas, registered, example, query)?,
        None => by_chart(registered, example, query)?,
    };
    let patch = example.model.patch(example.segment)?;
    let angles = measure::layout_distortion(&patch.mesh, &laid.cross, &example.encoded.query.chart);
    Ok((laid, angles.p95))
}

/// Lets what was laid settle.
fn settle_laid(
    laid: &mut UnmeasuredMap<'_>,
    atlas: Option<&Atlas>,
    registered: &Registered,
    (example, query): (&Side, &Side),
) -> Result<(), PipelineError> {
    let model = &*example.model;
    let patch = model.patch(example.segment)?;
    let creases = creases_on(&example.model.mesh.attributes.creases, &model.prepared.vertex_of, patch);
    // Corners of a segment's boundary are where segments meet, and belong to the composition.
    let other = &*query.model;
    let is_whole = model.is_whole(example.segment) && other.is_whole(query.segment);
    let laying = Laying { mesh: &patch.mesh, creases, snap: if is_whole { Snap::All } else { Snap::Creases } };
    let grounds = match atlas {
        Some(atlas) => atlas.grounds(),
        None => vec![registered.surface(query)?.ground()],
    };
    settle(&registered.settled, &laying, &mut laid.cross, &grounds, sign(laid.mirrored), &laid.constraints);
    Ok(())
}

/// −1 for mirrored maps.
pub(crate) fn sign(mirrored: bool) -> f64 {
    if mirrored { -1.0 } else { 1.0 }
}

/// Log of the ratio of the moduli.
fn modulus_log(example: &Side, query: &Side) -> Result<f64, PipelineError> {
    let (one, two) = (&example.encoded.query, &query.encoded.query);
    Ok((one.chart.modulus / two.chart.modulus).ln())
}

/// Maps every vertex of the example's segment.
pub(crate) fn map(from: &Registered, example: &Side, query: &Side, stop: Stop) -> Result<Mapped, PipelineError> {
    let made = mapped(from, example, query, false, stop)?;
    made.ok_or_else(|| PipelineError::Internal("expected a map, good or not".into()))
}

/// The same if the map is [good](Verdict::Good): most that are not are known before they settle, which costs most.
pub(crate) fn good_map(
    from: &Registered,
    example: &Side,
    query: &Side,
    stop: Stop,
) -> Result<Option<Mapped>, PipelineError> {
    Ok(mapped(from, example, query, true, stop)?.filter(|mapped| mapped.verdict == Verdict::Good))
}

/// Maps; `None` where only a good map is wanted, and it can't be one.
fn mapped(
    from: &Registered,
    example: &Side,
    query: &Side,
    is_to_be_good: bool,
    stop: Stop,
) -> Result<Option<Mapped>, PipelineError> {
    if let Some((laid, angle_p95_deg)) = from_whole(from, example, query)? {
        return measured(laid, angle_p95_deg, from, example, query).map(Some);
    }
    let unburdened = from.unburdened(example, query, stop)?;
    let registered = unburdened.as_ref().unwrap_or(from);
    let atlas = registered.atlas(example, query, stop)?;
    stopped(stop)?;
    let (mut laid, angle_p95_deg) = unsettled(atlas, registered, example, query)?;
    let is_ring = measure::is_ring(&example.encoded.query.chart);
    if is_to_be_good && !measure::may_be_good(laid.cost, angle_p95_deg, is_ring) {
        return Ok(None);
    }
    settle_laid(&mut laid, atlas, registered, (example, query))?;
    measured(laid, angle_p95_deg, from, example, query).map(Some)
}

/// One chart with its registration.
fn by_chart<'a>(registered: &'a Registered, example: &Side, query: &Side) -> Result<UnmeasuredMap<'a>, PipelineError> {
    let input = registered.surface(query)?;
    let source = &example.encoded.query;
    let registration = registered.registration();
    let named = registered.named();
    let model = &*example.model;
    let mirror = sign(registration.flip.is_mirror());
    let mut cross = cross_map(registration, &source.chart, &input.chart, &input.index);
    let mesh = &model.patch(example.segment)?.mesh;
    untangle(mesh, &mut cross, &input.chart, mirror, &input.bvh);
    leave_fillings(&mut cross, &input.chart, f64::INFINITY);
    Ok(UnmeasuredMap {
        cross,
        as_part: None,
        way: LaidBy::Chart,
        input: &input.chart,
        mirrored: registration.flip.is_mirror(),
        cost: registered.entry.best().cost(),
        modulus_log: modulus_log(example, query)?,
        constraints: constraints(registration, &named, source, input),
        registered: Registered { names: named, ..registered.clone() },
    })
}

/// The caller's constraints on two charts.
pub(crate) fn pinned(registered: &Registered, example: &Chart, input: &Chart) -> Vec<Constraint> {
    let at = |chart: &Chart, place: &Location| {
        let [u, v] = place.uv(chart);
        LocatedPoint { point: place.point(chart).into(), u, v }
    };
    let pin = |(id, (a, b)): &(String, (Location, Location))| Constraint {
        id: id.clone(),
        on_example: at(example, a),
        on_input: at(input, b),
        origin: ConstraintOrigin::User,
    };
    registered.pinned.iter().map(pin).collect()
}

/// A chart for each protrusion. Its constraints are the matched tips, and what the caller pinned.
fn by_atlas<'a>(
    atlas: &'a Atlas,
    registered: &Registered,
    example_side: &Side,
    query: &Side,
) -> Result<UnmeasuredMap<'a>, PipelineError> {
    let pins: Vec<(Location, Location)> = registered.pinned.iter().map(|p| p.1).collect();
    let mut cross = atlas.cross_map(&pins).map_err(|e| {
        let which: Vec<&str> = registered.pinned.iter().map(|p| p.0.as_str()).collect();
        PipelineError::refused(Refusal::ConstraintFolds, format!("constraint {}: {e}", which.join(", ")))
    })?;
    let (Some(example), Some(input)) = (atlas.example(), atlas.input()) else {
        return Err(PipelineError::Internal("expected an atlas with charts".into()));
    };
    let model = &*example_side.model;
    let mirror = sign(atlas.mirrored);
    untangle(&model.patch(example_side.segment)?.mesh, &mut cross, input, mirror, &OnceLock::new());
    leave_fillings(&mut cross, input, f64::INFINITY);
    let at_vertex = |chart: &Chart, v: u32| LocatedPoint {
        point: chart.mesh.positions[v as usize].into(),
        u: chart.uv[v as usize][0],
        v: chart.uv[v as usize][1],
    };
    let tip = |(k, &(a, b)): (usize, &(u32, u32))| Constraint {
        id: format!("f{k}"),
        on_example: at_vertex(example, a),
        on_input: at_vertex(input, b),
        origin: ConstraintOrigin::Feature,
    };
    let tips = atlas.matches.iter().enumerate().map(tip);
    Ok(UnmeasuredMap {
        cross,
        as_part: None,
        way: LaidBy::Atlas(atlas),
        input,
        mirrored: atlas.mirrored,
        cost: atlas.mean_cost(),
        modulus_log: modulus_log(example_side, query)?,
        constraints: tips.chain(pinned(registered, example, input)).collect(),
        registered: registered.clone(),
    })
}

pub(crate) fn constraints(
    registration: &crate::register::Registration,
    named: &[(String, ConstraintOrigin)],
    example: &crate::register::Query,
    input: &IndexedChart,
) -> Vec<Constraint> {
    let at = |chart: &Chart, place: Location, uv: [f64; 2]| LocatedPoint {
        point: place.point(chart).into(),
        u: uv[0],
        v: uv[1],
    };
    edit::constraints(registration)
        .into_iter()
        .zip(named)
        .map(|((p, q), (id, origin))| Constraint {
            id: id.clone(),
            on_example: at(&example.chart, example.index().locate(&example.chart, p), p),
            on_input: at(&input.chart, input.index.locate(&input.chart, q), q),
            origin: *origin,
        })
        .collect()
}
