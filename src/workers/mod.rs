//! Workers: claim a job, run it, settle it.

use crate::app::App;
use tokio_util::task::TaskTracker;

/// The workers of a process.
pub struct Workers {
    app: App,
    owner: String,
}

impl Workers {
    /// Workers that sign their leases with `owner`, the instance of this process.
    pub fn new(app: App, owner: &str) -> Self {
        Self { app, owner: owner.to_owned() }
    }

    /// Starts as many as the settings say.
    pub fn spawn(self, _tasks: &TaskTracker) {
        let _ = (self.app, self.owner);
    }
}
