//! The stitching of what stands on the segments, again and again until it holds.

use super::check::{self, Broken, TopologyCounts, check, extraordinary};
use super::fit::MeasuredSurface;
use super::following::WHOLE_QUADS_MAX;
use super::glue::{Glued, Misfit, glue, rims};
use super::layout::{Layout, layout};
use super::net::Net;
use super::open::open_flat;
use super::plan::{SegmentBoundary, plan};
use super::resolve::{self, Resolved, resolve};
use super::rim::{LoopDirection, Rim, even_out};
use super::simplify_valence::ValenceSimplifier;
use super::site::{LayoutKind, ReplacementReason, Site, on_surface, way};
use super::smooth::{OPENING_ROUNDS, Plan, Target};
use super::subdivide::subdivide;
use super::{Input, Options, Piece, Report, Way};
use crate::map::snap::lines::sharp_edges;
use crate::mesh::tri::TriMesh;
use crate::mesh::{PolyMesh, Vec3};
use crate::numerics::stop;
use std::sync::{Arc, OnceLock};

/// Mean distance from which on a part or a result is subdivided, as a share of the diagonal of the input.
pub(super) const MISS_MAX: f64 = 0.0019;
/// The same where one example covers the whole input alone: its own vertices and faces are worth more.
pub(super) const KEPT_MISS_MAX: f64 = 0.005;

/// Tries in which one segment at a time gives way; afterwards all that are in the way give up at once. Each costs a stitching
/// of the whole, and a ragged input of dozens of segments would take hundreds.
const ATTEMPTS_MAX: usize = 24;
/// Times that all is stitched anew with what misses the input made finer.
const REFITTED_MAX: usize = 2;

/// A face of less than this share of the mean area has none, where a mesh is refused for such.
const FLAT_SHARE: f64 = 1e-4;
/// Faces are opened to this many times the area up to which they have none.
const HELD_AREAS: f64 = 4.0;

/// The size of an input, by which lengths and areas are measured.
#[derive(Clone, Copy, Debug)]
pub struct InputSize {
    /// Area of the whole input.
    pub area: f64,
    /// Diagonal of its bounding box.
    pub diagonal: f64,
}

pub(super) struct Stitching<'a> {
    input: Input<'a>,
    pub(super) options: Options,
    pub(super) layout: Layout,
    pub(super) shape: TopologyCounts,
    pub(super) target: Target,
    pub(super) measured: MeasuredSurface,
    pub(super) scale: InputSize,
    sharp: OnceLock<Vec<u32>>,
    /// The thread's count of steps from which on it is late.
    pub(super) late_at: u64,
}

impl<'a> Stitching<'a> {
    /// For an input that is measured by a scale: its own, or that of what it is a component of. From `late_at` steps of
    /// this thread on it is late.
    pub(super) fn new(input: Input<'a>, options: Options, scale: InputSize, late_at: u64) -> Self {
        let target = Target::new(input.surface);
        Self {
            layout: layout(input.surface, input.owner, input.count),
            shape: TopologyCounts::of(input.surface),
            measured: MeasuredSurface::with_tree(input.surface, Arc::clone(target.tree())),
            target,
            sharp: OnceLock::new(),
            late_at,
            scale,
            input,
            options,
        }
    }

    /// Whether as much work was done as a composition of these parts is worth: what holds is then not made better, and what
    /// does not hold gives up at once. Counted in steps, so that the result is the same on every machine.
    pub(super) fn is_late(&self) -> bool {
        stop::steps() >= self.late_at
    }

    pub(super) fn segments(&self) -> usize {
        self.input.count
    }

    /// The segment of a triangle.
    pub(super) fn owner_of(&self, triangle: u32) -> u32 {
        self.input.owner[triangle as usize]
    }

    pub(super) fn surface(&self) -> &'a TriMesh {
        self.input.surface
    }

    /// Stitches; what doesn't fit gives way, segment by segment, until everything does. `None` if nothing is left to try,
    /// or the caller asked to stop.
    pub(super) fn run(&self, pieces: &[Piece<'_>], report: &mut Report, stop: &dyn Fn() -> bool) -> Option<PolyMesh> {
        if stop() {
            return None;
        }
        let is_bare = pieces.iter().all(|piece| matches!(piece, Piece::Regular(..) | Piece::Nothing));
        if is_bare && let Some(mesh) = self.along_field(report) {
            return Some(mesh);
        }
        let all_gave_way = |sites: &[Site<'_>]| !is_bare && sites.iter().all(|site| site.stands == LayoutKind::Regular);
        let mut sites = self.sites(pieces);
        self.settle_density(&mut sites);
        let is_tried = all_gave_way(&sites);
        if is_tried && let Some(mesh) = self.in_place_of_all(pieces, &sites, report) {
            return Some(mesh);
        }
        let mesh = self.fitted(&mut sites, report, stop)?;
        if !is_tried
            && all_gave_way(&sites)
            && let Some(mesh) = self.in_place_of_all(pieces, &sites, report)
        {
            return Some(mesh);
        }
        self.tell(pieces, &sites, report);
        let mut made = self.stitched_near(mesh, &sites);
        for _ in 0..REFITTED_MAX {
            if stop() {
                return None;
            }
            if self.is_late() {
                break;
            }
            let missing = self.missing(&sites, &made);
            if missing.is_empty() {
                break;
            }
            missing.into_iter().for_each(|s| sites[s].refine(&self.target));
            let mut again = Report::default();
            let Some(mesh) = self.fitted(&mut sites, &mut again, stop) else { break };
            self.tell(pieces, &sites, &mut again);
            let finer = self.stitched_near(mesh, &sites);
            if !self.is_worth_while(made.laid.fit, finer.laid.fit) {
                break;
            }
            (made, *report) = (finer, again);
        }
        Some(self.followed(made, report))
    }

    /// The layout along a field where all that was brought gave way: templates on its segments would be worse.
    fn in_place_of_all(&self, pieces: &[Piece<'_>], sites: &[Site<'_>], report: &mut Report) -> Option<PolyMesh> {
        let mut anew = Report::default();
        let mesh = self.along_field(&mut anew)?;
        self.tell(pieces, sites, &mut anew);
        *report = anew;
        Some(mesh)
    }

    /// Stitches; what doesn't fit gives way.
    fn fitted(&self, sites: &mut [Site<'_>], report: &mut Report, stop: &dyn Fn() -> bool) -> Option<PolyMesh> {
        let mut attempts = 0;
        loop {
            if stop() || self.is_beyond_layout(sites) {
                return None;
            }
            attempts += 1;
            let culprits = match self.attempt(sites, report) {
                Ok(mesh) => return Some(mesh),
                Err(Misfit::Loops { segment }) => {
                    if !sites[segment].give_up(self.surface(), ReplacementReason::NotJoined) {
                        return None;
                    }
                    continue;
                }
                Err(Misfit::TooCoarse { segment }) => vec![segment],
                Err(Misfit::Pinched { segments }) => segments,
            };
            if attempts > ATTEMPTS_MAX || self.is_late() {
                if culprits.iter().filter(|&&s| sites[s].give_up(self.surface(), ReplacementReason::NotJoined)).count()
                    == 0
                {
                    return None;
                }
                continue;
            }
            let next = self.first_to_give_way(sites, &culprits)?;
            if !sites[next].give_way(self.surface(), &self.target) {
                return None;
            }
        }
    }

    /// Tells whether nothing stands but the input's own triangles, and these make more quads than a layout may have: smoothing and
    /// optimising them takes minutes, and makes no layout of them.
    fn is_beyond_layout(&self, sites: &[Site<'_>]) -> bool {
        let quads = || sites.iter().map(|site| site.net.faces().count()).sum::<usize>();
        sites.iter().all(|site| site.stands == LayoutKind::Own) && quads() > WHOLE_QUADS_MAX
    }

    fn sites<'p>(&self, pieces: &[Piece<'p>]) -> Vec<Site<'p>> {
        let nets: Vec<Net> = pieces
            .iter()
            .enumerate()
            .map(|(s, piece)| match piece {
                Piece::Mapped(mesh) | Piece::Kept(mesh) => self.prepared(s, mesh),
                Piece::Regular(..) | Piece::Nothing => Net::default(),
            })
            .collect();
        let edge = self.whole_edge();
        let sites = pieces.iter().zip(nets).enumerate();
        let mut sites: Vec<Site<'p>> =
            sites.map(|(s, (piece, net))| Site::new(self.input, s, *piece, net, edge)).collect();
        if self.is_late() {
            sites.iter_mut().for_each(Site::keep_plain);
        }
        sites
    }

    /// A part as a net, its faces turned as the segment's.
    fn prepared(&self, segment: usize, part: &PolyMesh) -> Net {
        let mut net = Net::from_mesh(part);
        if way(&net, &self.layout.curves[segment]) == Some(LoopDirection::Against) {
            let faces: Vec<(u32, Vec<u32>)> =
                net.faces().map(|(f, c)| (f, c.iter().rev().copied().collect())).collect();
            faces.into_iter().for_each(|(f, c)| net.set_face(f, c));
        }
        net
    }

    /// Of what is involved where the result is pinched, and can be made finer, that for which it takes the fewest quads; if
    /// none can, of all.
    fn first_to_give_way(&self, sites: &[Site<'_>], culprits: &[usize]) -> Option<usize> {
        let is_last = |s: &usize| !sites[*s].may_be_finer();
        let can = culprits.iter().copied().filter(|s| sites[*s].stands != LayoutKind::Own || !is_last(s));
        can.min_by(|a, b| is_last(a).cmp(&is_last(b)).then(sites[*a].quads_more().total_cmp(&sites[*b].quads_more())))
    }

    /// The boundaries of what is no regular layout, on the segments' curves.
    pub(super) fn given_rims(&self, sites: &[Site<'_>]) -> Result<Vec<Vec<Rim>>, Misfit> {
        let mut all = Vec::with_capacity(sites.len());
        for (segment, site) in sites.iter().enumerate() {
            all.push(match site.stands {
                LayoutKind::Regular => Vec::new(),
                LayoutKind::Part | LayoutKind::Own => rims(&site.net, &self.layout.curves[segment], segment)?,
            });
        }
        even_out(&mut all, &self.layout);
        Ok(all)
    }

    fn attempt(&self, sites: &mut [Site<'_>], report: &mut Report) -> Result<PolyMesh, Misfit> {
        let mut all = self.given_rims(sites)?;
        let sides: Vec<SegmentBoundary<'_>> = sites
            .iter()
            .zip(&all)
            .map(|(site, rims)| {
                if site.stands == LayoutKind::Regular {
                    SegmentBoundary::Free(site.wish)
                } else {
                    SegmentBoundary::Given(rims)
                }
            })
            .collect();
        let places = plan(&self.layout, &sides);
        let mut nets: Vec<Net> = Vec::with_capacity(sites.len());
        let mut is_coarser = false;
        for (segment, site) in sites.iter_mut().enumerate() {
            if site.stands != LayoutKind::Regular {
                nets.push(site.net.clone());
                continue;
            }
            let laid = site.lay_out(&self.layout.curves[segment], &places[segment]);
            let (net, rims) = laid.ok_or(Misfit::Loops { segment })?;
            is_coarser |= site.coarsen(&net, &places[segment]);
            nets.push(net);
            all[segment] = rims;
        }
        if is_coarser {
            // Each is asked once.
            return self.attempt(sites, report);
        }
        report.extraordinary_before = nets.iter().map(|net| extraordinary(&net.clone().into_mesh().0)).sum();
        let stands: Vec<LayoutKind> = sites.iter().map(|site| site.stands).collect();
        self.stitched(&nets, &stands, &all, report)
    }

    fn stitched(
        &self,
        nets: &[Net],
        stands: &[LayoutKind],
        rims: &[Vec<Rim>],
        report: &mut Report,
    ) -> Result<PolyMesh, Misfit> {
        let points: Vec<Vec3> = self.layout.junctions.iter().map(|&v| self.surface().positions[v as usize]).collect();
        let glued = glue(nets, rims, &self.layout, &points)?;
        (report.merged, report.filled) = (glued.merged, glued.filled);
        let pinched = || Misfit::Pinched { segments: (0..nets.len()).collect() };
        let faces: Vec<usize> = nets.iter().map(|net| net.faces().count()).collect();
        let culprits = culprits(&glued.net, &faces);
        if !culprits.is_empty() {
            return Err(Misfit::Pinched { segments: culprits });
        }
        if !is_sound(&glued.net) {
            return Err(pinched());
        }
        let free = free_faces(&glued, &faces, stands);
        match self.by_surgery(glued.clone(), free) {
            Ok((mesh, resolved)) => {
                report.resolved = resolved;
                return Ok(mesh);
            }
            // Subdividing all does not open what lies flat within one segment, as long as that can give way.
            Err(Unfinished::Flat { segments }) if segments.iter().any(|&s| stands.get(s) != Some(&LayoutKind::Own)) => {
                return Err(Misfit::Pinched { segments });
            }
            Err(_) => {}
        }
        let mesh = self.all_subdivided(&glued).ok_or_else(pinched)?;
        (report.way, report.resolved) = (Way::AllSubdivided, Resolved::default());
        Ok(mesh)
    }

    fn by_surgery(&self, mut glued: Glued, free: Vec<bool>) -> Result<(PolyMesh, Resolved), Unfinished> {
        let resolved = resolve(&mut glued.net);
        glued.seam.extend(&resolved.touched);
        let mut simplifier = ValenceSimplifier::new(glued.net.clone(), free, &self.target, glued.seam.clone());
        let simplified =
            if simplifier.run() > 0 { self.finished(simplifier.net, &simplifier.touched).ok() } else { None };
        let mesh = simplified.map_or_else(|| self.finished(glued.net, &glued.seam), Ok)?;
        Ok((mesh, resolved))
    }

    fn all_subdivided(&self, glued: &Glued) -> Option<PolyMesh> {
        let old = glued.net.positions.len() as u32;
        let mut fine = on_surface(subdivide(&glued.net), glued.net.positions.len(), &self.target);
        let mut resolved = Resolved::default();
        resolve::remove_doublets(&mut fine, &mut resolved);
        let mut touched = glued.seam.clone();
        touched.extend(resolved.touched);
        // New vertices beside seams belong to them.
        let beside: Vec<u32> = glued.seam.iter().flat_map(|&v| fine.neighbours(v)).filter(|&v| v >= old).collect();
        touched.extend(beside);
        self.finished(fine, &touched).ok()
    }

    /// Smoothed and checked.
    fn finished(&self, mut net: Net, touched: &[u32]) -> Result<PolyMesh, Unfinished> {
        let (mesh, _) = net.clone().into_mesh();
        check::check_structure(&mesh, self.shape).map_err(|_| Unfinished::Structure)?;
        let laid = net.positions.clone();
        let mut plan = Plan::new(&net, touched);
        for &v in touched {
            if !net.at(v).is_empty() && !net.on_boundary(v) {
                net.positions[v as usize] = self.target.onto_surface(net.positions[v as usize]);
            }
        }
        if self.checked(&net).1.is_err() {
            self.open_flat_faces(&mut net);
        }
        let rounds = OPENING_ROUNDS + self.options.smoothing;
        plan.run(&mut net, &self.target, rounds);
        if let (mesh, Ok(())) = self.checked(&net) {
            return Ok(mesh);
        }
        // Smoothed, vertices on a jagged border run together in its corners: there they stay as they were laid.
        plan.hold_border();
        for (v, &p) in laid.iter().enumerate() {
            if net.on_boundary(v as u32) {
                net.positions[v] = p;
            }
        }
        plan.run(&mut net, &self.target, rounds);
        if let (mesh, Ok(())) = self.checked(&net) {
            return Ok(mesh);
        }
        self.open_flat_faces(&mut net);
        match self.checked(&net) {
            (mesh, Ok(())) => Ok(mesh),
            (mesh, Err(Broken::NoArea(_))) => Err(Unfinished::Flat { segments: self.segments_of_flat_faces(&mesh) }),
            (_, Err(_)) => Err(Unfinished::Structure),
        }
    }

    /// A net as a mesh, and whether that holds.
    pub(super) fn checked(&self, net: &Net) -> (PolyMesh, Result<(), Broken>) {
        let (mesh, _) = net.clone().into_mesh();
        let holds = check(&mesh, self.shape);
        (mesh, holds)
    }

    /// The input's sharp edges, a halfedge of each.
    pub(super) fn sharp_edges(&self) -> &[u32] {
        self.sharp.get_or_init(|| sharp_edges(self.surface(), &[]))
    }

    /// The segment nearest to a point.
    pub(super) fn segment_at(&self, p: Vec3) -> Option<usize> {
        self.input.owner.get(self.target.triangle(p) as usize).map(|&s| s as usize)
    }

    /// The segments on which faces without area lie.
    fn segments_of_flat_faces(&self, mesh: &PolyMesh) -> Vec<usize> {
        let flat = check::flat_faces(mesh).into_iter().map(|f| mesh.faces.face(f));
        let middle = |c: &[u32]| c.iter().map(|&v| mesh.positions[v as usize]).sum::<Vec3>() / c.len().max(1) as f64;
        let mut segments: Vec<usize> = flat.filter_map(|c| self.segment_at(middle(c))).collect();
        segments.sort_unstable();
        segments.dedup();
        segments
    }

    /// Opens faces without area, off the input if need be.
    pub(super) fn open_flat_faces(&self, net: &mut Net) {
        let least = FLAT_SHARE * self.surface().total_area() / net.faces().count().max(1) as f64;
        open_flat(net, least, HELD_AREAS * check::no_area(self.scale.diagonal));
    }

    /// What each segment came to.
    fn tell(&self, pieces: &[Piece<'_>], sites: &[Site<'_>], report: &mut Report) {
        report.subdivided = sites.iter().map(|site| site.subdivided).collect();
        for (s, (site, piece)) in sites.iter().zip(pieces).enumerate() {
            match (site.stands, piece) {
                (LayoutKind::Regular, Piece::Mapped(_) | Piece::Kept(_)) => match site.given_up {
                    Some(ReplacementReason::TooDense) => report.too_dense.push(s),
                    Some(ReplacementReason::Missing) => report.missing.push(s),
                    Some(ReplacementReason::NotJoined) | None => report.replaced.push(s),
                },
                (LayoutKind::Own, _) => report.own.push(s),
                _ => {}
            }
        }
        if sites.iter().any(|site| site.given_up.is_some()) || !report.own.is_empty() {
            report.way = report.way.max(Way::PartsReplaced);
        } else if report.subdivided.iter().any(|&n| n > 0) {
            report.way = report.way.max(Way::PartsSubdivided);
        }
    }
}

/// Why stitched parts were not finished.
enum Unfinished {
    /// They are no such mesh.
    Structure,
    /// Faces have no area, whatever is smoothed, on these segments.
    Flat { segments: Vec<usize> },
}

/// Mean length of a part's boundary edges; `None` where it has none.
pub(super) fn border_edge(net: &Net) -> Option<f64> {
    let p = |v: u32| net.positions[v as usize];
    let lengths: Vec<f64> = net
        .loops()?
        .iter()
        .flat_map(|ring| (0..ring.len()).map(|k| (p(ring[(k + 1) % ring.len()]) - p(ring[k])).norm()))
        .collect();
    (!lengths.is_empty()).then(|| lengths.iter().sum::<f64>() / lengths.len() as f64)
}

/// The parts with a face at a vertex whose faces form no fan; the net's faces are those of the parts in their order, then
/// what fills holes.
fn culprits(net: &Net, faces: &[usize]) -> Vec<usize> {
    let mut ends = Vec::new();
    for n in faces {
        ends.push(ends.last().copied().unwrap_or(0) + n);
    }
    let bad = (0..net.positions.len() as u32).filter(|&v| net.fan(v).is_none());
    let mut found: Vec<usize> = bad
        .flat_map(|v| net.at(v).to_vec())
        .map(|f| ends.partition_point(|&end| end <= f as usize))
        .filter(|&s| s < faces.len())
        .collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// For each face of glued parts whether it may be changed: it belongs to no mapped example, or has a corner on a seam.
fn free_faces(glued: &Glued, faces: &[usize], stands: &[LayoutKind]) -> Vec<bool> {
    let mut on_seam = vec![false; glued.net.positions.len()];
    glued.seam.iter().for_each(|&v| on_seam[v as usize] = true);
    let of_part = faces.iter().zip(stands).flat_map(|(&count, &use_)| std::iter::repeat_n(use_, count));
    let has_seam = |f: usize| glued.net.face(f as u32).iter().any(|&v| on_seam[v as usize]);
    of_part.enumerate().map(|(f, stands)| stands != LayoutKind::Part || has_seam(f)).collect()
}

/// Whether the faces have distinct corners, share edges two by two, and form one fan at each vertex.
fn is_sound(net: &Net) -> bool {
    let distinct = |c: &[u32]| c.iter().enumerate().all(|(k, v)| !c[..k].contains(v));
    let (mesh, _) = net.clone().into_mesh();
    net.faces().all(|(_, c)| distinct(c))
        && check::edges_are_sound(&mesh)
        && (0..net.positions.len() as u32).all(|v| net.fan(v).is_some())
}
