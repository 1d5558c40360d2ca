//! The JSON schema of scenes, for editors and for `yawara scene --schema`.

use serde_json::Value;

use super::schema::SceneFile;

/// JSON schema (draft 2020-12) of the scene format, with unit, default and example of each key.
///
/// It describes keys, types and ranges of single values; what depends on several keys is left to [`super::parse`].
pub fn json_schema() -> Value {
    let mut schema = schemars::schema_for!(SceneFile).to_value();
    remove_null(&mut schema);
    schema
}

/// TOML has no null: a key that may be left out is left out. Takes `null` out of the types of optional keys.
fn remove_null(schema: &mut Value) {
    match schema {
        Value::Object(map) => {
            // "type": ["number", "null"]
            if let Some(Value::Array(types)) = map.get_mut("type") {
                types.retain(|name| name != "null");
                if let [only] = types.as_slice() {
                    let only = only.clone();
                    map.insert("type".to_owned(), only);
                }
            }
            // "anyOf": [{ "$ref": ... }, { "type": "null" }]
            if let Some(Value::Array(choices)) = map.get_mut("anyOf") {
                choices.retain(|choice| choice["type"] != "null");
                if let [Value::Object(only)] = choices.as_slice() {
                    let only = only.clone();
                    map.remove("anyOf");
                    map.extend(only);
                }
            }
            if map.get("default") == Some(&Value::Null) {
                map.remove("default");
            }
            map.values_mut().for_each(remove_null);
        }
        Value::Array(list) => list.iter_mut().for_each(remove_null),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Visits every object schema with properties: its path and the schema.
    fn visit(path: &str, schema: &Value, found: &mut Vec<(String, Value)>) {
        if schema.get("properties").is_some() {
            found.push((path.to_owned(), schema.clone()));
        }
        match schema {
            Value::Object(map) => map.iter().for_each(|(key, value)| visit(&format!("{path}/{key}"), value, found)),
            Value::Array(list) => list.iter().for_each(|value| visit(path, value, found)),
            _ => {}
        }
    }

    #[test]
    fn every_key_of_the_schema_is_described_and_no_other_is_allowed() {
        let schema = json_schema();
        let mut tables = Vec::new();
        visit("", &schema, &mut tables);
        let mut keys = 0;
        for (path, table) in &tables {
            assert_eq!(table["additionalProperties"], false, "{path}");
            for (key, value) in table["properties"].as_object().unwrap() {
                // The variants of a region are one-key tables whose description stands beside the key.
                let text = value.get("description").or(table.get("description")).and_then(Value::as_str);
                let text = text.unwrap_or_else(|| panic!("{path}: `{key}` has no description"));
                let is_table = matches!(
                    key.as_str(),
                    "volume"
                        | "lattice"
                        | "organ"
                        | "time"
                        | "gravity"
                        | "drag"
                        | "fix"
                        | "cut"
                        | "pull"
                        | "push"
                        | "pressure"
                        | "tool"
                        | "plane"
                        | "contact"
                        | "self_contact"
                        | "release"
                );
                assert!(is_table || text.contains("xample: `"), "{path}: `{key}` has no example: {text}");
                keys += 1;
            }
        }
        assert!(keys > 50, "only {keys} keys seen");
    }

    #[test]
    fn the_materials_are_listed() {
        let schema = json_schema();
        let text = schema["$defs"]["Organ"]["properties"]["material"]["description"].as_str().unwrap();
        let words: Vec<&str> = text.split([' ', ',', ';', '\n']).collect();
        for tissue in crate::material::library::tissues() {
            assert!(words.contains(&tissue.name), "no {} in {text}", tissue.name);
        }
    }

    #[test]
    fn modulus_and_density_are_a_number_or_one_of_two_keys() {
        let schema = json_schema();
        for (key, name) in [("youngs_modulus", "YoungsModulus"), ("density", "Density")] {
            let organ = &schema["$defs"]["Organ"]["properties"][key];
            assert_eq!(organ["$ref"], format!("#/$defs/{name}"));
            let choices = &schema["$defs"][name]["anyOf"];
            assert_eq!((choices[0]["type"].as_str(), &choices[0]["exclusiveMinimum"]), (Some("number"), &0.into()));
            assert_eq!(choices[1]["$ref"], format!("#/$defs/Varying{name}"));
            let table = &schema["$defs"][format!("Varying{name}")];
            assert_eq!((&table["minProperties"], &table["maxProperties"]), (&1.into(), &1.into()));
            let keys: Vec<&String> = table["properties"].as_object().unwrap().keys().collect();
            assert_eq!(keys, ["file", "hu"]);
        }
        let map = &schema["$defs"]["HuMap"]["anyOf"];
        assert_eq!((&map[0]["minItems"], &map[1]["type"]), (&2.into(), &"string".into()));
        assert_eq!(schema["$defs"]["MapPoint"]["maxItems"], 2);
        assert_eq!(schema["$defs"]["Organ"]["properties"]["poissons_ratio"]["maximum"], 0.49);
    }

    #[test]
    fn the_published_maps_are_listed() {
        let text = json_schema()["$defs"]["Organ"]["properties"]["density"]["description"].to_string();
        for map in crate::material::ct_density::density_maps() {
            assert!(text.contains(map.name), "no {} in {text}", map.name);
        }
    }

    #[test]
    fn nothing_may_be_null_and_ranges_are_kept() {
        let schema = json_schema();
        assert!(!schema.to_string().contains("null"));
        let organ = &schema["$defs"]["Organ"]["properties"];
        assert_eq!(organ["stiffness"]["exclusiveMinimum"], 0);
        assert_eq!(organ["stiffness"]["type"], "number");
        assert_eq!(schema["$defs"]["Triple"]["minItems"], 3);
        assert_eq!(schema["$defs"]["Triple"]["maxItems"], 3);
        assert_eq!(schema["properties"]["organ"]["minItems"], 1);
        assert_eq!(schema["required"], serde_json::json!(["volume", "organ", "time"]));
    }
}
