//! `/v1/tokens`: who may use the service. For admins.

use super::body::Message;
use super::error::HttpError;
use super::negotiate::ResponsePreferences;
use super::params::PathIds;
use crate::app::App;
use crate::auth::{AuthError, Tokens};
use crate::work::WorkError;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::Response;
use quadmuse_proto::id::TokenId;
use quadmuse_proto::{CreatedToken, NewToken, Page, Token, TokenPatch};

/// Off tokio's threads: the list is read, and synced when it changes.
async fn blocking<T: Send + 'static>(
    app: &App,
    change: impl FnOnce(&Tokens) -> Result<T, AuthError> + Send + 'static,
) -> Result<T, HttpError> {
    let tokens = std::sync::Arc::clone(&app.tokens);
    let task = app.work.background.spawn_blocking(move || change(&tokens));
    Ok(task.await.map_err(|_| HttpError::Work(WorkError::Lost))??)
}

/// Lists the tokens, without what makes them secret.
#[utoipa::path(
    get, path = "/v1/tokens", tag = "admin",
    responses((status = 200, description = "All tokens", body = Page<Token>))
)]
pub async fn list(State(app): State<App>, wants: ResponsePreferences) -> Result<Response, HttpError> {
    let items = blocking(&app, Tokens::list).await?.iter().map(crate::auth::TokenRecord::to_wire).collect();
    wants.show(&Page::<Token> { items, next: None })
}

/// Creates a token. Its secret is told this once.
#[utoipa::path(
    post, path = "/v1/tokens", tag = "admin", request_body = NewToken,
    responses((status = 201, description = "Created", body = CreatedToken))
)]
pub async fn create(
    State(app): State<App>,
    wants: ResponsePreferences,
    new: Message<NewToken>,
) -> Result<Response, HttpError> {
    let (secret, record) = blocking(&app, move |tokens| tokens.create(&new.value)).await?;
    let location = format!("/v1/tokens/{}", record.id);
    wants.answer(StatusCode::CREATED, Some(location), &CreatedToken { secret, token: record.to_wire() })
}

/// Changes a token's name or quota.
#[utoipa::path(
    patch, path = "/v1/tokens/{id}", tag = "admin",
    params(("id" = TokenId, Path)), request_body = TokenPatch,
    responses((status = 200, description = "The token now", body = Token))
)]
pub async fn annotate(
    State(app): State<App>,
    wants: ResponsePreferences,
    PathIds((id,)): PathIds<(TokenId,)>,
    patch: Message<TokenPatch>,
) -> Result<Response, HttpError> {
    let record = blocking(&app, move |tokens| tokens.annotate(&id.to_string(), &patch.value)).await?;
    wants.answer(StatusCode::OK, None, &record.to_wire())
}

/// Revokes a token.
#[utoipa::path(
    delete, path = "/v1/tokens/{id}", tag = "admin", params(("id" = TokenId, Path)),
    responses((status = 204, description = "Revoked"))
)]
pub async fn revoke(State(app): State<App>, PathIds((id,)): PathIds<(TokenId,)>) -> Result<StatusCode, HttpError> {
    blocking(&app, move |tokens| tokens.revoke(&id.to_string())).await?;
    Ok(StatusCode::NO_CONTENT)
}
