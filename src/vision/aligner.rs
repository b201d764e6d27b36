//! Aligns the rope model with one stretch of rope after the other, and estimates lay lengths. [Wacker13, sec. 3.3]
//!
//! First it searches: a few stretches are gathered, the strands found by their contours (eq. 13), the camera distance estimated,
//! the template learnt, the wires found. Then it tracks: every stretch starts from the last one's course. A stretch is
//! answered when the next one is in, so that the smoother sees both sides; memory is that of the gathered stretches.

use super::camera::Camera;
use super::contour::{Contours, extract};
use super::estimates::{Estimates, NotAligned, estimate, measured_rate};
use super::image::GrayImage;
use super::lock::{LEAST_COHERENCE, Lock, lock, search_wires};
use super::rope::Rope;
use super::smoothing::{Course, CoursePrior, Measurement, smooth};
use super::strand_alignment::{StrandAlignment, polish, search};
use super::stretch::{
    Reference, StrandKnots, ViewModel, ViewStretch, axis_corrections_px, fuse, register_views, strand_knots,
};
use super::template::TemplateSums;
use super::unwrapping::{LINE_STRIDE, StripeTable, Stripes, read_stripes};
use super::wire_pattern::{PatternSums, WirePattern};
use super::wire_tracking::{Grid, StripeShift, WirePrediction, readings, wire_knots};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Stretches that are gathered before the search.
pub const GATHERED: usize = 5;
/// Contours that agree less than this (eq. 13, 1 is perfect) are not the rope's.
pub const LEAST_SCORE: f64 = 0.45;
/// Share of lines that must show both edges in a view.
const LEAST_FOUND: f64 = 0.4;
/// How far the lay length may change from one stretch to the next before it is searched anew, as a share.
const RELOCK_TOLERANCE: f64 = 0.06;

/// What does not change over an acquisition.
#[derive(Debug, Clone)]
pub struct AlignerSpec {
    /// The rope.
    pub rope: Rope,
    /// Rope per camera line in mm.
    pub pitch_mm: f64,
    /// Angles of the views in rad.
    pub view_angles_rad: Vec<f64>,
    /// Columns of the images.
    pub width_px: usize,
    /// Expected width of the rope in px, if known.
    pub rope_width_px: Option<f64>,
    /// Lines per knot of the courses.
    pub knot_lines: usize,
}

/// Millimetres of rope per knot, in rope diameters: a fraction of a wire's pitch.
const KNOT_DIAMETERS: f64 = 0.15;

impl AlignerSpec {
    /// A specification with knots suited to the rope.
    pub fn new(
        rope: Rope,
        pitch_mm: f64,
        view_angles_rad: Vec<f64>,
        width_px: usize,
        rope_width_px: Option<f64>,
    ) -> Self {
        let knot_lines = ((KNOT_DIAMETERS * rope.diameter_mm() / pitch_mm).round() as usize).max(2 * LINE_STRIDE);
        Self {
            rope,
            pitch_mm,
            view_angles_rad,
            width_px,
            rope_width_px,
            knot_lines: knot_lines.next_multiple_of(LINE_STRIDE),
        }
    }

    /// Lines of a stretch: whole knots, about `lines`.
    pub fn stretch_lines(&self, lines: usize) -> usize {
        (lines / self.knot_lines).max(4) * self.knot_lines
    }
}

/// A stretch as it comes in: consecutive lines of every view. A view without lines is lost here.
#[derive(Debug, Clone)]
pub struct Stretch {
    /// Number of the first line in the acquisition.
    pub first_line: usize,
    /// Number of lines.
    pub lines: usize,
    /// One image a view.
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

/// A stretch with everything measured in it.
#[derive(Debug)]
pub(super) struct Measured {
    pub first_line: usize,
    pub lines: usize,
    pub views: Vec<ViewStretch>,
    pub fit: Result<StrandAlignment, NotAligned>,
    pub reference: Option<Reference>,
    pub strands: StrandKnots,
    pub stripes: Vec<Stripes>,
    /// `wires[v][j]`: measured wires per knot.
    pub wires: Vec<Vec<Vec<Measurement>>>,
}

impl Measured {
    pub fn knots(&self, spec: &AlignerSpec) -> usize {
        self.lines.div_ceil(spec.knot_lines)
    }

    pub fn grid(&self, spec: &AlignerSpec) -> Grid {
        Grid {
            first_mm: self.first_line as f64 * spec.pitch_mm,
            pitch_mm: spec.pitch_mm,
            knot_lines: spec.knot_lines,
            knots: self.knots(spec),
        }
    }
}

/// Everything that was learnt of the views by the lock, and refined while tracking.
#[derive(Debug)]
pub(super) struct Views {
    pub models: Vec<ViewModel>,
    pub sums: Vec<TemplateSums>,
    pub pattern_sums: Vec<PatternSums>,
    pub shifts: Vec<StripeShift>,
    pub wire_noise_scale: f64,
    pub table: StripeTable,
    pub diameter_mm: f64,
}

/// Change of the strands' rate along the rope: spectral density times the cube of the rope diameter, in rad^2. Deviations of
/// a few hundredths of a rad over a few rope diameters are usual.
const STRAND_WANDER: f64 = 1e-5;
/// The same for wires, in strand diameters: they keep their lay much better.
const WIRE_WANDER: f64 = 1e-5;

pub(super) fn strand_prior(spec: &AlignerSpec, rate_rad_per_mm: f64) -> CoursePrior {
    CoursePrior {
        spacing_mm: spec.knot_lines as f64 * spec.pitch_mm,
        wander: STRAND_WANDER / spec.rope.diameter_mm().powi(3),
        rate_rad_per_mm,
        rate_sd: 0.05 * rate_rad_per_mm.abs(),
    }
}

pub(super) fn wire_prior(spec: &AlignerSpec, rate_rad_per_mm: f64) -> CoursePrior {
    CoursePrior {
        spacing_mm: spec.knot_lines as f64 * spec.pitch_mm,
        wander: WIRE_WANDER / (8.0 * spec.rope.strand_radius_mm().powi(3) * 8.0),
        rate_rad_per_mm,
        rate_sd: 0.05 * rate_rad_per_mm.abs(),
    }
}

/// Aligns stretch after stretch.
#[derive(Debug)]
pub struct Aligner {
    spec: AlignerSpec,
    views: Option<Views>,
    gathered: Vec<Measured>,
    /// The last two tracked stretches; the back one is not answered yet.
    window: VecDeque<Measured>,
    wires: Vec<Option<WirePrediction>>,
    lost: usize,
}

impl Aligner {
    /// An aligner that has seen nothing.
    pub fn new(spec: AlignerSpec) -> Self {
        let wires = vec![None; spec.rope.strands()];
        Self { spec, views: None, gathered: Vec::new(), window: VecDeque::new(), wires, lost: 0 }
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
        let seen = self.see(stretch);
        let mut out = Vec::new();
        if self.views.is_some() && self.gathered.is_empty() {
            self.track(seen, &mut out);
        } else {
            self.gathered.push(seen);
            if self.gathered.len() >= GATHERED {
                self.settle_gathered(&mut out);
            }
        }
        out
    }

    /// Answers what is left.
    pub fn finish(&mut self) -> Vec<AlignedStretch> {
        let mut out = Vec::new();
        if !self.gathered.is_empty() {
            self.settle_gathered(&mut out);
        }
        self.flush(&mut out);
        out
    }

    fn see(&self, stretch: Stretch) -> Measured {
        let hint = self.spec.rope_width_px;
        let given = stretch.given_contours;
        let views = stretch
            .images
            .into_par_iter()
            .enumerate()
            .map(|(v, image)| {
                let contours = match &given {
                    Some(given) => given[v].clone(),
                    None => extract(&image, hint),
                };
                ViewStretch { image, contours, axis_px: Vec::new() }
            })
            .collect();
        Measured {
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

    /// Locks on the gathered stretches, measures them, and goes on tracking; without a lock they are answered as not aligned.
    fn settle_gathered(&mut self, out: &mut Vec<AlignedStretch>) {
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
        let estimates = match (&self.window[at].fit, &self.views) {
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
        measure(&self.spec, views, &mut seen, &before, &self.wires);
        learn_template(&self.spec, views, &seen);
        measure_wires(&self.spec, views, &mut seen, &self.wires);
        let window: Vec<&Measured> = before.into_iter().chain([&seen]).collect();
        self.wires = predict_wires(&self.spec, &window, &self.wires);
        self.enter(seen, out);
    }
}

/// Aligns the strands of a stretch, starting from the one before if there is one.
pub(super) fn fit_from(
    spec: &AlignerSpec,
    models: &[ViewModel],
    seen: &Measured,
    previous: Option<(usize, &Reference)>,
) -> Result<StrandAlignment, NotAligned> {
    let views: Vec<_> = seen
        .views
        .iter()
        .zip(models)
        .filter(|(v, _)| v.image.lines() > 0 && v.contours.found() >= LEAST_FOUND)
        .map(|(v, m)| v.contour_view(m))
        .collect();
    if views.is_empty() {
        let lost = seen.views.iter().all(|v| v.image.lines() == 0);
        return Err(if lost { NotAligned::LinesLost } else { NotAligned::NoRope });
    }
    let step = spec.rope.strand_step_rad();
    let found = match previous {
        Some((first_line, reference)) => {
            let middle = seen.first_line as f64 - first_line as f64 + (seen.lines as f64 - 1.0) / 2.0;
            let rate = reference.rate_rad_per_mm;
            let expected = reference.mean_phase_rad(middle);
            let tracked = polish(&views, spec.pitch_mm, expected, rate).filter(|f| f.score >= LEAST_SCORE);
            let relocked = || {
                let lay = std::f64::consts::TAU / rate;
                search(&views, spec.pitch_mm, (lay * (1.0 - RELOCK_TOLERANCE), lay * (1.0 + RELOCK_TOLERANCE)))
            };
            tracked.or_else(relocked).map(|fit| {
                // Contours repeat from strand to strand: take the repetition nearest to what was expected.
                let turns = ((expected - fit.phase_rad) / step).round();
                StrandAlignment { phase_rad: fit.phase_rad + turns * step, ..fit }
            })
        }
        None => spec
            .searched_strand_lays()
            .into_iter()
            .filter_map(|range| search(&views, spec.pitch_mm, range))
            .max_by(|a, b| a.score.total_cmp(&b.score)),
    };
    match found {
        Some(fit) if fit.score >= LEAST_SCORE => Ok(fit),
        Some(fit) => Err(NotAligned::ContoursDisagree { score: fit.score }),
        None => Err(NotAligned::NoRope),
    }
}

/// Strand lays to search when none is given, in rope diameters.
const SEARCHED_LAY_DIAMETERS: (f64, f64) = (5.0, 9.0);
/// How far a strand lay may be off its nominal value, as a share.
const NOMINAL_TOLERANCE: f64 = 0.12;

impl AlignerSpec {
    /// The same, for a rope of this strand lay. `None` if no such rope can exist.
    pub(super) fn with_strand_lay(&self, lay_mm: f64) -> Option<Self> {
        let design = super::rope::RopeDesign { strand_lay_mm: Some(lay_mm), ..self.rope.design().clone() };
        Some(Self { rope: design.validate().ok()?, ..self.clone() })
    }

    /// Signed intervals of the strand lay in mm that are searched: about the nominal value, or wide where none is given.
    ///
    /// Without a nominal value only right-hand lays are searched: contours of one view do not tell the hand, the slant of the
    /// strands in the image does, afterwards.
    pub(super) fn searched_strand_lays(&self) -> Vec<(f64, f64)> {
        match self.rope.design().strand_lay_mm {
            Some(lay) => vec![(lay * (1.0 - NOMINAL_TOLERANCE), lay * (1.0 + NOMINAL_TOLERANCE))],
            None => {
                let range = (
                    SEARCHED_LAY_DIAMETERS.0 * self.rope.diameter_mm(),
                    SEARCHED_LAY_DIAMETERS.1 * self.rope.diameter_mm(),
                );
                if self.view_angles_rad.len() > 1 { vec![range, (-range.1, -range.0)] } else { vec![range] }
            }
        }
    }
}

/// Measures each strand's course through a stretch that was fitted: two rounds of registration.
///
/// `wires` are where the wires are expected; their pattern is taken out of the image where it is known.
pub(super) fn measure(
    spec: &AlignerSpec,
    views: &mut Views,
    seen: &mut Measured,
    before: &[&Measured],
    wires: &[Option<WirePrediction>],
) {
    let Ok(fit) = seen.fit else { return };
    let rope = &spec.rope;
    let n = rope.strands();
    let mut reference = Reference::straight(&fit, rope, seen.lines, spec.pitch_mm, spec.knot_lines);
    let middle_mm = (seen.first_line as f64 + (seen.lines as f64 - 1.0) / 2.0) * spec.pitch_mm;
    for (wire, prediction) in reference.wires.iter_mut().zip(wires) {
        if let Some(prediction) = prediction {
            *wire = (prediction.at(middle_mm), prediction.rate_rad_per_mm);
        }
    }
    for (view, model) in seen.views.iter_mut().zip(&views.models) {
        if view.image.lines() > 0 && view.contours.found() >= LEAST_FOUND {
            view.set_axis(model, rope, &reference);
        }
    }
    let knots = reference.knots();
    for _ in 0..2 {
        let sums = register_views(rope, &views.models, &seen.views, &reference);
        if sums.iter().all(Vec::is_empty) {
            break;
        }
        let mut corrections = vec![vec![0.0; knots]; seen.views.len()];
        let mut phases = vec![0.0; knots * n];
        for _ in 0..3 {
            seen.strands = strand_knots(rope, &views.models, &sums, &reference, &corrections);
            let courses = strand_courses(spec, &with(before, seen), None, fit.rate_rad_per_mm);
            for k in 0..knots {
                for j in 0..n {
                    let straight =
                        reference.mean_phase_rad(reference.knot_middle(k)) + j as f64 * rope.strand_step_rad();
                    phases[k * n + j] = match &courses[j] {
                        Some(course) => course.phase_rad(course.len() - knots + k),
                        None => straight,
                    };
                }
            }
            corrections = axis_corrections_px(rope, &sums, &reference, &phases);
        }
        for k in 0..knots {
            let mean = reference.mean_phase_rad(reference.knot_middle(k));
            for j in 0..n {
                let deviation = phases[k * n + j] - mean - j as f64 * rope.strand_step_rad();
                reference.deviation_rad[k * n + j] = deviation.clamp(-0.12, 0.12);
            }
        }
        for (view, correction) in seen.views.iter_mut().zip(&corrections) {
            for (line, axis) in view.axis_px.iter_mut().enumerate() {
                *axis += correction[(line / spec.knot_lines).min(knots - 1)] as f32;
            }
        }
    }
    // What is measured from here on is relative to the corrected axis.
    let sums = register_views(rope, &views.models, &seen.views, &reference);
    seen.strands = strand_knots(rope, &views.models, &sums, &reference, &vec![vec![0.0; knots]; seen.views.len()]);
    seen.stripes = views
        .models
        .par_iter()
        .zip(&seen.views)
        .map(|(model, view)| match (&model.template, view.usable()) {
            (Some(template), true) => {
                read_stripes(rope, &model.camera, template, &views.table, &view.image, &view.axis_px, |line, out| {
                    reference.phases_rad(rope, line, out);
                })
            }
            _ => Stripes::default(),
        })
        .collect();
    seen.reference = Some(reference);
}

fn with<'a>(before: &[&'a Measured], seen: &'a Measured) -> Vec<&'a Measured> {
    let mut window: Vec<&Measured> = before.iter().copied().rev().take_while(|m| m.reference.is_some()).collect();
    window.reverse();
    window.push(seen);
    window
}

/// Smoothed course of every strand over consecutive stretches; `view`: only what that view saw.
pub(super) fn strand_courses(
    spec: &AlignerSpec,
    window: &[&Measured],
    view: Option<usize>,
    rate: f64,
) -> Vec<Option<Course>> {
    let n = spec.rope.strands();
    let fused: Vec<Vec<Measurement>> = window
        .iter()
        .map(|m| {
            let views = m
                .strands
                .views
                .iter()
                .enumerate()
                .filter(|(v, _)| view.is_none_or(|only| only == *v))
                .map(|(_, x)| &x[..]);
            fuse(views, m.knots(spec) * n)
        })
        .collect();
    (0..n)
        .map(|j| {
            let knots: Vec<Measurement> = fused.iter().flat_map(|f| f.chunks_exact(n).map(move |k| k[j])).collect();
            smooth(&knots, strand_prior(spec, rate))
        })
        .collect()
}

/// Adds a measured stretch to the templates and renews them.
pub(super) fn learn_template(spec: &AlignerSpec, views: &mut Views, seen: &Measured) {
    let Some(reference) = &seen.reference else { return };
    let rope = &spec.rope;
    views.models.par_iter_mut().zip(&mut views.sums).zip(&seen.views).for_each(|((model, sums), view)| {
        if view.usable() {
            sums.fade(0.9);
            let angle = model.camera.angle_rad;
            sums.add(rope, &view.image, &view.axis_px, 2 * LINE_STRIDE, |line| {
                reference.average_phase_rad(rope, line) - angle
            });
            if let Some(template) = super::template::Template::new(rope, &model.camera, sums) {
                model.template = Some(template);
            }
        }
    });
}

/// Adds a stretch whose wires were measured to the wire patterns.
pub(super) fn learn_pattern(
    spec: &AlignerSpec,
    views: &mut Views,
    seen: &Measured,
    courses: &[Option<Course>],
    first_knot: usize,
) {
    let Some(reference) = &seen.reference else { return };
    let grid = seen.grid(spec);
    let wires_at = |line: usize, out: &mut [f64]| {
        let knot = (line / spec.knot_lines).min(grid.knots - 1);
        let off_mm = (seen.first_line + line) as f64 * spec.pitch_mm - grid.knot_mm(knot);
        for (phase, course) in out.iter_mut().zip(courses) {
            let at = first_knot + knot;
            *phase = course.as_ref().map_or(f64::NAN, |c| c.phase_rad(at) + c.rate_rad_per_mm(at) * off_mm);
        }
    };
    views.models.par_iter().zip(&mut views.pattern_sums).zip(&seen.views).for_each(|((model, sums), view)| {
        if let (Some(template), true) = (&model.template, view.usable()) {
            sums.add(
                &spec.rope,
                template,
                model.camera.angle_rad,
                &view.image,
                &view.axis_px,
                LINE_STRIDE,
                |line, strands, wires| {
                    reference.phases_rad(&spec.rope, line, strands);
                    wires_at(line, wires);
                },
            );
        }
    });
}

/// Renews the wire patterns from what was learnt.
pub(super) fn renew_patterns(spec: &AlignerSpec, views: &mut Views) {
    views.models.par_iter_mut().zip(&views.pattern_sums).for_each(|(model, sums)| {
        model.pattern = model.template.as_ref().map(|template| WirePattern::new(&spec.rope, template, sums));
    });
}

/// Measures the wires of a stretch in every view, relative to what is predicted of them; where the prediction proves wrong, the
/// wires of that strand are searched anew.
pub(super) fn measure_wires(spec: &AlignerSpec, views: &Views, seen: &mut Measured, wires: &[Option<WirePrediction>]) {
    let grid = seen.grid(spec);
    let stripes: Vec<_> = seen.stripes.iter().zip(&views.shifts).collect();
    let predictions: Vec<Option<WirePrediction>> = (0..spec.rope.strands())
        .map(|j| {
            let readings = readings(&spec.rope, &stripes, j, grid);
            let adapted = wires[j].map(|p| p.adapted(spec.rope.wires(), &readings));
            match adapted {
                Some((prediction, coherence)) if coherence >= LEAST_COHERENCE || readings.len() < 16 => {
                    Some(prediction)
                }
                _ => search_wires(spec, views, &[&*seen], j),
            }
        })
        .collect();
    seen.wires = stripes
        .iter()
        .map(|(stripes, shift)| {
            (0..spec.rope.strands())
                .map(|j| match predictions[j] {
                    Some(prediction) => {
                        wire_knots(&spec.rope, stripes, shift, j, grid, prediction, views.wire_noise_scale)
                    }
                    None => vec![Measurement::default(); grid.knots],
                })
                .collect()
        })
        .collect();
}

/// Smoothed course of the wires of every strand over consecutive stretches; `view`: only what that view saw.
pub(super) fn wire_courses(
    spec: &AlignerSpec,
    window: &[&Measured],
    view: Option<usize>,
    rates: impl Fn(usize) -> Option<f64>,
) -> Vec<Option<Course>> {
    (0..spec.rope.strands())
        .map(|j| {
            let knots: Vec<Measurement> = window
                .iter()
                .flat_map(|m| {
                    let views = m.wires.iter().enumerate().filter(|(v, _)| view.is_none_or(|only| only == *v));
                    fuse(views.map(|(_, w)| &w[j][..]), m.knots(spec))
                })
                .collect();
            smooth(&knots, wire_prior(spec, rates(j)?))
        })
        .collect()
}

/// Where the wires of every strand are expected at the end of the last stretch.
pub(super) fn predict_wires(
    spec: &AlignerSpec,
    window: &[&Measured],
    now: &[Option<WirePrediction>],
) -> Vec<Option<WirePrediction>> {
    let contiguous = match window.split_last() {
        Some((last, before)) => with(before, last),
        None => return now.to_vec(),
    };
    let courses = wire_courses(spec, &contiguous, None, |j| {
        contiguous.last().and_then(|m| measured_rate(spec, m, j)).or(now[j].map(|p| p.rate_rad_per_mm))
    });
    let Some(last) = contiguous.last() else { return now.to_vec() };
    let grid = last.grid(spec);
    courses
        .iter()
        .zip(now)
        .map(|(course, now)| match course {
            Some(course) => {
                let knot = course.len() - 1;
                Some(WirePrediction {
                    phase_rad: course.phase_rad(knot),
                    // The rate at the very end is the least certain; lays change little over half a stretch.
                    rate_rad_per_mm: course.slope_rad_per_mm(course.len() - grid.knots..course.len()),
                    position_mm: grid.knot_mm(grid.knots - 1),
                })
            }
            None => *now,
        })
        .collect()
}
