//! Small line plots to PNG and the same numbers to CSV.
//!
//! Text is drawn with the bitmap font that comes with `embedded-graphics`, smoothed: no font of the machine is needed, and the
//! same data give the same bytes everywhere. Colours are those of Okabe and Ito (2008), told apart by colour-blind readers too.
//! Characters outside ISO 8859-1 (Greek letters, say; "µ" and "°" are inside) are drawn as "?".
//! Not a plotting library: one pair of axes, lines with or without marks, and marks alone.

pub mod bars;
pub(crate) mod canvas;
pub mod color_bar;
mod csv;
mod draw;
pub(crate) mod legend;
mod ticks;

use std::path::{Path, PathBuf};

use crate::io::png::{WritePngError, write_png};

/// Lines over a pair of axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// What stands above; may be empty.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The lines.
    pub series: Vec<Series>,
}

/// An axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// What it counts.
    pub label: String,
    /// In which unit; empty for counts and ratios.
    pub unit: String,
    /// How values are laid along it.
    pub scale: Scale,
}

/// How values are laid along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// Each factor of ten takes the same length; values must be positive.
    Logarithmic,
}

/// One line.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// Its points (x, y), joined in this order.
    pub points: Vec<[f64; 2]>,
    /// How they are drawn.
    pub stroke: Stroke,
}

/// How the points of a series are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// As a line.
    Line,
    /// As a line with a disc at each point.
    Marked,
    /// As a line of dashes: a fit, or a bound.
    Dashed,
    /// As discs alone.
    Discs,
    /// As rings, wide enough to stand around a disc.
    Rings,
}

impl Stroke {
    /// Whether points are joined.
    fn joins(self) -> bool {
        !matches!(self, Self::Discs | Self::Rings)
    }
}

/// Why a plot was not made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    /// There is nothing to draw.
    #[error("plot '{title}': none of its {series} series has a point; record at least one step")]
    NoData {
        /// Title of the plot.
        title: String,
        /// Number of series.
        series: usize,
    },
    /// A value cannot be laid on an axis.
    #[error("plot '{title}': point {point} of '{series}' is ({x}, {y}); {expected}")]
    BadPoint {
        /// Title of the plot.
        title: String,
        /// Name of the series.
        series: String,
        /// Which point, from 0.
        point: usize,
        /// Its x.
        x: f64,
        /// Its y.
        y: f64,
        /// What the axes can show.
        expected: &'static str,
    },
    /// No room for the axes, or more than a picture should have.
    #[error("plot '{title}': {width} x {height} pixels; take between 320 x 240 and 8000 x 8000")]
    Size {
        /// Title of the plot.
        title: String,
        /// Pixels per row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The picture could not be written.
    #[error(transparent)]
    Png(#[from] WritePngError),
    /// The table could not be written.
    #[error("{}: could not write the table: {source}", path.display())]
    Csv {
        /// The file asked for.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
}

impl Axis {
    /// An even axis.
    pub fn linear(label: &str, unit: &str) -> Self {
        Self { label: label.to_string(), unit: unit.to_string(), scale: Scale::Linear }
    }

    /// A logarithmic axis.
    pub fn logarithmic(label: &str, unit: &str) -> Self {
        Self { scale: Scale::Logarithmic, ..Self::linear(label, unit) }
    }

    /// Label and unit, as they stand at the axis and in tables.
    fn caption(&self) -> String {
        if self.unit.is_empty() { self.label.clone() } else { format!("{} [{}]", self.label, self.unit) }
    }
}

impl Plot {
    /// Draws the plot.
    ///
    /// # Errors
    /// If there is no point, a point is not finite (or not positive on a logarithmic axis), or the size is absurd.
    pub fn render(&self, width: u32, height: u32) -> Result<image::RgbImage, PlotError> {
        self.check()?;
        if !(320..=8000).contains(&width) || !(240..=8000).contains(&height) {
            return Err(PlotError::Size { title: self.title.clone(), width, height });
        }
        Ok(draw::draw(self, width, height))
    }

    /// Draws the plot at 1200 x 800 pixels and writes it as PNG.
    ///
    /// # Errors
    /// As [`Plot::render`], or if the file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<(), PlotError> {
        Ok(write_png(path, &self.render(1200, 800)?, None)?)
    }

    /// Writes the numbers as CSV (RFC 4180, UTF-8): a column for x and one per series, a row per x that occurs, in ascending
    /// order; a series without a point there leaves its field empty. Numbers are the shortest that read back to the same bits.
    ///
    /// # Errors
    /// As [`Plot::render`] for the points, or if the file cannot be written.
    pub fn write_csv(&self, path: &Path) -> Result<(), PlotError> {
        self.check()?;
        csv::write(self, path).map_err(|source| PlotError::Csv { path: path.to_path_buf(), source })
    }

    fn check(&self) -> Result<(), PlotError> {
        if self.series.iter().all(|series| series.points.is_empty()) {
            return Err(PlotError::NoData { title: self.title.clone(), series: self.series.len() });
        }
        for series in &self.series {
            for (point, &[x, y]) in series.points.iter().enumerate() {
                let positive = |axis: &Axis, value: f64| axis.scale == Scale::Linear || value > 0.0;
                let expected = if !(x.is_finite() && y.is_finite()) {
                    "values must be finite"
                } else if !(positive(&self.x, x) && positive(&self.y, y)) {
                    "values on a logarithmic axis must be above zero"
                } else {
                    continue;
                };
                let (title, series) = (self.title.clone(), series.name.clone());
                return Err(PlotError::BadPoint { title, series, point, x, y, expected });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: Vec<[f64; 2]>) -> Plot {
        let series = vec![Series { name: "cells".into(), points, stroke: Stroke::Line }];
        Plot { title: "Volume".into(), x: Axis::linear("step", ""), y: Axis::logarithmic("error", "mm"), series }
    }

    #[test]
    fn refusals_name_the_point() {
        let message = |points| plot(points).render(640, 480).unwrap_err().to_string();
        assert!(message(vec![]).contains("'Volume': none of its 1"));
        assert!(message(vec![[0.0, 1.0], [1.0, f64::NAN]]).contains("point 1 of 'cells' is (1, NaN)"));
        assert!(message(vec![[0.0, 0.0]]).contains("above zero"));
        let message = plot(vec![[0.0, 1.0]]).render(10, 480).unwrap_err().to_string();
        assert!(message.contains("10 x 480"), "{message}");
        let folder = tempfile::tempdir().unwrap();
        let message = plot(vec![[0.0, 1.0]]).write_csv(folder.path()).unwrap_err().to_string();
        assert!(message.contains("could not write the table"), "{message}");
    }

    #[test]
    fn extreme_ranges_are_drawn() {
        for points in [vec![[0.0, 1e-300], [1e300, 1e300]], vec![[5.0, 5.0]], vec![[-1e-12, 1.0], [1e-12, 1.0 + 1e-15]]]
        {
            plot(points).render(640, 480).unwrap();
        }
    }
}
