//! The cut through the rope at one line, in the axes of one view: a circle per strand and per wire. [Wacker13, eq. 1]

use super::defects::Defect;
use super::scene::Scene;
use super::trace::wrap;
use crate::vision::strand::on_circle;

/// A strand where the cut meets it.
#[derive(Debug, Clone, Copy, Default)]
pub struct StrandCut {
    /// Centre in mm.
    pub y: f64,
    /// Centre in mm, away from the camera.
    pub z: f64,
    /// Phase in the axes of the view in rad, -pi..pi.
    pub phase_rad: f64,
}

/// A wire where the cut meets it.
#[derive(Debug, Clone, Copy, Default)]
pub struct WireCut {
    /// Centre in mm.
    pub y: f64,
    /// Centre in mm, away from the camera.
    pub z: f64,
    /// Phase in the axes of the view in rad, -pi..pi.
    pub phase_rad: f64,
    /// Direction of the wire: (1, tangent_y, tangent_z) is along it.
    pub tangent_y: f64,
    /// See `tangent_y`.
    pub tangent_z: f64,
    /// Strand it belongs to.
    pub strand: usize,
    /// Its number in the strand.
    pub wire: usize,
    /// The defect that moved it (index into the defects given), and how far in mm.
    pub moved: Option<(usize, f64)>,
}

/// All circles of one line.
#[derive(Debug, Clone, Default)]
pub struct CrossSection {
    /// True position along the rope in mm.
    pub x_mm: f64,
    /// Rope axis (y, z) in mm.
    pub axis: (f64, f64),
    /// The strands, in order.
    pub strands: Vec<StrandCut>,
    /// The wires, strand by strand.
    pub wires: Vec<WireCut>,
}

impl CrossSection {
    /// Cuts the rope at a line. `near` are the defects that may reach it, each with its index.
    pub fn cut(&mut self, scene: &Scene, view: usize, line: usize, near: &[(usize, &Defect)]) {
        let rope = scene.rope();
        let x = scene.x_mm(line);
        let angle = scene.view_angle_rad(view);
        let axis = scene.axis_in_view_mm(line, view);
        self.x_mm = x;
        self.axis = axis;
        self.strands.clear();
        self.wires.clear();
        let (r_s, r_w) = (scene.strand_curve_radius_mm(x), rope.wire_curve_radius_mm());
        let strand_rate = scene.strand.rad_per_mm(x);
        let (step_sin, step_cos) = rope.wire_step_rad().sin_cos();
        for j in 0..rope.strands() {
            let phase = scene.strand_phase_rad(j, x) - angle;
            let (y, z) = on_circle(r_s, phase);
            let oval = scene.oval_offset_mm(x, phase + angle, angle);
            let (y, z) = (y + oval.0, z + oval.1);
            let rate = strand_rate + scene.strand_jitter[j].slope(x);
            let (strand_ty, strand_tz) = (-z * rate, y * rate); // d/dphase of (sin, -cos)
            self.strands.push(StrandCut { y: y + axis.0, z: z + axis.1, phase_rad: wrap(phase) });
            let wire_phase = scene.wires[j].phase_rad(x) - angle;
            let wire_rate = scene.wires[j].rad_per_mm(x);
            let (mut sin, mut cos) = wire_phase.sin_cos();
            for i in 0..rope.wires() {
                self.wires.push(WireCut {
                    y: y + axis.0 + r_w * sin,
                    z: z + axis.1 - r_w * cos,
                    phase_rad: wrap(wire_phase + i as f64 * rope.wire_step_rad()),
                    tangent_y: strand_ty + r_w * cos * wire_rate,
                    tangent_z: strand_tz + r_w * sin * wire_rate,
                    strand: j,
                    wire: i,
                    moved: None,
                });
                (sin, cos) = (sin * step_cos + cos * step_sin, cos * step_cos - sin * step_sin);
            }
        }
        for &(index, defect) in near {
            let Some((lift_mm, turn_rad)) = defect.moves_wire(x, rope.wire_radius_mm()) else { continue };
            let strand = self.strands[defect.strand];
            let wire = &mut self.wires[defect.strand * rope.wires() + defect.wire];
            let (dy, dz) = on_circle(r_w + lift_mm, wire.phase_rad + turn_rad);
            let (y, z) = (strand.y + dy, strand.z + dz);
            wire.moved = Some((index, (y - wire.y).hypot(z - wire.z)));
            (wire.y, wire.z) = (y, z);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Recipe;
    use crate::vision::strand::StrandHelix;
    use crate::vision::wire::{WireHelix, wire_centre};

    #[test]
    fn wires_are_where_equation_1_puts_them() {
        let recipe = Recipe {
            strand_lay_drift_mm: 0.0,
            wire_lay_drift_mm: 0.0,
            strand_jitter_rad: 0.0,
            oscillation_px: 0.0,
            encoder_jitter_mm: 0.0,
            ..Recipe::photographic()
        };
        let scene = Scene::new(&recipe, 2).unwrap();
        let strand = StrandHelix { lay_length_mm: 220.0, offset_rad: scene.strand.phase_rad(0.0) };
        let wire = WireHelix { lay_length_mm: -95.0, offset_rad: scene.wires[4].phase_rad(0.0) };
        let mut cut = CrossSection::default();
        cut.cut(&scene, 0, 777, &[]);
        let (_, y, z) = wire_centre(scene.rope(), strand, wire, 4, 7, 77.7);
        let found = cut.wires[4 * 9 + 7];
        assert!((found.y - y).abs() < 1e-9 && (found.z - z).abs() < 1e-9);
        // tangent against a difference quotient
        let (_, y2, z2) = wire_centre(scene.rope(), strand, wire, 4, 7, 77.701);
        assert!((found.tangent_y - (y2 - y) / 0.001).abs() < 1e-4);
        assert!((found.tangent_z - (z2 - z) / 0.001).abs() < 1e-4);
        // the view at 90 degrees sees y where view 0 has z
        cut.cut(&scene, 1, 777, &[]);
        assert!((cut.wires[4 * 9 + 7].y - z).abs() < 1e-9);
    }
}
