//! Appearance models on disk: a header that people can read, and compressed tables.

use super::construction::Construction;
use super::tables::write_error;
use super::train::TrainReport;
use super::{Acquisition, PipelineError};
use crate::vision::appearance::{Appearance, TABLES};
use crate::vision::calibration::{FilterCalibration, RegionLevel};
use crate::vision::factor::FACTORS;
use crate::vision::histogram::{CELLS, REGIONS};
use crate::vision::inspection_model::ViewAppearance;
use crate::vision::lasting::Lasting;
use crate::vision::usual::Usual;
use serde::{Deserialize, Serialize};
use std::io::{BufReader, Read, Write};
use std::path::Path;

const MAGIC: &[u8] = b"ropescope model 15\n";
/// How models of every version begin.
const KIND: &[u8] = b"ropescope model ";
/// Longest header that is read, in bytes.
const MAX_HEADER_BYTES: u32 = 1 << 20;
/// How far the diameter of a rope may be off its model's, as a share: rope wears, and is measured anew.
const DIAMETER_TOLERANCE: f64 = 0.02;
/// The same of the line pitch: the encoder's wheel wears and slips, and within this a block has as many lines as in training.
const PITCH_TOLERANCE: f64 = 0.05;

/// A trained model.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// What it was trained on.
    pub report: TrainReport,
    construction: Construction,
    /// One entry a view.
    pub views: Vec<ViewAppearance>,
    /// How scores that last along the rope are judged.
    pub lasting: Lasting,
}

#[derive(Serialize, Deserialize)]
struct Header {
    report: TrainReport,
    /// What must agree between a model and an acquisition.
    construction: Construction,
    /// `[view][factor][filter]`.
    calibration: Vec<Vec<Vec<Option<CalibrationNumbers>>>>,
    /// Cut, from and rise of [`Lasting`].
    lasting: [f32; 3],
    /// Floats of the tables of the gray value.
    table_lens: [usize; 3],
}

impl Model {
    /// A model for the rope of an acquisition.
    pub fn new(acquisition: &Acquisition, report: TrainReport, views: Vec<ViewAppearance>, lasting: Lasting) -> Self {
        Self { report, construction: Construction::of(acquisition), views, lasting }
    }

    /// Refuses an acquisition of another rope, or by another camera head: scores would mean something else there, and at coarser lines
    /// nobody looks closer. Images may be wider or narrower than those that taught, because places are found on the rope.
    pub fn check(&self, acquisition: &Acquisition) -> Result<(), PipelineError> {
        let shown = Construction::of(acquisition);
        if let Some(difference) = self.construction.other_rope(&shown, DIAMETER_TOLERANCE) {
            return Err(PipelineError::ModelOfAnotherRope { difference });
        }
        match self.construction.other_head(&shown, PITCH_TOLERANCE) {
            Some(difference) => Err(PipelineError::ModelOfAnotherHead { difference }),
            None => Ok(()),
        }
    }

    /// Writes the model, whole or not at all: to a temporary file beside it, synced, then renamed.
    pub fn write(&self, path: &Path) -> Result<(), PipelineError> {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let failed = |source| PipelineError::Write { path: path.into(), source };
        let mut file = tempfile::NamedTempFile::new_in(folder).map_err(failed)?;
        let header = Header {
            report: self.report.clone(),
            construction: self.construction.clone(),
            calibration: self
                .views
                .iter()
                .map(|v| {
                    let of_factor = |filters: &Vec<Option<FilterCalibration>>| {
                        filters.iter().map(|c| c.as_ref().map(CalibrationNumbers::of)).collect()
                    };
                    v.calibration.iter().map(of_factor).collect()
                })
                .collect(),
            lasting: [self.lasting.cut, self.lasting.from, self.lasting.rise],
            table_lens: TABLES,
        };
        let header = serde_json::to_vec(&header).map_err(|e| write_error(path)(e.into()))?;
        let mut write = || {
            file.write_all(MAGIC)?;
            file.write_all(&(header.len() as u32).to_le_bytes())?;
            file.write_all(&header)?;
            let mut packer = zstd::Encoder::new(&mut file, 3)?;
            for view in &self.views {
                let further = view.further.iter().flat_map(Usual::tables);
                for value in view.gray.tables().into_iter().chain(further).flatten() {
                    packer.write_all(&value.to_le_bytes())?;
                }
            }
            packer.finish()?;
            file.as_file().sync_all()
        };
        write().map_err(failed)?;
        file.persist(path).map_err(|e| failed(e.error))?;
        Ok(())
    }

    /// Reads a model. Errors: not a model, another version, cut short.
    pub fn read(path: &Path) -> Result<Self, PipelineError> {
        let unusable = |reason: String| PipelineError::Model { path: path.into(), reason };
        let (header, rest) = read_header(path)?;
        let views = header.construction.views();
        if header.table_lens != TABLES || header.calibration.len() != views {
            return Err(unusable(format!(
                "its tables have {:?} entries, this version uses {TABLES:?}",
                header.table_lens
            )));
        }
        let mut unpacker = zstd::Decoder::with_buffer(rest).map_err(|e| unusable(e.to_string()))?;
        let mut table = |len: usize| -> Result<Vec<f32>, PipelineError> {
            let mut bytes = vec![0u8; len * 4];
            unpacker.read_exact(&mut bytes).map_err(|e| unusable(format!("it is cut short or damaged ({e})")))?;
            Ok(bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
        };
        let wrong_size = |what: &str| unusable(format!("its {what} has the wrong size"));
        let mut views = Vec::new();
        for factors in &header.calibration {
            let [likelihood, score, expected] = TABLES;
            let gray = Appearance::from_tables([table(likelihood)?, table(score)?, table(expected)?]);
            let gray = gray.ok_or_else(|| wrong_size("appearance"))?;
            let mut usual =
                || Usual::from_tables([table(CELLS)?, table(CELLS)?]).ok_or_else(|| wrong_size("appearance"));
            // As many as are calibrated beside the gray value: a model may be cut down to that.
            let known = FACTORS.len().min(factors.len().saturating_sub(1));
            let further = (0..known).map(|_| usual()).collect::<Result<_, _>>()?;
            let filter = |numbers: &Option<CalibrationNumbers>| {
                numbers.as_ref().map(|n| n.calibration().ok_or_else(|| wrong_size("calibration"))).transpose()
            };
            let calibration = factors.iter().map(|filters| filters.iter().map(filter).collect());
            let calibration = calibration.collect::<Result<_, _>>()?;
            views.push(ViewAppearance { gray, further, calibration });
        }
        let [cut, from, rise] = header.lasting;
        let lasting = Lasting { cut, from, rise };
        Ok(Self { report: header.report, construction: header.construction, views, lasting })
    }
}

/// A [`FilterCalibration`] as it is stored.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct CalibrationNumbers {
    shared: f64,
    pixels: f64,
    both_ways: bool,
    one_in_100: f64,
    one_in_1000: f64,
    /// `[region]`: middle, upward.
    regions: Vec<[f32; 2]>,
}

impl CalibrationNumbers {
    fn of(c: &FilterCalibration) -> Self {
        let regions = c.regions.iter().map(|r| [r.middle, r.upward]).collect();
        let FilterCalibration { shared, pixels, both_ways, one_in_100, one_in_1000, .. } = *c;
        Self { shared, pixels, both_ways, one_in_100, one_in_1000, regions }
    }

    fn calibration(&self) -> Option<FilterCalibration> {
        let regions = self.regions.iter().map(|&[middle, upward]| RegionLevel { middle, upward }).collect();
        let Self { shared, pixels, both_ways, one_in_100, one_in_1000, .. } = *self;
        (self.regions.len() == REGIONS).then_some(FilterCalibration {
            shared,
            pixels,
            both_ways,
            one_in_100,
            one_in_1000,
            regions,
        })
    }
}

fn read_header(path: &Path) -> Result<(Header, BufReader<std::fs::File>), PipelineError> {
    let unusable = |reason: String| PipelineError::Model { path: path.into(), reason };
    let mut file = BufReader::new(std::fs::File::open(path).map_err(|e| unusable(e.to_string()))?);
    let mut magic = vec![0u8; MAGIC.len()];
    let mut length = [0u8; 4];
    let whole = file.read_exact(&mut magic).and_then(|()| file.read_exact(&mut length));
    if whole.is_err() || magic != MAGIC {
        let number = |magic: &[u8]| -> String {
            magic[KIND.len()..].iter().map(|&b| char::from(b)).take_while(char::is_ascii_digit).collect()
        };
        return Err(unusable(if magic.starts_with(KIND) && magic != MAGIC {
            format!("it is of version {}, and this program reads {}: train anew", number(&magic), number(MAGIC))
        } else {
            "it does not begin like a model".to_owned()
        }));
    }
    let length = u32::from_le_bytes(length);
    if length > MAX_HEADER_BYTES {
        return Err(unusable(format!("its header claims {length} bytes, at most {MAX_HEADER_BYTES} are read")));
    }
    let mut header = vec![0u8; length as usize];
    file.read_exact(&mut header).map_err(|e| unusable(format!("it is cut short ({e})")))?;
    let header = serde_json::from_slice(&header).map_err(|e| unusable(format!("its header is damaged ({e})")))?;
    Ok((header, file))
}

/// True if a file is a model, of this version or another: one that may be replaced by a new one.
pub fn is_model(path: &Path) -> bool {
    let mut begin = vec![0u8; KIND.len()];
    std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut begin)).is_ok() && begin == KIND
}

/// Reads what a model says of its training, without its tables.
pub fn read_report(path: &Path) -> Result<TrainReport, PipelineError> {
    Ok(read_header(path)?.0.report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::training_range::tests::acquisition;
    use serde_json::json;

    fn model(acquisition: &Acquisition) -> Model {
        let report = json!({
            "construction": acquisition.construction(), "from_m": 0.0, "to_m": 5.0, "learnt_view_m": 10.0, "threshold": 6.0,
            "threshold_origin": "a test", "seconds": 1.0, "notes": [],
        });
        Model::new(acquisition, serde_json::from_value(report).unwrap(), Vec::new(), Lasting::NEVER)
    }

    #[test]
    fn another_rope_or_camera_head_is_refused_with_both_values_and_a_way_out() {
        let model = model(&acquisition(|_| ()));
        for (key, value, words) in [
            ("wires_per_strand", json!(8), "rope with a number of wires per strand of 9, but this acquisition shows 8"),
            ("rope_diameter_mm", json!(31.0), "rope with a rope diameter of 32 mm, but this acquisition shows 31 mm"),
            (
                "strand_lay_mm",
                json!(-220.0),
                "rope with a strand lay of right-hand, but this acquisition shows left-hand",
            ),
            ("wire_lay_mm", json!(95.0), "rope with a wire lay of left-hand, but this acquisition shows right-hand"),
        ] {
            let error = model.check(&acquisition(|file| file[key] = value)).unwrap_err();
            assert!(matches!(error, PipelineError::ModelOfAnotherRope { .. }));
            let error = error.to_string();
            assert!(error.contains(words) && error.ends_with(": use a model of this rope, or train one"), "{error}");
        }
        let one_view = json!([{"folder": "view0", "angle_deg": 0.0}]);
        let turned = json!([{"folder": "view0", "angle_deg": 0.0}, {"folder": "view1", "angle_deg": 120.0}]);
        for (key, value, words) in [
            ("line_pitch_mm", json!(0.3), "a line pitch of 0.1 mm, but this acquisition has 0.3 mm"),
            ("views", one_view, "a number of views of 2, but this acquisition has 1"),
            ("views", turned, "an angle of view 1 of 90.0 degrees, but this acquisition has 120.0 degrees"),
        ] {
            let error = model.check(&acquisition(|file| file[key] = value)).unwrap_err();
            assert!(matches!(error, PipelineError::ModelOfAnotherHead { .. }));
            let error = error.to_string();
            assert!(
                error.contains(words) && error.contains(": use a model that was trained on recordings like"),
                "{error}"
            );
        }
    }

    #[test]
    fn another_day_of_the_rope_is_taken_with_a_diameter_that_was_measured_anew() {
        let model = model(&acquisition(|_| ()));
        let other = acquisition(|file| {
            file["start_m"] = json!(3.0);
            file["rope_diameter_mm"] = json!(31.5);
            file["strand_lay_mm"] = json!(218.0);
            file["sensor_px"] = json!(512);
            file["views"][1]["angle_deg"] = json!(89.5);
            file.as_object_mut().unwrap().remove("wire_lay_mm");
        });
        model.check(&other).unwrap();
    }

    #[test]
    fn what_must_agree_is_the_same_when_it_is_read_back() {
        let acquisition = acquisition(|file| file["views"][1]["angle_deg"] = json!(33.3));
        let written = serde_json::to_vec(&Construction::of(&acquisition)).unwrap();
        let read = Model { construction: serde_json::from_slice(&written).unwrap(), ..model(&acquisition) };
        read.check(&acquisition).unwrap();
    }

    #[test]
    fn models_of_other_versions_are_told_from_what_is_no_model() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("old.model");
        let said = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            Model::read(&path).unwrap_err().to_string()
        };
        let old = said(b"ropescope model 9\n{}     ");
        assert!(old.ends_with("it is of version 9, and this program reads 15: train anew"), "{old}");
        for bytes in [&b"a picture, which is long enough to be read"[..], b"ropescope model 15\n", b"", b"ropes"] {
            assert!(said(bytes).ends_with("it does not begin like a model"), "{}", said(bytes));
        }
    }
}
