//! What every ray of a line meets first: the visible wire, or the darkness between the wires. Occlusion is exact in the cut.

use super::camera::Camera;
use super::cross_section::CrossSection;
use super::defects::Defect;
use crate::vision::rope::Rope;
use std::f64::consts::PI;

/// Rays per pixel across the sensor.
pub const RAYS_PER_PX: usize = 2;
/// What a ray met.
pub type SurfaceId = u16;
/// Nothing but background.
pub const BACKGROUND: SurfaceId = u16::MAX;
/// The core of the rope.
pub const ROPE_CORE: SurfaceId = u16::MAX - 1;
/// First of the strand cores (strand j is this plus j); below are the wires, strand by strand.
pub const STRAND_CORES: SurfaceId = 1024;

/// The rays of one line and what they meet.
#[derive(Debug, Clone)]
pub struct Trace {
    /// Slope y/(z+d) of every ray.
    pub slope: Vec<f32>,
    /// 1 / (1 + slope^2) of every ray.
    lean: Vec<f32>,
    /// What it meets.
    pub id: Vec<SurfaceId>,
    /// Where: depth z + d in mm.
    pub depth: Vec<f32>,
    /// Where the wire would be that a defect took away: its depth, and the defect's index.
    pub ghost: Vec<(f32, u16)>,
    /// Outermost points of the rope, in rays (as a real number), lower and upper.
    pub outline: (f64, f64),
}

/// How far behind the widest place something may lie and still be seen, in rope radii.
const DEEPEST: f64 = 0.35;
/// The same for wires in their strand: wires further back are hidden by their strand's core and front.
const DEEPEST_IN_STRAND: f64 = 0.55;

/// Angle of (sin, cos) in rad from -pi to pi; error below 0.0003.
pub fn fast_angle(sin: f32, cos: f32) -> f32 {
    let (a, b) = (sin.abs(), cos.abs());
    let q = a.min(b) / a.max(b).max(1e-20);
    let s = q * q;
    let mut angle = ((-0.046_496_475 * s + 0.159_314_22) * s - 0.327_622_76) * s * q + q;
    if a > b {
        angle = std::f32::consts::FRAC_PI_2 - angle;
    }
    if cos < 0.0 {
        angle = std::f32::consts::PI - angle;
    }
    angle.copysign(sin)
}

impl Trace {
    /// Rays for a sensor.
    pub fn new(camera: &Camera, sensor_px: u32) -> Self {
        let rays = sensor_px as usize * RAYS_PER_PX;
        let slope: Vec<f32> =
            (0..rays).map(|s| ((column_of(s as f64) - camera.axis_px) / camera.focal_px) as f32).collect();
        Self {
            lean: slope.iter().map(|s| 1.0 / (1.0 + s * s)).collect(),
            slope,
            id: vec![BACKGROUND; rays],
            depth: vec![f32::INFINITY; rays],
            ghost: vec![(f32::INFINITY, 0); rays],
            outline: (0.0, 0.0),
        }
    }

    /// Follows every ray of a line. `near` are the defects that may reach it.
    pub fn follow(&mut self, camera: &Camera, rope: &Rope, cut: &CrossSection, near: &[(usize, &Defect)]) {
        self.id.fill(BACKGROUND);
        self.depth.fill(f32::INFINITY);
        if !near.is_empty() {
            self.ghost.fill((f32::INFINITY, 0));
        }
        let mut outline = (f64::INFINITY, f64::NEG_INFINITY);
        let radius = rope.diameter_mm() / 2.0;
        let core_mm = (rope.strand_curve_radius_mm() - 0.75 * rope.strand_radius_mm()).max(0.05 * radius);
        self.meet(camera, cut.axis, core_mm, ROPE_CORE);
        for (j, strand) in cut.strands.iter().enumerate() {
            if strand.z - cut.axis.1 < DEEPEST * radius + rope.strand_radius_mm() {
                let core_mm = (rope.wire_curve_radius_mm() - 0.9 * rope.wire_radius_mm()).max(rope.wire_radius_mm());
                self.meet(camera, (strand.y, strand.z), core_mm, STRAND_CORES + j as u16);
            }
        }
        for (w, wire) in cut.wires.iter().enumerate() {
            let behind = wire.z - cut.axis.1 > DEEPEST * radius
                || wire.z - cut.strands[wire.strand].z > DEEPEST_IN_STRAND * rope.wire_curve_radius_mm();
            if behind && wire.moved.is_none() {
                continue;
            }
            let broken = near.iter().find(|(_, d)| d.strand == wire.strand && d.wire == wire.wire && d.breaks_wire());
            let seen = match broken {
                None => Some(self.meet(camera, (wire.y, wire.z), rope.wire_radius_mm(), w as u16)),
                Some((index, defect)) => self.meet_broken(camera, rope, cut, w, *index, defect),
            };
            if let Some((low, high)) = seen {
                outline = (outline.0.min(low), outline.1.max(high));
            }
        }
        self.outline = outline;
        self.fill_valleys();
    }

    /// Rays between the wires that met nothing end in the dark inside of the rope.
    fn fill_valleys(&mut self) {
        let first = self.id.iter().position(|&id| id == ROPE_CORE || id >= STRAND_CORES && id != BACKGROUND);
        let last = self.id.iter().rposition(|&id| id == ROPE_CORE || id >= STRAND_CORES && id != BACKGROUND);
        if let (Some(first), Some(last)) = (first, last) {
            for id in &mut self.id[first..=last] {
                if *id == BACKGROUND {
                    *id = ROPE_CORE;
                }
            }
        }
    }

    /// Lets a circle catch its rays. Returns its outline in rays.
    fn meet(&mut self, camera: &Camera, centre: (f64, f64), radius_mm: f64, id: SurfaceId) -> (f64, f64) {
        let (low, high) = camera.outline_px(centre.0, centre.1, radius_mm);
        let (low, high) = (ray_of(low), ray_of(high));
        let w = (centre.1 + camera.distance_mm) as f32;
        let y = centre.0 as f32;
        let r = radius_mm as f32;
        let rays = rays_within(low, high, self.id.len());
        let ends = self.depth[rays.clone()].iter_mut().zip(&mut self.id[rays.clone()]);
        let directions = self.slope[rays.clone()].iter().zip(&self.lean[rays]);
        for ((nearest, nearest_id), (&slope, &lean)) in ends.zip(directions) {
            let depth = first_meeting(slope, lean, y, w, r);
            let nearer = depth < *nearest;
            *nearest = if nearer { depth } else { *nearest };
            *nearest_id = if nearer { id } else { *nearest_id };
        }
        (low, high)
    }

    /// The same for a wire with a gap; rays through the gap pass on and leave a ghost. `None` if all of it is gone.
    fn meet_broken(
        &mut self,
        camera: &Camera,
        rope: &Rope,
        cut: &CrossSection,
        w: usize,
        index: usize,
        defect: &Defect,
    ) -> Option<(f64, f64)> {
        let wire = cut.wires[w];
        let (low, high) = camera.outline_px(wire.y, wire.z, rope.wire_radius_mm());
        let (low, high) = (ray_of(low), ray_of(high));
        let (y, depth, r) = (wire.y as f32, (wire.z + camera.distance_mm) as f32, rope.wire_radius_mm() as f32);
        let mut any = false;
        for s in rays_within(low, high, self.id.len()) {
            let met = first_meeting(self.slope[s], self.lean[s], y, depth, r);
            let (ny, nz) = ((self.slope[s] * met - y) / r, (met - depth) / r);
            let psi = wrap(f64::from(fast_angle(ny, -nz)) - wire.phase_rad);
            if defect.gap_at(cut.x_mm, psi) {
                if met < self.ghost[s].0 {
                    self.ghost[s] = (met, index as u16);
                }
            } else {
                any = true;
                if met < self.depth[s] {
                    (self.depth[s], self.id[s]) = (met, w as u16);
                }
            }
        }
        any.then_some((low, high))
    }
}

/// Depth z + d at which the ray first meets a circle (its nearest approach for rays that just miss).
#[inline]
fn first_meeting(slope: f32, lean: f32, y: f32, w: f32, r: f32) -> f32 {
    // the distance of the centre from the ray is well conditioned, unlike the textbook discriminant in f32
    let off = y - slope * w;
    let behind = (r * r - off * off * lean).max(0.0);
    w + slope * off * lean - (behind * lean).sqrt()
}

/// Angle wrapped to -pi..pi.
pub fn wrap(angle_rad: f64) -> f64 {
    let turns = angle_rad / (2.0 * PI);
    (turns - turns.round()) * 2.0 * PI
}

/// Column of a ray.
fn column_of(ray: f64) -> f64 {
    (ray + 0.5) / RAYS_PER_PX as f64 - 0.5
}

/// Ray of a column.
fn ray_of(column_px: f64) -> f64 {
    (column_px + 0.5) * RAYS_PER_PX as f64 - 0.5
}

fn rays_within(low: f64, high: f64, rays: usize) -> std::ops::Range<usize> {
    let first = low.ceil().max(0.0) as usize;
    let end = (high.floor() + 1.0).clamp(0.0, rays as f64) as usize;
    first.min(end)..end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Recipe, Scene};

    #[test]
    fn the_fast_angle_is_an_angle() {
        for k in 0..1000 {
            let angle = 0.999 * std::f32::consts::PI * (k as f32 / 500.0 - 1.0);
            assert!((fast_angle(angle.sin(), angle.cos()) - angle).abs() < 1e-3, "{angle}");
        }
    }

    #[test]
    fn a_ray_meets_the_near_side_of_a_circle() {
        let depth = first_meeting(0.1, 1.0 / 1.01, 20.0, 200.0, 3.0); // through its centre: 3 mm before, along the ray
        assert!((depth - (200.0 - 3.0 / 1.01_f32.sqrt())).abs() < 1e-3, "{depth}");
    }

    #[test]
    fn every_ray_inside_the_outline_meets_something_and_none_outside() {
        let scene = Scene::new(&Recipe::photographic(), 4).unwrap();
        let mut cut = CrossSection::default();
        let mut trace = Trace::new(scene.camera(), 480);
        for line in (0..5000).step_by(250) {
            cut.cut(&scene, 2, line, &[]);
            trace.follow(scene.camera(), scene.rope(), &cut, &[]);
            let (low, high) = trace.outline;
            assert!(high - low > 680.0 && high - low < 762.0, "{low} {high}");
            for s in 0..trace.id.len() {
                let inside = s as f64 >= low && s as f64 <= high;
                assert_eq!(trace.id[s] != BACKGROUND, inside, "line {line} ray {s}");
            }
        }
    }
}
