//! A property of an organ as it is written: one number, or a table that says how it differs from place to place.

use std::fmt;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeSeed, Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::checks::Checks;
use super::diagnostics::KeyPath;
use super::problem::{Caution, Problem, nearest_name, number};
use super::property::{Property, PropertyKind};
use super::schema;
use super::values::exactly;
use crate::material::ct_density::{density_map, density_maps};

/// Below this, a voxel may well be air.
const AIR_BELOW_HU: f64 = -800.0;

/// A kind of property as a type, so that what is wrong with a value can be said in its unit while it is read.
pub(super) trait Quantity {
    const KIND: PropertyKind;
}

/// Young's modulus [Pa].
#[derive(Debug, Clone, Copy, JsonSchema)]
pub(super) struct YoungsModulus;

/// Density [kg/m^3].
#[derive(Debug, Clone, Copy, JsonSchema)]
pub(super) struct Density;

impl Quantity for YoungsModulus {
    const KIND: PropertyKind = PropertyKind::YoungsModulus;
}

impl Quantity for Density {
    const KIND: PropertyKind = PropertyKind::Density;
}

/// One number, or a table that says how the property differs from place to place.
#[derive(Debug, Clone, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "{Q}")]
pub(super) enum Written<Q> {
    /// The same everywhere, above 0.
    #[schemars(extend("exclusiveMinimum" = 0))]
    Constant(f64),
    /// Different from place to place.
    Varying(Varying<Q>),
}

/// A property that differs from place to place: one of these keys.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, bound = "Q: Quantity")]
#[schemars(rename = "Varying{Q}", extend("minProperties" = 1, "maxProperties" = 1))]
pub(super) struct Varying<Q> {
    /// From the CT number: points [HU, value] by ascending HU, at least two, values in the unit of the key (Pa, kg/m^3);
    /// straight between them, constant beyond the ends. For density also the name of a published map: "schneider_2000"
    /// (see `yawara info --materials`). Needs a CT image or a phantom.
    /// Example: `youngs_modulus = { hu = [[-100, 2e3], [0, 5e3], [100, 2e4]] }` or `density = { hu = "schneider_2000" }`.
    #[serde(default, deserialize_with = "some_hu_map::<_, Q>")]
    pub(super) hu: Option<HuMap>,
    /// From a volume of values in the unit of the key (Pa, kg/m^3) on the grid of the image or labels, such as
    /// elastography gives; a path relative to the scene file. Example: `youngs_modulus = { file = "stiffness.nii.gz" }`.
    pub(super) file: Option<PathBuf>,
    #[serde(skip)]
    quantity: PhantomData<Q>,
}

/// A map from CT numbers.
#[derive(Debug, Clone, JsonSchema)]
#[serde(untagged)]
pub(super) enum HuMap {
    /// Points, straight between them.
    Points(#[schemars(length(min = 2))] Vec<MapPoint>),
    /// A published map by its name.
    Name(String),
}

/// A point of a map from CT numbers: two numbers [HU, value].
#[derive(Debug, Clone, Copy, JsonSchema)]
pub(super) struct MapPoint(pub(super) [f64; 2]);

impl<'de, Q: Quantity> Deserialize<'de> for Written<Q> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(WrittenVisitor(PhantomData))
    }
}

struct WrittenVisitor<Q>(PhantomData<Q>);

impl<'de, Q: Quantity> Visitor<'de> for WrittenVisitor<Q> {
    type Value = Written<Q>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (unit, file) = (Q::KIND.unit(), file_example(Q::KIND));
        write!(f, "a number of {unit}, or a table {{ hu = [[HU, {unit}], ...] }} or {{ file = \"{file}\" }}")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Written<Q>, E> {
        Ok(Written::Constant(value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Written<Q>, E> {
        Ok(Written::Constant(value as f64))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Written<Q>, E> {
        Ok(Written::Constant(value as f64))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Written<Q>, A::Error> {
        Varying::deserialize(MapAccessDeserializer::new(map)).map(Written::Varying)
    }
}

fn some_hu_map<'de, D: Deserializer<'de>, Q: Quantity>(deserializer: D) -> Result<Option<HuMap>, D::Error> {
    deserializer.deserialize_any(HuMapVisitor(Q::KIND)).map(Some)
}

struct HuMapVisitor(PropertyKind);

impl<'de> Visitor<'de> for HuMapVisitor {
    type Value = HuMap;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of points [HU, {}]", self.0.unit())?;
        if published(self.0).is_empty() { Ok(()) } else { f.write_str(" or the name of a published map") }
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<HuMap, E> {
        Ok(HuMap::Name(name.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<HuMap, A::Error> {
        let mut points = Vec::new();
        while let Some(point) = list.next_element_seed(PointSeed(self.0))? {
            points.push(point);
        }
        Ok(HuMap::Points(points))
    }
}

struct PointSeed(PropertyKind);

impl<'de> DeserializeSeed<'de> for PointSeed {
    type Value = MapPoint;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<MapPoint, D::Error> {
        exactly(deserializer, &format!("two numbers [HU, {}]", self.0.unit())).map(MapPoint)
    }
}

/// Names of the published maps.
fn published(kind: PropertyKind) -> Vec<&'static str> {
    match kind {
        PropertyKind::YoungsModulus => Vec::new(),
        PropertyKind::Density => density_maps().iter().map(|map| map.name).collect(),
    }
}

fn file_example(kind: PropertyKind) -> &'static str {
    match kind {
        PropertyKind::YoungsModulus => "stiffness.nii.gz",
        PropertyKind::Density => "density.nii.gz",
    }
}

/// What tissue has, and what else a number may have been meant as. Softest tissue (fat, brain): some hundred Pa; metal
/// implants reach 1.1e11 Pa (titanium). Inflated lung: 200 kg/m3; cortical bone: 1900 kg/m3; steel: 8000 kg/m3.
fn usual(kind: PropertyKind) -> ([f64; 2], &'static str, &'static str) {
    match kind {
        PropertyKind::YoungsModulus => ([50.0, 5e11], "50 to 5e11", "1 kPa is 1e3 Pa"),
        PropertyKind::Density => ([50.0, 25_000.0], "50 to 25000", "1 g/cm3 is 1000 kg/m3"),
    }
}

/// Checks a property; `None` when there is nothing to go on with.
pub(super) fn resolve<Q: Quantity>(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    written: &Written<Q>,
    volume: &schema::Volume,
    folder: &Path,
) -> Option<Property> {
    let kind = Q::KIND;
    let (key, unit) = (table.key(kind.key()), kind.unit());
    let Varying { hu, file, .. } = match written {
        Written::Constant(value) => {
            check_value(checks, &key, *value, kind);
            return Some(Property::Constant(*value));
        }
        Written::Varying(varying) => varying,
    };
    match (hu, file) {
        (Some(_), Some(_)) => {
            let next = format!("take the {} from the CT number or from a volume of its own", kind.noun());
            checks.problem(&key.key("file"), Problem::Conflict { first: "hu".into(), second: "file".into(), next });
            None
        }
        (None, None) => {
            let (map, file) = match kind {
                PropertyKind::YoungsModulus => ("[[-100, 2e3], [100, 2e4]]", file_example(kind)),
                PropertyKind::Density => ("[[-100, 930], [100, 1100]]", file_example(kind)),
            };
            let expected = format!("a number of {unit}, {{ hu = {map} }} or {{ file = \"{file}\" }}");
            checks.out_of_range(&key, "an empty table", expected);
            None
        }
        (Some(map), None) => {
            let key = key.key("hu");
            let before = checks.problems.len();
            // A volume with nothing at all has been reported as such.
            if volume.image.is_none() && volume.phantom.is_none() && volume.labels.is_some() {
                let next =
                    format!("the {} is taken from the CT number, so add the CT: image = \"ct.nii.gz\"", kind.noun());
                checks.problem(&key, Problem::Missing { key: "volume.image".into(), next });
            }
            let points = match map {
                HuMap::Points(points) => check_points(checks, &key, points, kind),
                HuMap::Name(name) => published_points(checks, &key, name, kind)?,
            };
            (checks.problems.len() == before).then_some(Property::FromHu(points))
        }
        (None, Some(path)) => {
            if path.as_os_str().is_empty() {
                let expected = format!("the path of a volume of {} [{unit}]", kind.name());
                checks.out_of_range(&key.key("file"), "an empty path", expected);
            }
            Some(Property::FromFile(folder.join(path)))
        }
    }
}

fn check_points(checks: &mut Checks<'_>, key: &KeyPath, points: &[MapPoint], kind: PropertyKind) -> Vec<[f64; 2]> {
    if points.len() < 2 {
        let found = if points.len() == 1 { "1 point".to_owned() } else { format!("{} points", points.len()) };
        let constant = match kind {
            PropertyKind::YoungsModulus => "5e3",
            PropertyKind::Density => "1060",
        };
        let expected = format!(
            "at least two points [HU, {}]; for the same {} everywhere write {} = {constant}",
            kind.unit(),
            kind.noun(),
            kind.key()
        );
        checks.out_of_range(key, found, expected);
    }
    let mut earlier = None;
    for (index, &MapPoint([hu, value])) in points.iter().enumerate() {
        let point = key.index(index);
        if !hu.is_finite() {
            checks.out_of_range(&point.index(0), number(hu), "a finite number of HU");
        } else if let Some(earlier) = earlier.filter(|&earlier| hu <= earlier) {
            let expected =
                format!("more than the {} HU of the point before; give the points by ascending HU", number(earlier));
            checks.out_of_range(&point.index(0), format!("{} HU", number(hu)), expected);
        }
        earlier = Some(hu);
        if kind == PropertyKind::Density && hu < AIR_BELOW_HU {
            checks.above_zero(&point.index(1), value, kind.unit());
        } else {
            check_value(checks, &point.index(1), value, kind);
        }
    }
    points.iter().map(|point| point.0).collect()
}

fn published_points(checks: &mut Checks<'_>, key: &KeyPath, name: &str, kind: PropertyKind) -> Option<Vec<[f64; 2]>> {
    let known = published(kind);
    if known.is_empty() {
        let expected = format!(
            "a list of points [HU, {}]; there is no published map from CT numbers to {}",
            kind.unit(),
            kind.name()
        );
        checks.out_of_range(key, format!("\"{name}\""), expected);
        return None;
    }
    let Some(map) = density_map(name) else {
        let suggestion = nearest_name(name, known.iter().copied());
        let known = known.into_iter().map(str::to_owned).collect();
        let kind = "map from CT numbers";
        checks.problem(key, Problem::UnknownName { kind, found: name.to_owned(), suggestion, known });
        return None;
    };
    Some(map.points.to_vec())
}

/// A value above zero; warns where it looks like one in another unit.
fn check_value(checks: &mut Checks<'_>, key: &KeyPath, value: f64, kind: PropertyKind) {
    checks.above_zero(key, value, kind.unit());
    let ([low, high], usual, hint) = usual(kind);
    if value > 0.0 && !(low..=high).contains(&value) {
        checks.caution(key, Caution::UnusualValue { found: number(value), unit: kind.unit(), usual, hint });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(bound = "Q: Quantity")]
    struct Holder<Q> {
        value: Written<Q>,
    }

    fn read<Q: Quantity>(text: &str) -> Result<Written<Q>, toml::de::Error> {
        toml::from_str::<Holder<Q>>(&format!("value = {text}")).map(|holder| holder.value)
    }

    #[test]
    fn a_property_is_a_number_or_a_table() {
        assert!(matches!(read::<YoungsModulus>("5000"), Ok(Written::Constant(5e3))));
        assert!(matches!(read::<Density>("1.06e3"), Ok(Written::Constant(1.06e3))));
        let Ok(Written::Varying(Varying { hu: Some(HuMap::Points(points)), file: None, .. })) =
            read::<YoungsModulus>("{ hu = [[-1, 2.5], [3, 4]] }")
        else {
            panic!("the map is read")
        };
        assert_eq!(points.iter().map(|point| point.0).collect::<Vec<_>>(), [[-1.0, 2.5], [3.0, 4.0]]);
        let named = read::<Density>("{ hu = 'schneider_2000' }").unwrap();
        assert!(
            matches!(named, Written::Varying(Varying { hu: Some(HuMap::Name(name)), .. }) if name == "schneider_2000")
        );
        let file = read::<Density>("{ file = 'a.nii' }").unwrap();
        assert!(
            matches!(file, Written::Varying(Varying { hu: None, file: Some(path), .. }) if path.ends_with("a.nii"))
        );
    }

    #[test]
    fn what_is_neither_is_said_in_the_unit_of_the_key() {
        fn check<Q: Quantity + fmt::Debug>(bad: &str, message: &str) {
            let error = read::<Q>(bad).unwrap_err();
            assert!(error.message().contains(message), "{bad}: {error}");
            assert!(error.span().is_some(), "{bad}");
        }
        check::<YoungsModulus>("'soft'", "expected a number of Pa, or a table { hu");
        check::<YoungsModulus>("[1, 2]", "expected a number of Pa, or a table { hu");
        check::<Density>("'heavy'", "expected a number of kg/m3, or a table { hu = [[HU, kg/m3], ...] }");
        check::<YoungsModulus>("{ hu = [[1, 2, 3]] }", "expected two numbers [HU, Pa], found 3");
        check::<Density>("{ hu = [[1]] }", "expected two numbers [HU, kg/m3], found 1");
        check::<YoungsModulus>("{ hu = 7 }", "expected a list of points [HU, Pa]");
        check::<Density>("{ hu = 7 }", "expected a list of points [HU, kg/m3] or the name of a published map");
        check::<YoungsModulus>("{ HU = [[1, 2]] }", "unknown field `HU`");
        check::<Density>("{ quantity = 1 }", "unknown field `quantity`");
    }
}
