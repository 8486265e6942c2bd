//! `piola schema`: JSON schemas of what is read and written.

use super::Exit;
use crate::cli::Subject;
use crate::console;
use crate::schema;

pub(super) fn execute(subject: Subject) -> Exit {
    let found = match subject {
        Subject::Scene => schema::scene(),
        Subject::Summary => schema::summary(),
        Subject::Finding => schema::finding(),
    };
    console::out(&format!("{found:#}\n"));
    Exit::Done
}
