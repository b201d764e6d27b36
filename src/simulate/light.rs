//! Lamps of a camera head and how wire answers: Lambert and a highlight that is narrow across the wire and wide along it.

use super::cross_section::CrossSection;
use super::finish::Coat;
use super::foreign::Cover;
use crate::vision::rope::Rope;

type Vector = [f32; 3];

fn dot(a: Vector, b: Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(v: Vector) -> Vector {
    let shrink = 1.0 / dot(v, v).sqrt();
    v.map(|c| c * shrink)
}

/// A lamp in the axes of the view: (along the rope, along the sensor, away from the camera).
#[derive(Debug, Clone, Copy)]
struct Lamp {
    to_lamp: Vector,
    halfway: Vector,
    in_cut: [f32; 2],
    strength: f32,
}

/// All lamps of a view.
#[derive(Debug, Clone)]
pub struct Lamps([Lamp; 3]);

/// Light that comes from everywhere.
const AMBIENT: f32 = 0.16;
/// How narrow highlights of foreign matter are: an exponent.
const COVER_SHARPNESS: i32 = 45;
/// Directions and strengths: two lamps beside the camera, a weaker one above it.
const LAMPS: [(Vector, f32); 3] =
    [([0.28, -0.62, -0.75], 0.52), ([-0.22, 0.58, -0.80], 0.44), ([0.05, 0.06, -1.0], 0.30)];

/// What the lamps see of a wire at one line: constant along the wire's cut.
#[derive(Debug, Clone, Copy, Default)]
pub struct WireLight {
    tangent: Vector,
    along: [f32; 3],
}

/// Shadows that neighbouring strands cast within the cut.
#[derive(Debug, Clone, Default)]
pub struct Shadows {
    strands: Vec<(usize, f32, f32)>,
    /// Share of light per mm from the shadow's middle line.
    soft: f32,
}

/// Shadows begin this far inside a strand's outline, as a share of light (negative) ...
const SHADOW_START: f32 = -0.78 / 0.34;
/// ... and this much light is left in them.
const SHADOW_LEFT: f32 = 0.10;

impl Lamps {
    /// The lamps of every camera head; `spread` is how far they stand to its sides, about 1.
    pub fn new(spread: f32) -> Self {
        Self(LAMPS.map(|(direction, strength)| {
            let to_lamp = unit([direction[0], direction[1] * spread, direction[2]]);
            let in_cut = (to_lamp[1] * to_lamp[1] + to_lamp[2] * to_lamp[2]).sqrt();
            Lamp {
                to_lamp,
                halfway: unit([to_lamp[0], to_lamp[1], to_lamp[2] - 1.0]),
                in_cut: [to_lamp[1] / in_cut, to_lamp[2] / in_cut],
                strength,
            }
        }))
    }

    /// Prepares a wire with direction (1, tangent_y, tangent_z).
    pub fn on_wire(&self, tangent_y: f64, tangent_z: f64) -> WireLight {
        let tangent = unit([1.0, tangent_y as f32, tangent_z as f32]);
        let along = self.0.map(|lamp| {
            let t = dot(tangent, lamp.halfway);
            let s = (1.0 - t * t).max(0.0);
            (s * s) * (s * s) * (s * s) // wide along the wire: the lamps are long
        });
        WireLight { tangent, along }
    }

    /// Light from a point of a wire with normal (y, z) in the cut, relative to white paper facing the lamps.
    pub fn shade(&self, wire: &WireLight, normal: [f32; 2], coat: &Coat, openness: f32, lit: [f32; 3]) -> f32 {
        let lean = normal[0] * wire.tangent[1] + normal[1] * wire.tangent[2];
        let n = unit([-lean * wire.tangent[0], normal[0] - lean * wire.tangent[1], normal[1] - lean * wire.tangent[2]]);
        let mut diffuse = AMBIENT * (0.55 - 0.45 * n[2]);
        let mut highlight = 0.0;
        for (k, lamp) in self.0.iter().enumerate() {
            let strength = lit[k];
            diffuse += strength * dot(n, lamp.to_lamp).max(0.0);
            let h = dot(n, lamp.halfway);
            if h > 0.5 {
                let h2 = h * h;
                let h4 = h2 * h2;
                let h8 = h4 * h4;
                let h16 = h8 * h8;
                highlight += strength * wire.along[k] * h8 * (0.16 + 0.60 * h16 * h8);
            }
        }
        openness * (0.55 * diffuse * coat.albedo + highlight * coat.gloss)
    }

    /// Light where foreign matter lies on a wire that would answer with `of_wire`. The rope's surface faces `outward` (y, z) in the cut.
    pub fn on_cover(&self, cover: &Cover, of_wire: f32, outward: [f32; 2], lit: [f32; 3]) -> f32 {
        let [along, round] = cover.lean;
        let n = unit([along, outward[0] - round * outward[1], outward[1] + round * outward[0]]);
        let mut diffuse = AMBIENT * (0.55 - 0.45 * n[2]);
        let mut highlight = 0.0;
        for (lamp, strength) in self.0.iter().zip(lit) {
            diffuse += strength * dot(n, lamp.to_lamp).max(0.0);
            highlight += strength * dot(n, lamp.halfway).max(0.0).powi(COVER_SHARPNESS);
        }
        of_wire + cover.share * (0.55 * diffuse * cover.albedo - of_wire) + highlight * cover.gleam
    }
}

impl Shadows {
    /// Takes the strands of a cut.
    pub fn prepare(&mut self, rope: &Rope, cut: &CrossSection) {
        self.soft = 1.0 / (0.34 * rope.strand_radius_mm() as f32);
        self.strands.clear();
        let near =
            cut.strands.iter().enumerate().filter(|(_, s)| s.z - cut.axis.1 < 0.6 * rope.strand_curve_radius_mm());
        self.strands.extend(near.map(|(j, s)| (j, s.y as f32, s.z as f32)));
    }

    /// Strength of each lamp at a point of a strand, with soft shadows.
    pub fn lit(&self, lamps: &Lamps, strand: usize, point: [f32; 2]) -> [f32; 3] {
        lamps.0.map(|lamp| {
            let mut lit = lamp.strength;
            for &(j, y, z) in &self.strands {
                if j == strand {
                    continue;
                }
                let away = [y - point[0], z - point[1]];
                let ahead = away[0] * lamp.in_cut[0] + away[1] * lamp.in_cut[1];
                if ahead > 0.0 {
                    let beside = (away[0] * lamp.in_cut[1] - away[1] * lamp.in_cut[0]).abs();
                    lit *= (beside * self.soft + SHADOW_START).clamp(SHADOW_LEFT, 1.0);
                }
            }
            lit
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wire_is_brightest_where_it_faces_camera_and_lamps() {
        let lamps = Lamps::new(1.0);
        let wire = lamps.on_wire(0.1, 0.0);
        let coat = Coat { albedo: 1.0, gloss: 1.0, flat: 0.0, cover: None };
        let gray = |angle: f32| lamps.shade(&wire, [angle.sin(), -angle.cos()], &coat, 1.0, [0.52, 0.44, 0.30]);
        assert!(gray(0.0) > 1.3 * gray(0.9) && gray(0.0) > 1.3 * gray(-0.9));
        assert!(gray(0.0) < 1.2 && gray(1.5) > 0.02);
    }
}
