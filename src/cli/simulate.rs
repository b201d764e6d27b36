//! `ropescope simulate`.

use anyhow::{Context, bail};
use clap::ValueEnum;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use indicatif::{ProgressBar, ProgressStyle};
use ropescope::simulate::defects::{DefectKind, KINDS};
use ropescope::simulate::{Background, Recipe, RenderProgress, Scene, write_acquisition};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Writes a synthetic acquisition with known truth.
///
/// The folder holds what a camera head would deliver (rope.json and view0/frame_000000.png, ...) and beside it what is
/// true: truth_lines.csv, truth_wires.csv and labels.json. The same options and --seed give the same bytes.
///
/// Lay lengths are signed: positive is right-hand. Wire lay is measured against the fixed axes, so strand and wire lay of
/// opposite sign are ordinary lay, of the same sign Lang lay.
#[derive(clap::Args)]
#[command(after_long_help = "Examples:
  ropescope simulate --out intact --metres 5
      five metres of intact rope in service, seen by four cameras
  ropescope simulate --out damaged --metres 8 --defects 12 --defect-free-m 4 --dirt 0.6
      to train on the first four metres and find defects in the rest
  ropescope simulate --out lang --strands 8 --diameter-mm 36 --strand-lay-mm=-245 --wire-lay-mm=-88
      a left-hand rope in Lang lay
  ropescope simulate --out paper --kind artificial --contour-noise-px 2
      the ArtificialRope protocol of the paper; inspect it with --contours given")]
pub(crate) struct SimulateArgs {
    /// Folder to write; must be empty or not exist, unless --force is given
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write into a folder that is not empty; files of the same names are replaced
    #[arg(long)]
    force: bool,
    /// How the rope is drawn: photographic looks like rope in service, artificial is the paper's Gaussian centre lines
    #[arg(long, value_enum, default_value = "photographic")]
    kind: KindArg,
    /// Every random choice follows from this number
    #[arg(long, default_value_t = 1)]
    seed: u64,

    /// Length of rope [default: 10, artificial 30]
    #[arg(long, value_name = "M")]
    metres: Option<f64>,
    /// Number of strands, 3 to 8 [default: 6]
    #[arg(long, value_name = "N", help_heading = "Rope")]
    strands: Option<usize>,
    /// Outer wires per strand, 5 to 16 [default: 9]
    #[arg(long, value_name = "N", help_heading = "Rope")]
    wires: Option<usize>,
    /// Rope diameter [default: 32, artificial 20.46]
    #[arg(long, value_name = "MM", help_heading = "Rope")]
    diameter_mm: Option<f64>,
    /// The diameter is that much larger in the middle of the rope, 0.02 is 2 %, negative for a neck [default: 0]
    #[arg(long, value_name = "RATIO", allow_negative_numbers = true, help_heading = "Rope")]
    diameter_change: Option<f64>,
    /// Largest less smallest diameter of a cut, 0.02 is 2 %; the camera at 0 degrees sees the largest [default: 0]
    #[arg(long, value_name = "RATIO", help_heading = "Rope")]
    ovality: Option<f64>,
    /// Nominal strand lay, negative for left-hand [default: 220, artificial 137.5; other constructions 6.9 diameters]
    #[arg(long, value_name = "MM", allow_negative_numbers = true, help_heading = "Rope")]
    strand_lay_mm: Option<f64>,
    /// Nominal wire lay [default: -95, artificial 79; other constructions 8.9 strand diameters]
    #[arg(long, value_name = "MM", allow_negative_numbers = true, help_heading = "Rope")]
    wire_lay_mm: Option<f64>,
    /// The strand lay stays within nominal +- this [default: 2.2, artificial 14.5]
    #[arg(long, value_name = "MM", help_heading = "Rope")]
    strand_lay_drift_mm: Option<f64>,
    /// The wire lay of each strand stays within nominal +- this [default: 3.5, artificial 20]
    #[arg(long, value_name = "MM", help_heading = "Rope")]
    wire_lay_drift_mm: Option<f64>,
    /// Shortest wave of the drift of lay lengths [default: 1.2, artificial 6]
    #[arg(long, value_name = "M", help_heading = "Rope")]
    drift_wave_m: Option<f64>,
    /// How far strands stray from their regular phase [default: 0.035, artificial 0]
    #[arg(long, value_name = "RAD", help_heading = "Rope")]
    strand_jitter_rad: Option<f64>,

    /// Number of cameras, evenly round the rope, 1 to 8 [default: 4, artificial 1]
    #[arg(long, value_name = "N", help_heading = "Cameras")]
    views: Option<usize>,
    /// Angles of the cameras instead, comma-separated
    #[arg(
        long,
        value_name = "DEG,...",
        value_delimiter = ',',
        allow_negative_numbers = true,
        conflicts_with = "views",
        help_heading = "Cameras"
    )]
    view_angles: Option<Vec<f64>>,
    /// Rope per camera line [default: 0.1]
    #[arg(long, value_name = "MM", help_heading = "Cameras")]
    line_pitch_mm: Option<f64>,
    /// Lines of a frame [default: 2000]
    #[arg(long, value_name = "N", help_heading = "Cameras")]
    frame_lines: Option<usize>,
    /// Pixels of a camera line [default: 480]
    #[arg(long, value_name = "PX", help_heading = "Cameras")]
    sensor_px: Option<u32>,
    /// Width of the rope in the image [default: 380]
    #[arg(long, value_name = "PX", help_heading = "Cameras")]
    rope_width_px: Option<f64>,
    /// Camera to rope axis [default: 7 rope diameters]
    #[arg(long, value_name = "MM", help_heading = "Cameras")]
    camera_distance_mm: Option<f64>,
    /// Rope metre of the first line [default: 0]
    #[arg(long, value_name = "M", allow_negative_numbers = true, help_heading = "Cameras")]
    start_m: Option<f64>,
    /// rope.json states the scale of the cameras, px_per_mm, so that diameters can be absolute
    #[arg(long, help_heading = "Cameras")]
    calibrated: bool,
    /// Noise of gray values: sd in gray levels [default: 2 in the dark, artificial 10]
    #[arg(long, visible_alias = "noise", value_name = "LEVELS", help_heading = "Cameras")]
    gray_noise: Option<f64>,
    /// Noise of contours{v}.csv: sd; artificial kind only [default: 1]
    #[arg(long, value_name = "PX", help_heading = "Cameras")]
    contour_noise_px: Option<f64>,
    /// Dead or hot columns a view [default: 1, artificial 0]
    #[arg(long, value_name = "N", help_heading = "Cameras")]
    bad_columns: Option<usize>,

    /// Farthest sideways motion of the rope [default: 4, artificial 0]
    #[arg(long, value_name = "PX", help_heading = "Service")]
    oscillation_px: Option<f64>,
    /// Farthest error of the encoder [default: 0.02, artificial 0]
    #[arg(long, value_name = "MM", help_heading = "Service")]
    encoder_jitter_mm: Option<f64>,
    /// Dirt, 0 (new) to 1 [default: 0.35]
    #[arg(long, value_name = "0..1", help_heading = "Service")]
    dirt: Option<f64>,
    /// Oil spots per metre [default: 1.5]
    #[arg(long, value_name = "N", help_heading = "Service")]
    oil_spots_per_m: Option<f64>,
    /// Water film and drops, 0 (dry) to 1 [default: 0.05]
    #[arg(long, value_name = "0..1", help_heading = "Service")]
    water: Option<f64>,
    /// Harmless scratches per metre [default: 3]
    #[arg(long, value_name = "N", help_heading = "Service")]
    scratches_per_m: Option<f64>,
    /// Harmless foreign matter, pieces per metre: tar, grease, water, fibres, grit, stains, paint [default: 0]
    #[arg(long, value_name = "N", help_heading = "Service")]
    debris_per_m: Option<f64>,
    /// Brightness, 1 is as usual [default: 1]
    #[arg(long, value_name = "RATIO", help_heading = "Service")]
    exposure: Option<f64>,
    /// How strongly wires gleam, 1 is as usual [default: 1]
    #[arg(long, value_name = "RATIO", help_heading = "Cameras")]
    gloss: Option<f64>,
    /// How far the lamps stand to the sides of the camera, 1 is as usual [default: 1]
    #[arg(long, value_name = "RATIO", help_heading = "Cameras")]
    lamp_spread: Option<f64>,
    /// Blur of the lens: sd [default: 0.55]
    #[arg(long, value_name = "PX", help_heading = "Cameras")]
    blur_px: Option<f64>,
    /// Farthest drift of the light along the rope, 0.1 is 10 % [default: 0.12, artificial 0]
    #[arg(long, value_name = "RATIO", help_heading = "Service")]
    light_drift: Option<f64>,
    /// Light lost at the ends of the sensor, 0 to 1 [default: 0.18]
    #[arg(long, value_name = "0..1", help_heading = "Service")]
    vignetting: Option<f64>,
    /// What is behind the rope [default: dark]
    #[arg(long, value_enum, help_heading = "Service")]
    background: Option<BackgroundArg>,

    /// Number of defects, of every kind in turn unless --defect-kind says which [default: 0]
    #[arg(long, value_name = "N", help_heading = "Defects")]
    defects: Option<usize>,
    /// So many of them at one metre of the rope, on strands of their own [default: 1]
    #[arg(long, value_name = "N", help_heading = "Defects")]
    defects_at_once: Option<usize>,
    /// The kind that all defects are of
    #[arg(long, value_name = "KIND", value_parser = defect_kinds(), help_heading = "Defects")]
    defect_kind: Option<DefectKind>,
    /// No defect before this metre of the acquisition: the part to train on [default: 0]
    #[arg(long, value_name = "M", help_heading = "Defects")]
    defect_free_m: Option<f64>,
    /// How far defects of one kind differ in look and size, 0 to 1 [default: 0]
    #[arg(long, value_name = "0..1", help_heading = "Defects")]
    defect_variety: Option<f64>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum KindArg {
    Photographic,
    Artificial,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum BackgroundArg {
    /// The tunnel of a camera head
    Dark,
    /// A workshop
    Bright,
    /// A workshop with the rope's shadow
    Shadow,
}

impl SimulateArgs {
    fn recipe(&self) -> anyhow::Result<Recipe> {
        let mut recipe = match self.kind {
            KindArg::Photographic => Recipe::photographic(),
            KindArg::Artificial => Recipe::artificial(),
        };
        if self.kind == KindArg::Artificial && self.defects.is_some_and(|n| n > 0) {
            bail!("--defects needs --kind photographic: the artificial kind has centre lines but no surface");
        }
        if self.strands.is_some() || self.wires.is_some() || self.diameter_mm.is_some() {
            let (n, m, d) = (recipe.strands, recipe.wires_per_strand, recipe.diameter_mm);
            recipe = recipe.with_construction(
                self.strands.unwrap_or(n),
                self.wires.unwrap_or(m),
                self.diameter_mm.unwrap_or(d),
            );
        }
        macro_rules! take {
            ($($option:ident),*) => { $(if let Some(value) = self.$option { recipe.$option = value; })* };
        }
        recipe.calibrated = self.calibrated;
        take!(diameter_change, ovality);
        take!(metres, strand_lay_mm, wire_lay_mm, strand_lay_drift_mm, wire_lay_drift_mm, drift_wave_m);
        take!(strand_jitter_rad, line_pitch_mm, frame_lines, sensor_px, rope_width_px, camera_distance_mm, start_m);
        take!(gray_noise, contour_noise_px, bad_columns, oscillation_px, encoder_jitter_mm, dirt, oil_spots_per_m);
        take!(water, scratches_per_m, debris_per_m, exposure, light_drift, vignetting, defects, defect_free_m);
        take!(gloss, lamp_spread, blur_px, defects_at_once, defect_variety);
        recipe.defect_kind = self.defect_kind;
        if let Some(views) = self.views {
            recipe.view_angles_deg = Recipe::evenly_spaced(views);
        }
        if let Some(angles) = &self.view_angles {
            recipe.view_angles_deg.clone_from(angles);
        }
        if let Some(background) = self.background {
            recipe.background = match background {
                BackgroundArg::Dark => Background::Dark,
                BackgroundArg::Bright => Background::Bright,
                BackgroundArg::Shadow => Background::Shadow,
            };
        }
        Ok(recipe)
    }
}

/// Kinds of defects by the names that labels give them.
fn defect_kinds() -> impl TypedValueParser<Value = DefectKind> {
    PossibleValuesParser::new(KINDS.map(DefectKind::name))
        .try_map(|name| DefectKind::named(&name).ok_or("no such kind"))
}

/// Runs the command.
pub(crate) fn run(args: &SimulateArgs) -> anyhow::Result<()> {
    let scene = Scene::new(&args.recipe()?, args.seed)?;
    if !args.force && std::fs::read_dir(&args.out).is_ok_and(|mut entries| entries.next().is_some()) {
        bail!("{} is not empty: choose another --out, or --force to write into it", args.out.display());
    }
    std::fs::create_dir_all(&args.out).with_context(|| format!("cannot create {}", args.out.display()))?;
    let teller = Teller::new(&scene);
    let labels = write_acquisition(&scene, &args.out, |progress| teller.tell(progress))?;
    teller.bar.finish_and_clear();
    let seconds = teller.started.elapsed().as_secs_f64();
    let recipe = scene.recipe();
    println!(
        "{}: {} m of rope {}x{}, {} views, {} frames, {} defects ({} labels), seed {}, {:.2} m/s",
        args.out.display(),
        recipe.metres,
        recipe.strands,
        recipe.wires_per_strand,
        scene.views(),
        scene.frames() * scene.views(),
        scene.defects().len(),
        labels.len(),
        args.seed,
        recipe.metres / seconds
    );
    Ok(())
}

/// Says how far the run is: a bar on a terminal, a line every few seconds elsewhere.
struct Teller {
    bar: ProgressBar,
    started: Instant,
    /// When the last plain line was written; `None` on a terminal.
    last_line: Option<Mutex<Instant>>,
    metres_per_view_line: f64,
}

impl Teller {
    fn new(scene: &Scene) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar =
            if terminal { ProgressBar::new((scene.lines() * scene.views()) as u64) } else { ProgressBar::hidden() };
        if let Ok(style) = ProgressStyle::with_template("rendering {wide_bar} {percent} %  {msg}  {eta} left") {
            bar.set_style(style);
        }
        let started = Instant::now();
        Self {
            bar,
            started,
            last_line: (!terminal).then(|| Mutex::new(started)),
            metres_per_view_line: scene.recipe().line_pitch_mm / 1000.0 / scene.views() as f64,
        }
    }

    fn tell(&self, progress: RenderProgress) {
        let seconds = self.started.elapsed().as_secs_f64().max(1e-3);
        let done_m = progress.view_lines_done as f64 * self.metres_per_view_line;
        let total_m = progress.view_lines_total as f64 * self.metres_per_view_line;
        let speed = done_m / seconds;
        self.bar.set_position(progress.view_lines_done as u64);
        self.bar.set_message(format!("{speed:.2} m/s"));
        let Some(last_line) = &self.last_line else { return };
        let Ok(mut last) = last_line.lock() else { return };
        if last.elapsed() >= Duration::from_secs(5) {
            *last = Instant::now();
            let left_s = (total_m - done_m) / speed;
            eprintln!("rendered {done_m:.1} of {total_m:.1} m, {speed:.2} m/s, {left_s:.0} s left");
        }
    }
}
