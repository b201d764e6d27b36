//! Results against truth, by the protocols of [Wacker13, sec. 6.2]: lay-length errors, displacement, line ROC, 50 % recovery,
//! defects found and metres to inspect again.

pub mod bound; // what nobody can beat
pub mod boxes; // distributions of errors as boxes
pub mod costs; // what a threshold finds, and what it costs
pub mod curves; // ROC curves, view by view and averaged
pub mod defects; // what was decided: found, false, metres to inspect again
pub mod displacement;
pub mod intervals; // whether standard deviations keep their word
pub mod kinds; // what defects were taken for
pub mod labels; // which lines of which view show a defect
pub mod lay_lengths;
pub mod line_scores; // of every view
pub mod recall; // every single defect
pub mod report; // everything together, as JSON and for people
pub mod roc; // line scores against labels
pub mod shape; // true diameter, ovality and looseness
pub mod table; // CSV, row by row
mod told_apart; // defects with a report of their own
pub mod truth; // what the recording says of itself

pub use report::{Evaluation, evaluate};
pub use table::EvaluateError;
