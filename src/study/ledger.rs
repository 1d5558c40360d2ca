//! What a study has found so far, one line of JSON for each finished piece of work, so that it can be interrupted.
//!
//! The first line says what is studied: checksum of scene and volumes, version of the program. Lines are only ever added; a line
//! that was cut off by an interruption is dropped.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::choice::Choice;
use super::surface_distance::SurfaceDistance;

/// Name of the file in the folder of a study.
pub const FILE: &str = "results.jsonl";

/// Changes with what the lines mean; a study of another is not gone on with.
pub const FORMAT: u32 = 3;

/// What a study is about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Subject {
    /// [`FORMAT`]; 0 in studies from before there were several.
    #[serde(default)]
    pub format: u32,
    /// Version of the program.
    pub version: String,
    /// SHA-256 of the resolved scene and of every file it names.
    pub scene_sha256: String,
    /// Instants at which runs are compared.
    pub instants: usize,
}

/// What one run took and where it came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunLine {
    /// What was chosen.
    pub choice: Choice,
    /// 0 for the first run of this choice, whose frames are kept.
    pub repeat: usize,
    /// Particles.
    pub particles: usize,
    /// Step of the schedule, or the mean one of an integrator that divides it itself \[s\].
    pub dt_s: f64,
    /// Steps taken, with those that were divided; parts, of an integrator that divides them itself.
    pub steps: u64,
    /// Steps that were shorter than planned.
    pub divided: u64,
    /// How often the forces of all particles were computed.
    pub evaluations: u64,
    /// Time spent stepping \[s\]: not reading, assembling, measuring or writing.
    pub seconds: f64,
    /// Springs severed at the end.
    pub severed: usize,
    /// Kinetic and elastic energy at each instant after the first \[J\].
    pub energy_j: Vec<[f64; 2]>,
    /// Momentum at each instant after the first, lattice axes \[kg m/s\].
    pub momentum: Vec<[f64; 3]>,
    /// Volume of whole cells over their volume at rest, at each instant after the first; 1 where there is none.
    pub volume: Vec<f64>,
    /// Time of all of it, with preparing, measuring and writing \[s\].
    pub all_seconds: f64,
    /// SHA-256 of the last displacements.
    pub bits: String,
    /// Why the run did not come to its end.
    pub failed: Option<String>,
}

/// A surface of one run at one resolution.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceLine {
    /// Folder of the run it was drawn from.
    pub run: String,
    /// `lattice`, or the spacing \[mm\].
    pub resolution: String,
    /// Triangles.
    pub triangles: usize,
    /// Time to draw and carry it \[s\], the shortest of some.
    pub seconds: f64,
    /// Volume it encloses \[mL\].
    pub volume_ml: f64,
    /// How far it is from the reference; `None` for the reference.
    pub distance: Option<SurfaceDistance>,
}

/// What rounding does to the end of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoundingLine {
    /// Folder of the run.
    pub run: String,
    /// Steps from its last state on, free of all but holds, gravity and drag, in f32 and in f64.
    pub steps: u64,
    /// Longest way of a particle in these steps \[mm\].
    pub moved_mm: f64,
    /// Largest distance of both after these steps \[mm\].
    pub max_mm: f64,
    /// Root of the mean square of the distances \[mm\].
    pub rms_mm: f64,
    /// Time of a step in f64 over one in f32.
    pub times_slower: f64,
}

/// What steps of one pitch cost, from a part of a run, see [`super::probe`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProbeLine {
    /// Distance of particles \[mm\].
    pub pitch_mm: f64,
    /// Particles.
    pub particles: usize,
    /// The choices that were timed.
    pub paces: Vec<Pace>,
    /// Those that did not come through their first steps.
    pub untimed: Vec<Choice>,
    /// Time of a run beside its steps \[s\].
    pub other_seconds: f64,
    /// Why this pitch cannot be had.
    pub failed: Option<String>,
}

/// How fast a choice goes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pace {
    /// The choice.
    pub choice: Choice,
    /// Time of all steps of a run at this pace \[s\].
    pub seconds: f64,
}

/// A line of the ledger.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Line {
    /// What is studied; comes first.
    Subject(Subject),
    /// What steps of a pitch cost.
    Probe(ProbeLine),
    /// A finished run.
    Run(RunLine),
    /// A measured surface.
    Surface(SurfaceLine),
    /// Rounding, measured.
    Rounding(RoundingLine),
    /// A run there was no time for.
    Skipped(SkippedLine),
}

/// A run there was no time for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkippedLine {
    /// What was chosen.
    pub choice: Choice,
    /// Which repeat.
    pub repeat: usize,
    /// How long it would have taken \[s\].
    pub seconds: f64,
    /// The budget that was too short \[s\].
    pub budget_seconds: f64,
}

/// Why a study cannot be gone on with.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LedgerError {
    /// The file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A line is not one that this program writes.
    #[error("{}: line {line} is not one of a study ({source}); choose another folder, or begin anew (--overwrite)", path.display())]
    BadLine {
        /// The file.
        path: PathBuf,
        /// Its number, from 1.
        line: usize,
        /// Why.
        source: serde_json::Error,
    },
    /// The folder holds the study of something else.
    #[error(
        "{}: {what} since this study was begun ({known} then, {now} now), so its results cannot be gone on with; choose \
         another folder, or begin anew (--overwrite)", path.display()
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// What changed.
        what: &'static str,
        /// What the study was begun with.
        known: String,
        /// What is given now.
        now: String,
    },
}

/// The lines of a study, in memory and on disk.
#[derive(Debug)]
pub struct Ledger {
    path: PathBuf,
    file: File,
    lines: Vec<Line>,
}

impl Ledger {
    /// Opens the ledger of a folder, or begins it. The folder is made if it is missing.
    ///
    /// # Errors
    /// If it belongs to another subject, is no ledger, or cannot be read or written.
    pub fn open(folder: &Path, subject: &Subject) -> Result<Self, LedgerError> {
        let path = folder.join(FILE);
        let io = |source| LedgerError::Io { path: path.clone(), source };
        crate::io::atomic::make_folder(folder).map_err(io)?;
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(io(error)),
        };
        // What was being written when the program or the machine went down.
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        let mut lines = Vec::new();
        for (number, line) in text[..whole].lines().enumerate() {
            let bad = |source| LedgerError::BadLine { path: path.clone(), line: number + 1, source };
            let line = serde_json::from_str::<Line>(line).map_err(bad)?;
            // First, for lines of another format cannot be read.
            if let Line::Subject(known) = &line {
                known.same(subject, &path)?;
            }
            lines.push(line);
        }
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(io)?;
        file.set_len(whole as u64).map_err(io)?;
        let mut ledger = Self { path, file, lines };
        match ledger.lines.first() {
            None => ledger.push(Line::Subject(subject.clone()))?,
            Some(Line::Subject(_)) => {}
            Some(_) => {
                let source: serde_json::Error = serde::de::Error::custom("it does not say what is studied");
                return Err(LedgerError::BadLine { path: ledger.path, line: 1, source });
            }
        }
        Ok(ledger)
    }

    /// Adds a line; it is on disk when this returns.
    ///
    /// # Errors
    /// If it cannot be written.
    ///
    /// # Panics
    /// Never: a line is plain data.
    pub fn push(&mut self, line: Line) -> Result<(), LedgerError> {
        let mut text = serde_json::to_string(&line).expect("a line is plain data");
        text.push('\n');
        let written = self.file.write_all(text.as_bytes()).and_then(|()| self.file.sync_data());
        written.map_err(|source| LedgerError::Io { path: self.path.clone(), source })?;
        self.lines.push(line);
        Ok(())
    }

    /// All lines.
    pub fn lines(&self) -> &[Line] {
        &self.lines
    }

    /// Finished runs.
    pub fn runs(&self) -> impl Iterator<Item = &RunLine> {
        self.lines.iter().filter_map(|line| if let Line::Run(run) = line { Some(run) } else { None })
    }

    /// What steps of each pitch cost; a later probe of the same pitch is the better one.
    pub fn probes(&self) -> impl Iterator<Item = &ProbeLine> {
        self.lines.iter().filter_map(|line| if let Line::Probe(probe) = line { Some(probe) } else { None })
    }

    /// The last probe of a pitch.
    pub fn probe(&self, pitch_mm: f64) -> Option<&ProbeLine> {
        self.probes().filter(|probe| probe.pitch_mm == pitch_mm).last()
    }

    /// Measured surfaces.
    pub fn surfaces(&self) -> impl Iterator<Item = &SurfaceLine> {
        self.lines.iter().filter_map(|line| if let Line::Surface(surface) = line { Some(surface) } else { None })
    }

    /// Runs there was no time for within a budget \[s\], and that were not made since.
    pub fn skipped(&self, budget_seconds: f64) -> impl Iterator<Item = &SkippedLine> {
        self.lines
            .iter()
            .filter_map(|line| if let Line::Skipped(skipped) = line { Some(skipped) } else { None })
            .filter(move |skipped| skipped.budget_seconds >= budget_seconds)
            .filter(|skipped| !self.has(&skipped.choice, skipped.repeat))
    }

    /// Rounding, if it was measured.
    pub fn rounding(&self) -> Option<&RoundingLine> {
        self.lines.iter().find_map(|line| if let Line::Rounding(rounding) = line { Some(rounding) } else { None })
    }

    /// Whether a run is done.
    pub fn has(&self, choice: &Choice, repeat: usize) -> bool {
        self.runs().any(|run| run.choice == *choice && run.repeat == repeat)
    }
}

impl Subject {
    fn same(&self, now: &Self, path: &Path) -> Result<(), LedgerError> {
        let parts = [
            ("the scene or a volume of it has changed", self.scene_sha256.clone(), now.scene_sha256.clone()),
            ("the program keeps other lines", self.format.to_string(), now.format.to_string()),
            ("the program is another version", self.version.clone(), now.version.clone()),
            ("the number of instants is another", self.instants.to_string(), now.instants.to_string()),
        ];
        match parts.into_iter().find(|(_, known, now)| known != now) {
            None => Ok(()),
            Some((what, known, now)) => {
                let short = |text: String| text.chars().take(12).collect();
                Err(LedgerError::Changed { path: path.to_owned(), what, known: short(known), now: short(now) })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ledger_is_gone_on_with() {
        let folder = tempfile::tempdir().unwrap();
        let subject = Subject { format: FORMAT, version: "1".into(), scene_sha256: "ab".into(), instants: 4 };
        let line = |seconds| {
            Line::Probe(ProbeLine {
                pitch_mm: 3.0,
                particles: 8,
                paces: Vec::new(),
                untimed: Vec::new(),
                other_seconds: seconds,
                failed: None,
            })
        };
        let mut ledger = Ledger::open(folder.path(), &subject).unwrap();
        ledger.push(line(1.0)).unwrap();
        drop(ledger);
        let path = folder.path().join(FILE);
        let text = std::fs::read_to_string(&path).unwrap();
        // Interrupted in the middle of a line.
        std::fs::write(&path, format!("{text}{{\"probe\":{{\"pit")).unwrap();
        let mut ledger = Ledger::open(folder.path(), &subject).unwrap();
        assert_eq!(ledger.lines().len(), 2);
        ledger.push(line(2.0)).unwrap();
        drop(ledger);
        let ledger = Ledger::open(folder.path(), &subject).unwrap();
        assert_eq!(ledger.probes().count(), 2);
        assert_eq!(ledger.probe(3.0).map(|probe| probe.other_seconds), Some(2.0));

        let changed = Subject { scene_sha256: "cd".into(), ..subject.clone() };
        let message = Ledger::open(folder.path(), &changed).unwrap_err().to_string();
        assert!(["scene", "ab", "cd", "--overwrite"].iter().all(|part| message.contains(part)), "{message}");
        // Lines of before, which cannot be read any more.
        let before =
            "{\"subject\":{\"version\":\"1\",\"scene_sha256\":\"ab\",\"instants\":4}}\n{\"probe\":{\"steps\":1}}\n";
        std::fs::write(&path, before).unwrap();
        let message = Ledger::open(folder.path(), &subject).unwrap_err().to_string();
        assert!(
            ["other lines", &format!("0 then, {FORMAT} now"), "--overwrite"].iter().all(|part| message.contains(part)),
            "{message}"
        );
        std::fs::write(&path, "no study\n").unwrap();
        let message = Ledger::open(folder.path(), &changed).unwrap_err().to_string();
        assert!(message.contains("line 1") && message.contains("--overwrite"), "{message}");
    }
}
