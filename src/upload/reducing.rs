//! Reduces a frame to its preview: four lines and four columns become one, 32 shades of gray are left, and PNG does the rest.

use crate::pipeline::preview::{REDUCTION, columns_of, line_of, lines_of};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, GrayImage, ImageResult, Luma};

/// Gray values that become one: half the bytes, and less than the noise of a camera.
const SHADE: f32 = 8.0;

/// The preview of a frame that begins at a camera line of its view.
pub fn reduce(frame: &DynamicImage, first_line: u64) -> GrayImage {
    let (width, height) = (frame.width() as usize, frame.height() as usize);
    let gray: Vec<f32> = match frame {
        DynamicImage::ImageLuma8(gray) => gray.as_raw().iter().map(|&g| f32::from(g)).collect(),
        other => other.to_luma16().as_raw().iter().map(|&g| f32::from(g) / 257.0).collect(),
    };
    let by = REDUCTION as usize;
    let skipped = (line_of(first_line) * u64::from(REDUCTION) - first_line) as usize;
    let end_line = first_line + height as u64;
    GrayImage::from_fn(columns_of(frame.width()), lines_of(first_line..end_line), |column, line| {
        // The last four may go on in the next frame, whose lines are not looked at: what is here stands for them.
        let from_line = (skipped + line as usize * by).min(height - 1);
        let lines = from_line..(from_line + by).min(height);
        let columns = column as usize * by..(column as usize + 1) * by;
        let sum: f32 = lines.clone().flat_map(|l| &gray[l * width..][columns.clone()]).sum();
        let mean = sum / (lines.len() * columns.len()) as f32;
        Luma([((mean / SHADE).round() * SHADE) as u8])
    })
}

/// The file of a preview. Lines are much like those above them: other filters need half as much again.
pub fn encode(preview: &GrayImage) -> ImageResult<Vec<u8>> {
    let mut bytes = Vec::new();
    preview.write_with_encoder(PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, FilterType::Up))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A view whose line `n` has the gray value `n`.
    fn view(lines: std::ops::Range<u32>) -> DynamicImage {
        GrayImage::from_fn(256, lines.len() as u32, |_, y| Luma([(lines.start + y) as u8])).into()
    }

    #[test]
    fn previews_of_a_view_are_the_same_however_it_was_cut_but_for_lines_on_a_cut() {
        let whole = reduce(&view(0..240), 0);
        let cuts = [0, 17, 101, 106, 240];
        let pieces = cuts.windows(2).map(|cut| reduce(&view(cut[0]..cut[1]), u64::from(cut[0])));
        let lines: Vec<u8> =
            pieces.flat_map(|p| (0..p.height()).map(|y| p.get_pixel(3, y).0[0]).collect::<Vec<_>>()).collect();
        assert_eq!((whole.width(), whole.height(), lines.len()), (64, 60, 60));
        for (y, gray) in lines.iter().enumerate() {
            let there = whole.get_pixel(3, y as u32).0[0];
            assert!(gray.abs_diff(there) <= 8, "line {y}: {gray} instead of {there}");
            assert!(gray.abs_diff((4 * y + 1) as u8) <= 6, "line {y} is the mean of lines {} to {}", 4 * y, 4 * y + 3);
        }
    }

    #[test]
    fn sixteen_bits_are_reduced_as_eight_are_and_white_stays_white() {
        let sixteen = DynamicImage::ImageLuma16(view(0..80).to_luma16());
        assert_eq!(reduce(&sixteen, 0), reduce(&view(0..80), 0));
        let white = GrayImage::from_pixel(256, 8, Luma([255]));
        assert_eq!(reduce(&white.into(), 0).get_pixel(0, 0).0[0], 255);
    }
}
