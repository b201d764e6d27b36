-- Trainings on several acquisitions of one rope.

alter table job add column further text; -- JSON, what a training learns from besides acquisition_id: acquisition_id, from_m, to_m of each; null: nothing
create index job_with_further on job (id) where further is not null; -- few have; who asks what needs an acquisition reads them all

-- Every acquisition that a job works on.
create view job_acquisition as
    select id as job_id, acquisition_id from job
    union all
    select j.id, f.value ->> 'acquisition_id' from job j, json_each(j.further) f where j.further is not null;
