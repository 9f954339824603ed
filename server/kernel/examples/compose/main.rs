//! Cuts meshes, lays the best fitting part of some examples (or a regular layout) on each part, stitches, and tells.
//!
//! `compose OUT_DIR [--examples A.obj,B.obj,…] [--parts auto|N] FILE…`: one line a file, and OUT_DIR/NAME.obj to be judged
//! from outside. Ends with 1 if a mesh could not be composed. Standard error has the steps that composing took, and how
//! long a cancellation at a random moment would have waited, from reading on ([`asked`]).

mod asked;

use std::sync::{Arc, OnceLock};
use std::time::Instant;

use quadmuse_kernel::compose::{self, Options, Piece, apart, check, part, surface::ComposedSurface};
use quadmuse_kernel::encode::{Encoding, encode, index::PlanarIndex};
use quadmuse_kernel::map::{assemble::Winding, cross_map, untangle::untangle};
use quadmuse_kernel::mesh::{self, Format, Limits, PolyMesh, TriMesh};
use quadmuse_kernel::numerics::stop;
use quadmuse_kernel::rank::{SegmentShape, score};
use quadmuse_kernel::register::{Entry, LevenbergMarquardt, Query};
use quadmuse_kernel::segment::{PartCount, Segmented, segment};
use quadmuse_kernel::topology::Patch;
use quadmuse_kernel::unfold::{Chart, UnfoldOptions, unfold};

/// Registered so far before the best is chosen, and at the end, in pixels a side.
const SIDE: usize = 64;
/// Candidates that go on after the coarsest level.
const FINALISTS: usize = 3;
/// Relevance of every example.
const RELEVANCE: f64 = 3.0;

struct ExamplePart {
    name: String,
    patch: Patch,
    chart: Chart,
    encoding: Encoding,
}

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
    let names = flag("--examples").unwrap_or_default();
    let examples: Vec<ExamplePart> =
        names.split(',').filter(|n| !n.is_empty()).flat_map(|n| example(n, parts)).collect();
    let Some((out, files)) = arguments.split_first() else { return Ok(()) };
    std::fs::create_dir_all(out)?;
    println!(
        "| mesh | triangles | parts | of examples | quads | extraordinary before | after | way | merged | filled | cuts | strip quads | doublets | out / back % | s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    let mut failures = 0;
    for file in files {
        let start = Instant::now();
        let (made, gaps) = asked::asked(|stopped| one(file, parts, &examples, out, stopped));
        gaps.tell(file);
        match made {
            Ok(row) => println!("{row} {:.1} |", start.elapsed().as_secs_f64()),
            Err(why) => {
                failures += 1;
                println!("| {file} | {why} |");
            }
        }
    }
    println!("{failures} failures");
    std::process::exit(i32::from(failures > 0));
}

fn surface(file: &str) -> Result<Arc<TriMesh>, String> {
    let bytes = std::fs::read(file).map_err(|e| e.to_string())?;
    let poly = mesh::read(&bytes, Format::sniff(&bytes), &Limits::default()).map_err(|e| e.to_string())?;
    Ok(mesh::prepare(&poly).map_err(|e| e.to_string())?.mesh)
}

fn stem(file: &str) -> String {
    std::path::Path::new(file).file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}

/// The parts of an example that can be unfolded.
fn example(file: &str, parts: PartCount) -> Vec<ExamplePart> {
    let Ok(surface) = surface(file) else { return Vec::new() };
    let Ok(cut) = segment(&surface, parts).and_then(|free| free.between_polygons(&surface)) else { return Vec::new() };
    let made = cut.parts.into_iter().filter_map(|patch| {
        let chart = unfold(&patch, &UnfoldOptions::default()).ok()?;
        let encoding = encode(&chart);
        Some(ExamplePart { name: stem(file), patch, chart, encoding })
    });
    made.collect()
}

type Stopped<'a> = &'a (dyn Fn() -> bool + Sync);

fn one(
    file: &str,
    parts: PartCount,
    examples: &[ExamplePart],
    out: &str,
    stopped: Stopped<'_>,
) -> Result<String, String> {
    let surface = surface(file)?;
    let mended = Segmented::mended(&surface).filter(|_| parts == PartCount::AsNeeded);
    let cut = mended.map_or_else(|| segment(&surface, parts), Ok).map_err(|e| e.to_string())?;
    let ground = ComposedSurface::of(&cut);
    let input = ground.input();
    let laid: Vec<(Option<(String, PolyMesh)>, Option<Query>)> =
        cut.parts.iter().map(|patch| lay(patch, examples, stopped)).collect();
    let pieces: Vec<Piece<'_>> = laid.iter().map(piece_of).collect();
    let (steps, begun) = (stop::steps(), Instant::now());
    let made = compose::compose(input, &pieces, Options::default(), stopped).map_err(|e| e.to_string())?;
    let (steps, seconds) = (stop::steps() - steps, begun.elapsed().as_secs_f64());
    eprintln!("{file}: {steps} steps in {seconds:.1} s");
    check::check(&made.mesh, check::TopologyCounts::of(&apart::owned(input))).map_err(|e| e.to_string())?;
    let bytes = mesh::write(&made.mesh, Format::Obj).map_err(|e| e.to_string())?;
    std::fs::write(format!("{out}/{}.obj", stem(file)), bytes).map_err(|e| e.to_string())?;
    let r = &made.report;
    let mut used: Vec<&str> = laid.iter().filter_map(|l| l.0.as_ref().map(|m| m.0.as_str())).collect();
    let count = used.len();
    used.sort_unstable();
    used.dedup();
    Ok(format!(
        "| {} | {} | {} | {count} {} | {} | {} | {} | {:?} | {} | {} | {} | {} | {} | {:.3} / {:.3} |",
        stem(file),
        surface.triangles.len(),
        cut.parts.len(),
        used.join(" "),
        made.mesh.faces.len(),
        r.extraordinary_before,
        r.extraordinary_after,
        r.way,
        r.merged,
        r.filled,
        r.resolved.cuts,
        r.resolved.strip_quads,
        r.resolved.doublets,
        100.0 * r.fit.out,
        100.0 * r.fit.back,
    ))
}

fn piece_of(laid: &(Option<(String, PolyMesh)>, Option<Query>)) -> Piece<'_> {
    match laid {
        (Some((_, mesh)), _) => Piece::Mapped(mesh),
        (None, Some(query)) => Piece::Regular(&query.chart, query.index()),
        (None, None) => Piece::Nothing,
    }
}

/// The best example on a part, mapped; and the part, encoded, where it can be.
fn lay(patch: &Patch, examples: &[ExamplePart], stopped: Stopped<'_>) -> (Option<(String, PolyMesh)>, Option<Query>) {
    let made = Query::new(patch, &UnfoldOptions::default());
    let Ok(query) = made.inspect_err(|error| eprintln!("a part is not unfolded: {error}")) else { return (None, None) };
    let solver = LevenbergMarquardt::default();
    let mut entries: Vec<(f64, &ExamplePart, Entry)> = examples
        .iter()
        .filter(|e| e.patch.topology == patch.topology)
        .filter_map(|e| {
            let entry = Entry::coarse(&query, &e.encoding, &solver, stopped)?;
            Some((rated(&entry, e), e, entry))
        })
        .collect();
    entries.sort_by(|a, b| a.0.total_cmp(&b.0));
    entries.truncate(FINALISTS);
    for (rating, e, entry) in &mut entries {
        while entry.side() < SIDE && entry.advance(&query, &e.encoding, &solver, stopped).is_ok() {}
        *rating = rated(entry, e);
    }
    entries.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mapped = entries.first().and_then(|(_, e, entry)| {
        let best = entry.best();
        let input = query.chart_for(&best.unfolded.poles).ok()?;
        let registration = &best.registration;
        let mut cross = cross_map(registration, &e.chart, &input, &PlanarIndex::new(&input));
        let (mirror, winding) =
            if registration.flip.is_mirror() { (-1.0, Winding::Reversed) } else { (1.0, Winding::Kept) };
        untangle(&e.patch.mesh, &mut cross, &input, mirror, &OnceLock::new());
        Some((e.name.clone(), part::polygons(&e.patch.mesh, &cross.positions, winding)))
    });
    (mapped, Some(query))
}

fn rated(entry: &Entry, example: &ExamplePart) -> f64 {
    let best = entry.best();
    let shape = |modulus| SegmentShape { modulus, bending: None };
    score(best.cost(), shape(example.encoding.modulus), shape(best.unfolded.encoding.modulus), RELEVANCE)
}
