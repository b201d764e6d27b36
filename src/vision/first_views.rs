//! What is taken to be known of the views before a rope is found, and where their cameras stand once it is.

use super::agreement::Agreement;
use super::aligner::AlignerSpec;
use super::camera::Camera;
use super::camera_distance::{ContourHarmonics, DEFAULT_DISTANCE_DIAMETERS, estimate};
use super::encoder::EncoderEvidence;
use super::measured::{Measured, Views};
use super::model_contour::ModelContour;
use super::outline_detail::DetailSums;
use super::reference::Reference;
use super::shared_axis::SharedAxis;
use super::stretch::ViewModel;
use super::surface::Outlines;
use super::template::TemplateSums;
use super::unwrapping::StripeTable;
use super::width::{WidthAgreement, WidthScatter};
use super::wire_pattern::PatternSums;
use super::wire_tracking::StripeShift;
use std::f64::consts::TAU;

/// Cameras at the usual distance, scaled to the width that the contours show.
pub(super) fn first_views(spec: &AlignerSpec, gathered: &[Measured]) -> Views {
    let distance_mm = DEFAULT_DISTANCE_DIAMETERS * spec.rope.diameter_mm();
    let models = spec
        .view_angles_rad
        .iter()
        .enumerate()
        .map(|(v, &angle_rad)| view_model(spec, gathered, v, angle_rad, distance_mm))
        .collect::<Vec<_>>();
    Views {
        sums: models.iter().map(|_| TemplateSums::new(spec.width_px)).collect(),
        pattern_sums: models.iter().map(|_| PatternSums::new(spec.width_px)).collect(),
        shifts: models.iter().map(|_| StripeShift::default()).collect(),
        detail_sums: vec![DetailSums::default(); models.len()],
        models,
        wire_noise_scale: 1.0,
        shared_axis: SharedAxis::default(),
        encoder: EncoderEvidence::default(),
        agreement: Agreement::default(),
        table: StripeTable::new(spec.rope.wires(), spec.reading_lines),
        found_axis_px: Vec::new(),
        widths: vec![WidthScatter::default(); spec.view_angles_rad.len()],
        width_agreement: WidthAgreement::default(),
    }
}

fn view_model(spec: &AlignerSpec, gathered: &[Measured], v: usize, angle_rad: f64, distance_mm: f64) -> ViewModel {
    let mut widths: Vec<f32> = gathered
        .iter()
        .filter_map(|m| m.views.get(v))
        .flat_map(|view| view.contours.lower_px.iter().zip(&view.contours.upper_px).map(|(l, u)| u - l))
        .filter(|w| w.is_finite())
        .collect();
    let unit = ModelContour::new(&spec.rope, &Camera { angle_rad, distance_mm, px_per_mm: 1.0 });
    let width_px = if widths.is_empty() {
        spec.rope_width_px.unwrap_or(spec.width_px as f64 * 0.8)
    } else {
        // Mean of the middle half: the outline's own distribution is symmetric enough, wire ends and losses are not.
        let n = widths.len();
        widths.sort_by(f32::total_cmp);
        let middle = &widths[n / 4..(3 * n / 4).max(n / 4 + 1)];
        middle.iter().map(|&w| f64::from(w)).sum::<f64>() / middle.len() as f64
    };
    let camera = Camera { angle_rad, distance_mm, px_per_mm: width_px / unit.mean_width_px() };
    ViewModel {
        camera,
        contour: ModelContour::new(&spec.rope, &camera),
        outlines: Outlines::new(&spec.rope, &camera),
        template: None,
        pattern: None,
        detail: None,
        noise_scale: 1.0,
        contour_noise_scale: 1.0,
    }
}

/// Estimates the camera distance from all contours, and scales the cameras again.
pub(super) fn place_cameras(spec: &AlignerSpec, views: &mut Views, gathered: &[Measured]) {
    let mut harmonics = vec![ContourHarmonics::default(); views.models.len()];
    for measured in gathered {
        let Ok(fit) = measured.fit else { continue };
        let reference = Reference::straight(&fit, &spec.rope, measured.lines, spec.pitch_mm, spec.knot_lines);
        let period = TAU / fit.rate_rad_per_mm.abs() / spec.rope.strands() as f64 / spec.pitch_mm;
        for ((h, view), model) in harmonics.iter_mut().zip(&measured.views).zip(&views.models) {
            h.add(spec.rope.strands(), &view.contours, period.round().max(4.0) as usize, |line| {
                model.camera.phase_in_view(reference.mean_phase_rad(line as f64))
            });
        }
    }
    let distance_mm = estimate(&spec.rope, &harmonics).unwrap_or(DEFAULT_DISTANCE_DIAMETERS * spec.rope.diameter_mm());
    for (v, model) in views.models.iter_mut().enumerate() {
        *model = view_model(spec, gathered, v, model.camera.angle_rad, distance_mm);
    }
}
