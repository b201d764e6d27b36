//! Intact rope to learn from: a range of an acquisition. Of several, whether they show one rope, seen by one camera head.

use super::construction::{Construction, Difference, ROUNDING, differs};
use super::{Acquisition, FrameSource, PipelineError};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Most ranges that teach one model: a choice, for lists that come from outside.
pub const MOST_RANGES: usize = 16;

/// A range of an acquisition that is known to be intact.
#[derive(Clone, Copy)]
pub struct TrainingRange<'a> {
    /// How reports and errors name the acquisition: by its folder or its id. Equal names are the same frames.
    pub name: &'a str,
    /// The acquisition.
    pub acquisition: &'a Acquisition,
    /// Its frames.
    pub source: &'a dyn FrameSource,
    /// Rope metre from which on the rope is intact; `None`: from the start.
    pub from_m: Option<f64>,
    /// Rope metre up to which it is; `None`: to the end.
    pub to_m: Option<f64>,
}

/// What an acquisition gave to a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LearntFrom {
    /// The acquisition, by its folder or its id.
    pub acquisition: String,
    /// Rope metres used.
    pub from_m: f64,
    /// Rope metres used.
    pub to_m: f64,
    /// Metres of rope that were aligned and learnt from, summed over the views.
    pub learnt_view_m: f64,
}

impl TrainingRange<'_> {
    /// Lines of the range, whether or not there are as many.
    pub(super) fn lines(&self) -> Range<usize> {
        let line = |position_m: f64| {
            ((position_m - self.acquisition.start_m) * 1000.0 / self.acquisition.line_pitch_mm).round().max(0.0)
                as usize
        };
        self.from_m.map_or(0, line)..self.to_m.map_or(usize::MAX, line)
    }
}

/// Refuses ranges that cannot teach one model: of different ropes, of different camera heads, or of the same rope twice.
pub(super) fn check(ranges: &[TrainingRange<'_>]) -> Result<(), PipelineError> {
    for (number, range) in ranges.iter().enumerate() {
        if let Some(difference) = difference(ranges[0].acquisition, range.acquisition) {
            return Err(PipelineError::AcquisitionsDiffer { acquisition: range.name.to_owned(), difference });
        }
        let twice = |other: &&TrainingRange<'_>| {
            other.name == range.name && overlap((other.from_m, other.to_m), (range.from_m, range.to_m))
        };
        if ranges[..number].iter().any(|other| twice(&other)) {
            return Err(PipelineError::RangesOverlap { acquisition: range.name.to_owned() });
        }
    }
    Ok(())
}

/// True if two ranges of one acquisition share rope. Such rope would be judged by what it has taught itself.
pub fn overlap(a: (Option<f64>, Option<f64>), b: (Option<f64>, Option<f64>)) -> bool {
    let begins = |range: (Option<f64>, Option<f64>)| range.0.unwrap_or(f64::NEG_INFINITY);
    let ends = |range: (Option<f64>, Option<f64>)| range.1.unwrap_or(f64::INFINITY);
    begins(a) < ends(b) && begins(b) < ends(a)
}

/// The first thing in which two acquisitions differ and must not, to teach one model. Lays may differ, only their hand may not.
pub fn difference(first: &Acquisition, other: &Acquisition) -> Option<Difference> {
    let (one, another) = (Construction::of(first), Construction::of(other));
    let columns = |acquisition: &Acquisition| format!("{} px", acquisition.sensor_px);
    one.other_rope(&another, ROUNDING)
        .or_else(|| one.other_head(&another, ROUNDING))
        .or_else(|| differs("an image width", columns(first), columns(other)))
}

/// What every acquisition gave, as a sentence.
pub(super) fn sentence(learnt_from: &[LearntFrom], views: usize) -> String {
    let of_one = |from: &LearntFrom| {
        let gave = if from.learnt_view_m > 0.0 {
            format!("{:.2} m of each view on average", from.learnt_view_m / views as f64)
        } else {
            "nothing, because none of it could be aligned".to_owned()
        };
        format!("{} (metre {:.2} to {:.2}) gave {gave}", from.acquisition, from.from_m, from.to_m)
    };
    learnt_from.iter().map(of_one).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::pipeline::{FrameFiles, RopeFile};
    use serde_json::{Value, json};

    /// An acquisition by two views, changed as a test wants it.
    pub fn acquisition(change: impl FnOnce(&mut Value)) -> Acquisition {
        let mut file = json!({
            "strands": 6, "wires_per_strand": 9, "rope_diameter_mm": 32.0, "strand_lay_mm": 220.0, "wire_lay_mm": -95.0,
            "line_pitch_mm": 0.1, "sensor_px": 480, "rope_width_px": 380.0, "start_m": 100.0,
            "views": [{"folder": "view0", "angle_deg": 0.0}, {"folder": "view1", "angle_deg": 90.0}],
        });
        change(&mut file);
        serde_json::from_value::<RopeFile>(file).unwrap().validate().unwrap()
    }

    #[test]
    fn what_keeps_acquisitions_from_teaching_one_model_is_named_with_both_values() {
        let first = acquisition(|_| ());
        for (key, value, quantity, values) in [
            ("strands", json!(7), "a number of strands", ("6", "7")),
            ("wires_per_strand", json!(8), "a number of wires per strand", ("9", "8")),
            ("rope_diameter_mm", json!(31.0), "a rope diameter", ("32 mm", "31 mm")),
            ("strand_lay_mm", json!(-220.0), "a strand lay", ("right-hand", "left-hand")),
            ("wire_lay_mm", json!(95.0), "a wire lay", ("left-hand", "right-hand")),
            ("views", json!([{"folder": "v", "angle_deg": 0.0}]), "a number of views", ("2", "1")),
            ("line_pitch_mm", json!(0.2), "a line pitch", ("0.1 mm", "0.2 mm")),
            ("sensor_px", json!(512), "an image width", ("480 px", "512 px")),
        ] {
            let found = difference(&first, &acquisition(|file| file[key] = value)).unwrap();
            assert_eq!((found.quantity.as_str(), (found.first.as_str(), found.other.as_str())), (quantity, values));
        }
        let turned = acquisition(|file| file["views"][1]["angle_deg"] = json!(120.0));
        let found = difference(&first, &turned).unwrap().to_string();
        assert_eq!(found, "an angle of view 1 of 120.0 degrees, but the first one has 90.0 degrees");
    }

    #[test]
    fn another_day_may_differ_in_place_lays_and_what_nobody_wrote_down() {
        let first = acquisition(|_| ());
        let other = acquisition(|file| {
            file["start_m"] = json!(3.0);
            file["strand_lay_mm"] = json!(218.0);
            file["rope_width_px"] = json!(384.0);
            file["views"][0]["angle_deg"] = json!(360.0);
            file["views"][1]["angle_deg"] = json!(89.5);
            file.as_object_mut().unwrap().remove("wire_lay_mm");
        });
        assert_eq!(difference(&first, &other), None);
    }

    #[test]
    fn rope_cannot_teach_twice_but_two_ranges_of_one_acquisition_can() {
        let (acquisition, source) = (acquisition(|_| ()), FrameFiles::new(480, vec![Vec::new(); 2]));
        let range =
            |name, from_m, to_m| TrainingRange { name, acquisition: &acquisition, source: &source, from_m, to_m };
        let (a, b) = (range("a", None, Some(102.0)), range("a", Some(102.0), Some(104.0)));
        check(&[a, b, range("b", None, None)]).unwrap();
        let error = check(&[a, b, range("a", Some(103.0), None)]).unwrap_err();
        assert!(error.to_string().starts_with("a is named twice, with ranges that overlap"), "{error}");
        assert_eq!((a.lines(), b.lines()), (0..20_000, 20_000..40_000));
    }
}
