//! The line camera of a view: perspective along the sensor, one line per step along the rope. [Wacker13, eq. 4-5]

/// A pinhole at `distance_mm` from the nominal rope axis, looking along +z of the view's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Camera to nominal rope axis, d, in mm.
    pub distance_mm: f64,
    /// Pixels per unit of y/(z + d).
    pub focal_px: f64,
    /// Column of the nominal rope axis: the middle of the sensor, pixel centres at whole numbers.
    pub axis_px: f64,
}

impl Camera {
    /// The camera that shows a cylinder of the rope's diameter `rope_width_px` wide.
    ///
    /// The paper rescales the projection to the known width in the image; here the focal length does that.
    pub fn fitting(distance_mm: f64, rope_diameter_mm: f64, rope_width_px: f64, sensor_px: u32) -> Self {
        let radius_mm = rope_diameter_mm / 2.0;
        let edge = radius_mm / (distance_mm * distance_mm - radius_mm * radius_mm).sqrt();
        Self { distance_mm, focal_px: rope_width_px / 2.0 / edge, axis_px: f64::from(sensor_px - 1) / 2.0 }
    }

    /// Column of a point (y, z) of the view's axes in mm.
    pub fn column_px(&self, y_mm: f64, z_mm: f64) -> f64 {
        self.axis_px + self.focal_px * y_mm / (z_mm + self.distance_mm)
    }

    /// Columns between which a circle is seen: where rays touch it. [Wacker13, eq. 6, fig. 3b]
    pub fn outline_px(&self, y_mm: f64, z_mm: f64, radius_mm: f64) -> (f64, f64) {
        let w = z_mm + self.distance_mm;
        let root = radius_mm * (y_mm * y_mm + w * w - radius_mm * radius_mm).max(0.0).sqrt();
        let scale = self.focal_px / (w * w - radius_mm * radius_mm);
        (self.axis_px + (y_mm * w - root) * scale, self.axis_px + (y_mm * w + root) * scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cylinder_of_the_rope_has_the_width_asked_for() {
        let camera = Camera::fitting(224.0, 32.0, 380.0, 480);
        let (low, high) = camera.outline_px(0.0, 0.0, 16.0);
        assert!((high - low - 380.0).abs() < 1e-9 && (high + low - 479.0).abs() < 1e-9);
    }

    #[test]
    fn the_outline_touches_the_circle() {
        let camera = Camera::fitting(100.0, 20.0, 380.0, 480);
        let (y, z, r) = (6.0, -3.0, 2.5);
        let (_, high) = camera.outline_px(y, z, r);
        let most = (0..36_000)
            .map(|k| f64::from(k) / 36_000.0 * std::f64::consts::TAU)
            .map(|a| camera.column_px(y + r * a.cos(), z + r * a.sin()))
            .fold(f64::MIN, f64::max);
        assert!((high - most).abs() < 1e-4, "{high} {most}");
    }
}
