//! Who plays in the demo: the examples of the corpus, and the strangers that are searched with.

use super::cage::Cage;
use super::creature;
use super::ear::Ear;
use super::foot::Foot;
use super::hand::{Finger, Hand};
use super::head::beast::Beast;
use super::head::human::Human;
use super::limb::{self, Build};
use super::remesh::Scan;
use quadmuse_kernel::mesh::Vec3;

/// A shape and what the corpus says about it.
pub(super) struct Role {
    pub(super) name: &'static str,
    pub(super) tags: &'static [&'static str],
    pub(super) relevance: f32,
    pub(super) shape: (Cage, Vec<Vec3>),
}

fn role(name: &'static str, tags: &'static [&'static str], relevance: f32, shape: (Cage, Vec<Vec3>)) -> Role {
    Role { name, tags, relevance, shape }
}

/// The corpus.
pub(super) fn examples() -> Vec<Role> {
    const HUMAN_HEAD: &[&str] = &["head", "human", "disc"];
    const BEAST_HEAD: &[&str] = &["head", "animal", "disc"];
    const HAND: &[&str] = &["hand", "disc"];
    const LIMB: &[&str] = &["limb", "annulus"];
    const CREATURE: &[&str] = &["creature", "sphere"];
    vec![
        role("head_man", HUMAN_HEAD, 4.0, man().build(1)),
        role("head_woman", HUMAN_HEAD, 4.0, woman().build(1)),
        role("head_child", HUMAN_HEAD, 3.0, child().build(1)),
        role("head_goblin", &["head", "fantasy", "disc"], 2.0, goblin().build(1)),
        role("head_cat", BEAST_HEAD, 3.0, cat().build(1)),
        role("head_fox", BEAST_HEAD, 3.0, fox().build(1)),
        role("head_bear", BEAST_HEAD, 3.0, bear().build(1)),
        role("ear_human", &["ear", "human", "disc"], 3.0, human_ear().build(1)),
        role("hand_human", HAND, 4.0, human_hand().build(1)),
        role("hand_glove", HAND, 2.0, glove().build(1)),
        role("paw_bear", &["paw", "animal", "disc"], 3.0, paw().build(1)),
        role("foot_human", &["foot", "human", "disc"], 3.0, Foot { wide: 1.0, arch: 1.0, toes: 1.0 }.build(1)),
        role("arm_human", LIMB, 4.0, limb::arm(&Build { thick: 1.0, muscle: 1.0, bend: 0.35 }, 1)),
        role("leg_human", LIMB, 4.0, limb::leg(&Build { thick: 1.0, muscle: 1.0, bend: 0.25 }, 1)),
        role("tentacle", LIMB, 2.0, limb::tentacle(2.6, 7, 1)),
        role("fish", CREATURE, 3.0, creature::fish(1.0, 1.0, 1)),
        role("duck", CREATURE, 3.0, creature::duck(0.4, 1.0, 1)),
        role("pig", CREATURE, 3.0, creature::pig(1.0, 1)),
    ]
}

/// The inputs, with how each is scanned.
pub(super) fn strangers() -> Vec<(Role, Scan)> {
    vec![
        (
            role("scan_old_man", &["head", "human", "disc"], 0.0, old_man().build(2)),
            Scan { seed: 11, triangles: 14_000, tilt: 0.45, scale: 84.0 },
        ),
        (
            role("scan_arm", &["limb", "annulus"], 0.0, limb::arm(&Build { thick: 1.18, muscle: 1.5, bend: 0.75 }, 3)),
            Scan { seed: 23, triangles: 9_000, tilt: 0.8, scale: 0.31 },
        ),
        (
            role("scan_fish", &["creature", "sphere"], 0.0, creature::fish(1.22, 0.86, 2)),
            Scan { seed: 37, triangles: 12_000, tilt: 0.3, scale: 12.0 },
        ),
    ]
}

fn man() -> Human {
    Human { jaw: 1.04, nose: [0.29, 1.05, 0.1], hump: 0.02, brow: 1.5, neck: 1.08, cheek: 0.9, ..Default::default() }
}

fn woman() -> Human {
    Human {
        wide: 0.95,
        jaw: 0.76,
        chin: 0.7,
        face: 0.94,
        nose: [0.215, 0.80, -0.4],
        hump: -0.015,
        brow: 0.2,
        eye: [0.182, 0.098],
        slant: 0.03,
        mouth: [0.235, 1.4],
        cheek: 1.25,
        neck: 0.72,
        ear: [0.85, 0.7],
        point: 0.0,
        askew: 0.01,
    }
}

fn child() -> Human {
    Human {
        wide: 1.04,
        jaw: 0.86,
        chin: 0.5,
        face: 0.80,
        nose: [0.19, 0.95, -0.6],
        hump: 0.0,
        brow: 0.2,
        eye: [0.185, 0.105],
        slant: 0.0,
        mouth: [0.215, 1.1],
        cheek: 1.6,
        neck: 0.72,
        ear: [0.92, 1.15],
        point: 0.0,
        askew: 0.01,
    }
}

fn goblin() -> Human {
    Human {
        wide: 1.06,
        jaw: 0.90,
        chin: 1.9,
        face: 1.04,
        nose: [0.43, 1.45, 1.2],
        hump: 0.07,
        brow: 2.2,
        eye: [0.175, 0.08],
        slant: 0.06,
        mouth: [0.36, 0.8],
        cheek: 1.7,
        neck: 0.85,
        ear: [1.05, 1.6],
        point: 1.1,
        askew: 0.02,
    }
}

/// Not in the corpus: long ears and nose, hollow cheeks, a heavy brow.
fn old_man() -> Human {
    Human {
        wide: 0.98,
        jaw: 0.95,
        chin: 1.5,
        face: 1.06,
        nose: [0.35, 1.25, 0.6],
        hump: 0.05,
        brow: 1.9,
        eye: [0.155, 0.066],
        slant: -0.015,
        mouth: [0.29, 0.7],
        cheek: 0.75,
        neck: 0.88,
        ear: [1.15, 1.15],
        point: 0.0,
        askew: 0.03,
    }
}

fn cat() -> Beast {
    Beast {
        snout: 0.16,
        narrow: 1.9,
        droop: 0.0,
        stop: 0.2,
        eye: [0.40, 0.20, 0.165, 0.13],
        pad: 0.8,
        cheek: 1.0,
        ear: [0.62, 0.30, 0.35],
        point: 1.0,
        askew: 0.01,
    }
}

fn fox() -> Beast {
    Beast {
        snout: 0.85,
        narrow: 3.4,
        droop: 0.12,
        stop: 0.0,
        eye: [0.42, 0.24, 0.135, 0.085],
        pad: 1.0,
        cheek: 1.1,
        ear: [0.78, 0.27, 0.30],
        point: 1.0,
        askew: 0.01,
    }
}

fn bear() -> Beast {
    Beast {
        snout: 0.42,
        narrow: 3.0,
        droop: 0.10,
        stop: 1.5,
        eye: [0.36, 0.22, 0.10, 0.085],
        pad: 1.6,
        cheek: 1.5,
        ear: [0.40, 0.29, 0.75],
        point: 0.1,
        askew: 0.01,
    }
}

fn human_ear() -> Ear {
    Ear { slim: 1.0, lobe: 1.0, helix: 1.0, fold: 1.0, point: 0.0 }
}

fn finger(length: f64, radius: f64, spread: f64, curl: f64) -> Finger {
    Finger { length, radius, spread, curl, taper: 0.28 }
}

fn human_hand() -> Hand {
    Hand {
        fingers: vec![
            finger(0.78, 0.125, -0.20, 0.35),
            finger(1.00, 0.142, -0.06, 0.28),
            finger(1.10, 0.147, 0.04, 0.25),
            finger(0.98, 0.142, 0.16, 0.22),
        ],
        thumb: Some(finger(0.92, 0.185, 0.95, 0.35)),
        wide: 0.62,
        thick: 0.20,
        high: 1.15,
        wrist: 0.40,
        pads: 0.0,
    }
}

fn glove() -> Hand {
    Hand {
        fingers: vec![
            finger(0.78, 0.190, -0.30, 0.35),
            finger(0.92, 0.205, 0.0, 0.30),
            finger(0.84, 0.200, 0.28, 0.25),
        ],
        thumb: Some(finger(0.85, 0.235, 1.0, 0.35)),
        wide: 0.76,
        thick: 0.30,
        high: 0.95,
        wrist: 0.38,
        pads: 0.3,
    }
}

fn paw() -> Hand {
    Hand {
        fingers: vec![
            finger(0.50, 0.185, -0.42, 0.9),
            finger(0.60, 0.200, -0.14, 0.9),
            finger(0.59, 0.200, 0.15, 0.9),
            finger(0.48, 0.185, 0.44, 0.9),
        ],
        thumb: None,
        wide: 0.84,
        thick: 0.32,
        high: 0.85,
        wrist: 0.50,
        pads: 1.0,
    }
}
