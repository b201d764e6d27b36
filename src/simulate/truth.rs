//! The tables of what is true: `truth_lines.csv`, `truth_wires.csv`, and the noisy contours of the artificial kind.

use super::artificial::contours_px;
use super::cross_section::CrossSection;
use super::noise::{GaussianStream, Stream};
use super::scene::Scene;
use std::io::{self, Write};

/// Every how many lines `truth_wires.csv` has a row.
pub const WIRE_ROW_LINES: usize = 10;

/// Writes `line,x_mm,strand_phase_rad,strand_lay_mm,dv0_px,...,diameter_mm,ovality_percent`: one row a line. Phases are of strand 0
/// without its own deviation.
pub fn write_lines(scene: &Scene, out: &mut impl Write) -> io::Result<()> {
    write!(out, "line,x_mm,strand_phase_rad,strand_lay_mm")?;
    for view in 0..scene.views() {
        write!(out, ",dv{view}_px")?;
    }
    writeln!(out, ",diameter_mm,ovality_percent")?;
    let ovality_percent = 100.0 * scene.recipe().ovality;
    for line in 0..scene.lines() {
        let x = scene.x_mm(line);
        write!(out, "{line},{x:.4},{:.6},{:.4}", scene.strand.phase_rad(x), scene.strand.lay_mm(x))?;
        for view in 0..scene.views() {
            write!(out, ",{:.3}", scene.displacement_px(line, view))?;
        }
        writeln!(out, ",{:.5},{ovality_percent:.4}", scene.diameter_mm(x))?;
    }
    Ok(())
}

/// Writes `line`, then per strand `wire_phase{j}_rad,wire_lay{j}_mm,strand_jitter{j}_rad`: one row every ten lines.
pub fn write_wires(scene: &Scene, out: &mut impl Write) -> io::Result<()> {
    write!(out, "line")?;
    for j in 0..scene.rope().strands() {
        write!(out, ",wire_phase{j}_rad,wire_lay{j}_mm,strand_jitter{j}_rad")?;
    }
    writeln!(out)?;
    for line in (0..scene.lines()).step_by(WIRE_ROW_LINES) {
        let x = scene.x_mm(line);
        write!(out, "{line}")?;
        for (wire, jitter) in scene.wires.iter().zip(&scene.strand_jitter) {
            write!(out, ",{:.6},{:.4},{:.6}", wire.phase_rad(x), wire.lay_mm(x), jitter.value(x))?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// The volumetric contours of every line of a view in px, lower and upper, with the noise that the recipe asks for.
pub fn contours(scene: &Scene, view: usize) -> impl Iterator<Item = (f64, f64)> {
    let mut noise = GaussianStream::new(scene.seed(), Stream::Contours(view));
    let sd = scene.recipe().contour_noise_px;
    let mut cut = CrossSection::default();
    (0..scene.lines()).map(move |line| {
        cut.cut(scene, view, line, &[]);
        let (low, high) = contours_px(scene, &cut);
        (low + sd * f64::from(noise.draw()), high + sd * f64::from(noise.draw()))
    })
}

/// Writes `line,lower_px,upper_px` of a view: its [`contours`].
pub fn write_contours(scene: &Scene, view: usize, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "line,lower_px,upper_px")?;
    for (line, (low, high)) in contours(scene, view).enumerate() {
        writeln!(out, "{line},{low:.3},{high:.3}")?;
    }
    Ok(())
}
