-- Thresholds that people applied to inspections after these had ended: nothing was computed anew, defects moved between the two
-- levels by their peak scores. The threshold of the job stays in the summary; the last number holds. Rows never change, so it stays
-- known who judged by what, and when.

create table inspection_threshold (
    inspection_id         text    not null references inspection (id) on delete cascade,
    number                integer not null check (number > 0), -- 1, 2, .. per inspection, without gaps, in the order they were applied
    line_score            real    not null,                    -- places with a peak score above it are defects
    look_again_line_score real,                                -- under it nothing is stored; null: it holds no more than defects
    model_version         integer,                             -- threshold of the model that was applied; null: a line score for this inspection
    set_by                text    not null,                    -- who applied it
    reason                text    not null,                    -- and why; of a threshold of the model, where that came from
    defects               integer not null,                    -- defects since then, for the summary
    look_again            integer not null,                    -- places to look at again since then
    created_at_ms         integer not null,                    -- when it was applied, ms since 1970
    primary key (inspection_id, number)
) strict, without rowid;

-- Inspections with the threshold that was applied last; without one, the job's own in the summary holds.
create view judged_inspection as
    select i.*, t.line_score as applied_line_score, t.look_again_line_score as applied_look_again_line_score,
           t.set_by as applied_by, t.reason as applied_because, t.defects as applied_defects, t.look_again as applied_look_again
    from inspection i
    left join inspection_threshold t on t.inspection_id = i.id
        and t.number = (select max(number) from inspection_threshold where inspection_id = i.id);
