-- What the service has vouched for: every frame was read back from its disk and had the promised digest.

create table receipt (
    acquisition_id  text    primary key references acquisition (id) on delete cascade,
    body            text    not null,           -- the signed document, as it was given out
    issued_at_ms    integer not null
) strict;
