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
    fn a_panic_of_the_second_reaches_the_caller() {
        let caught = std::panic::catch_unwind(|| side_by_side(|| 1, || std::panic::panic_any("singular")));
        assert_eq!(caught.err().and_then(|p| p.downcast_ref::<&str>().copied()), Some("singular"));
    }
}
