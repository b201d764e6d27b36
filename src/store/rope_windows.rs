//! Windows of rope over which surface alarms are counted, with limits: the usual ones, or those set for a rope.

use super::{Id, Store, StoreError};
use crate::pipeline::surface_alarms::{RopeWindow, WindowUnit, usual};

/// A window as it is stored.
#[derive(sqlx::FromRow)]
struct Row {
    unit: String,
    length: f64,
    most_surface_alarms: Option<u32>,
}

impl TryFrom<Row> for RopeWindow {
    type Error = StoreError;

    fn try_from(row: Row) -> Result<Self, StoreError> {
        let unit = WindowUnit::ALL.into_iter().find(|unit| unit.name() == row.unit);
        let unit = unit.ok_or_else(|| StoreError::Inconsistent {
            table: "rope_window",
            column: "unit",
            row: row.length.to_string(),
            value: row.unit.clone(),
        })?;
        Ok(Self { unit, length: row.length, most_surface_alarms: row.most_surface_alarms })
    }
}

impl Store {
    /// The windows of a rope, shortest first of each unit.
    pub async fn rope_windows(&self, rope: Id) -> Result<Vec<RopeWindow>, StoreError> {
        let set: Vec<Row> = sqlx::query_as(
            "select unit, length, most_surface_alarms from rope_window where rope_id = $1 order by unit, length",
        )
        .bind(rope)
        .fetch_all(self.reader())
        .await?;
        if set.is_empty() {
            return Ok(usual());
        }
        set.into_iter().map(RopeWindow::try_from).collect()
    }

    /// Sets the windows of a rope, which must exist; none: the usual ones again.
    pub async fn set_rope_windows(&self, rope: Id, windows: &[RopeWindow]) -> Result<(), StoreError> {
        let mut tx = self.write().await?;
        sqlx::query("delete from rope_window where rope_id = $1").bind(rope).execute(&mut *tx).await?;
        for window in windows {
            sqlx::query("insert into rope_window (rope_id, unit, length, most_surface_alarms) values ($1, $2, $3, $4)")
                .bind(rope)
                .bind(window.unit.name())
                .bind(window.length)
                .bind(window.most_surface_alarms)
                .execute(&mut *tx)
                .await?;
        }
        tx.commit().await?;
        Ok(())
    }
}
