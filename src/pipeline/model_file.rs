//! Appearance models on disk: a header that people can read, and compressed tables.

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

const MAGIC: &[u8] = b"ropescope model 14\n";
/// How models of every version begin.
const KIND: &[u8] = b"ropescope model ";
/// Longest header that is read, in bytes.
const MAX_HEADER_BYTES: u32 = 1 << 20;
/// How far the diameter of a rope may be off its model's, as a share.
const DIAMETER_TOLERANCE: f64 = 0.02;

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

/// What must agree between a model and an acquisition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Construction {
    strands: usize,
    wires: usize,
    diameter_mm: f64,
    views: usize,
    text: String,
}

#[derive(Serialize, Deserialize)]
struct Header {
    report: TrainReport,
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
        let construction = Construction {
            strands: acquisition.rope.strands(),
            wires: acquisition.rope.wires(),
            diameter_mm: acquisition.rope.diameter_mm(),
            views: acquisition.view_angles_rad.len(),
            text: acquisition.construction(),
        };
        Self { report, construction, views, lasting }
    }

    /// Refuses an acquisition of another rope.
    pub fn check(&self, acquisition: &Acquisition) -> Result<(), PipelineError> {
        let c = &self.construction;
        let same = c.strands == acquisition.rope.strands()
            && c.wires == acquisition.rope.wires()
            && c.views == acquisition.view_angles_rad.len()
            && (c.diameter_mm / acquisition.rope.diameter_mm() - 1.0).abs() <= DIAMETER_TOLERANCE;
        if same {
            return Ok(());
        }
        Err(PipelineError::ModelOfAnotherRope { model: c.text.clone(), acquisition: acquisition.construction() })
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
        let views = header.construction.views;
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
        return Err(unusable("it does not begin like a model of this version".into()));
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
