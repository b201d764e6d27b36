-- What jobs concluded. Bulky results (line scores, likelihood maps, model files) are files; tables that people ask ranges of are rows.

create table model (
    seq             integer primary key,
    id              text    not null unique,
    rope_id         text    not null references rope (id),
    version         integer not null,                      -- 1, 2, .. per rope
    acquisition_id  text    not null references acquisition (id), -- what it was trained on
    job_id          text    not null unique references job (id),  -- unique: a job leaves one model, however often it was tried
    report          text    not null,                      -- JSON: range, threshold and its origin, notes
    sha256          text    not null,                      -- of the model file
    bytes           integer not null,                      -- length of the model file
    created_at_ms   integer not null,
    unique (rope_id, version)
) strict;

create table inspection (
    seq             integer primary key,
    id              text    not null unique,               -- names the results folder
    rope_id         text    not null references rope (id),
    acquisition_id  text    not null references acquisition (id),
    model_id        text    references model (id),         -- null: alignment only
    job_id          text    not null unique references job (id),
    summary         text    not null,                      -- JSON: coverage with reasons, threshold and its origin, speed
    created_at_ms   integer not null
) strict;

create index inspection_by_rope on inspection (rope_id, seq);
create index inspection_by_acquisition on inspection (acquisition_id, seq);

create table lay_length (
    inspection_id      text    not null references inspection (id) on delete cascade,
    view               integer not null,                   -- -1: fused over all views
    first_line         integer not null,                   -- camera lines of the stretch
    last_line          integer not null,
    from_m             real    not null,                   -- rope metres of the stretch
    to_m               real    not null,
    position_m         real    not null,                   -- rope metre of the middle line, where phases hold
    strand_lay_mm      real,                               -- signed; null when it could not be estimated, never a guess
    strand_lay_sd_mm   real,                               -- its standard deviation
    strand_phase_rad   real,                               -- of strand 0 at the middle line
    strand_score       real,                               -- agreement of contours and model, 1 is perfect
    diameter_mm        real,                               -- rope diameter, where contours allow it
    wires              text    not null,                   -- JSON, one entry a strand: lay_mm, lay_sd_mm, phase_rad, score
    reason             text,                               -- why estimates are absent
    primary key (inspection_id, view, first_line)
) strict, without rowid;

create table defect (
    seq             integer primary key,
    id              text    not null unique,
    inspection_id   text    not null references inspection (id) on delete cascade,
    rope_id         text    not null references rope (id),
    number          integer not null,                      -- within the inspection, from 0, along the rope
    from_m          real    not null,                      -- rope metre where it begins
    to_m            real    not null,                      -- and ends
    strand          integer,                               -- null if it is not known
    wire            integer,                               -- wire in the strand, null if it is not known
    peak_score      real    not null,                      -- highest line score of its alarms
    alarms          text    not null,                      -- JSON: view, lines, columns, peak score of each alarm
    state           text    not null check (state in ('open', 'confirmed', 'dismissed')), -- what people decided
    verdict_by      text,                                  -- who decided
    verdict_comment text,                                  -- and what they said
    verdict_at_ms   integer,                               -- and when
    ticket_number   text,                                  -- written back by the maintenance system
    ticket_url      text,
    ticket_state    text,                                  -- in the words of that system
    created_at_ms   integer not null,
    unique (inspection_id, number)
) strict;

create index defect_by_rope on defect (rope_id, state, seq);
