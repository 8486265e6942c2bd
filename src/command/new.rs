//! `piola new`: a folder with a scene and a law to begin with.

use std::path::Path;

use piola_runtime::output::atomic::write_atomically;

use super::Exit;
use crate::cli::{New, Template};
use crate::console;
use crate::render;

/// What stands for the name in a law.
const PLACEHOLDER: &str = "NAME";

impl Template {
    /// Its files with their texts.
    fn files(self) -> &'static [(&'static str, &'static str)] {
        macro_rules! both {
            ($name:literal) => {
                &[
                    ("law.piola", include_str!(concat!("../templates/", $name, "/law.piola"))),
                    ("scene.toml", include_str!(concat!("../templates/", $name, "/scene.toml"))),
                ]
            };
        }
        match self {
            Template::Plate => both!("plate"),
            Template::Bar => both!("bar"),
            Template::Crack => both!("crack"),
            Template::Fibre => both!("fibre"),
            Template::Law => &[("law.piola", include_str!("../templates/law/law.piola"))],
        }
    }
}

pub(super) fn execute(arguments: &New) -> Exit {
    match write(&arguments.folder, arguments.template) {
        Ok(()) => Exit::Done,
        Err((message, help)) => {
            render::error(&message, help);
            Exit::Input
        }
    }
}

/// Writes the files, or says what is in the way; nothing that is there is touched.
fn write(folder: &Path, template: Template) -> Result<(), (String, Option<&'static str>)> {
    let shown = folder.display();
    let failed = |error: std::io::Error| (format!("cannot make {shown}: {error}"), None);
    std::fs::create_dir_all(folder).map_err(failed)?;
    let name = potential_name(folder);
    for (file, _) in template.files() {
        if folder.join(file).symlink_metadata().is_ok() {
            let message = format!("{} is there already", folder.join(file).display());
            return Err((message, Some("name another folder, or take the file away")));
        }
    }
    for (file, text) in template.files() {
        let text = text.replacen(PLACEHOLDER, &name, 1);
        write_atomically(&folder.join(file), |out| out.write_all(text.as_bytes()))
            .map_err(|error| (error.to_string(), error.help()))?;
    }
    let names: Vec<&str> = template.files().iter().map(|(file, _)| *file).collect();
    let next = match template {
        Template::Law => format!("piola check {}", typed(&folder.join("law.piola"))),
        _ => {
            let [scene, out] = ["scene.toml", "out"].map(|name| typed(&folder.join(name)));
            format!("piola run {scene} --out {out}")
        }
    };
    console::tell(&format!("{} in {shown}; next: {next}", names.join(" and ")));
    Ok(())
}

/// A path as it is typed.
fn typed(path: &Path) -> String {
    let shown = path.display().to_string();
    if shown.contains(char::is_whitespace) { format!("\"{shown}\"") } else { shown }
}

/// A potential may be called as its folder, where that is a name.
fn potential_name(folder: &Path) -> String {
    let whole = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    let name = whole.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let name: String = name.chars().map(|c| if is_part(c) { c } else { '_' }).collect();
    let line = format!("potential {name}\npsi(l) = l\n");
    if piola_grammar::parse(&line).is_ok() { name } else { format!("law_{name}") }
}
