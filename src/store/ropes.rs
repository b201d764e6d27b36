//! Ropes and their designs.

use super::{Created, Id, Page, PageRequest, Store, StoreError};
use crate::vision::rope::RopeDesign;

/// A rope of a ropeway. Its design was validated before it was stored.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Rope {
    /// Order of arrival.
    pub seq: i64,
    /// Id.
    pub id: Id,
    /// The ropeway it belongs to.
    pub ropeway_id: Id,
    /// Its name.
    pub name: String,
    /// Design.
    #[sqlx(flatten)]
    pub design: Design,
    /// Peak score at or above which a defect is ticketed without a person; `None`: never.
    pub ticket_level: Option<f64>,
    /// When it was created, ms since 1970.
    pub created_at_ms: i64,
}

/// The design of a rope as somebody entered it, with the tolerances of its lay lengths.
#[derive(Debug, Clone, PartialEq, sqlx::FromRow)]
pub struct Design {
    /// Number of strands.
    pub strands: u32,
    /// Outer wires per strand.
    pub wires_per_strand: u32,
    /// Rope diameter in mm.
    pub rope_diameter_mm: f64,
    /// Nominal strand lay in mm, signed.
    pub strand_lay_mm: Option<f64>,
    /// Nominal wire lay in mm, signed, against the fixed axes.
    pub wire_lay_mm: Option<f64>,
    /// Strand diameter in mm, if stated.
    pub strand_diameter_mm: Option<f64>,
    /// Wire diameter in mm, if stated.
    pub wire_diameter_mm: Option<f64>,
    /// Allowed departure of the strand lay in mm.
    pub strand_lay_tolerance_mm: Option<f64>,
    /// Allowed departure of the wire lay in mm.
    pub wire_lay_tolerance_mm: Option<f64>,
}

impl Design {
    /// The part of the design that vision validates.
    pub fn rope_design(&self) -> RopeDesign {
        RopeDesign {
            strands: self.strands as usize,
            wires_per_strand: self.wires_per_strand as usize,
            diameter_mm: self.rope_diameter_mm,
            strand_lay_mm: self.strand_lay_mm,
            wire_lay_mm: self.wire_lay_mm,
            strand_diameter_mm: self.strand_diameter_mm,
            wire_diameter_mm: self.wire_diameter_mm,
        }
    }
}

/// A rope to be created.
#[derive(Debug, Clone, PartialEq)]
pub struct NewRope {
    /// Id.
    pub id: Id,
    /// The ropeway it belongs to.
    pub ropeway_id: Id,
    /// Its name.
    pub name: String,
    /// Its validated design.
    pub design: Design,
    /// See [`Rope::ticket_level`].
    pub ticket_level: Option<f64>,
}

impl Store {
    /// Names of a rope and of its ropeway.
    pub async fn names_of(&self, rope: Id) -> Result<(String, String), StoreError> {
        Ok(sqlx::query_as("select r.name, w.name from rope r join ropeway w on w.id = r.ropeway_id where r.id = $1")
            .bind(rope)
            .fetch_one(self.reader())
            .await?)
    }

    /// Creates a rope, or finds the one that the same call created before. The ropeway must exist.
    pub async fn create_rope(&self, new: &NewRope, now_ms: i64) -> Result<Created<Rope>, StoreError> {
        let mut tx = self.write().await?;
        let design = &new.design;
        let inserted = sqlx::query(
            "insert into rope (id, ropeway_id, name, strands, wires_per_strand, rope_diameter_mm, strand_lay_mm, wire_lay_mm,
               strand_diameter_mm, wire_diameter_mm, strand_lay_tolerance_mm, wire_lay_tolerance_mm, ticket_level, created_at_ms)
             values ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14) on conflict (id) do nothing",
        )
        .bind(new.id)
        .bind(new.ropeway_id)
        .bind(&new.name)
        .bind(design.strands)
        .bind(design.wires_per_strand)
        .bind(design.rope_diameter_mm)
        .bind(design.strand_lay_mm)
        .bind(design.wire_lay_mm)
        .bind(design.strand_diameter_mm)
        .bind(design.wire_diameter_mm)
        .bind(design.strand_lay_tolerance_mm)
        .bind(design.wire_lay_tolerance_mm)
        .bind(new.ticket_level)
        .bind(now_ms)
        .execute(&mut *tx)
        .await?
        .rows_affected();
        let row: Rope = sqlx::query_as("select * from rope where id = $1").bind(new.id).fetch_one(&mut *tx).await?;
        tx.commit().await?;
        // The ticket level is not compared: it may have been changed since.
        let same = row.ropeway_id == new.ropeway_id && row.name == new.name && row.design == new.design;
        Ok(match inserted {
            1 => Created::New(row),
            _ if same => Created::Same(row),
            _ => Created::Different,
        })
    }

    /// A rope.
    pub async fn rope(&self, id: Id) -> Result<Option<Rope>, StoreError> {
        Ok(sqlx::query_as("select * from rope where id = $1").bind(id).fetch_optional(self.reader()).await?)
    }

    /// Ropes, of one ropeway or of all, page by page.
    pub async fn ropes(&self, ropeway: Option<Id>, page: PageRequest) -> Result<Page<Rope>, StoreError> {
        let rows = sqlx::query_as(
            "select * from rope where ($1 is null or ropeway_id = $1) and seq < $2 order by seq desc limit $3",
        )
        .bind(ropeway)
        .bind(page.before_seq())
        .bind(page.fetch())
        .fetch_all(self.reader())
        .await?;
        Ok(page.page(rows, |r: &Rope| r.seq))
    }

    /// Sets or clears the ticket level. `None` if there is no such rope.
    pub async fn set_ticket_level(&self, id: Id, level: Option<f64>) -> Result<Option<Rope>, StoreError> {
        let mut tx = self.write().await?;
        let row = sqlx::query_as("update rope set ticket_level = $2 where id = $1 returning *")
            .bind(id)
            .bind(level)
            .fetch_optional(&mut *tx)
            .await?;
        tx.commit().await?;
        Ok(row)
    }
}
