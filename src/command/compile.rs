//! `piola compile`: a potential as C, or as an object of the machine's C compiler, with a header.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use piola_compiler::Values;
use piola_runtime::output::atomic::write_atomically;

use super::{Exit, derive};
use crate::cli::{Compile, Derive, Emit, Level, Product};
use crate::console;
use crate::potential::{self, Loaded};
use crate::render;

/// Without contraction of a*b + c results are those of the strict kernels.
const FLAGS: [&str; 4] = ["-std=c99", "-O2", "-ffp-contract=off", "-c"];

pub(super) fn execute(arguments: &Compile) -> Exit {
    let Some(loaded) = potential::load(&arguments.file) else { return Exit::Input };
    let largest = loaded.model.dimensions().max().unwrap_or(3);
    let dimension = arguments.dim.map_or(largest, usize::from);
    let Some(settings) = potential::settings(&arguments.inputs) else { return Exit::Input };
    let delta = arguments.inputs.delta;
    let Some(values) = potential::values(&loaded.model, dimension, &settings, delta) else {
        return Exit::Input;
    };
    let printed = Derive {
        file: arguments.file.clone(),
        emit: Emit::C,
        dim: arguments.dim,
        inputs: arguments.inputs.clone(),
        level: Level::Strict,
        explain: false,
    };
    let source = match derive::text(&loaded, dimension, &printed) {
        Ok(source) => source,
        Err(exit) => return exit,
    };
    if !source.contains("\nvoid ") {
        let help = "give parameters that leave something of it";
        render::error("the parameters leave no energy of this potential", Some(help));
        return Exit::Input;
    }
    match write(arguments, &loaded, &values, &source) {
        Ok(files) => {
            let names: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
            console::tell(&names.join(", "));
            Exit::Done
        }
        Err(message) => {
            render::error(&message, None);
            Exit::Input
        }
    }
}

/// Writes the files; which they are, or why not.
fn write(
    arguments: &Compile,
    loaded: &Loaded,
    values: &Values,
    source: &str,
) -> Result<Vec<PathBuf>, String> {
    let name = loaded.model.name();
    let folder = &arguments.out;
    std::fs::create_dir_all(folder)
        .map_err(|error| format!("cannot create `{}`: {error}", folder.display()))?;
    let file = |ending: &str| folder.join(format!("{name}.{ending}"));
    let (header, code, object) = (file("h"), file("c"), file("o"));
    let made = match arguments.emit {
        Product::C => vec![code.clone(), header.clone()],
        Product::Obj => vec![object.clone(), header.clone()],
    };
    if let Some(there) = made.iter().find(|path| path.exists() && !arguments.force) {
        return Err(format!(
            "`{}` exists: name another folder, or replace it with --force",
            there.display()
        ));
    }
    let put = |path: &Path, text: &[u8]| {
        write_atomically(path, |file| file.write_all(text)).map_err(|error| error.to_string())
    };
    let source = format!("#include \"{name}.h\"\n{source}");
    let declarations = c_header(loaded, values, &source);
    match arguments.emit {
        Product::C => put(&code, source.as_bytes())?,
        Product::Obj => put(&object, &compiled(name, &source, &declarations)?)?,
    }
    put(&header, declarations.as_bytes())?;
    Ok(made)
}

/// An object file, by the compiler that `CC` names, or `cc`.
fn compiled(name: &str, source: &str, header: &str) -> Result<Vec<u8>, String> {
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_string());
    let folder = std::env::temp_dir().join(format!("piola-compile-{}", std::process::id()));
    let failed =
        |error: std::io::Error| format!("cannot compile in `{}`: {error}", folder.display());
    // One that is there already is someone else's.
    std::fs::create_dir(&folder).map_err(failed)?;
    let (code, object) = (folder.join(format!("{name}.c")), folder.join(format!("{name}.o")));
    let work = || -> Result<Vec<u8>, String> {
        std::fs::write(&code, source).map_err(failed)?;
        std::fs::write(folder.join(format!("{name}.h")), header).map_err(failed)?;
        let mut words = compiler.split_whitespace();
        let mut command = Command::new(words.next().unwrap_or("cc"));
        let made = command.args(words).args(FLAGS).arg(&code).arg("-o").arg(&object).output();
        let made = made.map_err(|error| {
            format!("cannot start the C compiler `{compiler}`: {error}; install one, name it in CC, or take --emit c")
        })?;
        if !made.status.success() {
            let said = String::from_utf8_lossy(&made.stderr).into_owned();
            return Err(format!("`{compiler}` refused the C of `{name}`: {said}"));
        }
        std::fs::read(&object).map_err(failed)
    };
    let bytes = work();
    let _ = std::fs::remove_dir_all(&folder);
    bytes
}

/// Declarations of the functions of a C source, with the comments before them and the values that they hold.
fn c_header(loaded: &Loaded, values: &Values, source: &str) -> String {
    let model = &loaded.model;
    let guard = format!("PIOLA_{}_H", model.name().to_uppercase());
    let mut out = format!(
        "/* {}: energies and their derivatives over arrays, made by piola {} for {} dimensions.\n",
        model.name(),
        env!("CARGO_PKG_VERSION"),
        values.dimension
    );
    out += " *\n * measure: lengths in m, twice areas of triangles in m^2, six times volumes of tetrahedra in m^3;\n\
            \x20* reference: what they are at rest; change: (measure - reference)/reference, from displacements where\n\
            \x20* digits near rest count; gradient, change: deformation gradients F and F - I, component after component\n\
            \x20* of n places, row by row. Arrays have n elements each and do not overlap. Parameters have the values below,\n\
            \x20* in SI units.\n";
    if loaded.model.has_gathered_energy() {
        out += " * integrand_1 times the volumes of neighbours is summed up over the family of a point, which gives I1, and so\n\
                \x20* on; variables and given: as the comment at the function says, number after number of n places.\n";
    }
    out += " */\n";
    let _ = writeln!(out, "#ifndef {guard}\n#define {guard}\n\n#include <stddef.h>\n");
    let name = model.name().to_uppercase();
    let _ = writeln!(out, "#define {name}_DIMENSION {}", values.dimension);
    for (parameter, value) in model.parameters().iter().zip(&values.parameters) {
        if parameter.is_state
            || parameter.name == "DIMENSION"
            || !parameter.name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        {
            continue;
        }
        let unit = parameter.unit.as_deref().unwrap_or("");
        let _ = writeln!(out, "#define {name}_{} {value:?} /* {unit} */", parameter.name);
    }
    out += "\n#ifdef __cplusplus\nextern \"C\" {\n#endif\n";
    let mut before = "";
    for function in source.split("\nvoid ") {
        if let Some((prototype, _)) = function.split_once(" {\n").filter(|_| !before.is_empty()) {
            let comment = before.ends_with("*/").then(|| before.rfind("/*")).flatten();
            let comment = comment.map_or(String::new(), |at| format!("{}\n", &before[at..]));
            let _ = write!(out, "\n{comment}void {prototype};\n");
        }
        before = function;
    }
    out += "\n#ifdef __cplusplus\n}\n#endif\n\n#endif\n";
    out
}
