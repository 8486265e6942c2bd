//! `piola energy`: energy, forces and tangent of a given displacement.

use std::collections::BTreeMap;

use piola_runtime::case::{Case, CaseError};
use piola_runtime::energy::Energy as _;
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::output::read::read_displacement;

use serde_json::{Value, json};

use super::{Exit, scene};
use crate::cli::{Energy, Format};
use crate::console;
use crate::potential;
use crate::table::MAX_TABLE;

pub(super) fn execute(arguments: &Energy) -> Exit {
    let Some(case) = scene::read(&arguments.scene, &arguments.settings) else {
        return Exit::Input;
    };
    scene::print_warnings(&case, case.warnings.clone());
    match evaluate(&case, arguments) {
        Ok(Some(result)) => {
            console::out(&match arguments.format {
                Format::Json => format!("{result}\n"),
                Format::Human => human(&result),
            });
            Exit::Done
        }
        Ok(None) => Exit::Input,
        Err(error) => {
            scene::print_error(&error);
            Exit::Input
        }
    }
}

fn evaluate(case: &Case, arguments: &Energy) -> Result<Option<Value>, CaseError> {
    case.check_rest()?;
    let d = case.body.dimension();
    let n = case.body.n_points();
    let displacement = match &arguments.displacement {
        None => vec![0.0; n * d],
        Some(path) => {
            let Some(text) = potential::read_limited(path, MAX_TABLE) else { return Ok(None) };
            let rows = read_displacement(&text, d, n)
                .map_err(|error| CaseError::table(path, &text, error))?;
            case.body.from_user_order(&rows, d)
        }
    };
    let compiled = case.compile()?;
    for dropped in compiled.iter().flat_map(|potential| &potential.dropped) {
        console::note(&dropped.reason);
    }
    if case.changes_in_time() {
        console::note("parameters that change with t have the values of t = 0");
    }
    let energy = case.energy(compiled)?;
    let mut gradient = vec![0.0; n * d];
    let mut tangent = arguments.tangent.then(|| BlockMatrix::zeros(energy.pattern()));
    let parts = match &mut tangent {
        Some(tangent) => energy.tangent(&displacement, &mut gradient, tangent),
        None => energy.forces(&displacement, &mut gradient),
    };
    let parts = parts.map_err(|found| CaseError::Body { message: case.describe(&found) })?;
    let report = energy.report();
    let rows: Vec<Vec<f64>> =
        case.body.to_user_order(&gradient, d).chunks_exact(d).map(<[f64]>::to_vec).collect();
    let mut result = json!({
        "points": n,
        "dimension": d,
        "interactions": {
            "bonds": report.bonds,
            "triangles": report.triangles,
            "tetrahedra": report.tetrahedra,
        },
        "energy": parts.total(),
        "energy_parts": parts.iter().collect::<BTreeMap<_, _>>(),
        "gradient": rows,
    });
    if let Some(tangent) = tangent {
        result["tangent"] = entries(case, &tangent);
    }
    Ok(Some(result))
}

/// The tangent's entries in the user's order of points, both triangles.
fn entries(case: &Case, tangent: &BlockMatrix) -> Value {
    let d = case.body.dimension();
    let user = |dof: usize| d * case.body.user_index()[dof / d] as usize + dof % d;
    let mut entries: Vec<(usize, usize, f64)> =
        tangent.entries().map(|(row, column, value)| (user(row), user(column), value)).collect();
    entries.sort_unstable_by_key(|entry| (entry.0, entry.1));
    json!({
        "rows": entries.iter().map(|e| e.0).collect::<Vec<_>>(),
        "cols": entries.iter().map(|e| e.1).collect::<Vec<_>>(),
        "values": entries.iter().map(|e| e.2).collect::<Vec<_>>(),
    })
}

fn human(result: &Value) -> String {
    let interactions = &result["interactions"];
    let parts = result["energy_parts"].as_object().into_iter().flatten();
    let parts: Vec<String> = parts.map(|(name, value)| format!("{value} in {name}")).collect();
    format!(
        "{} points in {} dimensions; {} bonds, {} triangles, {} tetrahedra\n\
         energy {} J: {}\n",
        result["points"],
        result["dimension"],
        interactions["bonds"],
        interactions["triangles"],
        interactions["tetrahedra"],
        result["energy"],
        parts.join(", ")
    )
}
