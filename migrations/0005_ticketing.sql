-- One ticket per defect: what goes out about it, to whom, and what became of it.

-- Who is told. The secret lies here in the clear because every attempt is signed with it.
create table webhook_endpoint (
    seq             integer primary key,
    id              text    not null unique,
    url             text    not null,                      -- where events are posted to
    secret          text    not null,                      -- whsec_ and base64 (Standard Webhooks); shown once
    allow_private   integer not null default 0 check (allow_private in (0, 1)), -- may lie in a private network; an admin decides
    enabled         integer not null default 1 check (enabled in (0, 1)),
    disabled_reason text,                                  -- why it was switched off, as a sentence
    created_at_ms   integer not null
) strict;

-- What happened, at most once a defect: the unique column makes tickets single, however many confirm at once. Written in the
-- transaction that confirms the defect or stores the inspection, so neither exists without the other.
create table outbox_event (
    seq            integer primary key,
    id             text    not null unique,                -- webhook-id and CloudEvents id, derived from the defect
    defect_id      text    not null unique references defect (id) on delete cascade,
    facts          text    not null,                       -- JSON: what was known about the defect at that moment
    occurred_at_ms integer not null
) strict;

-- One event on its way to one endpoint.
create table webhook_delivery (
    seq                integer primary key,
    id                 text    not null unique,
    event_id           text    not null references outbox_event (id) on delete cascade,
    endpoint_id        text    not null references webhook_endpoint (id) on delete cascade,
    state              text    not null check (state in ('pending', 'delivered', 'dead')),
    attempts           integer not null default 0,         -- of the running schedule; a redelivery starts again at 0
    next_attempt_at_ms integer not null,                   -- not before
    lease_until_ms     integer not null default 0,         -- a dispatcher is on it until then
    lease_token        integer not null default 0,         -- fencing token: a dispatcher that comes back late settles nothing
    created_at_ms      integer not null,
    settled_at_ms      integer,                            -- when it became delivered or dead
    unique (event_id, endpoint_id)
) strict;

create index webhook_delivery_due on webhook_delivery (next_attempt_at_ms) where state = 'pending';

-- Every attempt ever made, for the person who asks why there is no ticket.
create table webhook_attempt (
    delivery_id   text    not null references webhook_delivery (id) on delete cascade,
    number        integer not null,                        -- 1, 2, .. over all schedules of the delivery
    started_at_ms integer not null,
    duration_ms   integer not null,
    status        integer,                                 -- HTTP status; null when there was no answer
    error         text,                                    -- null when it was accepted
    primary key (delivery_id, number)
) strict, without rowid;
