//! Access tokens: the secret is shown once, only its SHA-256 is stored.

use super::{Store, StoreError};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What the holder of a token may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Everything.
    Admin,
    /// Everything but tokens and webhook endpoints.
    Operator,
    /// Reads ropes, writes acquisitions and frames.
    Upload,
    /// Reads.
    Read,
    /// Reads, and writes tickets back.
    Ticketing,
}

impl Role {
    /// All roles.
    pub const ALL: [Self; 5] = [Self::Admin, Self::Operator, Self::Upload, Self::Read, Self::Ticketing];

    /// Its name in the database, on the command line and in the API.
    pub fn name(self) -> &'static str {
        match self {
            Self::Admin => "admin",
            Self::Operator => "operator",
            Self::Upload => "upload",
            Self::Read => "read",
            Self::Ticketing => "ticketing",
        }
    }

    /// What it allows, for people.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Admin => "Everything",
            Self::Operator => "Everything but tokens and webhook endpoints",
            Self::Upload => "Reads ropes, writes acquisitions and frames",
            Self::Read => "Reads",
            Self::Ticketing => "Reads, and writes tickets back",
        }
    }

    /// The role of that name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.name() == name)
    }
}

/// A token without its secret.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Token {
    /// Order of arrival.
    pub seq: i64,
    /// Public part, 16 hex digits.
    pub id: String,
    /// Who or what uses it.
    pub name: String,
    /// Name of its [`Role`].
    pub role: String,
    /// Digest of the secret.
    pub secret_sha256: Vec<u8>,
    /// When it was made, ms since 1970.
    pub created_at_ms: i64,
    /// When it was revoked, ms since 1970.
    pub revoked_at_ms: Option<i64>,
}

impl Store {
    /// Records a token.
    pub async fn add_token(
        &self,
        id: &str,
        name: &str,
        role: Role,
        secret_sha256: &[u8],
        now_ms: i64,
    ) -> Result<Token, StoreError> {
        let mut tx = self.write().await?;
        let row = sqlx::query_as(
            "insert into token (id, name, role, secret_sha256, created_at_ms) values ($1, $2, $3, $4, $5) returning *",
        )
        .bind(id)
        .bind(name)
        .bind(role.name())
        .bind(secret_sha256)
        .bind(now_ms)
        .fetch_one(&mut *tx)
        .await?;
        tx.commit().await?;
        Ok(row)
    }

    /// A token, revoked or not.
    pub async fn token(&self, id: &str) -> Result<Option<Token>, StoreError> {
        Ok(sqlx::query_as("select * from token where id = $1").bind(id).fetch_optional(self.reader()).await?)
    }

    /// All tokens, oldest first. There are few: one a laptop, dashboard or system.
    pub async fn tokens(&self) -> Result<Vec<Token>, StoreError> {
        Ok(sqlx::query_as("select * from token order by seq").fetch_all(self.reader()).await?)
    }

    /// Revokes a token; one that was revoked before stays so since then. False if there is no such token.
    pub async fn revoke_token(&self, id: &str, now_ms: i64) -> Result<bool, StoreError> {
        let mut tx = self.write().await?;
        let rows = sqlx::query("update token set revoked_at_ms = coalesce(revoked_at_ms, $2) where id = $1")
            .bind(id)
            .bind(now_ms)
            .execute(&mut *tx)
            .await?
            .rows_affected();
        tx.commit().await?;
        Ok(rows == 1)
    }
}
