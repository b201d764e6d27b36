//! The method of E.-S. Wacker and J. Denzler, "Enhanced Anomaly Detection in Wire Ropes by Combining Structure and Appearance",
//! cited as \[Wacker13\]: numbers and images in, numbers and images out.
//!
//! Nothing here reads or writes files, waits, tells the time, draws chance it was not given or keeps global state; the same input
//! gives the same result. `tests/architecture.rs` holds the wall.
//!
//! # Notation
//!
//! | paper | here | unit |
//! |---|---|---|
//! | N, M | [`Rope::strands`](rope::Rope::strands), [`Rope::wires`](rope::Rope::wires) | 1 |
//! | diameter of the rope, strands, wires | `diameter_mm`, `strand_radius_mm` and `wire_radius_mm` (halves) | mm |
//! | r_s, r_w | `strand_curve_radius_mm`, `wire_curve_radius_mm` | mm |
//! | k_s = 2 pi/N, k_w = 2 pi/M | `strand_step_rad`, `wire_step_rad` | rad |
//! | t | `x_mm`: position along the rope, lines times `pitch_mm` | mm |
//! | p_s = (L_s, o_s) | [`StrandHelix`](strand::StrandHelix) `{ lay_length_mm, offset_rad }`, signed, + right-hand | mm, rad |
//! | p_wj = (L_wj, o_wj) | [`WireHelix`](wire::WireHelix), against the fixed axes | mm, rad |
//! | phi_s, phi_w (eq. 2-3) | `phase_rad` of strand j, of wire i | rad |
//! | d (eq. 4) | [`Camera::distance_mm`](camera::Camera::distance_mm) | mm |
//! | f/d, rescaling to the known width | [`Camera::px_per_mm`](camera::Camera::px_per_mm) | px/mm |
//! | rc^u, rc^l | [`Contours`](contour::Contours): `upper_px`, `lower_px` | px |
//! | mc^u, mc^l (eq. 7-8) | [`ModelContour`](model_contour::ModelContour) | px |
//! | y^ps (eq. 10) | minus the course of `axis_px`, less its mean | px |
//! | I_r, I_m (eq. 14) | [`GrayImage`](image::GrayImage), [`synthesise`](synthesis::synthesise) | gray, 1 |
//! | theta = (phi_s, phi_w, d') | `cell` of a [`SurfacePoint`](surface_map::SurfacePoint); d' as a share of the wire step | 1 |
//! | p(g, theta), Sigma (eq. 18-19) | [`Histogram::smoothed`](histogram::Histogram::smoothed), [`Bandwidths`](bandwidths::Bandwidths) | 1, bins |
//! | p(g given theta) (eq. 20) | [`Appearance::likelihood`](appearance::Appearance::likelihood) | of uniform |
//! | R_k, epsilon, normalised p (eq. 21-22) | `REGION_BINS`, `EPSILON`, [`Appearance::scores`](appearance::Appearance::scores) | 1, 1, sd |
//!
//! Axes: y = r sin(phase), z = -r cos(phase), x along the rope; view 0 looks along +z.
//!
//! # Modules in reading order
//!
//! The model: what a rope is, and what a camera sees of it:
//! - [`rope`]: the rope as designed, validated, with its radii (fig. 3a)
//! - [`strand`]: centre line of a strand (eq. 1-2)
//! - [`wire`]: centre line of a wire (eq. 1, 3)
//! - [`camera`]: pushbroom projection (eq. 4-5)
//! - [`image`]: gray values, line after line
//! - [`surface`]: which strand a column shows, and where on its surface (eq. 16)
//! - [`model_contour`]: outline of the model rope (eq. 6-8)
//! - [`synthesis`]: the model rope as an image
//!
//! Tools of the alignment:
//! - [`simplex`]: downhill simplex
//! - [`smoothing`]: smooth courses from scattered measurements, with their uncertainty
//!
//! What a camera does to the picture:
//! - [`lost_lines`]: lines that show nothing, or the line before once more
//! - [`columns`]: columns of the sensor that are dead, tired or under dust
//!
//! The strands:
//! - [`contour`]: edges of the rope in the image; `edge_search` and `edge_tracker` find and follow them
//! - `shadow`: whether an edge is a shadow's, from the image beside it (`edge_strip`); `shadowed_edge`: where the rope begins then
//! - [`displacement`]: sideways movement from line to line (eq. 9-12)
//! - [`sway`]: its course, as smooth as ropes sway
//! - [`shared_axis`]: what all views see of that movement
//! - [`strand_alignment`]: phase and lay of all strands from the contours (eq. 13)
//! - [`camera_distance`]: d from the shift between both contours
//! - [`template`]: mean look of the strands
//! - [`registration`]: each strand's own deviation, from the image
//!
//! The wires:
//! - [`wire_alignment`]: the paper's way, exact and slow: the reference (eq. 14)
//! - [`unwrapping`]: wires as stripes on the unrolled strand: the fast way
//! - [`shade`]: what they are read against
//! - [`wire_prediction`]: where they are expected
//! - [`wire_tracking`]: the stripes followed along the rope
//! - [`wire_pattern`]: what wires add to the look of the strands
//!
//! The loop: stretches in, estimates out:
//! - [`stretch`]: a stretch of rope in all views, and what is measured in it; [`mod@reference`]: where strands and wires are taken to be meanwhile
//! - `lock`: finding the rope in the first stretches
//! - `courses`: strands and their wires solved for together; `encoder`: what the line counter gets wrong
//! - `noise_scale`: whether measurements scatter as they state
//! - [`aligner`]: stretch after stretch, of an acquisition that `aligner_spec` describes
//! - [`diameter`]: diameter and ovality from opposite contours, whose `width` is followed block by block and, where the scale was measured,
//!   turned into mm by `calibrated_width`; `looseness`: how far strands are from their regular places
//! - [`estimates`]: lay lengths with their uncertainty, or why there are none; `agreement`: whether the views bear it out; `error_ratios`: whether
//!   simulated ropes do
//!
//! The appearance:
//! - [`surface_map`]: theta of every pixel (eq. 16-17)
//! - [`histogram`]: 4-D density (eq. 18-19), as smooth as [`bandwidths`] say
//! - [`appearance`]: likelihood and its normalisation (eq. 20-22)
//! - [`usual`]: the same of what is judged beside the gray
//! - [`render`]: the model read backwards: intact rope drawn from it (fig. 10f)
//!
//! The defects:
//! - [`residuals`]: what deviates from the expected gray; `gathering` reads it from the pixels, `expected_row` what they are expected to be;
//!   loops over so many of them are `wide`
//! - [`evidence`]: scores on the unrolled rope
//! - [`filtering`]: their sums along the wires; `visibility`: how well a view sees a place
//! - [`calibration`]: how those lie on intact rope, learnt from evidence that was held back ([`kept_evidence`])
//! - [`scoring`]: sums made comparable, and what all factors say of a place
//! - [`closer_look`]: damage told from what lies on the rope, by the [`patch`] about what was found: gray of the unrolled rope
//!   ([`unrolled`]) that a small network ([`damage`]) looks at, and in doubt by the [`detail`] of the image that another one looks at
//!   ([`detail_network`])
//! - [`stretch_scores`]: the scores of a stretch, and views joined
//! - [`lasting`]: what is rare because it lasts
//! - [`judging`]: all of that, or parts of it, down to the paper's [`mean_filter`]
//! - [`tail`]: where an alarm begins; [`known_tail`]: what other ropes say of it
//! - [`defects`]: runs of lines over the threshold, strand by strand; [`merging`] makes defects of those that have one cause

mod agreement;
pub mod aligner;
mod aligner_spec;
pub mod appearance;
mod banded;
pub mod bandwidths;
mod calibrated_width;
pub mod calibration;
pub mod camera;
pub mod camera_distance;
pub mod closer_look;
pub mod columns;
pub mod contour;
pub mod course;
mod courses;
pub mod damage;
pub mod defects;
pub mod detail;
pub mod detail_network;
pub mod diameter;
pub mod displacement;
mod edge_search;
mod edge_strip;
mod edge_tracker;
mod encoder;
mod error_ratios;
pub mod estimates;
pub mod evidence;
mod expected_row;
pub mod factor;
mod filter_rows;
pub mod filtering;
mod first_views;
mod fitting;
mod gathering;
mod grain;
pub mod histogram;
pub mod image;
pub mod inspection_model;
pub mod judging;
pub mod kept_evidence;
pub mod kind;
pub mod known_tail;
pub mod lasting;
mod layers;
mod lock;
mod looseness;
pub mod lost_lines;
pub mod margins;
pub mod mean_filter;
mod measured;
mod measuring;
pub mod merging;
pub mod model_contour;
mod noise_scale;
pub mod outline_detail;
pub mod patch;
pub mod reference;
pub mod registration;
pub mod render;
pub mod residuals;
pub mod rope;
pub mod scoring;
mod self_likeness;
pub mod shade;
mod shadow;
mod shadowed_edge;
pub mod shared_axis;
pub mod simplex;
pub mod smoothing;
pub mod strand;
pub mod strand_alignment;
pub mod strand_pixels;
pub mod stretch;
pub mod stretch_scores;
pub mod surface;
pub mod surface_map;
pub mod sway;
pub mod synthesis;
pub mod tail;
pub mod template;
pub mod unrolled;
pub mod unwrapping;
pub mod usual;
mod visibility;
mod wide;
mod width;
pub mod wire;
pub mod wire_alignment;
pub mod wire_count;
mod wire_lock;
pub mod wire_pattern;
pub mod wire_prediction;
pub mod wire_tracking;
