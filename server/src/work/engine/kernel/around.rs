//! The input of a map that covers a part of it, cut along the map's rim.

use super::super::{EngineError, Mapped, Model, Opaque};
use super::continued;
use super::model::ModelInner;
use quadmuse_kernel::fit::within;
use quadmuse_kernel::mesh::{PolyMesh, prepare};
use quadmuse_kernel::segment::segment_around;
use std::sync::Arc;

/// More parts of the rest are a rag: none of them is worth a layout.
const PARTS_MAX: usize = 24;

/// The input of one segment cut along the rim of a map that lies on a part of it, and the map's own faces. What the map covers is
/// segment 0, the others are the rest. `None` where the map has no rim, nothing lies beyond it, or the rest is a rag.
pub(super) fn around(query: &Model, mapped: &Mapped) -> Result<Option<(Model, Arc<PolyMesh>)>, EngineError> {
    let on: &ModelInner = query.inner.open()?;
    let [patch] = &on.segmented.parts[..] else { return Ok(None) };
    let own = continued::own_faces(mapped).unwrap_or_else(|| Arc::clone(&mapped.mesh));
    let Ok(laid) = prepare(&own) else { return Ok(None) };
    let Some(field) = within(&laid.mesh, &laid.mesh.positions, &patch.mesh) else { return Ok(None) };
    let Ok(segmented) = segment_around(&patch.mesh, &field) else { return Ok(None) };
    if !(2..=PARTS_MAX).contains(&segmented.parts.len()) {
        return Ok(None);
    }
    let inner = ModelInner { segmented, parts: Vec::new(), is_part: true, laid: None, prepared: on.prepared.clone() };
    let segments = inner.segments();
    let cut = Model { segments, labels: None, besides: None, inner: Opaque::new(inner), ..query.clone() };
    Ok(Some((cut, own)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pool::Stop;
    use crate::work::engine::kernel::KernelEngine;
    use crate::work::engine::{Allowed, Cut, Engine, Part, Side, Stitching};
    use quadmuse_kernel::mesh::{Format, Polygons, Vec3, write};

    /// n × n quads of a dome over the square from `from` to `to` of the unit square.
    fn dome(n: u32, [from, to]: [f64; 2]) -> PolyMesh {
        let at = |k: u32| from + (to - from) * f64::from(k) / f64::from(n);
        let point = |(i, j): (u32, u32)| {
            let (x, y) = (at(i), at(j));
            Vec3::new(x, y, 4.0 * x * (1.0 - x) * y * (1.0 - y))
        };
        let quad = |(i, j): (u32, u32)| [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| j * (n + 1) + i);
        let mut faces = Polygons::default();
        (0..n).flat_map(|j| (0..n).map(move |i| (i, j))).for_each(|at| faces.push(&quad(at)));
        let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j))).map(point).collect();
        PolyMesh { positions, faces, ..PolyMesh::default() }
    }

    #[test]
    fn a_layout_on_a_part_of_a_scan_is_surrounded_by_quads_that_end_where_the_scan_does() {
        let (engine, stop) = (KernelEngine::default(), Stop::new(None));
        let bytes = write(&dome(48, [0.0, 1.0]), Format::Obj).expect("writable");
        let scan = engine.read(&bytes, None, &Cut::default(), &stop).expect("a disc");
        let encoded = Arc::new(engine.encode(&scan, 0, &stop).expect("encodable"));
        let side = Side { model: Arc::new(scan.clone()), segment: 0, encoded };
        let regular = engine.template(&side, &stop).expect("a layout");
        let part = Mapped { mesh: Arc::new(dome(10, [0.3, 0.7])), ..regular };
        let (cut, own) = engine.around(&scan, &part).expect("cut").expect("a rest");
        assert!(own == part.mesh, "the map's own faces");
        let regular = |segment| Part::Template(Arc::new(engine.encode(&cut, segment, &stop).expect("encodable")));
        let rest = (1..cut.segments.len() as u32).map(regular);
        let parts: Vec<Part> = [Part::Kept(own)].into_iter().chain(rest).collect();
        let how = Stitching { smoothing: 5, density: 0 };
        let made = engine.compose(&cut, &parts, how, &stop).expect("stitched");
        assert!(made.is_example[0] && !made.is_example[1..].contains(&true), "{:?}", made.is_example);
        assert!(made.mesh.faces.iter().all(|face| face.len() == 4) && made.mesh.faces.len() > 150);
        let found = engine.appraise(&cut, &made, Allowed::default()).expect("measured");
        assert!(found.flaws.is_empty() && found.covered > 0.99, "{found:?}");
        assert!((found.examples[0] - 0.2).abs() < 0.06, "{found:?}");
    }
}
