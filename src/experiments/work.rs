//! How much of an experiment is done, over all its runs, so that the time left is that of the whole.

use crate::pipeline::{Progress, ProgressReport};
use std::sync::Mutex;
use std::sync::PoisonError;

/// The work of an experiment in metres of rope times views, and who hears of it.
pub(super) struct Work<'a> {
    outer: &'a dyn Progress,
    stage: &'static str,
    total_m: f64,
    /// Of the runs that have ended.
    done_m: Mutex<f64>,
}

impl<'a> Work<'a> {
    /// So many metres times views.
    pub fn new(outer: &'a dyn Progress, stage: &'static str, total_m: f64) -> Self {
        Self { outer, stage, total_m, done_m: Mutex::new(0.0) }
    }

    /// A run that is worth so many metres times views; its own reports are shares of them.
    pub fn run(&self, worth_m: f64) -> Run<'_> {
        self.run_of(worth_m, &[])
    }

    /// A run that goes through its rope once a stage.
    pub fn run_of(&self, worth_m: f64, stages: &'static [&'static str]) -> Run<'_> {
        Run { work: self, worth_m, stages }
    }
    fn done_m(&self) -> f64 {
        *self.done_m.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One run of the pipeline within an experiment. It counts as done when it is dropped.
pub(super) struct Run<'a> {
    work: &'a Work<'a>,
    worth_m: f64,
    stages: &'static [&'static str],
}

impl Progress for Run<'_> {
    fn report(&self, report: ProgressReport) {
        let stage_m = self.worth_m / self.stages.len().max(1) as f64;
        let before = self.stages.iter().position(|s| *s == report.stage).unwrap_or(0) as f64;
        let done_m = self.work.done_m() + stage_m * (before + report.done_m / report.total_m.max(1e-9));
        let Work { stage, total_m, .. } = *self.work;
        self.work.outer.report(ProgressReport { stage, done_m: done_m.min(total_m), total_m });
    }

    fn cancelled(&self) -> bool {
        self.work.outer.cancelled()
    }
}

impl Drop for Run<'_> {
    fn drop(&mut self) {
        *self.work.done_m.lock().unwrap_or_else(PoisonError::into_inner) += self.worth_m;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Heard(Mutex<Vec<f64>>);

    impl Progress for Heard {
        fn report(&self, report: ProgressReport) {
            assert_eq!((report.stage, report.total_m), ("all", 30.0));
            self.0.lock().unwrap().push(report.done_m);
        }
    }

    #[test]
    fn runs_add_up_to_the_whole() {
        let heard = Heard::default();
        let work = Work::new(&heard, "all", 30.0);
        for _ in 0..2 {
            let run = work.run(15.0);
            run.report(ProgressReport { stage: "inspect", done_m: 1.0, total_m: 3.0 });
        }
        assert_eq!(*heard.0.lock().unwrap(), [5.0, 20.0]);
    }

    #[test]
    fn stages_of_a_run_follow_each_other() {
        let heard = Heard::default();
        let work = Work::new(&heard, "all", 30.0);
        let run = work.run_of(30.0, &["learn", "calibrate"]);
        for stage in ["learn", "calibrate"] {
            run.report(ProgressReport { stage, done_m: 1.0, total_m: 2.0 });
        }
        assert_eq!(*heard.0.lock().unwrap(), [7.5, 22.5]);
    }
}
