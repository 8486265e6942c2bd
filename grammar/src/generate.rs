//! Valid programs from arbitrary bytes, for property tests and fuzz targets.
//!
//! The bytes decide everything and the same bytes give the same text, so a failure found by a fuzzer
//! is a test case and a shrunk byte string is a smaller program. Any bytes give a program that
//! parses and whose names, numbers of arguments and types are right; most have no units, and those
//! that have get the dimensions right. The energies are arbitrary: they need not be real numbers
//! everywhere, stable, or zero at rest; so are the conditions under which something breaks, what
//! bonds remember and what they dissipate. A parameter without a default wants any positive number.

/// A potential file made from these bytes.
pub fn potential_text(bytes: &[u8]) -> String {
    let mut writer = Writer::new(bytes);
    writer.file();
    writer.out
}

/// An expression made from these bytes: a number that depends on some of `names`.
pub fn number_text(bytes: &[u8], names: &[&str]) -> String {
    let mut writer = Writer::new(bytes);
    let scope = Scope { leaves: names.iter().map(|name| name.to_string()).collect() };
    writer.body(&scope)
}

/// A condition made from these bytes, on some of `names`.
pub fn condition_text(bytes: &[u8], names: &[&str]) -> String {
    let mut writer = Writer::new(bytes);
    let scope = Scope { leaves: names.iter().map(|name| name.to_string()).collect() };
    writer.fuel = FUEL;
    writer.condition(&scope, DEPTH)
}

/// Operations in one definition or energy; few, because functions are expanded where they are called.
const FUEL: usize = 24;

/// How deep an expression may nest.
const DEPTH: usize = 6;

const PARAMETER_NAMES: [&str; 8] = ["C", "k", "n", "λ", "mu", "κ_", "r_c", "Θ"];
const STATE_NAMES: [&str; 3] = ["k_", "η", "damage"];
const MEASURES: [(&str, &str); 3] = [("l", "L"), ("a", "A"), ("v", "V")];
const FUNCTION_NAMES: [&str; 4] = ["S", "f", "g", "φ"];
const NUMBERS: [&str; 12] =
    ["1", "2", "0.5", "3", ".25", "1.5", "2e-3", "1e2", "0", "7.125", "1.0E+1", "0.1"];

/// Strains of a stretch `S` that are 0 at rest, where they are differences of nearly equal numbers.
const STRAINS: [&str; 13] = [
    "S - 1",
    "(S^2 - 1)/2",
    "(S^1.5 - 1)/1.5",
    "S^3 - S",
    "S - 1/S",
    "ln(S)",
    "ln(S^3)",
    "S - 1 - ln(S)",
    "exp(-2*(S - 1)) - 2*exp(-1*(S - 1)) + 1",
    "exp(3*S) - exp(S)",
    "S^2 - 2 + S^-2",
    "cosh(S - 1) - 1",
    "S^0.5 - 1",
];

/// A state, by the number of the measure of what remembers it.
struct State {
    name: String,
    measure: usize,
}

/// The names of the states of one measure.
fn of_measure(states: &[State], measure: usize) -> Vec<&str> {
    states.iter().filter(|one| one.measure == measure).map(|one| one.name.as_str()).collect()
}

/// What may stand at the leaves of an expression.
#[derive(Clone, Default)]
struct Scope {
    leaves: Vec<String>,
}

impl Scope {
    fn with(&self, more: &[&str]) -> Scope {
        let mut leaves = self.leaves.clone();
        leaves.extend(more.iter().map(|leaf| leaf.to_string()));
        Scope { leaves }
    }
}

struct Writer<'b> {
    bytes: &'b [u8],
    out: String,
    /// User functions: name and number of arguments.
    functions: Vec<(String, usize)>,
    fuel: usize,
    /// Calls of user functions in one body: more than one each would grow exponentially.
    calls: usize,
}

impl<'b> Writer<'b> {
    fn new(bytes: &'b [u8]) -> Self {
        Writer { bytes, out: String::new(), functions: Vec::new(), fuel: FUEL, calls: 0 }
    }

    /// The next choice out of `n`; 0, the simplest one, when the bytes are used up.
    fn pick(&mut self, n: usize) -> usize {
        match self.bytes.split_first() {
            Some((&byte, rest)) => {
                self.bytes = rest;
                byte as usize % n
            }
            None => 0,
        }
    }

    fn pick_of(&mut self, choices: &[&'static str]) -> &'static str {
        choices[self.pick(choices.len())]
    }

    fn line(&mut self, text: &str) {
        self.out.push_str(text);
        let end =
            self.pick_of(&["\n", "\n", "\n", " # a remark (with a bracket\n", "\r\n", "\n\n"]);
        self.out.push_str(end);
    }

    fn file(&mut self) {
        let head = self.pick_of(&["potential p", "potential p \"title\"", "potential λ1 \"(#\""]);
        self.line(head);
        let extra =
            ["", "source \"a, eq. (1)\"", "dimensions 2, 3", "dimensions 3", "weights volumes"];
        let extra = self.pick_of(&extra);
        if !extra.is_empty() {
            self.line(extra);
        }
        let kind = self.pick(8);
        let mut scope = Scope { leaves: vec!["pi".into(), "d".into()] };
        self.parameters(&mut scope);
        self.definitions(&mut scope);
        let states = self.states();
        for _ in 0..=self.pick(3) {
            let measure = self.pick(3);
            // What bonds, triangles and tetrahedra remember is theirs alone.
            let names = of_measure(&states, measure);
            let scope = scope.with(if kind != 6 { &names } else { &[] });
            match kind {
                7 => self.energy_with_units(&scope, measure),
                6 => self.gradient_energy(&scope),
                _ => self.energy(&scope, measure),
            }
        }
        if self.pick(4) == 3 {
            self.dissipation(&scope, &states, kind == 7);
        }
        self.updates(&scope, &states, kind == 7);
        for _ in 0..self.pick(4).saturating_sub(1) {
            self.breaking(&scope, &states, kind == 7);
        }
        let domain = self.pick_of(&[
            "",
            "domain l/L in (0, 10]",
            "domain a in (0, inf)",
            "domain v/V in [-1 - 1/2, 2^2)",
        ]);
        if !domain.is_empty() {
            self.line(domain);
        }
        let allow = self.pick_of(&[
            "",
            "allow \"no-bond-energy\"",
            "allow \"not-stress-free\" \"it is (so\"",
        ]);
        if !allow.is_empty() {
            self.line(allow);
        }
    }

    fn parameters(&mut self, scope: &mut Scope) {
        for i in 0..=self.pick(4) {
            let name = format!("{}{i}", self.pick_of(&PARAMETER_NAMES));
            let default = self.pick_of(&[" = 1", " = 2", " = 1/2", " = .5", " = 1e-3 + 2*pi", ""]);
            let constraint = match self.pick(4) {
                3 => format!(", {name} > 0, {name} < 1e6"),
                2 => format!(", {name} > 0"),
                _ => String::new(),
            };
            let description = self.pick_of(&["", " \"what it is\""]);
            self.line(&format!("parameter {name}{default}{constraint}{description}"));
            scope.leaves.push(name);
        }
    }

    fn definitions(&mut self, scope: &mut Scope) {
        for i in 0..self.pick(4) {
            let name = format!("{}_{i}", self.pick_of(&FUNCTION_NAMES));
            match self.pick(3) {
                0 => {
                    let body = self.body(scope);
                    self.line(&format!("{name} = {body}"));
                    scope.leaves.push(name);
                }
                1 => {
                    let body = self.body(&scope.with(&["x"]));
                    self.line(&format!("{name}(x) = {body}"));
                    self.functions.push((name, 1));
                }
                _ => {
                    let body = self.body(&scope.with(&["x", "y", "x"]));
                    self.line(&format!("{name}(x,y)={body}"));
                    self.functions.push((name, 2));
                }
            }
        }
    }

    /// What is remembered: nothing in half of the files.
    fn states(&mut self) -> Vec<State> {
        let mut states = Vec::new();
        for i in 0..self.pick(4).saturating_sub(1) {
            let name = format!("{}s{i}", self.pick_of(&STATE_NAMES));
            let value = self.pick_of(&["0", "1", "0.25", "-1/8", "2e-3*pi"]);
            let description = self.pick_of(&["", " \"what it keeps\""]);
            self.line(&format!("state {name} = {value}{description}"));
            let measure = self.pick(5).saturating_sub(2);
            states.push(State { name, measure });
        }
        states
    }

    /// What states become; some of bonds stay as they are.
    fn updates(&mut self, scope: &Scope, states: &[State], has_units: bool) {
        for State { name, measure } in states {
            let (now, rest) = MEASURES[*measure];
            let stretch = format!("{now}/{rest}");
            // Measures and the time step have units.
            let own = if has_units { &[][..] } else { &["delta", "dt", rest, now] };
            let names = of_measure(states, *measure);
            let scope = scope.with(&names).with(own).with(&[&stretch]);
            let body = self.body(&scope);
            match self.pick(4) {
                0 => self.line(&format!("update {name} = max({name}, {body})")),
                1 => self.line(&format!("update {name} = {body}")),
                // What never changes is of bonds.
                3 if *measure == 0 => {}
                _ => self
                    .line(&format!("update {name} = if {stretch} > 1.1 then {body} else {name}")),
            }
        }
    }

    /// A condition under which bonds, triangles or tetrahedra break. All its comparisons are of one kind, so
    /// that it has one threshold.
    fn breaking(&mut self, scope: &Scope, states: &[State], has_units: bool) {
        let measure = self.pick(3);
        let (now, rest) = MEASURES[measure];
        let stretch = format!("{now}/{rest}");
        let own = if has_units { &[][..] } else { &["delta", rest, now] };
        let scope = scope.with(&of_measure(states, measure)).with(own);
        let scope = scope.with(&[&stretch]);
        let strict = self.pick(2) == 0;
        let first = match self.pick(3) {
            0 => format!("{stretch} - 1"),
            1 => self.pick_of(&STRAINS).replace('S', &format!("({stretch})")),
            _ => format!("{stretch}*({})", self.body(&scope)),
        };
        let first = self.comparison(&first, strict, &scope);
        let condition = match self.pick(6) {
            2 => format!("not ({first})"),
            3 | 4 => {
                let operator = self.pick_of(&["and", "or"]);
                let left = self.body(&scope);
                let second = self.comparison(&left, strict, &scope);
                format!("{first} {operator} {second}")
            }
            5 => {
                self.fuel = FUEL;
                let which = self.condition(&scope, 1);
                let left = self.body(&scope);
                let second = self.comparison(&left, strict, &scope);
                format!("if {which} then {first} else {second}")
            }
            _ => first,
        };
        let reason = self.pick_of(&["", " \"reason (of it\""]);
        self.line(&format!("break when {condition}{reason}"));
    }

    /// A comparison that holds at equality, or one that does not.
    fn comparison(&mut self, left: &str, strict: bool, scope: &Scope) -> String {
        let operator = self.pick_of(if strict { &[" > ", "<"] } else { &[" >= ", "<="] });
        let right = self.body(scope);
        format!("{left}{operator}{right}")
    }

    fn energy(&mut self, scope: &Scope, measure: usize) {
        let (now, rest) = MEASURES[measure];
        let stretch = format!("{now}/{rest}");
        let mut scope = scope.with(&["delta", rest, now, &stretch]);
        if self.pick(4) >= 2 {
            let name = format!("strain_{now}{}", self.out.len());
            let strain = self.pick_of(&STRAINS).replace('S', &format!("({stretch})"));
            self.line(&format!("{name} = {strain}"));
            scope.leaves.push(name);
        }
        let body = self.body(&scope);
        self.line(&format!("psi({now}) = {body}"));
    }

    /// An energy density in J/m^(2d), J/m^(3d) or J/m^(4d), times an arbitrary pure number.
    fn energy_with_units(&mut self, scope: &Scope, measure: usize) {
        let (now, rest, unit) =
            [("l", "L", "J/m^(2*d+1)"), ("a", "A", "J/m^(3*d + 2)"), ("v", "V", "N*m/m^(4*d)/m^3")]
                [measure];
        let stiffness = format!("stiffness_{}", self.out.len());
        self.line(&format!("parameter {stiffness} = 2 in {unit}, {stiffness} > 0"));
        let body = self.body(&scope.with(&[&format!("{now}/{rest}")]));
        self.line(&format!("psi({now}) = 1/2*{stiffness}*{rest}*({body})"));
    }

    /// A potential of how fast bonds change; the rate may stand in it anywhere.
    fn dissipation(&mut self, scope: &Scope, states: &[State], has_units: bool) {
        let names = of_measure(states, 0);
        if has_units {
            let viscosity = format!("viscosity_{}", self.out.len());
            self.line(&format!("parameter {viscosity} = 2 in W*s^2/m^(2*d + 2)"));
            let body = self.body(&scope.with(&names).with(&["l/L"]));
            self.line(&format!("dissipation(l) = {viscosity}*rate(l)^2*({body})"));
            return;
        }
        let scope = scope.with(&names).with(&["delta", "L", "l", "rate(l)", "rate(l)/L"]);
        let body = self.body(&scope);
        let first = self.pick_of(&["1/2*rate(l)^2", "rate(l)", "abs(rate(l))^1.5"]);
        self.line(&format!("dissipation(l) = {first}*({body})"));
    }

    /// An energy of the deformation gradient: an arbitrary function of a few numbers made of it.
    fn gradient_energy(&mut self, scope: &Scope) {
        let mut scope = scope.with(&["d", "J"]);
        for _ in 0..=self.pick(2) {
            let name = format!("i_{}", self.out.len());
            let invariant = self.invariant();
            self.line(&format!("{name} = {invariant}"));
            scope.leaves.push(name);
        }
        let body = self.body(&scope);
        self.line(&format!("psi(F) = {body}"));
    }

    fn invariant(&mut self) -> String {
        match self.pick(10) {
            0 => "tr(C) - d".to_string(),
            1 => "E : E".to_string(),
            2 => "J^(-2/d)*tr(C)".to_string(),
            3 => "ln(J)".to_string(),
            4 => format!("det({})", self.tensor(1)),
            5 | 6 => format!("{} : {}", self.factor(2), self.factor(1)),
            7 => {
                let of_stretch =
                    ["tr(U) - d", "tr(ln(U)^2)", "tr(U^1.5)", "U : ln(U)", "tr((U - I)^2)"];
                self.pick_of(&of_stretch).to_string()
            }
            _ => format!("tr({})", self.tensor(3)),
        }
    }

    fn tensor(&mut self, depth: usize) -> String {
        if depth == 0 {
            return self.pick_of(&["F", "C", "E", "I", "F'"]).to_string();
        }
        let depth = depth - 1;
        match self.pick(9) {
            0 | 1 => self.tensor(0),
            2 => format!("dev({})", self.tensor(depth)),
            3 => format!("sym({})", self.tensor(depth)),
            4 => "inv(C)".to_string(),
            5 => format!("{}*{}", self.factor(depth), self.factor(depth)),
            6 => format!("{}^{}", self.factor(depth), self.pick_of(&["2", "3"])),
            7 => format!("{}*{}", self.pick_of(&["2", "J", "1/3"]), self.factor(depth)),
            _ => {
                let operator = self.pick_of(&[" + ", " - "]);
                format!("{}{operator}{}", self.tensor(depth), self.factor(depth))
            }
        }
    }

    /// A tensor that binds as tightly as a name.
    fn factor(&mut self, depth: usize) -> String {
        format!("({})", self.tensor(depth))
    }

    /// A whole expression with its own budget.
    fn body(&mut self, scope: &Scope) -> String {
        self.fuel = FUEL;
        self.calls = 0;
        self.number(scope, DEPTH)
    }

    fn number(&mut self, scope: &Scope, depth: usize) -> String {
        if depth == 0 || self.fuel == 0 {
            return self.leaf(scope);
        }
        self.fuel -= 1;
        match self.pick(12) {
            0 => self.leaf(scope),
            1..=5 => self.arithmetic(scope, depth - 1),
            6 => self.power(scope, depth - 1),
            7 => format!("-{}", self.enclosed(scope, depth - 1)),
            8 => self.unary_call(scope, depth - 1),
            9 => self.binary_call(scope, depth - 1),
            10 => self.conditional(scope, depth - 1),
            _ => self.user_call(scope, depth - 1),
        }
    }

    fn leaf(&mut self, scope: &Scope) -> String {
        if scope.leaves.is_empty() || self.pick(3) == 2 {
            return self.pick_of(&NUMBERS).to_string();
        }
        // The last names of a scope are the ones it was made for: every other leaf is one of them.
        let n = scope.leaves.len();
        let choice = self.pick(2 * n);
        let choice = if choice < n { choice } else { choice % n.min(3) };
        scope.leaves[n - 1 - choice].clone()
    }

    fn arithmetic(&mut self, scope: &Scope, depth: usize) -> String {
        let operator = self.pick_of(&["*", " + ", " - ", "/", "-", " * ", "+"]);
        let left = self.enclosed(scope, depth);
        let right = self.enclosed(scope, depth);
        format!("{left}{operator}{right}")
    }

    fn power(&mut self, scope: &Scope, depth: usize) -> String {
        let base = self.enclosed(scope, depth);
        let exponent = match self.pick(8) {
            6 => "2^2".to_string(),
            7 => self.enclosed(scope, depth),
            constant => ["2", "3", "-1", "0.5", "-2", "(1/3)"][constant].to_string(),
        };
        format!("{base}^{exponent}")
    }

    fn unary_call(&mut self, scope: &Scope, depth: usize) -> String {
        let function = self.pick_of(&crate::names::UNARY_FUNCTIONS);
        let argument = self.number(scope, depth);
        let (open, close) =
            [("(", ")"), ("( ", " )"), ("(\n", ") "), ("( # why not (\n", "\r\n)")][self.pick(4)];
        format!("{function}{open}{argument}{close}")
    }

    fn binary_call(&mut self, scope: &Scope, depth: usize) -> String {
        let function = self.pick_of(&crate::names::BINARY_FUNCTIONS);
        let left = self.number(scope, depth);
        let right = self.number(scope, depth);
        format!("{function}({left}, {right})")
    }

    fn user_call(&mut self, scope: &Scope, depth: usize) -> String {
        if self.functions.is_empty() || self.calls > 0 {
            return self.leaf(scope);
        }
        self.calls += 1;
        let choice = self.pick(self.functions.len());
        let (name, arity) = self.functions[choice].clone();
        let arguments: Vec<String> = (0..arity).map(|_| self.number(scope, depth)).collect();
        format!("{name}({})", arguments.join(", "))
    }

    /// Always in parentheses, or an operator behind it would belong to its last branch.
    fn conditional(&mut self, scope: &Scope, depth: usize) -> String {
        let condition = self.condition(scope, depth);
        let then = self.number(scope, depth);
        let otherwise = self.number(scope, depth);
        format!("(if {condition} then {then} else {otherwise})")
    }

    fn condition(&mut self, scope: &Scope, depth: usize) -> String {
        let kind = if depth == 0 || self.fuel == 0 { 0 } else { self.pick(6) };
        self.fuel = self.fuel.saturating_sub(1);
        match kind {
            3 => {
                let operator = self.pick_of(&["and", "or"]);
                let left = self.condition(scope, depth - 1);
                let right = self.condition(scope, depth - 1);
                format!("{left} {operator} {right}")
            }
            4 => format!("not {}", self.condition(scope, depth - 1)),
            5 => format!("({})", self.condition(scope, depth - 1)),
            _ => {
                let operator = self.pick_of(&["<", " > ", " == ", "<=", " >= ", " != "]);
                let depth = depth.saturating_sub(1);
                let left = self.number(scope, depth);
                let right = self.number(scope, depth);
                format!("{left}{operator}{right}")
            }
        }
    }

    /// A number, in parentheses or not: both are valid, the trees differ.
    fn enclosed(&mut self, scope: &Scope, depth: usize) -> String {
        let inner = self.number(scope, depth);
        if self.pick(2) == 0 { inner } else { format!("({inner})") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_bytes_give_the_simplest_program() {
        assert!(crate::parse(&potential_text(&[])).is_ok());
        assert_eq!(number_text(&[], &["X"]), "X");
        assert_eq!(condition_text(&[], &["X"]), "X<X");
    }
}
