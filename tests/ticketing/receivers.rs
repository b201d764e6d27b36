//! Receivers that fail, stall, repeat, move away or lie about where they live.

use crate::house::{House, Mood, Receiver, all};
use ropescope::store::deliveries::Redelivery;
use ropescope::ticketing::{guard, schedule};
use std::sync::Arc;

const DAY_MS: i64 = 86_400_000;

#[tokio::test]
async fn retries_carry_the_same_id_a_fresh_timestamp_and_a_signature_that_verifies() {
    let house = House::new().await;
    let receiver = Receiver::start([Mood::Fail(500), Mood::Fail(503)]).await;
    let endpoint = house.endpoint(&receiver.url).await;
    let defect = house.defect(0).await;
    house.confirm(defect).await;
    let mut dispatcher = house.dispatcher();
    assert_eq!(dispatcher.step().await.unwrap(), 1);
    assert_eq!(dispatcher.step().await.unwrap(), 0, "not before its time");
    house.clock.advance_ms(6_001);
    assert_eq!(dispatcher.step().await.unwrap(), 1);
    let received = receiver.take();
    assert_eq!(received.len(), 2);
    assert_eq!(received[0].header("webhook-id"), received[1].header("webhook-id"));
    assert_eq!(received[0].body, received[1].body);
    assert_ne!(received[0].header("webhook-timestamp"), received[1].header("webhook-timestamp"));
    for request in &received {
        standardwebhooks::Webhook::new(&endpoint.secret).unwrap().verify(&request.body, &request.headers).unwrap();
    }
    house.clock.advance_ms(361_000);
    assert_eq!(dispatcher.step().await.unwrap(), 1);
    assert_eq!(house.states().await, ["delivered"]);

    let event = receiver.take()[0].json();
    assert_eq!(event["specversion"], "1.0");
    assert_eq!(event["type"], "org.ropescope.defect.confirmed");
    assert_eq!(event["subject"], format!("defects/{defect}"));
    assert_eq!(event["data"]["strand"], 2);
    assert_eq!(event["data"]["cause"]["by"], "A. Inspector");
    assert_eq!(event["data"]["links"]["ticket"], format!("https://ropes.example/api/v1/defects/{defect}/ticket"));

    let delivery = house.store.deliveries(None, all()).await.unwrap().items.remove(0);
    let log = house.store.attempts(delivery.id).await.unwrap();
    assert_eq!(log.iter().map(|a| a.status).collect::<Vec<_>>(), [Some(500), Some(503), Some(204)]);
    assert_eq!(log[0].error.as_deref(), Some("the receiver answered 500: out of order"));
}

#[tokio::test]
async fn a_receiver_that_stalls_is_given_up_and_holds_up_nobody() {
    let house = House::new().await;
    let (slow, quick) = (Receiver::start([Mood::Stall]).await, Receiver::start([]).await);
    house.endpoint(&slow.url).await;
    house.endpoint(&quick.url).await;
    house.confirm(house.defect(0).await).await;
    let begun = std::time::Instant::now();
    assert_eq!(house.dispatcher().step().await.unwrap(), 2);
    assert!(begun.elapsed().as_secs_f64() < 5.0);
    assert_eq!(quick.take().len(), 1);
    let pending = house.store.deliveries(Some("pending"), all()).await.unwrap().items.remove(0);
    let log = house.store.attempts(pending.id).await.unwrap();
    assert_eq!(log[0].status, None);
    assert!(log[0].error.as_deref().unwrap().starts_with("no answer within"), "{log:?}");
}

#[tokio::test]
async fn retry_after_is_honoured() {
    let house = House::new().await;
    let receiver = Receiver::start([Mood::FailFor(429, "3600")]).await;
    house.endpoint(&receiver.url).await;
    house.confirm(house.defect(0).await).await;
    let mut dispatcher = house.dispatcher();
    dispatcher.step().await.unwrap();
    house.clock.advance_ms(3_500_000);
    assert_eq!(dispatcher.step().await.unwrap(), 0);
    house.clock.advance_ms(200_000);
    assert_eq!(dispatcher.step().await.unwrap(), 1);
}

#[tokio::test]
async fn when_the_schedule_ends_the_delivery_is_dead_and_a_person_may_start_it_again() {
    let house = House::new().await;
    let tries = schedule::WAITS_S.len() + 1;
    let receiver = Receiver::start(vec![Mood::Fail(500); tries]).await;
    house.endpoint(&receiver.url).await;
    house.confirm(house.defect(0).await).await;
    let mut dispatcher = house.dispatcher();
    for _ in 0..tries {
        assert_eq!(dispatcher.step().await.unwrap(), 1);
        house.clock.advance_ms(2 * DAY_MS);
    }
    assert_eq!(dispatcher.step().await.unwrap(), 0);
    assert_eq!(house.states().await, ["dead"]);
    let id = receiver.take()[0].header("webhook-id");
    let dead = house.store.deliveries(Some("dead"), all()).await.unwrap().items.remove(0);
    assert!(matches!(house.store.redeliver(dead.id, 0).await.unwrap(), Redelivery::Queued(_)));
    assert_eq!(dispatcher.step().await.unwrap(), 1);
    assert_eq!(receiver.take()[0].header("webhook-id"), id);
    assert_eq!(house.states().await, ["delivered"]);
    assert_eq!(house.store.attempts(dead.id).await.unwrap().len(), tries + 1, "the log keeps both schedules");
}

#[tokio::test]
async fn gone_switches_the_endpoint_off_until_somebody_switches_it_on() {
    let house = House::new().await;
    let receiver = Receiver::start([Mood::Fail(410)]).await;
    let endpoint = house.endpoint(&receiver.url).await;
    house.confirm(house.defect(0).await).await;
    let mut dispatcher = house.dispatcher();
    dispatcher.step().await.unwrap();
    let held = house.store.endpoint(endpoint.id).await.unwrap().unwrap();
    assert!(!held.enabled);
    assert!(held.disabled_reason.unwrap().contains("410"));
    house.confirm(house.defect(1).await).await;
    assert_eq!(dispatcher.step().await.unwrap(), 0);
    let dead = house.store.deliveries(Some("dead"), all()).await.unwrap().items.remove(0);
    assert_eq!(house.store.redeliver(dead.id, 0).await.unwrap(), Redelivery::EndpointDisabled);
    house.store.enable_endpoint(endpoint.id, true, 0).await.unwrap();
    assert_eq!(dispatcher.step().await.unwrap(), 1, "what was confirmed meanwhile goes out now");
}

#[tokio::test]
async fn redirects_are_not_followed() {
    let house = House::new().await;
    let elsewhere = Receiver::start([]).await;
    let receiver = Receiver::start([Mood::Redirect(elsewhere.url.clone())]).await;
    house.endpoint(&receiver.url).await;
    house.confirm(house.defect(0).await).await;
    house.dispatcher().step().await.unwrap();
    assert!(elsewhere.take().is_empty());
    let pending = house.store.deliveries(Some("pending"), all()).await.unwrap().items.remove(0);
    assert!(house.store.attempts(pending.id).await.unwrap()[0].error.as_deref().unwrap().contains("not followed"));
}

#[tokio::test]
async fn private_addresses_need_an_admins_leave_and_names_are_not_resolved_twice() {
    let house = House::new().await;
    let receiver = Receiver::start([]).await;
    let port: u16 = receiver.url.rsplit(':').next().unwrap().trim_end_matches("/hook").parse().unwrap();
    let url = format!("http://receiver.test:{port}/hook");
    let lookups = Arc::new(std::sync::atomic::AtomicUsize::new(0));
    let counter = Arc::clone(&lookups);
    let resolver: guard::Resolver = Arc::new(move |_, port| {
        counter.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
        Box::pin(async move { Ok(vec![([127, 0, 0, 1], port).into()]) })
    });
    house.endpoint_with(&url, false).await;
    house.endpoint_with(&url, true).await;
    house.confirm(house.defect(0).await).await;
    let mut dispatcher = house.dispatcher_with(|s| s.resolver = Arc::clone(&resolver));
    assert_eq!(dispatcher.step().await.unwrap(), 2);
    assert_eq!(receiver.take().len(), 1, "the name exists in our resolver only, so it was the checked address");
    assert_eq!(lookups.load(std::sync::atomic::Ordering::SeqCst), 2, "one look an attempt");
    let refused = house.store.deliveries(Some("pending"), all()).await.unwrap().items.remove(0);
    let error = house.store.attempts(refused.id).await.unwrap().remove(0).error.unwrap();
    assert_eq!(
        error,
        "receiver.test is 127.0.0.1, which is not a public address: an admin may set allow_private on the endpoint"
    );
}
