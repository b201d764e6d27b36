//! What a rope and an acquisition in the database amount to as `rope.json`: one check for what comes over HTTP, for what a job
//! reads back, and for folders.

use super::acquisitions::{Acquisition, NewAcquisition, NewView};
use super::ropes::Design;
use crate::pipeline::acquisition::{RopeFile, ViewFile};

impl NewAcquisition {
    /// The `rope.json` of an acquisition that is not stored yet.
    pub fn rope_file(&self, rope: &Design) -> RopeFile {
        RopeFile {
            strands: rope.strands as usize,
            wires_per_strand: rope.wires_per_strand as usize,
            rope_diameter_mm: rope.rope_diameter_mm,
            strand_lay_mm: rope.strand_lay_mm,
            wire_lay_mm: rope.wire_lay_mm,
            strand_diameter_mm: rope.strand_diameter_mm,
            wire_diameter_mm: rope.wire_diameter_mm,
            line_pitch_mm: self.line_pitch_mm,
            rope_width_px: self.rope_width_px,
            sensor_px: self.sensor_px,
            views: (0..)
                .zip(&self.views)
                .map(|(v, view): (u32, &NewView)| ViewFile {
                    folder: format!("view{v}"),
                    angle_deg: view.angle_deg,
                    px_per_mm: view.px_per_mm,
                })
                .collect(),
            start_m: Some(self.start_m),
            ropeway: None,
            rope: None,
            acquired_at: None,
        }
    }
}

impl Acquisition {
    /// The `rope.json` of a stored acquisition.
    pub fn rope_file(&self, rope: &Design) -> RopeFile {
        let row = &self.row;
        let new = NewAcquisition {
            id: row.id,
            rope_id: row.rope_id,
            line_pitch_mm: row.line_pitch_mm,
            sensor_px: row.sensor_px,
            rope_width_px: row.rope_width_px,
            start_m: row.start_m,
            acquired_at_ms: row.acquired_at_ms,
            views: self
                .views
                .iter()
                .map(|v| NewView { angle_deg: v.angle_deg, px_per_mm: v.px_per_mm, frames: v.frames_expected })
                .collect(),
        };
        new.rope_file(rope)
    }
}
