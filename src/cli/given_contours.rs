//! Contours measured elsewhere: `contours{v}.csv` (`line,lower_px,upper_px`) beside `rope.json`.

use super::recording::Recording;
use anyhow::{Context, bail};
use std::path::Path;

/// (lower, upper) of every line of a view in px; NaN where the file has no line.
type ViewContours = Vec<(f32, f32)>;

/// Reads the contours of every view. Lines ascend and may have gaps: a line that is absent has no contour.
/// Errors name file, row, column, value and limit.
pub(crate) fn read(folder: &Path, recording: &Recording) -> anyhow::Result<Vec<ViewContours>> {
    let sensor_px = f64::from(recording.acquisition.sensor_px);
    let views = recording.lines.iter().enumerate();
    views.map(|(v, &lines)| read_view(&folder.join(format!("contours{v}.csv")), lines, sensor_px)).collect()
}

fn read_view(path: &Path, lines: usize, sensor_px: f64) -> anyhow::Result<ViewContours> {
    let name = path.display();
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_path(path)
        .with_context(|| format!("--contours given needs {name}"))?;
    let head = reader.headers().with_context(|| format!("cannot read {name}"))?.clone();
    let column = |title: &str| {
        let found = head.iter().position(|h| h == title);
        found.with_context(|| {
            format!(
                "{name} has no column {title}: it must begin with line,lower_px,upper_px, but begins with {}",
                head.iter().collect::<Vec<_>>().join(",")
            )
        })
    };
    let (line_column, columns) = (column("line")?, [column("lower_px")?, column("upper_px")?]);
    let mut contours = vec![(f32::NAN, f32::NAN); lines];
    let mut next_line = 0;
    let mut record = csv::StringRecord::new();
    for row in 2.. {
        if !reader.read_record(&mut record).with_context(|| format!("{name}, row {row}"))? {
            break;
        }
        let cell = |column: usize| record.get(column).unwrap_or_default();
        let Some(line) = cell(line_column).parse::<usize>().ok().filter(|l| (next_line..lines).contains(l)) else {
            bail!(
                "{name}, row {row}: line is {:?}, but must be a whole number from {next_line} (lines ascend) to {} (the last line of the view)",
                cell(line_column),
                lines.saturating_sub(1)
            );
        };
        let mut edges = [0.0; 2];
        for (edge, (column, title)) in edges.iter_mut().zip(columns.into_iter().zip(["lower_px", "upper_px"])) {
            let value = cell(column).parse::<f64>().ok().filter(|px| (-sensor_px..2.0 * sensor_px).contains(px));
            *edge = value.with_context(|| {
                format!(
                    "{name}, row {row} (line {line}): {title} is {:?}, but must be a finite column between -{sensor_px} and {}",
                    cell(column),
                    2.0 * sensor_px
                )
            })?;
        }
        let [lower, upper] = edges;
        if lower >= upper {
            bail!(
                "{name}, row {row} (line {line}): lower_px is {lower}, but must be less than upper_px, which is {upper}"
            );
        }
        contours[line] = (lower as f32, upper as f32);
        next_line = line + 1;
    }
    if next_line == 0 {
        bail!("{name} has no contours: it must have a row for each of the {lines} lines of the view");
    }
    Ok(contours)
}

#[cfg(test)]
mod tests {
    use super::read_view;

    fn read(text: &str) -> Result<Vec<(f32, f32)>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("contours0.csv");
        std::fs::write(&path, text).unwrap();
        read_view(&path, 5, 480.0).map_err(|e| format!("{e:#}").rsplit_once('/').unwrap().1.to_owned())
    }

    #[test]
    fn lines_may_be_absent_and_are_then_without_contour() {
        let contours = read("line,lower_px,upper_px\n1,50.25,430\n4, 51 ,431\n").unwrap();
        assert_eq!((contours.len(), contours[1], contours[4]), (5, (50.25, 430.0), (51.0, 431.0)));
        assert!(contours[0].0.is_nan() && contours[2].1.is_nan());
    }

    #[test]
    fn what_is_wrong_is_named_with_file_row_value_and_limit() {
        let head = "line,lower_px,upper_px\n";
        for (rows, error) in [
            ("0,50,430\n0,50,430\n", "row 3: line is \"0\", but must be a whole number from 1 (lines ascend) to 4"),
            ("5,50,430\n", "row 2: line is \"5\", but must be a whole number from 0 (lines ascend) to 4"),
            ("0,nan,430\n", "row 2 (line 0): lower_px is \"nan\", but must be a finite column between -480 and 960"),
            ("2,50,\n", "row 2 (line 2): upper_px is \"\", but must be a finite column"),
            ("2,430,50\n", "row 2 (line 2): lower_px is 430, but must be less than upper_px, which is 50"),
            ("", "has no contours: it must have a row for each of the 5 lines"),
        ] {
            let said = read(&format!("{head}{rows}")).unwrap_err();
            assert!(said.starts_with("contours0.csv") && said.contains(error), "{said}");
        }
        assert!(read("line,left\n").unwrap_err().contains("no column lower_px"));
    }
}
