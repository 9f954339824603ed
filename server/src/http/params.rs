//! Query parameters and path ids, with problems of our own.

use super::error::HttpError;
use axum::extract::{FromRequestParts, RawPathParams};
use axum::http::request::Parts;
use quadmuse_proto::paging::{LIMIT_DEFAULT, LIMIT_MAX};
use std::fmt::Display;
use std::str::FromStr;

/// Most parameters of a request.
const PARAMS_MAX: usize = 128;

/// The query parameters, in order; names may repeat.
#[derive(Clone, Debug, Default)]
pub struct Params(Vec<(String, String)>);

impl<S: Sync> FromRequestParts<S> for Params {
    type Rejection = HttpError;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, HttpError> {
        let query = parts.uri.query().unwrap_or_default();
        let pairs: Vec<_> = form_urlencoded::parse(query.as_bytes()).into_owned().take(PARAMS_MAX + 1).collect();
        if pairs.len() > PARAMS_MAX {
            return Err(HttpError::parameter("query", format!("of at most {PARAMS_MAX} parameters"), "more"));
        }
        Ok(Self(pairs))
    }
}

impl Params {
    /// All values of a repeated parameter.
    pub fn all(&self, name: &str) -> Vec<String> {
        self.0.iter().filter(|(key, _)| key == name).map(|(_, value)| value.clone()).collect()
    }

    /// The value of a parameter that may be there once.
    ///
    /// # Errors
    /// [`HttpError::Parameter`] when it is there twice.
    pub fn text(&self, name: &str) -> Result<Option<&str>, HttpError> {
        let mut values = self.0.iter().filter(|(key, _)| key == name);
        match (values.next(), values.next()) {
            (_, Some(_)) => Err(HttpError::parameter(name, "once", "it twice")),
            (value, None) => Ok(value.map(|(_, value)| value.as_str())),
        }
    }

    /// The parsed value of a parameter; `expected` says what would do.
    ///
    /// # Errors
    /// [`HttpError::Parameter`].
    pub fn get<T: FromStr>(&self, name: &str, expected: &str) -> Result<Option<T>, HttpError> {
        let parse = |text: &str| text.parse().map_err(|_| HttpError::parameter(name, expected, text));
        self.text(name)?.map(parse).transpose()
    }

    /// The `limit` of a list.
    ///
    /// # Errors
    /// [`HttpError::Parameter`] outside 1–500.
    pub fn limit(&self, default: u32) -> Result<usize, HttpError> {
        let expected = format!("from 1 to {LIMIT_MAX}");
        let limit: u32 = self.get("limit", &expected)?.unwrap_or(default);
        if (1..=LIMIT_MAX).contains(&limit) {
            return Ok(limit as usize);
        }
        Err(HttpError::parameter("limit", expected, limit))
    }

    /// The `limit` of a list of resources.
    ///
    /// # Errors
    /// [`HttpError::Parameter`] outside 1–500.
    pub fn page_limit(&self) -> Result<usize, HttpError> {
        self.limit(LIMIT_DEFAULT)
    }
}

/// The ids (and numbers) in the path, in order. One that can't be parsed is the address of nothing.
#[derive(Clone, Debug)]
pub struct PathIds<T>(pub T);

struct Segments<'a> {
    values: Vec<&'a str>,
    path: &'a str,
}

impl Segments<'_> {
    fn parse<T: FromStr>(&self, at: usize) -> Result<T, HttpError>
    where
        T::Err: Display,
    {
        let nothing = || HttpError::NoRoute { path: self.path.into() };
        self.values.get(at).ok_or_else(nothing)?.parse().map_err(|_| nothing())
    }
}

macro_rules! path_ids {
    ($($name:ident at $place:literal),+) => {
        impl<S, $($name),+> FromRequestParts<S> for PathIds<($($name,)+)>
        where
            S: Send + Sync,
            $($name: FromStr, $name::Err: Display),+
        {
            type Rejection = HttpError;

            async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, HttpError> {
                let path = parts.uri.path().to_owned();
                let raw = RawPathParams::from_request_parts(parts, state).await;
                let raw = raw.map_err(|_| HttpError::NoRoute { path: path.clone() })?;
                let segments = Segments { values: raw.iter().map(|(_, value)| value).collect(), path: &path };
                Ok(Self(($(segments.parse::<$name>($place)?,)+)))
            }
        }
    };
}

path_ids!(A at 0);
path_ids!(A at 0, B at 1);
