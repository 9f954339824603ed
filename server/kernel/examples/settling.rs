//! How long a cancellation waits while an example settles on an input, with its boundary free.
//!
//! `settling EXAMPLE INPUT…`: poses are sought for the example on each input, and the best few are settled, as a map does
//! where pictures tell nothing. Standard error has the waits, in processor time, and where the long ones ended.

#[path = "compose/asked.rs"]
mod asked;

use quadmuse_kernel::fit::places::{PlaceSearch, Start};
use quadmuse_kernel::mesh::{self, Format, Limits, TriMesh};
use quadmuse_kernel::numerics::stop::Stop;
use quadmuse_kernel::settle::{Thoroughness, poses};
use std::path::Path;
use std::sync::Arc;

/// Poses that are settled.
const POSED: usize = 3;

fn surface(name: &str) -> Option<Arc<TriMesh>> {
    let format = Path::new(name).extension().and_then(|e| e.to_str()).and_then(Format::from_extension);
    let poly = mesh::read(&std::fs::read(name).ok()?, format, &Limits::default()).ok()?;
    Some(mesh::prepare(&poly).ok()?.mesh)
}

fn settled(example: &TriMesh, input: &TriMesh, stopped: Stop<'_>) -> Option<f64> {
    let mut search = PlaceSearch::new(example, input)?;
    for (_, pose) in poses(example, input, [true, true], Thoroughness::Thoroughly, stopped).iter().take(POSED) {
        let positions = example.positions.iter().map(|x| pose.apply(x)).collect();
        search.tries(&Start { positions, mirrored: false, apart: 0.0 }, stopped);
    }
    Some(search.settle_best(|_| true, stopped)?.evidence.relief)
}

fn main() {
    let names: Vec<String> = std::env::args().skip(1).collect();
    let Some((example, inputs)) = names.split_first() else { return };
    let Some(example) = surface(example) else { return eprintln!("expected a mesh, found none in {example}") };
    for name in inputs {
        let Some(input) = surface(name) else {
            eprintln!("expected a mesh, found none in {name}");
            continue;
        };
        let (relief, gaps) = asked::asked(|stopped| settled(&example, &input, stopped));
        println!("{name}: {} triangles, relief {relief:?}", input.triangles.len());
        gaps.tell(name);
    }
}
