//! What a defect is likely to be, from a few figures that a person can check in the picture.
//!
//! What the shape of the damage tells is learnt (`damage`). Where nobody looked closer, or the shape tells nothing clearly, rules
//! decide: a wire that is gone shows the dark bottom between its neighbours; one that stands out crosses the model's outline;
//! damage to the surface is rougher, brighter or wider than a wire. What shows none of it clearly is called unclear, not guessed.

/// What an alarm shows: sums over its blocks, so that blocks, stretches and alarms add up.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Signs {
    /// Length along the rope in mm.
    pub length_mm: f64,
    /// Length times width across the wires, in mm times wires.
    pub mm_wires: f64,
    /// Surface over the threshold as the camera sees it, in mm2.
    pub area_mm2: f64,
    /// Pixels on the wire with the peak, the sum of their deviations from the expected gray in steps of the gray scale, and of
    /// the changes of these along the rope.
    pub wire: Grays,
    /// The same for the rest of the rope beside it.
    pub beside: Grays,
    /// Farthest that the rope's edge is outside the model's outline, in mm.
    pub beyond_outline_mm: f64,
    /// Direction of the peak round the rope: sums of sine and cosine.
    pub direction: (f64, f64),
    /// What a closer look takes it for.
    pub likely: Likely,
}

/// How much speaks for each way in which a wire can be damaged, in a measure that only its shares tell of.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Likely {
    /// The wire is interrupted.
    pub interrupted: f64,
    /// It stands out.
    pub protruding: f64,
    /// Its surface is changed.
    pub surface: f64,
}

impl Likely {
    /// A changed surface, and nothing else.
    pub const SURFACE: Self = Self { interrupted: 0.0, protruding: 0.0, surface: 1.0 };

    /// Both together.
    pub fn joined(self, other: &Self) -> Self {
        Self {
            interrupted: self.interrupted + other.interrupted,
            protruding: self.protruding + other.protruding,
            surface: self.surface + other.surface,
        }
    }

    /// So much of it.
    pub fn times(self, by: f64) -> Self {
        Self { interrupted: by * self.interrupted, protruding: by * self.protruding, surface: by * self.surface }
    }

    /// What most speaks for, and its share of the whole; `None` if nothing was told.
    fn most(&self) -> Option<(Kind, f64)> {
        let ways = [
            (Kind::Gap, self.interrupted),
            (Kind::ProtrudingWire, self.protruding),
            (Kind::SurfaceChange, self.surface),
        ];
        let (kind, most) = ways.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        (most > 0.0).then(|| (kind, most / (self.interrupted + self.protruding + self.surface)))
    }
}

/// Sums over pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Grays {
    /// Pixels.
    pub pixels: f64,
    /// Deviations from the expected gray, with sign.
    pub deviation: f64,
    /// Absolute changes of the deviation along the rope.
    pub change: f64,
}

impl Grays {
    /// Adds a pixel.
    pub fn add(&mut self, deviation: f64, change: f64) {
        self.pixels += 1.0;
        self.deviation += deviation;
        self.change += change;
    }

    fn join(&mut self, other: &Self) {
        self.pixels += other.pixels;
        self.deviation += other.deviation;
        self.change += other.change;
    }
}

impl Signs {
    /// Adds what another block or alarm shows.
    pub fn join(&mut self, other: &Self) {
        self.length_mm += other.length_mm;
        self.mm_wires += other.mm_wires;
        self.area_mm2 += other.area_mm2;
        self.wire.join(&other.wire);
        self.beside.join(&other.beside);
        self.beyond_outline_mm = self.beyond_outline_mm.max(other.beyond_outline_mm);
        self.direction.0 += other.direction.0;
        self.direction.1 += other.direction.1;
        self.likely = self.likely.joined(&other.likely);
    }

    /// The figures of a defect; `None` if nothing was seen.
    pub fn figures(&self) -> Option<Figures> {
        let some = self.length_mm > 0.0 && self.wire.pixels > 0.0 && self.beside.change > 0.0;
        some.then(|| Figures {
            length_mm: self.length_mm,
            width_wires: self.mm_wires / self.length_mm,
            area_mm2: self.area_mm2,
            gray_steps: self.wire.deviation / self.wire.pixels,
            texture: self.wire.change / self.wire.pixels * self.beside.pixels / self.beside.change,
            beyond_outline_mm: self.beyond_outline_mm,
            angle_rad: self.direction.0.atan2(self.direction.1),
            likely: self.likely,
        })
    }
}

/// What a defect shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Length of what is over the threshold along the rope in mm, reach of the filters included.
    pub length_mm: f64,
    /// Mean width of it across the wires, in wires.
    pub width_wires: f64,
    /// Surface of it as the camera sees it, in mm2.
    pub area_mm2: f64,
    /// Mean deviation from the expected gray on the wire with the peak, in steps of the 32 of the gray scale; negative is darker.
    pub gray_steps: f64,
    /// Change of gray along that wire, as a multiple of that of the rope beside it.
    pub texture: f64,
    /// Farthest that the rope's edge is outside the model's outline, in mm.
    pub beyond_outline_mm: f64,
    /// Angle of the peak round the rope in rad, rope axes: 0 is where view 0 looks.
    pub angle_rad: f64,
    /// What a closer look takes it for.
    pub likely: Likely,
}

/// What a defect is likely to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A wire is interrupted.
    Gap,
    /// A wire is not there over a longer stretch.
    MissingWire,
    /// A wire stands out of the rope.
    ProtrudingWire,
    /// The surface is changed: worn, corroded, burnt, cut.
    SurfaceChange,
    /// The figures decide for nothing.
    Unclear,
}

/// Outside the model's outline from here on, in mm: sound rope and flat damage stay within it.
const PROTRUDES_MM: f64 = 0.55;
/// Darker than expected from here on, in gray steps: a hole and not a stain.
const HOLE_STEPS: f64 = -4.0;
/// A gap longer than this is a missing wire, in mm, reach of the filters included.
const MISSING_MM: f64 = 22.0;
/// A hole is narrower than this, in wires, reach of the filters included.
const HOLE_WIRES: f64 = 3.0;
/// Texture of a damaged surface from here on.
const ROUGH: f64 = 1.5;
/// Gray of a damaged surface from here on, in gray steps either way.
const STAIN_STEPS: f64 = 2.0;
/// Share from which on the shape of the damage is believed.
const SHAPE_TELLS: f64 = 0.5;

impl Figures {
    /// What it is likely to be, and why, in words.
    pub fn kind(&self) -> (Kind, String) {
        let (length, width, gray) = (self.length_mm, self.width_wires, self.gray_steps);
        let protrudes = self.beyond_outline_mm >= PROTRUDES_MM;
        let shape = self.likely.most().filter(|(_, share)| *share >= SHAPE_TELLS);
        // What stands out changes the look of the surface, too, and the outline is the surer sign.
        if let Some((way, share)) = shape.filter(|(way, _)| !(protrudes && *way == Kind::SurfaceChange)) {
            let (kind, words) = match way {
                Kind::Gap if length >= MISSING_MM => (Kind::MissingWire, "an interrupted wire"),
                Kind::Gap => (way, "an interrupted wire"),
                Kind::ProtrudingWire => (way, "a wire that stands out"),
                _ => (way, "a changed surface"),
            };
            let figures = format!("{gray:+.1} gray steps, {:.1} times the usual texture", self.texture);
            let size = format!("{length:.0} mm long, {width:.1} wires wide");
            return (kind, format!("shaped like {words} ({:.0} %): {figures}, {size}", 100.0 * share));
        }
        // The ends of an interrupted wire often stand out, too: the gap is the worse of both.
        if gray <= HOLE_STEPS && width <= HOLE_WIRES {
            let kind = if length >= MISSING_MM { Kind::MissingWire } else { Kind::Gap };
            return (kind, format!("dark ({gray:.1} gray steps) over {length:.0} mm, {width:.1} wires wide"));
        }
        if protrudes {
            return (
                Kind::ProtrudingWire,
                format!("{:.1} mm outside the outline of the model", self.beyond_outline_mm),
            );
        }
        if self.texture >= ROUGH || gray.abs() >= STAIN_STEPS {
            let change = format!("{gray:+.1} gray steps, {:.1} times the usual texture", self.texture);
            return (Kind::SurfaceChange, format!("{change}, {length:.0} mm long, {width:.1} wires wide"));
        }
        let why =
            format!("neither gray ({gray:+.1} steps) nor texture ({:.1} times) nor outline stand out", self.texture);
        (Kind::Unclear, why)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOUND: Figures = Figures {
        length_mm: 8.0,
        width_wires: 1.5,
        area_mm2: 20.0,
        gray_steps: 0.3,
        texture: 1.1,
        beyond_outline_mm: 0.1,
        angle_rad: 0.0,
        likely: Likely { interrupted: 0.0, protruding: 0.0, surface: 0.0 },
    };

    #[test]
    fn the_shape_tells_the_kind_unless_the_outline_contradicts() {
        let shaped = |interrupted: f64, protruding: f64, surface: f64| Figures {
            likely: Likely { interrupted, protruding, surface },
            ..SOUND
        };
        let kind = |figures: Figures| figures.kind().0;
        assert_eq!(kind(shaped(6.0, 1.0, 1.0)), Kind::Gap);
        assert_eq!(kind(Figures { length_mm: 60.0, ..shaped(6.0, 1.0, 1.0) }), Kind::MissingWire);
        assert_eq!(kind(shaped(1.0, 6.0, 1.0)), Kind::ProtrudingWire);
        assert_eq!(kind(shaped(0.0, 0.1, 0.9)), Kind::SurfaceChange);
        assert_eq!(kind(Figures { beyond_outline_mm: 1.2, ..shaped(0.0, 0.1, 0.9) }), Kind::ProtrudingWire);
        assert_eq!(kind(Figures { beyond_outline_mm: 1.2, ..shaped(0.9, 0.1, 0.0) }), Kind::Gap, "its ends stand up");
        assert_eq!(kind(shaped(4.0, 4.0, 4.0)), Kind::Unclear, "no way tells more than the others");
        let (_, why) = shaped(6.0, 1.0, 1.0).kind();
        assert_eq!(
            why,
            "shaped like an interrupted wire (75 %): +0.3 gray steps, 1.1 times the usual texture, 8 mm long, 1.5 wires wide"
        );
    }

    #[test]
    fn each_kind_has_its_figure_and_what_has_none_is_unclear() {
        let kind = |figures: Figures| figures.kind().0;
        assert_eq!(kind(SOUND), Kind::Unclear);
        assert_eq!(kind(Figures { gray_steps: -6.0, ..SOUND }), Kind::Gap);
        assert_eq!(kind(Figures { gray_steps: -6.0, length_mm: 60.0, ..SOUND }), Kind::MissingWire);
        assert_eq!(kind(Figures { gray_steps: -6.0, width_wires: 6.0, ..SOUND }), Kind::SurfaceChange);
        assert_eq!(kind(Figures { texture: 2.5, ..SOUND }), Kind::SurfaceChange);
        assert_eq!(kind(Figures { beyond_outline_mm: 1.2, texture: 2.5, ..SOUND }), Kind::ProtrudingWire);
        assert_eq!(kind(Figures { beyond_outline_mm: 0.7, gray_steps: -6.0, ..SOUND }), Kind::Gap, "its ends stand up");
        let (_, why) = Figures { gray_steps: -6.0, length_mm: 60.0, ..SOUND }.kind();
        assert_eq!(why, "dark (-6.0 gray steps) over 60 mm, 1.5 wires wide");
    }

    #[test]
    fn signs_of_several_blocks_add_up_to_the_figures_of_the_defect() {
        let grays = |pixels: f64, deviation: f64, change: f64| Grays { pixels, deviation, change };
        let mut signs = Signs {
            length_mm: 0.5,
            mm_wires: 0.5,
            area_mm2: 2.0,
            wire: grays(10.0, -50.0, 20.0),
            beside: grays(100.0, 0.0, 100.0),
            beyond_outline_mm: 0.2,
            direction: (1.0, 0.0),
            likely: Likely { interrupted: 1.0, protruding: 0.0, surface: 3.0 },
        };
        let other = Signs { mm_wires: 1.5, beyond_outline_mm: 0.1, wire: grays(10.0, -10.0, 20.0), ..signs };
        signs.join(&other);
        let figures = signs.figures().unwrap();
        assert_eq!((figures.length_mm, figures.width_wires, figures.area_mm2), (1.0, 2.0, 4.0));
        assert_eq!((figures.gray_steps, figures.texture, figures.beyond_outline_mm), (-3.0, 2.0, 0.2));
        assert_eq!(figures.likely, Likely { interrupted: 2.0, protruding: 0.0, surface: 6.0 });
        assert!((figures.angle_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert!(Signs::default().figures().is_none());
    }
}
