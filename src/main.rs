//! The command line of Ropescope.

mod cli;

fn main() -> std::process::ExitCode {
    cli::run()
}
