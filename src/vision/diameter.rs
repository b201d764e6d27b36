//! Rope diameter from the distance of opposite contours, in every view, and in all together with the ovality.
//!
//! The width of the outline follows the strands, so every line is compared with the model's outline at that line's phases. Medians of
//! short blocks, half a rope diameter each, pass over loose wires and oil; a straight line through them, fitted robustly, gives the
//! diameter in the middle of the stretch, and what the blocks scatter about it, with what neighbours have in common, its standard
//! deviation. A rope that sways towards a camera looks thicker: views from other sides see how far, and it is taken out.
//!
//! The scale of a view was fitted to the nominal diameter when the rope was found. So diameters tell how the rope changes along
//! itself, and differs from view to view as against there, but not how thick it is, unless somebody measured the scale.

use super::aligner::AlignerSpec;
use super::calibrated_width::{EDGES_PX, calibrated};
use super::measured::{Measured, Views};
use super::reference::Reference;
use super::stretch::ViewStretch;
use super::width::{block_ratios, straight};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::f64::consts::PI;

/// Angles of views that differ less, in rad, see one diameter.
const SAME_DIRECTION_RAD: f64 = 0.17;

/// A value with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WithSd {
    /// The value.
    pub value: f64,
    /// Its standard deviation.
    pub sd: f64,
}

/// What the contours of a stretch say.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Diameters {
    /// Diameter in mm across each view.
    pub views: Vec<Option<WithSd>>,
    /// Diameter in mm over all directions.
    pub mean: Option<WithSd>,
    /// Largest less smallest diameter in percent of their mean; `None` if all cameras look in one direction.
    pub ovality_percent: Option<WithSd>,
}

/// Diameters of a stretch that was aligned; `error_ratio` is what their mean errs by over what it states.
pub(super) fn diameters(
    spec: &AlignerSpec,
    views: &mut Views,
    here: &Measured,
    reference: &Reference,
    error_ratio: f64,
) -> Diameters {
    let depths_mm = depths_mm(spec, views, here);
    let mut seen: Vec<Option<WithSd>> = here
        .views
        .iter()
        .enumerate()
        .map(|(v, view)| {
            let model = &views.models[v];
            let farther = |line: usize| depths_mm.as_ref().map_or(0.0, |d| d[(v, line)] / model.camera.distance_mm);
            let ratios = block_ratios(&spec.rope, model, view, reference, farther);
            let (line, left) = straight(&ratios)?;
            let blocks = left.iter().flatten().count() as f64;
            views.widths[v].learn(&left);
            let variance = line.sd.powi(2) * views.widths[v].shared(blocks);
            let sway_mm = if depths_mm.is_some() { 0.0 } else { sway_px(view) / model.camera.px_per_mm };
            let sd = variance.sqrt().hypot(sway_mm / model.camera.distance_mm);
            Some(WithSd { value: line.value * spec.rope.diameter_mm(), sd: sd * spec.rope.diameter_mm() })
        })
        .collect();
    views.width_agreement.learn(&seen);
    let scale = views.width_agreement.scale();
    seen.iter_mut().flatten().for_each(|diameter| diameter.sd *= scale);
    // What calibrated edges may be off by is the same everywhere, so it neither averages out nor makes a rope oval.
    let mut edges_sd_mm = 0.0f64;
    for (v, diameter) in seen.iter_mut().enumerate() {
        if let (Some(seen), Some(&px_per_mm)) = (diameter, spec.calibrated_px_per_mm.get(v)) {
            let (absolute, sd_mm) = calibrated(&spec.rope, &views.models[v], &here.views[v], px_per_mm, *seen);
            *seen = absolute;
            edges_sd_mm = edges_sd_mm.max(sd_mm);
        }
    }
    let with_edges = |d: WithSd| WithSd { sd: d.sd.hypot(edges_sd_mm), ..d };
    let (mean, ovality_percent) = joined(&seen, &spec.view_angles_rad);
    Diameters {
        views: seen.into_iter().map(|d| d.map(with_edges)).collect(),
        mean: mean.map(|mean| with_edges(WithSd { sd: mean.sd * error_ratio, ..mean })),
        ovality_percent: ovality_percent.map(|oval| {
            // Cameras and their light are alike, but not the same: half of it may differ.
            let edges = if spec.calibrated_px_per_mm.is_empty() { 0.0 } else { EDGES_PX / 2.0 * 2f64.sqrt() };
            let percent = 100.0 * edges / views.models[0].contour.mean_width_px();
            WithSd { sd: oval.sd.hypot(percent), ..oval }
        }),
    }
}

/// How much farther than usual the rope is from each camera at every line, in mm, as the others see it; `None` if they do not say.
fn depths_mm(spec: &AlignerSpec, views: &Views, here: &Measured) -> Option<DMatrix<f64>> {
    let found = views.found_axis_px.len() == here.views.len() && views.found_axis_px.iter().all(|px| px.is_finite());
    let usable = found && here.views.iter().all(ViewStretch::usable);
    if !usable || directions(&spec.view_angles_rad).len() < 2 {
        return None;
    }
    let n = here.views.len();
    let seen = DMatrix::from_fn(n, here.lines, |v, line| {
        let axis = &here.views[v].axis_px;
        f64::from(axis[line.min(axis.len() - 1)]) - views.found_axis_px[v]
    });
    let angles = || views.models.iter().map(|model| model.camera.angle_rad);
    let sideways = DMatrix::from_fn(n, 2, |v, axis| {
        let camera = &views.models[v].camera;
        camera.px_per_mm * if axis == 0 { camera.angle_rad.cos() } else { camera.angle_rad.sin() }
    });
    let away = DMatrix::from_iterator(n, 2, angles().map(|a| -a.sin()).chain(angles().map(f64::cos)));
    Some(away * (sideways.pseudo_inverse(1e-9).ok()? * seen))
}

/// How far the axis of a view goes to and fro over a stretch, rms: so far it may go to and from the camera, too.
fn sway_px(view: &ViewStretch) -> f64 {
    let n = view.axis_px.len().max(1) as f64;
    let mean = view.axis_px.iter().map(|&px| f64::from(px)).sum::<f64>() / n;
    (view.axis_px.iter().map(|&px| (f64::from(px) - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// Views by the direction that they see the diameter across, modulo half a turn.
fn directions(angles_rad: &[f64]) -> Vec<(f64, Vec<usize>)> {
    let mut directions: Vec<(f64, Vec<usize>)> = Vec::new();
    for (v, &angle) in angles_rad.iter().enumerate() {
        let apart = |other: f64| ((angle - other + PI / 2.0).rem_euclid(PI) - PI / 2.0).abs();
        match directions.iter_mut().find(|(other, _)| apart(*other) < SAME_DIRECTION_RAD) {
            Some((_, views)) => views.push(v),
            None => directions.push((angle, vec![v])),
        }
    }
    directions
}

/// Diameter over all directions, and ovality.
fn joined(views: &[Option<WithSd>], angles_rad: &[f64]) -> (Option<WithSd>, Option<WithSd>) {
    let across: Vec<(f64, WithSd)> = directions(angles_rad)
        .into_iter()
        .filter_map(|(angle, of)| Some((angle, weighted_mean(of.iter().filter_map(|&v| views[v]))?)))
        .collect();
    if across.is_empty() {
        return (None, None);
    }
    let n = across.len() as f64;
    let mean = WithSd {
        value: across.iter().map(|(_, d)| d.value).sum::<f64>() / n,
        sd: across.iter().map(|(_, d)| d.sd * d.sd).sum::<f64>().sqrt() / n,
    };
    match &across[..] {
        [_] => (Some(mean), None),
        [(_, a), (_, b)] => {
            let percent = |mm: f64| 100.0 * mm / mean.value;
            let apart = WithSd { value: percent((a.value - b.value).abs()), sd: percent(a.sd.hypot(b.sd)) };
            (Some(mean), Some(apart))
        }
        more => oval(more).map_or((Some(mean), None), |(mean, ovality)| (Some(mean), Some(ovality))),
    }
}

fn weighted_mean(values: impl Iterator<Item = WithSd>) -> Option<WithSd> {
    let (sum, weight) =
        values.fold((0.0, 0.0), |(sum, weight), d| (sum + d.value / d.sd.powi(2), weight + d.sd.powi(-2)));
    (weight > 0.0 && weight.is_finite()).then(|| WithSd { value: sum / weight, sd: weight.powf(-0.5) })
}

/// The oval d(angle) = mean + a cos 2 angle + b sin 2 angle through three or more directions: its mean, and twice its amplitude. Chance
/// makes every circle a little oval in some direction; what it adds on average is taken out.
fn oval(across: &[(f64, WithSd)]) -> Option<(WithSd, WithSd)> {
    let (mut information, mut weighted) = (Matrix3::zeros(), Vector3::zeros());
    for (angle, d) in across {
        let row = Vector3::new(1.0, (2.0 * angle).cos(), (2.0 * angle).sin());
        information += row * row.transpose() / d.sd.powi(2);
        weighted += row * d.value / d.sd.powi(2);
    }
    let covariance = information.try_inverse()?;
    let oval = covariance * weighted;
    let of_amplitude = DVector::from_vec(vec![oval[1], oval[2]]);
    let chance = covariance[(1, 1)] + covariance[(2, 2)];
    let amplitude = (of_amplitude.norm_squared() - chance).max(0.0).sqrt();
    let percent = |mm: f64| 200.0 * mm / oval[0];
    let mean = WithSd { value: oval[0], sd: covariance[(0, 0)].sqrt() };
    Some((mean, WithSd { value: percent(amplitude), sd: percent((chance / 2.0).sqrt()) }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    fn views(values: &[f64]) -> Vec<Option<WithSd>> {
        values.iter().map(|&value| Some(WithSd { value, sd: 0.02 })).collect()
    }

    #[test]
    fn opposite_views_see_one_diameter_and_two_at_right_angles_give_mean_and_ovality() {
        let angles = [0.0, FRAC_PI_2, PI, 3.0 * FRAC_PI_2];
        let (mean, oval) = joined(&views(&[32.3, 31.7, 32.3, 31.7]), &angles);
        let (mean, oval) = (mean.unwrap(), oval.unwrap());
        assert!((mean.value - 32.0).abs() < 1e-9 && (mean.sd - 0.01).abs() < 1e-9, "{mean:?}");
        assert!((oval.value - 0.6 / 0.32).abs() < 1e-9 && (oval.sd - 0.02 / 0.32).abs() < 1e-9, "{oval:?}");
        let (mean, oval) = joined(&[Some(WithSd { value: 32.3, sd: 0.02 }), None, None, None], &angles);
        assert_eq!((mean.unwrap().value, oval), (32.3, None));
        assert_eq!(joined(&[None; 4], &angles), (None, None));
    }

    #[test]
    fn an_oval_is_found_between_three_views_however_it_lies() {
        let angles = [0.0, 1.0, 2.2];
        let across = |angle: f64| 32.0 + 0.3 * (2.0 * angle - 0.9).cos();
        let (mean, oval) = joined(&views(&angles.map(across)), &angles);
        assert!((mean.unwrap().value - 32.0).abs() < 1e-9);
        // 0.6 mm of 32 mm, less what chance adds to an amplitude.
        let oval = oval.unwrap();
        assert!((oval.value - 1.875).abs() < 0.5 * oval.sd && oval.sd < 0.12, "{oval:?}");
        // A circle is not made oval by noise of its own size.
        assert!(joined(&views(&[32.01, 31.99, 32.0]), &angles).1.unwrap().value < 1e-9);
    }
}
