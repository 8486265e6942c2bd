//! A plan for people: aligned columns, units that fit.

use std::fmt;

use piola_grammar::counted;
use piola_solvers::linear::LinearMethod;

use super::{Basis, Plan, RanksPlan};

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = |f: &mut fmt::Formatter<'_>, name: &str, n: u64| {
            writeln!(f, "  {name:<28}{:>14}", grouped(n))
        };
        let estimated = if self.interactions.exact { "" } else { " (estimated)" };
        writeln!(f, "model, {} dimensions", self.dimension)?;
        count(f, "points", self.points as u64)?;
        count(f, "unknowns", self.unknowns as u64)?;
        let bonds = if self.interactions.bonds_exact { "bonds" } else { "bonds (estimated)" };
        count(f, bonds, self.interactions.bonds)?;
        count(f, &format!("triangles{estimated}"), self.interactions.triangles)?;
        count(f, &format!("tetrahedra{estimated}"), self.interactions.tetrahedra)?;
        if !self.kernels.is_empty() {
            writeln!(f, "energies")?;
        }
        for kernel in &self.kernels {
            let fate = if kernel.modelled { "modelled" } else { "dropped" };
            let line = format!("  {:<28}{fate:>14}   {}", kernel.energy, kernel.reason);
            writeln!(f, "{}", line.trim_end())?;
        }
        writeln!(f, "memory beside the 25 MB of the program, within a factor of 1.5")?;
        for item in &self.memory {
            writeln!(f, "  {:<28}{:>14}", item.item, bytes(item.bytes))?;
        }
        writeln!(f, "  {:<28}{:>14}", "together", bytes(self.memory_total))?;
        if let (Some(stored), false) = (&self.stored, self.goes_over()) {
            let total = bytes(stored.memory_total);
            writeln!(f, "  {:<28}{total:>14}   where one takes over", "with a stored tangent")?;
        }
        let available = self.available_memory.map_or("unknown".into(), bytes);
        writeln!(f, "  {:<28}{available:>14}", "available")?;
        if let Some(ranks) = &self.ranks {
            let program = super::ranks::PROGRAM;
            let each = counted(ranks.ranks, "rank");
            writeln!(f, "each of {each}, beside the {program} of the program with PETSc")?;
            of_ranks(f, ranks, self.motion.is_some())?;
        }
        let threads =
            if self.threads == 1 { "1 thread" } else { &format!("{} threads", self.threads) };
        if let Some(motion) = &self.motion {
            writeln!(f, "time on {threads}, estimated, within a factor of 3")?;
            writeln!(f, "  {:<28}{:>14}", "setup", seconds(self.time.setup))?;
            writeln!(f, "  {:<28}{:>14}   per step, at most", "forces", seconds(motion.pass))?;
            if let (Some(steps), Some(total)) = (motion.steps, motion.total) {
                let steps = format!("run of {steps} steps");
                writeln!(f, "  {steps:<28}{:>14}   at most", seconds(total))?;
            }
            writeln!(f, "what this plan does not know, or takes for granted:")?;
            let step = "the critical step, which is found when a run begins: a scene without `step` takes \
                        as many steps as that asks for";
            let notes = self.notes.iter().cloned().chain([step.to_string()]);
            return notes
                .flat_map(|note| wrapped(&note))
                .try_for_each(|line| writeln!(f, "  {line}"));
        }
        let basis = match self.time.basis {
            Basis::Estimate => "estimated, within a factor of 3",
            Basis::Iterations => "from the first iterations, a third of it or more",
            Basis::Increment => "from the first increment, within a factor of 3",
        };
        writeln!(f, "time on {threads}, {basis}")?;
        let (short, name) = match self.linear.method {
            LinearMethod::Cholesky => ("Cholesky", "Cholesky"),
            LinearMethod::Lu => ("LU", "LU"),
            LinearMethod::Gmres => ("GMRES", "GMRES"),
            _ => ("CG", "conjugate gradients"),
        };
        let (method, without) = match self.linear.stores_matrix {
            true => (format!("linear system, {short}"), ""),
            false if self.goes_over() => ("linear system, Cholesky".to_string(), BEGINS),
            false => ("linear system (matrix-free)".to_string(), " without a stored tangent"),
        };
        writeln!(f, "  {:<28}{:>14}", "setup", seconds(self.time.setup))?;
        writeln!(f, "  {:<28}{:>14}   per iteration", "assembly", seconds(self.time.assembly))?;
        writeln!(f, "  {method:<28}{:>14}   per iteration", seconds(self.time.linear))?;
        writeln!(f, "  {:<28}{:>14}", "increment", seconds(self.time.increment))?;
        match &self.events {
            Some(events) => {
                writeln!(f, "  {:<28}{:>14}", "event", seconds(events.each))?;
                let total = format!("run of {} events", grouped(events.most as u64));
                writeln!(f, "  {total:<28}{:>14}   at most", seconds(events.total))?;
            }
            None => {
                let total = format!("run of {} increments", self.increments);
                writeln!(f, "  {total:<28}{:>14}", seconds(self.time.total))?;
            }
        }
        writeln!(f, "linear systems by {name}{without}:")?;
        let reason = format!("{}{}", self.linear.reason, self.takes_over());
        wrapped(&reason).iter().try_for_each(|line| writeln!(f, "  {line}"))?;
        writeln!(f, "what this plan does not know, or takes for granted:")?;
        let notes = self.notes.iter().cloned().chain(self.event_note()).chain([self.time_note()]);
        notes.flat_map(|note| wrapped(&note)).try_for_each(|line| writeln!(f, "  {line}"))
    }
}

/// What the largest of many processes takes.
fn of_ranks(f: &mut fmt::Formatter<'_>, plan: &RanksPlan, moves: bool) -> fmt::Result {
    let mut line = |name: &str, value: String, rest: &str| {
        writeln!(f, "{}", format!("  {name:<28}{value:>14}   {rest}").trim_end())
    };
    line("own points", grouped(plan.own as u64), "of each")?;
    line("halo", grouped(plan.halo as u64), "points of others")?;
    for item in &plan.memory {
        line(item.item, bytes(item.bytes), "")?;
    }
    line("together", bytes(plan.memory_total), "")?;
    let when = if moves { "a step" } else { "an evaluation" };
    let from = match plan.messages {
        1 => format!("{when}, from 1 other"),
        n => format!("{when}, from {n} others"),
    };
    if plan.messages > 0 {
        line("received", bytes(plan.received), &from)?;
    }
    if plan.ranks > plan.room {
        let text = format!("more than {} own less than they hold of others", plan.room);
        line("room", grouped(plan.room as u64), &text)?;
    }
    Ok(())
}

/// A method that is not the last.
const BEGINS: &str = ", then by Cholesky with a stored tangent";

impl Plan {
    /// Whether the first increment went over to a stored tangent.
    fn goes_over(&self) -> bool {
        self.first.as_ref().is_some_and(|first| first.stored.is_some())
    }

    /// When and why a stored tangent takes over, as the rest of a sentence; empty where none may.
    fn takes_over(&self) -> String {
        let seen = self.first.as_ref().and_then(|first| first.stored.as_ref());
        match (seen, &self.stored) {
            (Some(change), _) => {
                format!("; in the first increment a stored one takes over: {}", change.reason)
            }
            (None, Some(stored)) => format!(
                "; a stored one and Cholesky take over for the rest of the run where a system takes more than \
                 {} products, or its tangent is indefinite",
                stored.products
            ),
            (None, None) => String::new(),
        }
    }

    /// What is not known of events, in a sentence without its full stop.
    fn event_note(&self) -> Option<String> {
        let most = grouped(self.events?.most as u64);
        Some(format!(
            "the number of events: each breaks a bond, a triangle or a tetrahedron, and those that come to \
             their thresholds with it; the run ends after {most}, the `events` of [steps], or before"
        ))
    }

    /// What the time rests on, in a sentence without its full stop.
    fn time_note(&self) -> String {
        let Some(first) = &self.first else {
            let reason = if self.of_families && !self.linear.stores_matrix {
                "; linear systems of families take 30 to 1000 products, and 35 to 65 are taken"
            } else {
                ""
            };
            return format!("5 Newton iterations per increment, without line searches{reason}");
        };
        let iterations = number_of(first.iterations, "Newton iteration");
        let mut seen = vec![iterations];
        if first.products > 0 {
            seen.push(number_of(first.products, "product with the tangent"));
        }
        if first.cut_backs > 0 {
            seen.push(number_of(first.cut_backs, "cut-back"));
        }
        let seen = seen.join(", ");
        match (&first.failure, self.time.basis) {
            (Some(failure), _) => format!("the first increment fails after {seen}: {failure}"),
            (None, Basis::Increment) if first.solved < 1.0 => format!(
                "{:.3} of the first increment took {seen}; the rest is taken to be like that",
                first.solved
            ),
            (None, Basis::Increment) => format!(
                "the first increment took {seen}; further ones are taken to be like it, and may be \
                 harder"
            ),
            _ => format!("the first increment was not solved after {seen}"),
        }
    }
}

/// `1 cut-back`, `3 cut-backs`, `products with the tangent`
fn number_of(n: usize, what: &str) -> String {
    match what.split_once(' ') {
        _ if n == 1 => format!("1 {what}"),
        Some(("product", rest)) => format!("{n} products {rest}"),
        _ => format!("{n} {what}s"),
    }
}

/// Lines of at most 76 characters.
fn wrapped(text: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.len() + 1 + word.len() <= 76 => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_string()),
        }
    }
    lines
}

/// `1 234 567`
fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(digit);
    }
    out
}

/// Bytes with a decimal prefix: `512 B`, `3.2 MB`.
pub(crate) fn bytes(bytes: u64) -> String {
    let units = ["kB", "MB", "GB", "TB", "PB"];
    let mut value = bytes as f64;
    let mut unit = "B";
    for larger in units {
        if value < 999.5 {
            break;
        }
        value /= 1000.0;
        unit = larger;
    }
    if unit == "B" || value >= 99.5 {
        format!("{value:.0} {unit}")
    } else {
        format!("{value:.1} {unit}")
    }
}

/// A duration with a unit that fits: `12 ms`, `3.4 s`, `2.5 min`, `7.1 h`, `3.0 days`.
fn seconds(seconds: f64) -> String {
    match seconds {
        s if s < 1.0 => format!("{:.1} ms", s * 1e3),
        s if s < 120.0 => format!("{s:.1} s"),
        s if s < 7200.0 => format!("{:.1} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.1} h", s / 3600.0),
        s => format!("{:.1} days", s / 86_400.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_fit() {
        assert_eq!(bytes(512), "512 B");
        assert_eq!(bytes(999_600), "1.0 MB");
        assert_eq!(bytes(3_200_000), "3.2 MB");
        assert_eq!(bytes(123_456_789_012), "123 GB");
        assert_eq!(grouped(1_234_567), "1 234 567");
        assert_eq!(grouped(123), "123");
        assert_eq!(seconds(0.0123), "12.3 ms");
        assert_eq!(seconds(150.0), "2.5 min");
        assert_eq!(seconds(5e5), "5.8 days");
    }
}
