//! Names of labels from a text file.
//!
//! Understood, one label per line:
//! - two or more columns divided by tabs, commas, semicolons or blanks: number and name, in the columns that a header line
//!   names (`id`, `label`, `index`, `value`; `name`, `organ`, `structure`), else the first two; more columns are ignored;
//! - colour tables of 3D Slicer and FreeSurfer: `5 liver 221 130 101 255`;
//! - label descriptions of ITK-SNAP: `5 221 130 101 1 1 1 "liver"`.
//!
//! `#` starts a comment line, blank lines are skipped, names may stand in double quotes. Divided by blanks, the name is the
//! rest of the line.

use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Largest file read [bytes]; 65 536 labels with long names fit many times over.
const MAX_BYTES: u64 = 16 << 20;
/// Most suggestions in a message.
const MAX_SUGGESTIONS: usize = 5;
const ID_COLUMNS: [&str; 6] = ["id", "label", "index", "value", "number", "label_id"];
const NAME_COLUMNS: [&str; 6] = ["name", "organ", "structure", "label_name", "description", "class"];

/// Why a file gives no label names.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadLabelNamesError {
    /// The operating system refused.
    #[error("{}: could not read the label names: {source}", path.display())]
    Io {
        /// The file asked for.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// Far larger than any list of labels.
    #[error("{}: found more than {MAX_BYTES} bytes, expected a short text file with one label per line", path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
    },
    /// Not a text.
    #[error("{}: byte {at} is not UTF-8 text, expected one label per line; save the list as plain text", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// Place of the first byte that is no text.
        at: usize,
    },
    /// A line without a label number where one should be.
    #[error(
        "{}:{line}: found \"{found}\" where a label number is expected (0 to 65535); write one label per line as: \
         number name",
        path.display()
    )]
    BadNumber {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What stands there.
        found: String,
    },
    /// A line without a name.
    #[error("{}:{line}: label {id} has no name, expected: number name", path.display())]
    NoName {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The label.
        id: u16,
    },
    /// One number with two names, or one name with two numbers.
    #[error(
        "{}:{line}: label {id} \"{name}\" contradicts label {other_id} \"{other_name}\" of an earlier line, expected \
         each number and each name once; remove one of the lines",
        path.display()
    )]
    Contradiction {
        /// The file.
        path: PathBuf,
        /// Line of the second entry, from 1.
        line: usize,
        /// Its label.
        id: u16,
        /// Its name.
        name: String,
        /// Label of the first entry.
        other_id: u16,
        /// Name of the first entry.
        other_name: String,
    },
    /// Nothing but comments.
    #[error("{}: found no label, expected one per line as: number name", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

/// A name that no label has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no label is called \"{found}\"; {}", advice(suggestions, *known))]
pub struct UnknownLabel {
    /// The name asked for.
    pub found: String,
    /// Names that look like it, nearest first; at most five.
    pub suggestions: Vec<String>,
    /// How many names there are.
    pub known: usize,
}

fn advice(suggestions: &[String], known: usize) -> String {
    if suggestions.is_empty() {
        format!("none of the {known} names is like it, give the label's number or another name")
    } else {
        format!("did you mean {}?", suggestions.join(", "))
    }
}

/// Numbers and names of labels, each once.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LabelNames {
    names: BTreeMap<u16, String>,
    /// By lower-case name.
    ids: BTreeMap<String, u16>,
}

impl LabelNames {
    /// Reads a text file; see the module for the forms it may have.
    ///
    /// # Errors
    /// [`ReadLabelNamesError`], with the line at fault.
    pub fn read(path: &Path) -> Result<Self, ReadLabelNamesError> {
        let io_error = |source| ReadLabelNamesError::Io { path: path.into(), source };
        let file = std::fs::File::open(path).map_err(io_error)?;
        let mut bytes = Vec::new();
        file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(io_error)?;
        if bytes.len() as u64 > MAX_BYTES {
            return Err(ReadLabelNamesError::TooLong { path: path.into() });
        }
        let text = std::str::from_utf8(&bytes)
            .map_err(|error| ReadLabelNamesError::NotText { path: path.into(), at: error.valid_up_to() })?;
        Self::parse(text, path)
    }

    /// Takes the names from a text; `path` is for messages only.
    ///
    /// # Errors
    /// [`ReadLabelNamesError`], with the line at fault.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ReadLabelNamesError> {
        let mut names = Self::default();
        let mut columns = Columns::default();
        let mut first = true;
        for (line, content) in (1..).zip(text.trim_start_matches('\u{feff}').lines()) {
            let content = content.trim_end();
            if content.trim().is_empty() || content.trim_start().starts_with('#') {
                continue;
            }
            let (fields, by_blanks) = split(content);
            // A header has no number in it; every entry has one.
            if std::mem::take(&mut first) && !fields.iter().any(|field| field.parse::<i64>().is_ok()) {
                columns = Columns::named(&fields);
                continue;
            }
            let (number, name) = columns.entry(&fields, by_blanks);
            let Ok(id) = number.parse() else {
                return Err(ReadLabelNamesError::BadNumber { path: path.into(), line, found: number });
            };
            if name.is_empty() {
                return Err(ReadLabelNamesError::NoName { path: path.into(), line, id });
            }
            if let Err((other_id, other_name)) = names.insert(id, &name) {
                let path = path.into();
                return Err(ReadLabelNamesError::Contradiction { path, line, id, name, other_id, other_name });
            }
        }
        if names.names.is_empty() { Err(ReadLabelNamesError::Empty { path: path.into() }) } else { Ok(names) }
    }

    /// Adds a label, or gives the one it contradicts. The same entry twice is no contradiction.
    fn insert(&mut self, id: u16, name: &str) -> Result<(), (u16, String)> {
        let key = name.to_lowercase();
        if let Some(known) = self.names.get(&id).filter(|known| known.to_lowercase() != key) {
            return Err((id, known.clone()));
        }
        if let Some(&known) = self.ids.get(&key).filter(|known| **known != id) {
            return Err((known, self.names[&known].clone()));
        }
        self.names.entry(id).or_insert_with(|| name.to_owned());
        self.ids.insert(key, id);
        Ok(())
    }

    /// The label with this name, whatever the letter case.
    ///
    /// # Errors
    /// [`UnknownLabel`], with the names nearest to it.
    pub fn id(&self, name: &str) -> Result<u16, UnknownLabel> {
        let name = name.trim();
        self.ids.get(&name.to_lowercase()).copied().ok_or_else(|| UnknownLabel {
            found: name.to_owned(),
            suggestions: self.similar(name),
            known: self.names.len(),
        })
    }

    /// The name of a label.
    pub fn name(&self, id: u16) -> Option<&str> {
        self.names.get(&id).map(String::as_str)
    }

    /// All labels with their names, by number.
    pub fn iter(&self) -> impl Iterator<Item = (u16, &str)> {
        self.names.iter().map(|(id, name)| (*id, name.as_str()))
    }

    /// Number of labels.
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// True when there is no label.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Names a few letters away, or that share a part of at least three letters.
    fn similar(&self, name: &str) -> Vec<String> {
        let wanted = comparable(name);
        let allowed = (wanted.len() / 3).max(1);
        let mut found: Vec<(usize, &String)> = Vec::new();
        for known in self.names.values() {
            let other = comparable(known);
            let distance = edit_distance(&wanted, &other);
            let holds =
                |long: &[char], short: &[char]| short.len() >= 3 && long.windows(short.len()).any(|w| w == short);
            if distance <= allowed {
                found.push((distance, known));
            } else if holds(&other, &wanted) || holds(&wanted, &other) {
                found.push((allowed + distance, known));
            }
        }
        found.sort_by_key(|(distance, _)| *distance);
        found.into_iter().take(MAX_SUGGESTIONS).map(|(_, known)| known.clone()).collect()
    }
}

/// Lower case without blanks, hyphens and underscores; long input is cut, to bound the work on nonsense.
fn comparable(name: &str) -> Vec<char> {
    name.to_lowercase().chars().filter(|c| !matches!(c, ' ' | '-' | '_')).take(64).collect()
}

/// Letters to insert, remove or change (Levenshtein 1966), with a swap of two neighbours as one step.
fn edit_distance(a: &[char], b: &[char]) -> usize {
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    for (i, row) in rows.iter_mut().enumerate() {
        row[0] = i;
    }
    rows[0] = (0..=b.len()).collect();
    for i in 1..=a.len() {
        for j in 1..=b.len() {
            let change = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut best = change.min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(rows[i - 2][j - 2] + 1);
            }
            rows[i][j] = best;
        }
    }
    rows[a.len()][b.len()]
}

/// Which fields hold number and name.
#[derive(Debug, Clone, Copy)]
struct Columns {
    id: usize,
    name: usize,
}

impl Default for Columns {
    fn default() -> Self {
        Self { id: 0, name: 1 }
    }
}

impl Columns {
    /// By the words of a header line, else the first two.
    fn named(header: &[String]) -> Self {
        let place = |words: &[&str]| {
            header.iter().position(|field| words.iter().any(|word| field.trim().eq_ignore_ascii_case(word)))
        };
        match (place(&ID_COLUMNS), place(&NAME_COLUMNS)) {
            (Some(id), Some(name)) if id != name => Self { id, name },
            _ => Self::default(),
        }
    }

    /// Number and name of a line, as text.
    fn entry(self, fields: &[String], by_blanks: bool) -> (String, String) {
        let field = |at: usize| fields.get(at).map(|field| field.trim().to_owned()).unwrap_or_default();
        let numbers = |fields: &[String]| fields.iter().all(|field| field.parse::<f64>().is_ok());
        if by_blanks {
            match fields {
                // ITK-SNAP: number, red, green, blue, opacity, visible, mesh, "name".
                [head @ .., name] if head.len() == 7 && numbers(head) => {
                    return (field(0), name.trim().to_owned());
                }
                // 3D Slicer, FreeSurfer: number, name, red, green, blue, opacity.
                [id, name, colour @ ..] if colour.len() == 4 && numbers(colour) => {
                    return (id.clone(), name.clone());
                }
                [id, name @ ..] if self.id == 0 && self.name == 1 => return (id.clone(), name.join(" ")),
                _ => {}
            }
        }
        (field(self.id), field(self.name))
    }
}

/// What divides columns when a line has any of it; blanks otherwise.
const DIVIDERS: [char; 3] = ['\t', ',', ';'];

/// Fields of a line, by the first of tab, comma, semicolon that it holds outside of quotes, else by blanks; and whether by
/// blanks.
fn split(content: &str) -> (Vec<String>, bool) {
    let mut quoted = false;
    let outside = |c: char, quoted: &mut bool| {
        *quoted ^= c == '"';
        !*quoted
    };
    let holds = |divider: char| {
        let mut quoted = false;
        content.chars().any(|c| outside(c, &mut quoted) && c == divider)
    };
    let divider = DIVIDERS.into_iter().find(|divider| holds(*divider));
    let mut fields = vec![String::new()];
    let mut after_blank = true;
    for c in content.chars() {
        let divides = match divider {
            Some(divider) => c == divider,
            None => c.is_whitespace(),
        };
        if outside(c, &mut quoted) && divides {
            // Several blanks divide once; two tabs enclose an empty field.
            if divider.is_some() || !after_blank {
                fields.push(String::new());
            }
            after_blank = true;
        } else {
            after_blank = false;
            if c != '"'
                && let Some(field) = fields.last_mut()
            {
                field.push(c);
            }
        }
    }
    (fields, divider.is_none())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<LabelNames, ReadLabelNamesError> {
        LabelNames::parse(text, Path::new("names.txt"))
    }

    fn pairs(text: &str) -> Vec<(u16, String)> {
        parse(text).unwrap().iter().map(|(id, name)| (id, name.to_owned())).collect()
    }

    #[test]
    fn every_form_gives_the_same_names() {
        let expected = [(2, "kidney right".to_owned()), (5, "liver".to_owned())];
        let forms = [
            "id\tname\tvoxels\n5\tliver\t41733\n2\tkidney right\t6854\n",
            "\u{feff}# made by hand\r\n\r\n5,liver\r\n2,\"kidney right\"\r\n",
            "name;value\nliver;5\nkidney right;2",
            "  5   liver\n  2 kidney right\n",
            "5 liver 221 130 101 255\n2 \"kidney right\" 185 102 83 255\n",
            "    5   221  130  101        1  1  1    \"liver\"\n    2   185  102   83        1  1  1    \"kidney right\"\n",
            "5 liver\n2 kidney right\n5 Liver\n",
        ];
        for form in forms {
            assert_eq!(pairs(form), expected, "{form}");
        }
    }

    #[test]
    fn quotes_keep_dividers() {
        assert_eq!(pairs("7,\"lobe, left\"\n"), [(7, "lobe, left".to_owned())]);
        assert_eq!(pairs("7 1 2 3 1 1 1 \"lobe, left\"\n"), [(7, "lobe, left".to_owned())]);
        assert_eq!(pairs("0 0 0 0 0 0 0 \"Clear Label\"\n"), [(0, "Clear Label".to_owned())]);
    }

    #[test]
    fn names_are_found_in_any_case_and_near_misses_are_suggested() {
        let names = parse("1 spleen\n2 kidney_right\n3 kidney_left\n5 liver\n57 colon\n").unwrap();
        assert_eq!(names.len(), 5);
        assert_eq!(names.id("LIVER"), Ok(5));
        assert_eq!(names.name(57), Some("colon"));
        assert_eq!(names.id("lvier").unwrap_err().suggestions, ["liver"]);
        assert_eq!(names.id("Kidney").unwrap_err().suggestions, ["kidney_left", "kidney_right"]);
        assert_eq!(names.id("kidney right").unwrap_err().suggestions[0], "kidney_right");
        let message = names.id("splen").unwrap_err().to_string();
        assert!(message.contains("\"splen\"") && message.contains("did you mean spleen?"), "{message}");
        let message = names.id("brain").unwrap_err().to_string();
        assert!(message.contains("none of the 5 names"), "{message}");
        assert!(names.id(&"x".repeat(100_000)).is_err());
    }

    #[test]
    fn every_error_names_the_line_and_what_stands_there() {
        let cases: [(&str, &[&str]); 8] = [
            ("5 liver\nfive spleen\n", &["names.txt:2", "\"five\"", "number name"]),
            ("id,name\n70000,liver\n", &["names.txt:2", "\"70000\"", "65535"]),
            ("-1 liver\n", &["names.txt:1", "\"-1\""]),
            ("5\n", &["names.txt:1", "label 5 has no name"]),
            ("5 liver\n5 spleen\n", &["names.txt:2", "5 \"spleen\"", "5 \"liver\"", "remove"]),
            ("5 liver\n6 Liver\n", &["names.txt:2", "6 \"Liver\"", "5 \"liver\""]),
            ("# nothing\n\n", &["names.txt", "no label"]),
            ("", &["names.txt", "no label"]),
        ];
        for (text, parts) in cases {
            let message = parse(text).unwrap_err().to_string();
            for part in parts {
                assert!(message.contains(part), "{part} is not in: {message}");
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let missing = LabelNames::read(&folder.path().join("none.tsv")).unwrap_err().to_string();
        assert!(missing.contains("none.tsv") && missing.contains("could not read"), "{missing}");
        let binary = folder.path().join("labels.nii");
        std::fs::write(&binary, b"5 liver\n\xff\xfe").unwrap();
        let message = LabelNames::read(&binary).unwrap_err().to_string();
        assert!(message.contains("labels.nii") && message.contains("byte 8"), "{message}");
        let long = folder.path().join("long.txt");
        std::fs::File::create(&long).unwrap().set_len(MAX_BYTES + 1).unwrap();
        let message = LabelNames::read(&long).unwrap_err().to_string();
        assert!(message.contains("long.txt") && message.contains("16777216"), "{message}");
    }
}
