//! The whole way of a recording, from PNG frames to results, as separate processes of the release binary: metres per second and
//! peak memory of `train` and `inspect`, on a short and on a ten times longer recording of four views of 480 columns.
//!
//! ```text
//! cargo bench --bench whole_process             trains on 5 m, inspects 5 m and 50 m
//! cargo bench --bench whole_process -- --quick  trains on 2 m, inspects 2 m and 4 m
//! ```
//!
//! The recordings are simulated once and kept in `target/bench-data`. Fails if results are empty or a run fails; speed and
//! memory are printed beside what they should be, because they depend on the machine.

use anyhow::{Context, bail, ensure};
use ropescope::pipeline::results::Summary;
use ropescope::simulate::{Recipe, Scene, write_acquisition};
use ropescope::workers::results_folder;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// What a run should reach, in metres of rope per second on two cores.
const TARGET_M_PER_S: f64 = 1.0;
/// What a run may need, in MB, whatever the rope's length.
const TARGET_MB: f64 = 600.0;
/// Share of the rope that must have been covered, and of the stretches that must have a strand lay length.
const LEAST_SHARE: f64 = 0.8;

struct Run {
    seconds: f64,
    peak_mb: f64,
}

fn main() -> anyhow::Result<()> {
    let quick = std::env::args().any(|arg| arg == "--quick");
    let (short_m, long_m) = if quick { (2.0, 4.0) } else { (5.0, 50.0) };
    let data = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("bench-data");
    let intact = recording(&data, "intact", short_m, 0, 1)?;
    let damaged = recording(&data, "damaged", long_m, long_m as usize / 2, 2)?;
    let model = data.join("rope.model");
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    println!("{cores} cores; targets: at least {TARGET_M_PER_S} m/s, below {TARGET_MB} MB\n");
    println!("{:<9} {:>6} {:>9} {:>8} {:>9}", "command", "m", "seconds", "m/s", "peak MB");

    let run = ropescope(&["train".as_ref(), &intact, "--out".as_ref(), &model])?;
    print_row("train", short_m, &run);
    for (folder, metres) in [(&intact, short_m), (&damaged, long_m)] {
        let out = data.join(format!("results-{metres}m"));
        let run = ropescope(&["inspect".as_ref(), folder, "--model".as_ref(), &model, "--out".as_ref(), &out])?;
        print_row("inspect", metres, &run);
        check(&out, metres).with_context(|| format!("the results in {} are not what they should be", out.display()))?;
    }
    Ok(())
}

fn print_row(command: &str, metres: f64, run: &Run) {
    let speed = metres / run.seconds;
    let slow = if speed < TARGET_M_PER_S { "  below the target speed" } else { "" };
    let large = if run.peak_mb > TARGET_MB { "  above the target memory" } else { "" };
    println!("{command:<9} {metres:>6} {:>9.1} {speed:>8.2} {:>9.0}{slow}{large}", run.seconds, run.peak_mb);
}

/// Simulates a recording, or finds it from an earlier run.
fn recording(data: &Path, name: &str, metres: f64, defects: usize, seed: u64) -> anyhow::Result<PathBuf> {
    let folder = data.join(format!("{name}-{metres}m"));
    if folder.is_dir() {
        return Ok(folder);
    }
    println!("simulating {metres} m of {name} rope, once");
    let partial = data.join(format!("{name}-{metres}m.partial"));
    if partial.exists() {
        std::fs::remove_dir_all(&partial)?;
    }
    let recipe = Recipe { metres, defects, ..Recipe::photographic() };
    write_acquisition(&Scene::new(&recipe, seed)?, &partial, |_| {})?;
    std::fs::rename(&partial, &folder)?;
    Ok(folder)
}

/// Runs the release binary to its end and watches its memory.
fn ropescope(arguments: &[&Path]) -> anyhow::Result<Run> {
    let begun = Instant::now();
    let mut child = Command::new(env!("CARGO_BIN_EXE_ropescope"))
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .context("cannot start the binary")?;
    let mut peak_kb = 0;
    let status = loop {
        peak_kb = peak_kb.max(peak_rss_kb(&child).unwrap_or(0));
        if let Some(status) = child.try_wait()? {
            break status;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let seconds = begun.elapsed().as_secs_f64();
    ensure!(status.success(), "ropescope {arguments:?} failed: {status}");
    Ok(Run { seconds, peak_mb: peak_kb as f64 / 1000.0 })
}

/// High-water mark of the resident memory, as Linux counts it. The last look is at most 5 ms before the end.
fn peak_rss_kb(child: &Child) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

/// A fast run that found nothing is no result.
fn check(out: &Path, metres: f64) -> anyhow::Result<()> {
    let summary: Summary = serde_json::from_slice(&std::fs::read(out.join("summary.json"))?)?;
    ensure!((summary.metres - metres).abs() < 0.01, "{} m were inspected, not {metres} m", summary.metres);
    let views_m = 4.0 * metres;
    ensure!(
        summary.covered_view_m >= LEAST_SHARE * views_m,
        "only {:.1} of {views_m} m (summed over the views) were covered",
        summary.covered_view_m
    );
    let rows = results_folder::lay_lengths(out)?;
    let fused: Vec<_> = rows.iter().filter(|row| row.view.is_none()).collect();
    let known = fused.iter().filter(|row| row.strand_lay_mm.is_some()).count();
    if fused.is_empty() || (known as f64) < LEAST_SHARE * fused.len() as f64 {
        bail!("{known} of {} stretches have a strand lay length", fused.len());
    }
    let scores = std::fs::metadata(out.join("line_scores.csv"))?.len();
    ensure!(scores > 10_000, "line_scores.csv has only {scores} bytes");
    Ok(())
}
