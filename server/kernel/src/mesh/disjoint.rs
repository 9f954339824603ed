//! Disjoint sets, plain and with a parity between members.

/// Disjoint sets of `0..n`; the root of a set is its smallest member.
#[derive(Clone)]
pub(crate) struct Sets(Vec<u32>);

impl Sets {
    pub(crate) fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    pub(crate) fn root(&mut self, mut x: u32) -> u32 {
        while self.0[x as usize] != x {
            self.0[x as usize] = self.0[self.0[x as usize] as usize];
            x = self.0[x as usize];
        }
        x
    }

    pub(crate) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// Disjoint sets whose members stand on one of two sides of their set.
pub(crate) struct Sides {
    /// Parent, and whether the member stands on the other side than its parent.
    parents: Vec<(u32, bool)>,
}

impl Sides {
    pub(crate) fn new(n: usize) -> Self {
        Self { parents: (0..n as u32).map(|x| (x, false)).collect() }
    }

    /// The root of the set of `x`, and whether `x` stands on the other side than the root.
    pub(crate) fn root(&mut self, x: u32) -> (u32, bool) {
        let (mut top, mut side) = (x, false);
        while self.parents[top as usize].0 != top {
            let (parent, other) = self.parents[top as usize];
            (top, side) = (parent, side ^ other);
        }
        let (mut below, mut rest) = (x, side);
        while self.parents[below as usize].0 != top && below != top {
            let (parent, other) = std::mem::replace(&mut self.parents[below as usize], (top, rest));
            (below, rest) = (parent, rest ^ other);
        }
        (top, side)
    }

    /// Demands that `a` and `b` stand on different sides (`opposed`) or on the same; false if that contradicts what was
    /// demanded before.
    pub(crate) fn join(&mut self, a: u32, b: u32, opposed: bool) -> bool {
        let ((a, side_a), (b, side_b)) = (self.root(a), self.root(b));
        if a == b {
            return (side_a ^ side_b) == opposed;
        }
        self.parents[a.max(b) as usize] = (a.min(b), side_a ^ side_b ^ opposed);
        true
    }

    /// Whether `a` and `b` of one set stand on different sides.
    pub(crate) fn opposed(&mut self, a: u32, b: u32) -> bool {
        self.root(a).1 ^ self.root(b).1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_member_is_the_root() {
        let mut sets = Sets::new(6);
        for (a, b) in [(5, 4), (4, 2), (1, 0), (3, 5)] {
            sets.join(a, b);
        }
        assert_eq!((0..6).map(|x| sets.root(x)).collect::<Vec<_>>(), [0, 0, 2, 2, 2, 2]);
    }

    #[test]
    fn an_odd_cycle_contradicts_itself_and_an_even_one_does_not() {
        let mut sides = Sides::new(5);
        for x in 0..4 {
            assert!(sides.join(x, x + 1, true));
        }
        assert!(sides.join(0, 3, true), "a cycle of four");
        assert!(!sides.join(0, 4, true), "a cycle of five");
        assert!(sides.opposed(1, 4) && !sides.opposed(0, 4));
    }

    #[test]
    fn long_chains_stay_fast() {
        let n = 1_000_000;
        let mut sides = Sides::new(n as usize);
        for x in (0..n - 1).rev() {
            assert!(sides.join(x, x + 1, true));
        }
        assert!(sides.opposed(0, n - 1));
    }
}
