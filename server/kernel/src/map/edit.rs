//! Editing a cross map: its controls are constraints that the user moves, adds and removes; ψ̂ has a closed form, so
//! an edit costs no optimisation. *Source:* paper §5.3.

use crate::encode::features::distance_on;
use crate::register::evaluate::psi;
use crate::register::mls::Domain;
use crate::register::{ASPECT, Registration, fold_cells};
use crate::topology::Topology;
use crate::unfold::Uv;

/// Cells a side at which an edit is checked for folds.
const FOLD_SIDE: usize = 64;

/// Why an edit was refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EditError {
    /// The constraint would turn part of the map over.
    #[error("expected a map without folds, found {cells} folded cells of {} near ({:.3}, {:.3}); move the constraint less, or move its neighbours too", FOLD_SIDE * FOLD_SIDE, at[0], at[1])]
    Folds {
        /// How many cells fold.
        cells: usize,
        /// The first of them, on the example's domain.
        at: Uv,
    },
    /// There is no such constraint.
    #[error("expected a constraint numbered below {count}, found {index}")]
    Unknown {
        /// What was asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// The last constraint carries the translation and cannot go.
    #[error("expected at least one constraint to remain; move it instead of removing it")]
    Last,
}

/// The constraints as pairs of points of the two domains (the example's unmirrored).
pub fn constraints(registration: &Registration) -> Vec<(Uv, Uv)> {
    let inside = |x: Uv| [x[0].rem_euclid(1.0), if (0.0..=1.0).contains(&x[1]) { x[1] } else { x[1].rem_euclid(1.0) }];
    let pair = |(p, q): (&Uv, &Uv)| (registration.flip.apply(*p), inside(*q));
    registration.p.iter().zip(&registration.q).map(pair).collect()
}

/// Sets constraint `index` (or, where `None`, adds one) to carry `on_example` to `on_input`.
///
/// # Errors
/// [`EditError::Unknown`]. Folds are not checked: see [`check_folds`].
pub fn set(
    registration: &mut Registration,
    topology: Topology,
    index: Option<usize>,
    on_example: Uv,
    on_input: Uv,
) -> Result<(), EditError> {
    let p = registration.flip.apply(on_example);
    // Of all periods the one nearest to where the map sends the point now.
    let now = psi(Domain { topology, aspect: ASPECT }, &registration.p, &registration.q, p);
    let nearest = |k: usize| on_input[k] + (now[k] - on_input[k]).round();
    let v = if topology.is_periodic_v() { nearest(1) } else { on_input[1].clamp(0.0, 1.0) };
    let q = [nearest(0), v];
    let count = registration.p.len();
    match index {
        Some(i) if i < count => (registration.p[i], registration.q[i]) = (p, q),
        Some(index) => return Err(EditError::Unknown { index, count }),
        None => {
            registration.p.push(p);
            registration.q.push(q);
        }
    }
    Ok(())
}

/// Removes constraint `index`.
///
/// # Errors
/// [`EditError::Unknown`], [`EditError::Last`].
pub fn remove(registration: &mut Registration, index: usize) -> Result<(), EditError> {
    let count = registration.p.len();
    if index >= count {
        return Err(EditError::Unknown { index, count });
    }
    if count == 1 {
        return Err(EditError::Last);
    }
    registration.p.remove(index);
    registration.q.remove(index);
    Ok(())
}

/// Refuses a map that folds.
///
/// # Errors
/// [`EditError::Folds`].
pub fn check_folds(registration: &Registration, topology: Topology) -> Result<(), EditError> {
    let folds = fold_cells(Domain { topology, aspect: ASPECT }, &registration.p, &registration.q, FOLD_SIDE);
    folds.first().map_or(Ok(()), |&at| Err(EditError::Folds { cells: folds.len(), at }))
}

/// Half-way moves of a constraint towards where the others predict it before it goes there wholly.
const RESOLVE_HALVINGS: usize = 6;

/// Makes room for the constraints numbered in `kept`: of the others the one nearest to a fold moves towards where its
/// neighbours predict it, until nothing folds. Returns the numbers of those that moved.
///
/// # Errors
/// [`EditError::Folds`] where the kept ones alone fold.
pub fn resolve(registration: &mut Registration, topology: Topology, kept: &[usize]) -> Result<Vec<usize>, EditError> {
    let domain = Domain { topology, aspect: ASPECT };
    let count = registration.p.len();
    let mut moves = vec![0usize; count];
    for _ in 0..=(RESOLVE_HALVINGS + 1) * count {
        let folds = fold_cells(domain, &registration.p, &registration.q, FOLD_SIDE);
        let Some(fold) = folds.first() else { break };
        let to_fold = |i: usize| distance_on(topology, registration.p[i], *fold);
        let open = (0..count).filter(|i| moves[*i] <= RESOLVE_HALVINGS && !kept.contains(i));
        let Some(i) = open.min_by(|&a, &b| to_fold(a).total_cmp(&to_fold(b))) else { break };
        let others =
            |all: &[Uv]| -> Vec<Uv> { all.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, x)| *x).collect() };
        let predicted = psi(domain, &others(&registration.p), &others(&registration.q), registration.p[i]);
        let share = if moves[i] < RESOLVE_HALVINGS { 0.5 } else { 1.0 };
        (0..2).for_each(|k| registration.q[i][k] += share * (predicted[k] - registration.q[i][k]));
        moves[i] += 1;
    }
    check_folds(registration, topology)?;
    Ok((0..count).filter(|&i| moves[i] > 0).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::Flip;

    fn start() -> Registration {
        let p = vec![[0.2, 0.5], [0.7, 0.4]];
        let q = vec![[1.25, 0.5], [1.75, 0.4]];
        let flip = Flip { u: true, v: false };
        Registration { flip, side: 128, p, q, energy: 0.0, variance: 1.0, folds: 0 }
    }

    #[test]
    fn a_moved_constraint_is_met_in_the_nearest_period() {
        let mut registration = start();
        set(&mut registration, Topology::Disc, None, [0.55, 0.8], [0.52, 0.82]).expect("room");
        let y = registration.map(Topology::Disc, [0.55, 0.8]);
        assert!((y[0] - y[0].floor() - 0.52).abs() < 1e-8 && (y[1] - 0.82).abs() < 1e-8);
        assert!((registration.q[2][0] - 1.52).abs() < 1e-12);
        assert_eq!(check_folds(&registration, Topology::Disc), Ok(()));
    }

    #[test]
    fn a_constraint_that_crosses_another_folds() {
        let mut registration = start();
        set(&mut registration, Topology::Disc, None, [0.78, 0.5], [0.45, 0.5]).expect("room");
        assert!(matches!(check_folds(&registration, Topology::Disc), Err(EditError::Folds { .. })));
    }

    #[test]
    fn neighbours_make_room_where_that_is_asked_for() {
        let mut registration = start();
        set(&mut registration, Topology::Disc, None, [0.78, 0.5], [0.45, 0.5]).expect("room");
        let wanted = registration.q[2];
        let moved = resolve(&mut registration, Topology::Disc, &[2]).expect("room once the neighbours yield");
        assert!(!moved.is_empty() && !moved.contains(&2));
        assert_eq!(registration.q[2], wanted);
        assert_eq!(check_folds(&registration, Topology::Disc), Ok(()));
        // With nothing that may yield it is refused.
        let mut registration = start();
        set(&mut registration, Topology::Disc, None, [0.78, 0.5], [0.45, 0.5]).expect("room");
        assert!(resolve(&mut registration, Topology::Disc, &[0, 1, 2]).is_err());
    }

    #[test]
    fn the_last_constraint_stays() {
        let mut registration = start();
        remove(&mut registration, 0).expect("two");
        assert_eq!(remove(&mut registration, 0), Err(EditError::Last));
        assert_eq!(remove(&mut registration, 7), Err(EditError::Unknown { index: 7, count: 1 }));
    }
}
