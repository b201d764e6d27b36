//! Every command of `ropescope`, one file each.

mod demo;
mod evaluate;
mod healthcheck;
mod inspect;
mod logs;
mod serve;
mod simulate;
mod token;
mod train;
mod upload;
mod upload_progress;
mod worker;

use clap::{Parser, Subcommand};
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
    Demo(demo::DemoArgs),
    Healthcheck(healthcheck::HealthcheckArgs),
}

/// Runs the command. Exit codes: 0 done, 1 failed, 2 wrong arguments (clap's).
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
        Command::Demo(args) => demo::run(args),
        Command::Healthcheck(args) => healthcheck::run(args),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("ropescope: {error:#}");
            ExitCode::FAILURE
        }
    }
}
