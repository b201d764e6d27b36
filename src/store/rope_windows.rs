//! Windows of rope over which surface alarms are counted, with limits: the usual ones, or those set for a rope.

use super::{Id, Store, StoreError};

/// A window of rope, as rules for ropes state it.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct RopeWindow {
    /// `diameter` or `lay`: what the length is counted in.
    pub unit: String,
    /// Length in these units.
    pub length: f64,
    /// More surface alarms in it are over the limit; `None`: no limit.
    pub most_surface_alarms: Option<u32>,
}

/// The reference lengths of rules for crane ropes and ropeways, and one lay. Limits depend on rope and rule, so there are none.
fn usual() -> Vec<RopeWindow> {
    let diameters = [6.0, 30.0, 40.0, 500.0].map(|length| ("diameter", length));
    diameters
        .into_iter()
        .chain([("lay", 1.0)])
        .map(|(unit, length)| RopeWindow { unit: unit.to_owned(), length, most_surface_alarms: None })
        .collect()
}

impl Store {
    /// The windows of a rope, shortest first of each unit.
    pub async fn rope_windows(&self, rope: Id) -> Result<Vec<RopeWindow>, StoreError> {
        let set: Vec<RopeWindow> = sqlx::query_as(
            "select unit, length, most_surface_alarms from rope_window where rope_id = $1 order by unit, length",
        )
        .bind(rope)
        .fetch_all(self.reader())
        .await?;
        Ok(if set.is_empty() { usual() } else { set })
    }

    /// Sets the windows of a rope, which must exist; none: the usual ones again.
    pub async fn set_rope_windows(&self, rope: Id, windows: &[RopeWindow]) -> Result<(), StoreError> {
        let mut tx = self.write().await?;
        sqlx::query("delete from rope_window where rope_id = $1").bind(rope).execute(&mut *tx).await?;
        for window in windows {
            sqlx::query("insert into rope_window (rope_id, unit, length, most_surface_alarms) values ($1, $2, $3, $4)")
                .bind(rope)
                .bind(&window.unit)
                .bind(window.length)
                .bind(window.most_surface_alarms)
                .execute(&mut *tx)
                .await?;
        }
        tx.commit().await?;
        Ok(())
    }
}
