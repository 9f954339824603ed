//! The HTTP surface: this file is its table of contents, each resource a file of its own.
//!
//! Handlers read what came in, call `work`, and write what comes out. They never name the kernel or the store.

pub mod admin;
pub mod body;
pub mod caller;
pub mod compositions;
pub mod docs;
pub mod error;
pub mod examples;
pub mod files;
pub mod forward;
pub mod health;
pub mod idempotency;
pub mod known;
pub mod making;
pub mod maps;
pub mod negotiate;
pub mod openapi;
pub mod origin;
pub mod packed;
pub mod params;
pub mod queries;
pub mod ranking;
pub mod retopos;
pub mod samples;
pub mod stream;
pub mod tokens;
pub mod upload;
pub mod uploads;
pub mod watchful;

#[cfg(test)]
mod tests;

use crate::app::App;
use axum::body::Body;
use axum::extract::DefaultBodyLimit;
use axum::http::Request;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{get, post};
use axum::{Router, response::IntoResponse};
use error::HttpError;
use tower::ServiceBuilder;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// All routes, with all that happens around them, the outermost layer first.
pub fn router(app: App) -> Router {
    let (documented, api) = documented().split_for_parts();
    // Set once: the routes are the same however often this is called.
    let _ = app.openapi.set(packed::Text::kept(openapi::finished(&api)));
    let known = known::KnownParameters::of(&serde_json::to_value(&api).unwrap_or_default());
    // The body is limited on the wire here, and unpacked and limited again where it is read.
    let layers = ServiceBuilder::new()
        .layer(from_fn_with_state(app.clone(), forward::receive))
        .layer(from_fn(watchful::identify))
        .layer(from_fn(origin::harden))
        .layer(from_fn(watchful::guard))
        .layer(from_fn(watchful::measure))
        .layer(from_fn_with_state(app.clone(), origin::check))
        .layer(from_fn_with_state(app.clone(), uploads::announce))
        .option_layer(origin::cors(&app.settings.allowed_origins))
        .layer(from_fn_with_state(app.clone(), caller::authorize))
        .layer(from_fn_with_state(app.clone(), caller::own))
        .layer(from_fn_with_state(known, known::check))
        .layer(from_fn_with_state(app.clone(), body::limit))
        .layer(from_fn_with_state(app.clone(), forward::pass));
    documented
        .route(forward::shares::PATH, post(forward::shares::answer))
        .route("/openapi.json", get(openapi::get))
        .route("/docs", get(docs::docs))
        .route("/", get(docs::index))
        .route("/web/{name}", get(docs::asset))
        .fallback(no_route)
        .method_not_allowed_fallback(method_not_allowed)
        // Ours are on the stream: see `body`.
        .layer(DefaultBodyLimit::disable())
        .layer(layers)
        .with_state(app)
}

/// The routes of the contract.
fn documented() -> OpenApiRouter<App> {
    OpenApiRouter::with_openapi(openapi::head())
        .routes(routes!(examples::add, examples::list))
        .routes(routes!(examples::get, examples::annotate, examples::remove))
        .routes(routes!(examples::mesh))
        .routes(routes!(examples::thumbnail))
        .routes(routes!(examples::encoding))
        .routes(routes!(queries::start, queries::list))
        .routes(routes!(queries::get, queries::annotate, queries::cancel))
        .routes(routes!(queries::restart))
        .routes(routes!(queries::mesh))
        .routes(routes!(ranking::get))
        .routes(routes!(stream::stream))
        .routes(routes!(maps::create, maps::list))
        .routes(routes!(maps::get, maps::remove))
        .routes(routes!(maps::stream))
        .routes(routes!(maps::mesh))
        .routes(routes!(maps::preview))
        .routes(routes!(maps::constrain))
        .routes(routes!(compositions::create, compositions::list))
        .routes(routes!(compositions::get, compositions::remove))
        .routes(routes!(compositions::stream))
        .routes(routes!(compositions::mesh))
        .routes(routes!(compositions::preview))
        .routes(routes!(retopos::create, retopos::list))
        .routes(routes!(retopos::get, retopos::remove))
        .routes(routes!(retopos::stream))
        .merge(uploaded())
        .routes(routes!(samples::list))
        .routes(routes!(samples::mesh))
        .routes(routes!(admin::status))
        .routes(routes!(admin::check))
        .routes(routes!(admin::backup))
        .routes(routes!(tokens::list, tokens::create))
        .routes(routes!(tokens::annotate, tokens::revoke))
        .routes(routes!(health::alive))
        .routes(routes!(health::ready))
        .routes(routes!(health::metrics))
}

/// The routes of uploads. They speak tus, and refuse other versions of it.
fn uploaded() -> OpenApiRouter<App> {
    OpenApiRouter::new()
        .routes(routes!(uploads::protocol, uploads::begin))
        .routes(routes!(uploads::standing, uploads::append, uploads::remove))
        .route_layer(from_fn(uploads::speak))
}

async fn no_route(request: Request<Body>) -> impl IntoResponse {
    HttpError::NoRoute { path: request.uri().path().into() }
}

async fn method_not_allowed(request: Request<Body>) -> impl IntoResponse {
    HttpError::MethodNotAllowed { path: request.uri().path().into(), method: request.method().to_string() }
}
