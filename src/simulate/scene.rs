//! One rope made from a recipe and a seed: where every strand and wire is at every line, and how the rope moves.

use super::camera::Camera;
use super::curve::SmoothCurve;
use super::defects::{self, Defect};
use super::finish::Finish;
use super::noise::{Stream, generator};
use super::recipe::Recipe;
use super::recipe_limits::RecipeError;
use super::sensor::SensorPattern;
use crate::vision::rope::Rope;
use rand::Rng;
use std::f64::consts::TAU;

/// A helix whose lay length drifts: phase(x) = offset + integral of 2 pi / lay. [Wacker13, eq. 2-3 with a variable lay]
#[derive(Debug, Clone, PartialEq)]
pub struct DriftingHelix {
    offset_rad: f64,
    rad_per_mm: SmoothCurve,
}

impl DriftingHelix {
    /// A helix with lays within nominal +- drift; `own` is the part of the drift that is a constant of this helix.
    fn random(rng: &mut impl Rng, nominal_mm: f64, drift_mm: f64, own: f64, wave_m: f64) -> Self {
        let (shortest, longest) = (nominal_mm.abs() - drift_mm, nominal_mm.abs() + drift_mm);
        let (fast, slow) = (TAU / shortest, TAU / longest);
        let (middle, reach) = ((fast + slow) / 2.0, (fast - slow) / 2.0);
        let centre = middle + reach * own * (2.0 * rng.random::<f64>() - 1.0);
        let waves =
            SmoothCurve::waves(rng, centre * nominal_mm.signum(), reach * (1.0 - own), wave_m * 1e3..wave_m * 1e4, 4);
        Self { offset_rad: rng.random::<f64>() * TAU, rad_per_mm: waves }
    }

    /// Phase at `x_mm` in rad.
    pub fn phase_rad(&self, x_mm: f64) -> f64 {
        self.offset_rad + self.rad_per_mm.integral(x_mm)
    }

    /// Phase per mm at `x_mm`.
    pub fn rad_per_mm(&self, x_mm: f64) -> f64 {
        self.rad_per_mm.value(x_mm)
    }

    /// Lay length at `x_mm` in mm, signed.
    pub fn lay_mm(&self, x_mm: f64) -> f64 {
        TAU / self.rad_per_mm.value(x_mm)
    }
}

/// A rope, its motion, its light, its dirt and its defects: everything but the pixels.
#[derive(Debug, Clone)]
pub struct Scene {
    recipe: Recipe,
    seed: u64,
    rope: Rope,
    camera: Camera,
    pub(super) strand: DriftingHelix,
    pub(super) wires: Vec<DriftingHelix>,
    pub(super) strand_jitter: Vec<SmoothCurve>,
    offset_mm: [SmoothCurve; 2],
    encoder_mm: SmoothCurve,
    pub(super) light: Vec<SmoothCurve>,
    pub(super) sensors: Vec<SensorPattern>,
    pub(super) finish: Finish,
    defects: Vec<Defect>,
}

impl Scene {
    /// Makes the rope. Errors: what is wrong with the recipe.
    pub fn new(recipe: &Recipe, seed: u64) -> Result<Self, RecipeError> {
        let rope = recipe.validate()?;
        let camera =
            Camera::fitting(recipe.camera_distance_mm, recipe.diameter_mm, recipe.rope_width_px, recipe.sensor_px);
        let mut geometry = generator(seed, Stream::Geometry);
        let rng = &mut geometry;
        let strand =
            DriftingHelix::random(rng, recipe.strand_lay_mm, recipe.strand_lay_drift_mm, 0.0, recipe.drift_wave_m);
        let wires = (0..recipe.strands)
            .map(|_| DriftingHelix::random(rng, recipe.wire_lay_mm, recipe.wire_lay_drift_mm, 0.4, recipe.drift_wave_m))
            .collect();
        let lay_mm = recipe.strand_lay_mm.abs();
        let strand_jitter = (0..recipe.strands)
            .map(|_| SmoothCurve::waves(rng, 0.0, recipe.strand_jitter_rad, 0.8 * lay_mm..8.0 * lay_mm, 4))
            .collect();

        let mut motion = generator(seed, Stream::Motion);
        let rng = &mut motion;
        let reach_mm = recipe.oscillation_px * recipe.camera_distance_mm / camera.focal_px;
        // two directions of equal strength: a view at any angle sees at most `oscillation_px`
        let offset_mm = [0, 1].map(|_| SmoothCurve::waves(rng, 0.0, reach_mm * 0.5_f64.sqrt(), 120.0..3000.0, 5));
        let encoder_mm = SmoothCurve::waves(rng, 0.0, recipe.encoder_jitter_mm / 2.0, 25.0..500.0, 4).from_zero();
        let light = recipe
            .view_angles_deg
            .iter()
            .map(|_| SmoothCurve::waves(rng, 1.0, recipe.light_drift, 400.0..8000.0, 4))
            .collect();
        let sensors = (0..recipe.view_angles_deg.len())
            .map(|view| SensorPattern::random(&mut generator(seed, Stream::Sensor(view)), recipe))
            .collect();
        let finish =
            Finish::random(&mut generator(seed, Stream::Finish), &mut generator(seed, Stream::Foreign), recipe);
        let mut scene = Self {
            recipe: recipe.clone(),
            seed,
            rope,
            camera,
            strand,
            wires,
            strand_jitter,
            offset_mm,
            encoder_mm,
            light,
            sensors,
            finish,
            defects: Vec::new(),
        };
        scene.defects = defects::plant(&scene);
        Ok(scene)
    }

    /// The same rope in the same light, recorded once more: only the noise of gray values and contours is another.
    pub fn recorded_again(mut self, noise_seed: u64) -> Self {
        self.seed = noise_seed;
        self
    }

    /// The recipe.
    pub fn recipe(&self) -> &Recipe {
        &self.recipe
    }
    /// The seed.
    pub fn seed(&self) -> u64 {
        self.seed
    }
    /// The rope.
    pub fn rope(&self) -> &Rope {
        &self.rope
    }
    /// The camera that every view has.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }
    /// The defects that were planted, in order along the rope.
    pub fn defects(&self) -> &[Defect] {
        &self.defects
    }
    /// Number of views.
    pub fn views(&self) -> usize {
        self.recipe.view_angles_deg.len()
    }
    /// Number of lines of each view.
    pub fn lines(&self) -> usize {
        self.recipe.lines()
    }
    /// Number of frames of each view.
    pub fn frames(&self) -> usize {
        self.lines().div_ceil(self.recipe.frame_lines)
    }
    /// First line of a frame.
    pub fn first_line(&self, frame: usize) -> usize {
        frame * self.recipe.frame_lines
    }
    /// Lines of a frame.
    pub fn frame_height(&self, frame: usize) -> usize {
        self.recipe.frame_lines.min(self.lines().saturating_sub(self.first_line(frame)))
    }
    /// Angle of a view in rad.
    pub fn view_angle_rad(&self, view: usize) -> f64 {
        self.recipe.view_angles_deg[view].to_radians()
    }

    /// True position of a line along the rope in mm from the first: the line counter and what the encoder got wrong.
    pub fn x_mm(&self, line: usize) -> f64 {
        let counted_mm = line as f64 * self.recipe.line_pitch_mm;
        counted_mm + self.encoder_mm.value(counted_mm)
    }

    /// Diameter at `x_mm`, mean over all directions.
    pub fn diameter_mm(&self, x_mm: f64) -> f64 {
        let recipe = &self.recipe;
        let turn = TAU * x_mm / (recipe.metres * 1e3);
        recipe.diameter_mm * (1.0 + recipe.diameter_change * (1.0 - turn.cos()) / 2.0)
    }

    /// How far from the rope axis the strands' centres are at `x_mm`, in mm. Strands keep their size: a rope gets thinner by its core.
    pub fn strand_curve_radius_mm(&self, x_mm: f64) -> f64 {
        self.rope.strand_curve_radius_mm() + (self.diameter_mm(x_mm) - self.recipe.diameter_mm) / 2.0
    }

    /// How far the centre of a strand of this phase is from its place on the circle, (y, z) in mm in the axes of the view at
    /// `angle_rad`: the cut is stretched in one direction and squeezed in the other.
    pub fn oval_offset_mm(&self, x_mm: f64, phase_rad: f64, angle_rad: f64) -> (f64, f64) {
        let stretched_mm = self.diameter_mm(x_mm) * self.recipe.ovality / 4.0;
        let (sin, cos) = (phase_rad + angle_rad).sin_cos();
        (stretched_mm * sin, stretched_mm * cos)
    }

    /// Where the rope axis is at a line: (y, z) in mm in the axes of a view.
    pub fn axis_in_view_mm(&self, line: usize, view: usize) -> (f64, f64) {
        let t = line as f64 * self.recipe.line_pitch_mm;
        let (y, z) = (self.offset_mm[0].value(t), self.offset_mm[1].value(t));
        let (sin, cos) = self.view_angle_rad(view).sin_cos();
        (y * cos + z * sin, -y * sin + z * cos)
    }

    /// Column of the rope axis at a line less the middle of the sensor, in px.
    pub fn displacement_px(&self, line: usize, view: usize) -> f64 {
        let (y, z) = self.axis_in_view_mm(line, view);
        self.camera.column_px(y, z) - self.camera.axis_px
    }

    /// Phase of strand `j` at `x_mm` in rope axes, with its own deviation.
    pub fn strand_phase_rad(&self, j: usize, x_mm: f64) -> f64 {
        self.strand.phase_rad(x_mm) + j as f64 * self.rope.strand_step_rad() + self.strand_jitter[j].value(x_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lays_stay_within_the_drift_and_keep_their_hand() {
        let recipe = Recipe { strand_lay_mm: -137.5, ..Recipe::artificial() };
        let scene = Scene::new(&recipe, 3).unwrap();
        for k in 0..3000 {
            let x = f64::from(k) * 10.0;
            assert!((-152.01..=-122.99).contains(&scene.strand.lay_mm(x)));
            assert!(scene.wires.iter().all(|w| (58.99..=99.01).contains(&w.lay_mm(x))));
        }
    }

    #[test]
    fn no_view_sees_more_motion_than_asked_for() {
        let scene = Scene::new(&Recipe { oscillation_px: 6.0, ..Recipe::photographic() }, 11).unwrap();
        let most = (0..scene.lines()).step_by(10).map(|l| scene.displacement_px(l, 1).abs()).fold(0.0, f64::max);
        assert!(most > 1.0 && most < 6.2, "{most}"); // a nearer rope is a little larger
    }
}
