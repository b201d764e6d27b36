//! Camera lines in queries: numbers that a view can have, and ranges of them.

use super::Problem;
use super::acquisitions::MAX_FRAMES;
use crate::pipeline::source::MAX_FRAME_LINES;
use serde::Deserialize;
use utoipa::ToSchema;

/// Most lines of a view: as many frames as it may have, as long as they may be.
const MAX_LINE: u64 = MAX_FRAMES as u64 * MAX_FRAME_LINES as u64;

/// The number of a camera line, or the one after the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(try_from = "u64")]
#[schema(maximum = 65_536_000_000_u64)]
pub struct LineNumber(u64);

impl LineNumber {
    /// The number.
    pub fn get(self) -> u64 {
        self.0
    }
}

impl TryFrom<u64> for LineNumber {
    type Error = String;

    fn try_from(line: u64) -> Result<Self, String> {
        if line > MAX_LINE {
            return Err(format!("the line is {line}, but no view has more than {MAX_LINE} lines"));
        }
        Ok(Self(line))
    }
}

/// The range `[from, to)` of a view of so many lines; what is not said is its start and its end. Errors: nothing is left.
pub fn line_range(from: Option<LineNumber>, to: Option<LineNumber>, lines: u64) -> Result<(u64, u64), Problem> {
    let (from, to) = (from.map_or(0, |l| l.0), to.map_or(lines, |l| l.0));
    not_empty(from, to, lines)
}

/// Cuts a range of lines to those that a view has. Errors: nothing is left.
pub fn not_empty(from: u64, to: u64, lines: u64) -> Result<(u64, u64), Problem> {
    let to = to.min(lines);
    if from < to {
        return Ok((from, to));
    }
    Err(Problem::out_of_range(format!(
        "the range begins at line {from} and ends before line {to}, so it is empty; the view has {lines} lines"
    ))
    .limit(from, to))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_number_is_one_that_a_view_can_have() {
        assert_eq!(LineNumber::try_from(MAX_LINE), Ok(LineNumber(65_536_000_000)), "the contract says so too");
        assert!(LineNumber::try_from(MAX_LINE + 1).unwrap_err().contains("65536000000"));
    }

    #[test]
    fn a_range_is_cut_to_what_there_is_and_never_empty() {
        let line = |n| Some(LineNumber(n));
        assert_eq!(line_range(None, None, 300).unwrap(), (0, 300));
        assert_eq!(line_range(line(7), line(1000), 300).unwrap(), (7, 300));
        assert!(line_range(line(300), None, 300).is_err());
    }
}
