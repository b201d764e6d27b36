//! Previews: frames that are reduced so far that they cross a thin link in minutes, and still show contours, strands and wires.
//!
//! Line `g` of the previews of a view is the mean of camera lines `4 g .. 4 g + 4`, however these were cut into frames: it belongs to
//! the preview of the frame in which the four begin. So previews put together have the geometry of the whole frames.

use super::Acquisition;
use std::ops::Range;

/// Camera lines that become one line, and columns that become one column. Measured: with 4, lay lengths are nearly as good as those of
/// whole frames and the files have 3 % of the bytes; with 8 lines, wires are lost.
pub const REDUCTION: u32 = 4;
/// Fewest columns of a sensor whose frames can be reduced: with fewer, too little of the wires is left.
pub const LEAST_SENSOR_PX: u32 = 256;

/// The first line of previews that begins at or behind a camera line.
pub fn line_of(camera_line: u64) -> u64 {
    camera_line.div_ceil(u64::from(REDUCTION))
}

/// Lines of the preview of a frame that has these camera lines of its view. At least one, so that every frame has a preview.
pub fn lines_of(frame: Range<u64>) -> u32 {
    u32::try_from(line_of(frame.end) - line_of(frame.start)).unwrap_or(u32::MAX).max(1)
}

/// Columns of a preview.
pub fn columns_of(sensor_px: u32) -> u32 {
    sensor_px / REDUCTION
}

/// The acquisition as its previews show it.
pub fn reduced(acquisition: &Acquisition) -> Acquisition {
    Acquisition {
        line_pitch_mm: acquisition.line_pitch_mm * f64::from(REDUCTION),
        sensor_px: columns_of(acquisition.sensor_px),
        px_per_mm: acquisition.px_per_mm.iter().map(|scale| scale / f64::from(REDUCTION)).collect(),
        rope_width_px: acquisition.rope_width_px.map(|px| px / f64::from(REDUCTION)),
        reduction: acquisition.reduction * REDUCTION,
        ..acquisition.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn however_a_view_is_cut_into_frames_its_previews_have_every_line_once() {
        for cuts in [vec![0, 2000, 4000, 4100], vec![0, 7, 22, 31, 200, 4100], vec![0, 4100]] {
            let lines: u32 = cuts.windows(2).map(|cut| lines_of(cut[0]..cut[1])).sum();
            assert_eq!(lines, 1025, "{cuts:?}");
        }
        assert_eq!(lines_of(1..3), 1, "every frame has a preview");
    }
}
