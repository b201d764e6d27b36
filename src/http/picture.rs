//! Scales a strip of frames down to one PNG, holding one frame and one row at a time.

use crate::pipeline::source::{self, Map, SourceError};
use std::path::PathBuf;

/// A frame-sized file that the strip touches.
#[derive(Debug, Clone, PartialEq)]
pub struct Tile {
    /// Its first camera line, counted over the view.
    pub first_line: u64,
    /// Its camera lines.
    pub lines: u64,
    /// The file. One that does not exist was not inspected.
    pub path: PathBuf,
}

/// What part of a view, and how large it shall be.
#[derive(Debug, Clone, PartialEq)]
pub struct Strip {
    /// Columns of the frames.
    pub columns: usize,
    /// First line.
    pub from_line: u64,
    /// Line after the last one.
    pub to_line: u64,
    /// Columns of the picture, at most `columns`.
    pub width: usize,
    /// Rows of the picture, at most the lines.
    pub height: usize,
    /// True: the files are likelihood maps, and a pixel is the darkest of what it stands for. False: frames, and their mean.
    pub maps: bool,
}

/// Why a picture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// A file could not be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The PNG could not be written.
    #[error(transparent)]
    Encode(#[from] png::EncodingError),
    /// The process goes down.
    #[error("the process goes down")]
    Stopped,
}

/// One row of the picture being filled.
struct Row {
    /// Picture column of every frame column: each belongs to exactly one.
    column: Vec<usize>,
    sum: Vec<u32>,
    count: Vec<u32>,
    least: Vec<u8>,
}

impl Row {
    fn new(strip: &Strip) -> Self {
        Self {
            column: (0..strip.columns).map(|c| c * strip.width / strip.columns).collect(),
            sum: vec![0; strip.width],
            count: vec![0; strip.width],
            least: vec![255; strip.width],
        }
    }

    /// Adds a line of gray and alpha; what is transparent does not count.
    fn add(&mut self, line: &[[u8; 2]]) {
        for (&[gray, alpha], &column) in line.iter().zip(&self.column) {
            if alpha > 0 {
                self.sum[column] += u32::from(gray);
                self.count[column] += 1;
                self.least[column] = self.least[column].min(gray);
            }
        }
    }

    /// Gray and alpha of the row; then empties it.
    fn flush(&mut self, darkest: bool, pixels: &mut Vec<[u8; 2]>) {
        for column in 0..self.sum.len() {
            pixels.push(match (self.count[column], darkest) {
                (0, _) => [0, 0],
                (_, true) => [self.least[column], 255],
                (count, false) => [((self.sum[column] + count / 2) / count) as u8, 255],
            });
        }
        self.sum.fill(0);
        self.count.fill(0);
        self.least.fill(255);
    }
}

/// Makes the PNG. Lines without a file, and what maps say was not judged, are transparent; without any such, the PNG is plain gray.
/// `stopped` is asked once a file.
pub fn render(strip: &Strip, tiles: &[Tile], stopped: impl Fn() -> bool) -> Result<Vec<u8>, PictureError> {
    let lines = strip.to_line - strip.from_line;
    let row_of = |line: u64| ((line - strip.from_line) * strip.height as u64 / lines) as usize;
    let mut row = Row::new(strip);
    let mut pixels: Vec<[u8; 2]> = Vec::with_capacity(strip.width * strip.height);
    let mut current = 0;
    for tile in tiles {
        if stopped() {
            return Err(PictureError::Stopped);
        }
        if !tile.path.is_file() {
            continue;
        }
        let Map { width, pixels: decoded } = if strip.maps {
            source::decode_map(&tile.path)?
        } else {
            let frame = source::decode(&tile.path)?;
            Map { width: frame.width, pixels: frame.pixels.into_iter().map(|gray| [gray, 255]).collect() }
        };
        let (first, last) = (tile.first_line.max(strip.from_line), (tile.first_line + tile.lines).min(strip.to_line));
        for line in first..last {
            while current < row_of(line) {
                row.flush(strip.maps, &mut pixels);
                current += 1;
            }
            let start = (line - tile.first_line) as usize * width;
            if let Some(line) = decoded.get(start..start + width) {
                row.add(line);
            }
        }
    }
    while current < strip.height {
        row.flush(strip.maps, &mut pixels);
        current += 1;
    }
    encode(strip, &pixels)
}

fn encode(strip: &Strip, pixels: &[[u8; 2]]) -> Result<Vec<u8>, PictureError> {
    let opaque = pixels.iter().all(|[_, alpha]| *alpha == 255);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, strip.width as u32, strip.height as u32);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_color(if opaque { png::ColorType::Grayscale } else { png::ColorType::GrayscaleAlpha });
    let mut writer = encoder.write_header()?;
    if opaque {
        let grays: Vec<u8> = pixels.iter().map(|[gray, _]| *gray).collect();
        writer.write_image_data(&grays)?;
    } else {
        writer.write_image_data(pixels.as_flattened())?;
    }
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tiles(folder: &std::path::Path, frames: &[&[[u8; 4]]]) -> Vec<Tile> {
        let mut first_line = 0;
        let mut tiles = Vec::new();
        for (n, lines) in frames.iter().enumerate() {
            let path = folder.join(n.to_string());
            let image = image::GrayImage::from_raw(4, lines.len() as u32, lines.concat()).unwrap();
            image.save_with_format(&path, image::ImageFormat::Png).unwrap();
            tiles.push(Tile { first_line, lines: lines.len() as u64, path });
            first_line += lines.len() as u64;
        }
        tiles
    }

    fn strip(from_line: u64, to_line: u64, width: usize, height: usize, maps: bool) -> Strip {
        Strip { columns: 4, from_line, to_line, width, height, maps }
    }

    fn pixels(png: &[u8]) -> Vec<u8> {
        image::load_from_memory(png).unwrap().to_luma8().into_raw()
    }

    #[test]
    fn the_darkest_pixel_survives_and_the_mean_is_the_mean() {
        let folder = tempfile::tempdir().unwrap();
        let tiles = tiles(folder.path(), &[&[[100; 4], [100, 100, 0, 100]], &[[200; 4], [200; 4]]]);
        let darkest = render(&strip(0, 4, 2, 2, true), &tiles, || false).unwrap();
        assert_eq!(pixels(&darkest), [100, 0, 200, 200]);
        let mean = render(&strip(0, 4, 2, 1, false), &tiles, || false).unwrap();
        assert_eq!(pixels(&mean), [150, 138]); // (3*100 + 0 + 4*200) / 8 = 137.5
    }

    #[test]
    fn a_range_across_frames_is_cut_to_the_line() {
        let folder = tempfile::tempdir().unwrap();
        let tiles = tiles(folder.path(), &[&[[1; 4], [2; 4]], &[[3; 4], [4; 4]]]);
        let png = render(&strip(1, 3, 1, 2, false), &tiles, || false).unwrap();
        assert_eq!(pixels(&png), [2, 3]);
    }

    #[test]
    fn a_frame_without_map_is_transparent() {
        let folder = tempfile::tempdir().unwrap();
        let mut tiles = tiles(folder.path(), &[&[[9; 4]], &[[9; 4]]]);
        tiles[0].path = folder.path().join("absent");
        let png = render(&strip(0, 2, 1, 2, true), &tiles, || false).unwrap();
        assert_eq!(image::load_from_memory(&png).unwrap().to_luma_alpha8().into_raw(), [0, 0, 9, 255]);
    }
    #[test]
    fn what_was_not_judged_is_transparent_and_darkens_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.png");
        let (judged, not) = ([90, 255], [0, 0]);
        let map = [[judged, not, not, not], [[200, 255], not, not, judged]].as_flattened().concat();
        image::GrayAlphaImage::from_raw(4, 2, map).unwrap().save(&path).unwrap();
        let png = render(&strip(0, 2, 2, 2, true), &[Tile { first_line: 0, lines: 2, path }], || false).unwrap();
        let pixels = image::load_from_memory(&png).unwrap().to_luma_alpha8().into_raw();
        assert_eq!(pixels, [90, 255, 0, 0, 200, 255, 90, 255]);
    }
}
