-- Tickets: what goes out about a defect, to whom, and what became of it. Times are milliseconds since 1970 UTC.

-- Who is told. The secret is kept in the clear because every attempt is signed with it.
create table webhook_endpoints (
    id              text    primary key,
    url             text    not null,
    secret          text    not null,                     -- whsec_ and base64, Standard Webhooks
    allow_private   integer not null default 0 check (allow_private in (0, 1)), -- may lie in a private network (set by an admin)
    enabled         integer not null default 1 check (enabled in (0, 1)),
    disabled_reason text,                                 -- why it was switched off, as a sentence
    created_ms      integer not null
) strict;

-- What happened, at most once a defect: the unique column is what makes tickets single, however many confirm at once.
-- Written in the transaction that confirms the defect or stores the inspection, so neither exists without the other.
create table outbox_events (
    id          text    primary key,                      -- webhook-id and CloudEvents id, derived from the defect
    defect_id   text    not null unique,
    facts       text    not null,                         -- JSON of what is known about the defect at that moment
    occurred_ms integer not null
) strict;

-- One event on its way to one endpoint.
create table webhook_deliveries (
    id              text    primary key,
    event_id        text    not null references outbox_events (id),
    endpoint_id     text    not null references webhook_endpoints (id) on delete cascade,
    state           text    not null check (state in ('pending', 'delivered', 'dead')),
    attempts        integer not null default 0,           -- of the running schedule; a redelivery starts again at 0
    next_attempt_ms integer not null,                     -- not before
    lease_until_ms  integer not null default 0,           -- a dispatcher is on it until then
    lease_token     integer not null default 0,           -- fences a dispatcher that came back late
    created_ms      integer not null,
    settled_ms      integer,                              -- when it became delivered or dead
    unique (event_id, endpoint_id)
) strict;
create index webhook_deliveries_due on webhook_deliveries (next_attempt_ms) where state = 'pending';

-- Every attempt ever made, kept for the person who asks why there is no ticket.
create table webhook_attempts (
    delivery_id text    not null references webhook_deliveries (id) on delete cascade,
    number      integer not null,                         -- 1, 2, ... over all schedules of the delivery
    started_ms  integer not null,
    duration_ms integer not null,
    status      integer,                                  -- HTTP status, null when there was no answer
    error       text,                                     -- null when it was accepted
    primary key (delivery_id, number)
) strict, without rowid;

-- The ticket as the maintenance system reported it back.
create table tickets (
    defect_id  text    primary key,
    number     text    not null,
    url        text,
    state      text    not null,
    updated_ms integer not null
) strict;
