//! The syntax tree: what the user wrote, nothing resolved, a span on every node.
//!
//! Expressions live in one arena and refer to each other by index. Children always stand before
//! their parents, so a pass over a tree is a loop over the arena and no input, however deep, can
//! overflow the stack.

use crate::Span;

/// Index of an expression in its [`Arena`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ExprId(pub u32);

/// A name with its place. Greek letters are already spelled out (`ψ` is `psi`).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ident {
    /// The name.
    pub name: String,
    /// Its place.
    pub span: Span,
}

/// A quoted string with its place; `text` is without the quotes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Text {
    /// What stands between the quotes.
    pub text: String,
    /// Its place, quotes included.
    pub span: Span,
}

/// One expression.
#[derive(Clone, Debug, PartialEq)]
pub struct Expr {
    /// What it is.
    pub kind: ExprKind,
    /// Its place, without enclosing parentheses.
    pub span: Span,
}

/// The kinds of expression.
#[derive(Clone, Debug, PartialEq)]
pub enum ExprKind {
    /// `1`, `0.5`, `2.5e-3`; never negative, always finite.
    Number(f64),
    /// A name that is not called.
    Name(String),
    /// `f(x, y)`.
    Call {
        /// The function's name.
        function: Ident,
        /// The arguments in order.
        arguments: Vec<ExprId>,
    },
    /// `table("data.csv", x)`
    Table {
        /// The file of the measured points, as written.
        file: Text,
        /// Where it is read off.
        argument: ExprId,
    },
    /// `-x`, `not c`.
    Unary {
        /// Which.
        operator: UnaryOperator,
        /// Of what.
        operand: ExprId,
    },
    /// `x + y`, `x < y`, `c and e`.
    Binary {
        /// Which.
        operator: BinaryOperator,
        /// Left operand.
        left: ExprId,
        /// Right operand.
        right: ExprId,
    },
    /// `if c then x else y`.
    If {
        /// The condition.
        condition: ExprId,
        /// Value where it holds.
        then: ExprId,
        /// Value elsewhere.
        otherwise: ExprId,
    },
}

impl Statement {
    /// The outermost expressions that it holds, exponents of units among them.
    pub fn expressions_mut(&mut self) -> Vec<&mut ExprId> {
        match self {
            Statement::Parameter(Parameter { defaults, constraints, unit, .. }) => {
                defaults.iter_mut().chain(constraints).chain(exponents_mut(unit)).collect()
            }
            Statement::Definition(Definition { body, unit, .. }) => {
                [body].into_iter().chain(exponents_mut(unit)).collect()
            }
            Statement::Update(Update { body, .. })
            | Statement::Energy(Energy { body, .. })
            | Statement::Dissipation(Energy { body, .. }) => vec![body],
            Statement::Domain(Domain { quantity, lower, upper, .. }) => {
                vec![quantity, &mut lower.value, &mut upper.value]
            }
            Statement::Break(Break { condition, .. }) => vec![condition],
            Statement::Source(_)
            | Statement::Import(..)
            | Statement::Allow(_)
            | Statement::Dimensions(_)
            | Statement::Weights(_) => Vec::new(),
        }
    }

    /// The same to read.
    pub fn expressions(&self) -> Vec<ExprId> {
        self.clone().expressions_mut().into_iter().map(|id| *id).collect()
    }
}

fn exponents_mut(unit: &mut Option<Unit>) -> impl Iterator<Item = &mut ExprId> {
    let factors = unit.iter_mut().flat_map(|unit| &mut unit.factors);
    factors.filter_map(|factor| factor.exponent.as_mut())
}

impl ExprKind {
    /// The expressions that it is made of.
    pub fn operands(&self) -> Vec<ExprId> {
        match self {
            ExprKind::Number(_) | ExprKind::Name(_) => Vec::new(),
            ExprKind::Call { arguments, .. } => arguments.clone(),
            ExprKind::Unary { operand, .. } | ExprKind::Table { argument: operand, .. } => {
                vec![*operand]
            }
            ExprKind::Binary { left, right, .. } => vec![*left, *right],
            ExprKind::If { condition, then, otherwise } => vec![*condition, *then, *otherwise],
        }
    }

    /// The same to change.
    pub fn operands_mut(&mut self) -> Vec<&mut ExprId> {
        match self {
            ExprKind::Number(_) | ExprKind::Name(_) => Vec::new(),
            ExprKind::Call { arguments, .. } => arguments.iter_mut().collect(),
            ExprKind::Unary { operand, .. } | ExprKind::Table { argument: operand, .. } => {
                vec![operand]
            }
            ExprKind::Binary { left, right, .. } => vec![left, right],
            ExprKind::If { condition, then, otherwise } => vec![condition, then, otherwise],
        }
    }
}

/// Operators with one operand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum UnaryOperator {
    /// `-x`; binds weaker than `^`: `-x^2` is `-(x^2)`.
    Negate,
    /// `not c`.
    Not,
    /// `F'`, the transpose; stands behind its operand.
    Transpose,
}

/// Operators with two operands, loosest first in the comments of their groups.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BinaryOperator {
    /// `or`
    Or,
    /// `and`
    And,
    /// `==`; comparisons do not chain
    Equal,
    /// `!=`
    NotEqual,
    /// `<`
    Less,
    /// `<=`
    LessEqual,
    /// `>`
    Greater,
    /// `>=`
    GreaterEqual,
    /// `+`
    Add,
    /// `-`
    Subtract,
    /// `*`
    Multiply,
    /// `/`
    Divide,
    /// `A : B`, the double contraction of two tensors
    Contract,
    /// `^`, right associative
    Power,
}

/// The expressions of one text, children before parents.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Arena {
    exprs: Vec<Expr>,
}

impl Arena {
    /// Appends an expression whose children are already here.
    pub fn push(&mut self, kind: ExprKind, span: Span) -> ExprId {
        self.exprs.push(Expr { kind, span });
        ExprId((self.exprs.len() - 1) as u32)
    }

    /// How many expressions there are.
    pub fn len(&self) -> usize {
        self.exprs.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.exprs.is_empty()
    }

    /// All expressions with their ids, children before parents.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = (ExprId, &Expr)> {
        self.exprs.iter().enumerate().map(|(i, e)| (ExprId(i as u32), e))
    }
}

impl std::ops::Index<ExprId> for Arena {
    type Output = Expr;
    fn index(&self, id: ExprId) -> &Expr {
        &self.exprs[id.0 as usize]
    }
}

/// A potential file.
#[derive(Clone, Debug, PartialEq)]
pub struct Ast {
    /// The name after `potential`.
    pub name: Ident,
    /// The quoted title after the name.
    pub title: Option<Text>,
    /// The statements in the order of the text.
    pub statements: Vec<Statement>,
    /// Every expression of the file.
    pub arena: Arena,
}

/// A lone expression, as scene files hold them in strings.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpressionAst {
    /// The outermost expression.
    pub root: ExprId,
    /// All its parts.
    pub arena: Arena,
}

/// One statement of a potential file.
#[derive(Clone, Debug, PartialEq)]
pub enum Statement {
    /// `source "Silling 2000, eq. (1)"`
    Source(Text),
    /// `import "strains.piola"`, the names of another file, with the place of the whole statement.
    Import(Text, Span),
    /// `allow "no-bond-energy" "bonds are another file"`
    Allow(Allow),
    /// `dimensions 2, 3`: where the energy is defined.
    Dimensions(Vec<(u8, Span)>),
    /// `weights volumes`, with the place of the word: interactions weigh the product of the volumes
    /// of their points.
    Weights(Span),
    /// `parameter C = 1 in Pa, C > 0 "stiffness"`, or `state k = 0 "largest stretch so far"`
    Parameter(Parameter),
    /// `update k = max(k, l/L - 1)`
    Update(Update),
    /// `S(x) = ..` or `k = ..`
    Definition(Definition),
    /// `psi(l) = ..`
    Energy(Energy),
    /// `dissipation(l) = 1/2*eta*rate(l)^2`, of the same shape
    Dissipation(Energy),
    /// `domain l/L in (0, 10]`
    Domain(Domain),
    /// `break when l/L - 1 > s0 "critical stretch"`
    Break(Break),
}

/// A lint that is not to be reported.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Allow {
    /// The code of the lint.
    pub code: Text,
    /// Why the energy is right as it is.
    pub reason: Option<Text>,
}

/// The declaration of a parameter, or of a state: what an interaction remembers.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Whether it is a state, whose default is what interactions begin with.
    pub is_state: bool,
    /// Its name.
    pub name: Ident,
    /// How many entries a vector of them has, `parameter mu(3)`, with the place of the number.
    pub size: Option<(u32, Span)>,
    /// Default values, constant expressions: none, one for all entries, or one for each of a vector.
    pub defaults: Vec<ExprId>,
    /// Unit, if one is stated.
    pub unit: Option<Unit>,
    /// Conditions on the value, e.g. `C1 > 0`.
    pub constraints: Vec<ExprId>,
    /// What it is.
    pub description: Option<Text>,
}

/// A product of powers of named units, `J/m^(2*d+1)`; `1` is the empty product.
#[derive(Clone, Debug, PartialEq)]
pub struct Unit {
    /// The factors in order.
    pub factors: Vec<UnitFactor>,
    /// Its place.
    pub span: Span,
}

/// One factor of a unit.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitFactor {
    /// The unit's name, prefix included: `GPa`.
    pub name: Ident,
    /// Exponent; a constant expression that may hold `d`.
    pub exponent: Option<ExprId>,
    /// Whether it stands after a `/`.
    pub divided: bool,
}

/// A function (`parameters` is some) or a named value.
#[derive(Clone, Debug, PartialEq)]
pub struct Definition {
    /// Its name.
    pub name: Ident,
    /// The formal parameters of a function.
    pub parameters: Option<Vec<Ident>>,
    /// What it stands for.
    pub body: ExprId,
    /// The unit in which a named value is stated, `Y0 = 250 in MPa`.
    pub unit: Option<Unit>,
}

/// An energy density of one measure, or of values gathered over families; or a potential of how fast a
/// measure changes.
#[derive(Clone, Debug, PartialEq)]
pub struct Energy {
    /// What stands first in the parentheses of `psi(..)` or `dissipation(..)`.
    pub measure: Ident,
    /// The gathered values named behind it.
    pub gathered: Vec<Ident>,
    /// The energy, or the potential.
    pub body: ExprId,
    /// Place of what stands before `=`.
    pub head: Span,
}

/// What a state becomes.
#[derive(Clone, Debug, PartialEq)]
pub struct Update {
    /// The state.
    pub state: Ident,
    /// What counts the entries of a vector of states: `update q(k) = ..`.
    pub index: Option<Ident>,
    /// Its next value.
    pub body: ExprId,
    /// The whole statement.
    pub span: Span,
}

/// A condition under which an interaction breaks.
#[derive(Clone, Debug, PartialEq)]
pub struct Break {
    /// The condition.
    pub condition: ExprId,
    /// What it is.
    pub reason: Option<Text>,
    /// The whole statement.
    pub span: Span,
}

/// A declared interval of use.
#[derive(Clone, Debug, PartialEq)]
pub struct Domain {
    /// The quantity, e.g. `l/L`.
    pub quantity: ExprId,
    /// Lower end.
    pub lower: Bound,
    /// Upper end.
    pub upper: Bound,
    /// The whole statement.
    pub span: Span,
}

/// An end of an interval; the name `inf` stands for infinity.
#[derive(Clone, Debug, PartialEq)]
pub struct Bound {
    /// Its value, a constant expression.
    pub value: ExprId,
    /// `[` and `]` include it, `(` and `)` do not.
    pub inclusive: bool,
}
