//! One upload over a link that is thin and far, and whose connections are cut, reset and stalled.

use crate::process::{Process, token};
use crate::proxy::{Link, Proxy, Trouble};
use crate::recording::{assert_stored, bytes, get, recording, repeated_frames};
use crate::uploader::{Uploader, free_port};
use std::time::Duration;

/// 20 Mbit/s.
const BYTES_PER_SECOND: f64 = 20e6 / 8.0;

struct Figures {
    frames_a_view: usize,
    lines: u32,
    delay: Duration,
    /// Of each kind.
    troubles: usize,
    silence_s: u64,
    within: Duration,
}

fn troubled_upload(figures: &Figures) {
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    recording(source.path(), figures.frames_a_view, figures.lines);
    let all = bytes(source.path(), figures.frames_a_view);
    let token = token(data.path());
    let server = Process::serve(data.path(), free_port(), &[]);
    let link = Link { bytes_per_second: BYTES_PER_SECOND, delay: figures.delay };
    let mut proxy = Proxy::start(&server.base, link, 7);
    let silence = figures.silence_s.to_string();
    let mut uploader = Uploader::start(source.path(), &proxy.url, &token, &["--silence-s", &silence]);
    // Troubles are spread over the bytes, so that they all fall into the upload.
    let kinds = [Trouble::Cut, Trouble::Stall, Trouble::Reset];
    let count = figures.troubles * kinds.len();
    let begun = std::time::Instant::now();
    let mut struck = 0;
    while struck < count {
        assert!(
            uploader.running() && begun.elapsed() < figures.within,
            "{struck} troubles, {:?}",
            uploader.said().last()
        );
        let due = all * (struck as u64 + 1) / (count as u64 + 2);
        if proxy.up_bytes() >= due && proxy.strike(kinds[struck % kinds.len()]) {
            struck += 1;
        }
        std::thread::sleep(Duration::from_millis(3));
    }
    let report = uploader.report(figures.within);
    assert_eq!(report["frames"], 2 * figures.frames_a_view);
    let id = report["acquisition_id"].as_str().unwrap();
    assert_stored(data.path(), id, source.path(), figures.frames_a_view);
    assert_eq!(get(&server.base, &token, &format!("acquisitions/{id}"))["state"], "complete");
    // Manifests and headers are small beside the frames; what was sent twice is the rest.
    let sent = proxy.up_bytes();
    let twice = sent.saturating_sub(all) as f64 / all as f64;
    println!(
        "{sent} bytes sent for {all}: {:.1} % more; {:.0} s, {struck} troubles",
        twice * 100.0,
        begun.elapsed().as_secs_f64()
    );
    assert!(twice <= 0.10, "{sent} bytes were sent for {all}");
    let given_up = format!("silent for {silence} s");
    let waits: Vec<_> = uploader.said().iter().filter(|l| l["event"] == "waiting").cloned().collect();
    assert!(waits.iter().any(|l| l["reason"].as_str().unwrap().contains(&given_up)), "{waits:?}");
    // A frame comes again only when its answer was lost.
    let repeated = repeated_frames(&server.base, &token);
    assert!(repeated <= count as u64, "{repeated} frames came again, but only {count} answers can have been lost");
}

#[test]
fn an_upload_ends_complete_over_a_link_that_is_cut_reset_and_stalled() {
    troubled_upload(&Figures {
        frames_a_view: 150,
        lines: 150,
        delay: Duration::from_millis(30),
        troubles: 5,
        silence_s: 1,
        within: Duration::from_secs(120),
    });
}

#[test]
#[ignore = "the full figures: takes ten minutes"]
fn full_an_upload_of_1000_frames_ends_complete_over_20_mbit_with_300_ms_and_150_troubles() {
    troubled_upload(&Figures {
        frames_a_view: 500,
        lines: 1600,
        delay: Duration::from_millis(150),
        troubles: 50,
        silence_s: 20,
        within: Duration::from_secs(1500),
    });
}
