-- Windows of rope over which surface alarms are counted, as the rules for this rope want them. A rope without rows has the usual
-- ones: 6, 30, 40 and 500 diameters and one lay length, without limits.

create table rope_window (
    rope_id              text    not null references rope (id),
    unit                 text    not null check (unit in ('diameter', 'lay')), -- what the length is counted in
    length               real    not null check (length > 0),                  -- in these units, such as 6 (diameters)
    most_surface_alarms  integer,                                              -- more are over the limit; null: no limit
    primary key (rope_id, unit, length)
) strict, without rowid;
