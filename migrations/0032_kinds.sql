-- What a defect is likely to be, with the figures that say so. Null in inspections of earlier versions.

alter table defect add column rank integer;    -- 1 for the highest peak of its level, and so on
alter table defect add column angle_deg real;  -- of its peak round the rope, rope axes
alter table defect add column suggestion text; -- JSON: kind, why, length, width, area, gray, texture, distance from the outline
