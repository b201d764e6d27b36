-- Inspections of acquisitions that are still arriving, and what they have found so far.

alter table job add column live integer not null default 0 check (live in (0, 1)); -- may begin before the acquisition is complete
alter table job add column waiting_for text;             -- JSON: view and frame that a running job waits for, and since when; null: none

-- What a running inspection has found. It is no result: nobody can judge it, nothing is ticketed, and it goes when the job ends.
create table provisional_lay_length (
    job_id             text    not null references job (id) on delete cascade,
    view               integer not null,                   -- -1: fused over all views
    first_line         integer not null,                   -- the following as in lay_length
    last_line          integer not null,
    from_m             real    not null,
    to_m               real    not null,
    position_m         real    not null,
    strand_lay_mm      real,
    strand_lay_sd_mm   real,
    strand_phase_rad   real,
    strand_score       real,
    diameter_mm        real,
    wires              text    not null,
    reason             text,
    primary key (job_id, view, first_line)
) strict, without rowid;

create table provisional_defect (
    seq     integer primary key autoincrement,             -- grows with every change, for those who follow
    job_id  text    not null references job (id) on delete cascade,
    number  integer not null,                              -- along the rope, from 0
    defect  text    not null,                              -- JSON: rope metres, strand, wire, peak score, alarms
    unique (job_id, number)
) strict;

-- However a job ends, it leaves nothing provisional; and what it found before it was started again holds no more.
create trigger provisional_of_ended_job after update of state on job
when new.state in ('succeeded', 'failed', 'cancelled')
begin
    delete from provisional_lay_length where job_id = new.id;
    delete from provisional_defect where job_id = new.id;
end;

create trigger provisional_of_restarted_job after update of lease_token on job
when new.lease_token <> old.lease_token
begin
    delete from provisional_lay_length where job_id = new.id;
    delete from provisional_defect where job_id = new.id;
end;
