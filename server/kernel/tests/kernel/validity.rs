//! A generated family of valid surfaces: nearly all of them are encoded, and what comes of it stands up to a validator that
//! shares nothing with the encoder.
//!
//! Discs, annuli, spheres and tori of random sizes, proportions, lumps and triangulations. The validator reads charts and pictures
//! as data, and knows but what they have to be: each triangle is upright, together they cover the square once, a vertex lies where
//! all its corners say, and λ is finite, not negative and of mean 1 at every level.
//!
//! `QUADMUSE_FAMILY=400 QUADMUSE_TRIANGLES=1000000` makes so many, of up to so many triangles.

use std::f64::consts::{PI, TAU};

use quadmuse_kernel::encode::{Encoding, encode_to};
use quadmuse_kernel::mesh::{self, Format, Limits};
use quadmuse_kernel::topology::{self, Topology};
use quadmuse_kernel::unfold::{Chart, UnfoldOptions, unfold};

/// Surfaces made, unless told otherwise.
const FAMILY: u64 = 400;
/// Triangles of the least and of the largest, unless told otherwise; as many are between 100 and 1,000 as between 1,000 and 10,000.
const TRIANGLES: (f64, f64) = (30.0, 8_000.0);
/// Of a thousand, so many are to be encoded.
const ENCODED_MIN: u64 = 995;
/// Places in the square that are the same.
const SAME: f64 = 1e-9;
/// So much of the square may lie under triangles that are turned over: on the coarsest and most stretched surfaces a conformal
/// chart folds here and there, and λ is the sum of what lies on a pixel.
const TURNED_MAX: f64 = 1e-2;
/// More of it than this is shown.
const TURNED_SHOWN: f64 = 1e-6;
/// Triangles cover the square but for so much.
const COVERED: f64 = 1e-6;
/// The finest level, in pixels a side: what is finer is made in the same way.
const SIDE: usize = 128;

/// Random numbers of one surface, in 0–1.
struct Dice(u64);

impl Dice {
    fn throw(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * self.throw()
    }

    fn count(&mut self, least: usize, most: usize) -> usize {
        least + (self.throw() * (most - least + 1) as f64) as usize
    }
}

/// Lumps on a unit sphere or a tube: where, how high, how wide.
fn lumps(dice: &mut Dice) -> Vec<([f64; 3], f64, f64)> {
    let count = dice.count(0, 6);
    let lump = |_| {
        let at = [dice.between(-1.0, 1.0), dice.between(-1.0, 1.0), dice.between(-1.0, 1.0)];
        (at, dice.between(-0.3, 0.9), dice.between(0.2, 0.8))
    };
    (0..count).map(lump).collect()
}

/// Radius of a torus's ring; that of its tube is 1 where it has no lumps.
const RING: f64 = 3.0;

/// One surface of the family as OBJ, and what it is. Rows go from one end to the other, columns around; a cap is a fan.
fn surface(seed: u64, most: f64) -> (String, Topology) {
    let mut dice = Dice(seed.wrapping_mul(0x2545_f491_4f6c_dd1d) + 1);
    let kind = [Topology::Disc, Topology::Annulus, Topology::Sphere, Topology::Torus][seed as usize % 4];
    let cells = dice.between(TRIANGLES.0.ln(), most.ln()).exp() / 2.0;
    let around = ((cells.sqrt() * dice.between(-0.7, 0.7).exp()) as usize).max(5);
    let rows = ((cells / around as f64) as usize).max(3);
    let lumps = lumps(&mut dice);
    let scale = [(); 3].map(|()| dice.between(-1.0, 1.0).exp());
    let (twist, jitter) = (dice.between(-1.0, 1.0), dice.between(0.0, 0.25));
    // The rows of a torus close up.
    let twist = if kind == Topology::Torus { 0.0 } else { twist };
    let opening = dice.between(0.15, 0.9) * PI;
    let at = |row: f64, column: f64| {
        let angle = TAU * column / around as f64 + twist * row / rows as f64;
        let flat = match kind {
            Topology::Annulus => [angle.cos(), angle.sin(), 3.0 * row / rows as f64 - 1.5],
            Topology::Torus => [angle.cos(), angle.sin(), TAU * row / rows as f64],
            _ => {
                let end = if kind == Topology::Disc { opening } else { PI };
                let down = end * row / rows as f64;
                [down.sin() * angle.cos(), down.sin() * angle.sin(), down.cos()]
            }
        };
        let lift = |(at, height, width): &([f64; 3], f64, f64)| {
            // Along a torus's ring it is the way to the lump that counts, in either direction.
            let along =
                if kind == Topology::Torus { 2.0 * ((flat[2] - PI * at[2]) / 2.0).sin() } else { flat[2] - at[2] };
            let far = (flat[0] - at[0]).powi(2) + (flat[1] - at[1]).powi(2) + along.powi(2);
            height * (-far / (width * width)).exp()
        };
        let lift = 1.0 + lumps.iter().map(lift).sum::<f64>();
        if kind == Topology::Torus {
            let far = RING + flat[0] * lift;
            return [far * flat[2].cos() * scale[0], far * flat[2].sin() * scale[1], flat[1] * lift * scale[2]];
        }
        // A tube is lifted from its axis, everything else from its middle.
        let along = if kind == Topology::Annulus { 1.0 } else { lift };
        [flat[0] * lift * scale[0], flat[1] * lift * scale[1], flat[2] * along * scale[2]]
    };
    let mut text = String::new();
    let mut vertex = |[x, y, z]: [f64; 3]| text.push_str(&format!("v {x} {y} {z}\n"));
    let has_top = matches!(kind, Topology::Disc | Topology::Sphere);
    let last = if matches!(kind, Topology::Sphere | Topology::Torus) { rows - 1 } else { rows };
    if has_top {
        vertex(at(0.0, 0.0));
    }
    for row in usize::from(has_top)..=last {
        for column in 0..around {
            // Boundaries and rows keep their order: nothing turns over.
            let [r, c] = [dice.between(-jitter, jitter), dice.between(-jitter, jitter)];
            let is_end = kind != Topology::Torus && (row == 0 || row == rows);
            vertex(at(row as f64 + if is_end { 0.0 } else { r }, column as f64 + c));
        }
    }
    if kind == Topology::Sphere {
        vertex(at(rows as f64, 0.0));
    }
    let first = usize::from(has_top);
    let index = |row: usize, column: usize| {
        let row = if kind == Topology::Torus { row % rows } else { row };
        (row - first) * around + column % around + first + 1
    };
    for column in 0..around {
        if has_top {
            text.push_str(&format!("f 1 {} {}\n", index(1, column), index(1, column + 1)));
        }
        for row in first..last + usize::from(kind == Topology::Torus) {
            let [a, b] = [index(row, column), index(row + 1, column)];
            let [c, d] = [index(row + 1, column + 1), index(row, column + 1)];
            text.push_str(&match dice.throw() {
                x if x < 0.3 => format!("f {a} {b} {c} {d}\n"),
                x if x < 0.65 => format!("f {a} {b} {c}\nf {a} {c} {d}\n"),
                _ => format!("f {a} {b} {d}\nf {b} {c} {d}\n"),
            });
        }
        if kind == Topology::Sphere {
            let bottom = (last - first + 1) * around + first + 1;
            text.push_str(&format!("f {} {bottom} {}\n", index(last, column), index(last, column + 1)));
        }
    }
    (text, kind)
}

/// The triangles of a surface as it was read, its chart and its pictures.
fn encoded(text: &str) -> Result<(usize, Chart, Encoding), String> {
    let poly = mesh::read(text.as_bytes(), Some(Format::Obj), &Limits::default()).map_err(|e| e.to_string())?;
    let prepared = mesh::prepare(&poly).map_err(|e| e.to_string())?;
    let patch = topology::whole(&prepared.mesh).map_err(|e| e.to_string())?;
    let chart = unfold(&patch, &UnfoldOptions::default()).map_err(|e| e.to_string())?;
    let encoding = encode_to(&chart, SIDE);
    Ok((prepared.mesh.triangles.len(), chart, encoding))
}

/// Twice the signed area of a polygon.
fn double_area(corners: &[[f64; 2]]) -> f64 {
    let next = |k: usize| corners[(k + 1) % corners.len()];
    corners.iter().enumerate().map(|(k, a)| a[0] * next(k)[1] - next(k)[0] * a[1]).sum()
}

/// The image of a triangle. A pole is a whole edge of the square: a triangle at one is a trapezoid that stands on it.
fn image(corners: &[[f64; 2]; 3], is_pole: [bool; 3]) -> Vec<[f64; 2]> {
    let Some(at) = is_pole.iter().position(|&is_pole| is_pole) else { return corners.to_vec() };
    let [pole, b, c] = [corners[at], corners[(at + 1) % 3], corners[(at + 2) % 3]];
    vec![[b[0], pole[1]], b, c, [c[0], pole[1]]]
}

/// How much of the square lies under triangles that are turned over, and what is wrong with a chart, if something is.
fn judged(chart: &Chart, kind: Topology) -> (f64, Option<String>) {
    if chart.topology != kind {
        return (0.0, Some(format!("{:?} instead of {kind:?}", chart.topology)));
    }
    if chart.corners.len() != chart.mesh.triangles.len() {
        return (0.0, Some(format!("{} corners of {} triangles", chart.corners.len(), chart.mesh.triangles.len())));
    }
    let (mut area, mut turned) = (0.0, 0.0);
    // The square of a torus closes in both directions, all others in one.
    let is_torus = kind == Topology::Torus;
    let apart = |a: f64, b: f64| {
        let apart = (a - b).rem_euclid(1.0);
        apart.min(1.0 - apart)
    };
    for (triangle, corners) in chart.mesh.triangles.iter().zip(&chart.corners) {
        let is_pole = triangle.map(|vertex| chart.poles.iter().any(|pole| pole.vertex == vertex));
        let own = double_area(&image(corners, is_pole)) / 2.0;
        if !own.is_finite() {
            return (turned, Some(format!("a triangle at {corners:?}")));
        }
        area += own;
        turned += (-own).max(0.0);
        for ((vertex, corner), is_pole) in triangle.iter().zip(corners).zip(is_pole) {
            let at = chart.uv[*vertex as usize];
            let up = if is_torus { apart(corner[1], at[1]) } else { (corner[1] - at[1]).abs() };
            if (!is_pole && apart(corner[0], at[0]) > SAME) || up > SAME {
                return (turned, Some(format!("vertex {vertex} at {at:?} and, in a triangle, at {corner:?}")));
            }
            if !is_torus && !(-SAME..=1.0 + SAME).contains(&corner[1]) {
                return (turned, Some(format!("a corner at {corner:?}")));
            }
        }
    }
    if turned > TURNED_MAX {
        return (turned, Some(format!("{turned:e} of the square lies under triangles that are turned over")));
    }
    (turned, ((area - 1.0).abs() > COVERED).then(|| format!("triangles cover {area} of the square")))
}

/// What is wrong with an encoding, if something is.
fn fault_of_encoding(encoding: &Encoding) -> Option<String> {
    if !(encoding.modulus.is_finite() && encoding.modulus > 0.0) {
        return Some(format!("a modulus of {}", encoding.modulus));
    }
    for picture in &encoding.pyramid {
        if picture.values.len() != picture.side * picture.side {
            return Some(format!("{} values at {}", picture.values.len(), picture.side));
        }
        if let Some(bad) = picture.values.iter().find(|value| !(value.is_finite() && **value >= 0.0)) {
            return Some(format!("λ = {bad} at {}", picture.side));
        }
        let mean = picture.values.iter().map(|&value| f64::from(value)).sum::<f64>() / picture.values.len() as f64;
        if (mean - 1.0).abs() > 1e-3 {
            return Some(format!("a mean λ of {mean} at {}", picture.side));
        }
    }
    encoding.pyramid.last().is_none_or(|picture| picture.side != SIDE).then(|| "no finest level".to_owned())
}

#[test]
fn nearly_all_of_a_family_of_valid_surfaces_are_encoded_and_stand_up_to_a_validator() {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse::<u64>().expect("a number"));
    let family = number("QUADMUSE_FAMILY").unwrap_or(FAMILY);
    let most = number("QUADMUSE_TRIANGLES").map_or(TRIANGLES.1, |most| most as f64);
    let (mut encodings, mut folded, mut worst, mut refused, mut bad) = (0, 0, 0.0_f64, Vec::new(), Vec::new());
    let mut largest = [0; 4];
    for seed in 0..family {
        let (text, kind) = surface(seed, most);
        match encoded(&text) {
            Ok((triangles, chart, encoding)) => {
                encodings += 1;
                let largest = &mut largest[seed as usize % 4];
                *largest = triangles.max(*largest);
                let (turned, fault) = judged(&chart, kind);
                worst = worst.max(turned);
                folded += u64::from(turned > TURNED_SHOWN);
                let fault = fault.or_else(|| fault_of_encoding(&encoding));
                bad.extend(fault.map(|fault| format!("{seed} ({kind:?}): {fault}")));
            }
            Err(error) => refused.push(format!("{seed} ({kind:?}): {error}")),
        }
    }
    println!("the largest disc, annulus, sphere and torus: {largest:?} triangles");
    println!("{encodings} of {family} encoded; {folded} with folds, of at most {worst:e} of the square");
    println!("refused: {refused:#?}; invalid: {bad:#?}");
    assert!(bad.is_empty(), "{bad:#?}");
    assert!(encodings * 1000 >= family * ENCODED_MIN, "{refused:#?}");
}

#[test]
fn the_validator_refuses_what_is_spoilt() {
    for seed in 0..4 {
        let (text, kind) = surface(seed, TRIANGLES.1);
        let (_, chart, encoding) = encoded(&text).expect("encoded");
        let spoilt = |spoil: &dyn Fn(&mut Chart)| {
            let mut chart = chart.clone();
            spoil(&mut chart);
            judged(&chart, kind).1
        };
        assert_eq!(spoilt(&|_| ()), None);
        let turn = |chart: &mut Chart| chart.corners.iter_mut().for_each(|corners| corners.swap(0, 1));
        assert!(spoilt(&turn).is_some(), "triangles turned over");
        assert!(spoilt(&|chart| chart.corners.truncate(chart.corners.len() - 1)).is_some(), "a triangle missing");
        assert!(spoilt(&|chart| chart.uv[3][1] += 0.01).is_some(), "a vertex elsewhere than its corners");
        assert!(spoilt(&|chart| chart.corners[5][1][0] = f64::NAN).is_some(), "a corner nowhere");
        let other = if kind == Topology::Torus { Topology::Disc } else { Topology::Torus };
        assert!(spoilt(&|chart| chart.topology = other).is_some(), "another topology");
        let mut dark = encoding.clone();
        dark.pyramid[1].values[7] = -1.0;
        assert!(fault_of_encoding(&dark).is_some(), "a λ below 0");
        let mut bright = encoding.clone();
        bright.pyramid[0].values.iter_mut().for_each(|value| *value *= 1.01);
        assert!(fault_of_encoding(&bright).is_some(), "a mean other than 1");
    }
}
