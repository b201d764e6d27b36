-- Two levels: alarms, which are defects, and places under the threshold that are worth looking at again.

alter table defect add column level text not null default 'alarm' check (level in ('alarm', 'look_again')); -- which threshold it is over
alter table model_threshold add column look_again_line_score real; -- second level; null: as far under the first as the trained one
alter table job add column budget text;                            -- JSON: what false alarms may cost, of a training; null: inspections
