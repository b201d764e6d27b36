//! How intact rope in service looks: dirt, oil, water, harmless scratches. All of it is fixed to the rope's surface, so that
//! every view that sees a place sees the same.

use super::foreign::{self, Cover, Piece};
use super::noise::{Along, LineNoise};
use super::recipe::Recipe;
use rand::Rng;
use std::f64::consts::{PI, TAU};

/// A place on the rope's surface.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Along the rope in mm.
    pub x_mm: f64,
    /// Strand.
    pub strand: usize,
    /// Wire in the strand; `None` on the strand's core.
    pub wire: Option<usize>,
    /// Angle round the wire from its outer side in rad.
    pub psi_rad: f32,
    /// The same as an arc in mm.
    pub arc_mm: f32,
    /// Angle round the rope in rope axes in rad, -pi..pi.
    pub rope_angle_rad: f32,
    /// Distance from the rope's axis in rope radii.
    pub radius: f32,
    /// 0 on the crowns, 1 deep between wires or strands.
    pub valley: f32,
}

/// What the surface does with light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coat {
    /// Diffuse reflection, 1 is clean wire.
    pub albedo: f32,
    /// Strength of highlights, 1 is clean wire.
    pub gloss: f32,
    /// 1 where the round wire is worn flat along the rope's surface.
    pub flat: f32,
    /// What lies over it, if anything does.
    pub cover: Option<Cover>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum MarkKind {
    Oil,
    Drop,
    Scratch,
}

/// A small thing on the surface: an ellipse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    kind: MarkKind,
    x_mm: f64,
    angle_rad: f64,
    half_x_mm: f64,
    half_across_mm: f64,
    slant: f64,
    strength: f32,
}

/// Farthest that a mark reaches along the rope in mm.
const MARK_REACH_MM: f64 = 20.0;

/// Dirt and marks of a whole rope.
#[derive(Debug, Clone, PartialEq)]
pub struct Finish {
    seed: u32,
    dirt: f32,
    water: f32,
    gloss: f32,
    radius_mm: f64,
    marks: Vec<Mark>,
    foreign: Vec<Piece>,
}

/// The finish of one line.
#[derive(Debug)]
pub struct LineFinish<'a> {
    finish: &'a Finish,
    marks: Vec<Mark>,
    foreign: Vec<Piece>,
    x_mm: f64,
    grime: LineNoise,
    patch: LineNoise,
    streak: LineNoise,
    grain: LineNoise,
    speck: LineNoise,
    grime_ring: i32,
    patch_ring: i32,
}

fn smoothstep(low: f32, high: f32, value: f32) -> f32 {
    ease((value - low) / (high - low))
}

/// 0 below 0, 1 above 1, smooth between.
fn ease(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// How bright the layer below the wires is beside them: dark, greasy, striped by its own wires.
pub fn inner_layer(place: &Place) -> f32 {
    0.42 * (0.6 + 0.4 * (place.psi_rad * 6.0 + (place.x_mm * 0.11) as f32).sin())
}

impl Finish {
    /// The finish that a recipe asks for; foreign matter by chances of its own.
    pub fn random(rng: &mut impl Rng, foreign: &mut impl Rng, recipe: &Recipe) -> Self {
        let seed = rng.random();
        let mut marks = Vec::new();
        let kinds = [
            (MarkKind::Oil, recipe.oil_spots_per_m),
            (MarkKind::Drop, recipe.water * 60.0),
            (MarkKind::Scratch, recipe.scratches_per_m),
        ];
        for (kind, per_m) in kinds {
            for _ in 0..(per_m * recipe.metres).round() as usize {
                let size = rng.random::<f64>();
                let (half_x_mm, half_across_mm) = match kind {
                    MarkKind::Oil => (1.0 + 7.0 * size, 0.8 + 3.0 * rng.random::<f64>()),
                    MarkKind::Drop => (0.25 + 0.5 * size, 0.25 + 0.4 * size),
                    MarkKind::Scratch => (0.6 + 4.0 * size, 0.04 + 0.05 * rng.random::<f64>()),
                };
                marks.push(Mark {
                    kind,
                    x_mm: rng.random::<f64>() * recipe.metres * 1000.0,
                    angle_rad: rng.random::<f64>() * TAU,
                    half_x_mm,
                    half_across_mm,
                    slant: (rng.random::<f64>() - 0.5) * 1.2,
                    strength: 0.4 + 0.6 * rng.random::<f32>(),
                });
            }
        }
        marks.sort_by(|a, b| a.x_mm.total_cmp(&b.x_mm));
        let (dirt, water) = (recipe.dirt as f32, recipe.water as f32);
        Self {
            seed,
            dirt,
            water,
            gloss: recipe.gloss as f32,
            radius_mm: recipe.diameter_mm / 2.0,
            marks,
            foreign: foreign::pieces(foreign, recipe),
        }
    }

    /// The finish at `x_mm`.
    pub fn at_line(&self, x_mm: f64) -> LineFinish<'_> {
        let first = self.marks.partition_point(|m| m.x_mm < x_mm - MARK_REACH_MM);
        let marks = self.marks[first..]
            .iter()
            .take_while(|m| m.x_mm <= x_mm + MARK_REACH_MM)
            .filter(|m| (m.x_mm - x_mm).abs() <= m.half_x_mm + m.half_across_mm)
            .copied()
            .collect();
        let round_mm = TAU * self.radius_mm;
        let (grime_ring, patch_ring) = ((round_mm / 11.0).ceil() as i32, (round_mm / 2.7).ceil() as i32);
        LineFinish {
            finish: self,
            marks,
            foreign: foreign::on_line(&self.foreign, x_mm),
            x_mm,
            grime: LineNoise::ring(Along::at(x_mm, 31.0), grime_ring),
            patch: LineNoise::ring(Along::at(x_mm, 5.3), patch_ring),
            streak: LineNoise::strip(Along::at(x_mm, 8.7)),
            grain: LineNoise::strip(Along::at(x_mm, 0.43)),
            speck: LineNoise::strip(Along::at(x_mm, 0.61)),
            grime_ring,
            patch_ring,
        }
    }
}

impl LineFinish<'_> {
    /// The coat of a place on this line.
    pub fn coat(&mut self, place: &Place) -> Coat {
        let f = self.finish;
        let own = f.seed ^ ((place.strand * 32 + place.wire.unwrap_or(31)) as u32).wrapping_mul(0x61C8_8647);
        let turn = place.rope_angle_rad * (1.0 / std::f32::consts::TAU);
        let grime = self.grime.at(f.seed ^ 1, turn * self.grime_ring as f32);
        let patch = self.patch.at(f.seed ^ 2, turn * self.patch_ring as f32);
        let streak = self.streak.at(own ^ 3, place.arc_mm * 4.3) - 0.5;
        let grain = self.grain.at(own ^ 4, place.arc_mm * 2.9) - 0.5;
        let cover = ease((0.55 * grime + 0.45 * patch - 0.25) * (1.0 / 0.55));
        let dirt = (f.dirt * (0.15 + 1.35 * cover) * (0.45 + 1.5 * place.valley)).min(0.92);
        let mut coat = Coat {
            albedo: (1.0 - 0.7 * dirt) * (1.0 + 0.2 * streak + (0.1 + 0.35 * f.dirt) * grain),
            gloss: f.gloss * (1.0 - 0.85 * dirt) * (1.0 + 1.3 * streak + 0.4 * grain),
            flat: 0.0,
            cover: None,
        };
        if f.dirt > 0.0 {
            let speck = self.speck.at(own ^ 5, place.arc_mm * 2.1);
            let least = 0.93 - 0.12 * f.dirt * patch;
            if speck > least {
                coat.albedo *= 1.0 - 0.75 * smoothstep(least, 1.0, speck);
            }
        }
        if grime > 1.0 - f.water {
            let film = smoothstep(1.0 - f.water, 1.15 - f.water, grime);
            coat.albedo *= 1.0 - 0.22 * film;
            coat.gloss *= 1.0 + 0.9 * film;
        }
        for mark in &self.marks {
            mark.put_on(&mut coat, self.x_mm, place.rope_angle_rad, f.radius_mm);
        }
        coat.cover = self.foreign.iter().find_map(|piece| piece.cover(place, f.radius_mm));
        coat
    }
}

impl Mark {
    fn put_on(&self, coat: &mut Coat, x_mm: f64, angle_rad: f32, radius_mm: f64) {
        let mut away = f64::from(angle_rad) - self.angle_rad;
        away -= TAU * (away / TAU).round();
        let (u, v) = (x_mm - self.x_mm, away * radius_mm);
        let (a, b) = ((u + self.slant * v) / self.half_x_mm, (v - self.slant * u) / self.half_across_mm);
        let r = (a * a + b * b).sqrt() as f32;
        if r >= 1.0 || away.abs() > PI / 2.0 {
            return;
        }
        match self.kind {
            MarkKind::Oil => {
                let wet = self.strength * smoothstep(1.0, 0.6, r);
                coat.albedo *= 1.0 - 0.5 * wet;
                coat.gloss *= 1.0 + 0.4 * wet;
            }
            MarkKind::Drop => {
                coat.albedo *= 1.0 - 0.35 * self.strength * (1.0 - r);
                if a < -0.1 && r > 0.45 {
                    coat.albedo += 1.1 * self.strength * (1.0 - (r - 0.72).abs() * 3.6).max(0.0); // the lamp in its rim
                }
            }
            MarkKind::Scratch => coat.albedo *= 1.0 + 0.55 * self.strength * (1.0 - r),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Scene;

    fn place() -> Place {
        Place {
            x_mm: 0.0,
            strand: 1,
            wire: Some(2),
            psi_rad: 0.1,
            arc_mm: 0.13,
            rope_angle_rad: 0.4,
            radius: 1.0,
            valley: 0.2,
        }
    }

    #[test]
    fn dirt_makes_rope_darker_and_duller() {
        let mean = |dirt| {
            let recipe =
                Recipe { dirt, oil_spots_per_m: 0.0, scratches_per_m: 0.0, water: 0.0, ..Recipe::photographic() };
            let scene = Scene::new(&recipe, 6).unwrap();
            let coats = (0..2000).map(|k| scene.finish.at_line(f64::from(k)).coat(&place()));
            let (albedo, gloss) = coats.fold((0.0, 0.0), |sum, c| (sum.0 + c.albedo, sum.1 + c.gloss));
            (albedo / 2000.0, gloss / 2000.0)
        };
        let (clean, dirty) = (mean(0.0), mean(0.9));
        assert!((clean.0 - 1.0).abs() < 0.02, "{clean:?}");
        assert!(dirty.0 < 0.8 && dirty.1 < 0.7, "{dirty:?}");
    }
}
