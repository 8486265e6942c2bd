//! JSON schemas of what is read and written, made from what the reader takes and the pages that document it:
//! an editor that knows them completes keys of scenes and shows what they mean.

use piola_runtime::scene::{ValueWords, vocabulary};
use serde_json::{Map, Value, json};

use crate::pages::{OUTPUT, Row, SCENES, Section, sections};

/// The dialect.
const DRAFT: &str = "https://json-schema.org/draft/2020-12/schema";

/// The schema of scene files, as TOML reads them.
pub(crate) fn scene() -> Value {
    let mut tables: Map<String, Value> = Map::new();
    let sections = sections(SCENES);
    for words in vocabulary().iter().filter(|words| words.name != "sets") {
        let of_page: Vec<&Section> =
            sections.iter().filter(|section| section.table() == Some(words.name)).collect();
        let rows: Vec<Row> = of_page.iter().flat_map(|section| section.rows("key")).collect();
        let mut table = table(of_page.first().map_or("", |section| section.summary()));
        for key in &words.keys {
            let row = rows.iter().find(|row| row.name == key.name);
            table["properties"][key.name] = property(row, &key.value);
        }
        tables.insert(words.name.to_string(), if words.repeats { several(&table) } else { table });
    }
    // The parts of a material stand in it, and there may be several of both.
    if let Some(plus) = tables.remove("material.plus") {
        let material = &mut tables["material"];
        material["properties"]["plus"] = plus;
        *material = json!({ "anyOf": [material.clone(), several(material)] });
    }
    let about_sets = sections.iter().find(|section| section.table() == Some("sets"));
    tables.insert("sets".to_string(), sets(about_sets.map_or("", |section| section.summary())));
    json!({
        "$schema": DRAFT,
        "title": "A scene of piola",
        "type": "object",
        "properties": tables,
        "required": ["body", "horizon", "material"],
        "additionalProperties": false,
    })
}

fn table(description: &str) -> Value {
    json!({
        "type": "object",
        "description": description,
        "properties": {},
        "additionalProperties": false,
    })
}

fn several(table: &Value) -> Value {
    json!({ "type": "array", "items": table })
}

/// A key, by what the page says of it and what the reader takes.
fn property(row: Option<&Row>, value: &ValueWords) -> Value {
    let mut property = match value {
        ValueWords::Word(words) => json!({ "enum": words }),
        ValueWords::WordOrText(words) => {
            json!({ "anyOf": [{ "enum": words }, { "type": "string" }] })
        }
        ValueWords::Words(words) => {
            json!({ "type": "array", "items": { "enum": words }, "uniqueItems": true })
        }
        ValueWords::Positive => json!({ "type": "number", "exclusiveMinimum": 0 }),
        ValueWords::Fraction => {
            json!({ "type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1 })
        }
        ValueWords::NotNegative => json!({ "type": "number", "minimum": 0 }),
        ValueWords::Switch => json!({ "type": "boolean" }),
        ValueWords::Seconds(_) => {
            json!({ "anyOf": [{ "type": "number", "exclusiveMinimum": 0 }, { "type": "string" }] })
        }
        ValueWords::Count(least) => json!({ "type": "integer", "minimum": least }),
        ValueWords::Text => json!({ "type": "string" }),
        ValueWords::Other => json!({}),
    };
    if let Some(row) = row {
        property["description"] = json!(row.meaning);
        if let Some(default) = row.default() {
            property["default"] = default;
        }
    }
    property
}

fn sets(description: &str) -> Value {
    let listed = |key: &str, types: &[&str]| {
        json!({
            "type": "object",
            "properties": { key: { "type": types } },
            "required": [key],
            "additionalProperties": false,
        })
    };
    json!({
        "type": "object",
        "description": description,
        "additionalProperties": { "anyOf": [
            { "type": "string" },
            listed("group", &["string", "integer"]),
            listed("numbers", &["string"]),
        ] },
    })
}

/// The schema of `summary.json`.
pub(crate) fn summary() -> Value {
    let fields = |head: &str| -> Map<String, Value> {
        let rows = sections(OUTPUT).into_iter().flat_map(|section| section.rows(head));
        rows.map(|row| (row.name.to_string(), json!({ "description": row.meaning }))).collect()
    };
    let mut properties = fields("field");
    let steps = json!({ "type": "object", "properties": fields("field of a step") });
    properties.insert("steps".to_string(), json!({ "type": "array", "items": steps }));
    let required = ["versions", "scene_hash", "exit_reason", "dimension", "points", "phases"];
    json!({
        "$schema": DRAFT,
        "title": "The summary of a run of piola",
        "type": "object",
        "properties": properties,
        "required": required,
    })
}

/// The schema of a line of `piola check --format json`.
pub(crate) fn finding() -> Value {
    let whole =
        |description: &str| json!({ "type": "integer", "minimum": 0, "description": description });
    let text = |description: &str| json!({ "type": "string", "description": description });
    json!({
        "$schema": DRAFT,
        "title": "A finding of piola",
        "type": "object",
        "properties": {
            "code": text("a stable name; `piola explain CODE` says more"),
            "severity": { "enum": ["error", "warning"] },
            "message": text("what is wrong, in a sentence"),
            "file": text("the file, or the override"),
            "line": whole("from 1"),
            "column": whole("in characters, from 1"),
            "start": whole("byte where the place begins, from 0"),
            "end": whole("byte behind it"),
            "label": text("what stands under the place; may be empty"),
            "notes": { "type": "array", "items": {
                "type": "object",
                "properties": {
                    "line": whole("from 1"),
                    "column": whole("in characters, from 1"),
                    "label": text("what stands there"),
                },
            } },
            "helps": { "type": "array", "items": text("a way out") },
        },
        "required": ["code", "severity", "message", "file", "line", "column", "start", "end", "helps"],
        "additionalProperties": false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_have_their_tables_and_keys() {
        let schema = scene();
        let of = |table: &str| schema["properties"][table].clone();
        for table in ["body", "horizon", "correspondence", "fracture", "steps", "motion", "solver"]
        {
            assert!(!of(table)["properties"].as_object().unwrap().is_empty(), "{table}");
        }
        assert_eq!(of("body")["properties"]["nodes"]["default"], "cells");
        assert_eq!(of("body")["properties"]["nodes"]["enum"][1], "corners");
        assert_eq!(of("solver")["properties"]["tolerance"]["exclusiveMaximum"], 1);
        let spacings = of("horizon")["properties"]["spacings"]["description"].clone();
        assert!(spacings.as_str().unwrap().starts_with("horizon in spacings"), "{spacings}");
        assert!(of("probe")["items"]["properties"]["at"]["description"].is_string());
        let material = &of("material")["anyOf"][0]["properties"];
        for key in ["potential", "parameters", "set", "plus"] {
            assert!(material[key].is_object(), "{key}");
        }
    }

    #[test]
    fn summaries_have_their_fields() {
        let schema = summary();
        for field in ["points", "warnings", "exit_reason", "wall_seconds"] {
            assert!(schema["properties"][field]["description"].is_string(), "{field}");
        }
        assert!(schema["properties"]["steps"]["items"]["properties"]["iterations"].is_object());
    }
}
