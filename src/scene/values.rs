//! Values of a scene that derived readers would accept too freely or refuse without a reason: tables that must not be
//! lists, switches that may be tables, lists of exactly two or three numbers, labels by number or name.

use std::fmt;
use std::marker::PhantomData;

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeSeed, Error, IgnoredAny, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};

/// Reads a table. Derived structs would also read a list, its entries taken for the keys in order.
pub(super) fn table<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<T, D::Error> {
    deserializer.deserialize_any(TableVisitor(PhantomData))
}

pub(super) fn some_table<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    table(deserializer).map(Some)
}

/// True or false, or a table that says more than true.
#[derive(Debug, JsonSchema)]
#[serde(untagged)]
pub(super) enum Switch<T> {
    /// As is, or not at all.
    Plain(bool),
    /// In this way.
    Table(T),
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Switch<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SwitchVisitor(PhantomData))
    }
}

struct SwitchVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for SwitchVisitor<T> {
    type Value = Switch<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("true, false or a table")
    }

    fn visit_bool<E: Error>(self, on: bool) -> Result<Switch<T>, E> {
        Ok(Switch::Plain(on))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Switch<T>, A::Error> {
        T::deserialize(MapAccessDeserializer::new(map)).map(Switch::Table)
    }
}

/// Reads a list of tables.
pub(super) fn tables<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    deserializer.deserialize_any(TablesVisitor(PhantomData))
}

struct TableVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for TableVisitor<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table, as [name] with keys below it or as { key = value }")
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
        T::deserialize(MapAccessDeserializer::new(map))
    }
}

struct TablesVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for TablesVisitor<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of tables, each as [[name]] with keys below it")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<T>, A::Error> {
        let mut tables = Vec::new();
        while let Some(table) = list.next_element_seed(TableSeed(PhantomData))? {
            tables.push(table);
        }
        Ok(tables)
    }
}

struct TableSeed<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> DeserializeSeed<'de> for TableSeed<T> {
    type Value = T;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<T, D::Error> {
        table(deserializer)
    }
}

/// Three numbers [x, y, z]. A type of its own because reading a plain array would drop a fourth number unseen.
#[derive(Debug, Clone, Copy, JsonSchema)]
pub(super) struct Triple(pub(super) [f64; 3]);

impl<'de> Deserialize<'de> for Triple {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        exactly(deserializer, "three numbers [x, y, z]").map(Self)
    }
}

/// Two numbers [min, max].
#[derive(Debug, Clone, Copy, JsonSchema)]
pub(super) struct Pair(pub(super) [f64; 2]);

impl<'de> Deserialize<'de> for Pair {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        exactly(deserializer, "two numbers [min, max]").map(Self)
    }
}

/// A colour of a CT number: [HU, "#rrggbb"].
#[derive(Debug, Clone, JsonSchema)]
pub(super) struct ColorPoint(pub(super) f64, pub(super) String);

impl<'de> Deserialize<'de> for ColorPoint {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(ColorPointVisitor)
    }
}

struct ColorPointVisitor;

impl<'de> Visitor<'de> for ColorPointVisitor {
    type Value = ColorPoint;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a CT number and a colour, [HU, \"#rrggbb\"]")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<ColorPoint, A::Error> {
        let short = |found: usize| A::Error::invalid_length(found, &self);
        let hu = list.next_element()?.ok_or_else(|| short(0))?;
        let color = list.next_element()?.ok_or_else(|| short(1))?;
        match list.next_element::<IgnoredAny>()? {
            None => Ok(ColorPoint(hu, color)),
            Some(_) => Err(short(3)),
        }
    }
}

/// A list of so many numbers.
pub(super) fn exactly<'de, D: Deserializer<'de>, const N: usize>(
    deserializer: D,
    expected: &str,
) -> Result<[f64; N], D::Error> {
    let numbers = Vec::<f64>::deserialize(deserializer)?;
    let found = numbers.len();
    numbers.try_into().map_err(|_| D::Error::custom(format!("expected {expected}, found {found} of them")))
}

/// A label by number or by name.
#[derive(Debug, Clone, PartialEq, JsonSchema)]
#[serde(untagged)]
pub(super) enum Label {
    /// The number in the label map, from 1 to 65535.
    Id(#[schemars(range(min = 1))] u16),
    /// The name of `label_names` or of the phantom.
    Name(String),
}

/// One label, or a list of them.
#[derive(Debug, Clone, JsonSchema)]
#[serde(untagged)]
pub(super) enum LabelList {
    /// One label.
    One(Label),
    /// Several labels.
    Many(#[schemars(length(min = 1))] Vec<Label>),
}

// Written out rather than derived: serde's untagged enums cannot say what was wrong, nor where.
impl<'de> Deserialize<'de> for Label {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(LabelVisitor)
    }
}

impl<'de> Deserialize<'de> for LabelList {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(LabelListVisitor)
    }
}

struct LabelVisitor;

impl Visitor<'_> for LabelVisitor {
    type Value = Label;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a label: a number from 1 to 65535, or a name")
    }

    fn visit_i64<E: Error>(self, id: i64) -> Result<Label, E> {
        match u16::try_from(id) {
            Ok(id) if id > 0 => Ok(Label::Id(id)),
            _ => Err(E::invalid_value(Unexpected::Signed(id), &self)),
        }
    }

    fn visit_u64<E: Error>(self, id: u64) -> Result<Label, E> {
        self.visit_i64(i64::try_from(id).unwrap_or(i64::MAX))
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Label, E> {
        Ok(Label::Name(name.to_owned()))
    }
}

struct LabelListVisitor;

impl<'de> Visitor<'de> for LabelListVisitor {
    type Value = LabelList;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a label (a number from 1 to 65535, or a name) or a list of labels")
    }

    fn visit_i64<E: Error>(self, id: i64) -> Result<LabelList, E> {
        LabelVisitor.visit_i64(id).map(LabelList::One)
    }

    fn visit_u64<E: Error>(self, id: u64) -> Result<LabelList, E> {
        LabelVisitor.visit_u64(id).map(LabelList::One)
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<LabelList, E> {
        LabelVisitor.visit_str(name).map(LabelList::One)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<LabelList, A::Error> {
        let mut labels = Vec::new();
        while let Some(label) = list.next_element()? {
            labels.push(label);
        }
        Ok(LabelList::Many(labels))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fourth_coordinate_is_not_dropped() {
        #[derive(Debug, Deserialize)]
        struct Holder {
            acceleration: Triple,
        }
        let gravity = |text: &str| toml::from_str::<Holder>(text);
        assert_eq!(gravity("acceleration = [1, 2.5, -3]").unwrap().acceleration.0, [1.0, 2.5, -3.0]);
        let error = gravity("acceleration = [1, 2, 3, 4]").unwrap_err();
        assert!(error.message().contains("three numbers [x, y, z], found 4"), "{error}");
        assert_eq!(error.span(), Some(15..27));
    }

    #[test]
    fn a_colour_point_has_two_parts() {
        #[derive(Debug, Deserialize)]
        struct Holder {
            point: ColorPoint,
        }
        let read = |text: &str| toml::from_str::<Holder>(&format!("point = {text}")).map(|holder| holder.point);
        let ColorPoint(hu, color) = read("[-100, '#e3c878']").unwrap();
        assert_eq!((hu, color.as_str()), (-100.0, "#e3c878"));
        for (bad, message) in [
            ("[1]", "expected a CT number and a colour"),
            ("[1, '#000000', 2]", "expected a CT number and a colour"),
            ("['#000000', 1]", "invalid type: string"),
            ("7", "expected a CT number and a colour"),
        ] {
            let error = read(bad).unwrap_err();
            assert!(error.message().contains(message), "{bad}: {error}");
            assert!(error.span().is_some(), "{bad}");
        }
    }

    #[test]
    fn labels_are_numbers_names_or_lists() {
        #[derive(Deserialize)]
        struct Holder {
            label: LabelList,
        }
        let read = |text: &str| toml::from_str::<Holder>(text).map(|holder| holder.label);
        assert!(matches!(read("label = 5"), Ok(LabelList::One(Label::Id(5)))));
        assert!(matches!(read("label = 'liver'"), Ok(LabelList::One(Label::Name(name))) if name == "liver"));
        let many = vec![Label::Id(65535), Label::Name("rib".into())];
        assert!(matches!(read("label = [65535, 'rib']"), Ok(LabelList::Many(list)) if list == many));
        for bad in ["0", "-1", "65536", "1.5", "true", "[0]", "[[1]]"] {
            let error = read(&format!("label = {bad}")).unwrap_err();
            assert!(error.message().contains("a number from 1 to 65535"), "{bad}: {error}");
        }
    }
}
