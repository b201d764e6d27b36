//! A sheet to draw on: rectangles, lines, letters, pictures.

use embedded_graphics::Drawable;
use embedded_graphics::Pixel;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size as Extent};
use embedded_graphics::mono_font::iso_8859_1::{FONT_9X15, FONT_10X20};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::primitives::{Polyline, Primitive, PrimitiveStyle};
use embedded_graphics::text::{Baseline, Text};
use image::{Rgb, RgbImage};

/// A colour.
pub type Colour = [u8; 3];

/// Size of letters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// 9 by 15 dots.
    Body,
    /// 10 by 20 dots.
    Heading,
}

impl Size {
    fn font(self) -> &'static MonoFont<'static> {
        match self {
            Self::Body => &FONT_9X15,
            Self::Heading => &FONT_10X20,
        }
    }

    /// Width of a text in dots.
    pub fn width(self, text: &str) -> i64 {
        text.chars().count() as i64 * i64::from(self.font().character_size.width)
    }
}

/// A sheet to draw on. What lies outside is cut off.
#[derive(Debug, Clone, PartialEq)]
pub struct Canvas(pub RgbImage);

impl Canvas {
    /// A sheet of one colour.
    pub fn new(width: u32, height: u32, colour: Colour) -> Self {
        Self(RgbImage::from_pixel(width, height, Rgb(colour)))
    }

    /// Sets a dot.
    pub fn dot(&mut self, x: i64, y: i64, colour: Colour) {
        if x >= 0 && y >= 0 && x < i64::from(self.0.width()) && y < i64::from(self.0.height()) {
            self.0.put_pixel(x as u32, y as u32, Rgb(colour));
        }
    }

    /// Fills a rectangle.
    pub fn fill(&mut self, x: i64, y: i64, width: i64, height: i64, colour: Colour) {
        for row in y..y + height {
            for column in x..x + width {
                self.dot(column, row, colour);
            }
        }
    }

    /// Draws the edge of a rectangle, two dots wide.
    pub fn frame(&mut self, x: i64, y: i64, width: i64, height: i64, colour: Colour) {
        self.fill(x, y, width, 2, colour);
        self.fill(x, y + height - 2, width, 2, colour);
        self.fill(x, y, 2, height, colour);
        self.fill(x + width - 2, y, 2, height, colour);
    }

    /// Draws lines from point to point.
    pub fn lines(&mut self, points: &[(i64, i64)], width: u32, colour: Colour) {
        let points: Vec<Point> = points.iter().map(|&(x, y)| Point::new(x as i32, y as i32)).collect();
        let style = PrimitiveStyle::with_stroke(rgb(colour), width);
        let Ok(()) = Polyline::new(&points).into_styled(style).draw(self);
    }

    /// Writes a text with its upper left corner at x, y. Returns where it ends.
    pub fn text(&mut self, x: i64, y: i64, size: Size, colour: Colour, text: &str) -> i64 {
        let style = MonoTextStyle::new(size.font(), rgb(colour));
        let Ok(end) = Text::with_baseline(text, Point::new(x as i32, y as i32), style, Baseline::Top).draw(self);
        i64::from(end.x)
    }
}

fn rgb([r, g, b]: Colour) -> Rgb888 {
    Rgb888::new(r, g, b)
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Extent {
        Extent::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = std::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Self::Error> {
        for Pixel(point, colour) in pixels {
            self.dot(point.x.into(), point.y.into(), [colour.r(), colour.g(), colour.b()]);
        }
        Ok(())
    }
}

/// The colour of a likelihood: likely (255) is dark blue, unlikely (0) glows: violet, red, yellow.
pub fn heat(gray: u8) -> Colour {
    const STOPS: [[f64; 3]; 5] =
        [[252.0, 250.0, 170.0], [246.0, 140.0, 20.0], [190.0, 45.0, 85.0], [85.0, 15.0, 110.0], [12.0, 12.0, 40.0]];
    let place = f64::from(gray) / 255.0 * (STOPS.len() - 1) as f64;
    let stop = (place as usize).min(STOPS.len() - 2);
    let part = place - stop as f64;
    [0, 1, 2].map(|c| (STOPS[stop][c] * (1.0 - part) + STOPS[stop + 1][c] * part) as u8)
}
