//! `piola bench`: what an energy or a scene costs on this machine.

use std::fmt::Write as _;
use std::path::Path;

use piola_compiler::audit::{Audit, Settings, audit};
use piola_compiler::{Argument, Form, Level, Measure, Mode, Values};
use piola_runtime::case::Case;
use piola_runtime::element::cost::{self, CostError, EnergyCost, SeveralCost, WayCost};
use piola_runtime::output::summary::PhaseClock;
use piola_runtime::simulation::{self, MotionCost, SceneCost};
use serde_json::{Value, json};

use super::audit::units;
use super::derive::print_compile_error;
use super::{Exit, machine, scene};
use crate::cli::{Bench, Format};
use crate::console;
use crate::potential::{self, Loaded};
use crate::render;

/// What is timed if nothing is named: the family whose exponent decides what an energy costs.
const DEFAULT: &str = "firooz2023";

/// Errors are measured at so many points per regime.
const fn settings(level: Level) -> Settings {
    Settings { form: Form::Accurate, level, points: 4, bar: 64.0 }
}

/// The audits of each accuracy level; of what is no energy of one argument none.
type Audits = Vec<(Level, Vec<Audit>)>;

pub(super) fn execute(arguments: &Bench) -> Exit {
    let subject = arguments.subject.as_deref().unwrap_or(DEFAULT);
    let exit = scene::with_threads(arguments.threads, || {
        if subject.ends_with(".toml") {
            of_scene(Path::new(subject), arguments)
        } else {
            of_potential(subject, arguments)
        }
    });
    exit.unwrap_or(Exit::Input)
}

fn of_potential(name: &str, arguments: &Bench) -> Exit {
    let Some(loaded) = potential::load(name) else { return Exit::Input };
    let model = &loaded.model;
    let values = potential::every_energy(model, arguments.dim, &arguments.inputs, "timed");
    let Some(values) = values else { return Exit::Input };
    let costs = match cost::cost(model, &values) {
        Ok(costs) => costs,
        Err(CostError::Compile(error)) => {
            print_compile_error(&loaded, &error);
            return Exit::Input;
        }
        Err(error) => {
            render::error(&error.to_string(), None);
            return Exit::Input;
        }
    };
    let mut audits = Audits::new();
    for level in Level::ALL {
        match audit(model, &values, &settings(level)) {
            Ok((of_level, dropped)) => {
                if audits.is_empty() {
                    dropped.iter().for_each(|dropped| console::note(&dropped.reason));
                }
                audits.push((level, of_level));
            }
            Err(error) => {
                print_compile_error(&loaded, &error);
                return Exit::Input;
            }
        }
    }
    console::out(&match arguments.format {
        Format::Human => potential_text(&loaded, &values, &costs, &audits),
        Format::Json => format!("{}\n", potential_json(&loaded, &values, &costs, &audits)),
    });
    Exit::Done
}

/// Largest errors of what was timed, in units of 2^-53, for the levels of compiled code, what is left of
/// them where rounded inputs excuse those above 64: an energy that runs as a function of the squared measure is timed as one.
fn errors(cost: &WayCost, energy: &EnergyCost, audits: &Audits) -> Option<[f64; 3]> {
    let Mode::Jit(level) = cost.way.mode else { return None };
    let (_, audits) = audits.iter().find(|(audited, _)| *audited == level)?;
    let find = |argument| audits.iter().find(|audit| audit.argument == Some(argument));
    let of_square = match energy.argument {
        Argument::Measure(measure) => find(Argument::Square(measure)),
        _ => None,
    };
    Some(of_square.or_else(|| find(energy.argument))?.worst())
}

fn potential_text(loaded: &Loaded, values: &Values, costs: &[WayCost], audits: &Audits) -> String {
    let dimension = values.dimension;
    let titles = costs.iter().flat_map(|cost| cost.several.iter().map(|one| one.title.len()));
    let width = titles.fold(8, usize::max);
    let mut out = format!(
        "{} in {dimension} dimensions: ns per interaction on one thread, least of several runs\n\n\
         {:24} {:width$} {:>10} {:>10} {:>10}   largest errors of psi, psi', psi'' in u\n",
        loaded.name, "way", "energy", "energy", "gradient", "tangent"
    );
    for cost in costs {
        for energy in &cost.energies {
            let psi = format!("psi({})", energy.argument.symbol());
            let _ = write!(out, "{:24} {psi:width$}", cost.way.name);
            for nanoseconds in energy.nanoseconds {
                let _ = write!(out, " {nanoseconds:>10.1}");
            }
            if let Some(errors) = errors(cost, energy, audits) {
                let _ = write!(out, "   {}", errors.map(units).join(", "));
            }
            out.push('\n');
        }
        for one in &cost.several {
            let _ = write!(out, "{:24} {:width$}", cost.way.name, one.title);
            for nanoseconds in one.nanoseconds {
                let _ = write!(out, " {nanoseconds:>10.1}");
            }
            out.push('\n');
        }
    }
    let _ = writeln!(out, "\n{:24} {:>10}", "compiling all energies", "ms");
    for cost in costs {
        let _ = writeln!(out, "{:24} {:>10.3}", cost.way.name, cost.compile_seconds * 1e3);
    }
    out.push_str(
        "\nu = 1.1e-16 of the value, beside its zeros of what rounding the inputs changes it by; \
         `piola audit` says where the largest errors are\n",
    );
    if loaded.model.has_gradient_energy() {
        out.push_str(
            "psi(F): ns per place a few percent from rest for psi, for psi and P, and for dP; errors of \
             these in u of the norm\n",
        );
    }
    if costs.iter().any(|cost| !cost.several.is_empty()) {
        out.push_str(
            "of several numbers: ns per triangle, bond or point for the value, with its gradient, and for the \
             product of\nsecond derivatives with a direction; integrands: all together, with first, with \
             second derivatives; errors: `piola audit`\n",
        );
    }
    for measure in Measure::ALL {
        if loaded.model.squared(values, measure).is_some() {
            let m = measure.symbol();
            let _ = writeln!(
                out,
                "psi({m}) is a function of {m}^2: symbolic derivatives need no root of it; times and \
                 errors are of that form"
            );
        }
    }
    out
}

fn potential_json(loaded: &Loaded, values: &Values, costs: &[WayCost], audits: &Audits) -> Value {
    let of_square = |argument: Argument| match argument {
        Argument::Measure(measure) => loaded.model.squared(values, measure).is_some(),
        _ => false,
    };
    let energy = |cost: &WayCost, energy: &EnergyCost| {
        let [only, gradient, second] = energy.nanoseconds;
        let third = if energy.argument == Argument::Gradient { "product" } else { "tangent" };
        let nanoseconds = json!({ "energy": only, "gradient": gradient, third: second });
        json!({
            "measure": energy.argument.symbol(),
            "of_square": of_square(energy.argument),
            "nanoseconds": nanoseconds,
            // JSON has no infinity: an error without end is null.
            "errors": errors(cost, energy, audits)
                .map(|errors| errors.map(|x| if x.is_finite() { json!(x) } else { Value::Null })),
        })
    };
    let several = |one: &SeveralCost| {
        let [value, gradient, product] = one.nanoseconds;
        json!({
            "function": one.title,
            "variables": one.n_variables,
            "nanoseconds": { "energy": value, "gradient": gradient, "product": product },
        })
    };
    let way = |cost: &WayCost| {
        json!({
            "way": cost.way.name,
            "compile_seconds": cost.compile_seconds,
            "energies": cost.energies.iter().map(|e| energy(cost, e)).collect::<Vec<_>>(),
            "several": cost.several.iter().map(several).collect::<Vec<_>>(),
        })
    };
    json!({
        "potential": loaded.name,
        "dimension": values.dimension,
        "ways": costs.iter().map(way).collect::<Vec<_>>(),
    })
}

fn of_scene(path: &Path, arguments: &Bench) -> Exit {
    if arguments.dim.is_some() || arguments.inputs.delta.is_some() {
        render::error("--dim and --delta are for potentials: a scene has its own", None);
        return Exit::Input;
    }
    let mut clock = PhaseClock::new();
    clock.enter("read");
    let Some(case) = scene::read(path, &arguments.inputs.settings) else { return Exit::Input };
    clock.leave();
    match measure(&case, clock) {
        Ok(cost) => {
            console::out(&match arguments.format {
                Format::Human => scene_text(path, &cost),
                Format::Json => format!("{}\n", json!(cost)),
            });
            Exit::Done
        }
        Err(exit) => exit,
    }
}

/// Refuses what the memory does not hold, as `piola run` does; prints what is wrong.
fn measure(case: &Case, clock: PhaseClock) -> Result<SceneCost, Exit> {
    let print = |error| {
        scene::print_error(&error);
        Exit::Input
    };
    // Bodies that can move are measured all the same; what else is wrong is told below.
    let plan = case.plan(rayon::current_num_threads()).ok();
    if let Some(refusal) = plan.and_then(|plan| plan.refusal()) {
        render::error(&refusal, Some("make the body smaller"));
        return Err(Exit::Input);
    }
    let warnings = scene::warnings(case).map_err(print)?;
    scene::print_warnings(case, warnings);
    let rates = || machine::at_hand().rates(rayon::current_num_threads());
    simulation::cost(case, clock, rates).map_err(print)
}

fn scene_text(path: &Path, cost: &SceneCost) -> String {
    let mb = |bytes: Option<u64>| match bytes {
        Some(bytes) => format!("{:.1}", bytes as f64 * 1e-6),
        None => "-".to_string(),
    };
    let [bonds, triangles, tetrahedra] = cost.interactions;
    let mut out = format!(
        "{}: {} points, {} unknowns; {bonds} bonds, {triangles} triangles, {tetrahedra} tetrahedra; \
         threads: {}\n\n{:26} {:>12} {:>12} {:>12}\n",
        path.display(),
        cost.points,
        cost.unknowns,
        cost.threads,
        "phase",
        "ms",
        "MB after",
        "MB at most"
    );
    for phase in &cost.phases {
        let _ = writeln!(
            out,
            "{:26} {:>12.3} {:>12} {:>12}",
            phase.name,
            phase.wall_seconds.0 * 1e3,
            mb(phase.memory_bytes),
            mb(phase.peak_memory_bytes)
        );
    }
    out.push_str(&passes_text(cost));
    out.push('\n');
    if let Some(motion) = &cost.motion {
        out.push_str(&motion_text(motion));
    } else {
        let _ = writeln!(out, "{:26} {:>12} MB", "matrix", mb(Some(cost.matrix_bytes)));
    }
    if let Some(factor) = cost.linear.as_ref().and_then(|linear| linear.factor_bytes) {
        let _ = writeln!(out, "{:26} {:>12} MB", "factor", mb(Some(factor)));
    }
    let _ = writeln!(out, "{:26} {:>12} MB\n", "peak", mb(cost.peak_memory_bytes));
    if let Some(linear) = &cost.linear {
        let _ = writeln!(
            out,
            "linear system by {}, {} iterations, relative residual {:.1e}",
            linear.method, linear.iterations, linear.relative_residual
        );
        linear.notes.iter().for_each(|note| out.push_str(&format!("note: {note}\n")));
    }
    cost.notes.iter().for_each(|note| out.push_str(&format!("note: {note}\n")));
    out
}

fn motion_text(motion: &MotionCost) -> String {
    let critical = match motion.critical_step_seconds {
        Some(seconds) => format!("{seconds:.4e} s"),
        None => "none".to_string(),
    };
    let together = match motion.wall_seconds {
        Some(seconds) => format!("about {seconds:.3} s"),
        None => "too few to be timed".to_string(),
    };
    format!(
        "{}: {} steps of {:.4e} s, the critical one is {critical}; together {together}\n\n",
        motion.method, motion.steps, motion.step_seconds
    )
}

fn passes_text(cost: &SceneCost) -> String {
    let mut out = format!(
        "\n{:26} {:>12} {:>18} {:>12} {:>12}\n",
        "one pass", "ms", "ns per interaction", "% of memory", "% of sums"
    );
    for pass in &cost.passes {
        let _ = writeln!(
            out,
            "{:26} {:>12.3} {:>18.1} {:>12.1} {:>12.1}",
            pass.name.name(),
            pass.seconds * 1e3,
            pass.nanoseconds_per_interaction,
            pass.share_of_bandwidth * 1e2,
            pass.share_of_arithmetic * 1e2
        );
    }
    let _ = writeln!(
        out,
        "by {}; at least, of {:.1} GB/s and {:.1}e9 multiply-adds per s (`piola info --machine`)",
        cost.ways.join(" and "),
        cost.rates.bandwidth * 1e-9,
        cost.rates.arithmetic * 1e-9
    );
    out
}
