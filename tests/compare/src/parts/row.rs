//! What became of a mesh.

use quadmuse_kernel::mesh::TriMesh;
use quadmuse_kernel::segment::{PartCount, Segmented, segment};
use quadmuse_kernel::topology::{self, Topology};
use std::time::Instant;

/// A surface cut in one way.
#[derive(Clone, Debug)]
pub struct Row {
    /// Components, boundary loops and handles of the surface.
    pub shape: [usize; 3],
    /// Its triangles.
    pub triangles: usize,
    /// Seconds by the clock.
    pub seconds: f64,
    /// The parts by kind, or why there are none.
    pub parts: Result<Kinds, String>,
}

/// How many parts there are of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kinds {
    /// Discs, annuli, spheres, tori.
    pub count: [usize; 4],
    /// Parts that are none of them, or other than they say.
    pub wrong: usize,
}

const KINDS: [Topology; 4] = [Topology::Disc, Topology::Annulus, Topology::Sphere, Topology::Torus];

/// Cuts a surface.
pub fn row(surface: &TriMesh, count: PartCount) -> Row {
    let begun = Instant::now();
    let cut = segment(surface, count);
    let seconds = begun.elapsed().as_secs_f64();
    let parts = cut.map(|cut| kinds(&cut)).map_err(|e| e.to_string());
    Row { shape: shape(surface), triangles: surface.triangles.len(), seconds, parts }
}

fn kinds(cut: &Segmented) -> Kinds {
    let mut kinds = Kinds::default();
    for part in &cut.parts {
        match KINDS.iter().position(|k| topology::classify(&part.mesh) == Ok(*k)) {
            Some(k) if part.topology == KINDS[k] => kinds.count[k] += 1,
            _ => kinds.wrong += 1,
        }
    }
    kinds
}

/// Components, boundary loops and handles.
fn shape(surface: &TriMesh) -> [usize; 3] {
    let (component, count) = topology::components(surface);
    let mut members = vec![Vec::new(); count];
    component.iter().enumerate().for_each(|(t, &c)| members[c as usize].push(t as u32));
    let mut shape = [count, 0, 0];
    for set in members {
        let found = topology::invariants(&topology::submesh(surface, &set).0);
        shape[1] += found.boundary_loops;
        shape[2] += found.genus.max(0) as usize;
    }
    shape
}

impl Row {
    /// Whether it failed: nothing, or something that is no primitive.
    pub fn failed(&self) -> bool {
        !matches!(&self.parts, Ok(kinds) if kinds.wrong == 0)
    }

    /// `parts (kinds) seconds`, as cells of a table.
    pub fn cells(&self, slow_s: f64) -> String {
        let slow = if self.seconds > slow_s { " slow" } else { "" };
        match &self.parts {
            Err(why) => format!("{why} | {:.2}{slow}", self.seconds),
            Ok(kinds) => {
                let [disc, annulus, sphere, torus] = kinds.count;
                let all: usize = kinds.count.iter().sum::<usize>() + kinds.wrong;
                let wrong = if kinds.wrong > 0 { format!(" wrong {}", kinds.wrong) } else { String::new() };
                format!("{all} ({disc} {annulus} {sphere} {torus}{wrong}) | {:.2}{slow}", self.seconds)
            }
        }
    }
}
