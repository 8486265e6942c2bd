//! Random laws of bonds that cancel at rest: two nested functions with the same value there, and often
//! the same slope, subtracted; then squared, kinked, raised to a power, inside another function.
//!
//! No rule of the compiler knows these laws, and most nobody would write. They tell what holds for any law
//! from what holds for those that were thought of.

use piola_compiler::verify::sample::Random;
use piola_compiler::{Measure, Model, Values, check_text};

/// A law as text.
pub(crate) struct Nested {
    pub(crate) seed: u64,
    /// How the difference is used, as a function of `D`.
    pub(crate) outer: &'static str,
    pub(crate) text: String,
    pub(crate) model: Model,
    pub(crate) values: Values,
}

/// Numbers that stand in laws; most are no doubles.
const CONSTANTS: [&str; 9] = ["1/3", "2.5", "pi", "0.7", "1.5", "2", "3", "sqrt(2)", "1/7"];

/// Functions of the stretch with value 0 and slope 1 at rest; `p` is an exponent.
const STRAINS: [&str; 5] = ["l/L - 1", "l/L - 1", "ln(l/L)", "1 - L/l", "((l/L)^p - 1)/p"];

/// Functions of `z` with value 0 and slope 1 where `z` is 0; `c` is a positive constant.
const KEEP_ZERO: [&str; 18] = [
    "sin(z)",
    "sin(c*z)/c",
    "atan(z)",
    "tanh(z)",
    "tanh(c*z)/c",
    "sinh(z)",
    "sinh(c*z)/c",
    "exp(z) - 1",
    "(exp(c*z) - 1)/c",
    "ln(1 + z)",
    "c*ln(1 + z/c)",
    "sqrt(1 + 2*z) - 1",
    "((1 + z)^c - 1)/c",
    "z + z^2",
    "z - c*z^3",
    "z/(1 + z)",
    "z*cos(z)",
    "z*exp(c*z)",
];

/// Functions of `z` with value 1 where `z` is 0.
const ONES: [&str; 8] = [
    "exp(z)",
    "exp(-c*z)",
    "cosh(z)",
    "cos(c*z)",
    "sqrt(1 + z)",
    "(1 + z)^c",
    "1/(1 + c*z)",
    "1 + tanh(z)",
];

/// Functions of `y`, a constant at rest.
const OTHERS: [&str; 8] =
    ["exp(y)", "ln(y)", "sqrt(y)", "sin(y)", "cos(y)", "atan(y)", "tanh(y)", "y^c"];

/// What is done with a difference that vanishes at rest.
const OUTER: [&str; 20] = [
    "D^2",
    "D^2",
    "D^2/(1 + D^2)",
    "max(D, 0)^2",
    "max(D, 0)^3",
    "abs(D)^2.5",
    "abs(D)^(5/3)",
    "abs(D)*D",
    "exp(D^2) - 1",
    "ln(1 + D^2)",
    "sqrt(1 + D^2) - 1",
    "cosh(D) - 1",
    "1 - cos(D)",
    "exp(D) - 1 - D",
    "D - ln(1 + D)",
    "D*sinh(D)",
    "D^2 + D^3",
    "max(D, 0)^2 + (l/L - 1)^4",
    "sqrt(1 + abs(D)^3) - 1",
    "ln(cosh(D))",
];

/// Most operations and calls of a law.
const MOST_OPERATIONS: usize = 40;

/// The law of a seed: the first that is finite up to strains of a half and is not 0.
pub(crate) fn law(seed: u64) -> Nested {
    let mut random = Random::new(seed << 20);
    let tries = 0..10_000;
    let found = tries.into_iter().find_map(|_| {
        let mut maker = Maker { random: &mut random };
        let (outer, text) = maker.law();
        let (model, values) = usable(&text)?;
        Some(Nested { seed, outer, text, model, values })
    });
    found.unwrap_or_else(|| panic!("no law comes of seed {seed}"))
}

struct Maker<'a> {
    random: &'a mut Random,
}

impl Maker<'_> {
    fn below(&mut self, n: usize) -> usize {
        (self.random.bits() % n as u64) as usize
    }

    fn pick(&mut self, from: &[&'static str]) -> &'static str {
        let k = self.below(from.len());
        from[k]
    }

    fn constant(&mut self) -> String {
        format!("({})", self.pick(&CONSTANTS))
    }

    /// A form with its constants, and `inner` in the place of its variable.
    fn filled(&mut self, form: &str, variable: char, inner: &str) -> String {
        let constant = self.constant();
        let part = |c: char| match c {
            'c' => constant.clone(),
            c if c == variable => inner.to_string(),
            c => c.to_string(),
        };
        // Letters of names of functions are no variables.
        let characters: Vec<char> = form.chars().collect();
        let is_letter = |k: Option<usize>| {
            k.and_then(|k| characters.get(k)).is_some_and(char::is_ascii_alphabetic)
        };
        let alone = |k: usize| !is_letter(k.checked_sub(1)) && !is_letter(Some(k + 1));
        let parts = characters.iter().enumerate();
        parts.map(|(k, c)| if alone(k) { part(*c) } else { c.to_string() }).collect()
    }

    /// A nested function with value 0 and slope 1 at rest.
    fn zero(&mut self, depth: usize) -> String {
        if depth == 0 {
            let form = self.pick(&STRAINS);
            let exponent = self.constant();
            return format!("({})", form.replace('p', &exponent));
        }
        let inner = self.zero(depth - 1);
        let form = self.pick(&KEEP_ZERO);
        format!("({})", self.filled(form, 'z', &inner))
    }

    /// A difference that vanishes at rest.
    fn difference(&mut self) -> String {
        let depth = [1 + self.below(2), self.below(2)];
        let [first, second] = depth.map(|depth| self.zero(depth));
        match self.below(6) {
            0 | 1 => format!("({first} - {second})"),
            2 => {
                let [one, other] = [first, second].map(|inner| {
                    let form = self.pick(&ONES);
                    format!("({})", self.filled(form, 'z', &inner))
                });
                format!("({one} - {other})")
            }
            3 => {
                let (form, constant) = (self.pick(&OTHERS), self.constant());
                let [one, other] = [first, second].map(|inner| format!("({constant} + {inner})"));
                // The same constants in both.
                let exponent = self.constant();
                let of =
                    |inner: &str| form.replace("y^c", &format!("y^{exponent}")).replace('y', inner);
                format!("({} - {})", of(&one), of(&other))
            }
            4 => {
                let (form, constant) = (self.pick(&OTHERS), self.constant());
                let exponent = self.constant();
                let of =
                    |inner: &str| form.replace("y^c", &format!("y^{exponent}")).replace('y', inner);
                format!("({} - {})", of(&format!("({constant} + {first})")), of(&constant))
            }
            _ => format!("({first} - (l/L - 1))"),
        }
    }

    /// An energy and the form of its outermost function.
    fn law(&mut self) -> (&'static str, String) {
        let difference = self.difference();
        let outer = self.pick(&OUTER);
        let scale = ["", "1.7*"][self.below(2)];
        let psi = format!("{scale}L*({outer})");
        let domain = "domain l/L in [0.5, 1.5]";
        (outer, format!("potential nested\nD = {difference}\npsi(l) = {psi}\n{domain}\n"))
    }
}

/// The model of a law that has a sensible size.
fn usable(text: &str) -> Option<(Model, Values)> {
    let body = text.split_once("D = ")?.1.split_once("\ndomain")?.0;
    let calls = body.match_indices('(').filter(|(k, _)| {
        body[..*k].chars().next_back().is_some_and(|before| before.is_ascii_alphanumeric())
    });
    let operators = body.matches(['+', '*', '/', '^']).count() + body.matches(" - ").count();
    if calls.count() + operators > MOST_OPERATIONS {
        return None;
    }
    let (_, model) = check_text(text).unwrap_or_else(|error| panic!("{text}: {error:?}"));
    let values = model.values(3, &[], None).unwrap();
    let written = model.written(&values, Measure::Length);
    let at = |stretch: f64| {
        let (psi, first, second) = written.derivatives(stretch, 1.0);
        [psi, first, second]
    };
    let stretches = [0.5, 0.55, 0.6, 0.7, 0.75, 0.8, 0.9, 1.1, 1.2, 1.25, 1.3, 1.4, 1.45, 1.5];
    let is_moderate = stretches.iter().all(|x| at(*x).iter().all(|value| value.abs() < 1e4));
    let is_something = [0.75, 1.25].iter().any(|x| at(*x)[0].abs() > 1e-9);
    (is_moderate && is_something).then_some((model, values))
}
