//! Aligns the rope model with one stretch of rope after the other, and estimates lay lengths. [Wacker13, sec. 3.3]
//!
//! First it searches: a few stretches are gathered, the strands found by their contours (eq. 13), the camera distance estimated,
//! the template learnt, the wires found. Then it tracks: every stretch starts from the last one's course. A stretch is
//! measured when the contours of the next one are known and answered when that one is measured, so that axis and courses are
//! smoothed with both sides in view; memory is that of the gathered stretches.

pub use super::aligner_spec::AlignerSpec;
use super::camera::Camera;
use super::columns::Columns;
use super::contour::{Contours, extract};
use super::courses::predict_wires;
use super::estimates::{Estimates, NotAligned, estimate};
use super::fitting::fit_from;
use super::image::GrayImage;
use super::lock::{Lock, lock};
use super::lost_lines::{LineWatch, Loss};
use super::measured::{Measured, Views};
use super::measuring::{Looking, learn_template, measure, measure_wires, read_wires};
use super::stretch::{StrandKnots, ViewStretch};
use super::wire_prediction::WirePrediction;
use rayon::prelude::*;
use std::collections::VecDeque;

/// Stretches that are gathered before the search.
pub const GATHERED: usize = 5;
/// Contours that agree less than this (eq. 13, 1 is perfect) are not the rope's.
pub const LEAST_SCORE: f64 = 0.45;

/// Rope beyond the ends of a stretch whose contours its axis takes into account, in rope diameters.
const BEYOND_DIAMETERS: f64 = 2.5;

/// A stretch as it comes in: consecutive lines of every view. A view without lines is lost here.
#[derive(Debug, Clone)]
pub struct Stretch {
    /// Number of the first line in the acquisition.
    pub first_line: usize,
    /// Number of lines.
    pub lines: usize,
    /// One image a view; shorter where the view ends.
    pub images: Vec<GrayImage>,
    /// Contours measured elsewhere, one per view, used instead of extraction.
    pub given_contours: Option<Vec<Contours>>,
}

/// A stretch as it goes out.
#[derive(Debug, Clone)]
pub struct AlignedStretch {
    /// Number of the first line in the acquisition.
    pub first_line: usize,
    /// Number of lines.
    pub lines: usize,
    /// Images, contours and axis of every view.
    pub views: Vec<ViewStretch>,
    /// What was estimated, or why nothing was.
    pub estimates: Result<Estimates, NotAligned>,
}

/// Aligns stretch after stretch.
#[derive(Debug)]
pub struct Aligner {
    spec: AlignerSpec,
    views: Option<Views>,
    /// One a view.
    watches: Vec<LineWatch>,
    /// One a view.
    columns: Vec<Columns>,
    /// The first stretches have taught them.
    columns_known: bool,
    /// The last stretch that came in: its axis is found when the lines after it are there.
    waiting: Option<Measured>,
    gathered: Vec<Measured>,
    /// The last two tracked stretches; the back one is not answered yet.
    window: VecDeque<Measured>,
    wires: Vec<Option<WirePrediction>>,
    lost: usize,
}

/// Lets two stretches that follow each other know the contours beyond their ends.
fn look_beyond(spec: &AlignerSpec, earlier: &mut Measured, later: &mut Measured) {
    let lines = (BEYOND_DIAMETERS * spec.rope.diameter_mm() / spec.pitch_mm) as usize;
    for (earlier, later) in earlier.views.iter_mut().zip(&mut later.views) {
        earlier.beyond[1] = later.contours.of(0..lines);
        later.beyond[0] = earlier.contours.of(earlier.contours.len().saturating_sub(lines)..usize::MAX);
    }
}

impl Aligner {
    /// An aligner that has seen nothing.
    pub fn new(spec: AlignerSpec) -> Self {
        let wires = vec![None; spec.rope.strands()];
        let columns = vec![Columns::default(); spec.view_angles_rad.len()];
        let watches = vec![LineWatch::default(); spec.view_angles_rad.len()];
        Self {
            spec,
            views: None,
            watches,
            columns,
            columns_known: false,
            waiting: None,
            gathered: Vec::new(),
            window: VecDeque::new(),
            wires,
            lost: 0,
        }
    }

    /// The cameras, once they were estimated.
    pub fn cameras(&self) -> Option<Vec<Camera>> {
        self.views.as_ref().map(|v| v.models.iter().map(|m| m.camera).collect())
    }

    /// What the aligner was made for.
    pub fn spec(&self) -> &AlignerSpec {
        &self.spec
    }

    /// Takes the next stretch; answers those that are settled by it, in order.
    pub fn push(&mut self, stretch: Stretch) -> Vec<AlignedStretch> {
        let mut seen = self.see(stretch);
        if let Some(waiting) = &mut self.waiting {
            look_beyond(&self.spec, waiting, &mut seen);
        }
        let mut out = Vec::new();
        if let Some(waiting) = self.waiting.replace(seen) {
            self.align(waiting, &mut out);
        }
        out
    }

    fn align(&mut self, seen: Measured, out: &mut Vec<AlignedStretch>) {
        if self.views.is_some() && self.gathered.is_empty() {
            self.track(seen, out);
        } else {
            self.gathered.push(seen);
            if self.gathered.len() >= GATHERED {
                self.settle_gathered(out);
            }
        }
    }

    /// Answers what is left.
    pub fn finish(&mut self) -> Vec<AlignedStretch> {
        let mut out = Vec::new();
        if let Some(waiting) = self.waiting.take() {
            self.align(waiting, &mut out);
        }
        if !self.gathered.is_empty() {
            self.settle_gathered(&mut out);
        }
        self.flush(&mut out);
        out
    }

    fn see(&mut self, stretch: Stretch) -> Measured {
        let hint = self.spec.rope_width_px;
        let (known, least_lines) = (self.columns_known, self.spec.column_lines());
        let given = stretch.given_contours;
        let views = self
            .watches
            .par_iter_mut()
            .zip(&mut self.columns)
            .zip(stretch.images)
            .enumerate()
            .map(|(v, ((watch, columns), image))| {
                let mut lost = watch.look(&image);
                let ends = image.lines();
                let mut image = if ends > 0 { image.with_lines(stretch.lines) } else { image };
                lost.push(ends..image.lines(), Loss::Ended);
                columns.read(&image, &lost);
                let all = lost.runs().iter().flat_map(|run| run.lines.clone());
                all.for_each(|line| image.line_mut(line).fill(0));
                if known {
                    columns.learn(least_lines);
                    columns.set_right(&mut image);
                }
                let contours = match &given {
                    Some(given) => given[v].clone(),
                    None => extract(&image, &lost, hint),
                };
                let blind = columns.not_judged();
                ViewStretch { image, lost, blind, contours, ..Default::default() }
            })
            .collect();
        Measured {
            given: given.is_some(),
            first_line: stretch.first_line,
            lines: stretch.lines,
            views,
            fit: Err(NotAligned::NoRope),
            reference: None,
            strands: StrandKnots::default(),
            stripes: Vec::new(),
            wires: Vec::new(),
        }
    }

    /// Learns the columns from the first stretches, which are there as the sensors gave them, and sets these right.
    fn set_first_right(&mut self) {
        self.columns_known = true;
        let (hint, least_lines) = (self.spec.rope_width_px, self.spec.column_lines());
        self.columns.iter_mut().for_each(|columns| columns.learn(least_lines));
        if !self.columns.iter().any(Columns::is_faulty) {
            return;
        }
        let mut first: Vec<&mut Measured> = self.gathered.iter_mut().chain(&mut self.waiting).collect();
        for measured in &mut first {
            let views = measured.views.par_iter_mut().zip(&self.columns);
            views.filter(|(view, columns)| columns.is_faulty() && view.image.lines() > 0).for_each(
                |(view, columns)| {
                    columns.set_right(&mut view.image);
                    view.blind = columns.not_judged();
                    if !measured.given {
                        view.contours = extract(&view.image, &view.lost, hint);
                    }
                },
            );
        }
        for k in 1..first.len() {
            let (before, after) = first.split_at_mut(k);
            look_beyond(&self.spec, before[k - 1], after[0]);
        }
    }

    /// Locks on the gathered stretches, measures them, and goes on tracking; without a lock they are answered as not aligned.
    fn settle_gathered(&mut self, out: &mut Vec<AlignedStretch>) {
        if !self.columns_known {
            self.set_first_right();
        }
        let mut gathered = std::mem::take(&mut self.gathered);
        let locked = lock(&self.spec, self.views.take(), &mut gathered);
        match locked {
            Some(Lock { views, wires }) => {
                self.views = Some(views);
                self.wires = wires;
                for measured in gathered {
                    self.enter(measured, out);
                }
            }
            None => {
                for measured in gathered {
                    self.enter(measured, out);
                }
            }
        }
        self.lost = 0;
    }

    /// Puts a measured stretch into the window and answers the one before it.
    fn enter(&mut self, measured: Measured, out: &mut Vec<AlignedStretch>) {
        self.window.push_back(measured);
        if self.window.len() >= 2 {
            let last = self.window.len() - 2;
            out.push(self.answer(last));
        }
        while self.window.len() > 2 {
            self.window.pop_front();
        }
    }

    fn flush(&mut self, out: &mut Vec<AlignedStretch>) {
        if let Some(last) = self.window.len().checked_sub(1) {
            out.push(self.answer(last));
        }
        self.window.clear();
    }

    /// Estimates of the stretch `at` of the window, from it and its neighbours. Its images go out with it.
    fn answer(&mut self, at: usize) -> AlignedStretch {
        let estimates = match (&self.window[at].fit, &mut self.views) {
            (Ok(_), Some(views)) => {
                let window: Vec<&Measured> = self.window.iter().collect();
                estimate(&self.spec, views, &window, at)
            }
            (Err(reason), _) => Err(*reason),
            (Ok(_), None) => Err(NotAligned::NoRope),
        };
        let measured = &mut self.window[at];
        AlignedStretch {
            first_line: measured.first_line,
            lines: measured.lines,
            views: std::mem::take(&mut measured.views),
            estimates,
        }
    }

    fn track(&mut self, mut seen: Measured, out: &mut Vec<AlignedStretch>) {
        let previous = self.window.back().and_then(|m| m.reference.as_ref().map(|r| (m.first_line, r.clone())));
        let Some(views) = self.views.as_mut() else { return };
        seen.fit = fit_from(&self.spec, &views.models, &seen, previous.as_ref().map(|(line, r)| (*line, r)));
        if seen.fit.is_err() {
            self.lost += 1;
            if self.lost >= 3 {
                // Lost for good: gather anew, so that a later rope is searched from scratch. What was learnt is kept.
                self.gathered.push(seen);
                self.flush(out);
                return;
            }
            self.enter(seen, out);
            return;
        }
        if self.lost > 0 && previous.is_none() {
            // Found again after a gap: the wires were lost meanwhile, so they are searched with the strands.
            self.flush(out);
            self.gathered.push(seen);
            return;
        }
        self.lost = 0;
        let before: Vec<&Measured> = self.window.iter().collect();
        measure(&self.spec, views, &mut seen, &before, &self.wires, Looking::Last);
        read_wires(&self.spec, views, &mut seen, &self.wires);
        learn_template(&self.spec, views, &seen);
        measure_wires(&self.spec, views, &mut seen, &self.wires);
        let window: Vec<&Measured> = before.into_iter().chain([&seen]).collect();
        self.wires = predict_wires(&self.spec, &window, &views.encoder, &self.wires);
        self.enter(seen, out);
    }
}
