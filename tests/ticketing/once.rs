//! Exactly one event a defect.

use crate::house::{House, Receiver, all};
use ropescope::clock::Clock;
use ropescope::store::defects::Judged;
use std::sync::Arc;

#[tokio::test]
async fn confirmed_by_many_at_once_a_defect_is_sent_once() {
    let house = Arc::new(House::new().await);
    let receiver = Receiver::start([]).await;
    house.endpoint(&receiver.url).await;
    let defect = house.defect(0).await;
    let confirmations: Vec<_> = (0..16)
        .map(|_| {
            let house = Arc::clone(&house);
            tokio::spawn(async move { house.confirm(defect).await })
        })
        .collect();
    for confirmation in confirmations {
        assert!(matches!(confirmation.await.unwrap(), Judged::Accepted(_)));
    }
    let mut one = house.dispatcher();
    let mut other = house.dispatcher();
    let (a, b) = tokio::join!(one.step(), other.step());
    assert_eq!(a.unwrap() + b.unwrap(), 1);
    assert_eq!(one.step().await.unwrap(), 0);
    assert_eq!(receiver.take().len(), 1);
    assert_eq!(house.states().await, ["delivered"]);
}

#[tokio::test]
async fn every_enabled_endpoint_gets_its_own_delivery() {
    let house = House::new().await;
    let (first, second) = (Receiver::start([]).await, Receiver::start([]).await);
    house.endpoint(&first.url).await;
    house.endpoint(&second.url).await;
    house.confirm(house.defect(0).await).await;
    house.dispatcher().step().await.unwrap();
    let (first, second) = (first.take(), second.take());
    assert_eq!((first.len(), second.len()), (1, 1));
    assert_eq!(first[0].header("webhook-id"), second[0].header("webhook-id"));
}

#[tokio::test]
async fn a_defect_confirmed_before_anybody_listens_reaches_the_first_listener() {
    let house = House::new().await;
    house.confirm(house.defect(0).await).await;
    assert_eq!(house.dispatcher().step().await.unwrap(), 0);
    let receiver = Receiver::start([]).await;
    house.endpoint(&receiver.url).await;
    house.dispatcher().step().await.unwrap();
    assert_eq!(receiver.take().len(), 1);
    let latecomer = Receiver::start([]).await;
    house.endpoint(&latecomer.url).await;
    house.dispatcher().step().await.unwrap();
    assert!(latecomer.take().is_empty(), "old tickets must not be opened again");
}

#[tokio::test]
async fn a_verdict_that_is_rolled_back_sends_nothing() {
    let house = House::new().await;
    let receiver = Receiver::start([]).await;
    house.endpoint(&receiver.url).await;
    let facts = ropescope::store::outbox::DefectFacts {
        defect_id: house.defect(0).await.0,
        inspection_id: house.inspection.0,
        rope_id: uuid::Uuid::from_u128(2),
        rope: "track rope 1".into(),
        ropeway: "North".into(),
        from_m: 1.0,
        to_m: 1.1,
        strand: None,
        wire: None,
        peak_score: 8.5,
        view: 0,
        cause: ropescope::store::outbox::Cause::Level { ticket_level: 8.0 },
    };
    let mut tx = house.store.write().await.unwrap();
    assert!(ropescope::store::outbox::enqueue_defect(&mut tx, &facts, 0).await.unwrap());
    assert!(!ropescope::store::outbox::enqueue_defect(&mut tx, &facts, 0).await.unwrap(), "the second is the first");
    tx.rollback().await.unwrap();
    house.dispatcher().step().await.unwrap();
    assert!(receiver.take().is_empty());
}

#[tokio::test]
async fn what_was_queued_or_under_way_when_the_process_died_is_sent_afterwards() {
    let house = House::new().await;
    let receiver = Receiver::start([]).await;
    house.endpoint(&receiver.url).await;
    house.confirm(house.defect(0).await).await;
    house.confirm(house.defect(1).await).await;
    // One delivery was claimed by a process that then died.
    let claimed = house.store.claim_deliveries(house.clock.now_ms(), 1, 1).await.unwrap();
    assert_eq!(claimed.len(), 1);
    let house = house.reopened().await;
    assert_eq!(house.dispatcher().step().await.unwrap(), 1, "the other one is free at once");
    house.clock.advance_ms(ropescope::store::deliveries::LEASE_MS + 1000);
    assert_eq!(house.dispatcher().step().await.unwrap(), 1, "the lease has ended");
    assert_eq!(receiver.take().len(), 2);
    // The dead process comes back to life: too late.
    let attempt = ropescope::store::deliveries::Attempt {
        number: 0,
        started_at_ms: 0,
        duration_ms: 1,
        status: Some(500),
        error: Some("late".into()),
    };
    let late = ropescope::store::deliveries::Settlement::Dead;
    assert!(!house.store.settle_delivery(&claimed[0], &attempt, &late, 0).await.unwrap());
    assert_eq!(house.states().await, ["delivered", "delivered"]);
    assert_eq!(house.store.deliveries(Some("dead"), all()).await.unwrap().items, []);
}
