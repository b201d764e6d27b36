//! The loop that empties the outbox. `step` does one round and is what tests call; `run` repeats it until told to stop.

use super::guard::{Resolver, system_resolver};
use super::send::{self, Answer, Message};
use super::{event, schedule};
use crate::clock::Clock;
use crate::store::deliveries::{Attempt, Claim, Settlement};
use crate::store::outbox::DefectFacts;
use crate::store::{Store, StoreError};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;

/// Deliveries of one round, and of one endpoint in a round.
const ROUND: u32 = 16;
const ROUND_PER_ENDPOINT: u32 = 4;
/// Longest sleep between rounds: another process may have written to the outbox.
const LONGEST_SLEEP: Duration = Duration::from_secs(2);

/// How the dispatcher works.
#[derive(Clone)]
pub struct Settings {
    /// Where people reach this service, without a slash at the end; links start with it.
    pub base_url: String,
    /// Waits between attempts in s, [`schedule::WAITS_S`].
    pub waits_s: Vec<u64>,
    /// Longest attempt, [`send::TIMEOUT`].
    pub timeout: Duration,
    /// Turns host names into addresses.
    pub resolver: Resolver,
}

impl Settings {
    /// The settings of the service: everything as documented, links to `base_url`.
    pub fn new(base_url: &str) -> Self {
        Self {
            base_url: base_url.trim_end_matches('/').to_owned(),
            waits_s: schedule::WAITS_S.to_vec(),
            timeout: send::TIMEOUT,
            resolver: system_resolver(),
        }
    }
}

/// Carries events to endpoints.
pub struct Dispatcher {
    store: Store,
    clock: Arc<dyn Clock>,
    settings: Settings,
    rng: ChaCha8Rng,
}

impl Dispatcher {
    /// A dispatcher of the outbox of `store`; `rng` is for the jitter.
    pub fn new(store: Store, clock: Arc<dyn Clock>, settings: Settings, rng: ChaCha8Rng) -> Self {
        Self { store, clock, settings, rng }
    }

    /// Attempts what is due now, side by side, and records what came of it. Returns the number of attempts.
    pub async fn step(&mut self) -> Result<usize, StoreError> {
        let claims = self.store.claim_deliveries(self.clock.now_ms(), ROUND, ROUND_PER_ENDPOINT).await?;
        let (settings, clock) = (&self.settings, &*self.clock);
        let answers = futures::future::join_all(claims.iter().map(|claim| attempt(claim, settings, clock))).await;
        for (claim, (attempt, answer)) in claims.iter().zip(answers) {
            self.settle(claim, attempt, &answer).await?;
        }
        Ok(claims.len())
    }

    async fn settle(&mut self, claim: &Claim, attempt: Attempt, answer: &Answer) -> Result<(), StoreError> {
        let now_ms = self.clock.now_ms();
        let failed = usize::try_from(claim.attempts).unwrap_or(usize::MAX).saturating_add(1);
        let mut later =
            |retry_after| match schedule::wait_ms(&self.settings.waits_s, failed, retry_after, &mut self.rng) {
                Some(wait_ms) => Settlement::Retry { at_ms: now_ms + wait_ms },
                None => Settlement::Dead,
            };
        let settlement = match answer {
            Answer::Accepted { .. } => Settlement::Delivered,
            Answer::Gone => {
                Settlement::Disable { reason: "the receiver answered 410: it wants no more events".to_owned() }
            }
            Answer::Refused { retry_after, .. } => later(*retry_after),
            Answer::Unreachable { .. } => later(None),
        };
        let outcome = match settlement {
            Settlement::Delivered => "delivered",
            Settlement::Retry { .. } => "retry",
            Settlement::Dead => "dead",
            Settlement::Disable { .. } => "disabled",
        };
        metrics::counter!("ropescope_webhook_attempts_total", "outcome" => outcome).increment(1);
        tracing::info!(
            event = claim.event_id, endpoint = %claim.endpoint_id.0, outcome, status = attempt.status,
            error = attempt.error, duration_ms = attempt.duration_ms, "webhook attempt"
        );
        self.store.settle_delivery(claim, &attempt, &settlement, now_ms).await?;
        Ok(())
    }

    /// Repeats [`Self::step`] until `shutdown`; `wake` ends a sleep early. An attempt that runs is finished first. A database that
    /// fails is tried again: the outbox must outlive a full disk.
    pub async fn run(mut self, wake: Arc<tokio::sync::Notify>, shutdown: CancellationToken) {
        while !shutdown.is_cancelled() {
            match self.step().await {
                Ok(0) => {}
                Ok(_) => continue,
                Err(error) => tracing::error!(%error, "the outbox could not be worked on"),
            }
            tokio::select! {
                () = wake.notified() => {}
                () = tokio::time::sleep(LONGEST_SLEEP) => {}
                () = shutdown.cancelled() => {}
            }
        }
    }
}

async fn attempt(claim: &Claim, settings: &Settings, clock: &dyn Clock) -> (Attempt, Answer) {
    let started_ms = clock.now_ms();
    let begun = Instant::now();
    let answer = match serde_json::from_str::<DefectFacts>(&claim.facts) {
        Err(error) => Answer::Unreachable { reason: format!("the stored event cannot be read: {error}") },
        Ok(facts) => {
            let message = Message {
                url: &claim.url,
                secret: &claim.secret,
                allow_private: claim.allow_private,
                id: &claim.event_id,
                body: event::body(&claim.event_id, claim.occurred_at_ms, &facts, &settings.base_url).to_string(),
            };
            send::attempt(&message, started_ms, settings.timeout, &settings.resolver).await
        }
    };
    let (status, error) = match &answer {
        Answer::Accepted { status } => (Some(i64::from(*status)), None),
        Answer::Gone => (Some(410), Some("gone".to_owned())),
        Answer::Refused { status, said, .. } => {
            let redirect = if (300..400).contains(status) { " (redirects are not followed)" } else { "" };
            (Some(i64::from(*status)), Some(format!("the receiver answered {status}{redirect}: {said}")))
        }
        Answer::Unreachable { reason } => (None, Some(reason.clone())),
    };
    let duration_ms = i64::try_from(begun.elapsed().as_millis()).unwrap_or(i64::MAX);
    (Attempt { number: 0, started_at_ms: started_ms, duration_ms, status, error }, answer)
}
