//! What to simulate: every option with its meaning, unit and interval.

use super::defects::DefectKind;

/// How the rope is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// ArtificialRope: wires as Gaussian centre lines, noise on gray values and contours. [Wacker13, sec. 6.1]
    Artificial,
    /// Round wires under lamps, with dirt, motion, sensor noise and defects.
    Photographic,
}

/// What is behind the rope.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Background {
    /// The dark tunnel of a camera head.
    Dark,
    /// A bright workshop, brighter to one side.
    Bright,
    /// Bright, with the rope's own shadow beside it.
    Shadow,
}

/// Everything that determines an acquisition but the seed.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// How the rope is drawn.
    pub kind: Kind,
    /// Number of strands, 3 to 8.
    pub strands: usize,
    /// Outer wires per strand, 5 to 16.
    pub wires_per_strand: usize,
    /// Rope diameter in mm.
    pub diameter_mm: f64,
    /// Nominal strand lay in mm, signed (+ right-hand).
    pub strand_lay_mm: f64,
    /// Nominal wire lay in mm against the fixed axes, signed.
    pub wire_lay_mm: f64,
    /// Most that the diameter departs from the nominal one, as a share, in the middle of the rope; it goes there and back smoothly.
    pub diameter_change: f64,
    /// Largest less smallest diameter of a cut, as a share of their mean. A view at angle 0 sees the largest.
    pub ovality: f64,
    /// The strand lay stays within nominal +- this many mm.
    pub strand_lay_drift_mm: f64,
    /// The wire lay of every strand stays within nominal +- this many mm.
    pub wire_lay_drift_mm: f64,
    /// Lay lengths drift in waves from this length in m up to ten times it.
    pub drift_wave_m: f64,
    /// Length of rope in m.
    pub metres: f64,
    /// Rope per camera line in mm.
    pub line_pitch_mm: f64,
    /// Lines of a frame; the last may be shorter.
    pub frame_lines: usize,
    /// Pixels of a camera line.
    pub sensor_px: u32,
    /// Width of the rope in the image in pixels.
    pub rope_width_px: f64,
    /// Camera to rope axis in mm.
    pub camera_distance_mm: f64,
    /// Where the cameras stand: one angle a view, in degrees.
    pub view_angles_deg: Vec<f64>,
    /// Rope metre of the first line.
    pub start_m: f64,
    /// Whether `rope.json` states the scale of the cameras.
    pub calibrated: bool,

    /// Noise of gray values: sd in gray levels in dark parts (photographic: grows with the light).
    pub gray_noise: f64,
    /// Noise of the contours in `contours{v}.csv`: sd in px. Artificial kind only.
    pub contour_noise_px: f64,

    /// Farthest sideways motion of the rope in px. Lateral in two directions; each view sees its projection.
    pub oscillation_px: f64,
    /// Farthest deviation of the encoder from the true position in mm.
    pub encoder_jitter_mm: f64,
    /// Farthest deviation of a strand's phase from its regular place in rad.
    pub strand_jitter_rad: f64,
    /// How much dirt, 0 (new) to 1 (as dirty as one can still inspect).
    pub dirt: f64,
    /// Oil spots per metre.
    pub oil_spots_per_m: f64,
    /// How wet, 0 to 1: film and drops.
    pub water: f64,
    /// Harmless scratches per metre.
    pub scratches_per_m: f64,
    /// Pieces of foreign matter per metre: tar, grease, water, fibres, grit, stains, paint.
    pub debris_per_m: f64,
    /// Exposure; 1 is as bright as a camera head is usually set.
    pub exposure: f64,
    /// How strongly wires gleam; 1 is as usual.
    pub gloss: f64,
    /// How far the lamps stand to the sides of the camera; 1 is as usual.
    pub lamp_spread: f64,
    /// Blur of the lens in px (sd).
    pub blur_px: f64,
    /// Farthest relative drift of the light along the rope.
    pub light_drift: f64,
    /// Light lost at the ends of the sensor, 0 to 1.
    pub vignetting: f64,
    /// Dead or hot columns a view.
    pub bad_columns: usize,
    /// What is behind the rope.
    pub background: Background,
    /// Number of defects planted.
    pub defects: usize,
    /// So many of them lie at one metre of the rope, on strands of their own.
    pub defects_at_once: usize,
    /// The kind that all of them are of; every kind in turn if there is none.
    pub defect_kind: Option<DefectKind>,
    /// No defect before this many metres (the training part).
    pub defect_free_m: f64,
    /// How far defects of one kind differ in look and size, 0 to 1.
    pub defect_variety: f64,
}

impl Recipe {
    /// Rope in service: 10 m of 6x9, 32 mm, seen by four cameras, moderately dirty, without defects.
    pub fn photographic() -> Self {
        Self {
            kind: Kind::Photographic,
            strands: 6,
            wires_per_strand: 9,
            diameter_mm: 32.0,
            strand_lay_mm: 220.0,
            wire_lay_mm: -95.0,
            diameter_change: 0.0,
            ovality: 0.0,
            strand_lay_drift_mm: 2.2,
            wire_lay_drift_mm: 3.5,
            drift_wave_m: 1.2,
            metres: 10.0,
            line_pitch_mm: 0.1,
            frame_lines: 2000,
            sensor_px: 480,
            rope_width_px: 380.0,
            camera_distance_mm: 224.0,
            view_angles_deg: Self::evenly_spaced(4),
            start_m: 0.0,
            calibrated: false,
            gray_noise: 2.0,
            contour_noise_px: 0.0,
            oscillation_px: 4.0,
            encoder_jitter_mm: 0.02,
            strand_jitter_rad: 0.035,
            dirt: 0.35,
            oil_spots_per_m: 1.5,
            water: 0.05,
            scratches_per_m: 3.0,
            debris_per_m: 0.0,
            exposure: 1.0,
            gloss: 1.0,
            lamp_spread: 1.0,
            blur_px: 0.55,
            light_drift: 0.12,
            vignetting: 0.18,
            bad_columns: 1,
            background: Background::Dark,
            defects: 0,
            defects_at_once: 1,
            defect_kind: None,
            defect_free_m: 0.0,
            defect_variety: 0.0,
        }
    }

    /// The paper's ArtificialRope: 30 m of 6x9, 20.46 mm, lays 123..152 mm and 59..99 mm, one view, noise 1 px and 10 levels.
    pub fn artificial() -> Self {
        Self {
            kind: Kind::Artificial,
            diameter_mm: 20.46,
            strand_lay_mm: 137.5,
            wire_lay_mm: 79.0,
            strand_lay_drift_mm: 14.5,
            wire_lay_drift_mm: 20.0,
            drift_wave_m: 6.0,
            metres: 30.0,
            camera_distance_mm: 7.0 * 20.46,
            view_angles_deg: vec![0.0],
            gray_noise: 10.0,
            contour_noise_px: 1.0,
            oscillation_px: 0.0,
            encoder_jitter_mm: 0.0,
            strand_jitter_rad: 0.0,
            dirt: 0.0,
            oil_spots_per_m: 0.0,
            water: 0.0,
            scratches_per_m: 0.0,
            light_drift: 0.0,
            vignetting: 0.0,
            bad_columns: 0,
            ..Self::photographic()
        }
    }

    /// Another construction, with lays as such ropes usually have them: 6.9 rope diameters, and 8.9 strand diameters
    /// in the same hand as this recipe's; the camera moves away with the diameter.
    pub fn with_construction(self, strands: usize, wires_per_strand: usize, diameter_mm: f64) -> Self {
        let strand_diameter_mm = diameter_mm / (2.0 * crate::vision::rope::ring_radius(strands.max(3)) + 1.0);
        let strand_lay_mm = (6.9 * diameter_mm).copysign(self.strand_lay_mm);
        let wire_lay_mm = (8.9 * strand_diameter_mm).copysign(self.wire_lay_mm);
        Self {
            strand_lay_drift_mm: (self.strand_lay_drift_mm * strand_lay_mm / self.strand_lay_mm).abs(),
            wire_lay_drift_mm: (self.wire_lay_drift_mm * wire_lay_mm / self.wire_lay_mm).abs(),
            camera_distance_mm: self.camera_distance_mm * diameter_mm / self.diameter_mm,
            strands,
            wires_per_strand,
            diameter_mm,
            strand_lay_mm,
            wire_lay_mm,
            ..self
        }
    }

    /// Angles of `views` cameras evenly round the rope, in degrees, the first at 0.
    pub fn evenly_spaced(views: usize) -> Vec<f64> {
        (0..views).map(|v| 360.0 * v as f64 / views as f64).collect()
    }

    /// Number of lines.
    pub fn lines(&self) -> usize {
        (self.metres * 1000.0 / self.line_pitch_mm).round() as usize
    }
}
