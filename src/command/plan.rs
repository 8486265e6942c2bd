//! `piola plan`: what a scene will model, and what it costs.

use super::{Exit, machine, scene};
use crate::cli::{Format, Plan};
use crate::console;
use crate::render;

pub(super) fn execute(arguments: &Plan) -> Exit {
    let Some(case) = scene::read_for_plan(&arguments.scene, &arguments.settings) else {
        return Exit::Input;
    };
    match scene::warnings(&case) {
        Ok(warnings) => drop(scene::print_warnings(&case, warnings)),
        Err(error) => {
            scene::print_error(&error);
            return Exit::Input;
        }
    }
    let planned = scene::with_threads(arguments.threads, || {
        let mut plan = case.rehearsed_plan(rayon::current_num_threads(), &machine::at_hand())?;
        let over = arguments.ranks.map(|ranks| case.plan_over_ranks(&plan, ranks));
        plan.ranks = over.transpose()?;
        Ok(plan)
    });
    let Some(planned) = planned else { return Exit::Input };
    match planned {
        Ok(plan) => {
            console::out(&match arguments.format {
                Format::Human => plan.to_string(),
                Format::Json => match serde_json::to_string_pretty(&plan) {
                    Ok(json) => json + "\n",
                    Err(error) => {
                        render::error(&error.to_string(), None);
                        return Exit::Input;
                    }
                },
            });
            if let Some(failure) = plan.first.as_ref().and_then(|first| first.failure.as_ref()) {
                render::warning(&format!("the first increment fails: {failure}"));
            }
            // Many processes are not of this machine alone.
            if let Some(refusal) = plan.refusal().filter(|_| plan.ranks.is_none()) {
                render::warning(&format!("{refusal}; `piola run` will refuse unless told --yes"));
            }
            Exit::Done
        }
        Err(error) => {
            scene::print_error(&error);
            Exit::Input
        }
    }
}
