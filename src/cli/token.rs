//! `ropescope token`.

use clap::Subcommand;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use ropescope::clock::{Clock, SystemClock};
use ropescope::http::auth;
use ropescope::http::times::rfc3339;
use ropescope::store::Store;
use ropescope::store::tokens::Role;
use std::path::PathBuf;

/// Makes, lists and revokes access tokens.
#[derive(clap::Args)]
pub(crate) struct TokenArgs {
    #[command(subcommand)]
    command: TokenCommand,
}

#[derive(Subcommand)]
enum TokenCommand {
    /// Makes a token and prints it alone on the last line
    Create {
        /// What it may do
        #[arg(long, value_parser = role_parser())]
        role: Role,
        /// Data folder of the service
        #[arg(long, env = "ROPESCOPE_DATA", value_name = "DIR")]
        data: PathBuf,
        /// Who or what will use it
        #[arg(long, default_value = "command line")]
        name: String,
    },
    /// Lists tokens without their secrets
    List {
        /// Data folder of the service
        #[arg(long, env = "ROPESCOPE_DATA", value_name = "DIR")]
        data: PathBuf,
    },
    /// Makes a token invalid
    Revoke {
        /// Id of the token, as `token list` shows it
        id: String,
        /// Data folder of the service
        #[arg(long, env = "ROPESCOPE_DATA", value_name = "DIR")]
        data: PathBuf,
    },
}

/// Reads a role by its name; the help lists all of them.
fn role_parser() -> impl TypedValueParser<Value = Role> {
    let names = Role::ALL.map(|role| PossibleValue::new(role.name()).help(role.meaning()));
    PossibleValuesParser::new(names).try_map(|name| Role::of_name(&name).ok_or(format!("there is no role {name}")))
}

/// Runs the command.
pub(crate) fn run(args: TokenArgs) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let now_ms = SystemClock.now_ms();
        match args.command {
            TokenCommand::Create { role, data, name } => {
                let store = Store::open(&data).await?;
                let (row, token) = auth::issue(&store, &name, role, now_ms).await?;
                store.close().await;
                eprintln!("token {} of role {} for {}; it is shown only now", row.id, row.role, row.name);
                println!("{token}");
            }
            TokenCommand::List { data } => {
                let store = Store::open(&data).await?;
                for token in store.tokens().await? {
                    let state = match token.revoked_at_ms {
                        Some(ms) => format!("revoked {}", rfc3339(ms)),
                        None => "valid".to_owned(),
                    };
                    println!(
                        "{}  {:9}  {}  {state}  {}",
                        token.id,
                        token.role,
                        rfc3339(token.created_at_ms),
                        token.name
                    );
                }
                store.close().await;
            }
            TokenCommand::Revoke { id, data } => {
                let store = Store::open(&data).await?;
                let found = store.revoke_token(&id, now_ms).await?;
                store.close().await;
                anyhow::ensure!(found, "there is no token {id}");
                println!("token {id} is not valid any more");
            }
        }
        Ok(())
    })
}
