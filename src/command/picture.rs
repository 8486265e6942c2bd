//! `piola picture`: the body of a run at one time or at all, or force against displacement.

use std::path::PathBuf;

use piola_runtime::output::OutputFile;
use piola_runtime::output::picture::{BodyFilm, ForcePicture};
use piola_runtime::output::results::{self, Results, ResultsError};

use super::Exit;
use crate::cli::Picture;
use crate::console;
use crate::render;

pub(super) fn execute(arguments: &Picture) -> Exit {
    let file = match (&arguments.force, arguments.film) {
        (Some(_), _) => OutputFile::ForcePicture,
        (None, true) => OutputFile::Film,
        (None, false) => OutputFile::BodyPicture,
    };
    let file = arguments.out.clone().unwrap_or_else(|| arguments.folder.join(file.relative()));
    let ending = file.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    let as_svg = match ending.as_deref() {
        Some("png") => false,
        Some("svg") if !arguments.film => true,
        _ => {
            let what = if arguments.film {
                "a film is an animated PNG"
            } else {
                "a picture is PNG or SVG"
            };
            let help = format!(
                "{what}: end the name in {}",
                if arguments.film { ".png" } else { ".png or .svg" }
            );
            render::error(
                &format!("{} is no name of a picture", file.display()),
                Some(help.as_str()),
            );
            return Exit::Input;
        }
    };
    match draw(arguments, file, as_svg) {
        Ok(file) => {
            console::tell(&file.display().to_string());
            Exit::Done
        }
        Err(error) => {
            render::error(&error.to_string(), None);
            Exit::Input
        }
    }
}

fn draw(arguments: &Picture, file: PathBuf, as_svg: bool) -> Result<PathBuf, ResultsError> {
    let results = Results::open(&arguments.folder)?;
    let bytes = match &arguments.force {
        Some(set) => {
            ForcePicture::new(&results, set, arguments.against.as_deref())?.to_bytes(as_svg)?
        }
        None => {
            let body = BodyFilm::new(&results, arguments.field.as_deref())?;
            match arguments.film {
                true => body.film(arguments.seconds)?,
                false => body.still(arguments.at, as_svg)?,
            }
        }
    };
    results::write(&file, &bytes)?;
    Ok(file)
}
