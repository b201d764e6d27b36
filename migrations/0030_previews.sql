-- Reduced forms of frames that are still to come over a thin link, and the job that looks at them. Previews are no frames and what is
-- found in them is no result: all of it goes when their acquisition is complete.

create table preview (
    acquisition_id  text    not null references acquisition (id) on delete cascade,
    view            integer not null,
    frame           integer not null,           -- number of the frame of which it is the reduced form
    sha256          text    not null,           -- of the stored bytes, lower-case hex; names the file, answers repeats
    bytes           integer not null,           -- length of the file
    first_line      integer not null,           -- camera line of the view at which the frame begins, as it was announced
    lines           integer not null,           -- lines of the preview, each of several camera lines
    suspicion       real,                       -- how soon the frame is wanted, higher is sooner; null: in its turn
    reason          text,                       -- why it is wanted sooner, as a sentence
    received_at_ms  integer not null,           -- when it was acknowledged; the file was durable before
    primary key (acquisition_id, view, frame)
) strict, without rowid;

alter table job add column preview integer not null default 0 check (preview in (0, 1)); -- it works on previews and has no result
create unique index preview_job_of_acquisition on job (acquisition_id) where preview = 1;

-- A preview job has no results that could replace what it found: that stays until the acquisition is complete.
drop trigger provisional_of_ended_job;
create trigger provisional_of_ended_job after update of state on job
when new.state in ('succeeded', 'failed', 'cancelled') and not (new.preview = 1 and new.state = 'succeeded')
begin
    delete from provisional_lay_length where job_id = new.id;
    delete from provisional_defect where job_id = new.id;
end;
