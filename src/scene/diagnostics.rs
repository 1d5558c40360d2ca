//! Where in a scene file something is wrong: from a key path to line, column and caret.
//!
//! Types read from TOML carry no places, so a check names what it looked at by a [`KeyPath`], and [`Source::locate`]
//! finds the place by walking the parsed document a second time. A key that is not written is shown at its table.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

use super::problem::Problem;

/// The way to a value in a scene, such as `organ[1].density` (lists count from 0).
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct KeyPath(Vec<Step>);

#[derive(Debug, Clone, PartialEq, Eq)]
enum Step {
    Key(String),
    Index(usize),
}

impl KeyPath {
    /// A key of the top level.
    pub(super) fn top(key: &str) -> Self {
        Self::default().key(key)
    }

    /// A key of this table.
    pub(super) fn key(&self, key: &str) -> Self {
        let mut longer = self.clone();
        longer.0.push(Step::Key(key.to_owned()));
        longer
    }

    /// An entry of this list.
    pub(super) fn index(&self, index: usize) -> Self {
        let mut longer = self.clone();
        longer.0.push(Step::Index(index));
        longer
    }
}

impl fmt::Display for KeyPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (position, step) in self.0.iter().enumerate() {
            match step {
                Step::Key(key) if position == 0 => write!(f, "{key}")?,
                Step::Key(key) => write!(f, ".{key}")?,
                Step::Index(index) => write!(f, "[{index}]")?,
            }
        }
        Ok(())
    }
}

/// A place in a text file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1, counted in characters.
    pub column: usize,
    /// How many characters to underline, at least 1.
    pub length: usize,
    /// The whole line, without its end.
    pub text: String,
}

/// Something to say about a place in a scene: a [`Problem`] or a [`Caution`](super::Caution).
///
/// Printed as file, line, column, key and message, then the line itself with a caret.
#[derive(Debug, Clone, PartialEq)]
pub struct Located<T> {
    /// The scene file.
    pub file: PathBuf,
    /// The key, such as `organ[1].density` (lists count from 0); empty for the file as a whole.
    pub key: String,
    /// Where the value stands, or its table where it is missing.
    pub place: Place,
    /// What there is to say.
    pub what: T,
}

impl<T: fmt::Display> fmt::Display for Located<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Place { line, column, length, text } = &self.place;
        write!(f, "{}:{line}:{column}: ", self.file.display())?;
        if !self.key.is_empty() {
            write!(f, "{}: ", self.key)?;
        }
        writeln!(f, "{}", self.what)?;
        let gutter = line.to_string();
        let margin = " ".repeat(gutter.len());
        // Of a very long line only what stands around the fault.
        let start = if *column > SHOWN { column - SHOWN / 4 } else { 1 };
        let excerpt: String = text.chars().skip(start - 1).take(SHOWN).collect();
        // Tabs are kept, so that the caret stands under its column however wide the terminal draws them.
        let before = excerpt.chars().take(column - start);
        let indent: String = before.map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
        let length = (*length).min((SHOWN + start).saturating_sub(*column).max(1));
        writeln!(f, "{margin} |")?;
        writeln!(f, "{gutter} | {excerpt}")?;
        write!(f, "{margin} | {indent}{}", "^".repeat(length))
    }
}

/// Longest part of a line shown [characters].
const SHOWN: usize = 160;

/// The text of a scene and its parsed form.
pub(super) struct Source<'t> {
    file: &'t Path,
    text: &'t str,
    root: DeTable<'t>,
}

impl<'t> Source<'t> {
    /// Parses TOML; says nothing about keys yet.
    pub(super) fn parse(text: &'t str, file: &'t Path) -> Result<Self, Vec<Located<Problem>>> {
        match DeTable::parse(text) {
            Ok(root) => Ok(Self { file, text, root: root.into_inner() }),
            Err(error) => Err(vec![Self { file, text, root: DeTable::new() }.error(&error)]),
        }
    }

    /// The document, for reading into types.
    pub(super) fn document(&self) -> toml::de::Deserializer<'t> {
        toml::de::Deserializer::from(toml::Spanned::new(0..self.text.len(), self.root.clone()))
    }

    /// Attaches file, place and key to a finding.
    pub(super) fn locate<T>(&self, key: &KeyPath, what: T) -> Located<T> {
        Located { file: self.file.to_owned(), key: key.to_string(), place: self.place(&self.span(key)), what }
    }

    /// Where in the text a key's value begins [bytes]; orders what was written.
    pub(super) fn offset(&self, key: &KeyPath) -> usize {
        self.span(key).start
    }

    /// An error of the TOML reader, with its key found from its place.
    pub(super) fn error(&self, error: &toml::de::Error) -> Located<Problem> {
        let span = error.span().unwrap_or(0..0);
        let key = self.key_at(&span);
        let what = Problem::from_reader(error.message(), &key);
        Located { file: self.file.to_owned(), key: key.to_string(), place: self.place(&span), what }
    }

    /// The span of a value, or of the deepest table around it that is written.
    fn span(&self, key: &KeyPath) -> Range<usize> {
        let mut span = 0..0;
        let mut here: Option<&DeValue<'_>> = None;
        for step in &key.0 {
            let next = match (step, here) {
                (Step::Key(key), None) => self.root.get(key.as_str()),
                (Step::Key(key), Some(value)) => value.get(key.as_str()),
                (Step::Index(index), Some(value)) => value.get(*index),
                (Step::Index(_), None) => None,
            };
            let Some(next) = next else { break };
            span = next.span();
            here = Some(next.get_ref());
        }
        span
    }

    /// The deepest key whose name or value covers a span; empty when none does.
    fn key_at(&self, span: &Range<usize>) -> KeyPath {
        let mut best = (usize::MAX, KeyPath::default());
        search_table(&self.root, &KeyPath::default(), span, &mut best);
        best.1
    }

    fn place(&self, span: &Range<usize>) -> Place {
        let start = span.start.min(self.text.len());
        let line_start = self.text[..start].rfind('\n').map_or(0, |end| end + 1);
        let text = self.text[line_start..].split('\n').next().unwrap_or_default().trim_end_matches('\r');
        let line_end = line_start + text.len();
        let length = self.text.get(start..span.end.min(line_end)).map_or(0, |marked| marked.chars().count());
        Place {
            line: self.text[..line_start].matches('\n').count() + 1,
            column: self.text[line_start..start].chars().count() + 1,
            length: length.max(1),
            text: text.to_owned(),
        }
    }
}

/// Keeps the smallest span that covers the wanted one; at equal size the deeper key.
fn consider(candidate: Range<usize>, path: &KeyPath, wanted: &Range<usize>, best: &mut (usize, KeyPath)) {
    if candidate.start <= wanted.start && wanted.end <= candidate.end && candidate.len() <= best.0 {
        *best = (candidate.len(), path.clone());
    }
}

fn search_table(table: &DeTable<'_>, path: &KeyPath, wanted: &Range<usize>, best: &mut (usize, KeyPath)) {
    for (key, value) in table {
        let path = path.key(key.get_ref());
        consider(key.span(), &path, wanted, best);
        consider(value.span(), &path, wanted, best);
        search_value(value.get_ref(), &path, wanted, best);
    }
}

fn search_value(value: &DeValue<'_>, path: &KeyPath, wanted: &Range<usize>, best: &mut (usize, KeyPath)) {
    match value {
        DeValue::Table(table) => search_table(table, path, wanted, best),
        DeValue::Array(array) => {
            for (index, entry) in array.iter().enumerate() {
                let path = path.index(index);
                consider(entry.span(), &path, wanted, best);
                search_value(entry.get_ref(), &path, wanted, best);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "[[organ]]\nname = \"é\"\n[[organ]]\n\tdensity = -3 # kg/m3\r\n[[cut]]\npath = [[0, 1,\n 2], \
                        [3, 4, 5]]\nregion.sphere.radius = 7\n";

    fn shown(key: &KeyPath) -> String {
        Source::parse(TEXT, Path::new("a/s.toml")).unwrap().locate(key, "message").to_string()
    }

    #[test]
    fn a_value_is_underlined() {
        let density = KeyPath::top("organ").index(1).key("density");
        let expected = "a/s.toml:4:12: organ[1].density: message\n  |\n4 | \tdensity = -3 # kg/m3\n  | \t          ^^";
        assert_eq!(shown(&density), expected);
        let name = KeyPath::top("organ").index(0).key("name");
        assert!(shown(&name).ends_with("2 | name = \"é\"\n  |        ^^^"), "{}", shown(&name));
    }

    #[test]
    fn a_missing_key_is_shown_at_its_table_and_long_values_at_their_first_line() {
        let missing = KeyPath::top("organ").index(1).key("mass");
        assert!(shown(&missing).starts_with("a/s.toml:3:1: organ[1].mass: message"), "{}", shown(&missing));
        let path = KeyPath::top("cut").index(0).key("path").index(0);
        assert!(shown(&path).ends_with("6 | path = [[0, 1,\n  |         ^^^^^^"), "{}", shown(&path));
        assert!(shown(&KeyPath::top("time")).starts_with("a/s.toml:1:1: time: message"));
    }

    #[test]
    fn of_a_long_line_the_part_around_the_fault_is_shown() {
        let text = format!("name = \"{}\"\nlist = [{}7, 8]", "x".repeat(500), "1, ".repeat(500));
        let source = Source::parse(&text, Path::new("s.toml")).unwrap();
        let shown = source.locate(&KeyPath::top("list").index(500), "message").to_string();
        let lines: Vec<&str> = shown.lines().collect();
        assert!(lines.iter().all(|line| line.chars().count() < 200), "{shown}");
        let caret = lines[3].find('^').unwrap();
        assert_eq!(&lines[2][caret..], "7, 8]", "{shown}");
        let name = source.locate(&KeyPath::top("name"), "message").to_string();
        assert!(name.lines().all(|line| line.len() < 200), "{name}");
    }

    #[test]
    fn a_place_leads_back_to_its_key() {
        let source = Source::parse(TEXT, Path::new("s.toml")).unwrap();
        for (word, key) in [
            ("-3", "organ[1].density"),
            ("density", "organ[1].density"),
            ("4", "cut[0].path[1][1]"),
            ("7", "cut[0].region.sphere.radius"),
            ("[[cut]]", "cut[0]"),
        ] {
            let start = TEXT.find(word).unwrap();
            assert_eq!(source.key_at(&(start..start + word.len())).to_string(), key);
        }
    }

    #[test]
    fn broken_toml_is_shown_where_it_breaks() {
        for (text, place) in
            [("[time]\nduration = \n", "s.toml:2:12: "), ("a = 1\na = 2", "s.toml:2:1: "), ("[", "s.toml:1:2")]
        {
            let error = Source::parse(text, Path::new("s.toml")).err().unwrap()[0].to_string();
            assert!(error.starts_with(place) && error.contains('^'), "{error}");
        }
    }
}
