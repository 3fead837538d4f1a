//! `palpate report --figures`: each figure of a page as an SVG file, and the numbers as a CSV file of the same name.

use super::Failure;
use palpate_data::dataset::files;
use palpate_report::chart::SVG_MARK;
use palpate_report::report::{PageFigure, counted};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// The files of a page's figures, not yet written.
pub(crate) struct FigureFiles {
    folder: PathBuf,
    figures: Vec<PageFigure>,
}

impl FigureFiles {
    pub(crate) fn new(folder: PathBuf, figures: Vec<PageFigure>) -> Self {
        FigureFiles { folder, figures }
    }

    /// Looks at the places of all files. Only a figure that palpate wrote is replaced, and the table beside such a one.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        for drawn in &self.figures {
            let [svg, csv] = self.paths(drawn);
            let is_ours = is_ours(&svg);
            for path in [svg, csv] {
                let why = match files::check_replaceable(&path) {
                    Ok(()) if is_ours || path.symlink_metadata().is_err() => continue,
                    Ok(()) => "already exists".to_owned(),
                    Err(why) => format!("can't be written: {why}"),
                };
                let help = "choose another --figures: only figures that palpate wrote are replaced";
                return Err(Failure::usage(miette::miette!(help = help, "{} {why}", path.display())));
            }
        }
        Ok(())
    }

    /// Writes them, and says how many there are.
    pub(crate) fn write(&self) -> Result<String, Failure> {
        for drawn in &self.figures {
            let [svg, csv] = self.paths(drawn);
            self.put(&svg, &drawn.figure.saved())?;
            self.put(&csv, &drawn.numbers.csv())?;
        }
        let text = counted(self.figures.len(), "figure");
        Ok(format!("{}: {text}, each as SVG and CSV\n", self.folder.display()))
    }

    fn put(&self, path: &Path, text: &str) -> Result<(), Failure> {
        let put = || -> io::Result<()> {
            fs::create_dir_all(&self.folder)?;
            files::place(path, text)
        };
        put().map_err(|why| {
            let help = "choose another --figures, or free disk space and check the permissions; the page is written";
            Failure::unwritten(miette::miette!(help = help, "writing the figure {}: {why}", path.display()))
        })
    }

    fn paths(&self, drawn: &PageFigure) -> [PathBuf; 2] {
        ["svg", "csv"].map(|ending| self.folder.join(format!("{}.{ending}", drawn.stem)))
    }
}

/// Whether a file is a figure that this program wrote. Only a regular file is read.
fn is_ours(svg: &Path) -> bool {
    svg.symlink_metadata().is_ok_and(|at| at.is_file())
        && fs::read_to_string(svg).is_ok_and(|text| text.starts_with("<svg ") && text.contains(SVG_MARK))
}
