-- Style: lower case, singular table names, times as integer milliseconds since 1970 UTC, ids as hyphenated lower-case UUID text,
-- `seq` the order of arrival (cursors of pages point into it; an explicit integer key survives vacuum). Applied files never change.

create table ropeway (
    seq            integer primary key,      -- order of arrival
    id             text    not null unique,  -- UUID, chosen by client or service
    name           text    not null,         -- what people call the installation
    location       text,                     -- where it stands, free text
    created_at_ms  integer not null          -- when it was first created
) strict;

create table rope (
    seq                       integer primary key,
    id                        text    not null unique,
    ropeway_id                text    not null references ropeway (id),
    name                      text    not null,      -- such as `track rope 1`
    strands                   integer not null,      -- N; the design below was validated before it was written
    wires_per_strand          integer not null,      -- M, outer wires only: the inner ones are never seen
    rope_diameter_mm          real    not null,      -- nominal diameter in mm
    strand_lay_mm             real,                  -- nominal strand lay in mm, signed (+ right-hand); null if unknown
    wire_lay_mm               real,                  -- nominal wire lay in mm against the fixed axes, signed; null if unknown
    strand_diameter_mm        real,                  -- mm, where the maker states it
    wire_diameter_mm          real,                  -- mm, where the maker states it
    strand_lay_tolerance_mm   real,                  -- how far the strand lay may depart from nominal, mm
    wire_lay_tolerance_mm     real,                  -- the same for the wire lay, mm
    ticket_level              real,                  -- peak score from which a defect is ticketed without a person; null: never
    created_at_ms             integer not null
) strict;

create index rope_by_ropeway on rope (ropeway_id, seq); -- ropes of a ropeway, page by page
