//! `ropescope demo`: the whole way of a rope through the service, on a rope whose truth is known.

mod compare;
mod picture;
mod stage;

use anyhow::{Context, ensure};
use ropescope::config::Settings;
use ropescope::http::auth;
use ropescope::service::{self, Service};
use ropescope::simulate::Recipe;
use ropescope::store::tokens::Role;
use ropescope::upload::Client;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Shows the whole service on a simulated rope: upload, training, inspection, results against truth, a picture.
#[derive(clap::Args)]
pub(crate) struct DemoArgs {
    /// Stop after the results instead of serving on
    #[arg(long)]
    exit: bool,
    /// Folder for everything the demo makes [default: a temporary one]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// The picture that is written
    #[arg(long, value_name = "PNG", default_value = "ropescope-demo.png")]
    picture: PathBuf,
    /// Metres of intact and of damaged rope
    #[arg(long, value_name = "M", default_value_t = 3.0)]
    metres: f64,
    /// Defects planted in the damaged rope
    #[arg(long, value_name = "N", default_value_t = 8)]
    defects: usize,
    /// Every random choice of the simulation follows from this number
    #[arg(long, default_value_t = 7)]
    seed: u64,
}

/// Name of ropeway and rope.
const ROPEWAY: &str = "Demo ropeway";
const ROPE: &str = "Track rope 1";

/// Runs the command.
pub(crate) fn run(args: DemoArgs) -> anyhow::Result<()> {
    ropescope::tls::install();
    let temporary;
    let folder = match &args.data {
        Some(folder) => folder.clone(),
        None => {
            temporary = tempfile::tempdir().context("cannot make a temporary folder; give one with --data")?;
            temporary.path().to_owned()
        }
    };
    tokio::runtime::Builder::new_multi_thread().enable_all().build()?.block_on(demo(&args, &folder))
}

async fn demo(args: &DemoArgs, folder: &Path) -> anyhow::Result<()> {
    let begun = Instant::now();
    let settings = Settings { listen: ([127, 0, 0, 1], 0).into(), ..Settings::new(folder.join("service")) };
    let service = Service::start(settings).await?;
    let url = service.base_url();
    let (_, token) = auth::issue(&service.app.store, "demo", Role::Admin, service.app.now_ms()).await?;
    println!("service     {url}, data in {}", folder.display());
    let client = Client::new(&url, &token, Duration::from_secs(60), args.seed)?;

    let intact = Recipe { metres: args.metres, ..Recipe::photographic() };
    let damaged = Recipe { defects: args.defects, ..intact.clone() };
    let intact_folder = stage::simulate("intact", intact, args.seed, folder, "2026-01-15T09:00:00Z")?;
    let damaged_folder = stage::simulate("damaged", damaged, args.seed + 1, folder, "2026-07-15T09:00:00Z")?;
    let intact = stage::upload_folder(&client, &intact_folder).await?;
    let damaged = stage::upload_folder(&client, &damaged_folder).await?;

    let train = json!({"kind": "train", "acquisition_id": intact});
    let model_id = text(&stage::job(&client, "train", &train).await?, "model_id")?;
    let inspect = json!({"kind": "inspect", "acquisition_id": damaged, "model_id": model_id});
    let inspection_id = text(&stage::job(&client, "inspect", &inspect).await?, "inspection_id")?;

    let lays = client.get(&format!("/inspections/{inspection_id}/lay-lengths")).await?;
    let found = client.get(&format!("/inspections/{inspection_id}/defects")).await?;
    let truth = compare::Truth::read(&damaged_folder)?;
    println!("\nLay lengths of the damaged rope against truth, in mm (right-hand is positive)\n");
    print!("{}", compare::lay_lengths(&truth, &lays));
    println!("\nDefects planted and found\n");
    print!("{}", compare::defects(&truth, &found));

    let png = picture::draw(&client, &inspection_id, &truth, &found).await?;
    png.save(&args.picture).with_context(|| format!("cannot write {}", args.picture.display()))?;
    println!("\npicture     {}", args.picture.display());
    println!("finished    after {:.0} s", begun.elapsed().as_secs_f64());
    if !args.exit {
        explore(&url, &token, &inspection_id, &damaged);
        service::signal().await;
    }
    service.stop().await;
    Ok(())
}

fn text(result: &Value, key: &str) -> anyhow::Result<String> {
    let text = result[key].as_str().unwrap_or_default().to_owned();
    ensure!(!text.is_empty(), "the job has no {key}: {result}");
    Ok(text)
}

/// Where to look next.
fn explore(url: &str, token: &str, inspection_id: &str, acquisition_id: &str) {
    println!("\nThe service keeps running; stop it with Ctrl-C. Look around:\n");
    println!("  {url}/docs  (authorise with the token below)");
    println!("  export ROPESCOPE_TOKEN={token}");
    for path in [
        "/ropeways".to_owned(),
        format!("/acquisitions/{acquisition_id}"),
        format!("/inspections/{inspection_id}"),
        format!("/inspections/{inspection_id}/lay-lengths?format=csv"),
        format!("/inspections/{inspection_id}/defects"),
        format!("/inspections/{inspection_id}/views/0/likelihood.png?from_m=0&to_m=0.5"),
    ] {
        let output = if path.contains(".png") { " -o likelihood.png" } else { "" };
        println!("  curl -s -H \"Authorization: Bearer $ROPESCOPE_TOKEN\" '{url}/api/v1{path}'{output}");
    }
}
