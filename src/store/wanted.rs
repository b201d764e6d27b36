//! In which order frames are wanted that are announced and not there: suspicious ones first, the rest along the rope.

use super::{Id, Store, StoreError};

/// A frame that is wanted.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Wanted {
    /// The view.
    pub view: u32,
    /// The frame.
    pub frame: u32,
    /// Camera line of the view at which it begins, if its preview is there.
    pub first_line: Option<i64>,
    /// Its camera lines.
    pub lines: u32,
    /// How soon it is wanted; `None`: in its turn.
    pub suspicion: Option<f64>,
    /// Why it is wanted sooner.
    pub reason: Option<String>,
}

impl Store {
    /// Announced frames that are not there, or damaged, in the order in which they are wanted.
    pub async fn wanted(&self, acquisition: Id, limit: u32) -> Result<Vec<Wanted>, StoreError> {
        Ok(sqlx::query_as(
            "select n.view, n.frame, p.first_line, n.lines, p.suspicion, p.reason from announced_frame n
             left join preview p on p.acquisition_id = n.acquisition_id and p.view = n.view and p.frame = n.frame
             where n.acquisition_id = $1 and not exists (select 1 from frame f where f.acquisition_id = n.acquisition_id
               and f.view = n.view and f.frame = n.frame and f.damaged_at_ms is null)
             order by p.suspicion desc nulls last, n.frame, n.view limit $2",
        )
        .bind(acquisition)
        .bind(limit)
        .fetch_all(self.reader())
        .await?)
    }
}
