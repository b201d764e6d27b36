//! Uploads a recording while it is being made.

use super::client::Client;
use super::plan::{Names, Plan, PlannedFrame};
use super::progress::Tick;
use super::transfer::{Options, Report, Transfer};
use super::upload_error::UploadError;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Time between two looks at the folder.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// When a recording counts as whole.
#[derive(Debug, Clone, Copy)]
pub struct Watching {
    /// The last frame of a view is whole when its file has not changed for so long; every other is whole when its successor exists.
    pub frame_rests: Duration,
    /// The recording has ended when nothing was added for so long.
    pub recording_rests: Duration,
}

/// Uploads `folder` while it grows; completes it when it has rested.
pub async fn watch<F: Fn(&Tick)>(
    client: &Client,
    folder: &Path,
    names: &Names,
    options: &Options,
    watching: Watching,
    on_tick: F,
) -> Result<Report, UploadError> {
    let mut quiet = Quiet::default();
    let (plan, begin) = loop {
        let plan = quiet.whole_frames(Plan::read_growing(folder, names)?, watching.frame_rests);
        if let Some(begin) = plan.begin()? {
            break (plan, begin);
        }
        tokio::time::sleep(LOOK_EVERY).await;
    };
    let mut transfer = Transfer::begin(client, &plan, &begin, options, on_tick).await?;
    loop {
        let plan = quiet.whole_frames(Plan::read_growing(folder, names)?, watching.frame_rests);
        transfer.announce_new(&plan).await?;
        let all_sent = transfer.send_some().await?;
        if quiet.since.elapsed() >= watching.recording_rests {
            // Now every frame counts, and a gap is an error.
            let whole = Plan::read(folder, names)?;
            transfer.ends_with(&whole).await?;
            transfer.bring(&whole).await?;
            return transfer.complete(&whole).await;
        }
        if all_sent {
            transfer.rest();
            tokio::time::sleep(LOOK_EVERY).await;
        }
    }
}

/// Remembers since when files rest.
struct Quiet {
    files: HashMap<PathBuf, (PlannedFrame, Instant)>,
    frames: usize,
    since: Instant,
}

impl Default for Quiet {
    fn default() -> Self {
        Self { files: HashMap::new(), frames: 0, since: Instant::now() }
    }
}

impl Quiet {
    /// The plan without frames that are perhaps still being written.
    fn whole_frames(&mut self, mut plan: Plan, frame_rests: Duration) -> Plan {
        let now = Instant::now();
        if plan.frame_count() != self.frames {
            (self.frames, self.since) = (plan.frame_count(), now);
        }
        let mut last_files = HashMap::new();
        for view in &mut plan.frames {
            let Some(last) = view.last().cloned() else { continue };
            let since = match self.files.get(&last.path) {
                Some((known, since)) if *known == last => *since,
                _ => now,
            };
            if now.duration_since(since) < frame_rests {
                view.pop();
                self.since = self.since.max(since);
            }
            last_files.insert(last.path.clone(), (last, since));
        }
        self.files = last_files;
        plan
    }
}
