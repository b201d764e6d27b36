//! Edges of a drawn rope, whose outline is known to a fraction of a pixel, before every kind of background.

use ropescope::vision::contour::{Contours, extract};
use ropescope::vision::image::GrayImage;
use ropescope::vision::lost_lines::LostLines;
use std::f64::consts::TAU;

const COLUMNS: usize = 340;
const LINES: usize = 1500;
const MIDDLE_PX: f64 = 165.0;
const HALF_PX: f64 = 95.0;
/// Lines from strand to strand, and from wire to wire.
const STRAND_LINES: f64 = 260.0;
const WIRE_LINES: f64 = 47.0;

/// What is drawn: a rope of strands and wires on a background.
struct Drawing {
    /// Gray of the background at a line and a distance outside the upper (positive columns) or lower edge of that line.
    background: Box<dyn Fn(usize, f64) -> f64>,
    /// Share of light at a place of the rope's width, -1 (lower edge) to 1 (upper edge).
    light: Box<dyn Fn(f64) -> f64>,
    /// Sideways movement of the rope in px.
    sway: Box<dyn Fn(usize) -> f64>,
}

impl Default for Drawing {
    fn default() -> Self {
        Self { background: Box::new(|_, _| 190.0), light: Box::new(|_| 1.0), sway: Box::new(|_| 0.0) }
    }
}

/// Repeatable noise of about 2.5 gray values.
fn noise(line: usize, column: usize) -> f64 {
    let mut x = (line as u64) << 32 | column as u64;
    (0..4)
        .map(|_| {
            x = (x ^ (x >> 31)).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(17).wrapping_add(0x1234_5678_9ABC);
            (x >> 40) as f64 / (1 << 24) as f64 - 0.5
        })
        .sum::<f64>()
        * 4.4
}

impl Drawing {
    fn on(background: impl Fn(usize, f64) -> f64 + 'static) -> Self {
        Self { background: Box::new(background), ..Self::default() }
    }

    /// Lower and upper edge of a line.
    fn edges(&self, line: usize) -> (f64, f64) {
        let bulge = |shift: f64| 5.0 * (TAU * (line as f64 / STRAND_LINES + shift)).sin().abs();
        let middle = MIDDLE_PX + (self.sway)(line);
        (middle - HALF_PX - bulge(0.0), middle + HALF_PX + bulge(0.25))
    }

    fn image(&self) -> GrayImage {
        let mut pixels = Vec::with_capacity(COLUMNS * LINES);
        for line in 0..LINES {
            let (lower, upper) = self.edges(line);
            for column in 0..COLUMNS {
                let c = column as f64;
                let across = ((c - lower) / (upper - lower) * 2.0 - 1.0).clamp(-1.0, 1.0);
                // wires pass by, narrower towards the edges, and every one is as bright as it likes
                let wire = across.asin() * 9.0 + line as f64 / WIRE_LINES;
                let own = 20.0 * (wire.floor() * 2.4).sin();
                let rope = (70.0 + own + 35.0 * (TAU * wire).sin()) * (self.light)(across);
                let outside = (lower - c).max(c - upper);
                let beside = (self.background)(line, if c > MIDDLE_PX { outside } else { -outside });
                let share = (0.5 - outside).clamp(0.0, 1.0);
                pixels.push((share * rope + (1.0 - share) * beside + noise(line, column)).clamp(0.0, 255.0) as u8);
            }
        }
        GrayImage::new(COLUMNS, pixels).unwrap()
    }

    fn contours(&self) -> Contours {
        extract(&self.image(), &LostLines::default(), Some(2.0 * HALF_PX))
    }

    /// By how much the found edges lie too far inside, lower and upper: median and the deviation that a tenth of the lines
    /// exceed; lines without an edge count as exceeding.
    fn errors(&self, contours: &Contours) -> [(f64, f64); 2] {
        let of = |found: &[f32], truth: &dyn Fn(usize) -> f64, inward: f64| {
            let mut inside: Vec<f64> = (0..LINES).map(|k| inward * (f64::from(found[k]) - truth(k))).collect();
            inside.sort_by(f64::total_cmp);
            let median = inside[LINES / 2];
            let mut away: Vec<f64> = inside.iter().map(|i| (i - median).abs()).collect();
            away.sort_by(f64::total_cmp);
            (median, away[LINES * 9 / 10])
        };
        [of(&contours.lower_px, &|k| self.edges(k).0, 1.0), of(&contours.upper_px, &|k| self.edges(k).1, -1.0)]
    }

    /// Both edges lie within `within_px` of the truth, in the middle and for nine lines of ten.
    fn assert_found(&self, what: &str, within_px: f64) {
        let errors = self.errors(&self.contours());
        for (side, (median, tenth)) in ["lower", "upper"].iter().zip(errors) {
            assert!(median.abs() < within_px && tenth < within_px, "{what}, {side} edge: {errors:?}");
        }
    }
}

/// A shadow beside the upper edge: its share of the light by the distance from the rope.
fn shadowed(share: impl Fn(usize, f64) -> f64 + 'static) -> Drawing {
    Drawing::on(move |line, outside| if outside > 0.0 { 190.0 * share(line, outside) } else { 190.0 })
}

/// Rises from 0 to 1 over a length, without corners.
fn rise(place: f64) -> f64 {
    let place = place.clamp(0.0, 1.0);
    place * place * (3.0 - 2.0 * place)
}

#[test]
fn edges_are_found_on_dark_and_bright_backgrounds_and_on_gradients() {
    Drawing::on(|_, _| 8.0).assert_found("dark", 1.0);
    Drawing::default().assert_found("bright", 1.0);
    Drawing::on(|_, outside| 160.0 + 1.2 * outside).assert_found("brighter to one side", 1.0);
}

#[test]
fn a_swaying_rope_is_followed() {
    let sway = |line: usize| 20.0 * (line as f64 / 180.0).sin();
    Drawing { sway: Box::new(sway), ..Drawing::default() }.assert_found("20 px", 1.0);
    let shadow = shadowed(|_, outside| 0.35 + 0.65 * rise(outside / 30.0));
    Drawing { sway: Box::new(sway), ..shadow }.assert_found("20 px, with a shadow", 2.5);
}

#[test]
fn a_rope_at_the_border_of_the_image_is_found() {
    Drawing { sway: Box::new(|_| 68.0), ..Drawing::default() }.assert_found("7 px of background", 1.0);
}

/// Twice the error that bright backgrounds have, for where the rope is as dark as its shadow nothing shows the edge.
const IN_SHADOW_PX: f64 = 2.5;

#[test]
fn the_outline_of_a_soft_shadow_is_not_taken_for_the_ropes() {
    shadowed(|_, outside| 0.35 + 0.65 * rise(outside / 30.0)).assert_found("30 px wide", IN_SHADOW_PX);
    shadowed(|_, outside| 0.3 + 0.7 * (outside / 24.0).min(1.0)).assert_found("linear", IN_SHADOW_PX);
    shadowed(|_, outside| 1.0 - 0.7 * (-outside / 9.0).exp()).assert_found("darkest at the rope", IN_SHADOW_PX);
}

#[test]
fn the_outline_of_a_hard_shadow_is_not_taken_for_the_ropes() {
    shadowed(|_, outside| 0.4 + 0.6 * rise((outside - 16.0) / 4.0)).assert_found("16 px wide", IN_SHADOW_PX);
}

/// Cast from ahead the bulges of a shadow stand beside the rope's valleys.
#[test]
fn a_shadow_with_an_outline_of_its_own_does_not_draw_the_edge_along() {
    let own = |line: usize, outside: f64| {
        let upper = Drawing::default().edges(line).1;
        let outline = MIDDLE_PX + HALF_PX + 16.0 + 3.0 * (TAU * line as f64 / STRAND_LINES).sin();
        0.4 + 0.6 * rise((upper + outside - outline) / 12.0)
    };
    shadowed(own).assert_found("another outline", IN_SHADOW_PX);
}

/// Black rope is rope: its first lit wires are not its edge.
#[test]
fn an_unlit_edge_is_an_edge_where_the_background_is_bright() {
    let light = |across: f64| 0.05 + 0.95 * rise((0.85 - across) * 6.0);
    Drawing { light: Box::new(light), ..Drawing::default() }.assert_found("unlit on bright ground", 1.5);
}

#[test]
fn an_unlit_edge_before_a_dark_background_does_not_disturb_the_other_one() {
    let light = |across: f64| 0.02 + 0.98 * rise((0.9 - across) * 12.0);
    let drawing = Drawing { light: Box::new(light), ..Drawing::on(|_, _| 8.0) };
    let [(lower, lower_tenth), (upper, upper_tenth)] = drawing.errors(&drawing.contours());
    assert!(lower.abs() < 1.0 && lower_tenth < 1.0, "{lower} {lower_tenth}");
    // The last tenth of the half width shows nothing, and the light rises over a twelfth: the edge is found there.
    assert!((0.0..18.0).contains(&upper) && upper_tenth < 6.0, "{upper} {upper_tenth}");
}

#[test]
fn wires_that_stick_out_of_rope_and_shadow_disturb_only_their_own_lines() {
    for (what, drawing, within_px) in [
        ("dark", Drawing::on(|_, _| 8.0), 1.5),
        ("bright", Drawing::default(), 1.5),
        ("shadow", shadowed(|_, outside| 0.35 + 0.65 * rise(outside / 30.0)), IN_SHADOW_PX),
    ] {
        let mut image = drawing.image();
        for first in [300, 700, 1100] {
            for line in first..first + 12 {
                let upper = drawing.edges(line).1 as usize;
                image.line_mut(line)[upper..upper + 25].fill(120);
            }
        }
        let errors = drawing.errors(&extract(&image, &LostLines::default(), Some(2.0 * HALF_PX)));
        assert!(
            errors.iter().all(|(median, tenth)| median.abs() < within_px && *tenth < within_px),
            "{what}: {errors:?}"
        );
    }
}

#[test]
fn a_background_without_a_rope_shows_none() {
    let backgrounds: [&dyn Fn(f64) -> f64; 4] = [
        &|_| 90.0,
        &|column| 60.0 + 0.4 * column,
        &|column| 190.0 - 120.0 * rise((column - 100.0) / 40.0) * rise((160.0 - column) / 40.0), // a shadow without its rope
        &|column| 190.0 - 120.0 * rise((column - 300.0) / 20.0),
    ];
    for (k, background) in backgrounds.iter().enumerate() {
        let gray = |line, column| (background(column as f64) + noise(line, column)) as u8;
        let pixels = (0..LINES * COLUMNS).map(|p| gray(p / COLUMNS, p % COLUMNS)).collect();
        let contours = extract(&GrayImage::new(COLUMNS, pixels).unwrap(), &LostLines::default(), Some(2.0 * HALF_PX));
        assert_eq!(contours.found(), 0.0, "background {k}");
    }
}
