//! The gap of a broken wire: how its ends are torn, how they look, and what shows between them.
//!
//! Without variety all gaps are alike: ends nearly square, bright above and dark below, and a dark layer between them. With it, ends are
//! slanted, cupped and jagged, show a dark torn face or none, and the layer between them may be as bright as the wires about it, striped
//! by its own wires, greasy, and in the shadow of an end.

use super::defects::{Defect, DefectKind, Trait};
use super::finish::{Coat, Place, inner_layer};
use super::noise::{Along, surface_noise};

/// Farthest that an end's face reaches into the gap, as a share of half the gap.
const MOST_FACE: f64 = 0.8;
/// How far beyond half the gap the layer below shows at most, in mm.
const TORN_MM: f32 = 0.8;

impl Defect {
    /// Whether its wire has a gap somewhere.
    pub fn breaks_wire(&self) -> bool {
        self.gap_half_mm() > 0.0
    }

    /// Half the length of the gap in its wire in mm; 0 if it has none.
    pub fn gap_half_mm(&self) -> f64 {
        match self.kind {
            DefectKind::BrokenWire | DefectKind::MissingWire => self.half_mm,
            DefectKind::LiftedWire if self.severity > 0.5 => 0.4 + 1.2 * self.severity,
            _ => 0.0,
        }
    }

    /// Whether nothing of the wire is left at `x_mm`, `psi_rad` round the wire from its outer side.
    pub fn gap_at(&self, x_mm: f64, psi_rad: f64) -> bool {
        self.past_gap_mm(x_mm, psi_rad) < -self.face_mm(self.end_at(x_mm), psi_rad)
    }

    /// Distance to the nearer end of the wire's surface in mm, negative in the gap. The ends are torn, not cut square.
    fn past_gap_mm(&self, x_mm: f64, psi_rad: f64) -> f64 {
        let half_mm = self.gap_half_mm();
        if half_mm <= 0.0 {
            return f64::INFINITY;
        }
        let end = self.end_at(x_mm);
        let seed = f64::from(self.roughness % 628) / 100.0;
        let torn = 0.25 * (psi_rad + seed + 2.0 * f64::from(end)).sin() + 0.08 * (5.0 * psi_rad + seed).sin();
        let slant = 1.1 * (self.chance(end, 1) - 0.5) * psi_rad;
        let cup = (self.chance(end, 2) - 0.5) * (psi_rad * psi_rad).min(2.5);
        let teeth = 1.2 * self.chance(end, 3) * (self.along_end(end, 4, psi_rad) - 0.5);
        let torn_mm = torn * half_mm.min(0.8) + self.variety * (slant + cup + teeth) * half_mm.min(1.0);
        (x_mm - self.centre_mm).abs() - (half_mm + torn_mm).max(0.15)
    }

    /// How far the torn face of an end shows beyond the end of its surface, in mm.
    fn face_mm(&self, end: u32, psi_rad: f64) -> f64 {
        let length_mm = self.variety * 2.2 * (self.chance(end, 5) - 0.4).max(0.0);
        let shows_mm = length_mm * (0.4 + 1.2 * self.along_end(end, 6, psi_rad)) * (0.3 + 0.7 * psi_rad.cos()).max(0.0);
        shows_mm.min(MOST_FACE * self.gap_half_mm())
    }

    /// Changes the coat of the broken wire itself. Returns how much of the defect is there, 0..1.
    pub(super) fn put_on_end(&self, coat: &mut Coat, place: &Place) -> f32 {
        let past_mm = self.past_gap_mm(place.x_mm, f64::from(place.psi_rad));
        let end = self.end_at(place.x_mm);
        let variety = self.variety as f32;
        if past_mm < 0.0 && self.face_mm(end, f64::from(place.psi_rad)) > 0.0 {
            let grain = surface_noise(self.roughness ^ 8, Along::at(place.x_mm, 0.25), place.psi_rad / 0.2);
            coat.albedo *= (0.1 + 0.5 * self.chance(end, 7) as f32 + 0.4 * (grain - 0.5)).max(0.05);
            coat.gloss *= 0.2;
            return 1.0;
        }
        let face = (1.0 - past_mm.abs() / 0.35).max(0.0) as f32;
        let usual = if end == 0 { 0.8 } else { -0.6 };
        let bright = usual + variety * (1.6 * (self.chance(end, 9) as f32 - 0.5) - usual);
        let bright = bright * (1.0 + self.departs(Trait::Rim) as f32) + 0.35 * self.departs(Trait::Brightness) as f32;
        coat.albedo *= 1.0 + face * bright;
        coat.gloss *= 1.0 - 0.7 * face;
        face
    }

    /// Changes the coat of the layer that shows in the gap.
    pub(super) fn put_on_layer_below(&self, coat: &mut Coat, place: &Place, across_mm: f32) {
        let beyond_mm = (place.x_mm - self.centre_mm).abs() - self.gap_half_mm();
        let variety = self.variety as f32 * (1.0 - beyond_mm as f32 / TORN_MM).clamp(0.0, 1.0);
        if variety == 0.0 {
            return;
        }
        let chance = |salt: u32| self.chance(0, salt) as f32;
        // its own wires, in their own direction
        let (wires, lay) = (6.0 + 7.0 * chance(10), 0.25 * (chance(11) - 0.5));
        let stripes = (wires * place.psi_rad + lay * (place.x_mm - self.centre_mm) as f32 + 6.3 * chance(12)).sin();
        let contrast = 0.5 * chance(13);
        let bright = 2.2 * (2.2 * (chance(14) - 0.6)).exp() * (1.0 - contrast + contrast * stripes);
        let rough = surface_noise(self.roughness ^ 7, Along::at(place.x_mm, 1.2), across_mm / 0.8);
        let grease = (6.0 * (rough - 0.7 + 0.5 * (chance(15) - 0.5))).clamp(0.0, 1.0);
        // lamps that stand a little along the rope: one end throws a shadow
        let end = if chance(16) < 0.5 { -1.0 } else { 1.0 };
        let from_end_mm = self.gap_half_mm() - end * (place.x_mm - self.centre_mm);
        let shadow = 1.2
            * (chance(17) - 0.3).max(0.0)
            * (-from_end_mm.max(0.0) / (0.2 + 1.2 * f64::from(chance(18)))).exp() as f32;
        let seen = bright * (1.0 - 0.85 * grease) * (1.0 - shadow.min(0.9));
        coat.albedo *= 1.0 + variety * (seen / inner_layer(place) - 1.0);
    }

    /// 0 for the end before the gap's middle, 1 for the one after it.
    fn end_at(&self, x_mm: f64) -> u32 {
        u32::from(x_mm >= self.centre_mm)
    }

    /// A number of its own for an end, 0 to 1.
    fn chance(&self, end: u32, salt: u32) -> f64 {
        f64::from(surface_noise(self.roughness ^ (salt << 8 | end), Along::at(0.0, 1.0), 0.0))
    }

    /// Noise along an end, 0 to 1: teeth of some tenths of a millimetre.
    fn along_end(&self, end: u32, salt: u32, psi_rad: f64) -> f64 {
        f64::from(surface_noise(self.roughness ^ (salt << 8 | end), Along::at(0.0, 1.0), psi_rad as f32 / 0.22))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaps of 2 mm that differ only in their own chance.
    fn gaps(variety: f64) -> impl Iterator<Item = Defect> {
        (0..200u32).map(move |number| Defect {
            id: 0,
            kind: DefectKind::BrokenWire,
            severity: 0.5,
            strand: 2,
            wire: 4,
            centre_mm: 100.0,
            half_mm: 1.0,
            angle_rad: 0.0,
            roughness: number.wrapping_mul(0x9E37_79B1),
            variety,
        })
    }

    fn place(x_mm: f64, wire: Option<usize>) -> Place {
        let (psi_rad, arc_mm, rope_angle_rad, radius, valley) = (0.0, 0.0, 0.0, 0.8, 0.0);
        Place { x_mm, strand: 2, wire, psi_rad, arc_mm, rope_angle_rad, radius, valley }
    }

    /// What a gap makes of clean steel at a place, and how much of it is there.
    fn coated(gap: &Defect, place: &Place) -> (Coat, f32) {
        let mut coat = Coat { albedo: 1.0, gloss: 1.0, flat: 0.0, cover: None };
        let there = gap.put_on(&mut coat, place, 16.0);
        (coat, there)
    }

    fn share_of(gaps: impl Iterator<Item = Defect>, is: impl Fn(&Defect) -> bool) -> f64 {
        gaps.filter(is).count() as f64 / 200.0
    }

    #[test]
    fn the_wire_is_gone_in_its_gap_only() {
        for variety in [0.0, 1.0] {
            assert!(gaps(variety).all(|gap| !gap.gap_at(103.0, 0.0) && !gap.gap_at(97.0, 0.0)));
        }
        assert!(gaps(0.0).all(|gap| gap.gap_at(100.0, 0.0)));
        assert!(share_of(gaps(1.0), |gap| gap.gap_at(100.0, 0.0)) > 0.7, "of some the faces show alone");
    }

    #[test]
    fn ends_are_nearly_square_without_variety_and_slanted_or_cupped_with_it() {
        let uneven_mm = |gap: &Defect| {
            let ends = [-1.0, 0.0, 1.0].map(|psi_rad| gap.past_gap_mm(101.5, psi_rad));
            ends.into_iter().fold(f64::MIN, f64::max) - ends.into_iter().fold(f64::MAX, f64::min)
        };
        assert!(gaps(0.0).all(|gap| uneven_mm(&gap) < 0.5 && gap.face_mm(1, 0.0) == 0.0));
        assert!(share_of(gaps(1.0), |gap| uneven_mm(gap) > 0.6) > 0.3);
        let shows_face = |gap: &Defect| gap.face_mm(1, 0.0) > 0.3;
        assert!((0.2..0.7).contains(&share_of(gaps(1.0), shows_face)));
    }

    #[test]
    fn the_face_of_an_end_is_dark_and_part_of_the_defect() {
        let mut faces = 0;
        for gap in gaps(1.0) {
            let x_mm = 101.0 - 0.1 * gap.face_mm(1, 0.0) - 0.05;
            let past_mm = gap.past_gap_mm(x_mm, 0.0);
            if past_mm < 0.0 && !gap.gap_at(x_mm, 0.0) {
                let (coat, there) = coated(&gap, &place(x_mm, Some(4)));
                assert!(there == 1.0 && coat.albedo < 0.85 && coat.gloss < 0.3, "{coat:?}");
                faces += 1;
            }
        }
        assert!(faces > 20, "{faces}");
    }

    #[test]
    fn the_layer_below_is_as_ever_without_variety_and_shines_or_is_dark_with_it() {
        let below = place(100.2, None);
        let seen = |gap: &Defect| {
            let (coat, there) = coated(gap, &below);
            assert_eq!(there, 0.0, "labels are drawn where the wire is missing");
            coat.albedo * inner_layer(&below)
        };
        assert!(gaps(0.0).all(|gap| seen(&gap) == inner_layer(&below)));
        assert!(share_of(gaps(1.0), |gap| seen(gap) > 0.9) > 0.3 && share_of(gaps(1.0), |gap| seen(gap) < 0.4) > 0.1);
        assert!(gaps(1.0).all(|gap| coated(&gap, &place(104.0, None)).0.albedo == 1.0), "and beyond it as ever");
    }
}
