//! Two computations side by side.
//!
//! A factorisation gains nothing from a second thread (measured), two of them at once do. The second thread lives only as
//! long as the call, and does not take up other work while it waits, as a pool's would: a caller may hold what that
//! work needs.

/// Runs both, the second on a thread of its own where one can be had, and returns both results; each is the same
/// whatever thread it ran on. A panic of either goes on in the caller.
pub fn side_by_side<A, B: Send>(first: impl FnOnce() -> A, second: impl Fn() -> B + Sync) -> (A, B) {
    std::thread::scope(|scope| {
        let other = std::thread::Builder::new().spawn_scoped(scope, &second);
        let a = first();
        let b = match other.map(std::thread::ScopedJoinHandle::join) {
            Ok(Ok(b)) => b,
            Ok(Err(panic)) => std::panic::resume_unwind(panic),
            Err(_) => second(),
        };
        (a, b)
    })
}

/// Computes a value of each item, of the second half of them on another thread, and returns the values in the items' order.
pub fn in_halves<T: Sync, R: Send>(items: &[T], of: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let all = |some: &[T]| some.iter().map(&of).collect::<Vec<R>>();
    let (some, others) = items.split_at(items.len().div_ceil(2));
    if others.is_empty() {
        return all(some);
    }
    let (mut found, others) = side_by_side(|| all(some), || all(others));
    found.extend(others);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_results_come_back_in_their_places() {
        let words = [String::from("u"), String::from("v")];
        let lengths = side_by_side(|| words[0].len() + 1, || words[1].clone());
        assert_eq!(lengths, (2, "v".to_owned()));
    }

    #[test]
    fn values_come_back_in_the_order_of_the_items() {
        for count in [0usize, 1, 2, 5, 100] {
            let items: Vec<usize> = (0..count).collect();
            assert_eq!(in_halves(&items, |k| k + 1), (1..=count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_panic_of_the_second_reaches_the_caller() {
        let caught = std::panic::catch_unwind(|| side_by_side(|| 1, || std::panic::panic_any("singular")));
        assert_eq!(caught.err().and_then(|p| p.downcast_ref::<&str>().copied()), Some("singular"));
    }
}
