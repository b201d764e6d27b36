//! A report page: Markdown with figures as SVG and every figure's numbers as CSV beside it.

use super::{ExperimentError, Provenance};
use crate::drawing::chart::{Chart, svg};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The page of a report.
const PAGE: &str = "report.md";

/// A page that is being written.
pub(super) struct Page {
    folder: PathBuf,
    text: String,
    /// Figures and numbers: name and content. Written at the end, so that a run which is stopped leaves no half report.
    files: Vec<(String, String)>,
}

/// Refuses a folder that holds something else than an earlier report, before minutes are spent.
pub fn check_folder(folder: &Path) -> Result<(), ExperimentError> {
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(source) => return Err(ExperimentError::Write { path: folder.into(), source }),
    };
    let first = entries.flatten().next();
    match first {
        Some(entry) if !folder.join(PAGE).exists() => Err(ExperimentError::NotAReport {
            folder: folder.into(),
            entry: entry.file_name().to_string_lossy().into_owned(),
        }),
        _ => Ok(()),
    }
}

impl Page {
    /// A page with its title and how it was made, simulated from a seed or not; makes the folder.
    pub fn new(folder: &Path, title: &str, made: &Provenance, seed: Option<u64>) -> Result<Self, ExperimentError> {
        std::fs::create_dir_all(folder).map_err(failed(folder))?;
        let seed = seed.map_or(String::new(), |seed| format!(", seed {seed}"));
        let version = env!("CARGO_PKG_VERSION");
        let text = format!(
            "# {title}\n\n`{}`{seed}, {}, version {version}. The same command makes the same figures.\n",
            made.command, made.date
        );
        Ok(Self { folder: folder.into(), text, files: Vec::new() })
    }

    pub fn heading(&mut self, words: &str) {
        let _ = write!(self.text, "\n## {words}\n");
    }

    pub fn paragraph(&mut self, words: &str) {
        let _ = write!(self.text, "\n{words}\n");
    }

    /// A table; cells of numbers are written as they shall be read.
    pub fn table<const N: usize>(&mut self, head: [&str; N], rows: impl IntoIterator<Item = [String; N]>) {
        let _ = write!(self.text, "\n| {} |\n|{}\n", head.join(" | "), "---|".repeat(N));
        for row in rows {
            let _ = writeln!(self.text, "| {} |", row.join(" | "));
        }
    }

    /// A figure of charts, `columns` side by side, as `{name}.svg`.
    pub fn figure(&mut self, name: &str, words: &str, charts: &[Chart], columns: usize) {
        let file = format!("{name}.svg");
        let _ = write!(self.text, "\n![{words}]({file})\n");
        self.files.push((file, svg(charts, columns)));
    }

    /// The numbers of a figure as `{name}.csv`, linked from the page.
    pub fn numbers<const N: usize>(
        &mut self,
        name: &str,
        head: [&str; N],
        rows: impl IntoIterator<Item = [String; N]>,
    ) {
        let file = format!("{name}.csv");
        let mut text = head.join(",") + "\n";
        for row in rows {
            text += &(row.join(",") + "\n");
        }
        let _ = write!(self.text, "\nNumbers: [{file}]({file})\n");
        self.files.push((file, text));
    }

    /// Writes the page, after all that it shows.
    pub fn finish(self) -> Result<PathBuf, ExperimentError> {
        self.files.iter().try_for_each(|(name, text)| self.put(name, text))?;
        self.put(PAGE, &self.text)?;
        Ok(self.folder.join(PAGE))
    }

    fn put(&self, name: &str, text: &str) -> Result<(), ExperimentError> {
        let path = self.folder.join(name);
        std::fs::write(&path, text).map_err(failed(&path))
    }
}

fn failed(path: &Path) -> impl FnOnce(std::io::Error) -> ExperimentError + use<'_> {
    move |source| ExperimentError::Write { path: path.into(), source }
}

/// A number with so many digits after the point; a dash where there is none.
pub(super) fn number(value: Option<f64>, digits: usize) -> String {
    value.filter(|v| v.is_finite()).map_or("-".into(), |v| format!("{v:.digits$}"))
}

/// A share in per cent.
pub(super) fn percent(share: Option<f64>, digits: usize) -> String {
    share.filter(|v| v.is_finite()).map_or("-".into(), |v| format!("{:.digits$} %", 100.0 * v))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_something_else_is_refused_and_an_earlier_report_is_not() {
        let folder = tempfile::tempdir().unwrap();
        check_folder(&folder.path().join("new")).unwrap();
        std::fs::write(folder.path().join("holiday.jpg"), "").unwrap();
        let error = check_folder(folder.path()).unwrap_err().to_string();
        assert!(error.contains("holds holiday.jpg but no earlier report: choose another folder"), "{error}");
        let made = Provenance { command: "ropescope evaluate".into(), date: "2026-11-22".into() };
        let mut page = Page::new(folder.path(), "Title", &made, Some(3)).unwrap();
        page.table(["a", "b"], [["1".into(), number(None, 2)]]);
        page.numbers("a", ["x"], [["1".into()]]);
        assert!(!folder.path().join("a.csv").exists(), "a run that is stopped leaves nothing");
        page.finish().unwrap();
        assert_eq!(std::fs::read_to_string(folder.path().join("a.csv")).unwrap(), "x\n1\n");
        check_folder(folder.path()).unwrap();
        let text = std::fs::read_to_string(folder.path().join("report.md")).unwrap();
        assert!(text.contains("`ropescope evaluate`, seed 3, 2026-11-22") && text.contains("| 1 | - |"), "{text}");
    }
}
