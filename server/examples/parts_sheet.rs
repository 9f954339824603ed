//! Cuts meshes into parts, and tells and draws them: `parts_sheet OUT_DIR [--parts N|auto] [--side PIXELS] FILE…`.
//!
//! One line a file: triangles, genus and loops, parts by kind, the smallest part's share of the area, seconds; and a
//! picture of the parts from two sides in OUT_DIR. Ends with 1 if a manifold file could not be cut.

use std::time::Instant;

use quadmuse_kernel::mesh::{self, Format, Limits, PolyMesh};
use quadmuse_kernel::segment::{PartCount, Segmented, segment};
use quadmuse_kernel::topology::{self, Topology};
use quadmuse_kernel::unfold::{UnfoldOptions, unfold};
use quadmuse_server::work::picture::{Paint, Picture, Poles, View, Wires, render, side_by_side_captioned};

fn main() -> std::io::Result<()> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut flag = |name: &str| {
        let at = arguments.iter().position(|a| a == name)?;
        let value = arguments.get(at + 1).cloned();
        arguments.drain(at..(at + 2).min(arguments.len()));
        value
    };
    let parts = match flag("--parts") {
        None => PartCount::AsNeeded,
        Some(word) => word.parse().map_or(PartCount::Protrusions, PartCount::About),
    };
    let side = flag("--side").and_then(|s| s.parse().ok()).unwrap_or(360u32);
    let Some((out, files)) = arguments.split_first() else { return Ok(()) };
    std::fs::create_dir_all(out)?;
    println!(
        "| mesh | triangles | components | genus | loops | parts | discs | annuli | whole | smallest % | unfold flips | s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    let (mut failures, mut strips) = (0, Vec::new());
    for file in files {
        let name =
            std::path::Path::new(file).file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        match row(file, &name, parts, side, &mut strips) {
            Ok(row) => println!("{row}"),
            Err(why) => {
                println!("| {name} | {why} |");
                failures += usize::from(!why.starts_with("refused"));
            }
        }
    }
    println!("{failures} failures");
    for (k, strips) in strips.chunks(12).enumerate() {
        std::fs::write(format!("{out}/parts-{k}.png"), sheet(strips).to_png())?;
    }
    std::process::exit(i32::from(failures > 0));
}

fn row(file: &str, name: &str, parts: PartCount, side: u32, strips: &mut Vec<Picture>) -> Result<String, String> {
    let bytes = std::fs::read(file).map_err(|e| format!("refused: {e}"))?;
    let poly = mesh::read(&bytes, Format::sniff(&bytes), &Limits::default()).map_err(|e| format!("refused: {e}"))?;
    let surface = mesh::prepare(&poly).map_err(|e| format!("refused: {e}"))?.mesh;
    let (_, components) = topology::components(&surface);
    let found = topology::invariants(&surface);
    let genus = (2 * components as i64 - found.boundary_loops as i64 - found.euler) / 2;
    let start = Instant::now();
    let cut = segment(&surface, parts).map_err(|e| format!("failed: {e}"))?;
    let seconds = start.elapsed().as_secs_f64();
    let wrong = cut.parts.iter().filter(|p| topology::classify(&p.mesh) != Ok(p.topology)).count();
    if wrong > 0 {
        return Err(format!("failed: {wrong} of {} parts are no primitives", cut.parts.len()));
    }
    let of = |t: Topology| cut.parts.iter().filter(|p| p.topology == t).count();
    let total = surface.total_area();
    let smallest = cut.parts.iter().map(|p| p.mesh.total_area() / total).fold(1.0, f64::min);
    let mut flips = 0;
    for part in cut.parts.iter().filter(|p| p.topology != Topology::Torus) {
        let chart = unfold(part, &UnfoldOptions::default()).map_err(|e| format!("failed: part not unfolded: {e}"))?;
        flips += chart.report.uv_flips;
        if chart.report.uv_flips > 100 {
            eprintln!(
                "{name}: {} of {} triangles, {} flips",
                part.topology,
                part.mesh.triangles.len(),
                chart.report.uv_flips
            );
        }
    }
    strips.push(draw(&cut, name, side));
    Ok(format!(
        "| {name} | {} | {components} | {genus} | {} | {} | {} | {} | {} | {:.2} | {flips} | {seconds:.2} |",
        surface.triangles.len(),
        found.boundary_loops,
        cut.parts.len(),
        of(Topology::Disc),
        of(Topology::Annulus),
        of(Topology::Sphere) + of(Topology::Torus),
        100.0 * smallest,
    ))
}

fn draw(cut: &Segmented, name: &str, side: u32) -> Picture {
    let mut mesh = PolyMesh {
        positions: cut.mesh.positions.clone(),
        faces: cut.mesh.triangles.iter().map(|t| &t[..]).collect(),
        ..PolyMesh::default()
    };
    mesh.attributes.segments = Some(cut.part_of.iter().map(|&p| i64::from(p)).collect());
    let view = View { wires: Wires::Hidden, poles: Poles::Unmarked, paint: Paint::Segments, ..View::guess(&mesh) };
    let (front, back) =
        (render(&mesh, &view, side), render(&mesh, &view.turned(view.yaw + std::f64::consts::PI, 0.3), side));
    side_by_side_captioned(&[(&front, name), (&back, "")])
}

/// Pictures beside and below each other.
fn sheet(strips: &[Picture]) -> Picture {
    let width = strips.iter().map(Picture::width).max().unwrap_or(1);
    let height = strips.iter().map(Picture::height).max().unwrap_or(1);
    let columns = if strips.len() > 1 { 2 } else { 1 };
    let mut sheet = Picture::filled(columns * width, strips.len().div_ceil(2) as u32 * height, [244; 3]);
    for (k, strip) in strips.iter().enumerate() {
        sheet.paste(strip, (k as u32 % columns) * width, (k as u32 / columns) * height);
    }
    sheet
}
