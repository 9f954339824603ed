//! Composition: small meshes spoilt at random, all of the way to regular layouts that are stitched.

use crate::dice::Dice;
use quadmuse_kernel::compose::{self, Options, Piece, surface::ComposedSurface};
use quadmuse_kernel::mesh::{self, PolyMesh, Vec3};
use quadmuse_kernel::numerics::stop;
use quadmuse_kernel::register::Query;
use quadmuse_kernel::segment::{PartCount, segment};
use quadmuse_kernel::unfold::UnfoldOptions;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What composition promises.
pub const PROMISE: &str =
    "a spoilt mesh is refused, or composed to one of finite vertices and sound faces, and either ends";

/// A mesh of a few dozen faces asks whether to go on so often at most: some millions of questions are minutes.
const ASKED_MAX: u64 = 4_000_000;

/// A sheet, a tube or a closed tube of a few dozen quads, bent at random.
fn sound(dice: &mut Dice) -> (Vec<Vec3>, Vec<Vec<u32>>) {
    let (columns, rows) = (3 + dice.below(7) as u32, 3 + dice.below(7) as u32);
    let [round, closed] = match dice.below(3) {
        0 => [false, false],
        1 => [true, false],
        _ => [true, true],
    };
    let across = if round { columns } else { columns + 1 };
    let down = if closed { rows } else { rows + 1 };
    let bend = dice.share();
    let at = |k: u32| {
        let (u, v) = (f64::from(k % across) / f64::from(columns), f64::from(k / across) / f64::from(rows));
        let (a, b) = (std::f64::consts::TAU * u, std::f64::consts::TAU * v);
        match (round, closed) {
            (false, _) => Vec3::new(u, v, bend * (5.0 * u).sin() * (4.0 * v).cos()),
            (true, false) => Vec3::new((1.0 + bend * b.sin()) * a.cos(), a.sin(), 2.0 * v),
            (true, true) => Vec3::new((2.0 + a.cos()) * b.cos(), (2.0 + a.cos()) * b.sin(), a.sin() * (1.0 + bend)),
        }
    };
    let corner = |c: u32, r: u32| (r % down) * across + c % across;
    let quad = |k: u32| {
        let (c, r) = (k % columns, k / columns);
        vec![corner(c, r), corner(c + 1, r), corner(c + 1, r + 1), corner(c, r + 1)]
    };
    ((0..across * down).map(at).collect(), (0..columns * rows).map(quad).collect())
}

/// The same with a few faces or vertices spoilt.
fn spoilt(seed: u64) -> PolyMesh {
    let mut dice = Dice::new(seed);
    let (mut positions, mut faces) = sound(&mut dice);
    for _ in 0..dice.below(7) {
        let (face, vertex, other) = (dice.below(faces.len()), dice.below(positions.len()), dice.below(positions.len()));
        match dice.below(8) {
            0 if faces.len() > 1 => drop(faces.swap_remove(face)),
            1 => faces.push(faces[face].clone()),
            2 => faces[face].reverse(),
            3 => positions[vertex] = positions[other],
            4 => faces.iter_mut().flatten().filter(|corner| **corner == vertex as u32).for_each(|c| *c = other as u32),
            5 => faces.push(vec![vertex as u32, other as u32, faces[face][0]]),
            6 => positions[vertex] *= 1e6 * dice.share(),
            _ => positions[vertex] *= 1e-9,
        }
    }
    let mut poly = PolyMesh { positions, ..PolyMesh::default() };
    faces.iter().for_each(|face| poly.faces.push(face));
    poly
}

/// What is composed of it, by regular layouts; `None` where some stage refuses.
fn composed(poly: &PolyMesh) -> Option<PolyMesh> {
    let surface = mesh::prepare(poly).ok()?.mesh;
    let cut = segment(&surface, PartCount::AsNeeded).ok()?;
    let queries: Vec<Query> =
        cut.parts.iter().map(|patch| Query::new(patch, &UnfoldOptions::default())).collect::<Result<_, _>>().ok()?;
    let ground = ComposedSurface::of(&cut);
    let pieces: Vec<Piece<'_>> = queries.iter().map(|query| Piece::Regular(&query.chart, query.index())).collect();
    Some(compose::compose(ground.input(), &pieces, Options::default(), &|| false).ok()?.mesh)
}

/// Composes a spoilt mesh.
pub fn composition(seed: u64) -> bool {
    let asked = Arc::new(AtomicU64::new(0));
    let counted = Arc::clone(&asked);
    let ask = move || {
        assert!(counted.fetch_add(1, Ordering::Relaxed) < ASKED_MAX, "seed {seed} does not end");
    };
    let Some(mesh) = stop::within(Arc::new(ask), || composed(&spoilt(seed))) else { return false };
    assert!(!mesh.faces.is_empty(), "it is composed of nothing");
    assert!(mesh.positions.iter().all(|x| x.iter().all(|c| c.is_finite())), "a vertex is nowhere");
    assert!(mesh.faces.corners().iter().all(|&corner| (corner as usize) < mesh.positions.len()), "a corner is none");
    if std::env::var_os("FUZZ_ASKED").is_some() {
        println!("seed {seed} asked {}", asked.load(Ordering::Relaxed));
    }
    true
}
