//! Query parameters that an operation does not have are refused: a misspelt one would be left out without a word.
//!
//! What an operation has is what the contract says of it, so that neither can change alone.

use super::error::HttpError;
use axum::extract::{MatchedPath, Request, State};
use axum::middleware::Next;
use axum::response::Response;
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What paths begin with whose parameters are checked: pages and metrics are asked for by programs with habits of their own.
const CHECKED: &str = "/v1/";

/// The query parameters of each operation, by its method (in small letters) and its path.
#[derive(Clone, Debug, Default)]
pub struct KnownParameters(Arc<BTreeMap<(String, String), Vec<String>>>);

impl KnownParameters {
    /// Of the contract as JSON.
    pub fn of(contract: &Value) -> Self {
        let mut known = BTreeMap::new();
        let paths = contract["paths"].as_object().into_iter().flatten();
        for (path, operations) in paths.filter(|(path, _)| path.starts_with(CHECKED)) {
            for (method, operation) in operations.as_object().into_iter().flatten() {
                let parameters = operation["parameters"].as_array().into_iter().flatten();
                let in_query = parameters.filter(|parameter| parameter["in"] == "query");
                let names = in_query.filter_map(|parameter| parameter["name"].as_str()).map(str::to_owned).collect();
                known.insert((method.clone(), path.clone()), names);
            }
        }
        Self(Arc::new(known))
    }

    /// Checks the parameters of a request.
    ///
    /// # Errors
    /// [`HttpError::ParameterUnknown`], of the first that is not known.
    fn check(&self, method: &str, path: &str, query: &str) -> Result<(), HttpError> {
        let Some(known) = self.0.get(&(method.to_ascii_lowercase(), path.to_owned())) else { return Ok(()) };
        let unknown =
            form_urlencoded::parse(query.as_bytes()).find(|(name, _)| !known.iter().any(|known| known == name));
        let Some((found, _)) = unknown else { return Ok(()) };
        let nearest = nearest(&found, known).map(str::to_owned);
        Err(HttpError::ParameterUnknown { found: found.into_owned(), nearest, known: known.join(", ") })
    }
}

/// Refuses requests with parameters that their operation does not have.
///
/// # Errors
/// [`HttpError::ParameterUnknown`].
pub async fn check(State(known): State<KnownParameters>, request: Request, next: Next) -> Result<Response, HttpError> {
    if let (Some(path), Some(query)) = (request.extensions().get::<MatchedPath>(), request.uri().query()) {
        known.check(request.method().as_str(), path.as_str(), query)?;
    }
    Ok(next.run(request).await)
}

/// The name that is reached by the fewest changes of a letter, if it takes fewer than half of its letters.
fn nearest<'a>(found: &str, known: &'a [String]) -> Option<&'a str> {
    // A longer text is no misspelling of any of ours.
    const LENGTH_MAX: usize = 64;
    if found.len() > LENGTH_MAX {
        return None;
    }
    let all = known.iter().map(|name| (changes(found, name), name.as_str()));
    all.filter(|(changes, name)| 2 * changes <= name.len().max(2))
        .min_by_key(|(changes, _)| *changes)
        .map(|best| best.1)
}

/// How many letters have to be put in, taken out or replaced to make one text of another (Levenshtein).
fn changes(one: &str, other: &str) -> usize {
    let other: Vec<char> = other.chars().collect();
    let mut row: Vec<usize> = (0..=other.len()).collect();
    for (i, a) in one.chars().enumerate() {
        let mut before = std::mem::replace(&mut row[0], i + 1);
        for (j, b) in other.iter().enumerate() {
            let replaced = before + usize::from(a != *b);
            before = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(before + 1);
        }
    }
    row[other.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_counted() {
        for (one, other, count) in
            [("", "", 0), ("tag", "tag", 0), ("tags", "tag", 1), ("", "tag", 3), ("resolutoin", "resolution", 2)]
        {
            assert_eq!((changes(one, other), changes(other, one)), (count, count), "{one}, {other}");
        }
    }

    #[test]
    fn the_nearest_name_is_told_if_it_is_near() {
        let known = ["top", "tag", "resolution", "deadline_ms"].map(str::to_owned);
        let found = |text: &str| nearest(text, &known);
        assert_eq!(
            (found("tags"), found("resolutoin"), found("deadline")),
            (Some("tag"), Some("resolution"), Some("deadline_ms"))
        );
        assert_eq!((found("colour"), found(&"tag".repeat(40))), (None, None));
    }
}
