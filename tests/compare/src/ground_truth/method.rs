//! What is compared: the whole path, the path without one of its means, and the paper's.

use quadmuse_kernel::map::snap::Snap;
use quadmuse_kernel::register::solve::Rigid;
use quadmuse_kernel::register::{LevenbergMarquardt, PixelDescent, Solver};

/// A way to map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Everything.
    Full,
    /// Without corners of the boundary and sharp edges snapped to the input's.
    NoSnap,
    /// All but the surface polish and the snapping.
    NoPolish,
    /// One chart, even where there are protrusions (polished).
    NoAtlas,
    /// One chart, the pole as the surface alone gives it (polished).
    NoPoles,
    /// The paper's descent, one chart, the pole as the surface alone gives it.
    Paper,
    /// Flips and translations only.
    Translation,
}

impl Method {
    /// All of them, best first.
    pub const ALL: [Self; 7] =
        [Self::Full, Self::NoSnap, Self::NoPolish, Self::NoAtlas, Self::NoPoles, Self::Paper, Self::Translation];

    /// A name for tables and the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::NoSnap => "no-snap",
            Self::NoPolish => "no-polish",
            Self::NoAtlas => "no-atlas",
            Self::NoPoles => "no-poles",
            Self::Paper => "paper",
            Self::Translation => "translation",
        }
    }

    /// What moves the controls.
    pub fn solver(self) -> Box<dyn Solver> {
        match self {
            Self::Full | Self::NoSnap | Self::NoPolish | Self::NoAtlas | Self::NoPoles => {
                Box::new(LevenbergMarquardt::default())
            }
            Self::Paper => Box::new(PixelDescent),
            Self::Translation => Box::new(Rigid),
        }
    }

    /// Whether the poles are sought again for the example.
    pub fn refines_poles(self) -> bool {
        matches!(self, Self::Full | Self::NoSnap | Self::NoPolish | Self::NoAtlas)
    }

    /// Whether surfaces with protrusions get a chart a tip.
    pub fn has_atlas(self) -> bool {
        matches!(self, Self::Full | Self::NoSnap | Self::NoPolish)
    }

    /// Whether mapped vertices slide along the surface in the end.
    pub fn polishes(self) -> bool {
        matches!(self, Self::Full | Self::NoSnap | Self::NoAtlas | Self::NoPoles)
    }

    /// What is snapped to the input's lines.
    pub fn snaps(self) -> Snap {
        if self == Self::Full { Snap::All } else { Snap::Off }
    }
}
