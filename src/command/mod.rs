//! The commands, one file each.

mod audit;
mod bench;
mod calibrate;
mod check;
mod compile;
mod completions;
mod derive;
mod energy;
mod eval;
mod eval_gradient;
mod eval_several;
mod explain;
mod explain_bond;
mod fmt;
mod info;
mod machine;
mod moduli;
mod new;
mod picture;
mod plan;
#[cfg(feature = "petsc")]
mod ranks;
mod report;
mod run;
mod scene;
mod schema;
mod sweep;
mod trade;
mod verify;
mod watch;

use crate::cli::Command;

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exit {
    /// Done, also with warnings.
    Done = 0,
    /// A check, verification or evaluation found failures.
    Findings = 1,
    /// Wrong usage or input.
    Input = 2,
    /// The solver did not converge.
    NotConverged = 3,
    /// SIGINT ended the run; what had converged is written.
    Interrupted = 130,
    /// SIGTERM did.
    Terminated = 143,
}

/// Executes a command.
pub(crate) fn execute(command: Command) -> Exit {
    match command {
        Command::Check(arguments) => check::execute(&arguments),
        Command::Derive(arguments) => derive::execute(&arguments),
        Command::Report(arguments) => report::execute(&arguments),
        Command::Picture(arguments) => picture::execute(&arguments),
        Command::Watch(arguments) => watch::execute(&arguments),
        Command::New(arguments) => new::execute(&arguments),
        Command::Fmt(arguments) => fmt::execute(&arguments),
        Command::Lsp => crate::lsp::execute(),
        Command::Compile(arguments) => compile::execute(&arguments),
        Command::Audit(arguments) => audit::execute(&arguments),
        Command::Verify(arguments) => verify::execute(&arguments),
        Command::Eval(arguments) => eval::execute(&arguments),
        Command::Energy(arguments) => energy::execute(&arguments),
        Command::Run(arguments) => run::execute(&arguments),
        Command::Plan(arguments) => plan::execute(&arguments),
        Command::Bench(arguments) => bench::execute(&arguments),
        Command::Trade(arguments) => trade::execute(&arguments),
        Command::Sweep(arguments) => sweep::execute(&arguments),
        Command::Moduli(arguments) => moduli::execute(&arguments),
        Command::Calibrate(arguments) => calibrate::execute(&arguments),
        Command::Info(arguments) => info::execute(&arguments),
        Command::Explain(arguments) => explain::execute(&arguments),
        Command::ExplainBond(arguments) => explain_bond::execute(&arguments),
        Command::Schema { subject } => schema::execute(subject),
        Command::Completions { shell } => completions::execute(shell),
    }
}
