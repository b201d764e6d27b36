-- What clients announce before they send it, what was found damaged since, and how much a ropeway may take.

create table announced_frame (
    acquisition_id  text    not null references acquisition (id) on delete cascade,
    view            integer not null,
    frame           integer not null,           -- number within the view, from 0
    sha256          text    not null,           -- of the bytes that will come, lower-case hex
    bytes           integer not null,           -- how many will come
    lines           integer not null,           -- camera lines of the image: tells the rope metres of what is missing
    primary key (acquisition_id, view, frame)
) strict, without rowid;

-- A frame whose file was found to be gone or changed may be sent again, and is no result until it was.
alter table frame add column damaged_at_ms integer;      -- null while it is sound
create index frame_by_sha256 on frame (sha256);          -- a frame that another acquisition holds is not sent again

-- Frames that are there, and their bytes; kept with every frame, because counting a million of them a request is too slow.
alter table view add column frames_present integer not null default 0;
update view set frames_present =
  (select count(*) from frame f where f.acquisition_id = view.acquisition_id and f.view = view.view);
alter table acquisition add column frame_bytes integer not null default 0;
update acquisition set frame_bytes = (select coalesce(sum(bytes), 0) from frame where acquisition_id = acquisition.id);

alter table ropeway add column quota_bytes integer;      -- most bytes of frames of all its ropes; null: as the disk allows
