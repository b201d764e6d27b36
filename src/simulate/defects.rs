//! Defects: their kinds, how they are planted, and what they do to the rope's shape.

use super::noise::{Stream, generator};
use super::recipe_limits::METRES_PER_DEFECT;
use super::scene::Scene;
use super::trace::wrap;
use rand::Rng;
use rand::seq::SliceRandom;
use std::f64::consts::{PI, TAU};

/// What is wrong with the rope.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DefectKind {
    /// A wire with a gap of 0.5 to 3 mm.
    BrokenWire,
    /// A wire that is not there for 20 to 150 mm.
    MissingWire,
    /// Rough, dull, pitted surface along one to three wires.
    Corrosion,
    /// A spot where lightning or an arc melted the surface.
    ArcBurn,
    /// A wire that stands out of the rope; broken when severe.
    LiftedWire,
    /// A groove across the wires.
    Notch,
    /// A wire that wanders in its strand.
    LooseWire,
    /// Crowns worn flat.
    Abrasion,
}

/// All kinds, in the order in which they are planted before shuffling.
pub const KINDS: [DefectKind; 8] = [
    DefectKind::BrokenWire,
    DefectKind::MissingWire,
    DefectKind::Corrosion,
    DefectKind::ArcBurn,
    DefectKind::LiftedWire,
    DefectKind::Notch,
    DefectKind::LooseWire,
    DefectKind::Abrasion,
];

impl DefectKind {
    /// The kind of this name.
    pub fn named(name: &str) -> Option<Self> {
        KINDS.into_iter().find(|kind| kind.name() == name)
    }

    /// Its name in labels.
    pub fn name(self) -> &'static str {
        match self {
            Self::BrokenWire => "broken_wire",
            Self::MissingWire => "missing_wire",
            Self::Corrosion => "corrosion",
            Self::ArcBurn => "arc_burn",
            Self::LiftedWire => "lifted_wire",
            Self::Notch => "notch",
            Self::LooseWire => "loose_wire",
            Self::Abrasion => "abrasion",
        }
    }
}

/// A planted defect.
#[derive(Debug, Clone, PartialEq)]
pub struct Defect {
    /// Its number, from 0 along the rope.
    pub id: usize,
    /// Its kind.
    pub kind: DefectKind,
    /// 0.15 (hard to see) to 1.
    pub severity: f64,
    /// Strand it is on.
    pub strand: usize,
    /// Wire of the strand it is on (the middle one if several are).
    pub wire: usize,
    /// Its middle along the rope in mm.
    pub centre_mm: f64,
    /// Half its length along the rope in mm.
    pub half_mm: f64,
    /// Where on the rope: angle of its middle round the rope in rope axes, in rad.
    pub angle_rad: f64,
    /// Its own source of roughness.
    pub roughness: u32,
    /// How far it may differ from others of its kind, 0 to 1.
    pub variety: f64,
}

/// Longest reach of a defect from its middle in mm.
pub const REACH_MM: f64 = 80.0;

/// Farthest that a defect lies after the one before it at the same metre, in mm.
const BESIDE_MM: f64 = 8.0;

/// Plants the defects of a scene's recipe: every kind in turn or the one that is asked for, in places that at least one camera can see; of several at
/// one metre, those beyond the strands that cameras face may be out of sight.
pub fn plant(scene: &Scene) -> Vec<Defect> {
    let recipe = scene.recipe();
    let rope = scene.rope();
    let mut rng = generator(scene.seed(), Stream::Defects);
    let count = recipe.defects;
    let mut kinds: Vec<DefectKind> = Vec::with_capacity(count);
    while kinds.len() < count {
        let mut round = recipe.defect_kind.map_or(KINDS, |kind| [kind; KINDS.len()]);
        round.shuffle(&mut rng);
        kinds.extend(round);
    }
    let room_mm = (recipe.metres - recipe.defect_free_m) * 1000.0 / recipe.defect_sites().max(1) as f64;
    let slack_mm = room_mm - METRES_PER_DEFECT * 1000.0;
    // Where the last defect lies, and the strands of those at its metre.
    let (mut last_mm, mut taken) = (0.0, Vec::new());
    (0..count)
        .map(|id| {
            let kind = kinds[id];
            let (site, at_site) = (id / recipe.defects_at_once, id % recipe.defects_at_once);
            let severity = 0.15 + 0.85 * rng.random::<f64>();
            let (wave, turn) = (rng.random::<f64>(), rng.random::<f64>());
            let site_mm = recipe.defect_free_m * 1000.0
                + site as f64 * room_mm
                + METRES_PER_DEFECT * 500.0
                + slack_mm.max(0.0) * wave;
            let centre_mm = if at_site == 0 { site_mm } else { last_mm + BESIDE_MM * wave };
            last_mm = centre_mm;
            if at_site == 0 {
                taken.clear();
            }
            // the strand that faces a camera (within 50 degrees), and its outermost wire
            let view = rng.random_range(0..scene.views());
            let facing = scene.view_angle_rad(view) + (turn - 0.5) * 1.7;
            let free = (0..rope.strands()).filter(|j| !taken.contains(j));
            let strand = nearest(free, facing, |j| scene.strand_phase_rad(j, centre_mm));
            taken.push(strand);
            let outward = scene.strand_phase_rad(strand, centre_mm);
            let wire = nearest(0..rope.wires(), outward, |i| {
                scene.wires[strand].phase_rad(centre_mm) + i as f64 * rope.wire_step_rad()
            });
            let half_mm = match kind {
                DefectKind::BrokenWire => 0.25 + 1.25 * severity,
                DefectKind::MissingWire => 10.0 + 62.0 * severity,
                DefectKind::Corrosion => 4.0 + 14.0 * severity,
                DefectKind::ArcBurn => 0.8 + 2.4 * severity,
                DefectKind::LiftedWire => 5.0 + 9.0 * severity,
                DefectKind::Notch => 1.5 + 5.0 * severity,
                DefectKind::LooseWire => 15.0 + 30.0 * severity,
                DefectKind::Abrasion => 8.0 + 18.0 * severity,
            };
            let angle_rad = outward + (rng.random::<f64>() - 0.5) * 0.3;
            let (roughness, variety) = (rng.random(), recipe.defect_variety);
            let as_usual =
                Defect { id, kind, severity, strand, wire, centre_mm, half_mm, angle_rad, roughness, variety };
            let longer = match kind {
                DefectKind::ArcBurn => 0.8 * as_usual.departs(Trait::Length) - 0.2 * variety, // many arcs leave but a dot
                _ => 0.5 * as_usual.departs(Trait::Length),
            };
            let half_mm = (half_mm * longer.exp()).min(REACH_MM - 8.0);
            Defect { half_mm, ..as_usual }
        })
        .collect()
}

/// Which of them has the phase nearest to `wanted`.
fn nearest(of: impl Iterator<Item = usize>, wanted: f64, phase: impl Fn(usize) -> f64) -> usize {
    let away = |k: usize| wrap(phase(k) - wanted).abs();
    of.min_by(|&a, &b| away(a).total_cmp(&away(b))).unwrap_or(0)
}

/// The defects that may reach x in `from_mm..=to_mm`, each with its index.
pub fn near(defects: &[Defect], from_mm: f64, to_mm: f64) -> Vec<(usize, &Defect)> {
    let first = defects.partition_point(|d| d.centre_mm + REACH_MM < from_mm);
    defects.iter().enumerate().skip(first).take_while(|(_, d)| d.centre_mm - REACH_MM <= to_mm).collect()
}

/// What defects of one kind may differ in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trait {
    Length,
    Brightness,
    Rim,
    Shape,
    Depth,
    Edge,
}

impl Defect {
    /// How far it departs from others of its kind in a trait: as likely less as more, up to its variety.
    pub(super) fn departs(&self, of: Trait) -> f64 {
        let chance = self.roughness.rotate_left(6 * of as u32).wrapping_mul(0x9E37_79B1);
        self.variety * (f64::from(chance) / f64::from(u32::MAX) * 2.0 - 1.0)
    }

    /// Whether any of it is at `x_mm`.
    pub fn reaches(&self, x_mm: f64) -> bool {
        let margin_mm = match self.kind {
            DefectKind::BrokenWire | DefectKind::MissingWire => 8.0, // ends that stand up
            _ => 2.0,
        };
        (x_mm - self.centre_mm).abs() < self.half_mm + margin_mm
    }

    /// How far its wire is moved at `x_mm`: outward from the strand's axis in mm, and round it in rad.
    pub fn moves_wire(&self, x_mm: f64, wire_radius_mm: f64) -> Option<(f64, f64)> {
        let u = (x_mm - self.centre_mm) / self.half_mm;
        match self.kind {
            DefectKind::LiftedWire if u.abs() < 1.0 => {
                let bump = (0.5 * PI * u).cos().powi(2);
                Some(((0.35 + 1.5 * self.severity) * wire_radius_mm * bump, 0.12 * self.severity * bump))
            }
            DefectKind::LooseWire if u.abs() < 1.0 => {
                let bump = (0.5 * PI * u).cos().powi(2);
                let wander = (TAU * 1.3 * u + f64::from(self.roughness % 7)).sin();
                Some((
                    (0.25 + 0.5 * self.severity) * wire_radius_mm * bump * (0.6 + 0.4 * wander),
                    0.3 * self.severity * bump * wander,
                ))
            }
            DefectKind::BrokenWire | DefectKind::MissingWire => {
                // the tension is gone: ends rise over a few mm
                let past_mm = (x_mm - self.centre_mm).abs() - self.half_mm;
                (past_mm.abs() < 7.0).then(|| {
                    let rise = (1.0 - past_mm.max(0.0) / 7.0).powi(2);
                    (0.22 * self.severity * wire_radius_mm * rise, 0.0)
                })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::Recipe;

    #[test]
    fn every_kind_is_planted_after_the_intact_part_and_apart() {
        let recipe = Recipe { defects: 16, defect_free_m: 4.0, metres: 8.0, ..Recipe::photographic() };
        let scene = Scene::new(&recipe, 5).unwrap();
        let planted = scene.defects();
        assert_eq!(planted.len(), 16);
        for kind in KINDS {
            assert_eq!(planted.iter().filter(|d| d.kind == kind).count(), 2, "{kind:?}");
        }
        assert!(planted.iter().all(|d| d.centre_mm - d.half_mm > 4000.0 && d.centre_mm + d.half_mm < 8000.0));
        assert!(planted.windows(2).all(|w| w[1].centre_mm - w[0].centre_mm >= 149.0));
        assert_eq!(
            near(planted, planted[3].centre_mm, planted[3].centre_mm).iter().filter(|(i, _)| *i == 3).count(),
            1
        );
    }

    #[test]
    fn defects_at_one_metre_lie_on_strands_of_their_own_along_the_rope() {
        let recipe =
            Recipe { defects: 9, defects_at_once: 4, defect_free_m: 1.0, metres: 2.0, ..Recipe::photographic() };
        let scene = Scene::new(&recipe, 3).unwrap();
        let planted = scene.defects();
        assert!(planted.is_sorted_by(|a, b| a.centre_mm <= b.centre_mm) && planted.len() == 9);
        for site in planted.chunks(4) {
            let mut strands: Vec<usize> = site.iter().map(|d| d.strand).collect();
            strands.sort_unstable();
            strands.dedup();
            assert_eq!(strands.len(), site.len(), "{site:?}");
            assert!(site.windows(2).all(|w| w[1].centre_mm - w[0].centre_mm <= BESIDE_MM));
        }
        assert!(planted[4].centre_mm - planted[3].centre_mm > 100.0 && planted[8].centre_mm < 2000.0);
        assert!(Scene::new(&Recipe { defects_at_once: 7, ..recipe }, 3).is_err(), "there are six strands");
    }

    #[test]
    fn defects_of_a_kind_differ_as_far_as_asked_and_none_reaches_too_far() {
        let planted = |defect_variety: f64| {
            let recipe = Recipe { defects: 24, metres: 4.0, defect_variety, ..Recipe::photographic() };
            Scene::new(&recipe, 9).unwrap().defects().to_vec()
        };
        let (alike, various) = (planted(0.0), planted(1.0));
        assert!(alike.iter().all(|d| d.departs(Trait::Rim) == 0.0));
        let departs: Vec<f64> = various.iter().map(|d| d.departs(Trait::Brightness)).collect();
        assert!(departs.iter().any(|d| *d > 0.5) && departs.iter().any(|d| *d < -0.5), "{departs:?}");
        assert!(departs.iter().all(|d| d.abs() <= 1.0));
        assert!(
            various.iter().zip(&alike).all(|(a, b)| a.kind == b.kind && (0.35..1.9).contains(&(a.half_mm / b.half_mm)))
        );
        assert!(various.iter().all(|d| (1..900).all(|k| !d.reaches(d.centre_mm + REACH_MM + 0.1 + f64::from(k)))));
    }
}
