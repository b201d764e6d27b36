-- Recordings that come as one large file (tar or zip) over tus 1.0, until they are unpacked into frames.

create table archive (
    id              text    primary key,           -- also the id of the acquisition that comes of it
    token_id        text    not null,              -- who began it: nobody else of that role may touch it
    rope_id         text    not null references rope (id),
    metadata        text    not null,              -- Upload-Metadata as it was sent: given back by HEAD
    length          integer not null,              -- bytes of the whole file
    received        integer not null default 0,    -- bytes that are durable: what follows in the file counts for nothing
    state           text    not null check (state in ('receiving', 'unpacking', 'unpacked', 'refused')),
    problem         text,                          -- JSON problem, why it was refused
    expires_at_ms   integer not null,              -- an upload that is not whole by then is removed
    created_at_ms   integer not null
) strict;
