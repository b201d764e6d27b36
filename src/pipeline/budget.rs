//! What false alarms may cost, in words of those who look at them, and the two thresholds that follow from it.

use super::reinspection::CONTEXT_MM;
use crate::vision::known_tail::KnownTail;
use crate::vision::tail::Tail;
use serde::{Deserialize, Serialize};

/// Length of most false defects in mm.
const FALSE_DEFECT_MM: f64 = 10.0;
/// Metres of rope that a false defect makes a person look at.
const REINSPECT_M_PER_DEFECT: f64 = (CONTEXT_MM + FALSE_DEFECT_MM) / 1000.0;
/// Places to look at again may cost so many times what alarms may.
const LOOK_AGAIN_BUDGETS: f64 = 5.0;
/// Budget unless told otherwise: false defects per 100 m.
const USUAL_FALSE_DEFECTS: f64 = 2.0;
/// Budgets that can be asked for: false defects per 100 m. Less is beyond what metres of training tell; more would be a defect a metre.
pub const FALSE_DEFECTS: (f64, f64) = (0.1, 100.0);

/// What false alarms may cost per 100 m of intact rope.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Budget {
    /// So many defects that are none.
    #[serde(rename = "false_defects_per_100m")]
    FalseDefects(f64),
    /// So many metres that a person looks at in vain: false defects with 5 cm of context each, 25 mm on either side.
    #[serde(rename = "reinspect_m_per_100m")]
    ReinspectM(f64),
}

impl Default for Budget {
    fn default() -> Self {
        Self::FalseDefects(USUAL_FALSE_DEFECTS)
    }
}

impl std::fmt::Display for Budget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::FalseDefects(n) => write!(f, "{n} false defects per 100 m"),
            Self::ReinspectM(m) => write!(f, "{m} m to look at in vain per 100 m"),
        }
    }
}

impl Budget {
    /// The budget in false defects per 100 m. Errors: outside [`FALSE_DEFECTS`]; the message names the limits in the budget's own unit.
    pub fn false_defects(self) -> Result<f64, String> {
        let (value, per_defect, unit) = match self {
            Self::FalseDefects(n) => (n, 1.0, "false defects"),
            Self::ReinspectM(m) => (m, REINSPECT_M_PER_DEFECT, "metres to look at in vain"),
        };
        let (least, most) = (FALSE_DEFECTS.0 * per_defect, FALSE_DEFECTS.1 * per_defect);
        if (least..=most).contains(&value) {
            return Ok(value / per_defect);
        }
        Err(format!("the budget is {value} {unit} per 100 m, but must be between {least} and {most}"))
    }
}

/// A threshold and what it costs on intact rope.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Level {
    /// Lines with a score above it are over this level.
    pub line_score: f64,
    /// False defects per 100 m that it is made for.
    pub false_defects_per_100m: f64,
    /// The least that these may be in truth: the true rate is between this and the next with 95 %.
    pub at_least_per_100m: f64,
    /// The most that these may be in truth.
    pub at_most_per_100m: f64,
    /// Metres that a person looks at in vain, per 100 m.
    pub reinspect_m_per_100m: f64,
}

/// The thresholds that a budget gives, and what they rest on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BudgetFit {
    /// What was asked for.
    pub budget: Budget,
    /// Lines over it are alarms.
    pub alarm: Level,
    /// Lines over it are worth a second look, if there is time.
    pub look_again: Level,
    /// Metres of held-back intact rope.
    pub held_back_m: f64,
    /// Highest scores on it, one an event, that make the tail.
    pub peaks: usize,
    /// Events on it so far out that they are taken for defects; they do not count.
    pub left_out: usize,
    /// Score from which on the tail is a law.
    pub tail_from: f64,
    /// Scores of these peaks, ascending: what the law was fitted to, so that it answers for every other rate, with its interval. Empty in
    /// models of earlier versions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tail_peaks: Vec<f32>,
    /// Whether scores have what a closer look adds, so that other ropes tell of their tail, too. Not so in models of earlier versions.
    #[serde(default)]
    pub closer_look: bool,
}

/// The threshold that so many false defects allow.
fn level(tail: &Tail, per_100m: f64) -> Level {
    Level { false_defects_per_100m: per_100m, ..costs(tail, tail.score_for(per_100m / 100.0)) }
}

/// What a threshold costs.
fn costs(tail: &Tail, line_score: f64) -> Level {
    let per_100m = 100.0 * tail.rate(line_score);
    let (low, high) = tail.rate_between(line_score);
    Level {
        line_score,
        false_defects_per_100m: per_100m,
        at_least_per_100m: 100.0 * low,
        at_most_per_100m: 100.0 * high,
        reinspect_m_per_100m: per_100m * REINSPECT_M_PER_DEFECT,
    }
}

impl BudgetFit {
    /// Both thresholds from the peaks of held-back intact rope, and what is known of their tail beforehand. `None` with too few.
    pub fn of(
        budget: Budget,
        false_defects_per_100m: f64,
        peaks: &[f32],
        held_back_m: f64,
        known: Option<KnownTail>,
    ) -> Option<Self> {
        let (tail, left_out) = Tail::of_intact(peaks, held_back_m, known)?;
        let mut tail_peaks: Vec<f32> = peaks.iter().copied().filter(|&p| f64::from(p) >= tail.base()).collect();
        tail_peaks.sort_by(f32::total_cmp);
        tail_peaks.truncate(tail_peaks.len() - left_out);
        Some(Self {
            budget,
            alarm: level(&tail, false_defects_per_100m),
            look_again: level(&tail, LOOK_AGAIN_BUDGETS * false_defects_per_100m),
            held_back_m,
            peaks: tail_peaks.len(),
            left_out,
            tail_from: tail.base(),
            tail_peaks,
            closer_look: known.is_some(),
        })
    }

    /// What is known of the tail beforehand.
    pub fn known(&self) -> Option<KnownTail> {
        self.closer_look.then_some(KnownTail::CLOSER_LOOK)
    }

    /// The law, from what is stored of it; `None` in models of earlier versions.
    fn tail(&self) -> Option<Tail> {
        let base = self.tail_peaks.first()?;
        Tail::over(f64::from(*base), &self.tail_peaks, f64::INFINITY, self.held_back_m, self.known())
    }

    /// The threshold that so many false defects per 100 m allow, which must lie within [`FALSE_DEFECTS`]. `None` if the model is of an
    /// earlier version.
    pub fn at(&self, false_defects_per_100m: f64) -> Option<Level> {
        Some(level(&self.tail()?, false_defects_per_100m))
    }

    /// What any threshold costs on intact rope. `None` if the model is of an earlier version, or where its metres do not tell: under the
    /// tail, and for rates outside [`FALSE_DEFECTS`].
    pub fn costs_of(&self, line_score: f64) -> Option<Level> {
        let tail = self.tail().filter(|tail| line_score >= tail.base())?;
        let told = FALSE_DEFECTS.0..=FALSE_DEFECTS.1;
        told.contains(&(100.0 * tail.rate(line_score))).then(|| costs(&tail, line_score))
    }

    /// Where the threshold comes from, as a sentence.
    pub fn origin(&self) -> String {
        format!(
            "automatic, budget {}, 95 % between {:.1} and {:.1} false defects per 100 m by the tail of {:.1} m of held-back intact rope",
            self.budget, self.alarm.at_least_per_100m, self.alarm.at_most_per_100m, self.held_back_m
        )
    }

    /// How far the second level lies under the first, in line scores.
    pub fn look_again_below(&self) -> f64 {
        self.alarm.line_score - self.look_again.line_score
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peaks() -> Vec<f32> {
        (0..200).map(|k| 4.0 - 0.6 * ((((k * 79) % 200) as f32 + 0.5) / 200.0).ln()).collect()
    }

    #[test]
    fn a_larger_budget_gives_lower_thresholds_and_looking_again_is_the_lower_of_two() {
        let fit = |n: f64| BudgetFit::of(Budget::FalseDefects(n), n, &peaks(), 5.0, None).unwrap();
        let (little, much) = (fit(1.0), fit(10.0));
        assert!(little.alarm.line_score > much.alarm.line_score + 0.5);
        for fit in [little, much] {
            assert!(fit.look_again.line_score < fit.alarm.line_score);
            let (low, high) = (fit.alarm.at_least_per_100m, fit.alarm.at_most_per_100m);
            assert!(low < fit.alarm.false_defects_per_100m && fit.alarm.false_defects_per_100m < high);
        }
    }

    #[test]
    fn metres_and_defects_are_two_names_of_one_budget_and_both_have_limits() {
        assert_eq!(Budget::FalseDefects(2.0).false_defects(), Ok(2.0));
        assert!((Budget::ReinspectM(0.12).false_defects().unwrap() - 2.0).abs() < 1e-9);
        let error = Budget::ReinspectM(50.0).false_defects().unwrap_err();
        assert!(error.contains("50") && error.ends_with("between 0.006 and 6"), "{error}");
        assert!(Budget::FalseDefects(f64::NAN).false_defects().is_err());
    }

    #[test]
    fn a_stored_fit_answers_for_every_rate_as_a_training_would_and_an_earlier_one_says_that_it_cannot() {
        let mut peaks = peaks();
        peaks.extend([30.0, 40.0]); // two defects that nobody had seen
        let fit = |n: f64| BudgetFit::of(Budget::FalseDefects(n), n, &peaks, 5.0, None).unwrap();
        assert_eq!((fit(2.0).peaks, fit(2.0).left_out), (fit(2.0).tail_peaks.len(), 2));
        let mut stored = serde_json::to_value(fit(2.0)).unwrap();
        let read: BudgetFit = serde_json::from_value(stored.clone()).unwrap();
        for n in [0.1, 2.0, 10.0, 100.0] {
            let (told, trained) = (read.at(n).unwrap(), fit(n).alarm);
            // The law is fitted to the same numbers; only their last digits may be lost on the way.
            assert!((told.line_score - trained.line_score).abs() < 1e-6, "{told:?} {trained:?}");
            assert!((told.at_least_per_100m / trained.at_least_per_100m - 1.0).abs() < 1e-6);
            assert!((told.at_most_per_100m / trained.at_most_per_100m - 1.0).abs() < 1e-6);
        }
        let back = read.costs_of(fit(10.0).alarm.line_score).unwrap();
        assert!((back.false_defects_per_100m - 10.0).abs() < 1e-6, "{back:?}");
        assert!(back.at_least_per_100m < 10.0 && 10.0 < back.at_most_per_100m);
        assert_eq!(read.costs_of(50.0), None, "so far out nobody knows");
        assert_eq!(read.costs_of(1.0), None, "under the tail there is no law");

        stored.as_object_mut().unwrap().remove("tail_peaks");
        let earlier: BudgetFit = serde_json::from_value(stored).unwrap();
        assert_eq!((earlier.at(2.0), earlier.costs_of(6.0)), (None, None));
        assert_eq!(earlier.alarm, read.alarm);
    }

    #[test]
    fn the_origin_says_budget_and_interval() {
        let fit = BudgetFit::of(Budget::default(), 2.0, &peaks(), 5.0, None).unwrap();
        let origin = fit.origin();
        assert!(origin.starts_with("automatic, budget 2 false defects per 100 m, 95 % between "), "{origin}");
    }
}
