//! Completion: the acquisition has every frame that was announced, and takes no others.

use super::acquisitions::load;
use super::missing::{MissingFrames, missing};
use super::preview_removal::drop_previews;
use super::{Id, Store, StoreError};

/// What came of the wish to complete an acquisition.
#[derive(Debug, Clone, PartialEq)]
pub enum Completion {
    /// It is complete, now or since an earlier call.
    Complete,
    /// Frames are missing; nothing was changed.
    Missing(Vec<MissingFrames>),
    /// The number of frames contradicts the one announced, or one more frame is there; nothing was changed.
    Contradiction {
        /// The view.
        view: u32,
        /// What the completion says.
        frames: u32,
        /// What was announced, or is there.
        known: u32,
    },
    /// The completion names another number of views than the acquisition has.
    Views {
        /// Views of the acquisition.
        views: usize,
    },
    /// There is no such acquisition.
    Unknown,
}

impl Store {
    /// Closes the acquisition if every view has all its frames. `frames[view]` says how many there are where that was not
    /// announced before. Previews go.
    pub async fn complete_acquisition(
        &self,
        id: Id,
        frames: Option<&[u32]>,
        now_ms: i64,
    ) -> Result<Completion, StoreError> {
        let mut tx = self.write().await?;
        let Some(acquisition) = load(&mut tx, id).await? else { return Ok(Completion::Unknown) };
        let mut views = acquisition.views.clone();
        if let Some(frames) = frames {
            if frames.len() != views.len() {
                return Ok(Completion::Views { views: views.len() });
            }
            for (view, &frames) in views.iter_mut().zip(frames) {
                let known = view.frames_expected.unwrap_or(frames);
                if known != frames {
                    return Ok(Completion::Contradiction { view: view.view, frames, known });
                }
                view.frames_expected = Some(frames);
            }
        }
        let missing = missing(&mut tx, &acquisition.row, &views).await?;
        if let Some(view) = missing.iter().find(|v| v.expected.is_some_and(|expected| v.present > expected)) {
            let frames = view.expected.unwrap_or_default();
            return Ok(Completion::Contradiction { view: view.view, frames, known: view.present });
        }
        if !missing.iter().all(MissingFrames::whole) {
            return Ok(Completion::Missing(missing));
        }
        for view in &views {
            sqlx::query("update view set frames_expected = $3 where acquisition_id = $1 and view = $2")
                .bind(id)
                .bind(view.view)
                .bind(view.frames_expected)
                .execute(&mut *tx)
                .await?;
        }
        sqlx::query("update acquisition set state = 'complete' where id = $1").bind(id).execute(&mut *tx).await?;
        drop_previews(&mut tx, id, now_ms).await?;
        tx.commit().await?;
        self.arrivals.send_replace(());
        self.remove_preview_files(id).await?;
        Ok(Completion::Complete)
    }
}
