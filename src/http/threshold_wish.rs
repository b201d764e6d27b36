//! What a threshold preview is asked for: a line score, metres to re-inspect on past inspections, or false defects on intact rope.

use super::Problem;
use super::thresholds::check_line_score;
use crate::pipeline::budget::{self, BudgetFit};
use crate::pipeline::rejudge::MetresToLookAt;
use serde::Deserialize;
use utoipa::ToSchema;

/// Inspections looked at unless asked otherwise.
const DEFAULT_INSPECTIONS: u32 = 10;
/// Most inspections looked at: each is read through once, for a budget of metres twice.
const MAX_INSPECTIONS: u32 = 20;

/// A threshold to be tried: a line score, or what it may cost.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(untagged)]
pub enum Wish {
    /// The threshold itself.
    LineScore(LineScoreWish),
    /// A budget of metres on past inspections.
    Budget(BudgetWish),
    /// A budget of false defects on intact rope.
    FalseDefects(FalseDefectsWish),
}

/// A threshold to be tried.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LineScoreWish {
    /// Lines with a score above it are alarms.
    #[schema(minimum = 0, maximum = 1000)]
    line_score: f64,
    /// How many inspections to look at, the newest ones; else 10.
    #[schema(minimum = 1, maximum = 20)]
    inspections: Option<u32>,
}

/// The least threshold that keeps a budget on past inspections. True alarms count too: it is what people have to look at.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BudgetWish {
    /// Most metres to re-inspect per 100 m of inspected rope.
    #[schema(minimum = 0, maximum = 100)]
    reinspect_m_per_100m: f64,
    /// How many inspections to look at, the newest ones; else 10.
    #[schema(minimum = 1, maximum = 20)]
    inspections: Option<u32>,
}

/// The threshold that so many false defects allow, by the tail of the intact rope that the model was trained on.
#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FalseDefectsWish {
    /// False defects per 100 m of intact rope.
    #[schema(minimum = 0.1, maximum = 100)]
    false_defects_per_100m: f64,
    /// How many inspections to look at, the newest ones; else 10.
    #[schema(minimum = 1, maximum = 20)]
    inspections: Option<u32>,
}

impl Wish {
    /// How many inspections to look at.
    pub fn inspections(self) -> u32 {
        let asked_for = match self {
            Self::LineScore(wish) => wish.inspections,
            Self::Budget(wish) => wish.inspections,
            Self::FalseDefects(wish) => wish.inspections,
        };
        asked_for.unwrap_or(DEFAULT_INSPECTIONS)
    }

    /// Refuses what cannot be tried.
    pub fn check(self) -> Result<(), Problem> {
        let n = self.inspections();
        if !(1..=MAX_INSPECTIONS).contains(&n) {
            return Err(Problem::outside("inspections", f64::from(n), 1.0, f64::from(MAX_INSPECTIONS)));
        }
        match self {
            Self::LineScore(wish) => check_line_score(wish.line_score).map(|_| ()),
            Self::Budget(BudgetWish { reinspect_m_per_100m: m, .. }) if !(0.0..=100.0).contains(&m) => {
                Err(Problem::outside("reinspect_m_per_100m", m, 0.0, 100.0))
            }
            Self::FalseDefects(FalseDefectsWish { false_defects_per_100m: n, .. })
                if !(budget::FALSE_DEFECTS.0..=budget::FALSE_DEFECTS.1).contains(&n) =>
            {
                let (least, most) = budget::FALSE_DEFECTS;
                Err(Problem::outside("false_defects_per_100m", n, least, most))
            }
            Self::Budget(_) | Self::FalseDefects(_) => Ok(()),
        }
    }

    /// The threshold that is tried, and what it costs on intact rope if the model tells. Only a budget of metres asks past inspections.
    pub fn threshold(
        self,
        trained: Option<&BudgetFit>,
        to_look_at: impl FnOnce() -> Result<MetresToLookAt, Problem>,
    ) -> Result<(f64, Option<budget::Level>), Problem> {
        let line_score = match self {
            Self::LineScore(wish) => wish.line_score,
            Self::Budget(wish) => to_look_at()?.threshold_for(wish.reinspect_m_per_100m).ok_or_else(|| {
                Problem::no_likelihood(
                    "no rope was inspected with this model yet, so a budget of metres finds no threshold: inspect first, or give \
                     false_defects_per_100m",
                )
            })?,
            Self::FalseDefects(wish) => {
                let level = trained.and_then(|fit| fit.at(wish.false_defects_per_100m)).ok_or_else(|| {
                    Problem::model_without_tail(format!(
                        "false_defects_per_100m is {}, but this model was trained by an earlier version, which did not store how intact rope \
                         scores: train anew, or give line_score or reinspect_m_per_100m",
                        wish.false_defects_per_100m
                    ))
                    .with("field", "false_defects_per_100m")
                    .with("value", wish.false_defects_per_100m)
                })?;
                return Ok((level.line_score, Some(level)));
            }
        };
        Ok((line_score, trained.and_then(|fit| fit.costs_of(line_score))))
    }
}
