//! Unfolds every real surface there is that one chart can hold: scans and artists' meshes.
//!
//! `cargo test --release -p quadmuse-kernel --test kernel unfolding -- --nocapture` prints the table of tests/records. The
//! meshes lie outside of the project, in `../shared/meshes` or where `QUADMUSE_SHARED` says.

use crate::folder;
use quadmuse_kernel::mesh::{self, Format, Limits};
use quadmuse_kernel::topology::{self, Components};
use quadmuse_kernel::unfold::{UnfoldOptions, unfold};
use std::path::{Path, PathBuf};

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).expect("a readable folder").map(|entry| entry.expect("readable").path()).collect();
    files.retain(|path| path.extension().and_then(|e| e.to_str()).and_then(Format::from_extension).is_some());
    files.sort();
    files
}

#[test]
fn nearly_every_primitive_surface_is_unfolded() {
    let (mut primitive, mut failed) = (0, Vec::new());
    for kind in ["scans", "quads"] {
        let Some(folder) = folder(kind) else { return };
        println!(
            "| {kind} | what | triangles | components left out | holes filled | added | flips | clamped | uv flips | angle |"
        );
        for path in files(&folder) {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let format = path.extension().and_then(|e| e.to_str()).and_then(Format::from_extension);
            let bytes = std::fs::read(&path).expect("a readable file");
            let prepared = match mesh::read(&bytes, format, &Limits::default()).and_then(|poly| mesh::prepare(&poly)) {
                Ok(prepared) => prepared,
                Err(error) => {
                    println!("| {name} | not read: {error} |");
                    continue;
                }
            };
            let patch = match topology::primitive(&prepared.mesh, Components::Largest) {
                Ok(patch) => patch,
                Err(error) => {
                    println!("| {name} | {error} |");
                    continue;
                }
            };
            primitive += 1;
            match unfold(&patch, &UnfoldOptions::default()) {
                Ok(chart) => {
                    let (r, n) = (chart.report, patch.mesh.triangles.len());
                    let flips = 100.0 * r.uv_flips as f64 / chart.corners.len() as f64;
                    println!(
                        "| {name} | {} | {n} | {} | {} | {} | {} | {} | {flips:.3} % | {:.1}° |",
                        patch.topology,
                        patch.left_out,
                        patch.holes.len(),
                        r.vertices_added,
                        r.flips,
                        r.clamped,
                        r.angle_deviation_deg
                    );
                    let sound = chart.uv.iter().flatten().all(|x| x.is_finite()) && chart.modulus.is_finite();
                    if !sound {
                        failed.push(format!("{name}: not finite"));
                    }
                }
                Err(error) => failed.push(format!("{name}: {error}")),
            }
        }
    }
    println!("{primitive} surfaces, {} failed: {failed:?}", failed.len());
    assert!(1000 * failed.len() <= 5 * primitive, "{failed:?}");
}
