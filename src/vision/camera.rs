//! Pushbroom projection: orthographic along the rope, perspective across it. [Wacker13, sec. 3.2, eq. 4-5]

/// A line camera that looks at the rope axis.
///
/// The paper sets f = 1 and rescales to the rope's known width in pixels; the two numbers left are the scale at the axis and d.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// The camera stands where strands of this phase are nearest, in rad.
    pub angle_rad: f64,
    /// Distance d from the camera to the rope axis in mm.
    pub distance_mm: f64,
    /// Pixels per mm at the distance of the rope axis (f/d).
    pub px_per_mm: f64,
}

impl Camera {
    /// Phase of the rope axes, seen from this camera.
    pub fn phase_in_view(&self, phase_rad: f64) -> f64 {
        phase_rad - self.angle_rad
    }

    /// Column, counted from the column of the rope axis, of a point (y, z) in mm in this view's axes (eq. 5).
    pub fn column_px(&self, y_mm: f64, z_mm: f64) -> f64 {
        self.px_per_mm * y_mm / (1.0 + z_mm / self.distance_mm)
    }

    /// Columns where the outline of a circle begins and ends: the circle of `radius_mm` about (y, z), in this view's axes.
    ///
    /// Figure 3b and eq. 6: the outline is where the line of sight touches the circle, not where the circle is widest.
    pub fn outline_px(&self, y_mm: f64, z_mm: f64, radius_mm: f64) -> (f64, f64) {
        let depth_mm = self.distance_mm + z_mm;
        let centre_rad = (y_mm / depth_mm).atan();
        let half_rad = (radius_mm / y_mm.hypot(depth_mm)).asin();
        let f_px = self.px_per_mm * self.distance_mm;
        (f_px * (centre_rad - half_rad).tan(), f_px * (centre_rad + half_rad).tan())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_far_camera_sees_orthographically() {
        let camera = Camera { angle_rad: 0.0, distance_mm: 1e7, px_per_mm: 10.0 };
        let (from, to) = camera.outline_px(3.0, -2.0, 1.0);
        assert!((from - 20.0).abs() < 1e-3 && (to - 40.0).abs() < 1e-3);
        assert!((camera.column_px(3.0, -2.0) - 30.0).abs() < 1e-3);
    }

    #[test]
    fn a_near_strand_looks_larger_than_a_far_one() {
        let camera = Camera { angle_rad: 0.0, distance_mm: 300.0, px_per_mm: 10.0 };
        let width = |z| {
            let (from, to) = camera.outline_px(0.0, z, 5.0);
            to - from
        };
        assert!(width(-10.0) > width(10.0) * 1.05);
    }
}
