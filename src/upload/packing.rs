//! Brings a frame file into the stored form, without loss: PNG and TIFF as they are, BMP and camera dumps as PNG, and all as
//! compressed PNG where the link is slower than the processor.

use super::plan::PlanError;
use bytes::Bytes;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ImageBuffer, ImageReader, Luma};
use std::io::Cursor;
use std::path::Path;

/// Endings of frame files that can be sent; `raw` is a dump of gray values without header.
pub const EXTENSIONS: [&str; 5] = ["png", "tif", "tiff", "bmp", "raw"];

/// How frames are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Packing {
    /// Columns of a camera dump.
    pub raw_width_px: u32,
    /// Bits of a gray value in a camera dump: 8, or 16 little-endian.
    pub raw_bits: u8,
    /// Compress as far as PNG goes.
    pub compress: bool,
}

/// A frame as it is sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packed {
    /// Its bytes.
    pub bytes: Bytes,
    /// `image/png` or `image/tiff`.
    pub content_type: &'static str,
    /// Camera lines.
    pub lines: u32,
}

impl Packing {
    /// Its name in the journal: other names, other bytes.
    pub fn name(self) -> String {
        format!("raw{}x{}{}", self.raw_width_px, self.raw_bits, if self.compress { " compressed" } else { "" })
    }

    /// Reads and packs a file.
    pub fn pack(self, path: &Path) -> Result<Packed, PlanError> {
        let content = std::fs::read(path).map_err(|source| PlanError::Read { path: path.into(), source })?;
        let extension = extension(path);
        let unreadable = |reason: String| PlanError::Frame { path: path.into(), reason };
        let stored = match extension.as_str() {
            "png" => Some("image/png"),
            "tif" | "tiff" => Some("image/tiff"),
            _ => None,
        };
        if let Some(content_type) = stored
            && !self.compress
        {
            let (_, lines) = reader(&content)
                .map_err(|e| unreadable(e.to_string()))?
                .into_dimensions()
                .map_err(|e| unreadable(e.to_string()))?;
            return Ok(Packed { bytes: content.into(), content_type, lines });
        }
        let gray = self.gray(&extension, &content).map_err(unreadable)?;
        let png = self.png(&gray).map_err(|e| unreadable(e.to_string()))?;
        let lines = gray.height();
        Ok(match stored {
            Some(content_type) if content.len() <= png.len() => Packed { bytes: content.into(), content_type, lines },
            _ => Packed { bytes: png.into(), content_type: "image/png", lines },
        })
    }

    /// Reads a file as gray values.
    pub fn read(self, path: &Path) -> Result<DynamicImage, PlanError> {
        let content = std::fs::read(path).map_err(|source| PlanError::Read { path: path.into(), source })?;
        self.gray(&extension(path), &content).map_err(|reason| PlanError::Frame { path: path.into(), reason })
    }

    fn gray(self, extension: &str, content: &[u8]) -> Result<DynamicImage, String> {
        gray(match extension {
            "raw" => self.dump(content)?,
            _ => reader(content).map_err(|e| e.to_string())?.decode().map_err(|e| e.to_string())?,
        })
    }

    fn dump(self, content: &[u8]) -> Result<DynamicImage, String> {
        let line_bytes = self.raw_width_px as usize * usize::from(self.raw_bits / 8);
        if content.is_empty() || !content.len().is_multiple_of(line_bytes) {
            return Err(format!(
                "{} bytes are no whole number of lines of {} columns with {} bits: is sensor_px in rope.json right, or --raw-bits?",
                content.len(),
                self.raw_width_px,
                self.raw_bits
            ));
        }
        let lines = (content.len() / line_bytes) as u32;
        let image = if self.raw_bits == 8 {
            ImageBuffer::<Luma<u8>, _>::from_raw(self.raw_width_px, lines, content.to_vec()).map(Into::into)
        } else {
            let values = content.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
            ImageBuffer::<Luma<u16>, Vec<u16>>::from_raw(self.raw_width_px, lines, values).map(Into::into)
        };
        image.ok_or_else(|| "the dump is larger than memory".to_owned())
    }

    fn png(self, image: &DynamicImage) -> image::ImageResult<Vec<u8>> {
        let compression = if self.compress { CompressionType::Best } else { CompressionType::Fast };
        let mut bytes = Vec::new();
        image.write_with_encoder(PngEncoder::new_with_quality(&mut bytes, compression, FilterType::Adaptive))?;
        Ok(bytes)
    }
}

fn extension(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase()
}

fn reader(content: &[u8]) -> std::io::Result<ImageReader<Cursor<&[u8]>>> {
    ImageReader::new(Cursor::new(content)).with_guessed_format()
}

/// The image as gray without loss. A gray BMP comes as colour with three equal channels.
fn gray(image: DynamicImage) -> Result<DynamicImage, String> {
    match image {
        DynamicImage::ImageLuma8(_) | DynamicImage::ImageLuma16(_) => Ok(image),
        DynamicImage::ImageRgb8(colour) if colour.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]) => {
            Ok(ImageBuffer::from_fn(colour.width(), colour.height(), |x, y| Luma([colour.get_pixel(x, y).0[0]])).into())
        }
        other => Err(format!("the image is {:?}, but frames are 8 or 16 bit gray", other.color())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACKING: Packing = Packing { raw_width_px: 64, raw_bits: 8, compress: false };

    fn packed(name: &str, content: &[u8], packing: Packing) -> Result<Packed, PlanError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        packing.pack(&path)
    }

    fn encoded(image: &DynamicImage, format: image::ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    fn decoded(packed: &Packed) -> DynamicImage {
        reader(&packed.bytes).unwrap().decode().unwrap()
    }

    fn noise16() -> DynamicImage {
        ImageBuffer::from_fn(64, 30, |x, y| Luma([(x * 977 + y * 3331) as u16])).into()
    }

    #[test]
    fn png_and_tiff_are_sent_as_they_are() {
        for (name, format) in [("a.png", image::ImageFormat::Png), ("a.tif", image::ImageFormat::Tiff)] {
            let content = encoded(&noise16(), format);
            let packed = packed(name, &content, PACKING).unwrap();
            assert_eq!((&packed.bytes[..], packed.lines), (&content[..], 30));
        }
    }

    #[test]
    fn dumps_bmp_and_compressed_frames_keep_every_gray_value() {
        let image = noise16();
        let raw: Vec<u8> = image.as_luma16().unwrap().as_raw().iter().flat_map(|g| g.to_le_bytes()).collect();
        let packed16 = packed("a.raw", &raw, Packing { raw_bits: 16, ..PACKING }).unwrap();
        assert_eq!((decoded(&packed16), packed16.content_type), (image.clone(), "image/png"));
        let eight = DynamicImage::ImageLuma8(image.to_luma8());
        let dump = packed("a.raw", eight.as_bytes(), PACKING).unwrap();
        assert_eq!((decoded(&dump), dump.lines), (eight.clone(), 30));
        assert_eq!(decoded(&packed("a.bmp", &encoded(&eight, image::ImageFormat::Bmp), PACKING).unwrap()), eight);
        let tiff = encoded(&image, image::ImageFormat::Tiff);
        let small = packed("a.tif", &tiff, Packing { compress: true, ..PACKING }).unwrap();
        assert!(small.bytes.len() < tiff.len());
        assert_eq!(decoded(&small), image);
    }

    #[test]
    fn a_dump_of_another_width_and_a_coloured_bmp_are_refused_with_the_way_out() {
        let error = packed("a.raw", &[0; 100], PACKING).unwrap_err().to_string();
        assert!(error.contains("100 bytes") && error.contains("--raw-bits"), "{error}");
        let colour = DynamicImage::ImageRgb8(ImageBuffer::from_pixel(64, 2, image::Rgb([1, 2, 3])));
        assert!(packed("a.bmp", &encoded(&colour, image::ImageFormat::Bmp), PACKING).is_err());
    }
}
