//! Runs one claimed job from its frames to its settled result.

use super::arriving::ArrivingFrames;
use super::engine::Engine;
use super::failure::Failure;
use super::preview;
use super::results_folder;
use super::watch::{Stop, Watch};
use crate::app::App;
use crate::pipeline::results::{LineScoreFormat, Summary, Threshold};
use crate::pipeline::{self, FrameFiles, FrameSource, InspectOptions, PipelineError, TrainingRange};
use crate::store::acquisitions::Acquisition;
use crate::store::enqueue::FurtherRange;
use crate::store::inspections::NewInspection;
use crate::store::jobs::Job;
use crate::store::leases::Lease;
use crate::store::model_thresholds::ModelThreshold;
use crate::store::models::NewModel;
use crate::store::previewed::Suspicion;
use crate::store::{Id, StoreError, digest, folder};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::runtime::Handle;

/// How an attempt ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Ended {
    /// With a result.
    Succeeded,
    /// As somebody wished.
    Cancelled,
    /// Unfinished, because the process goes down; it is queued again.
    HandedBack,
    /// With an error; perhaps to be tried again.
    Failed,
    /// Somebody else has the job; nothing was recorded.
    LeaseLost,
}

/// What the CPU works on, gathered beforehand.
struct Input {
    acquisition: pipeline::Acquisition,
    frames: Box<dyn FrameSource>,
    model_path: Option<PathBuf>,
    /// What somebody set for the model, if that holds for the job.
    threshold: Option<ModelThreshold>,
    /// Of a training.
    further: Vec<Further>,
}

/// Rope that a training learns from besides its acquisition.
struct Further {
    range: FurtherRange,
    name: String,
    acquisition: pipeline::Acquisition,
    frames: FrameFiles,
}

impl Input {
    /// All that a training learns from, as the pipeline takes it.
    fn training_ranges<'a>(&'a self, job: &Job, name: &'a str) -> Vec<TrainingRange<'a>> {
        let (acquisition, source) = (&self.acquisition, &*self.frames);
        let first = TrainingRange { name, acquisition, source, from_m: job.from_m, to_m: job.to_m };
        let further = self.further.iter().map(|f| TrainingRange {
            name: &f.name,
            acquisition: &f.acquisition,
            source: &f.frames,
            from_m: f.range.from_m,
            to_m: f.range.to_m,
        });
        std::iter::once(first).chain(further).collect()
    }
}

/// What the CPU made, in place and durable, not yet recorded.
enum Output {
    Model {
        model: NewModel,
        path: PathBuf,
    },
    Inspection {
        inspection: Box<NewInspection>,
        path: PathBuf,
    },
    /// Which frames are wanted first: nothing that lasts.
    Previewed(Vec<Suspicion>),
}

/// Why an attempt has no output.
enum NoOutput {
    Stopped,
    Failed(Failure),
}

impl From<StoreError> for NoOutput {
    fn from(error: StoreError) -> Self {
        Self::Failed(Failure::of_store(&error))
    }
}

/// Runs a job that was just claimed and settles it.
pub async fn run(app: &App, engine: &Arc<dyn Engine>, job: &Job) -> Result<Ended, StoreError> {
    let watch = Watch::new(app, job);
    let beat = watch.beat();
    let attempt = match beat {
        Ok(_) => attempt(app, engine, job, &watch).await,
        Err(ref error) => Err(NoOutput::Failed(Failure::new("internal", "The service failed", error, true))),
    };
    let now_ms = app.now_ms();
    let (id, token) = (job.id, job.lease_token);
    let (lease, ended) = match attempt {
        Ok(output) => (settle(app, job, output).await?, Ended::Succeeded),
        Err(NoOutput::Stopped) => match watch.stopped() {
            Stop::LeaseLost => (Lease::Lost, Ended::LeaseLost),
            Stop::Cancelled => (app.store.settle_cancelled(id, token, now_ms).await?, Ended::Cancelled),
            Stop::Shutdown => (app.store.hand_back(id, token).await?, Ended::HandedBack),
            Stop::No => {
                let failure = Failure::of_pipeline(&PipelineError::Cancelled, Path::new(""));
                (app.store.settle_failed(id, token, &failure.problem, false, now_ms).await?, Ended::Failed)
            }
        },
        Err(NoOutput::Failed(failure)) => {
            tracing::warn!(job = %id, problem = failure.problem, retry = failure.retry, "an attempt failed");
            (app.store.settle_failed(id, token, &failure.problem, failure.retry, now_ms).await?, Ended::Failed)
        }
    };
    drop(beat);
    let work = work_path(app, job);
    crate::store::frames::run_blocking(move || folder::remove(&work)).await?;
    Ok(if lease == Lease::Lost { Ended::LeaseLost } else { ended })
}

/// Where an attempt writes. The token in the name keeps a zombie from writing into its successor's files.
fn work_path(app: &App, job: &Job) -> PathBuf {
    app.store.folder().work().join(format!("{}-{}", job.id, job.lease_token))
}

async fn attempt(app: &App, engine: &Arc<dyn Engine>, job: &Job, watch: &Arc<Watch>) -> Result<Output, NoOutput> {
    let input = gather(app, job, watch).await?;
    let (app_, engine, job_, watch_) = (app.clone(), engine.clone(), job.clone(), watch.clone());
    let mut cpu = tokio::task::spawn_blocking(move || compute(&app_, &*engine, &job_, &input, &watch_));
    let done = tokio::select! {
        done = &mut cpu => done,
        () = app.shutdown.cancelled() => {
            watch.stop(Stop::Shutdown);
            cpu.await // it looks once a frame
        }
    };
    done.unwrap_or_else(|error| {
        tracing::error!(job = %job.id, %error, "a job panicked");
        Err(NoOutput::Failed(Failure::new(
            "job-crashed",
            "The job crashed",
            "the cause is in the log of the service",
            true,
        )))
    })
}

async fn gather(app: &App, job: &Job, watch: &Arc<Watch>) -> Result<Input, NoOutput> {
    let gone = |what: &str| {
        NoOutput::Failed(Failure::new("gone", "The job has lost its input", format!("the {what} is gone"), false))
    };
    let acquisition = app.store.acquisition(job.acquisition_id).await?.ok_or_else(|| gone("acquisition"))?;
    let rope = app.store.rope(job.rope_id).await?.ok_or_else(|| gone("rope"))?;
    let checked = |acquisition: &Acquisition| {
        acquisition.rope_file(&rope.design).validate().map_err(|error| {
            NoOutput::Failed(Failure::of_pipeline(&PipelineError::Acquisition(error), &app.settings.data))
        })
    };
    let mut further = Vec::new();
    for range in job.further()? {
        let id = range.acquisition_id;
        let acquisition = app.store.acquisition(id).await?.ok_or_else(|| gone("acquisition"))?;
        let frames = app.store.frame_files(&acquisition).await?;
        further.push(Further { range, name: id.to_string(), acquisition: checked(&acquisition)?, frames });
    }
    let checked = checked(&acquisition)?;
    let threshold = match (job.model_id, job.threshold_version) {
        (Some(model), Some(version)) => app.store.model_threshold(model, version).await?,
        _ => None,
    };
    let frames: Box<dyn FrameSource> = if job.preview {
        Box::new(ArrivingFrames::previews(app, &acquisition, job, watch).await?)
    } else if acquisition.complete() {
        Box::new(app.store.frame_files(&acquisition).await?)
    } else {
        Box::new(ArrivingFrames::new(app, &acquisition, job, watch).await?)
    };
    Ok(Input {
        threshold,
        further,
        frames,
        acquisition: checked,
        model_path: job.model_id.map(|model| app.store.folder().model(model)),
    })
}

fn compute(app: &App, engine: &dyn Engine, job: &Job, input: &Input, watch: &Watch) -> Result<Output, NoOutput> {
    let work = work_path(app, job);
    folder::remove(&work)?;
    let pipeline = |error: PipelineError| match error {
        PipelineError::Cancelled => NoOutput::Stopped,
        error => NoOutput::Failed(Failure::of_pipeline(&error, &app.settings.data)),
    };
    if job.preview {
        let run = preview::Run { engine, acquisition: &input.acquisition, frames: &*input.frames, work: &work, watch };
        let seen = run.look().map_err(pipeline)?;
        let previews = Handle::current().block_on(app.store.previews(job.acquisition_id))?;
        return Ok(Output::Previewed(seen.suspicions(&previews)));
    }
    let id = app.new_id();
    if job.kind == "train" {
        let name = job.acquisition_id.to_string();
        let ranges = input.training_ranges(job, &name);
        let report = engine.train(&ranges, job.options()?, &work, watch).map_err(pipeline)?;
        let sha256 = digest::of_file(&work)?;
        let bytes = folder::length(&work)? as i64;
        let report = serde_json::to_string(&report).map_err(|e| NoOutput::Failed(Failure::of_results(e)))?;
        let path = app.store.folder().model(id);
        folder::sync_tree(&work)?;
        folder::move_durably(&work, &path)?;
        return Ok(Output::Model { model: NewModel { id, report, sha256, bytes }, path });
    }
    let options = InspectOptions {
        model_path: input.model_path.clone(),
        maps: input.model_path.is_some(),
        threshold: job.threshold.map(Threshold::by_hand).or(input.threshold.as_ref().map(ModelThreshold::decides)),
        line_scores: LineScoreFormat::Binary,
        given_contours: None,
    };
    let summary = engine.inspect(&input.acquisition, &*input.frames, &options, &work, watch).map_err(pipeline)?;
    let inspection = read(job, id, &summary, input, &work).map_err(NoOutput::Failed)?;
    let path = app.store.folder().inspection(id);
    folder::sync_tree(&work)?;
    folder::move_durably(&work, &path)?;
    Ok(Output::Inspection { inspection: Box::new(inspection), path })
}

fn read(job: &Job, id: Id, summary: &Summary, input: &Input, work: &Path) -> Result<NewInspection, Failure> {
    let mut defects = results_folder::defects(work).map_err(Failure::of_results)?;
    defects.extend(results_folder::look_again(work).map_err(Failure::of_results)?);
    Ok(NewInspection {
        id,
        summary: serde_json::to_string(summary).map_err(Failure::of_results)?,
        lay_lengths: results_folder::lay_lengths(work).map_err(Failure::of_results)?,
        defects: defects.into_iter().map(|defect| (defect_id(job.id, defect.id), defect)).collect(),
        line_pitch_mm: input.acquisition.line_pitch_mm,
    })
}

/// Id of a defect: derived from job and number, so that a job which is run again after a crash names its defects alike.
fn defect_id(job: Id, number: usize) -> Id {
    let digest = Sha256::digest(format!("defect\n{job}\n{number}"));
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&digest[..16]);
    Id(uuid::Builder::from_custom_bytes(bytes).into_uuid())
}

async fn settle(app: &App, job: &Job, output: Output) -> Result<Lease, StoreError> {
    let now_ms = app.now_ms();
    let (lease, path) = match output {
        Output::Model { model, path } => {
            (app.store.settle_trained(job.id, job.lease_token, &model, now_ms).await?, path)
        }
        Output::Inspection { inspection, path } => {
            let lease = app.store.settle_inspected(job.id, job.lease_token, &inspection, now_ms).await?;
            app.outbox_wake.notify_one();
            (lease, path)
        }
        Output::Previewed(suspicions) => {
            return app.store.settle_previewed(job.id, job.lease_token, &suspicions, now_ms).await;
        }
    };
    if lease == Lease::Lost {
        crate::store::frames::run_blocking(move || folder::remove(&path)).await?;
    }
    Ok(lease)
}
