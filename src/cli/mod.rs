//! Every command of `ropescope`, one file each.

mod backup;
mod cards;
mod demo;
mod evaluate;
mod given_contours;
mod healthcheck;
mod inspect;
mod inspect_report;
mod live;
mod logs;
mod printing;
mod recording;
mod results_out;
mod retention;
mod run_progress;
mod scrub;
mod serve;
mod simulate;
mod surface_alarms_out;
mod time_left;
mod token;
mod train;
mod train_ranges;
mod upload;
mod upload_progress;
mod verify_receipt;
mod worker;

use clap::{Parser, Subcommand};
use ropescope::pipeline::PipelineError;
use std::process::ExitCode;

/// Inspects stranded wire ropes with line cameras: lay lengths, defects, likelihood maps.
#[derive(Parser)]
#[command(version, about, long_about = None, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Serve(serve::ServeArgs),
    Worker(worker::WorkerArgs),
    Token(token::TokenArgs),
    Simulate(Box<simulate::SimulateArgs>),
    Train(train::TrainArgs),
    Inspect(inspect::InspectArgs),
    Evaluate(evaluate::EvaluateArgs),
    Upload(upload::UploadArgs),
    VerifyReceipt(verify_receipt::VerifyReceiptArgs),
    Backup(backup::BackupArgs),
    Restore(backup::RestoreArgs),
    Scrub(scrub::ScrubArgs),
    Retention(retention::RetentionArgs),
    Demo(demo::DemoArgs),
    Healthcheck(healthcheck::HealthcheckArgs),
}

/// Runs the command. Exit codes: 0 done, 1 failed, 2 wrong arguments (clap's), 130 stopped by Ctrl-C; `upload` has more.
pub(crate) fn run() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::Serve(args) => serve::run(args),
        Command::Worker(args) => worker::run(args),
        Command::Token(args) => token::run(args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Train(args) => train::run(args),
        Command::Inspect(args) => inspect::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Upload(args) => upload::run(args),
        Command::VerifyReceipt(args) => verify_receipt::run(&args),
        Command::Backup(args) => backup::backup(&args),
        Command::Restore(args) => backup::restore(&args),
        Command::Scrub(args) => scrub::run(&args),
        Command::Retention(args) => retention::run(&args),
        Command::Demo(args) => demo::run(args),
        Command::Healthcheck(args) => healthcheck::run(args),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if matches!(error.downcast_ref(), Some(PipelineError::Cancelled)) => {
            run_progress::say("ropescope: stopped; nothing was written");
            ExitCode::from(run_progress::INTERRUPTED)
        }
        Err(error) => {
            run_progress::say(&format!("ropescope: {}", in_one_line(&error)));
            upload::exit_code(&error).map_or(ExitCode::FAILURE, ExitCode::from)
        }
    }
}

/// An error and its causes. A cause that the error above already quotes is not said again.
fn in_one_line(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.ends_with(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}
