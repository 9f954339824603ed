//! Remembers what the service makes for this program beyond the answer to its request, to cancel it where nobody waits any more.

use super::Api;
use reqwest::Method;
use std::sync::{Arc, Mutex, PoisonError};

/// Path of a resource below `/v1`.
type ResourcePath = Vec<String>;

/// Paths of what is waited for. Clones share one list.
#[derive(Clone, Debug, Default)]
pub(super) struct Unfinished(Arc<Mutex<Vec<ResourcePath>>>);

impl Unfinished {
    /// Lists a resource until the guard is dropped.
    pub(super) fn hold(&self, path: &[&str]) -> Held {
        let path: ResourcePath = path.iter().map(|&segment| segment.to_owned()).collect();
        self.paths(|paths| paths.push(path.clone()));
        Held { unfinished: self.clone(), path }
    }

    fn paths<T>(&self, of: impl FnOnce(&mut Vec<ResourcePath>) -> T) -> T {
        of(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// A resource that is waited for.
#[derive(Debug)]
pub(super) struct Held {
    unfinished: Unfinished,
    path: ResourcePath,
}

impl Drop for Held {
    fn drop(&mut self) {
        self.unfinished.paths(|paths| {
            if let Some(at) = paths.iter().position(|path| *path == self.path) {
                paths.swap_remove(at);
            }
        });
    }
}

impl Api {
    /// Cancels what the service still makes for this program. That it is done or gone by now is no failure.
    pub async fn cancel_unfinished(&self) {
        for path in self.unfinished.paths(|paths| paths.clone()) {
            let path: Vec<&str> = path.iter().map(String::as_str).collect();
            let _ = self.send(self.request(Method::DELETE, &path)).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_held_twice_is_listed_until_both_have_let_go() {
        let unfinished = Unfinished::default();
        let first = unfinished.hold(&["queries", "1"]);
        let second = unfinished.hold(&["queries", "1"]);
        let listed = || unfinished.paths(|paths| paths.len());
        assert_eq!(listed(), 2);
        drop(first);
        assert_eq!(listed(), 1);
        drop(second);
        assert_eq!(listed(), 0);
    }
}
