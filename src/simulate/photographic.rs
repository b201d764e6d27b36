//! The photographic kind: round wires under lamps, line by line.

use super::background::Backdrop;
use super::cross_section::CrossSection;
use super::defects::{self, Defect};
use super::finish::{Coat, Place, inner_layer};
use super::light::{Lamps, Shadows, WireLight};
use super::noise::{GaussianStream, Stream};
use super::scene::Scene;
use super::trace::{BACKGROUND, RAYS_PER_PX, ROPE_CORE, STRAND_CORES, Trace, fast_angle, wrap};

/// Gray level of a well lit surface of albedo 1 at exposure 1.
const WHITE: f32 = 215.0;
/// Gray level of the inside of the rope.
const INSIDE: f32 = 9.0;

/// Renders one frame.
pub fn render(scene: &Scene, view: usize, frame: usize) -> Vec<u8> {
    let width = scene.recipe().sensor_px as usize;
    let (first, height) = (scene.first_line(frame), scene.frame_height(frame));
    let mut pixels = vec![0; width * height];
    let mut noise = GaussianStream::new(scene.seed(), Stream::Frame { view, frame });
    let near = defects::near(scene.defects(), scene.x_mm(first), scene.x_mm(first + height));
    let mut line = LinePainter::new(scene, view);
    for (row, pixels) in pixels.chunks_exact_mut(width).enumerate() {
        line.paint(first + row, &near);
        scene.sensors[view].expose(&line.gray, &mut noise, pixels);
    }
    pixels
}

/// Paints the rays of one line after the other.
pub struct LinePainter<'a> {
    scene: &'a Scene,
    view: usize,
    cut: CrossSection,
    trace: Trace,
    shadows: Shadows,
    lamps: Lamps,
    wire_light: Vec<Option<WireLight>>,
    backdrop: Backdrop,
    gray: Vec<f32>,
}

/// Where a ray ends on the rope.
struct Hit {
    place: Place,
    /// Normal (y, z) of the wire in the cut.
    normal: [f32; 2],
    /// The point (y, z) in mm.
    point: [f32; 2],
}

impl<'a> LinePainter<'a> {
    /// A painter for a view.
    pub fn new(scene: &'a Scene, view: usize) -> Self {
        let sensor_px = scene.recipe().sensor_px;
        Self {
            scene,
            view,
            cut: CrossSection::default(),
            trace: Trace::new(scene.camera(), sensor_px),
            shadows: Shadows::default(),
            lamps: Lamps::new(scene.recipe().lamp_spread as f32 * (1.0 + 0.06 * (view as f32 * 2.4).sin())), // no two heads are alike
            wire_light: Vec::new(),
            backdrop: Backdrop::new(scene.recipe().background, sensor_px, view),
            gray: vec![0.0; sensor_px as usize * RAYS_PER_PX],
        }
    }

    /// Cuts and follows the rays of a line. Returns the defects that reach it.
    fn look<'d>(&mut self, line: usize, near: &[(usize, &'d Defect)]) -> Vec<(usize, &'d Defect)> {
        let x_mm = self.scene.x_mm(line);
        let here: Vec<_> = near.iter().filter(|(_, d)| d.reaches(x_mm)).copied().collect();
        self.cut.cut(self.scene, self.view, line, &here);
        self.trace.follow(self.scene.camera(), self.scene.rope(), &self.cut, &here);
        here
    }

    fn paint(&mut self, line: usize, near: &[(usize, &Defect)]) {
        let here = self.look(line, near);
        let scene = self.scene;
        let rope = scene.rope();
        self.shadows.prepare(rope, &self.cut);
        self.wire_light.clear();
        self.wire_light.resize(self.cut.wires.len(), None);
        let mut finish = scene.finish.at_line(self.cut.x_mm);
        let recipe = scene.recipe();
        let level = WHITE * (recipe.exposure * scene.light[self.view].value(line as f64 * recipe.line_pitch_mm)) as f32;
        let rope_radius_mm = rope.diameter_mm() / 2.0;
        let (low, high) = self.trace.outline;
        let column = |ray: f64| (ray + 0.5) / RAYS_PER_PX as f64 - 0.5;
        let (low_px, high_px) = (column(low), column(high));
        for pixel in 0..self.gray.len() / RAYS_PER_PX {
            let rays = pixel * RAYS_PER_PX..(pixel + 1) * RAYS_PER_PX;
            // rays of one pixel that meet the same wire are lit as one: only edges need more
            let alike = self.trace.id[rays.clone()].windows(2).all(|pair| pair[0] == pair[1]);
            let step = if alike { RAYS_PER_PX } else { 1 };
            for first in rays.step_by(step) {
                let gray = match self.trace.id[first] {
                    BACKGROUND => self.backdrop.gray(column(first as f64 + 0.5 * (step as f64 - 1.0)), low_px, high_px),
                    ROPE_CORE => INSIDE,
                    _ => {
                        let Some(hit) = self.hit(first..first + step) else { continue };
                        let mut coat = finish.coat(&hit.place);
                        for (_, defect) in &here {
                            defect.put_on(&mut coat, &hit.place, rope_radius_mm);
                        }
                        self.light_of(first, &hit, &coat) * level + 3.0
                    }
                };
                self.gray[first..first + step].fill(gray);
            }
        }
        self.soften(low, -1, low_px, high_px);
        self.soften(high, 1, low_px, high_px);
    }

    /// The part of the rope that rays of the same id met, in their middle; `None` for background and the inside.
    fn hit(&self, rays: std::ops::Range<usize>) -> Option<Hit> {
        let id = self.trace.id[rays.start];
        if id == BACKGROUND || id == ROPE_CORE {
            return None;
        }
        let rope = self.scene.rope();
        let last = rays.end - 1;
        let slope = 0.5 * (self.trace.slope[rays.start] + self.trace.slope[last]);
        let depth = 0.5 * (self.trace.depth[rays.start] + self.trace.depth[last]);
        let point = [slope * depth, depth - self.scene.camera().distance_mm as f32];
        let (centre, phase_rad, strand, wire) = if id >= STRAND_CORES {
            let j = usize::from(id - STRAND_CORES);
            let strand = self.cut.strands[j];
            ((strand.y, strand.z), strand.phase_rad, j, None)
        } else {
            let wire = &self.cut.wires[usize::from(id)];
            ((wire.y, wire.z), wire.phase_rad, wire.strand, Some(wire.wire))
        };
        let away = [point[0] - centre.0 as f32, point[1] - centre.1 as f32];
        let length = length_of(away);
        let per_mm = 1.0 / length;
        let normal = away.map(|a| a * per_mm);
        let psi_rad = wrap_f32(fast_angle(normal[0], -normal[1]) - phase_rad as f32);
        let strand_cut = self.cut.strands[strand];
        let from_strand = length_of([point[0] - strand_cut.y as f32, point[1] - strand_cut.z as f32]);
        let from_axis = [point[0] - self.cut.axis.0 as f32, point[1] - self.cut.axis.1 as f32];
        let in_strand = from_strand / rope.strand_radius_mm() as f32;
        let radius = length_of(from_axis) / (rope.diameter_mm() / 2.0) as f32;
        let wire_gap = ((1.0 - in_strand) * 3.6).clamp(0.0, 1.0);
        let strand_gap = ((1.0 - radius) * 2.2).clamp(0.0, 1.0);
        let angle = fast_angle(from_axis[0], -from_axis[1]) + wrap(self.scene.view_angle_rad(self.view)) as f32;
        let place = Place {
            x_mm: self.cut.x_mm,
            strand,
            wire,
            psi_rad,
            arc_mm: psi_rad * length,
            rope_angle_rad: wrap_f32(angle),
            radius,
            valley: wire_gap.max(strand_gap),
        };
        Some(Hit { place, normal, point })
    }

    fn light_of(&mut self, s: usize, hit: &Hit, coat: &Coat) -> f32 {
        let id = usize::from(self.trace.id[s]);
        let lit = self.shadows.lit(&self.lamps, hit.place.strand, hit.point);
        let valley = hit.place.valley;
        let mut normal = hit.normal;
        let outward = [hit.point[0] - self.cut.axis.0 as f32, hit.point[1] - self.cut.axis.1 as f32];
        let length = length_of(outward).max(1e-6);
        let outward = outward.map(|o| o / length);
        if coat.flat > 0.0 {
            for k in 0..2 {
                normal[k] += coat.flat * (outward[k] - normal[k]);
            }
        }
        let of_wire = match self.cut.wires.get(id) {
            Some(wire) => {
                let light =
                    *self.wire_light[id].get_or_insert_with(|| self.lamps.on_wire(wire.tangent_y, wire.tangent_z));
                let openness = (1.0 - 0.8 * valley) * (1.0 - 0.15 * valley * valley);
                self.lamps.shade(&light, normal, coat, openness, lit)
            }
            None => {
                // wires of the inner layer: dark, greasy, seen through a gap
                let light = self.lamps.on_wire(0.0, 0.0);
                inner_layer(&hit.place) * self.lamps.shade(&light, normal, coat, 0.6, lit)
            }
        };
        match &coat.cover {
            Some(cover) => self.lamps.on_cover(cover, of_wire, outward, lit),
            None => of_wire,
        }
    }

    /// Gives the outermost ray of the rope the exact share of rope and background, so that edges lie between pixels.
    fn soften(&mut self, edge: f64, outward: isize, low_px: f64, high_px: f64) {
        let s = edge.round();
        if !(s >= 1.0 && s < self.gray.len() as f64 - 1.0) {
            return;
        }
        let share = (0.5 + (edge - s) * outward as f64) as f32;
        let s = s as usize;
        let inside = s.saturating_add_signed(-outward);
        let rope = if self.trace.id[s] == BACKGROUND { self.gray[inside] } else { self.gray[s] };
        let column = (s as f64 + 0.5) / RAYS_PER_PX as f64 - 0.5;
        self.gray[s] = share * rope + (1.0 - share) * self.backdrop.gray(column, low_px, high_px);
    }

    /// Which rays of a line show a defect: (column, index of the defect) for every pixel that does.
    pub fn sightings(&mut self, line: usize, near: &[(usize, &Defect)], mut saw: impl FnMut(usize, usize)) {
        let here = self.look(line, near);
        if here.is_empty() {
            return;
        }
        let rope_radius_mm = self.scene.rope().diameter_mm() / 2.0;
        for s in (0..self.trace.id.len()).step_by(RAYS_PER_PX) {
            let column = s / RAYS_PER_PX;
            let (ghost, index) = self.trace.ghost[s];
            if ghost < self.trace.depth[s] {
                saw(column, usize::from(index));
            }
            let Some(hit) = self.hit(s..s + 1) else { continue };
            if let Some(wire) = self.cut.wires.get(usize::from(self.trace.id[s]))
                && let Some((index, moved_mm)) = wire.moved
                && moved_mm > 0.2 * self.scene.rope().wire_radius_mm()
            {
                saw(column, index);
            }
            for &(index, defect) in &here {
                let mut coat = Coat { albedo: 1.0, gloss: 1.0, flat: 0.0, cover: None };
                if defect.put_on(&mut coat, &hit.place, rope_radius_mm) > super::defect_surface::MARKED {
                    saw(column, index);
                }
            }
        }
    }
}

fn length_of(v: [f32; 2]) -> f32 {
    (v[0] * v[0] + v[1] * v[1]).sqrt()
}

/// Wraps an angle within two turns to -pi..pi.
fn wrap_f32(angle_rad: f32) -> f32 {
    use std::f32::consts::{PI, TAU};
    if angle_rad > PI {
        angle_rad - TAU
    } else if angle_rad < -PI {
        angle_rad + TAU
    } else {
        angle_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::recipe::Recipe;

    #[test]
    fn gleam_lamps_and_lens_of_a_camera_head_show_in_its_pictures() {
        let picture = |change: fn(&mut Recipe)| {
            let mut recipe = Recipe { metres: 0.05, gray_noise: 0.0, dirt: 0.0, ..Recipe::photographic() };
            change(&mut recipe);
            (render(&Scene::new(&recipe, 3).unwrap(), 0, 0), recipe.sensor_px as usize)
        };
        let mean = |(pixels, width): &(Vec<u8>, usize), columns: std::ops::Range<usize>| {
            let of_line = |line: &[u8]| line[columns.clone()].iter().map(|&gray| f64::from(gray)).sum::<f64>();
            pixels.chunks(*width).map(of_line).sum::<f64>() / (pixels.len() / width * columns.len()) as f64
        };
        let steps = |(pixels, _): &(Vec<u8>, usize)| {
            pixels.windows(2).map(|pair| f64::from(pair[0].abs_diff(pair[1])).powi(2)).sum::<f64>()
        };
        let usual = picture(|_| {});
        assert!(mean(&picture(|r| r.gloss = 2.0), 0..480) > 1.1 * mean(&usual, 0..480));
        assert!(steps(&picture(|r| r.blur_px = 1.0)) < 0.9 * steps(&usual));
        // The farther lamps stand to the sides, the more the crowns of the middle shade the rope's sides.
        let sides = |picture: &(Vec<u8>, usize)| mean(picture, 60..110) / mean(picture, 200..280);
        assert!(sides(&picture(|r| r.lamp_spread = 0.0)) > 1.05 * sides(&usual));
        assert!(sides(&picture(|r| r.lamp_spread = 2.0)) < sides(&usual));
    }
}
