//! Access tokens `rope_<id>_<secret>`: who asks, and what they may do.

use super::Problem;
use crate::app::App;
use crate::store::StoreError;
use crate::store::digest::hex;
use crate::store::tokens::{Role, Token};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, header};
use axum::middleware::Next;
use axum::response::Response;
use rand::TryRngCore;
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;

/// Who asks. Found in the extensions of every request that got past [`authorise`].
#[derive(Debug, Clone, PartialEq)]
pub struct Caller {
    /// Id of the token.
    pub token_id: String,
    /// Name of the token.
    pub name: String,
    /// What it may do.
    pub role: Role,
}

/// Roles that may use a group of routes.
pub type Roles = &'static [Role];
/// Nobody but administrators.
pub const ADMIN: Roles = &[Role::Admin];
/// Those who run inspections.
pub const OPERATORS: Roles = &[Role::Admin, Role::Operator];
/// Those who deliver acquisitions.
pub const UPLOADERS: Roles = &[Role::Admin, Role::Operator, Role::Upload];
/// Those who read results.
pub const READERS: Roles = &[Role::Admin, Role::Operator, Role::Read, Role::Ticketing];
/// Everybody with a token.
pub const EVERYBODY: Roles = &Role::ALL;
/// Those who write tickets back.
pub const TICKETERS: Roles = &[Role::Admin, Role::Operator, Role::Ticketing];

/// Makes a token; the secret is returned and nowhere else.
pub async fn issue(
    app_store: &crate::store::Store,
    name: &str,
    role: Role,
    now_ms: i64,
) -> Result<(Token, String), StoreError> {
    let mut random = [0_u8; 40];
    rand::rngs::OsRng.try_fill_bytes(&mut random).map_err(|e| StoreError::File {
        path: "the random source of the system".into(),
        source: std::io::Error::other(e.to_string()),
    })?;
    let (id, secret) = (hex(&random[..8]), hex(&random[8..]));
    let token = app_store.add_token(&id, name, role, &digest(&secret), now_ms).await?;
    Ok((token, format!("rope_{id}_{secret}")))
}

fn digest(secret: &str) -> Vec<u8> {
    Sha256::digest(secret.as_bytes()).to_vec()
}

fn split(token: &str) -> Option<(&str, &str)> {
    token.strip_prefix("rope_")?.split_once('_')
}

/// Finds out who asks. Errors: 401 without a valid token; the answer does not tell what exactly was wrong with a token.
pub async fn authenticate(app: &App, headers: &HeaderMap) -> Result<Caller, Problem> {
    let Some(value) = headers.get(header::AUTHORIZATION) else {
        return Err(Problem::unauthorized("the request has no Authorization header (Bearer rope_...)"));
    };
    let invalid = || Problem::unauthorized("the access token is not valid");
    let text = value.to_str().map_err(|_| invalid())?;
    let (scheme, token) = text.split_once(' ').ok_or_else(invalid)?;
    let (id, secret) = split(token.trim()).filter(|_| scheme.eq_ignore_ascii_case("bearer")).ok_or_else(invalid)?;
    let Some(row) = app.store.token(id).await? else { return Err(invalid()) };
    let matches: bool = digest(secret).ct_eq(&row.secret_sha256).into();
    let role = Role::of_name(&row.role).ok_or_else(invalid)?;
    if !matches || row.revoked_at_ms.is_some() {
        return Err(invalid());
    }
    Ok(Caller { token_id: row.id, name: row.name, role })
}

impl Caller {
    /// Itself, if it has one of these roles. Errors: 403 with the roles that would do.
    pub fn one_of(self, roles: Roles) -> Result<Self, Problem> {
        if roles.contains(&self.role) {
            return Ok(self);
        }
        let needed: Vec<_> = roles.iter().map(|r| r.name()).collect();
        Err(Problem::forbidden(format!(
            "the token has the role {}, but this needs one of: {}",
            self.role.name(),
            needed.join(", ")
        ))
        .limit(self.role.name(), needed))
    }
}

/// Lets a request pass if its token has one of the roles of this group of routes.
pub async fn authorise(
    State((app, roles)): State<(App, Roles)>,
    mut request: Request,
    next: Next,
) -> Result<Response, Problem> {
    let caller = authenticate(&app, request.headers()).await?.one_of(roles)?;
    request.extensions_mut().insert(caller);
    Ok(next.run(request).await)
}
