-- Long work, leased to workers. Every write of a worker names its lease token, so one that lost its lease cannot settle.

create table job (
    seq                integer primary key,
    id                 text    not null unique,
    kind               text    not null check (kind in ('train', 'inspect')),
    rope_id            text    not null references rope (id),
    acquisition_id     text    not null references acquisition (id),
    model_id           text    references model (id),   -- inspect: model to judge with; null: alignment only
    threshold          real,                            -- inspect: line score above which a line is an alarm; null: the model's own
    from_m             real,                            -- train: rope metre from which on the rope is intact; null: start
    to_m               real,                            -- train: up to which it is; null: end
    idempotency_key    text,                            -- the client's; a repeated request with it is the same job
    state              text    not null check (state in ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    run_at_ms          integer not null,                -- not before: back-off after a failed attempt
    attempts           integer not null default 0,      -- times it was claimed; a hand-back at shutdown does not count
    lease_owner        text,                            -- instance (process) that runs it; dead ones are known by their free lock
    lease_token        integer not null default 0,      -- fencing token: grows with every claim
    lease_until_ms     integer,                         -- the lease is void after this; renewed by heartbeats
    cancel_requested   integer not null default 0 check (cancel_requested in (0, 1)), -- seen by the worker at its next heartbeat
    stage              text,                            -- what is being done: align, learn, inspect, write
    done_m             real,                            -- metres of rope done in the stage
    total_m            real,                            -- metres of rope in the stage
    metres_per_second  real,                            -- speed of the stage so far
    error              text,                            -- JSON problem (type, title, detail) of the last failed attempt
    result_id          text,                            -- id of the model or inspection that came of it
    created_at_ms      integer not null,
    started_at_ms      integer,                         -- first claim
    finished_at_ms     integer,                         -- end, whatever the outcome
    unique (kind, idempotency_key)
) strict;

create index job_to_claim on job (state, run_at_ms, seq);
create index job_by_acquisition on job (acquisition_id);

-- Access tokens `rope_<id>_<secret>`. The secret has 256 random bits, so one SHA-256 is enough to store it safely.
create table token (
    seq            integer primary key,
    id             text    not null unique,      -- public part, 16 hex digits
    name           text    not null,             -- who or what uses it
    role           text    not null check (role in ('admin', 'operator', 'upload', 'read', 'ticketing')),
    secret_sha256  blob    not null,             -- the secret itself is shown once and never stored
    created_at_ms  integer not null,
    revoked_at_ms  integer                       -- null while it is valid
) strict;
