//! Measured numbers: tables of the documents are those of the record.

use std::collections::BTreeSet;

use crate::record::{CIRCUMSTANCES, DOCUMENTS, PATH, Record};
use crate::{between, files, read};

fn record() -> Record {
    serde_json::from_str(&read(PATH)).expect("the record is as the benchmark writes it")
}

#[test]
fn measured_tables_are_not_edited_by_hand() {
    let record = record();
    for document in DOCUMENTS {
        let text = read(document);
        let rendered = record.render(&text).unwrap_or_else(|error| panic!("{document}: {error}"));
        assert!(
            rendered == text,
            "a table of {document} is not what was measured: `cargo bench --bench ratios -- render`"
        );
    }
}

/// Each table of the record is shown once, and only the documents that are rendered show tables of it.
#[test]
fn every_measured_table_is_shown_once() {
    let mut shown = Vec::new();
    for path in files(".md") {
        let text = read(&path);
        let names = between(&text, "<!-- measured: ", " -->");
        let rendered = DOCUMENTS.iter().any(|document| path.as_os_str() == *document);
        assert!(
            names.is_empty() || rendered,
            "{} shows tables and is not rendered",
            path.display()
        );
        shown.extend(names.into_iter().map(str::to_string));
    }
    let once: BTreeSet<String> = shown.iter().cloned().collect();
    assert_eq!(once.len(), shown.len(), "a table is shown twice: {shown:?}");
    let record = record();
    let tables = record.sections.values().flat_map(|section| &section.tables);
    let mut measured: BTreeSet<String> = tables.map(|table| table.name.clone()).collect();
    measured.insert(CIRCUMSTANCES.to_string());
    assert_eq!(once, measured);
}

/// A changed digit of a table is found.
#[test]
fn a_digit_edited_by_hand_shows() {
    let record = record();
    let text = read(DOCUMENTS[0]);
    let mark = text.find("| least of ").expect("a row of a table of ratios");
    let digit = text[..mark].rfind(|c: char| c.is_ascii_digit()).expect("a row has numbers");
    let other = if text.as_bytes()[digit] == b'1' { "2" } else { "1" };
    let edited = format!("{}{other}{}", &text[..digit], &text[digit + 1..]);
    assert_ne!(record.render(&edited).unwrap(), edited);
}
