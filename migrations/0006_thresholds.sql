-- Thresholds that people set for a model after its training. The trained one is version 0 and stands in the model's report; the
-- last version holds for jobs that are queued from then on. Rows never change: what an inspection was judged by stays known.

create table model_threshold (
    model_id      text    not null references model (id),
    version       integer not null check (version > 0), -- 1, 2, .. per model, without gaps
    line_score    real    not null,                      -- lines with a score above it are alarms
    set_by        text    not null,                      -- who set it
    reason        text    not null,                      -- and why
    created_at_ms integer not null,
    primary key (model_id, version)
) strict, without rowid;

-- The version that held when the job was queued, so that a second attempt judges as the first; null: the trained one, or the
-- job's own threshold, or no model.
alter table job add column threshold_version integer;

create index inspection_by_model on inspection (model_id, seq); -- past inspections, to preview another threshold on
