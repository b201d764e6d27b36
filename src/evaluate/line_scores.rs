//! Line scores of a results folder: the table of the command line, or the files that the service keeps.

use super::table::{EvaluateError, Table};
use std::io::ErrorKind;
use std::path::Path;

/// Reads `RESULTS/line_scores.csv`, or else `RESULTS/line_scores_view{v}.f32`: per view a score per line, NaN where there is none. `None`
/// without either.
pub fn read_scores(results: &Path, lines: usize, views: usize) -> Result<Option<Vec<Vec<f64>>>, EvaluateError> {
    let Some(mut table) = Table::open(&results.join("line_scores.csv"))? else {
        return (0..views).map(|view| read_view(results, view, lines)).collect();
    };
    let (view, line, score) = (table.column("view")?, table.column("line")?, table.column("score")?);
    let mut scores = vec![vec![f64::NAN; lines]; views];
    while table.next_row()? {
        let (view, line) = (table.index(view)?, table.index(line)?);
        if let Some(place) = scores.get_mut(view).and_then(|s| s.get_mut(line)) {
            *place = table.number(score).unwrap_or(f64::NAN);
        }
    }
    Ok(Some(scores))
}

/// Little-endian f32, one a line from the first on.
fn read_view(results: &Path, view: usize, lines: usize) -> Result<Option<Vec<f64>>, EvaluateError> {
    let path = results.join(format!("line_scores_view{view}.f32"));
    let bytes = match std::fs::read(&path) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(EvaluateError::Read { path, source }),
    };
    let mut scores: Vec<f64> =
        bytes.as_chunks::<4>().0.iter().map(|score| f64::from(f32::from_le_bytes(*score))).collect();
    scores.resize(lines, f64::NAN);
    Ok(Some(scores))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_and_the_files_of_the_service_say_the_same() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(read_scores(folder.path(), 3, 2).unwrap(), None);
        let views = [[1.5f32, f32::NAN, -2.0], [0.25, 3.0, f32::NAN]];
        for (view, scores) in views.iter().enumerate() {
            let bytes: Vec<u8> = scores[..2 + (1 - view)].iter().flat_map(|score| score.to_le_bytes()).collect();
            std::fs::write(folder.path().join(format!("line_scores_view{view}.f32")), bytes).unwrap();
        }
        let files = read_scores(folder.path(), 3, 2).unwrap().unwrap();
        let table = "view,line,score\n0,0,1.5\n0,2,-2\n1,0,0.25\n1,1,3\n";
        std::fs::write(folder.path().join("line_scores.csv"), table).unwrap();
        let rows = read_scores(folder.path(), 3, 2).unwrap().unwrap();
        let bits = |scores: &[Vec<f64>]| scores.iter().flatten().map(|s| s.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&files), bits(&rows), "{files:?}");
    }
}
