//! Which surface point of the rope every pixel shows: theta = (strand phase, wire phase, distance). [Wacker13, eq. 16-17]
//!
//! The paper measures the distance d' of a pixel to the projected centre line of its wire in the image. Here it is measured on
//! the strand's surface, as a share of the wire step; both are functions of each other. With it, a pixel also has its place on
//! the unrolled strand: `wire_place` = (psi - wire phase)/step, constant along the course of a wire.

use super::camera::Camera;
use super::estimates::Estimates;
use super::histogram::{DISTANCE_BINS, STRAND_BINS, Theta, WIRE_BINS, cell};
use super::rope::Rope;
use super::surface::{Outlines, StrandSpan, wrap_rad};
use super::wide::wide;

/// Places per wire, across its course, that the unrolled rope is divided into.
pub const PLACES_PER_WIRE: usize = 5;
/// Strand phases in view that are parametrised, to either side, in rad.
pub const STRAND_RANGE_RAD: f64 = 1.9;
/// Wire phases in view that are parametrised, to either side, in rad.
pub const WIRE_RANGE_RAD: f64 = 1.8;
/// Pixels next to the border between two strands are left out: registration errors mix both there.
const BORDER_PX: f64 = 1.0;
/// Surface beyond this share of the strand's half width is too foreshortened.
const EDGE: f64 = 0.99;
/// Entries of the arcsine table.
const TABLE: usize = 2048;

/// A pixel's place on the rope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Column in the image.
    pub column: usize,
    /// The strand.
    pub strand: usize,
    /// Theta.
    pub theta: Theta,
    /// Its cell in the histogram.
    pub cell: usize,
    /// Place among the wires of the strand, in [0, M): whole numbers are wire centres, constant along a wire.
    pub wire_place: f32,
    /// The same as one of the M * [`PLACES_PER_WIRE`] places of the unrolled strand.
    pub place: usize,
    /// How many columns from the rope axis the same place of the wire lies farther on in the next line.
    pub slope_px: f32,
}

impl SurfacePoint {
    /// Column that shows the same place of the wire so many lines farther on, where the rope axis has moved by `axis_moved_px`.
    #[inline]
    pub fn column_on(&self, lines_on: f32, axis_moved_px: f32) -> usize {
        whole(self.column as f32 + lines_on * self.slope_px + axis_moved_px + 0.5) as usize
    }
}

/// The pixels that one strand fills in a line, side by side: what holds for every one of them, by column from `from` on.
#[derive(Debug, Clone, Copy)]
pub struct Run<'a> {
    /// The strand.
    pub strand: usize,
    /// Theta along the strand phases in view: all pixels have the same.
    pub strand_at: f32,
    /// First column.
    pub from: usize,
    /// Theta along the wire phases in view.
    pub wires_at: &'a [f32],
    /// Theta along the distances to the wire's centre line.
    pub distances_at: &'a [f32],
    /// Cells in the histogram.
    pub cells: &'a [u32],
    /// As [`SurfacePoint::wire_place`].
    pub wire_places: &'a [f32],
    /// As [`SurfacePoint::place`].
    pub places: &'a [u32],
    /// As [`SurfacePoint::slope_px`].
    pub slopes_px: &'a [f32],
}

impl Run<'_> {
    /// Its pixels one by one.
    fn points(&self) -> impl Iterator<Item = SurfacePoint> {
        let looked_up = self.cells.iter().zip(self.wire_places).zip(self.places).zip(self.slopes_px);
        let thetas = self.wires_at.iter().zip(self.distances_at);
        (self.from..).zip(looked_up).zip(thetas).map(
            |((column, (((&cell, &wire_place), &place), &slope_px)), (&wire, &distance))| SurfacePoint {
                column,
                strand: self.strand,
                theta: Theta { strand: self.strand_at, wire, distance },
                cell: cell as usize,
                wire_place,
                place: place as usize,
                slope_px,
            },
        )
    }
}

/// Which columns a strand fills.
#[derive(Debug, Clone, Copy)]
struct Filled {
    strand_at: f32,
    from: usize,
    to: usize,
}

/// Maps the lines of a stretch, as one view sees it, to the surface of the rope.
pub struct SurfaceMap<'a> {
    rope: &'a Rope,
    angle_rad: f64,
    estimates: &'a Estimates,
    width_px: usize,
    outlines: Outlines,
    arcsine: Vec<f32>,
    /// Cosine of those angles.
    cosine: Vec<f32>,
    phases: Vec<f64>,
    wires: Vec<f64>,
    /// Change of the phases from line to line.
    phase_steps: Vec<f64>,
    wire_steps: Vec<f64>,
    spans: Vec<StrandSpan>,
    /// Of every pixel of the line: surface angle, then what follows from it.
    psi_rad: Vec<f32>,
    slopes_px: Vec<f32>,
    wires_at: Vec<f32>,
    distances_at: Vec<f32>,
    cells: Vec<u32>,
    wire_places: Vec<f32>,
    places: Vec<u32>,
}

impl<'a> SurfaceMap<'a> {
    /// A map for images of `width_px` columns.
    pub fn new(rope: &'a Rope, camera: &Camera, estimates: &'a Estimates, width_px: usize) -> Self {
        let arcsine = (0..TABLE).map(|k| (2.0 * (k as f64 + 0.5) / TABLE as f64 - 1.0).asin() as f32).collect();
        let cosine =
            (0..TABLE).map(|k| (1.0 - (2.0 * (k as f64 + 0.5) / TABLE as f64 - 1.0).powi(2)).sqrt() as f32).collect();
        let n = rope.strands();
        Self {
            rope,
            angle_rad: camera.angle_rad,
            estimates,
            width_px,
            outlines: Outlines::new(rope, camera),
            arcsine,
            cosine,
            phases: vec![0.0; n],
            wires: vec![0.0; n],
            phase_steps: vec![0.0; n],
            wire_steps: vec![0.0; n],
            spans: Vec::new(),
            psi_rad: vec![0.0; width_px],
            slopes_px: vec![0.0; width_px],
            wires_at: vec![0.0; width_px],
            distances_at: vec![0.0; width_px],
            cells: vec![0; width_px],
            wire_places: vec![0.0; width_px],
            places: vec![0; width_px],
        }
    }

    /// Interpolates the courses at a line of the stretch.
    fn courses_at(&mut self, line: usize) {
        let n = self.rope.strands();
        let knot_lines = self.estimates.knot_lines;
        let knots = self.estimates.strand_phases_rad.len() / n;
        let at = (line as f64 - (knot_lines as f64 - 1.0) / 2.0) / knot_lines as f64;
        let a = (at.max(0.0) as usize).min(knots.saturating_sub(2));
        let b = (a + 1).min(knots - 1);
        // Beyond the outer knots the courses go on straight.
        let share = at - a as f64;
        for j in 0..n {
            let change = |values: &[f64]| values[b * n + j] - values[a * n + j];
            let (strands, wires) = (&self.estimates.strand_phases_rad, &self.estimates.wire_phases_rad);
            self.phases[j] = strands[a * n + j] + share * change(strands);
            self.wires[j] = wires[a * n + j] + share * change(wires);
            self.phase_steps[j] = change(strands) / knot_lines as f64;
            self.wire_steps[j] = change(wires) / knot_lines as f64;
        }
    }

    /// Calls `each` for every pixel of a line whose surface point is known. `axis_px` is the column of the rope axis.
    pub fn for_each(&mut self, line: usize, axis_px: f32, mut each: impl FnMut(SurfacePoint)) {
        self.for_each_run(line, axis_px, |run| run.points().for_each(&mut each));
    }

    /// The same for all pixels of a strand together.
    pub fn for_each_run(&mut self, line: usize, axis_px: f32, each: impl FnMut(Run<'_>)) {
        self.for_each_run_of(line, axis_px, |_| true, each);
    }

    /// The same for the strands that are asked for by what they fill, in columns from the rope axis.
    pub fn for_each_run_of(
        &mut self,
        line: usize,
        axis_px: f32,
        asked: impl Fn(&StrandSpan) -> bool,
        mut each: impl FnMut(Run<'_>),
    ) {
        self.courses_at(line);
        self.outlines.visible_spans(&self.phases, &mut self.spans);
        for s in 0..self.spans.len() {
            let span = self.spans[s];
            if !asked(&span) {
                continue;
            }
            let filled = wide(
                #[inline(always)]
                || self.map_span(span, f64::from(axis_px)),
            );
            let Some(Filled { strand_at, from, to }) = filled else { continue };
            each(Run {
                strand: span.strand,
                strand_at,
                from,
                wires_at: &self.wires_at[from..to],
                distances_at: &self.distances_at[from..to],
                cells: &self.cells[from..to],
                wire_places: &self.wire_places[from..to],
                places: &self.places[from..to],
                slopes_px: &self.slopes_px[from..to],
            });
        }
    }

    /// Maps the pixels of a strand. Plain loops over slices, without calls or branches: a recording has 10^9 such pixels. It is inlined to be
    /// compiled for registers of each width.
    #[inline(always)]
    fn map_span(&mut self, span: StrandSpan, axis_px: f64) -> Option<Filled> {
        let wire_phase = self.wires[span.strand];
        if wire_phase.is_nan() || span.phase_in_view_rad.abs() >= STRAND_RANGE_RAD {
            return None;
        }
        let low = (span.from_px + BORDER_PX).max(span.middle_px - EDGE * span.half_px) + axis_px;
        let high = (span.to_px - BORDER_PX).min(span.middle_px + EDGE * span.half_px) + axis_px;
        let from = (low.ceil().max(0.0) as usize).min(self.width_px);
        let to = (high.max(0.0) as usize).clamp(from, self.width_px);
        let strand_share = (span.phase_in_view_rad / STRAND_RANGE_RAD + 1.0) / 2.0;
        let strand_at = strand_share * STRAND_BINS as f64;
        let strand_bin = (strand_at as usize).min(STRAND_BINS - 1);

        let scale = (TABLE as f64 / (2.0 * span.half_px)) as f32;
        let first = ((from as f64 - axis_px - span.middle_px) * f64::from(scale)) as f32 + TABLE as f32 / 2.0;
        let sight = span.sight_rad as f32;
        // A place of a wire moves with its strand, and about it.
        let with_strand = (self.outlines.middle_per_rad(span.phase_in_view_rad) * self.phase_steps[span.strand]) as f32;
        let about_it = (span.half_px * self.wire_steps[span.strand]) as f32;
        let targets = self.psi_rad[from..to].iter_mut().zip(&mut self.slopes_px[from..to]);
        for (k, (psi, slope)) in targets.enumerate() {
            let entry = whole((first + k as f32 * scale).min(TABLE as f32 - 1.0)) as usize & (TABLE - 1);
            *psi = self.arcsine[entry] - sight;
            *slope = with_strand + about_it * self.cosine[entry];
        }

        let step = self.rope.wire_step_rad() as f32;
        let per_step = 1.0 / step;
        let wires = self.rope.wires() as f32;
        let all_places = wires * PLACES_PER_WIRE as f32;
        // Wire phase in view, reduced so that f32 keeps its digits.
        let in_view = wrap_rad(wire_phase - self.angle_rad) as f32;
        let wire_scale = WIRE_BINS as f32 / (2.0 * WIRE_RANGE_RAD as f32);
        let base = cell(strand_bin, 0, 0) as u32;
        let targets = self.cells[from..to].iter_mut().zip(&mut self.wire_places[from..to]);
        let targets = targets.zip(&mut self.places[from..to]);
        let thetas = self.wires_at[from..to].iter_mut().zip(&mut self.distances_at[from..to]);
        for ((&psi, ((to_cell, to_wire_place), to_place)), (wire_at, distance_at)) in
            self.psi_rad[from..to].iter().zip(targets).zip(thetas)
        {
            let at = (psi - in_view) * per_step;
            let distance = at - nearest(at); // to the nearest wire, in [-0.5, 0.5]
            let centre = psi - distance * step;
            *wire_at = within((centre + WIRE_RANGE_RAD as f32) * wire_scale, WIRE_BINS as f32 - 0.5);
            *distance_at = within((distance + 0.5) * DISTANCE_BINS as f32, DISTANCE_BINS as f32 - 0.001);
            *to_cell = base + whole(*wire_at) * DISTANCE_BINS as u32 + whole(*distance_at);
            let turned = if at < 0.0 { at + wires } else { at };
            *to_wire_place = turned;
            let place = (turned + 0.5) * PLACES_PER_WIRE as f32;
            *to_place = whole(within(if place >= all_places { place - all_places } else { place }, all_places - 0.5));
        }
        Some(Filled { strand_at: strand_at as f32, from, to })
    }
}

/// Adding and taking away this rounds small numbers to the nearest whole one.
const ROUNDS: f32 = 1.5 * (1u32 << 23) as f32;

#[inline(always)]
fn nearest(value: f32) -> f32 {
    (value + ROUNDS) - ROUNDS
}

/// The number, at least 0 and at most `most`. (Not `clamp`: that keeps NaN, which costs a branch and does not occur.)
#[inline(always)]
pub(super) fn within(value: f32, most: f32) -> f32 {
    let raised = if value > 0.0 { value } else { 0.0 };
    if raised < most { raised } else { most }
}

/// The whole part of a number of at least 0 and below 2^22, without a conversion that minds what is out of range.
#[inline(always)]
pub(super) fn whole(value: f32) -> u32 {
    let shifted = if value > 0.5 { value - 0.5 } else { 0.0 };
    (shifted + (1u32 << 23) as f32).to_bits() & 0x007f_ffff
}
