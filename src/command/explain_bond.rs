//! `piola explain-bond`: why a bond broke, or did not.

use std::sync::Arc;

use piola_runtime::case::{Case, CaseError};
use piola_runtime::output::summary::ExitReason;
use piola_runtime::simulation::{BondHistory, Place, bond_history, points_of};
use piola_runtime::solve::Watch;

use super::{Exit, scene};
use crate::cli::{ExplainBond, Format};
use crate::console;
use crate::interrupt::{Interrupt, Signal};
use crate::progress::Progress;
use crate::render;

pub(super) fn execute(arguments: &ExplainBond) -> Exit {
    let [p, q] = &arguments.at[..] else { return Exit::Input };
    let places = [p.clone(), q.clone()];
    let Some(case) = scene::read(&arguments.scene, &arguments.settings) else {
        return Exit::Input;
    };
    match scene::warnings(&case) {
        Ok(warnings) => drop(scene::print_warnings(&case, warnings)),
        Err(error) => {
            scene::print_error(&error);
            return Exit::Input;
        }
    }
    let work = || follow(&case, &places, arguments.format);
    scene::with_threads(arguments.threads, work).unwrap_or(Exit::Input)
}

fn follow(case: &Case, places: &[Place; 2], format: Format) -> Exit {
    let interrupt = Interrupt::listen();
    let end = case.scene.motion.as_ref().map_or(case.scene.steps.end, |motion| motion.end);
    let progress = Arc::new(Progress::new(end, interrupt.clone()));
    let found = (|| -> Result<BondHistory, CaseError> {
        let ends = points_of(case, places)?;
        let shown = progress.show();
        let found = bond_history(case, ends, &Watch::by(Arc::clone(&progress) as _));
        drop(shown);
        found
    })();
    let history = match found {
        Ok(history) => history,
        Err(error) => {
            scene::print_error(&error);
            return Exit::Input;
        }
    };
    console::out(&match format {
        Format::Human => history.to_string(),
        Format::Json => format!("{:#}\n", history.json()),
    });
    let (reason, message) = &history.ended;
    match (reason, interrupt.signal()) {
        (ExitReason::Completed, _) => Exit::Done,
        (ExitReason::Interrupted, Some(Signal::Terminate)) => Exit::Terminated,
        (ExitReason::Interrupted, _) => Exit::Interrupted,
        _ => {
            render::error(message, None);
            Exit::NotConverged
        }
    }
}
