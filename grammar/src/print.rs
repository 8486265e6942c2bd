//! From a syntax tree to canonical text.
//!
//! The text parses to the same tree ([`crate::same_tree`]) and holds no parentheses that could be
//! left out, except around an `if` inside an operation, which is hard to read without. Comments and
//! line breaks of the original are gone. Nothing here recurses: trees may be as deep as files are
//! long.

use crate::ast::{
    Allow, Arena, Ast, BinaryOperator, Bound, Break, Definition, Energy, ExprId, ExprKind, Ident,
    Parameter, Statement, Text, UnaryOperator, Unit, Update,
};
use crate::operator::Binding;

/// Prints a potential file, one statement a line.
pub fn print(ast: &Ast) -> String {
    let mut printer = Printer { arena: &ast.arena, out: String::new() };
    printer.push("potential ");
    printer.push(&ast.name.name);
    printer.text_after(" ", &ast.title);
    printer.push("\n");
    for statement in &ast.statements {
        printer.statement(statement);
        printer.push("\n");
    }
    printer.out
}

/// Prints one expression.
pub fn print_expression(arena: &Arena, root: ExprId) -> String {
    let mut printer = Printer { arena, out: String::new() };
    printer.expression(root);
    printer.out
}

/// Prints a unit as it would stand after `in`.
pub fn print_unit(arena: &Arena, unit: &Unit) -> String {
    let mut printer = Printer { arena, out: String::new() };
    printer.unit(unit);
    printer.out
}

/// What is still to be printed.
enum Work<'a> {
    Expression(ExprId),
    /// The expression in parentheses.
    Enclosed(ExprId),
    Text(&'a str),
}

struct Printer<'a> {
    arena: &'a Arena,
    out: String,
}

impl<'a> Printer<'a> {
    fn push(&mut self, text: &str) {
        self.out.push_str(text);
    }

    fn statement(&mut self, statement: &Statement) {
        match statement {
            Statement::Source(text) => {
                self.push("source");
                self.text(" ", text);
            }
            Statement::Import(file, _) => {
                self.push("import");
                self.text(" ", file);
            }
            Statement::Allow(Allow { code, reason }) => {
                self.push("allow");
                self.text(" ", code);
                self.text_after(" ", reason);
            }
            Statement::Dimensions(dimensions) => {
                self.push("dimensions ");
                let numbers: Vec<String> = dimensions.iter().map(|(d, _)| d.to_string()).collect();
                self.push(&numbers.join(", "));
            }
            Statement::Weights(_) => self.push("weights volumes"),
            Statement::Parameter(parameter) => self.parameter(parameter),
            Statement::Definition(definition) => self.definition(definition),
            Statement::Energy(energy) => self.energy("psi", energy),
            Statement::Dissipation(potential) => self.energy("dissipation", potential),
            Statement::Domain(domain) => {
                self.push("domain ");
                self.expression(domain.quantity);
                self.push(if domain.lower.inclusive { " in [" } else { " in (" });
                self.bound(&domain.lower);
                self.push(", ");
                self.bound(&domain.upper);
                self.push(if domain.upper.inclusive { "]" } else { ")" });
            }
            Statement::Update(Update { state, index, body, .. }) => {
                let index = index.as_ref().map(|index| format!("({})", index.name));
                self.push(&format!("update {}{} = ", state.name, index.unwrap_or_default()));
                self.expression(*body);
            }
            Statement::Break(Break { condition, reason, .. }) => {
                self.push("break when ");
                self.expression(*condition);
                self.text_after(" ", reason);
            }
        }
    }

    fn energy(&mut self, head: &str, energy: &Energy) {
        let names = [&energy.measure].into_iter().chain(&energy.gathered);
        let names: Vec<&str> = names.map(|name| name.name.as_str()).collect();
        self.push(&format!("{head}({}) = ", names.join(", ")));
        self.expression(energy.body);
    }

    fn bound(&mut self, bound: &Bound) {
        self.expression(bound.value);
    }

    fn parameter(&mut self, parameter: &Parameter) {
        self.push(if parameter.is_state { "state " } else { "parameter " });
        self.push(&parameter.name.name);
        if let Some((size, _)) = parameter.size {
            self.push(&format!("({size})"));
        }
        match parameter.defaults.as_slice() {
            [] => {}
            [default] => {
                self.push(" = ");
                self.expression(*default);
            }
            all => {
                for (number, default) in all.iter().enumerate() {
                    self.push(if number == 0 { " = (" } else { ", " });
                    self.expression(*default);
                }
                self.push(")");
            }
        }
        if let Some(unit) = &parameter.unit {
            self.push(" in ");
            self.unit(unit);
        }
        for &constraint in &parameter.constraints {
            self.push(", ");
            self.expression(constraint);
        }
        self.text_after(" ", &parameter.description);
    }

    fn definition(&mut self, definition: &Definition) {
        self.push(&definition.name.name);
        if let Some(parameters) = &definition.parameters {
            let names: Vec<&str> = parameters.iter().map(|p: &Ident| p.name.as_str()).collect();
            self.push(&format!("({})", names.join(", ")));
        }
        self.push(" = ");
        self.expression(definition.body);
        if let Some(unit) = &definition.unit {
            self.push(" in ");
            self.unit(unit);
        }
    }

    fn unit(&mut self, unit: &Unit) {
        if unit.factors.first().is_none_or(|first| first.divided) {
            self.push("1");
        }
        for (i, factor) in unit.factors.iter().enumerate() {
            if factor.divided {
                self.push("/");
            } else if i > 0 {
                self.push("*");
            }
            self.push(&factor.name.name);
            if let Some(exponent) = factor.exponent {
                self.push("^");
                self.exponent(exponent);
            }
        }
    }

    /// A number or a name, perhaps with a sign, stands bare after the `^` of a unit.
    fn exponent(&mut self, exponent: ExprId) {
        let plain =
            |id: ExprId| matches!(self.arena[id].kind, ExprKind::Number(_) | ExprKind::Name(_));
        let bare = plain(exponent)
            || matches!(self.arena[exponent].kind,
                ExprKind::Unary { operator: UnaryOperator::Negate, operand } if plain(operand));
        if bare {
            self.expression(exponent);
        } else {
            self.run(vec![Work::Enclosed(exponent)]);
        }
    }

    fn text_after(&mut self, before: &str, text: &Option<Text>) {
        if let Some(text) = text {
            self.text(before, text);
        }
    }

    /// The language has no escapes: what cannot stand in a string is replaced.
    fn text(&mut self, before: &str, text: &Text) {
        let inside = text.text.replace('"', "'").replace(['\n', '\r'], " ");
        self.push(&format!("{before}\"{inside}\""));
    }

    fn expression(&mut self, root: ExprId) {
        self.run(vec![Work::Expression(root)]);
    }

    /// Prints a stack of work, last entry first.
    fn run(&mut self, mut stack: Vec<Work<'a>>) {
        while let Some(work) = stack.pop() {
            match work {
                Work::Text(text) => self.push(text),
                Work::Enclosed(id) => {
                    self.push("(");
                    stack.push(Work::Text(")"));
                    stack.push(Work::Expression(id));
                }
                Work::Expression(id) => self.unfold(id, &mut stack),
            }
        }
    }

    /// Prints the beginning of an expression and leaves the rest on the stack.
    fn unfold(&mut self, id: ExprId, stack: &mut Vec<Work<'a>>) {
        let arena = self.arena;
        match &arena[id].kind {
            ExprKind::Number(value) => self.push(&number(*value)),
            ExprKind::Name(name) => self.push(name),
            ExprKind::Call { function, arguments } => {
                self.push(&function.name);
                self.push("(");
                stack.push(Work::Text(")"));
                for (i, &argument) in arguments.iter().enumerate().rev() {
                    stack.push(Work::Expression(argument));
                    if i > 0 {
                        stack.push(Work::Text(", "));
                    }
                }
            }
            ExprKind::Table { file, argument } => {
                self.push("table(");
                self.text("", file);
                self.push(", ");
                stack.push(Work::Text(")"));
                stack.push(Work::Expression(*argument));
            }
            ExprKind::Unary { operator: UnaryOperator::Transpose, operand } => {
                stack.push(Work::Text(UnaryOperator::Transpose.symbol()));
                let bare = binding(arena, *operand).is_none_or(|inner| inner == Binding::Transpose);
                stack.push(enclosed_unless(bare && !is_if(arena, *operand), *operand));
            }
            ExprKind::Unary { operator, operand } => {
                self.push(operator.symbol());
                if *operator == UnaryOperator::Not {
                    self.push(" ");
                }
                let bare = binding(arena, *operand).is_none_or(|inner| inner >= operator.binding());
                stack.push(enclosed_unless(bare && !is_if(arena, *operand), *operand));
            }
            ExprKind::Binary { operator, left, right } => {
                stack.push(enclosed_unless(stands_right(arena, *operator, *right), *right));
                stack.push(Work::Text(spaced(*operator)));
                stack.push(enclosed_unless(stands_left(arena, *operator, *left), *left));
            }
            ExprKind::If { condition, then, otherwise } => {
                self.push("if ");
                stack.push(Work::Expression(*otherwise));
                stack.push(Work::Text(" else "));
                stack.push(Work::Expression(*then));
                stack.push(Work::Text(" then "));
                stack.push(Work::Expression(*condition));
            }
        }
    }
}

fn enclosed_unless<'a>(bare: bool, id: ExprId) -> Work<'a> {
    if bare { Work::Expression(id) } else { Work::Enclosed(id) }
}

/// Whether an expression may stand left of an operator without parentheses.
fn stands_left(arena: &Arena, operator: BinaryOperator, left: ExprId) -> bool {
    let chains = !matches!(operator.binding(), Binding::Comparison | Binding::Power);
    !is_if(arena, left)
        && binding(arena, left)
            .is_none_or(|inner| inner > operator.binding() || chains && inner == operator.binding())
}

/// Whether an expression may stand right of an operator without parentheses.
fn stands_right(arena: &Arena, operator: BinaryOperator, right: ExprId) -> bool {
    let from_right = operator.binding() == Binding::Power;
    !is_if(arena, right)
        && binding(arena, right).is_none_or(|inner| {
            // `2^-x` is clear, because no operand stands left of the sign.
            inner > operator.binding() || from_right && inner >= Binding::Sign
        })
}

/// How tightly the outermost operator binds; `None` where there is no operator.
fn binding(arena: &Arena, id: ExprId) -> Option<Binding> {
    match arena[id].kind {
        ExprKind::Unary { operator, .. } => Some(operator.binding()),
        ExprKind::Binary { operator, .. } => Some(operator.binding()),
        _ => None,
    }
}

fn is_if(arena: &Arena, id: ExprId) -> bool {
    matches!(arena[id].kind, ExprKind::If { .. })
}

/// The operator between its operands: products and powers are close, all else is wide.
fn spaced(operator: BinaryOperator) -> &'static str {
    match operator {
        BinaryOperator::Or => " or ",
        BinaryOperator::And => " and ",
        BinaryOperator::Equal => " == ",
        BinaryOperator::NotEqual => " != ",
        BinaryOperator::Less => " < ",
        BinaryOperator::LessEqual => " <= ",
        BinaryOperator::Greater => " > ",
        BinaryOperator::GreaterEqual => " >= ",
        BinaryOperator::Add => " + ",
        BinaryOperator::Subtract => " - ",
        BinaryOperator::Multiply => "*",
        BinaryOperator::Divide => "/",
        BinaryOperator::Contract => " : ",
        BinaryOperator::Power => "^",
    }
}

/// The shortest decimal form that reads back to the same bits.
fn number(value: f64) -> String {
    let plain = format!("{value}");
    let scientific = format!("{value:e}");
    if scientific.len() < plain.len() { scientific } else { plain }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parse_expression;

    fn canonical(text: &str) -> String {
        let ast = parse_expression(text).unwrap_or_else(|found| panic!("{text}: {found:?}"));
        print_expression(&ast.arena, ast.root)
    }

    #[test]
    fn parentheses_that_change_nothing_are_dropped() {
        for (text, expected) in [
            ("((1))+(2)", "1 + 2"),
            ("1/2*(C1)*L*(S(l/L))^2", "1/2*C1*L*S(l/L)^2"),
            ("-(x^2)", "-x^2"),
            ("2^(3^2)", "2^3^2"),
            ("2^(-x)", "2^-x"),
            ("2^(-(x^2))*y", "2^-x^2*y"),
            ("(-x)*y", "-x*y"),
            ("a*(-b)", "a*-b"),
            ("a-(-b)", "a - -b"),
            ("not (a < b)", "not a < b"),
            ("(F')*(F)", "F'*F"),
            ("((F')')^2", "F''^2"),
            ("mu*((E):E)", "mu*(E : E)"),
            ("(mu*E):E", "mu*E : E"),
            ("(a and b) or (not c)", "a and b or not c"),
            (
                "if (a < b) then (1) else (if c then 2 else 3)",
                "if a < b then 1 else if c then 2 else 3",
            ),
        ] {
            assert_eq!(canonical(text), expected);
        }
    }

    #[test]
    fn parentheses_that_matter_stay() {
        for text in [
            "(-x)^2",
            "(2^3)^2",
            "-(x*y)",
            "a - (b - c)",
            "a/(b*c)",
            "a*(b/c)",
            "a + (b + c)",
            "(a < b) == (b < c)",
            "not (a and b)",
            "a == (not b)",
            "2*(if a then 1 else 2)",
            "-(if a then 1 else 2)",
            "(2^-x)^3",
            "(A*B)'",
            "(-A)'",
            "-A'",
            "2^A'",
            "(2^x)'",
            "A : B/2",
            "A*(B : C)",
            "2^(x + 1)",
        ] {
            assert_eq!(canonical(text), text);
        }
    }

    #[test]
    fn numbers_are_as_short_as_their_bits_allow() {
        for (text, expected) in [
            ("1.50", "1.5"),
            (".5", "0.5"),
            ("1e300", "1e300"),
            ("2.5E-3", "0.0025"),
            ("1000000", "1e6"),
            ("0.1", "0.1"),
            ("4.9e-324", "5e-324"),
            ("1.7976931348623157e308", "1.7976931348623157e308"),
        ] {
            assert_eq!(canonical(text), expected);
        }
    }
}
