//! The lease protocol, on a store with a clock that only moves when told to.

use ropescope::clock::{Clock, ManualClock};
use ropescope::pipeline::TrainOptions;
use ropescope::pipeline::found::{Found, FoundDefects};
use ropescope::pipeline::results::DefectRow;
use ropescope::store::acquisitions::{NewAcquisition, NewView};
use ropescope::store::enqueue::{Enqueued, NewJob, Task};
use ropescope::store::frames::Frame;
use ropescope::store::jobs::Cancellation;
use ropescope::store::leases::{Heartbeat, JobsOn, Lease, MAX_ATTEMPTS, Reached, WaitingFor};
use ropescope::store::models::NewModel;
use ropescope::store::ropes::{Design, NewRope};
use ropescope::store::{Id, PageRequest, Store};
use tempfile::TempDir;
use uuid::Uuid;

const LEASE_MS: i64 = 15_000;

struct Queue {
    store: Store,
    clock: ManualClock,
    acquisition: Id,
    _data: TempDir,
}

fn id() -> Id {
    Id(Uuid::new_v4())
}

fn model() -> NewModel {
    NewModel { id: id(), report: "{}".into(), sha256: String::new(), bytes: 0 }
}

impl Queue {
    async fn new() -> Self {
        let data = tempfile::tempdir().unwrap();
        let store = Store::open(data.path()).await.unwrap();
        let clock = ManualClock::at(1_000_000);
        let (ropeway, rope, acquisition) = (id(), id(), id());
        store.create_ropeway(ropeway, "North", None, 0).await.unwrap();
        let design = Design {
            strands: 6,
            wires_per_strand: 9,
            rope_diameter_mm: 20.0,
            strand_lay_mm: None,
            wire_lay_mm: None,
            strand_diameter_mm: None,
            wire_diameter_mm: None,
            strand_lay_tolerance_mm: None,
            wire_lay_tolerance_mm: None,
        };
        let new = NewRope { id: rope, ropeway_id: ropeway, name: "1".into(), design, ticket_level: None };
        store.create_rope(&new, 0).await.unwrap();
        let new = NewAcquisition {
            id: acquisition,
            rope_id: rope,
            line_pitch_mm: 0.1,
            sensor_px: 64,
            rope_width_px: None,
            start_m: 0.0,
            acquired_at_ms: None,
            views: vec![NewView { angle_deg: 0.0, px_per_mm: None, frames: Some(1) }],
        };
        store.create_acquisition(&new, 0).await.unwrap();
        let upload = data.path().join("uploads/frame");
        std::fs::write(&upload, b"x").unwrap();
        let frame = Frame {
            acquisition_id: acquisition,
            view: 0,
            frame: 0,
            sha256: "00".into(),
            bytes: 1,
            lines: 1,
            content_type: "image/png".into(),
            received_at_ms: 0,
            damaged_at_ms: None,
        };
        store.keep_frame(&upload, frame).await.unwrap();
        store.complete_acquisition(acquisition, None, 1).await.unwrap();
        Self { store, clock, acquisition, _data: data }
    }

    async fn enqueue(&self) -> Id {
        let task = Task::Train { from_m: None, to_m: None, options: TrainOptions::default(), further: Vec::new() };
        let new = NewJob { id: id(), acquisition_id: self.acquisition, task, idempotency_key: None };
        let enqueued = self.store.enqueue(&new, self.clock.now_ms()).await.unwrap();
        assert!(matches!(enqueued, Enqueued::New(_)));
        new.id
    }

    async fn claim(&self, owner: &str) -> Option<(Id, i64)> {
        let job = self.store.claim(JobsOn::CompleteAcquisitions, owner, self.clock.now_ms(), LEASE_MS).await.unwrap();
        job.map(|job| (job.id, job.lease_token))
    }

    async fn beat(&self, (job, token): (Id, i64)) -> Lease {
        let reached = Reached { stage: "align", done_m: 1.0, total_m: 2.0, metres_per_second: None };
        let beat = Heartbeat { reached: Some(reached), waiting_for: None };
        self.store.heartbeat(job, token, &beat, self.clock.now_ms() + LEASE_MS).await.unwrap()
    }

    async fn state(&self, job: Id) -> String {
        self.store.job(job).await.unwrap().unwrap().state
    }

    async fn models(&self) -> usize {
        self.store.models(None, PageRequest { before: None, limit: 100 }).await.unwrap().items.len()
    }
}

#[tokio::test]
async fn a_job_is_claimed_by_one_only_and_in_order() {
    let queue = Queue::new().await;
    let (first, second) = (queue.enqueue().await, queue.enqueue().await);
    assert_eq!(queue.claim("a").await.unwrap().0, first);
    assert_eq!(queue.claim("b").await.unwrap().0, second);
    assert_eq!(queue.claim("c").await, None);
}

#[tokio::test]
async fn a_zombie_with_an_old_token_can_do_no_harm() {
    let queue = Queue::new().await;
    let job = queue.enqueue().await;
    let zombie = queue.claim("a").await.unwrap();
    queue.clock.advance_ms(LEASE_MS + 1);
    let heir = queue.claim("b").await.unwrap();
    assert_eq!((heir.0, heir.1), (job, zombie.1 + 1));
    let now_ms = queue.clock.now_ms();
    assert_eq!(queue.beat(zombie).await, Lease::Lost);
    assert_eq!(queue.store.settle_trained(job, zombie.1, &model(), now_ms).await.unwrap(), Lease::Lost);
    assert_eq!(queue.store.settle_failed(job, zombie.1, "{}", false, now_ms).await.unwrap(), Lease::Lost);
    assert_eq!(queue.store.settle_cancelled(job, zombie.1, now_ms).await.unwrap(), Lease::Lost);
    assert_eq!(queue.store.hand_back(job, zombie.1).await.unwrap(), Lease::Lost);
    assert_eq!((queue.state(job).await, queue.models().await), ("running".to_owned(), 0));
    assert_eq!(queue.store.settle_trained(job, heir.1, &model(), now_ms).await.unwrap(), Lease::Held);
    assert_eq!(queue.store.settle_trained(job, heir.1, &model(), now_ms).await.unwrap(), Lease::Lost, "settled once");
    assert_eq!((queue.state(job).await, queue.models().await), ("succeeded".to_owned(), 1));
}

#[tokio::test]
async fn heartbeats_keep_a_lease_alive() {
    let queue = Queue::new().await;
    queue.enqueue().await;
    let lease = queue.claim("a").await.unwrap();
    for _ in 0..5 {
        queue.clock.advance_ms(LEASE_MS - 1);
        assert_eq!(queue.beat(lease).await, Lease::Held);
        assert_eq!(queue.claim("b").await, None);
    }
}

#[tokio::test]
async fn a_failed_attempt_waits_before_the_next_and_a_job_is_given_up_in_the_end() {
    let queue = Queue::new().await;
    let job = queue.enqueue().await;
    for attempt in 1..=MAX_ATTEMPTS {
        let (_, token) = queue.claim("a").await.unwrap();
        queue.store.settle_failed(job, token, r#"{"type":"t"}"#, true, queue.clock.now_ms()).await.unwrap();
        assert_eq!(queue.claim("a").await, None, "attempt {attempt} must wait");
        queue.clock.advance_ms(10 * 60_000);
    }
    assert_eq!((queue.state(job).await, queue.claim("a").await), ("failed".to_owned(), None));
}

#[tokio::test]
async fn a_job_that_kills_its_process_every_time_is_given_up() {
    let queue = Queue::new().await;
    let job = queue.enqueue().await;
    for _ in 0..MAX_ATTEMPTS {
        assert!(queue.claim("a").await.is_some());
        queue.clock.advance_ms(LEASE_MS + 1);
    }
    assert_eq!(queue.claim("a").await, None);
    let row = queue.store.job(job).await.unwrap().unwrap();
    assert_eq!(row.state, "failed");
    assert!(row.error.unwrap().contains("job-gave-up"));
}

#[tokio::test]
async fn a_hand_back_does_not_count_as_an_attempt() {
    let queue = Queue::new().await;
    let job = queue.enqueue().await;
    for _ in 0..10 {
        let (_, token) = queue.claim("a").await.unwrap();
        assert_eq!(queue.store.hand_back(job, token).await.unwrap(), Lease::Held);
    }
    assert_eq!(queue.store.job(job).await.unwrap().unwrap().attempts, 0);
}

#[tokio::test]
async fn jobs_of_dead_processes_are_reclaimed_at_once_and_those_of_living_ones_are_not() {
    let queue = Queue::new().await;
    let (first, second) = (queue.enqueue().await, queue.enqueue().await);
    let living = queue.store.folder().register(Uuid::new_v4()).unwrap();
    let dead = Uuid::new_v4().to_string();
    assert_eq!(queue.claim(&living.id.to_string()).await.unwrap().0, first);
    assert_eq!(queue.claim(&dead).await.unwrap().0, second);
    assert_eq!(queue.store.reclaim("me").await.unwrap(), 1);
    assert_eq!((queue.state(first).await.as_str(), queue.state(second).await.as_str()), ("running", "queued"));
    drop(living);
    assert_eq!(queue.store.reclaim("me").await.unwrap(), 1);
}

#[tokio::test]
async fn a_cancelled_job_of_a_dead_worker_is_not_run_again() {
    let queue = Queue::new().await;
    let job = queue.enqueue().await;
    let lease = queue.claim("a").await.unwrap();
    let cancelled = queue.store.cancel(job, queue.clock.now_ms()).await.unwrap();
    assert!(matches!(cancelled, Cancellation::Accepted(_)));
    assert_eq!(queue.beat(lease).await, Lease::CancelRequested);
    queue.clock.advance_ms(LEASE_MS + 1);
    assert_eq!((queue.claim("b").await, queue.state(job).await), (None, "cancelled".to_owned()));
}

#[tokio::test(flavor = "multi_thread")]
async fn many_claimers_of_several_connections_share_the_jobs_without_doubles() {
    let queue = Queue::new().await;
    for _ in 0..40 {
        queue.enqueue().await;
    }
    let mut claimers = Vec::new();
    for n in 0..4 {
        let store = Store::open(queue._data.path()).await.unwrap(); // as another process would
        claimers.push(tokio::spawn(async move {
            let mut mine = Vec::new();
            while let Some(job) =
                store.claim(JobsOn::CompleteAcquisitions, &n.to_string(), 1_000_000, LEASE_MS).await.unwrap()
            {
                mine.push(job.id);
            }
            mine
        }));
    }
    let mut all = Vec::new();
    for claimer in claimers {
        all.extend(claimer.await.unwrap());
    }
    assert_eq!(all.len(), 40);
    all.sort();
    all.dedup();
    assert_eq!(all.len(), 40);
}

/// A live job on an acquisition that is still open.
async fn enqueue_live(queue: &Queue) -> (Id, Id) {
    let complete = queue.store.acquisition(queue.acquisition).await.unwrap().unwrap();
    let new = NewAcquisition {
        id: id(),
        rope_id: complete.row.rope_id,
        line_pitch_mm: 0.1,
        sensor_px: 64,
        rope_width_px: None,
        start_m: 0.0,
        acquired_at_ms: None,
        views: vec![NewView { angle_deg: 0.0, px_per_mm: None, frames: None }],
    };
    queue.store.create_acquisition(&new, 0).await.unwrap();
    let task = Task::Inspect { model_id: None, threshold: None, live: true };
    let job = NewJob { id: id(), acquisition_id: new.id, task, idempotency_key: None };
    assert!(matches!(queue.store.enqueue(&job, queue.clock.now_ms()).await.unwrap(), Enqueued::New(_)));
    (job.id, new.id)
}

impl Queue {
    async fn claim_live(&self, owner: &str) -> Option<(Id, i64)> {
        let job = self.store.claim(JobsOn::OpenAcquisitions, owner, self.clock.now_ms(), LEASE_MS).await.unwrap();
        job.map(|job| (job.id, job.lease_token))
    }
}

#[tokio::test]
async fn jobs_on_open_acquisitions_and_on_complete_ones_are_claimed_apart() {
    let queue = Queue::new().await;
    let (live, _) = enqueue_live(&queue).await;
    let ordinary = queue.enqueue().await;
    assert_eq!(queue.claim("a").await.unwrap().0, ordinary);
    assert_eq!(queue.claim("a").await, None);
    assert_eq!(queue.claim_live("a").await.unwrap().0, live);
    assert_eq!(queue.claim_live("a").await, None);
}

#[tokio::test]
async fn a_job_that_waits_for_days_is_not_given_up_for_the_processes_that_died_meanwhile() {
    let queue = Queue::new().await;
    let (job, _) = enqueue_live(&queue).await;
    for _ in 0..3 * MAX_ATTEMPTS {
        let (_, token) = queue.claim_live("a").await.expect("it is not given up");
        let waiting_for = Some(WaitingFor { view: 0, frame: 7, since_ms: 5 });
        let beat = Heartbeat { reached: None, waiting_for };
        let until_ms = queue.clock.now_ms() + LEASE_MS;
        assert_eq!(queue.store.heartbeat(job, token, &beat, until_ms).await.unwrap(), Lease::Held);
        queue.clock.advance_ms(LEASE_MS + 1);
    }
    assert_eq!(queue.state(job).await, "running");
}

#[tokio::test]
async fn findings_need_the_lease_and_go_with_a_new_claim_and_with_every_end() {
    let queue = Queue::new().await;
    let found = || {
        let alarms = vec![];
        let defect = DefectRow { from_m: 0.1, to_m: 0.2, peak_score: 7.0, alarms, ..DefectRow::default() };
        [Found { lay_lengths: vec![], defects: Some(FoundDefects { from: 0, rows: vec![defect] }) }]
    };
    let told = async |job: Id| queue.store.provisional_defects(job, 0).await.unwrap().defects.len();
    for end in ["cancelled", "failed", "given up"] {
        let (job, _) = enqueue_live(&queue).await;
        let zombie = queue.claim_live("a").await.unwrap();
        assert_eq!(queue.store.keep_provisional(job, zombie.1, &found()).await.unwrap(), Lease::Held);
        assert_eq!(told(job).await, 1);
        queue.clock.advance_ms(LEASE_MS + 1);
        let heir = queue.claim_live("b").await.unwrap();
        assert_eq!(told(job).await, 0, "what an earlier run found holds no more");
        assert_eq!(queue.store.keep_provisional(job, zombie.1, &found()).await.unwrap(), Lease::Lost);
        assert_eq!(queue.store.keep_provisional(job, heir.1, &found()).await.unwrap(), Lease::Held);
        let now_ms = queue.clock.now_ms();
        match end {
            "cancelled" => queue.store.settle_cancelled(job, heir.1, now_ms).await.unwrap(),
            "failed" => queue.store.settle_failed(job, heir.1, "{}", false, now_ms).await.unwrap(),
            _ => {
                for _ in 2..MAX_ATTEMPTS {
                    queue.clock.advance_ms(LEASE_MS + 1);
                    queue.claim_live("c").await.unwrap();
                }
                let token = queue.store.job(job).await.unwrap().unwrap().lease_token;
                queue.store.keep_provisional(job, token, &found()).await.unwrap();
                queue.clock.advance_ms(LEASE_MS + 1);
                assert_eq!(queue.claim_live("d").await, None);
                Lease::Lost
            }
        };
        assert_eq!(told(job).await, 0, "{end}");
        assert_eq!(queue.store.keep_provisional(job, heir.1, &found()).await.unwrap(), Lease::Lost, "{end}");
    }
}
