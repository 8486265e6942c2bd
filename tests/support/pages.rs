//! Blocks of pages, and scenes made of them.
#![allow(dead_code)] // Every test binary uses its own part of this.

/// A fenced block: its language and its text.
pub(crate) type Block<'p> = (&'p str, &'p str);

pub(crate) fn blocks(text: &str) -> Vec<Block<'_>> {
    let fenced = text.split("\n```").skip(1).step_by(2);
    fenced.filter_map(|block| block.split_once('\n')).collect()
}

/// The tables of a scene or of a part of one, each with its header.
fn tables(scene: &str) -> Vec<String> {
    let mut tables: Vec<String> = Vec::new();
    for line in scene.lines() {
        if line.starts_with('[') || tables.is_empty() {
            tables.push(String::new());
        }
        let table = tables.last_mut().unwrap();
        table.push_str(line);
        table.push('\n');
    }
    tables
}

/// A scene with those of its tables replaced that a fragment names.
pub(crate) fn with_tables(scene: &str, fragment: &str) -> String {
    // One [material] and several [[material]] exclude each other.
    let name = |head: &str| head.trim_matches(['[', ']']).to_string();
    let head = |table: &String| table.lines().next().map(name);
    let fragment = tables(fragment);
    let mut kept = tables(scene);
    kept.retain(|table| !fragment.iter().any(|other| head(other) == head(table)));
    kept.into_iter().chain(fragment).collect()
}
