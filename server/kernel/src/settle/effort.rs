//! How many rough poses are looked at.

/// How thoroughly poses are sought.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// Points of the larger surface that are tried, and turns about the normal at each.
    pub(super) places: usize,
    pub(super) turns: usize,
    /// Points of a bulky smaller surface that are laid there, beside its middle.
    pub(super) anchors: usize,
    /// Areas of the smaller surface, laid, as shares of the larger's.
    pub(super) shares: &'static [f64],
    /// Samples of the larger surface.
    pub(super) large: usize,
    /// Samples of the smaller one by which a pose is sifted.
    pub(super) sifted_by: usize,
    /// Poses of one size that are refined, by how many samples of the smaller surface, in how many rounds.
    pub(super) refinements: &'static [(usize, usize, usize)],
}

/// To lay an example.
pub(super) const FULL: Effort = Effort {
    places: 100,
    turns: 12,
    anchors: 16,
    shares: &[0.14, 0.2, 0.28, 0.4, 0.56, 0.78, 1.1],
    large: 3000,
    sifted_by: 32,
    refinements: &[(72, 64, 4), (10, 256, 12)],
};
/// To lay one on a part of a scan.
pub(super) const ON_A_PART: Effort = Effort { anchors: 0, ..FULL };
/// To lay one roughly.
pub(super) const MIDDLE: Effort = Effort {
    places: 100,
    turns: 12,
    anchors: 0,
    shares: &[0.12, 0.18, 0.27, 0.4, 0.6, 0.9],
    large: 1500,
    sifted_by: 24,
    refinements: &[(48, 64, 4), (7, 128, 8)],
};
/// To tell which of many examples are worth it.
pub(super) const QUICK: Effort = Effort {
    places: 60,
    turns: 12,
    anchors: 0,
    shares: &[0.12, 0.22, 0.42, 0.8],
    large: 1500,
    sifted_by: 24,
    refinements: &[(28, 64, 4), (5, 128, 6)],
};
/// Says how many poses are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Thoroughness {
    /// As for a scan.
    Thoroughly,
    /// The same, but with a bulky surface laid by its middle alone: as for a part of a scan that was cut, which is no statue with
    /// a head somewhere on it.
    ByMiddle,
    /// A quarter of the work.
    Roughly,
    /// A twelfth of the work: for inputs of few faces.
    Quickly,
}
