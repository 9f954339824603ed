//! Measures meshes against the surfaces that they were laid on, and says which are broken.
//!
//! `sound [INPUT MESH]…`: one line a pair. The table in tests/records/ is made of these.

use quadmuse_kernel::measure::sound::ReferenceSurface;
use quadmuse_kernel::mesh::{self, Format, Limits, PolyMesh};
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    println!("| mesh | faces | astray % (edges, longest %) | off % | bare % | inward % | collapsed % |");
    println!("|---|---|---|---|---|---|---|");
    for pair in files.chunks_exact(2) {
        let (input, mesh) = (read(&pair[0])?, read(&pair[1])?);
        let grounds = ReferenceSurface::new(Arc::unwrap_or_clone(mesh::prepare(&input)?.mesh));
        let f = grounds.flaws(&mesh, &[]);
        let name = pair[1].rsplit('/').next().unwrap_or(&pair[1]);
        let [astray, off, bare, inward, collapsed] =
            [f.astray, f.off, f.bare, f.inward, f.collapsed].map(|share| format!("{:.2}", 100.0 * share));
        let (faces, edges) = (mesh.faces.len(), f.astray_edges);
        let longest = format!("{:.1}", 100.0 * f.spike);
        println!("| {name} | {faces} | {astray} ({edges}, {longest}) | {off} | {bare} | {inward} | {collapsed} |");
    }
    Ok(())
}

fn read(file: &str) -> Result<PolyMesh, Box<dyn std::error::Error>> {
    let bytes = std::fs::read(file)?;
    Ok(mesh::read(&bytes, Format::sniff(&bytes), &Limits::default())?)
}
