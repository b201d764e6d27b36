-- Diameters with their uncertainty, ovality and looseness. Null in results from before: not estimated.

alter table lay_length add column strand_phase_sd_rad real;  -- standard deviation of strand_phase_rad
alter table lay_length add column strand_spread_rad real;    -- looseness: rms of the strands' deviations from their regular places
alter table lay_length add column strand_spread_sd_rad real; -- its standard deviation
alter table lay_length add column diameter_sd_mm real;       -- standard deviation of diameter_mm
alter table lay_length add column ovality_percent real;      -- largest less smallest diameter in percent of their mean
alter table lay_length add column ovality_sd_percent real;   -- its standard deviation

alter table provisional_lay_length add column strand_phase_sd_rad real; -- the following as in lay_length
alter table provisional_lay_length add column strand_spread_rad real;
alter table provisional_lay_length add column strand_spread_sd_rad real;
alter table provisional_lay_length add column diameter_sd_mm real;
alter table provisional_lay_length add column ovality_percent real;
alter table provisional_lay_length add column ovality_sd_percent real;

alter table view add column px_per_mm real; -- calibrated scale at the distance of the rope axis; null: diameters are relative to the nominal one
