//! Access tokens.

use super::auth::issue;
use super::extract::{Json, Path};
use super::problem::{ReadProblems, WriteProblems};
use super::ropeways::{MAX_NAME, check_text};
use super::{Problem, times};
use crate::app::App;
use crate::store::tokens::{self, Role};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// An access token, without its secret.
#[derive(Debug, Serialize, ToSchema)]
pub struct Token {
    /// Public part of the token.
    #[schema(example = "0123456789abcdef")]
    id: String,
    /// Who or what uses it.
    name: String,
    /// Name of its role.
    role: String,
    /// When it was made.
    #[schema(format = DateTime)]
    created_at: String,
    /// When it was revoked; null while it is valid.
    #[schema(required, format = DateTime)]
    revoked_at: Option<String>,
    /// The token itself; only in the answer that made it.
    #[serde(skip_serializing_if = "Option::is_none")]
    token: Option<String>,
}

/// All tokens.
#[derive(Debug, Serialize, ToSchema)]
pub struct TokenList {
    /// The tokens, oldest first.
    items: Vec<Token>,
    /// Always null: there is one page.
    #[schema(required)]
    next_cursor: Option<String>,
}

/// A token to be made.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewToken {
    /// Who or what will use it.
    #[schema(min_length = 1, max_length = 200)]
    name: String,
    /// What it may do.
    role: Role,
}

impl From<tokens::Token> for Token {
    fn from(row: tokens::Token) -> Self {
        Self {
            id: row.id,
            name: row.name,
            role: row.role,
            created_at: times::rfc3339(row.created_at_ms),
            revoked_at: row.revoked_at_ms.map(times::rfc3339),
            token: None,
        }
    }
}

/// Make a token; the answer is the only one that shows it
#[utoipa::path(post, path = "/tokens", tag = "tokens", request_body = NewToken, responses(
    (status = 201, description = "It was made", body = Token, headers(("location" = String, description = "Its address"))),
    WriteProblems))]
pub async fn create_token(State(app): State<App>, Json(body): Json<NewToken>) -> Result<Response, Problem> {
    check_text("name", &body.name, 1, MAX_NAME)?;
    let (row, token) = issue(&app.store, &body.name, body.role, app.now_ms()).await?;
    let address = format!("/api/v1/tokens/{}", row.id);
    let view = Token { token: Some(token), ..row.into() };
    Ok((StatusCode::CREATED, [(header::LOCATION, address)], axum::Json(view)).into_response())
}

/// All tokens, without their secrets
#[utoipa::path(get, path = "/tokens", tag = "tokens",
    responses((status = 200, description = "The tokens", body = TokenList), ReadProblems))]
pub async fn list_tokens(State(app): State<App>) -> Result<axum::Json<TokenList>, Problem> {
    let items = app.store.tokens().await?.into_iter().map(Token::from).collect();
    Ok(axum::Json(TokenList { items, next_cursor: None }))
}

/// Revoke a token
#[utoipa::path(delete, path = "/tokens/{id}", tag = "tokens", params(("id" = String, Path, description = "Public part of the token")),
    responses((status = 204, description = "It is not valid any more"), WriteProblems))]
pub async fn revoke_token(State(app): State<App>, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    if app.store.revoke_token(&id, app.now_ms()).await? {
        Ok(StatusCode::NO_CONTENT)
    } else {
        Err(Problem::no("token", id))
    }
}
