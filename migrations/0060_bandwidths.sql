-- How the bandwidths of the gray density are chosen in a training.

alter table job add column bandwidths text; -- JSON: "held-out" or "fixed", of a training; null: inspections, and trainings from before
