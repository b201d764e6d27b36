//! A sheet to draw on: rectangles, letters, pictures.

use super::font;
use image::{Rgb, RgbImage};

/// A colour.
pub(super) type Colour = [u8; 3];

/// A sheet to draw on. What lies outside is cut off.
pub(super) struct Canvas(pub(super) RgbImage);

impl Canvas {
    /// A sheet of one colour.
    pub(super) fn new(width: u32, height: u32, colour: Colour) -> Self {
        Self(RgbImage::from_pixel(width, height, Rgb(colour)))
    }

    /// Sets a dot.
    pub(super) fn dot(&mut self, x: i64, y: i64, colour: Colour) {
        if x >= 0 && y >= 0 && x < i64::from(self.0.width()) && y < i64::from(self.0.height()) {
            self.0.put_pixel(x as u32, y as u32, Rgb(colour));
        }
    }

    /// Fills a rectangle.
    pub(super) fn fill(&mut self, x: i64, y: i64, width: i64, height: i64, colour: Colour) {
        for row in y..y + height {
            for column in x..x + width {
                self.dot(column, row, colour);
            }
        }
    }

    /// Draws the edge of a rectangle, two dots wide.
    pub(super) fn frame(&mut self, x: i64, y: i64, width: i64, height: i64, colour: Colour) {
        self.fill(x, y, width, 2, colour);
        self.fill(x, y + height - 2, width, 2, colour);
        self.fill(x, y, 2, height, colour);
        self.fill(x + width - 2, y, 2, height, colour);
    }

    /// Writes a text with its upper left corner at x, y; a dot of a letter is `scale` dots wide. Returns where it ends.
    pub(super) fn text(&mut self, x: i64, y: i64, scale: i64, colour: Colour, text: &str) -> i64 {
        let mut left = x;
        for letter in text.chars() {
            for (column, bits) in font::dots(letter).into_iter().enumerate() {
                for row in (0..8).filter(|row| bits >> row & 1 == 1) {
                    self.fill(left + column as i64 * scale, y + row * scale, scale, scale, colour);
                }
            }
            left += (font::COLUMNS as i64 + 1) * scale;
        }
        left
    }
}
