//! What defects do to the look of the surface, beside what they do to its shape.

use super::defects::{Defect, DefectKind, Trait};
use super::finish::{Coat, Place};
use super::noise::{Along, surface_noise};
use super::trace::wrap;

/// From this change on a place belongs to the defect when labels are drawn.
pub const MARKED: f32 = 0.3;

impl Defect {
    /// Changes the coat of a place. Returns how much of the defect is there, 0..1.
    pub fn put_on(&self, coat: &mut Coat, place: &Place, rope_radius_mm: f64) -> f32 {
        let severity = self.severity as f32;
        let u = place.x_mm - self.centre_mm;
        let v = wrap(f64::from(place.rope_angle_rad) - self.angle_rad) * rope_radius_mm * f64::from(place.radius);
        let own_strand = place.strand == self.strand && place.wire.is_some();
        let rough = |cell_mm: f64, across_mm: f32, seed: u32| {
            surface_noise(self.roughness ^ seed, Along::at(place.x_mm, cell_mm), v as f32 / across_mm)
        };
        let departs = |of: Trait| self.departs(of) as f32;
        match self.kind {
            DefectKind::Corrosion if own_strand => {
                let wire = place.wire.unwrap_or(usize::MAX);
                let beside = wire.abs_diff(self.wire);
                let reach = if beside == 0 {
                    1.0
                } else if beside == 1 && self.severity > 0.65 {
                    0.6
                } else {
                    return 0.0;
                };
                let edge = 1.0 - (u.abs() / (self.half_mm * reach)) as f32 + 0.25 * (rough(1.6, 0.8, 1) - 0.5);
                let weight = (edge * 5.0).clamp(0.0, 1.0) * (1.6 - place.psi_rad.abs()).clamp(0.0, 1.0);
                // No two patches rust alike: pits of several sizes, blooms paler or darker.
                let vary = |bits: u32| f64::from(self.roughness >> bits & 0xff) / 255.0;
                let (pits_mm, blooms_mm) = (0.16 + 0.2 * vary(0), 0.6 + 0.9 * vary(8));
                let (fine, coarse) =
                    (rough(pits_mm, 0.9 * pits_mm as f32, 2), rough(blooms_mm, 0.65 * blooms_mm as f32, 3));
                let pit = ((fine - 0.62) * 6.0).clamp(0.0, 1.0);
                let mean = 0.85 + 0.3 * departs(Trait::Brightness) + 0.25 * vary(16) as f32
                    - 0.45 * severity * (0.4 + 0.6 * vary(24) as f32);
                let look = mean + 0.5 * (coarse - 0.5) + 0.35 * (fine - 0.5) - 0.5 * pit;
                coat.albedo *= 1.0 - weight + weight * look.max(0.15);
                coat.gloss *= 1.0 - weight * (0.55 + 0.4 * severity);
                weight
            }
            DefectKind::ArcBurn => {
                let longer = (0.7 * self.departs(Trait::Shape)).exp();
                let ragged = 0.35 * (1.0 + departs(Trait::Edge)) * (rough(0.8, 0.7, 4) - 0.5);
                let r = (((u / longer).powi(2) + v * v).sqrt() / self.half_mm) as f32 + ragged;
                if r >= 1.6 {
                    return 0.0;
                }
                let melted = ((1.0 - r) * 4.0).clamp(0.0, 1.0);
                let rim = (1.0 - (r - 0.75).abs() * 4.5).max(0.0);
                let halo = ((1.6 - r) * 1.6).clamp(0.0, 1.0);
                let strength = 0.35 + 0.65 * severity;
                coat.albedo *= 1.0 - 0.3 * halo * strength;
                let darker = 0.45 + 0.5 * departs(Trait::Brightness);
                coat.albedo *= 1.0 - melted * strength * (darker + 0.6 * (rough(0.35, 0.35, 5) - 0.5));
                coat.albedo += 0.75 * (1.0 + departs(Trait::Rim)) * rim * strength;
                coat.gloss *= 1.0 - (0.6 + departs(Trait::Depth)) * melted;
                coat.flat = coat.flat.max(0.5 * melted);
                (melted + 0.5 * halo).min(1.0) * (0.5 + 0.5 * severity)
            }
            DefectKind::Notch => {
                let slope = 0.4 + f64::from(self.roughness % 100) / 80.0; // 22 to 60 degrees across the rope
                let (along, across) = ((u * slope.sin() + v * slope.cos()), (u * slope.cos() - v * slope.sin()));
                let width_mm = (0.2 + 0.35 * self.severity) * (0.6 * self.departs(Trait::Shape)).exp();
                let r = (across / width_mm).abs() as f32;
                if along.abs() > self.half_mm || r > 2.0 {
                    return 0.0;
                }
                let groove = (1.3 - r).clamp(0.0, 1.0);
                let lip = (1.0 - (r - 1.4).abs() * 2.5).max(0.0);
                coat.albedo *= 1.0 - ((0.4 + 0.45 * severity) * (1.0 + 0.7 * departs(Trait::Depth))).min(0.95) * groove;
                coat.albedo +=
                    0.6 * (1.0 + departs(Trait::Rim)) * severity * lip * if across > 0.0 { 1.0 } else { 0.3 };
                coat.gloss *= 1.0 - 0.8 * groove;
                groove.max(lip * severity)
            }
            DefectKind::Abrasion if own_strand => {
                let depth = 0.018 + 0.045 * severity;
                let worn = ((place.radius - (1.0 - depth)) / (0.35 * depth)).clamp(0.0, 1.0);
                let edge = (1.0 - (u.abs() / self.half_mm) as f32 + 0.2 * (rough(2.0, 1.0, 6) - 0.5)) * 6.0;
                let weight = worn * edge.clamp(0.0, 1.0);
                if weight > 0.0 {
                    // scored along the direction in which something rubbed
                    let scoring = surface_noise(
                        self.roughness,
                        Along::at(place.x_mm + 0.6 * v, 3.5),
                        (v - 0.6 * u) as f32 / 0.13,
                    );
                    coat.flat = coat.flat.max(weight);
                    let brighter = 0.15 + 0.35 * departs(Trait::Brightness);
                    coat.albedo *= 1.0 + weight * (brighter + 0.5 * (1.0 + departs(Trait::Depth)) * (scoring - 0.5));
                    coat.gloss *= 1.0 - (0.5 + 0.5 * departs(Trait::Rim)) * weight;
                }
                weight * (0.5 + 0.5 * severity)
            }
            _ if self.breaks_wire() && own_strand && place.wire == Some(self.wire) => self.put_on_end(coat, place),
            _ if self.breaks_wire() && place.strand == self.strand && place.wire.is_none() => {
                self.put_on_layer_below(coat, place, v as f32);
                0.0 // labels are drawn where the wire is missing
            }
            _ => 0.0,
        }
    }
}
