//! The checks every part of a scene shares: they collect what is wrong instead of stopping at the first fault.

use super::diagnostics::{KeyPath, Located, Source};
use super::problem::{Caution, Problem, number};
use super::values::Triple;

/// Collects findings about one scene.
pub(super) struct Checks<'s> {
    source: &'s Source<'s>,
    /// Faults, in the order found.
    pub(super) problems: Vec<Located<Problem>>,
    /// Oddities, in the order found.
    pub(super) cautions: Vec<Located<Caution>>,
}

impl<'s> Checks<'s> {
    pub(super) fn new(source: &'s Source<'s>) -> Self {
        Self { source, problems: Vec::new(), cautions: Vec::new() }
    }

    pub(super) fn problem(&mut self, key: &KeyPath, problem: Problem) {
        self.problems.push(self.source.locate(key, problem));
    }

    pub(super) fn caution(&mut self, key: &KeyPath, caution: Caution) {
        self.cautions.push(self.source.locate(key, caution));
    }

    /// Where in the text a key's value begins [bytes].
    pub(super) fn offset(&self, key: &KeyPath) -> usize {
        self.source.offset(key)
    }

    pub(super) fn out_of_range(&mut self, key: &KeyPath, found: impl Into<String>, expected: impl Into<String>) {
        self.problem(key, Problem::OutOfRange { found: found.into(), expected: expected.into() });
    }

    pub(super) fn missing(&mut self, table: &KeyPath, key: &str, next: impl Into<String>) {
        self.problem(&table.key(key), Problem::Missing { key: key.to_owned(), next: next.into() });
    }

    /// A finite number above zero.
    pub(super) fn above_zero(&mut self, key: &KeyPath, value: f64, unit: &str) -> f64 {
        if !(value.is_finite() && value > 0.0) {
            self.out_of_range(key, number(value), format!("a finite number above 0 {unit}"));
        }
        value
    }

    /// A finite number of at least zero.
    pub(super) fn not_negative(&mut self, key: &KeyPath, value: f64, unit: &str) -> f64 {
        if !(value.is_finite() && value >= 0.0) {
            let expected = if unit.is_empty() {
                "a finite number, 0 or more".to_owned()
            } else {
                format!("0 {unit} or more, finite")
            };
            self.out_of_range(key, number(value), expected);
        }
        value
    }

    /// A number between two bounds, both included.
    pub(super) fn between(&mut self, key: &KeyPath, value: f64, [low, high]: [f64; 2], unit: &str) -> f64 {
        if !(low..=high).contains(&value) {
            self.out_of_range(key, number(value), format!("{} to {} {unit}", number(low), number(high)));
        }
        value
    }

    /// Three finite numbers.
    pub(super) fn triple(&mut self, key: &KeyPath, value: Triple, unit: &str) -> [f64; 3] {
        for (axis, &part) in value.0.iter().enumerate() {
            if !part.is_finite() {
                self.out_of_range(&key.index(axis), number(part), format!("a finite number of {unit}"));
            }
        }
        value.0
    }

    /// A list of places or displacements [mm].
    pub(super) fn triples(&mut self, key: &KeyPath, values: &[Triple]) -> Vec<[f64; 3]> {
        values.iter().enumerate().map(|(index, &value)| self.triple(&key.index(index), value, "mm")).collect()
    }
}
