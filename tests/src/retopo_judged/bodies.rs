//! What is sent through `retopo`: whole bodies, animals and objects of genus 0 to 12.

use std::path::Path;

/// A mesh to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Body {
    /// Its file, in the folder of shared meshes.
    pub file: &'static str,
    /// Flags that it is sent with.
    pub flags: &'static [&'static str],
}

impl Body {
    /// The file's name without its ending.
    pub fn name(&self) -> String {
        Path::new(self.file).file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }
}

/// One segment a protrusion: primitives would otherwise be left whole.
const AUTO: &[&str] = &["--parts", "auto"];
/// As the service likes.
const PLAIN: &[&str] = &[];

const fn cut(file: &'static str) -> Body {
    Body { file, flags: AUTO }
}

/// All of them.
pub const BODIES: &[Body] = &[
    cut("scans/m2m_horse.obj"),
    cut("scans/m2m_dog.obj"),
    cut("scans/m2m_eagle.obj"),
    cut("scans/m2m_bigbuckbunny.obj"),
    cut("scans/cat_statue.ply"),
    cut("scans/spot.ply"),
    cut("scans/penguin.ply"),
    cut("scans/scorpion.obj"),
    cut("scans/hand_closed.ply"),
    cut("scans/goathead_open.obj"),
    cut("scans/nefertiti.ply"),
    cut("scans/plane.ply"),
    cut("groundtruth/input_animal_horse_jump_f18__animal_horse_run_f10.obj"),
    cut("groundtruth/input_animal_cat_idle_f30__animal_cat_idle_f10.obj"),
    cut("groundtruth/input_animal_pig_run_f11__animal_pig_death_f13.obj"),
    cut("groundtruth/input_animal_trex_trex_attack_f14__animal_trex_trex_run_f11.obj"),
    cut("groundtruth/input_animal_triceratops_triceratops_idle_f30__animal_triceratops_triceratops_attack_f9.obj"),
    cut("groundtruth/input_animal_rat_rest__animal_rat_rat_attack_f8.obj"),
    cut("groundtruth/input_mhbody_dev_00__mhbody_dev_08.obj"),
    cut("groundtruth/input_mhpose_dev_sit__mhpose_dev_twist.obj"),
    Body { file: "scans/torus.obj", flags: PLAIN },
    Body { file: "quads/osd_toroidal_tet.obj", flags: PLAIN },
    Body { file: "scans/skull.ply", flags: PLAIN },
    Body { file: "scans/boot.ply", flags: PLAIN },
];
