//! What lasts: SQLite for facts, files for bulk. Only here is SQL.
//!
//! Reading order: [`Store`] (connections), [`folder`] (files and who else works on them), then one file a table.

pub mod acquisitions;
pub mod archives;
pub mod backup;
pub mod completion;
pub mod defects;
pub mod deliveries;
pub mod digest;
pub mod enqueue;
pub mod folder;
pub mod frames;
mod id;
pub mod inspection_thresholds;
pub mod inspections;
pub mod jobs;
pub mod lay_lengths;
pub mod leases;
pub mod manifest;
pub mod missing;
pub mod model_thresholds;
pub mod models;
pub mod outbox;
mod preview_removal;
pub mod previewed;
pub mod previews;
pub mod provisional;
pub mod quota;
pub mod receipts;
pub mod retention;
mod rope_file;
pub mod rope_windows;
pub mod ropes;
pub mod ropeways;
pub mod tickets;
pub mod tokens;
pub mod verification;
pub mod wanted;
pub mod webhook_endpoints;

pub use folder::DataFolder;
pub use id::Id;

use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Sqlite, SqlitePool, Transaction};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::sync::watch;

/// Connections that only read.
const READERS: u32 = 4;
/// How long a writer waits for the writer of another process.
const BUSY_TIMEOUT: Duration = Duration::from_secs(15);

static MIGRATIONS: sqlx::migrate::Migrator = sqlx::migrate!("./migrations");

/// Why the store could not do its work. None of these is the client's fault.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database refused.
    #[error("database: {0}")]
    Database(#[from] sqlx::Error),
    /// The schema could not be brought up to date.
    #[error("migration of the database: {0}")]
    Migration(#[from] sqlx::migrate::MigrateError),
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// Another service already works on this data folder.
    #[error("{path} is in use by another `serve`: a data folder has one service (and any number of `worker`s)")]
    InUse {
        /// The data folder.
        path: PathBuf,
    },
    /// A row that the program could not have written.
    #[error("table {table}, row {row}: column {column} holds {value}")]
    Inconsistent {
        /// The table.
        table: &'static str,
        /// The column.
        column: &'static str,
        /// Key of the row.
        row: String,
        /// What stands there, or what is wrong with it.
        value: String,
    },
}

impl StoreError {
    /// True when the disk has no room.
    pub fn disk_full(&self) -> bool {
        const SQLITE_FULL: &str = "13";
        match self {
            Self::File { source, .. } => {
                matches!(source.kind(), std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded)
            }
            Self::Database(sqlx::Error::Database(error)) => error.code().is_some_and(|code| code == SQLITE_FULL),
            _ => false,
        }
    }
}

/// What came of creating something under an id that the client may have used before.
#[derive(Debug, Clone, PartialEq)]
pub enum Created<T> {
    /// It was not there; now it is.
    New(T),
    /// It was there already, with the same content.
    Same(T),
    /// The id belongs to something else; nothing was changed.
    Different,
}

/// A page of a list, newest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Page<T> {
    /// The items.
    pub items: Vec<T>,
    /// Where the next page begins; `None` on the last one.
    pub next: Option<i64>,
}

/// Which page of a list.
#[derive(Debug, Clone, Copy)]
pub struct PageRequest {
    /// Only items that came before this one (`Page::next` of the page before).
    pub before: Option<i64>,
    /// Most items.
    pub limit: u32,
}

impl PageRequest {
    fn before_seq(self) -> i64 {
        self.before.unwrap_or(i64::MAX)
    }

    /// One more than asked for: its presence tells that there is a next page.
    fn fetch(self) -> i64 {
        i64::from(self.limit) + 1
    }

    fn page<T>(self, mut items: Vec<T>, seq: impl Fn(&T) -> i64) -> Page<T> {
        let more = items.len() > self.limit as usize;
        items.truncate(self.limit as usize);
        let next = if more { items.last().map(seq) } else { None };
        Page { items, next }
    }
}

/// The database and the folder around it. Cheap to clone.
///
/// One writing connection a process (writers of one process queue here instead of failing as busy), several reading ones.
#[derive(Debug, Clone)]
pub struct Store {
    writer: SqlitePool,
    reader: SqlitePool,
    folder: DataFolder,
    /// Told when a frame was recorded or an acquisition completed by this process.
    arrivals: watch::Sender<()>,
    findings: watch::Sender<()>,
}

impl Store {
    /// Opens or makes the data folder and brings its schema up to date.
    pub async fn open(folder: &Path) -> Result<Self, StoreError> {
        let folder = DataFolder::open(folder)?;
        let options = SqliteConnectOptions::new()
            .filename(folder.database())
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full) // acknowledged means durable
            .busy_timeout(BUSY_TIMEOUT)
            .foreign_keys(true);
        let writer = SqlitePoolOptions::new()
            .max_connections(1)
            .acquire_timeout(Duration::from_secs(30))
            .connect_with(options.clone())
            .await?;
        MIGRATIONS.run(&writer).await?;
        let reader = SqlitePoolOptions::new()
            .max_connections(READERS)
            .acquire_timeout(Duration::from_secs(30))
            .connect_with(options.pragma("query_only", "on"))
            .await?;
        Ok(Self { writer, reader, folder, arrivals: watch::Sender::new(()), findings: watch::Sender::new(()) })
    }

    /// The files beside the database.
    pub fn folder(&self) -> &DataFolder {
        &self.folder
    }

    /// Changes whenever this process has recorded a frame or completed an acquisition, of whatever acquisition. What other
    /// processes do is not heard here.
    pub fn arrivals(&self) -> watch::Receiver<()> {
        self.arrivals.subscribe()
    }

    /// Tells when a running job of this process has found something.
    pub fn findings(&self) -> watch::Receiver<()> {
        self.findings.subscribe()
    }

    /// Begins a transaction that writes. Immediate: a transaction that reads first and writes later fails at once when
    /// another process wrote in between, and no busy timeout helps.
    pub async fn write(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.writer.begin_with("begin immediate").await?)
    }

    /// The writing connection, for loops that make their own transactions.
    pub fn writer(&self) -> &SqlitePool {
        &self.writer
    }

    /// Connections for reading.
    pub fn reader(&self) -> &SqlitePool {
        &self.reader
    }

    /// True when the database answers.
    pub async fn ready(&self) -> bool {
        sqlx::query("select 1").execute(&self.reader).await.is_ok()
    }

    /// Closes all connections; the last one folds the write-ahead log into the database.
    pub async fn close(&self) {
        self.reader.close().await;
        self.writer.close().await;
    }
}
