//! Where frames come from: image files, all there or still arriving, or whatever implements [`FrameSource`].

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Largest frame that is decoded, in pixels; checked from the header before any pixel is touched.
pub const MAX_FRAME_PIXELS: u64 = 64 << 20;
/// Most columns of a frame.
pub const MAX_SENSOR_PX: u32 = 16_384;
/// Most lines of one frame.
pub const MAX_FRAME_LINES: u32 = 65_536;

/// Why a frame could not be had.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// No such frame.
    #[error("view {view} has {frames} frames, so there is no frame {frame}")]
    NoSuchFrame {
        /// The view asked for.
        view: usize,
        /// The frame asked for.
        frame: usize,
        /// How many there are.
        frames: usize,
    },
    /// The file is not a whole gray image.
    #[error("{path}: {reason}")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The image is larger than any frame may be.
    #[error(
        "{path}: the image is {width}x{height}, but a frame may have at most {MAX_SENSOR_PX} columns, {MAX_FRAME_LINES} lines and {MAX_FRAME_PIXELS} pixels"
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Columns in its header.
        width: u32,
        /// Lines in its header.
        height: u32,
    },
    /// The image is not as wide as the sensor.
    #[error("{path}: the image has {width} columns, but the sensor has {sensor_px}")]
    WrongWidth {
        /// The file.
        path: PathBuf,
        /// Columns of the image.
        width: u32,
        /// Columns of the sensor.
        sensor_px: u32,
    },
    /// An acquisition that was not completed, and of which nothing came any more.
    #[error(
        "frame {frame} of view {view} did not come, and no other frame for {quiet_h:.1} h: send the rest and complete the acquisition, then queue the job again"
    )]
    Abandoned {
        /// The view.
        view: usize,
        /// The frame that was awaited.
        frame: usize,
        /// Hours since a frame came.
        quiet_h: f64,
    },
    /// The run was told to stop while it waited for a frame.
    #[error("stopped while a frame was awaited")]
    Stopped,
}

/// A frame as decoded: gray values scaled to 8 bit, rows are camera lines.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// Columns.
    pub width: usize,
    /// Lines.
    pub lines: usize,
    /// Gray values, row after row.
    pub pixels: Vec<u8>,
}

/// Gives the frames of an acquisition, in any order, from any thread.
pub trait FrameSource: Send + Sync {
    /// Number of views.
    fn views(&self) -> usize;
    /// Number of frames of `view`; of a source that still grows, those without a gap before them.
    fn frames(&self, view: usize) -> usize;
    /// True when the frame is there, false when the view ends before it. A source that still grows waits until it knows.
    fn wait_for(&self, view: usize, frame: usize) -> Result<bool, SourceError> {
        Ok(frame < self.frames(view))
    }
    /// Lines of a frame, read from its header without decoding it.
    fn lines(&self, view: usize, frame: usize) -> Result<usize, SourceError>;
    /// Decodes a frame.
    fn load(&self, view: usize, frame: usize) -> Result<Frame, SourceError>;
}

/// Frames that lie in image files (PNG or TIFF, 8 or 16 bit gray), one list a view.
#[derive(Debug, Clone)]
pub struct FrameFiles {
    sensor_px: u32,
    paths: Vec<Vec<PathBuf>>,
    maps: bool,
}

impl FrameFiles {
    /// `paths[view][frame]`; every image must be `sensor_px` wide.
    pub fn new(sensor_px: u32, paths: Vec<Vec<PathBuf>>) -> Self {
        Self { sensor_px, paths, maps: false }
    }

    /// The same of likelihood maps, whose alpha is left out: 255 is what was not judged.
    pub fn of_maps(sensor_px: u32, paths: Vec<Vec<PathBuf>>) -> Self {
        Self { maps: true, ..Self::new(sensor_px, paths) }
    }

    /// Adds the next frame of a view.
    pub fn push(&mut self, view: usize, path: PathBuf) {
        self.paths[view].push(path);
    }

    fn path(&self, view: usize, frame: usize) -> Result<&Path, SourceError> {
        let frames = self.paths.get(view).map_or(0, Vec::len);
        let missing = SourceError::NoSuchFrame { view, frame, frames };
        self.paths.get(view).and_then(|v| v.get(frame)).map(PathBuf::as_path).ok_or(missing)
    }

    fn dimensions(&self, path: &Path) -> Result<(u32, u32), SourceError> {
        let (width, height) = dimensions(path)?;
        if width != self.sensor_px {
            return Err(SourceError::WrongWidth { path: path.into(), width, sensor_px: self.sensor_px });
        }
        Ok((width, height))
    }
}

fn unreadable(path: &Path, error: impl std::fmt::Display) -> SourceError {
    SourceError::Unreadable { path: path.into(), reason: error.to_string() }
}

/// Bytes that are read at once of an image that is decoded, and of one whose header alone is asked for, as all are before the first stretch.
const READ_BYTES: usize = 1 << 16;
const HEADER_BYTES: usize = 1 << 9;

fn open(path: &Path, at_once: usize) -> Result<image::ImageReader<BufReader<File>>, SourceError> {
    let file = File::open(path).map_err(|e| unreadable(path, e))?;
    // By content, not by name: stored frames have no extension.
    image::ImageReader::new(BufReader::with_capacity(at_once, file))
        .with_guessed_format()
        .map_err(|e| unreadable(path, e))
}

/// Width and height of an image from its header, refused when larger than any frame may be.
pub fn dimensions(path: &Path) -> Result<(u32, u32), SourceError> {
    let (width, height) = open(path, HEADER_BYTES)?.into_dimensions().map_err(|e| unreadable(path, e))?;
    if width > MAX_SENSOR_PX || height > MAX_FRAME_LINES || u64::from(width) * u64::from(height) > MAX_FRAME_PIXELS {
        return Err(SourceError::TooLarge { path: path.into(), width, height });
    }
    Ok((width, height))
}

/// Decodes a gray image to 8 bit, after checking its header. Colour is refused: a line camera has none.
pub fn decode(path: &Path) -> Result<Frame, SourceError> {
    dimensions(path)?;
    decode_checked(path)
}

fn decode_checked(path: &Path) -> Result<Frame, SourceError> {
    let image = open(path, READ_BYTES)?.decode().map_err(|e| unreadable(path, e))?;
    let (width, height) = (image.width(), image.height());
    let pixels = match image {
        image::DynamicImage::ImageLuma8(gray) => gray.into_raw(),
        image::DynamicImage::ImageLuma16(gray) => gray.into_raw().into_iter().map(|g| (g >> 8) as u8).collect(),
        other => {
            return Err(unreadable(path, format!("the image is {:?}, but frames are 8 or 16 bit gray", other.color())));
        }
    };
    Ok(Frame { width: width as usize, lines: height as usize, pixels })
}

/// A likelihood map as decoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Map {
    /// Columns.
    pub width: usize,
    /// Gray and alpha, row after row: dark is unlikely, 0 alpha was not judged.
    pub pixels: Vec<[u8; 2]>,
}

/// Decodes a likelihood map, after checking its header.
pub fn decode_map(path: &Path) -> Result<Map, SourceError> {
    dimensions(path)?;
    let image = open(path, READ_BYTES)?.decode().map_err(|e| unreadable(path, e))?.into_luma_alpha8();
    Ok(Map { width: image.width() as usize, pixels: image.pixels().map(|pixel| pixel.0).collect() })
}

impl FrameSource for FrameFiles {
    fn views(&self) -> usize {
        self.paths.len()
    }

    fn frames(&self, view: usize) -> usize {
        self.paths.get(view).map_or(0, Vec::len)
    }

    fn lines(&self, view: usize, frame: usize) -> Result<usize, SourceError> {
        Ok(self.dimensions(self.path(view, frame)?)?.1 as usize)
    }

    fn load(&self, view: usize, frame: usize) -> Result<Frame, SourceError> {
        let path = self.path(view, frame)?;
        self.dimensions(path)?;
        if self.maps {
            let Map { width, pixels } = decode_map(path)?;
            let grays: Vec<u8> = pixels.into_iter().map(|[gray, _]| gray).collect();
            return Ok(Frame { width, lines: grays.len() / width.max(1), pixels: grays });
        }
        decode_checked(path)
    }
}
