-- How long frames are kept. Rows of frames stay for ever: what was seen, with which digest, is evidence even without the pixels.

alter table ropeway add column keep_days integer;               -- days after which frames may be removed; null: never
alter table acquisition add column frames_removed_at_ms integer; -- when its frames were removed; null while they are there
