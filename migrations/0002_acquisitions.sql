-- One pass of the camera head along a rope, and the frames that were uploaded of it.

create table acquisition (
    seq            integer primary key,
    id             text    not null unique,
    rope_id        text    not null references rope (id),
    line_pitch_mm  real    not null,            -- rope per camera line in mm
    sensor_px      integer not null,            -- columns of every frame
    rope_width_px  real,                        -- width of the rope in the image in px: a hint
    start_m        real    not null,            -- rope metre of line 0
    acquired_at_ms integer,                     -- when the pass began; null if the client did not say
    state          text    not null check (state in ('open', 'complete')), -- frames are taken only while open
    created_at_ms  integer not null
) strict;

create index acquisition_by_rope on acquisition (rope_id, seq);

create table view (
    acquisition_id  text    not null references acquisition (id) on delete cascade,
    view            integer not null,           -- 0..7
    angle_deg       real    not null,           -- the camera stands where strands of this phase are nearest
    frames_expected integer,                    -- how many frames the client announced; null until it says so
    primary key (acquisition_id, view)
) strict, without rowid;

create table frame (
    acquisition_id  text    not null references acquisition (id) on delete cascade,
    view            integer not null,
    frame           integer not null,           -- number within the view, from 0
    sha256          text    not null,           -- of the stored bytes, lower-case hex; names the file, answers repeats
    bytes           integer not null,           -- length of the file
    lines           integer not null,           -- camera lines (image rows): line numbers of later frames start after them
    content_type    text    not null,           -- image/png or image/tiff, as recognised from the content
    received_at_ms  integer not null,           -- when it was acknowledged; the file was durable before
    primary key (acquisition_id, view, frame)
) strict, without rowid;
