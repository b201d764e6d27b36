//! What the camera sees beside the rope.

use super::recipe::Background;

/// The background of one view, in gray levels before the sensor.
#[derive(Debug, Clone, Copy)]
pub struct Backdrop {
    kind: Background,
    sensor_px: f64,
    side: f64,
}

impl Backdrop {
    /// The backdrop of a view; the light comes from alternating sides.
    pub fn new(kind: Background, sensor_px: u32, view: usize) -> Self {
        Self { kind, sensor_px: f64::from(sensor_px), side: if view.is_multiple_of(2) { 1.0 } else { -1.0 } }
    }

    /// Gray level at a column; the outline of the rope is from `low_px` to `high_px`.
    pub fn gray(&self, column_px: f64, low_px: f64, high_px: f64) -> f32 {
        let across = self.side * (column_px / self.sensor_px - 0.5); // -0.5..0.5
        let gray = match self.kind {
            Background::Dark => {
                let glow = if across > 0.41 { 9.0 } else { 0.0 }; // the wall of the camera head catches some light
                6.5 + 1.5 * across + glow
            }
            Background::Bright => 196.0 + 60.0 * across,
            Background::Shadow => {
                let (edge, outward) = if self.side > 0.0 { (high_px, 1.0) } else { (low_px, -1.0) };
                let away = outward * (column_px - edge) - 6.0;
                let shadow = if away > -20.0 { (1.0 - (away / 28.0).abs()).clamp(0.0, 1.0) } else { 0.0 };
                (190.0 + 40.0 * across) * (1.0 - 0.72 * shadow.sqrt())
            }
        };
        gray as f32
    }
}
