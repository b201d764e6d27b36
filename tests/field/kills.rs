//! Service and client killed without warning at random moments.

use crate::process::{PROGRAM, Process, token};
use crate::recording::{
    SENSOR_PX, assert_stored, frame_path, get, post, put_frame, recording, repeated_frames, write_frame,
};
use crate::uploader::{Uploader, free_port};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const WITHIN: Duration = Duration::from_secs(300);

/// The one acquisition of a service, if it has one.
fn acquisition(server: &Process, token: &str) -> Option<serde_json::Value> {
    get(&server.base, token, "acquisitions")["items"].as_array().unwrap().first().cloned()
}

/// What lies in a folder.
fn below(folder: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect()
}

/// Files of frames below a data folder.
fn files(data: &Path) -> usize {
    below(&data.join("frames")).iter().flat_map(|a| below(a)).map(|view| below(&view).len()).sum()
}

fn kill_the_service(kills: usize, frames_a_view: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    recording(source.path(), frames_a_view, 60);
    let token = token(data.path());
    let port = free_port();
    let mut server = Process::serve(data.path(), port, &[]);
    let base = server.base.clone();
    let start = |more: &[&str]| Uploader::start(source.path(), &base, &token, more);
    let mut uploader = start(&["--limit-mbit", "4"]);
    for kill in 0..kills {
        std::thread::sleep(Duration::from_millis(rng.random_range(20..400)));
        server.kill();
        let acknowledged = uploader.held();
        let half_done = below(&data.path().join("uploads"));
        server = Process::serve(data.path(), port, &[]);
        // The client goes on at once, so new ones may be there already.
        assert!(half_done.iter().all(|file| !file.exists()), "kill {kill}: {half_done:?}");
        let present = acquisition(&server, &token).map_or(0, |a| a["frames_present"].as_u64().unwrap());
        assert!(present >= acknowledged, "kill {kill}: {acknowledged} frames were acknowledged, {present} are there");
        if !uploader.running() {
            uploader.report(WITHIN); // it was complete: go on with completions that are repeated
            uploader = start(&[]);
        }
    }
    uploader.report(WITHIN);
    let id = acquisition(&server, &token).unwrap()["id"].as_str().unwrap().to_owned();
    assert_stored(data.path(), &id, source.path(), frames_a_view);
    assert_eq!(files(data.path()), 2 * frames_a_view, "no file without owner");
}

#[test]
fn what_a_killed_service_had_acknowledged_is_there_and_the_upload_goes_on() {
    kill_the_service(6, 120);
}

#[test]
#[ignore = "the full figures: takes minutes"]
fn full_what_a_service_killed_50_times_had_acknowledged_is_there() {
    kill_the_service(50, 900);
}

/// Completes an acquisition and begins its receipt, in a thread that tells when it begins. Answers the status of the completion, if
/// there was an answer, and how long it took.
fn complete(base: &str, token: &str, id: &str) -> (mpsc::Receiver<()>, JoinHandle<(Option<u16>, Duration)>) {
    ropescope::tls::install();
    let (token, urls) =
        (token.to_owned(), ["completion", "receipt"].map(|what| format!("{base}/api/v1/acquisitions/{id}/{what}")));
    let (begins, begun) = mpsc::channel();
    let thread = std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let client = reqwest::Client::builder().no_proxy().build().unwrap();
            let post = async |url: &String| client.post(url).bearer_auth(&token).json(&json!({})).send().await.ok();
            begins.send(()).unwrap();
            let begun = Instant::now();
            let status = post(&urls[0]).await.map(|answer| answer.status().as_u16());
            let took = begun.elapsed();
            post(&urls[1]).await;
            (status, took)
        })
    });
    (begun, thread)
}

/// Kills the service while it completes acquisitions, one after the other, and reads their frames back for receipts.
fn kill_completions(kills: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(14);
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    recording(source.path(), 1, 60);
    let token = token(data.path());
    let port = free_port();
    let mut server = Process::serve(data.path(), port, &[]);
    let first = Uploader::start(source.path(), &server.base, &token, &[]).report(WITHIN);
    let whole_but_open = |server: &Process| {
        let views = json!([{"angle_deg": 0, "frames": 1}, {"angle_deg": 90, "frames": 1}]);
        let body = json!({"rope_id": first["rope_id"], "line_pitch_mm": 0.1, "sensor_px": SENSOR_PX, "views": views});
        let id = post(&server.base, &token, "acquisitions", &body)["id"].as_str().unwrap().to_owned();
        for view in 0..2 {
            put_frame(&server.base, &token, &id, view, &std::fs::read(frame_path(source.path(), view, 0)).unwrap());
        }
        id
    };
    let (_begun, undisturbed) = complete(&server.base, &token, &whole_but_open(&server));
    let (_, usual) = undisturbed.join().unwrap();
    let (mut acknowledged, mut open) = (0, 0);
    for kill in 0..kills {
        let id = whole_but_open(&server);
        let (begun, answer) = complete(&server.base, &token, &id);
        begun.recv().unwrap();
        // Evenly over three times as long as it takes: before, during, and while frames are read back.
        std::thread::sleep(usual.mul_f64(3.0 * (kill as f64 + rng.random::<f64>()) / kills as f64));
        server.kill();
        let (answer, _) = answer.join().unwrap();
        server = Process::serve(data.path(), port, &[]);
        let after = get(&server.base, &token, &format!("acquisitions/{id}"));
        assert_eq!(after["frames_present"], 2, "kill {kill}");
        match answer {
            Some(status) => {
                assert_eq!((status, &after["state"]), (200, &json!("complete")), "kill {kill}: it was acknowledged");
                acknowledged += 1;
            }
            None => open += usize::from(after["state"] == "open"),
        }
        for _ in 0..2 {
            let again = post(&server.base, &token, &format!("acquisitions/{id}/completion"), &json!({}));
            assert_eq!(again["state"], "complete", "kill {kill}");
        }
        let begun = Instant::now();
        while post(&server.base, &token, &format!("acquisitions/{id}/receipt"), &json!({})).get("signature").is_none() {
            assert!(begun.elapsed() < WITHIN, "kill {kill}: no receipt");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    println!("{kills} kills: {acknowledged} completions were acknowledged before, {open} had not happened");
    assert!(acknowledged > 0, "no kill came after an acknowledgement, of {kills}");
    assert_eq!(files(data.path()), 2 * (kills + 2), "no file without owner");
}

#[test]
fn a_completion_that_a_killed_service_had_acknowledged_holds_and_any_other_can_be_repeated() {
    kill_completions(8);
}

#[test]
#[ignore = "the full figures"]
fn full_completions_of_a_service_killed_50_times_hold_or_can_be_repeated() {
    kill_completions(50);
}

/// Kills the service while it works on jobs; every job ends with one inspection.
#[test]
#[ignore = "the full figures: takes minutes"]
fn full_no_job_is_lost_or_doubled_when_its_service_is_killed() {
    const JOBS: usize = 25;
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let simulate = ["simulate", "--metres", "1", "--views", "1", "--seed", "3", "--out"];
    let rope = source.path().join("rope");
    assert!(Command::new(PROGRAM).args(simulate).arg(&rope).output().unwrap().status.success());
    let token = token(data.path());
    let port = free_port();
    let mut server = Process::serve(data.path(), port, &[]);
    let uploaded = Uploader::start(&rope, &server.base, &token, &[]).report(WITHIN);
    let job = json!({"kind": "inspect", "acquisition_id": uploaded["acquisition_id"]});
    for number in 0..JOBS {
        let id = post(&server.base, &token, "jobs", &job)["id"].as_str().unwrap().to_owned();
        for _ in 0..2 {
            std::thread::sleep(Duration::from_millis(rng.random_range(0..1500)));
            server.kill();
            server = Process::serve(data.path(), port, &[]);
        }
        let begun = Instant::now();
        let ended = loop {
            let job = get(&server.base, &token, &format!("jobs/{id}"));
            if !["queued", "running"].contains(&job["state"].as_str().unwrap()) {
                break job;
            }
            assert!(begun.elapsed() < WITHIN, "{job}");
            std::thread::sleep(Duration::from_millis(100));
        };
        assert_eq!(ended["state"], "succeeded", "{ended}");
        let inspections = get(&server.base, &token, "inspections?limit=200")["items"].as_array().unwrap().len();
        let folders = std::fs::read_dir(data.path().join("inspections")).unwrap().count();
        assert_eq!(
            (inspections, folders),
            (number + 1, number + 1),
            "one inspection a job, and no folder without owner"
        );
    }
    assert_eq!(std::fs::read_dir(data.path().join("work")).unwrap().count(), 0);
}

/// A frame that the service has whole is stored within this time, also on a busy machine.
const SETTLING: Duration = Duration::from_millis(300);

fn kill_the_client(kills: usize, frames_a_view: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    recording(source.path(), frames_a_view, 60);
    let token = token(data.path());
    let server = Process::serve(data.path(), free_port(), &[]);
    let start = || Uploader::start(source.path(), &server.base, &token, &["--limit-mbit", "8"]);
    for _ in 0..kills {
        let mut uploader = start();
        std::thread::sleep(Duration::from_millis(rng.random_range(20..500)));
        uploader.kill();
        let acknowledged = uploader.held();
        let present = || acquisition(&server, &token).map_or(0, |a| a["frames_present"].as_u64().unwrap());
        let mut held = present();
        assert!(held >= acknowledged, "{acknowledged} frames were acknowledged, {held} are there");
        // A frame that arrived whole just before the kill may still be on its way to the disk: nobody could know of it yet, and sending
        // it again would be no fault.
        loop {
            std::thread::sleep(SETTLING);
            let now = present();
            if std::mem::replace(&mut held, now) == now {
                break;
            }
        }
    }
    let report = start().report(WITHIN);
    assert_eq!(repeated_frames(&server.base, &token), 0, "frames were sent again that the service held");
    assert_stored(data.path(), report["acquisition_id"].as_str().unwrap(), source.path(), frames_a_view);
}

#[test]
fn a_killed_client_resumes_and_sends_nothing_again_that_was_acknowledged() {
    kill_the_client(6, 100);
}

#[test]
#[ignore = "the full figures: takes minutes"]
fn full_a_client_killed_50_times_sends_nothing_again_that_was_acknowledged() {
    kill_the_client(50, 600);
}

#[test]
fn a_receipt_says_that_these_originals_may_be_deleted_and_no_others() {
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    recording(source.path(), 5, 60);
    let token = token(data.path());
    let server = Process::serve(data.path(), free_port(), &[]);
    let receipt = source.path().join("receipt.json");
    let uploaded =
        Uploader::start(source.path(), &server.base, &token, &["--receipt", receipt.to_str().unwrap()]).report(WITHIN);
    let verify = |more: &[&str]| {
        let folder = source.path().to_str().unwrap();
        let all = [&["verify-receipt", receipt.to_str().unwrap(), "--folder", folder], more].concat();
        Command::new(PROGRAM).args(all).output().unwrap()
    };
    let key = get(&server.base, &token, "signing-key")["x"].as_str().unwrap().to_owned();
    let good = verify(&["--key", &key]);
    let said = String::from_utf8([good.stdout, good.stderr].concat()).unwrap();
    assert!(good.status.success() && said.contains(uploaded["acquisition_id"].as_str().unwrap()), "{said}");
    write_frame(source.path(), 1, 3, 61);
    let other = verify(&[]);
    assert_eq!(other.status.code(), Some(1));
    assert!(String::from_utf8(other.stderr).unwrap().contains("keep the originals"));
}

#[test]
fn two_clients_that_send_one_acquisition_make_one_set_of_frames() {
    let (data, source) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    recording(source.path(), 60, 100);
    let token = token(data.path());
    let server = Process::serve(data.path(), free_port(), &[]);
    let mut both = [0; 2].map(|_| Uploader::start(source.path(), &server.base, &token, &["--limit-mbit", "16"]));
    let reports = both.each_mut().map(|uploader| uploader.report(WITHIN));
    assert_eq!(reports[0]["acquisition_id"], reports[1]["acquisition_id"]);
    assert_stored(data.path(), reports[0]["acquisition_id"].as_str().unwrap(), source.path(), 60);
}
