//! Foreign matter that lies on intact rope: flakes of tar, lumps of grease, beads of water, fibres, grit, specks, stains, paint. It
//! hides the wires and the valleys between them alike, is fixed to the rope's surface, and is no defect: what looks for defects must live with it.

use super::finish::Place;
use super::noise::{Along, surface_noise};
use super::recipe::Recipe;
use super::trace::wrap;
use rand::Rng;
use std::f64::consts::TAU;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Matter {
    /// Opaque, dark, with a ragged edge.
    Flake,
    /// Dull gray, thick enough to fill valleys, uneven.
    Lump,
    /// Clear, round, with a lamp's image in it.
    Bead,
    /// A hair or thread, dark or pale, across whatever lies under it.
    Fibre,
    /// A few grains of sand or ice, dark and bright ones.
    Grit,
    /// Many dark specks, splashed over an area.
    Specks,
    /// A thin dark film with a soft edge.
    Stain,
    /// A mark of an inspector: opaque, even, with a sharp edge.
    Paint,
}

/// All of it, as often one as the other.
const MATTERS: [Matter; 8] = [
    Matter::Flake,
    Matter::Lump,
    Matter::Bead,
    Matter::Fibre,
    Matter::Grit,
    Matter::Specks,
    Matter::Stain,
    Matter::Paint,
];

/// A piece of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    matter: Matter,
    x_mm: f64,
    angle_rad: f64,
    half_mm: f64,
    /// How much longer it is along the rope than across.
    stretch: f64,
    strength: f32,
    seed: u32,
}

/// What lies over a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cover {
    /// Share of the light that comes from it instead of the wire.
    pub share: f32,
    /// Its diffuse reflection, 1 is clean wire.
    pub albedo: f32,
    /// Strength of its highlights.
    pub gleam: f32,
    /// How its surface leans along the rope and round it: 0 faces away from the rope's axis.
    pub lean: [f32; 2],
}

/// How far beyond its half length a ragged edge may reach.
const RAGGED: f64 = 1.35;
/// Farthest that a piece reaches along the rope in mm.
const REACH_MM: f64 = 30.0;

/// Foreign matter of a whole rope, in the order of its place.
pub fn pieces(rng: &mut impl Rng, recipe: &Recipe) -> Vec<Piece> {
    let mut pieces: Vec<Piece> = (0..(recipe.debris_per_m * recipe.metres).round() as usize)
        .map(|_| {
            let size = rng.random::<f64>();
            let matter = MATTERS[rng.random_range(0..MATTERS.len())];
            let half_mm = match matter {
                Matter::Flake => 0.4 + 1.6 * size * size,
                Matter::Lump => 1.0 + 3.5 * size * size,
                Matter::Bead => 0.4 + 1.5 * size,
                Matter::Fibre | Matter::Grit => 1.0 + 4.0 * size,
                Matter::Specks => 3.0 + 11.0 * size,
                Matter::Stain => 1.0 + 6.0 * size * size,
                Matter::Paint => 0.8 + 4.0 * size * size,
            };
            Piece {
                matter,
                x_mm: rng.random::<f64>() * recipe.metres * 1000.0,
                angle_rad: rng.random::<f64>() * TAU,
                half_mm,
                stretch: if matter == Matter::Bead { 1.0 } else { 0.6 + 0.9 * rng.random::<f64>() },
                strength: rng.random(),
                seed: rng.random(),
            }
        })
        .collect();
    pieces.sort_by(|a, b| a.x_mm.total_cmp(&b.x_mm));
    pieces
}

/// Those of all pieces that may lie on the line at `x_mm`.
pub fn on_line(pieces: &[Piece], x_mm: f64) -> Vec<Piece> {
    let first_from = |x_mm: f64| pieces.partition_point(|piece| piece.x_mm < x_mm);
    let near = &pieces[first_from(x_mm - REACH_MM)..first_from(x_mm + REACH_MM)];
    near.iter().filter(|piece| (piece.x_mm - x_mm).abs() <= RAGGED * piece.half_mm * piece.stretch).copied().collect()
}

impl Piece {
    /// How far it is turned on the rope's surface, in rad.
    fn turn(&self) -> f64 {
        f64::from(self.seed >> 8) / f64::from(u32::MAX >> 8) * TAU
    }

    /// What of it lies over a place; `None` beside it.
    pub fn cover(&self, place: &Place, rope_radius_mm: f64) -> Option<Cover> {
        let u = (place.x_mm - self.x_mm) / (self.half_mm * self.stretch);
        let round_mm = wrap(f64::from(place.rope_angle_rad) - self.angle_rad) * rope_radius_mm;
        let v = round_mm / self.half_mm;
        let r = (u * u + v * v).sqrt() as f32;
        let rough = |cell_mm: f64, seed: u32| {
            surface_noise(self.seed ^ seed, Along::at(place.x_mm, cell_mm), (round_mm / cell_mm) as f32) - 0.5
        };
        let strength = self.strength;
        let cover = match self.matter {
            _ if f64::from(r) > RAGGED => return None,
            Matter::Flake => {
                let edge = 1.0 - r + 0.8 * rough(0.55, 1) + 0.4 * rough(0.2, 2);
                let albedo = 0.06 + 0.22 * strength + 0.08 * rough(0.4, 3);
                Cover { share: (8.0 * edge).clamp(0.0, 0.96), albedo, gleam: 0.02, lean: [0.0; 2] }
            }
            Matter::Lump => {
                let edge = 1.0 - r + 0.9 * rough(0.9, 1) + 0.3 * rough(0.3, 2);
                let lean = [0.9 * rough(0.7, 3), 0.9 * rough(0.7, 4)];
                let share = (5.0 * edge).clamp(0.0, 1.0) * (0.5 + 0.45 * strength);
                Cover { share, albedo: 0.55 + 0.3 * rough(0.5, 5), gleam: 0.15 * share, lean }
            }
            Matter::Bead => {
                let share = (6.0 * (1.0 - r)).clamp(0.0, 1.0) * (0.15 + 0.6 * r * r * strength);
                Cover { share, albedo: 0.3, gleam: 1.4, lean: [0.8 * u as f32, 0.8 * v as f32] }
            }
            Matter::Fibre => {
                // Along a slanted line, bent like a wave.
                let turn = self.turn();
                let (along, across) = (u * turn.cos() + v * turn.sin(), v * turn.cos() - u * turn.sin());
                let bent = across - 0.25 * (3.0 * along + f64::from(strength) * TAU).sin();
                let thick = (0.06 + 0.1 * f64::from(strength)) / self.half_mm;
                let share = (2.0 * (1.0 - (bent / thick).abs() as f32)).clamp(0.0, 0.9);
                let share = if along.abs() > 1.0 { 0.0 } else { share };
                Cover {
                    share,
                    albedo: if self.seed.is_multiple_of(2) { 0.08 } else { 1.3 },
                    gleam: 0.1,
                    lean: [0.0; 2],
                }
            }
            Matter::Grit => {
                let grain = rough(0.45, 1);
                let edge = grain - 0.27 - 0.25 * r;
                let albedo = if rough(0.45, 2) > 0.0 { 1.5 } else { 0.1 };
                Cover { share: (9.0 * edge).clamp(0.0, 0.9), albedo, gleam: 0.4, lean: [rough(0.2, 3), rough(0.2, 4)] }
            }
            Matter::Specks => {
                let cell_mm = 0.3 + 0.4 * f64::from(strength);
                let edge = rough(cell_mm, 1) + 0.3 * rough(0.2, 2) - 0.24 - 0.16 * r;
                Cover { share: (9.0 * edge).clamp(0.0, 0.85), albedo: 0.12, gleam: 0.02, lean: [0.0; 2] }
            }
            Matter::Stain => {
                let edge = 1.0 - r + 0.5 * rough(1.7, 1);
                let share = (2.5 * edge).clamp(0.0, 1.0) * (0.15 + 0.55 * strength);
                Cover { share, albedo: 0.15, gleam: 0.3 * share, lean: [0.0; 2] }
            }
            Matter::Paint => {
                let edge = 1.0 - u.abs().max(v.abs()) as f32 + 0.15 * rough(0.4, 1);
                let albedo = if self.seed.is_multiple_of(3) { 0.1 + 0.2 * strength } else { 0.7 + 0.9 * strength };
                Cover { share: (12.0 * edge).clamp(0.0, 0.93), albedo, gleam: 0.2, lean: [0.0; 2] }
            }
        };
        (cover.share > 0.0).then_some(cover)
    }
}

#[cfg(test)]
mod tests {
    use crate::simulate::Scene;
    use crate::simulate::photographic::render;
    use crate::simulate::recipe::Recipe;

    #[test]
    fn foreign_matter_changes_some_places_and_neither_the_rope_nor_its_defects() {
        let with = |debris_per_m: f64| {
            let recipe = Recipe { metres: 0.4, defects: 1, debris_per_m, ..Recipe::photographic() };
            let scene = Scene::new(&recipe, 5).unwrap();
            (render(&scene, 0, 0), scene.defects().to_vec())
        };
        let ((clean, defects), (littered, same)) = (with(0.0), with(100.0));
        assert_eq!(defects, same);
        let changed = clean.iter().zip(&littered).filter(|(a, b)| a.abs_diff(**b) > 12).count() as f64;
        let share = changed / clean.len() as f64;
        assert!(share > 0.002 && share < 0.25, "{share} of the pixels");
        // Paint and beads are brighter than the wires under them, flakes and specks darker.
        assert!(clean.iter().zip(&littered).any(|(a, b)| *b > a.saturating_add(60)));
        assert!(clean.iter().zip(&littered).any(|(a, b)| *a > b.saturating_add(60)));
    }
}
