//! A defect as the API shows it.

use super::suggestion::Suggestion;
use super::tickets::Ticket;
use super::times;
use crate::pipeline::results::AlarmRow;
use crate::store::{StoreError, defects};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// A run of lines of one view in which one strand is above the threshold.
#[derive(Debug, Serialize, ToSchema)]
pub struct Alarm {
    /// The view.
    view: usize,
    /// The strand; null in inspections of before alarms had one.
    #[schema(required)]
    strand: Option<usize>,
    /// First line.
    first_line: usize,
    /// Last line.
    last_line: usize,
    /// First column.
    first_column: usize,
    /// Last column.
    last_column: usize,
    /// Highest score of the strand in it.
    peak_score: f64,
}

impl From<AlarmRow> for Alarm {
    fn from(a: AlarmRow) -> Self {
        Self {
            view: a.view,
            strand: a.strand,
            first_line: a.first_line,
            last_line: a.last_line,
            first_column: a.first_column,
            last_column: a.last_column,
            peak_score: a.peak_score,
        }
    }
}

/// What people decided about a defect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum DefectState {
    /// Nobody decided yet.
    Open,
    /// It is one.
    Confirmed,
    /// It is none.
    Dismissed,
}

/// How sure it is that something is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DefectLevel {
    /// Over the threshold: a defect.
    Alarm,
    /// Over the second level only: worth looking at again.
    LookAgain,
}

/// A decision, with who made it.
#[derive(Debug, Serialize, ToSchema)]
pub struct Decision {
    /// Who decided.
    #[schema(required)]
    by: Option<String>,
    /// What they said.
    #[schema(required)]
    comment: Option<String>,
    /// When.
    #[schema(required, format = DateTime)]
    at: Option<String>,
}

/// Alarms of one cause, merged over lines, wires, strands and views.
#[derive(Debug, Serialize, ToSchema)]
pub struct Defect {
    /// Id.
    defect_id: Uuid,
    /// The inspection that found it.
    inspection_id: Uuid,
    /// The rope.
    rope_id: Uuid,
    /// Number within the inspection, from 0, as the job gave it: defects along the rope, then places to look at again along it.
    number: u32,
    /// Which threshold it is over; another one may have been applied since the job.
    level: DefectLevel,
    /// Rope metre where it begins.
    from_m: f64,
    /// Rope metre where it ends.
    to_m: f64,
    /// Strand, if it is known.
    #[schema(required)]
    strand: Option<u32>,
    /// Wire in the strand, if it is known.
    #[schema(required)]
    wire: Option<u32>,
    /// Angle of its peak round the rope, rope axes: 0 faces a camera at angle 0; null in inspections of earlier versions.
    #[schema(required)]
    angle_deg: Option<f64>,
    /// Highest line score of its alarms.
    peak_score: f64,
    /// 1 for the highest peak of its level, and so on; null in inspections of earlier versions.
    #[schema(required)]
    rank: Option<u32>,
    /// What it is likely to be; null in inspections of earlier versions.
    #[schema(required)]
    suggestion: Option<Suggestion>,
    /// Its alarms.
    alarms: Vec<Alarm>,
    /// What people decided.
    state: DefectState,
    /// Who decided; null while it is open.
    #[schema(required)]
    verdict: Option<Decision>,
    /// The ticket; null until the maintenance system wrote it back.
    #[schema(required)]
    ticket: Option<Ticket>,
    /// When it was found.
    #[schema(format = DateTime)]
    created_at: String,
}

impl TryFrom<defects::Defect> for Defect {
    type Error = StoreError;

    fn try_from(row: defects::Defect) -> Result<Self, StoreError> {
        let alarms = row.alarms()?.into_iter().map(Alarm::from);
        let suggestion = row.suggestion()?.map(Suggestion::from);
        let state = match row.state.as_str() {
            "confirmed" => DefectState::Confirmed,
            "dismissed" => DefectState::Dismissed,
            _ => DefectState::Open,
        };
        let verdict = row.verdict_at_ms.map(|ms| Decision {
            by: row.verdict_by.clone(),
            comment: row.verdict_comment.clone(),
            at: Some(times::rfc3339(ms)),
        });
        let ticket = Ticket::of(&row);
        Ok(Self {
            defect_id: row.id.0,
            inspection_id: row.inspection_id.0,
            rope_id: row.rope_id.0,
            number: row.number,
            level: if row.level == defects::LOOK_AGAIN { DefectLevel::LookAgain } else { DefectLevel::Alarm },
            from_m: row.from_m,
            to_m: row.to_m,
            strand: row.strand,
            wire: row.wire,
            angle_deg: row.angle_deg,
            peak_score: row.peak_score,
            rank: row.rank,
            suggestion,
            alarms: alarms.collect(),
            state,
            verdict,
            ticket,
            created_at: times::rfc3339(row.created_at_ms),
        })
    }
}
