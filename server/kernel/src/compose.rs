//! Composition: parts laid on the segments of an input become one mesh of quads.
//!
//! *Source:* paper §6: merging along the boundaries, filling of holes, triangles resolved in pairs by surgery, doublets
//! removed, smoothing with back-projection. *Ours, not the paper's:* the boundaries are matched arc by arc ([`seam`]), and
//! success is certain: where a way fails the theorems of [`check`], the next coarser tool is taken ([`Way`]).

pub mod check;
pub mod glue;
pub mod layout;
pub mod net;
pub mod part;
pub mod resolve;
pub mod rim;
pub mod seam;
pub mod smooth;
pub mod subdivide;
pub mod surgery;
pub mod template;

#[cfg(test)]
mod tests;

use crate::mesh::tri::TriMesh;
use crate::mesh::{PolyMesh, Vec3};
use check::{Broken, Shape, check, extraordinary};
use glue::{Glued, Misfit, glue};
use layout::{Layout, layout};
use net::Net;
use resolve::{Resolved, resolve};
use smooth::{OPENING_ROUNDS, Plan, Target};

/// Times a part may be subdivided to fit its neighbours.
const SUBDIVISIONS_MAX: usize = 5;

/// The input, and which segment each of its triangles belongs to.
#[derive(Clone, Copy, Debug)]
pub struct Segmented<'a> {
    /// The surface.
    pub surface: &'a TriMesh,
    /// Segment of each triangle.
    pub owner: &'a [u32],
    /// Number of segments.
    pub count: usize,
}

/// How a composition came about; the first that succeeds is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Way {
    /// The parts as they are.
    Direct,
    /// Some parts subdivided once or more before stitching.
    PartsSubdivided,
    /// Everything subdivided once after stitching, in place of surgery: four times the quads.
    AllSubdivided,
    /// No part could be used: the input's own triangles, cut into three quads each.
    InputSubdivided,
}

/// What a composition did.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// How it came about.
    pub way: Way,
    /// Extraordinary vertices inside the parts, before stitching.
    pub extraordinary_before: usize,
    /// Extraordinary vertices of the result.
    pub extraordinary_after: usize,
    /// Pairs of vertices merged along seams.
    pub merged: usize,
    /// Faces that filled holes.
    pub filled: usize,
    /// What resolving triangles did.
    pub resolved: Resolved,
    /// How often each part was subdivided.
    pub subdivided: Vec<usize>,
    /// Segments whose part did not have their topology and was left out, with everything else, for the input's own mesh.
    pub unusable: Vec<usize>,
}

/// A composed mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Composed {
    /// The mesh: quads only, as [`check`] asks.
    pub mesh: PolyMesh,
    /// What was done.
    pub report: Report,
}

/// Why there is no composition.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ComposeError {
    /// Not one part a segment.
    #[error("expected a part for each of {expected} segments, found {found}")]
    Parts {
        /// Segments.
        expected: usize,
        /// Parts.
        found: usize,
    },
    /// Labels of other triangles.
    #[error("expected a segment for each of {expected} triangles, found {found}")]
    Owners {
        /// Triangles.
        expected: usize,
        /// Labels.
        found: usize,
    },
    /// Even the input's own triangles make no such mesh.
    #[error("the surface can't be made of quads: {0}")]
    Surface(#[from] Broken),
}

/// Stitches one part a segment, smooths `smoothing` rounds, and checks the result.
///
/// # Errors
/// [`ComposeError`]; none for one part a segment of a valid surface.
pub fn compose(input: Segmented<'_>, parts: &[PolyMesh], smoothing: u32) -> Result<Composed, ComposeError> {
    if parts.len() != input.count {
        return Err(ComposeError::Parts { expected: input.count, found: parts.len() });
    }
    if input.owner.len() != input.surface.triangles.len() {
        return Err(ComposeError::Owners { expected: input.surface.triangles.len(), found: input.owner.len() });
    }
    let plan = Stitching {
        layout: layout(input.surface, input.owner, input.count),
        shape: Shape::of(input.surface),
        target: Target::new(input.surface),
        surface: input.surface,
        smoothing,
    };
    let nets: Vec<Net> = parts.iter().enumerate().map(|(s, part)| plan.prepared(s, part)).collect();
    let before = parts.iter().map(extraordinary).sum();
    let mut report = Report {
        way: Way::Direct,
        extraordinary_before: before,
        extraordinary_after: 0,
        merged: 0,
        filled: 0,
        resolved: Resolved::default(),
        subdivided: vec![0; nets.len()],
        unusable: Vec::new(),
    };
    let mesh = match plan.by_parts(nets, &mut report) {
        Some(mesh) => mesh,
        None => plan.by_input(&mut report)?,
    };
    report.extraordinary_after = extraordinary(&mesh);
    Ok(Composed { mesh, report })
}

/// For each segment the mean length of boundary edges of the parts beside it; `None` where no neighbour has a part. What
/// a template takes as the length of its edges.
pub fn edges_beside(input: Segmented<'_>, parts: &[Option<&PolyMesh>]) -> Vec<Option<f64>> {
    let found = layout(input.surface, input.owner, input.count);
    let border = |mesh: &PolyMesh| {
        let net = Net::from_mesh(mesh);
        let loops = net.loops()?;
        let p = |v: u32| net.positions[v as usize];
        let lengths: Vec<f64> = loops
            .iter()
            .flat_map(|ring| (0..ring.len()).map(|k| (p(ring[(k + 1) % ring.len()]) - p(ring[k])).norm()))
            .collect();
        (!lengths.is_empty()).then(|| lengths.iter().sum::<f64>() / lengths.len() as f64)
    };
    let edge_of: Vec<Option<f64>> = parts.iter().map(|part| part.and_then(border)).collect();
    let mean = |of: &mut dyn Iterator<Item = f64>| {
        let (sum, n) = of.fold((0.0, 0.0), |(s, n), x| (s + x, n + 1.0));
        (n > 0.0).then(|| sum / n)
    };
    let overall = mean(&mut edge_of.iter().copied().flatten());
    (0..input.count)
        .map(|segment| {
            let other = |arc: &layout::Arc| match arc.sides[..] {
                [[a, ..], [b, ..]] if a as usize == segment => Some(b),
                [[a, ..], [b, ..]] if b as usize == segment => Some(a),
                _ => None,
            };
            let known = |s: u32| edge_of.get(s as usize).copied().flatten();
            mean(&mut found.arcs.iter().filter_map(other).filter_map(known)).or(overall)
        })
        .collect()
}

struct Stitching<'a> {
    layout: Layout,
    shape: Shape,
    target: Target,
    surface: &'a TriMesh,
    smoothing: u32,
}

impl Stitching<'_> {
    /// A part as a net, its faces turned as the segment's.
    fn prepared(&self, segment: usize, part: &PolyMesh) -> Net {
        let mut net = Net::from_mesh(part);
        let turned = || -> Option<bool> {
            let loops = net.loops()?;
            let curves = &self.layout.curves[segment];
            let curve_of = rim::pair_loops(&net, &loops, curves)?;
            let ring = loops.first()?;
            Some(rim::way(&net, ring, &curves[*curve_of.first()?]) == rim::Way::Against)
        };
        if turned() == Some(true) {
            let faces: Vec<(u32, Vec<u32>)> =
                net.faces().map(|(f, c)| (f, c.iter().rev().copied().collect())).collect();
            faces.into_iter().for_each(|(f, c)| net.set_face(f, c));
        }
        net
    }

    /// Tries the parts: as they are, then with those subdivided that don't fit, then with everything subdivided.
    fn by_parts(&self, mut nets: Vec<Net>, report: &mut Report) -> Option<PolyMesh> {
        loop {
            let culprits = match self.attempt(&nets, report) {
                Ok(mesh) => return Some(mesh),
                Err(Misfit::Loops { segment }) => {
                    report.unusable.push(segment);
                    return None;
                }
                Err(Misfit::TooCoarse { segment }) => vec![segment],
                Err(Misfit::Pinched { segments }) => segments,
            };
            report.way = report.way.max(Way::PartsSubdivided);
            let mut grown = false;
            for s in culprits {
                if report.subdivided.get(s).is_some_and(|&n| n < SUBDIVISIONS_MAX) {
                    nets[s] = self.subdivided(&nets[s]);
                    report.subdivided[s] += 1;
                    grown = true;
                }
            }
            if !grown {
                return None;
            }
        }
    }

    fn attempt(&self, nets: &[Net], report: &mut Report) -> Result<PolyMesh, Misfit> {
        let points: Vec<Vec3> = self.layout.junctions.iter().map(|&v| self.surface.positions[v as usize]).collect();
        let glued = glue(nets, &self.layout, &points)?;
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
        if let Some((mesh, resolved)) = self.by_surgery(glued.clone()) {
            report.resolved = resolved;
            return Ok(mesh);
        }
        let mesh = self.all_subdivided(&glued).ok_or_else(pinched)?;
        (report.way, report.resolved) = (Way::AllSubdivided, Resolved::default());
        Ok(mesh)
    }

    fn by_surgery(&self, mut glued: Glued) -> Option<(PolyMesh, Resolved)> {
        let resolved = resolve(&mut glued.net);
        glued.seam.extend(&resolved.touched);
        Some((self.finished(glued.net, &glued.seam)?, resolved))
    }

    fn all_subdivided(&self, glued: &Glued) -> Option<PolyMesh> {
        let old = glued.net.positions.len() as u32;
        let mut fine = self.subdivided(&glued.net);
        let mut resolved = Resolved::default();
        resolve::remove_doublets(&mut fine, &mut resolved);
        let mut touched = glued.seam.clone();
        touched.extend(resolved.touched);
        // New vertices beside seams belong to them.
        let beside: Vec<u32> = glued.seam.iter().flat_map(|&v| fine.neighbours(v)).filter(|&v| v >= old).collect();
        touched.extend(beside);
        self.finished(fine, &touched)
    }

    /// Subdivided, with the new vertices on the input.
    fn subdivided(&self, net: &Net) -> Net {
        let mut fine = subdivide::subdivide(net);
        for v in net.positions.len() as u32..fine.positions.len() as u32 {
            let p = fine.positions[v as usize];
            fine.positions[v as usize] = self.target.onto_surface(p);
        }
        fine
    }

    /// Smoothed and checked.
    fn finished(&self, mut net: Net, touched: &[u32]) -> Option<PolyMesh> {
        let (mesh, _) = net.clone().into_mesh();
        check::check_structure(&mesh, self.shape).ok()?;
        let plan = Plan::new(&net, touched);
        for &v in touched {
            if !net.at(v).is_empty() && !net.on_boundary(v) {
                net.positions[v as usize] = self.target.onto_surface(net.positions[v as usize]);
            }
        }
        for rounds in [OPENING_ROUNDS + self.smoothing, OPENING_ROUNDS, 4 * OPENING_ROUNDS] {
            plan.run(&mut net, &self.target, rounds);
            let (mesh, _) = net.clone().into_mesh();
            if check(&mesh, self.shape).is_ok() {
                return Some(mesh);
            }
        }
        None
    }

    /// The input's own triangles, cut into three quads each.
    fn by_input(&self, report: &mut Report) -> Result<PolyMesh, ComposeError> {
        report.way = Way::InputSubdivided;
        let faces = self.surface.triangles.iter().map(|t| t.to_vec()).collect();
        let net = subdivide::subdivide(&Net::new(self.surface.positions.clone(), faces));
        let (mesh, _) = net.into_mesh();
        check::check_structure(&mesh, self.shape)?;
        Ok(mesh)
    }
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

/// Whether the faces have distinct corners, share edges two by two, and form one fan at each vertex.
fn is_sound(net: &Net) -> bool {
    let distinct = |c: &[u32]| c.iter().enumerate().all(|(k, v)| !c[..k].contains(v));
    let (mesh, _) = net.clone().into_mesh();
    net.faces().all(|(_, c)| distinct(c))
        && check::edges_are_sound(&mesh)
        && (0..net.positions.len() as u32).all(|v| net.fan(v).is_some())
}
