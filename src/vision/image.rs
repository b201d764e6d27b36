//! Gray images as the method sees them: rows are camera lines, columns are sensor pixels.

/// A gray image, row after row.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct GrayImage {
    width: usize,
    pixels: Vec<u8>,
}

impl GrayImage {
    /// An image of `pixels.len() / width` lines; `None` if that is no whole number of lines.
    pub fn new(width: usize, pixels: Vec<u8>) -> Option<Self> {
        (width > 0 && pixels.len().is_multiple_of(width)).then_some(Self { width, pixels })
    }

    /// A black image.
    pub fn black(width: usize, lines: usize) -> Self {
        Self { width, pixels: vec![0; width * lines] }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Lines.
    pub fn lines(&self) -> usize {
        self.pixels.len() / self.width.max(1)
    }

    /// The gray values of one line.
    pub fn line(&self, line: usize) -> &[u8] {
        &self.pixels[line * self.width..(line + 1) * self.width]
    }

    /// The gray values of one line, to write to.
    pub fn line_mut(&mut self, line: usize) -> &mut [u8] {
        &mut self.pixels[line * self.width..(line + 1) * self.width]
    }

    /// The same image with so many lines, cut or black at its end. Without columns it stays without lines.
    pub fn with_lines(mut self, lines: usize) -> Self {
        self.pixels.resize(self.width * lines, 0);
        self
    }

    /// All gray values, row after row.
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }
}
