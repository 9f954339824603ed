//! Further cases with a known truth, made of the pairs: the same cut, or the same cap, on both sides.
//!
//! Examples of one set share their connectivity, so that a set of faces is the same region on all of them, and the truth
//! of one is the truth of all.

use super::case::{Case, poly};
use super::cut::{capped, cut};
use super::sharp::{Shape, itself, made};
use quadmuse_kernel::mesh::{PolyMesh, Vec3};
use quadmuse_kernel::unfold::path::distances;
use quadmuse_tests::real_input::pairs::Pair;
use std::path::{Path, PathBuf};

/// Share of a head's area that is cut off around its crown to make an annulus.
const CROWN_SHARE: f64 = 0.1;
/// A foot ends at this share of the body's height.
const ANKLE_SHARE: f64 = 0.075;
/// How many pairs of other heads there are.
const OTHERS: usize = 6;

/// Artists' meshes with sharp edges.
const SHARP: [&str; 14] = [
    "chess_knight_1.obj",
    "chess_pawn_top.obj",
    "mh_fedora.obj",
    "mh_shoe01.obj",
    "mh_skirt.obj",
    "mh_casualsuit06_a.obj",
    "osd_helmet.obj",
    "osd_pawn.obj",
    "osd_rook.obj",
    "osd_toroidal_tet.obj",
    "shaderball_core.obj",
    "sword_quaddom.obj",
    "utah_teapot_1.obj",
    "utah_teapot_2.obj",
];

/// A case that can be read.
#[derive(Clone, Debug)]
pub struct Source {
    /// The pair's kind, or `other`, `annulus`, `closed`, `foot`, `sharp`.
    pub kind: String,
    /// A name for people.
    pub name: String,
    how: How,
}

#[derive(Clone, Debug)]
enum How {
    AsItIs(Pair),
    /// The example of another pair of the set.
    Example(Pair, PathBuf),
    WithoutCrown(Pair),
    NeckClosed(Pair),
    /// The foot at negative or positive x of a body that stands upright.
    Foot(Pair, PathBuf, f64),
    /// A file on its own surface.
    Itself(PathBuf),
    /// A shape made by code on itself.
    Made(Shape),
}

impl Source {
    /// Reads the files, and cuts or caps them.
    ///
    /// # Errors
    /// A sentence.
    pub fn read(&self) -> Result<Case, String> {
        match &self.how {
            How::AsItIs(pair) => Case::read(pair, None),
            How::Example(pair, example) => Case::read(pair, Some(example)),
            How::NeckClosed(pair) => capped(&Case::read(pair, None)?),
            How::WithoutCrown(pair) => {
                let case = Case::read(pair, None)?;
                let kept: Vec<bool> = crown(&case)?.into_iter().map(|gone| !gone).collect();
                cut(&case, &kept)
            }
            How::Foot(pair, standing, side) => cut(&Case::read(pair, None)?, &foot(&poly(standing)?, *side)),
            How::Itself(path) => itself(path),
            How::Made(shape) => made(*shape),
        }
    }
}

/// All cases: the pairs, what is made of them, and what has sharp edges, on its own surface.
pub fn sources(shared: &Path, pairs: &[Pair]) -> Vec<Source> {
    let source = |kind: &str, name: String, how: How| Source { kind: kind.to_owned(), name, how };
    let mut all: Vec<Source> = pairs.iter().map(|p| source(&p.kind, p.name(), How::AsItIs(p.clone()))).collect();
    let heads: Vec<&Pair> = pairs.iter().filter(|p| p.kind == "head").collect();
    all.extend(others(&heads).map(|(example, p)| {
        let name = format!("{}__{}", stem(&example.example), shape(p));
        source("other", name, How::Example(p.clone(), example.example.clone()))
    }));
    all.extend(heads.iter().map(|p| source("annulus", p.name(), How::WithoutCrown((*p).clone()))));
    all.extend(heads.iter().map(|p| source("closed", p.name(), How::NeckClosed((*p).clone()))));
    let bodies: Vec<&Pair> = pairs.iter().filter(|p| matches!(p.kind.as_str(), "body" | "pose")).collect();
    if let Some(standing) = bodies.iter().find(|p| p.kind == "body").map(|p| p.example.clone()) {
        let feet = |p: &&Pair| {
            let pair = (*p).clone();
            [("right", -1.0), ("left", 1.0)].map(|(word, side)| {
                let how = How::Foot(pair.clone(), standing.clone(), side);
                source("foot", format!("{word} {}", p.name()), how)
            })
        };
        all.extend(bodies.iter().flat_map(feet));
    }
    all.extend(Shape::ALL.map(|shape| source("sharp", format!("{shape:?}").to_lowercase(), How::Made(shape))));
    all.extend(SHARP.map(|name| {
        let path = shared.join("meshes/quads").join(name);
        source("sharp", stem(&path), How::Itself(path))
    }));
    all
}

/// Heads of the larger set, each with the example of the pair after the next: another face.
fn others<'a>(heads: &'a [&'a Pair]) -> impl Iterator<Item = (&'a Pair, &'a Pair)> {
    let set = |p: &Pair| stem(&p.example).split("_dev").next().map(str::to_owned);
    let largest = heads.iter().map(|p| (heads.iter().filter(|q| set(q) == set(p)).count(), set(p))).max();
    let own: Vec<&Pair> =
        heads.iter().copied().filter(|p| Some(set(p)) == largest.as_ref().map(|l| l.1.clone())).collect();
    let n = own.len();
    let all: Vec<(&Pair, &Pair)> = (0..n).map(|k| (own[(k + 2) % n], own[k])).collect();
    all.into_iter().filter(|(example, p)| stem(&example.example) != shape(p)).take(OTHERS)
}

/// What an example shows, by its file's name.
fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    stem.trim_start_matches("example_").to_owned()
}

/// What a pair's input shows.
fn shape(pair: &Pair) -> String {
    pair.name().rsplit("__").next().unwrap_or_default().to_owned()
}

/// Faces around the vertex that is farthest from the boundary.
fn crown(case: &Case) -> Result<Vec<bool>, String> {
    let (mesh, prepared) = (&case.example.poly, &case.example.prepared);
    let rim: Vec<u32> = (0u32..).zip(prepared.mesh.boundary_vertices()).filter(|(_, on)| *on).map(|(v, _)| v).collect();
    let (far, _) = distances(&prepared.mesh, &rim);
    let distance = |v: usize| far.get(prepared.vertex_of[v] as usize).copied().unwrap_or(0.0);
    let top = (0..mesh.positions.len()).max_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    let mut inside = vec![false; mesh.positions.len()];
    *inside.get_mut(top.ok_or("expected vertices")?).ok_or("expected vertices")? = true;
    let mut gone = vec![false; mesh.faces.len()];
    let mut areas = vec![0.0; mesh.faces.len()];
    (0..prepared.mesh.triangles.len())
        .for_each(|t| areas[prepared.mesh.polygon_of[t] as usize] += prepared.mesh.area(t));
    let wanted = CROWN_SHARE * areas.iter().sum::<f64>();
    for _ in 0..mesh.faces.len() {
        if gone.iter().zip(&areas).filter(|(gone, _)| **gone).map(|(_, a)| a).sum::<f64>() >= wanted {
            break;
        }
        for (f, face) in mesh.faces.iter().enumerate() {
            gone[f] |= face.iter().any(|&v| inside[v as usize]);
        }
        for (_, face) in mesh.faces.iter().enumerate().filter(|(f, _)| gone[*f]) {
            face.iter().for_each(|&v| inside[v as usize] = true);
        }
    }
    Ok(gone)
}

/// Faces of one foot of a body that stands upright along y.
fn foot(standing: &PolyMesh, side: f64) -> Vec<bool> {
    let heights = || standing.positions.iter().map(|p| p.y);
    let (low, high) = (heights().fold(f64::MAX, f64::min), heights().fold(f64::MIN, f64::max));
    let below = |p: &Vec3| p.y < low + ANKLE_SHARE * (high - low) && p.x * side > 0.0;
    standing.faces.iter().map(|face| face.iter().all(|&v| below(&standing.positions[v as usize]))).collect()
}
