//! A recording that is one camera dump: gray values without header, whose geometry stands in the metadata of its upload.
//!
//! `Upload-Metadata` has `rope_json` (as in a folder; folders of views are not needed to exist) and, for 16 bit, `raw_bits 16`. The
//! lines of the views follow each other, view by view, equally many of each: what `cat view0.raw view1.raw` makes.

use super::archive_entries::ArchiveError;
use crate::pipeline::acquisition::RopeFile;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use std::fs::File;
use std::io::{BufReader, Cursor, Read};
use std::path::Path;

/// Lines of the frames that a dump is cut into.
const FRAME_LINES: u64 = 2000;

/// What a dump holds.
#[derive(Debug, Clone, PartialEq)]
pub struct RawDump {
    /// Its `rope.json`.
    pub rope_file: RopeFile,
    /// Lines of every view.
    lines: u64,
    /// Bytes of a gray value.
    gray_bytes: usize,
}

impl RawDump {
    /// A dump of `length` bytes with this `rope.json` and bits a gray value.
    pub fn new(rope_json: &str, raw_bits: Option<&str>, length: u64) -> Result<Self, ArchiveError> {
        let no = ArchiveError::NoAcquisition;
        let rope_file: RopeFile = serde_json::from_str(rope_json)
            .map_err(|e| no(format!("rope_json in Upload-Metadata is not valid: {e}")))?;
        rope_file.validate().map_err(|e| no(e.to_string()))?;
        let gray_bytes = match raw_bits {
            None | Some("8") => 1,
            Some("16") => 2,
            Some(other) => return Err(no(format!("raw_bits in Upload-Metadata is {other:?}, but must be 8 or 16"))),
        };
        let line_bytes = u64::from(rope_file.sensor_px) * gray_bytes as u64;
        let views = rope_file.views.len() as u64;
        if length == 0 || !length.is_multiple_of(line_bytes * views) {
            return Err(no(format!(
                "{length} bytes are not the same whole number of lines of {line_bytes} bytes in each of {views} views: is sensor_px right, or raw_bits?"
            )));
        }
        Ok(Self { rope_file, lines: length / line_bytes / views, gray_bytes })
    }

    /// Frames of each view.
    pub fn frames(&self) -> Vec<u32> {
        let frames = self.lines.div_ceil(FRAME_LINES);
        vec![u32::try_from(frames).unwrap_or(u32::MAX); self.rope_file.views.len()]
    }

    /// Gives every frame to `take` as PNG, without loss, with its view and number.
    pub fn each_frame<E: From<ArchiveError>>(
        &self,
        path: &Path,
        mut take: impl FnMut(u32, u32, &mut dyn Read) -> Result<(), E>,
    ) -> Result<(), E> {
        let file = File::open(path).map_err(ArchiveError::from)?;
        let mut file = BufReader::with_capacity(1 << 18, file);
        for (view, frames) in (0..).zip(self.frames()) {
            for number in 0..frames {
                let lines = (self.lines - u64::from(number) * FRAME_LINES).min(FRAME_LINES);
                let png = self.next_frame(&mut file, lines as u32)?;
                take(view, number, &mut Cursor::new(png))?;
            }
        }
        Ok(())
    }

    fn next_frame(&self, file: &mut impl Read, lines: u32) -> Result<Vec<u8>, ArchiveError> {
        let mut pixels = vec![0; self.rope_file.sensor_px as usize * lines as usize * self.gray_bytes];
        file.read_exact(&mut pixels)?;
        let color = if self.gray_bytes == 1 { ExtendedColorType::L8 } else { ExtendedColorType::L16 };
        if self.gray_bytes == 2 {
            // Cameras write little-endian; the encoder takes values as this machine has them.
            for value in pixels.chunks_exact_mut(2) {
                value.copy_from_slice(&u16::from_le_bytes([value[0], value[1]]).to_ne_bytes());
            }
        }
        let mut png = Vec::new();
        PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Adaptive)
            .write_image(&pixels, self.rope_file.sensor_px, lines, color)
            .map_err(|e| ArchiveError::Unreadable(e.to_string()))?;
        Ok(png)
    }
}
