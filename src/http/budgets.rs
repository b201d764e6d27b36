//! What false alarms may cost, and the thresholds that follow from it.

use super::Problem;
use crate::pipeline::budget;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What false alarms may cost per 100 m of intact rope: one of the two.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum Budget {
    /// So many defects that are none.
    FalseDefects(FalseDefectsBudget),
    /// So many metres.
    ReinspectM(ReinspectBudget),
}

/// So many defects that are none.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FalseDefectsBudget {
    /// False defects per 100 m of rope.
    #[schema(minimum = 0.1, maximum = 100)]
    false_defects_per_100m: f64,
}

/// So many metres that a person looks at in vain.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ReinspectBudget {
    /// Metres per 100 m of rope: false defects with 5 cm of context each, 25 mm on either side.
    #[schema(minimum = 0.006, maximum = 6)]
    reinspect_m_per_100m: f64,
}

impl Budget {
    /// The budget for a training. Errors: one that makes no sense.
    pub fn check(self) -> Result<budget::Budget, Problem> {
        let (checked, value) = match self {
            Self::FalseDefects(b) => (budget::Budget::FalseDefects(b.false_defects_per_100m), b.false_defects_per_100m),
            Self::ReinspectM(b) => (budget::Budget::ReinspectM(b.reinspect_m_per_100m), b.reinspect_m_per_100m),
        };
        match checked.false_defects() {
            Ok(_) => Ok(checked),
            Err(detail) => Err(Problem::out_of_range(detail).with("field", "budget").with("value", value)),
        }
    }
}

impl From<budget::Budget> for Budget {
    fn from(b: budget::Budget) -> Self {
        match b {
            budget::Budget::FalseDefects(n) => Self::FalseDefects(FalseDefectsBudget { false_defects_per_100m: n }),
            budget::Budget::ReinspectM(m) => Self::ReinspectM(ReinspectBudget { reinspect_m_per_100m: m }),
        }
    }
}

/// A threshold and what it costs on intact rope.
#[derive(Debug, Serialize, ToSchema)]
pub struct Level {
    /// Lines with a score above it are over this level.
    line_score: f64,
    /// False defects per 100 m that it is made for.
    false_defects_per_100m: f64,
    /// The least that these may be in truth: 95 % lie between this and the next.
    at_least_per_100m: f64,
    /// The most that these may be in truth.
    at_most_per_100m: f64,
    /// Metres that a person looks at in vain, per 100 m.
    reinspect_m_per_100m: f64,
}

/// The thresholds that a budget gives, and what they rest on.
#[derive(Debug, Serialize, ToSchema)]
pub struct BudgetFit {
    /// What was asked for.
    budget: Budget,
    /// Lines over it are alarms.
    alarm: Level,
    /// Lines over it are worth looking at again.
    look_again: Level,
    /// Metres of held-back intact rope.
    held_back_m: f64,
    /// Highest scores on it, one an event, that make the tail.
    peaks: usize,
    /// Events on it so far out that they are taken for defects; they do not count.
    left_out: usize,
}

impl From<budget::Level> for Level {
    fn from(l: budget::Level) -> Self {
        Self {
            line_score: l.line_score,
            false_defects_per_100m: l.false_defects_per_100m,
            at_least_per_100m: l.at_least_per_100m,
            at_most_per_100m: l.at_most_per_100m,
            reinspect_m_per_100m: l.reinspect_m_per_100m,
        }
    }
}

impl From<budget::BudgetFit> for BudgetFit {
    fn from(fit: budget::BudgetFit) -> Self {
        Self {
            budget: fit.budget.into(),
            alarm: fit.alarm.into(),
            look_again: fit.look_again.into(),
            held_back_m: fit.held_back_m,
            peaks: fit.peaks,
            left_out: fit.left_out,
        }
    }
}
