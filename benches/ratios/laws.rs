//! Energies of textbooks and papers as the program runs them: what they cost against what was written, and
//! how long they take to compile.

use std::hint::black_box;
use std::path::{Path, PathBuf};

use piola_compiler::{
    Batch, Derivatives, Form, Kernel, Level, Mode, Model, Order, Setting, Values, check_text,
};

use crate::clock::{Clock, in_turn};
use crate::record::{Cell, Table};

/// Interactions per run, as many as stay in the first-level cache with their results.
const BATCH: usize = 512;
const ROUNDS: usize = 101;
/// Compilations of a law, the first of which is not counted.
const COMPILATIONS: usize = 15;
/// Strains of the interactions reach this to both sides of rest.
const STRAIN: f64 = 0.2;

/// What a kernel may take to compile, in ms: of the library, and of the collection.
const ALLOWED: [f64; 2] = [5.0, 20.0];

const KINDS: [(&str, &str); 4] = [
    ("library", "potentials"),
    ("bonds", "compiler/tests/laws/bonds"),
    ("areas", "compiler/tests/laws/areas"),
    ("volumes", "compiler/tests/laws/volumes"),
];

/// Functions that the words of a law may hold, as the rows of the table by functions name them.
const FUNCTIONS: [(&str, &[&str]); 4] = [
    ("powers and quotients alone", &[]),
    ("roots", &["sqrt("]),
    ("exponentials and logarithms", &["exp(", "ln(", "log1p(", "expm1("]),
    ("other functions", &["sin(", "cos(", "tan(", "sinh(", "cosh(", "tanh("]),
];

struct Law {
    name: String,
    kind: &'static str,
    functions: &'static str,
    model: Model,
    values: Values,
}

/// What was measured of a law: ns of an interaction as written and as run, ms to compile a kernel.
struct Measured {
    law: Law,
    textbook: f64,
    accurate: f64,
    compile: f64,
}

pub(crate) fn run() -> Vec<Table> {
    let all: Vec<Measured> = laws().into_iter().map(measured).collect();
    vec![costs(&all), compilations(&all)]
}

fn laws() -> Vec<Law> {
    let mut laws = Vec::new();
    for (kind, folder) in KINDS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
        let entries = std::fs::read_dir(folder).expect("the folder is there");
        let mut paths: Vec<PathBuf> = entries.map(|e| e.expect("it is listed").path()).collect();
        paths.retain(|path| path.extension().is_some_and(|e| e == "piola"));
        paths.sort();
        for path in paths {
            let text = std::fs::read_to_string(&path).expect("it is text");
            let (_, model) = check_text(&text).expect("it is a potential");
            if model.measures().is_empty() {
                continue;
            }
            let name = path.file_stem().expect("a file").to_string_lossy().into_owned();
            for (name, values) in values(&name, &model) {
                laws.push(Law {
                    name,
                    kind,
                    functions: functions(&text),
                    model: model.clone(),
                    values,
                });
            }
        }
    }
    laws
}

/// Defaults, 1 for want of one; of the library's Seth-Hill energies some exponents.
fn values(name: &str, model: &Model) -> Vec<(String, Values)> {
    let dimension = model.dimensions().last().expect("one at least");
    let with = |name: String, mut settings: Vec<(String, Setting)>| {
        model.fill_with_one(dimension, &mut settings);
        (name, model.values(dimension, &settings, Some(6.0)).expect("values of the potential"))
    };
    if name != "firooz2023" {
        return vec![with(name.into(), Vec::new())];
    }
    let exponents = [-2.0, -0.5, 0.0, 0.5, 1.0, 2.0, 2.7, 4.0, 30.0];
    let of = |n: &f64| with(format!("{name}, n = {n}"), vec![("n".into(), Setting::Number(*n))]);
    exponents.iter().map(of).collect()
}

/// The last kind of function that stands in a law.
fn functions(text: &str) -> &'static str {
    let is_there = |words: &&(&str, &[&str])| {
        words.1.is_empty() || words.1.iter().any(|word| text.contains(word))
    };
    FUNCTIONS.iter().rfind(is_there).expect("the first is always there").0
}

fn measured(law: Law) -> Measured {
    let compiled = |form| -> Vec<Kernel> {
        let mode = Mode::Jit(Level::default());
        law.model.compile(&law.values, mode, form).expect("it compiles").kernels
    };
    let (textbook, accurate) = (compiled(Form::Textbook), compiled(Form::Accurate));
    let n_kernels = accurate.len() as f64;
    let [compile] =
        in_turn(COMPILATIONS, Clock::Wall, [&mut || drop(black_box(compiled(Form::Accurate)))]);
    let [textbook, accurate] = times([&textbook, &accurate]).map(|ns| ns / n_kernels);
    Measured { law, textbook, accurate, compile: compile.least() * 1e3 / n_kernels }
}

/// Least time of an interaction in ns with psi, psi' and psi'', for each set of kernels.
fn times(sets: [&[Kernel]; 2]) -> [f64; 2] {
    let at = |k: usize| (k as f64 + 0.5) / BATCH as f64;
    let change: Vec<f64> = (0..BATCH).map(|k| STRAIN * (2.0 * at(k) - 1.0)).collect();
    let reference: Vec<f64> = (0..BATCH).map(|k| 0.5 + at(k)).collect();
    let measure: Vec<f64> = change.iter().zip(&reference).map(|(e, l)| l * (1.0 + e)).collect();
    let batch = Batch { measure: &measure, reference: &reference, change: &change, fields: &[] };
    let mut outs = [Derivatives::zeros(BATCH), Derivatives::zeros(BATCH)];
    let [first, second] = &mut outs;
    let evaluate = |kernels: &[Kernel], out: &mut Derivatives| {
        for kernel in kernels {
            kernel.evaluate(black_box(batch), Order::Tangent, out.outputs());
            black_box(&out);
        }
    };
    let times = in_turn(
        ROUNDS,
        Clock::Wall,
        [&mut || evaluate(sets[0], first), &mut || evaluate(sets[1], second)],
    );
    times.map(|times| times.least() * 1e9 / BATCH as f64)
}

/// What lies so far along numbers in order: 0.5 is the median.
fn quantile(mut numbers: Vec<f64>, q: f64) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[((numbers.len() - 1) as f64 * q).round() as usize]
}

fn costs(all: &[Measured]) -> Table {
    let mut table = Table::plain(
        "laws",
        format!(
            "Kernels of the library's energies of measures and of the collection's (`compiler/tests/laws`) with \
             their defaults, psi, psi' and psi'' at strains up to {STRAIN}: ns for an interaction, least of \
             {ROUNDS} runs in turn, in batches of {BATCH}. As written is what the textbook form takes."
        ),
        &[
            "laws",
            "how many",
            "as written, ns: median",
            "accurate, ns: median",
            "most",
            "accurate / as written: median",
            "90 %",
            "most",
        ],
    );
    let mut row = |name: &str, of: &dyn Fn(&&Measured) -> bool| {
        let some: Vec<&Measured> = all.iter().filter(of).collect();
        if some.is_empty() {
            return;
        }
        let list = |f: &dyn Fn(&Measured) -> f64| some.iter().map(|m| f(m)).collect::<Vec<_>>();
        let ratios = list(&|m| m.accurate / m.textbook);
        let cells: [Cell; 8] = [
            name.into(),
            some.len().to_string().into(),
            quantile(list(&|m| m.textbook), 0.5).into(),
            quantile(list(&|m| m.accurate), 0.5).into(),
            quantile(list(&|m| m.accurate), 1.0).into(),
            quantile(ratios.clone(), 0.5).into(),
            quantile(ratios.clone(), 0.9).into(),
            quantile(ratios, 1.0).into(),
        ];
        table.row(cells);
    };
    for (kind, _) in KINDS {
        row(kind, &|m| m.law.kind == kind);
    }
    for (functions, _) in FUNCTIONS {
        row(functions, &|m| m.law.functions == functions);
    }
    table
}

fn compilations(all: &[Measured]) -> Table {
    let mut table = Table::plain(
        "laws_compile",
        format!(
            "The same laws from the checked potential to machine code, ms for a kernel, least of {COMPILATIONS}; \
             allowed are {} ms for the library's and {} ms for the collection's.",
            ALLOWED[0], ALLOWED[1]
        ),
        &["laws", "median, ms", "90 %", "most", "above what is allowed"],
    );
    for (kind, _) in KINDS {
        let allowed = ALLOWED[usize::from(kind != "library")];
        let some: Vec<&Measured> = all.iter().filter(|m| m.law.kind == kind).collect();
        let times: Vec<f64> = some.iter().map(|m| m.compile).collect();
        let above: Vec<&str> =
            some.iter().filter(|m| m.compile > allowed).map(|m| m.law.name.as_str()).collect();
        let [median, most_of, most] = [0.5, 0.9, 1.0].map(|q| quantile(times.clone(), q));
        let above = if above.is_empty() { "none".into() } else { above.join("; ") };
        table.row([kind.into(), median.into(), most_of.into(), most.into(), above.as_str().into()]);
    }
    table
}
