//! What names stand for: built-in symbols, functions of tensors, what a file defines.

use std::collections::{HashMap, HashSet};
use std::iter::once;
use std::rc::Rc;

use piola_grammar::ast::{Ast, Energy, ExprId, ExprKind, Statement};

use super::names::INTEGRAL;
use super::table::Table;
use crate::clique::Part;
use crate::measure::Measure;
use crate::model::number_of_time_step;

/// The vector of a bond at rest.
pub(crate) const BOND: &str = "Xi";

/// The same now.
pub(crate) const BOND_NOW: &str = "xi";

/// What a name outside a function's formal parameters stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Symbol {
    /// Current measure.
    Current(Measure),
    /// Reference measure.
    Reference(Measure),
    /// A measure of a part of a triangle or a tetrahedron, in a file with an energy of several measures.
    Part(Part),
    /// The same at rest.
    PartAtRest(Part),
    /// `delta`
    Horizon,
    /// `d`
    Dimension,
    /// `pi`
    Pi,
    /// `F`, `I`, `J`, `C` or `E`, in a file with an energy of `F`.
    Kinematic(Kinematic),
    /// A parameter or a state, by number.
    Parameter(usize),
    /// `dt`, in a file with updates; numbered behind all parameters.
    TimeStep(usize),
    /// `Xi`, the vector of a bond at rest, in a file that names it; the number of the first component of its
    /// direction, behind all parameters.
    Bond(usize),
    /// `xi`, the same now, in a file with an energy of it.
    BondNow(usize),
    /// A definition without parameters, by number of its statement.
    Value(usize),
    /// A user's function, by number of its statement.
    Function(usize),
}

/// The names of a file.
#[derive(Default)]
pub(crate) struct Symbols<'a> {
    pub(super) names: HashMap<&'a str, Symbol>,
    /// The parameters that are states, by number, ascending.
    pub(super) states: Vec<usize>,
    /// Whether functions of tensors are known.
    pub(super) tensors: bool,
    /// What the files of tables hold, by their names in the text.
    pub(super) tables: HashMap<String, Rc<Table>>,
    /// Roots of the expressions in which some name is wrong: nothing more is said of them.
    pub(super) unresolved: HashSet<ExprId>,
}

impl<'a> Symbols<'a> {
    /// Declares variables, which count as parameters; no measures are known.
    pub(crate) fn with_variables(variables: &[&'a str]) -> Symbols<'a> {
        let mut symbols = Symbols::default();
        for (number, name) in variables.iter().enumerate() {
            symbols.names.insert(name, Symbol::Parameter(number));
        }
        symbols.names.insert("pi", Symbol::Pi);
        symbols
    }

    /// What a file of a potential knows before its first line.
    pub(super) fn of_potentials(ast: &Ast) -> Symbols<'a> {
        let tensors = ast.statements.iter().any(
            |s| matches!(s, Statement::Energy(e) if e.measure.name == "F" || is_kinematic(ast, e)),
        );
        let is_of_vector =
            |s: &Statement| matches!(s, Statement::Energy(energy) if is_of_vector(ast, energy));
        let gathers = is_named(ast, INTEGRAL);
        let moves_bond = ast.statements.iter().any(is_of_vector)
            || gathers && is_named(ast, BOND_NOW) && !is_defined(ast, BOND_NOW);
        let sees_bond = moves_bond || is_named(ast, BOND);
        let mut symbols = Symbols { tensors: tensors || sees_bond, ..Symbols::default() };
        if tensors {
            for (name, which) in Kinematic::NAMED {
                symbols.names.insert(name, Symbol::Kinematic(which));
            }
        }
        if gathers && sees_bond {
            symbols.names.insert("I", Symbol::Kinematic(Kinematic::Identity));
        }
        for measure in Measure::ALL {
            symbols.names.insert(measure.symbol(), Symbol::Current(measure));
            symbols.names.insert(measure.reference_symbol(), Symbol::Reference(measure));
        }
        if ast.statements.iter().any(|s| matches!(s, Statement::Energy(e) if is_coupled(ast, e))) {
            for part in Part::named() {
                symbols.names.insert(part.symbol(), Symbol::Part(part));
                symbols.names.insert(part.reference_symbol(), Symbol::PartAtRest(part));
            }
        }
        if ast.statements.iter().any(|s| matches!(s, Statement::Update(_))) {
            let declared = ast.statements.iter().filter(|s| matches!(s, Statement::Parameter(_)));
            symbols.names.insert("dt", Symbol::TimeStep(number_of_time_step(declared.count())));
        }
        if sees_bond {
            let declared = ast.statements.iter().filter(|s| matches!(s, Statement::Parameter(_)));
            let first = declared.count();
            symbols.names.insert(BOND, Symbol::Bond(first));
            if moves_bond {
                symbols.names.insert(BOND_NOW, Symbol::BondNow(first));
            }
        }
        symbols.names.insert("delta", Symbol::Horizon);
        symbols.names.insert("d", Symbol::Dimension);
        symbols.names.insert("pi", Symbol::Pi);
        symbols
    }

    /// What a name stands for, formal parameters aside.
    pub(crate) fn get(&self, name: &str) -> Option<Symbol> {
        self.names.get(name).copied()
    }

    /// Whether all names of the expression with this root are right.
    pub(crate) fn are_resolved(&self, root: ExprId) -> bool {
        !self.unresolved.contains(&root)
    }
}

/// Functions of tensors and vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TensorFunction {
    Trace,
    Determinant,
    Inverse,
    Deviator,
    Symmetric,
    /// `dyad(n, m)`, the tensor `n m` of two vectors, or `n n` of one or of its components.
    Dyad,
    /// `vector(x, y, z)`, of numbers.
    Vector,
    /// `norm(n)`, of a vector or a tensor.
    Norm,
}

impl TensorFunction {
    pub(crate) const NAMES: [&str; 8] =
        ["tr", "det", "inv", "dev", "sym", "dyad", "vector", "norm"];

    /// Whether how many arguments it takes follows from the dimension.
    pub(crate) fn takes_components(self) -> bool {
        matches!(self, TensorFunction::Dyad | TensorFunction::Vector)
    }

    pub(crate) fn named(name: &str) -> Option<TensorFunction> {
        Some(match name {
            "tr" => TensorFunction::Trace,
            "det" => TensorFunction::Determinant,
            "inv" => TensorFunction::Inverse,
            "dev" => TensorFunction::Deviator,
            "sym" => TensorFunction::Symmetric,
            "dyad" => TensorFunction::Dyad,
            "vector" => TensorFunction::Vector,
            "norm" => TensorFunction::Norm,
            _ => return None,
        })
    }
}

/// What a file with `psi(F)` knows besides the gradient itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kinematic {
    /// `F`
    Gradient,
    /// `I`
    Identity,
    /// `J = det(F)`
    Jacobian,
    /// `C = F'*F`
    CauchyGreen,
    /// `E = (C - I)/2`
    Strain,
    /// `U`, of which `C` is the square.
    Stretch,
}

impl Kinematic {
    pub(crate) const NAMED: [(&str, Kinematic); 6] = [
        ("F", Kinematic::Gradient),
        ("I", Kinematic::Identity),
        ("J", Kinematic::Jacobian),
        ("C", Kinematic::CauchyGreen),
        ("E", Kinematic::Strain),
        ("U", Kinematic::Stretch),
    ];
}

/// Whether an expression of a file holds a name, or calls it: `Xi(1)`.
fn is_named(ast: &Ast, name: &str) -> bool {
    ast.arena.iter().any(|(_, expression)| match &expression.kind {
        ExprKind::Name(own) => own == name,
        ExprKind::Call { function, .. } => function.name == name,
        _ => false,
    })
}

/// Whether a file defines a name.
fn is_defined(ast: &Ast, name: &str) -> bool {
    ast.statements.iter().any(|statement| match statement {
        Statement::Definition(definition) => definition.name.name == name,
        Statement::Parameter(parameter) => parameter.name.name == name,
        _ => false,
    })
}

/// Whether an energy is one of several measures of a triangle or a tetrahedron: `psi(a, l1, l2)`,
/// `psi(angle)`.
pub(crate) fn is_coupled(ast: &Ast, energy: &Energy) -> bool {
    let names = || once(&energy.measure).chain(&energy.gathered).map(|name| name.name.as_str());
    let is_part = |name: &str| {
        let known = Part::from_symbol(name).or_else(|| Part::at_rest(name));
        known.is_some() && !is_defined(ast, name)
    };
    let is_whole = |name: &str| matches!(name, "l" | "a" | "v");
    let first = energy.measure.name.as_str();
    is_part(first) || (is_whole(first) && names().skip(1).any(is_part))
}

/// Whether an energy is one of the vector of a bond: `psi(xi)`.
pub(crate) fn is_of_vector(ast: &Ast, energy: &Energy) -> bool {
    energy.measure.name == BOND_NOW && !is_defined(ast, BOND_NOW)
}

/// Whether an energy was meant to be one of the deformation gradient: `psi(C)`, `psi(J)`, `psi(U)`.
pub(crate) fn is_kinematic(ast: &Ast, energy: &Energy) -> bool {
    let name = energy.measure.name.as_str();
    Kinematic::NAMED.iter().any(|(known, _)| *known == name)
        && energy.gathered.is_empty()
        && !is_defined(ast, name)
}
