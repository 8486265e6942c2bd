//! From a checked tree to numbers and tensors. The checker has refused what has no meaning: what is
//! refused here has one, but not in tensors.

use rustc_hash::FxHashMap;

use piola_grammar::Ast;
use piola_grammar::ast::{BinaryOperator, ExprId, ExprKind, Ident, Statement, UnaryOperator};

use super::NotInTensors;
use super::algebra::{Algebra, Factor, Tensor, transposed};
use crate::check::{
    self, Elaborator, Kinematic, Meaning, Symbol, Symbols, TensorFunction, meaning,
};
use crate::expression::{Function, Input, Node, NodeId, Operator};

/// Most expressions that are looked at, those of called functions included.
const MAX_VISITS: usize = 20_000;

/// An energy that was read.
pub(super) struct Read {
    pub(super) algebra: Algebra,
    pub(super) psi: NodeId,
    pub(super) named: Vec<(NodeId, String)>,
}

/// Reads the sum of the energies of `F`; `fold` gives values to parameters.
pub(super) fn energy(
    ast: &Ast,
    dimension: usize,
    fold: &dyn Fn(Input) -> Option<f64>,
) -> Result<Read, NotInTensors> {
    let (symbols, _) = check::resolve(ast);
    let mut reader = Reader {
        ast,
        symbols: &symbols,
        fold,
        algebra: Algebra::new(dimension),
        values: FxHashMap::default(),
        named: Vec::new(),
        visits: 0,
    };
    let mut psi = reader.algebra.graph.number(0.0)?;
    for statement in &ast.statements {
        let Statement::Energy(energy) = statement else { continue };
        if energy.measure.name == "F" && energy.gathered.is_empty() {
            let part = reader.body(energy.body, &[])?.number()?;
            psi = reader.algebra.operation(Operator::Add, psi, part)?;
        }
    }
    Ok(Read { algebra: reader.algebra, psi, named: reader.named })
}

/// What an expression is.
#[derive(Clone, Debug)]
enum Value {
    Number(NodeId),
    Truth(NodeId),
    Tensor(Tensor),
    /// A function of `U`, by what it makes of a principal stretch.
    OfStretch(NodeId),
}

impl Value {
    fn number(self) -> Result<NodeId, NotInTensors> {
        match self {
            Value::Number(node) => Ok(node),
            _ => Err(NotInTensors::Foreign),
        }
    }

    fn truth(self) -> Result<NodeId, NotInTensors> {
        match self {
            Value::Truth(node) => Ok(node),
            _ => Err(NotInTensors::Foreign),
        }
    }

    fn tensor(self) -> Result<Tensor, NotInTensors> {
        match self {
            Value::Tensor(tensor) => Ok(tensor),
            _ => Err(NotInTensors::Foreign),
        }
    }
}

type Reading = Result<Value, NotInTensors>;

struct Reader<'a> {
    ast: &'a Ast,
    symbols: &'a Symbols<'a>,
    fold: &'a dyn Fn(Input) -> Option<f64>,
    algebra: Algebra,
    /// Of definitions, by the number of their statement.
    values: FxHashMap<usize, Value>,
    named: Vec<(NodeId, String)>,
    visits: usize,
}

/// Formal parameters of a function and what they stand for.
type Arguments<'b> = &'b [(&'b Ident, Value)];

impl<'a> Reader<'a> {
    fn body(&mut self, root: ExprId, arguments: Arguments<'_>) -> Reading {
        let parts = check::parts(&self.ast.arena, root);
        self.visits += parts.len();
        if self.visits > MAX_VISITS {
            return Err(NotInTensors::TooLong);
        }
        // What is refused counts only where it is used: an `if` on `d` may leave it out.
        let mut values: FxHashMap<ExprId, Reading> = FxHashMap::default();
        for id in parts {
            let value = self.expression(id, &values, arguments);
            values.insert(id, value);
        }
        values.remove(&root).unwrap_or(Err(NotInTensors::Foreign))
    }

    fn expression(
        &mut self,
        id: ExprId,
        values: &FxHashMap<ExprId, Reading>,
        arguments: Arguments<'_>,
    ) -> Reading {
        let of = |x: &ExprId| values.get(x).cloned().unwrap_or(Err(NotInTensors::Foreign));
        let ast: &'a Ast = self.ast;
        match &ast.arena[id].kind {
            ExprKind::Number(x) => Ok(Value::Number(self.algebra.graph.number(*x)?)),
            ExprKind::Name(name) => self.name(name, arguments),
            ExprKind::Unary { operator: UnaryOperator::Not, operand } => {
                let condition = of(operand)?.truth()?;
                Ok(Value::Truth(self.algebra.graph.make(Node::Not(condition))?))
            }
            ExprKind::Unary { operator: UnaryOperator::Negate, operand } => match of(operand)? {
                Value::Tensor(x) => Ok(Value::Tensor(self.algebra.scaled_by(&x, -1.0)?)),
                Value::OfStretch(x) => Ok(Value::OfStretch(self.algebra.graph.negate(x)?)),
                x => Ok(Value::Number(self.algebra.graph.negate(x.number()?)?)),
            },
            ExprKind::Unary { operator: UnaryOperator::Transpose, operand } => match of(operand)? {
                Value::Tensor(x) => Ok(Value::Tensor(transposed(&x))),
                symmetric => Ok(symmetric),
            },
            ExprKind::Binary { operator, left, right } => {
                self.binary(*operator, of(left)?, of(right)?)
            }
            ExprKind::If { condition, then, otherwise } => {
                let condition = of(condition)?.truth()?;
                match self.algebra.graph.graph()[condition] {
                    Node::Truth(true) => of(then),
                    Node::Truth(false) => of(otherwise),
                    _ => self.choice(condition, of(then)?, of(otherwise)?),
                }
            }
            // A reader has the points before him.
            ExprKind::Table { .. } => Err(NotInTensors::Table),
            ExprKind::Call { function, arguments: given } => {
                let actual: Result<Vec<Value>, _> = given.iter().map(of).collect();
                self.call(&function.name, actual?)
            }
        }
    }

    fn name(&mut self, name: &str, arguments: Arguments<'_>) -> Reading {
        if let Some((_, value)) = arguments.iter().find(|(formal, _)| formal.name == name) {
            return Ok(value.clone());
        }
        let dimension = self.algebra.dimension as f64;
        match self.symbols.get(name).ok_or(NotInTensors::Foreign)? {
            Symbol::Dimension => Ok(Value::Number(self.algebra.graph.number(dimension)?)),
            Symbol::Pi => Ok(Value::Number(self.algebra.graph.number(std::f64::consts::PI)?)),
            Symbol::Horizon => self.input(Input::Horizon),
            Symbol::Parameter(i) | Symbol::TimeStep(i) => self.input(Input::Parameter(i as u16)),
            Symbol::Kinematic(which) => self.kinematic(which),
            Symbol::Value(number) => self.definition(number, name),
            Symbol::Current(_)
            | Symbol::Reference(_)
            | Symbol::Bond(_)
            | Symbol::BondNow(_)
            | Symbol::Part(_)
            | Symbol::PartAtRest(_)
            | Symbol::Function(_) => Err(NotInTensors::Foreign),
        }
    }

    fn input(&mut self, input: Input) -> Reading {
        let graph = &mut self.algebra.graph;
        Ok(Value::Number(match (self.fold)(input) {
            Some(value) => graph.number(value)?,
            None => graph.input(input)?,
        }))
    }

    fn kinematic(&mut self, which: Kinematic) -> Reading {
        let word = match which {
            Kinematic::Jacobian => return Ok(Value::Number(self.algebra.jacobian()?)),
            Kinematic::Stretch => {
                return Ok(Value::OfStretch(self.algebra.graph.input(Input::Stretch(0))?));
            }
            Kinematic::Identity => Vec::new(),
            Kinematic::Gradient => vec![Factor::Gradient],
            Kinematic::CauchyGreen => vec![Factor::CauchyGreen],
            Kinematic::Strain => vec![Factor::Strain],
        };
        Ok(Value::Tensor(self.algebra.letters(word)?))
    }

    fn definition(&mut self, number: usize, name: &str) -> Reading {
        if let Some(known) = self.values.get(&number) {
            return Ok(known.clone());
        }
        let ast: &'a Ast = self.ast;
        let Statement::Definition(definition) = &ast.statements[number] else {
            return Err(NotInTensors::Foreign);
        };
        let mut value = self.body(definition.body, &[])?;
        if let Some(unit) = &definition.unit {
            let d = self.algebra.dimension;
            let mut units = Elaborator::new(&ast.arena, Some(ast), self.symbols, d, false);
            let scale = units.unit(unit).ok_or(NotInTensors::Foreign)?.scale;
            let scale = self.algebra.graph.number(scale)?;
            value = Value::Number(self.algebra.graph.multiply(value.number()?, scale)?);
        }
        if let Value::Number(node) = value {
            let given = matches!(
                self.algebra.graph.graph()[node],
                Node::Number(_) | Node::Input(Input::Parameter(_) | Input::Horizon)
            );
            let is_jacobian = self.algebra.jacobian()? == node;
            if !given && !is_jacobian && self.named.iter().all(|(known, _)| *known != node) {
                self.named.push((node, name.to_string()));
            }
        }
        self.values.insert(number, value.clone());
        Ok(value)
    }

    fn choice(&mut self, condition: NodeId, x: Value, y: Value) -> Reading {
        let select = |x, y| Node::Select(condition, x, y);
        match (x, y) {
            (Value::Number(x), Value::Number(y)) => {
                Ok(Value::Number(self.algebra.graph.make(select(x, y))?))
            }
            (Value::Truth(x), Value::Truth(y)) => {
                Ok(Value::Truth(self.algebra.graph.make(select(x, y))?))
            }
            _ => Err(NotInTensors::Choice),
        }
    }

    fn binary(&mut self, operator: BinaryOperator, x: Value, y: Value) -> Reading {
        let graph = &mut self.algebra.graph;
        match meaning(operator) {
            Meaning::And => Ok(Value::Truth(graph.make(Node::And(x.truth()?, y.truth()?))?)),
            Meaning::Or => Ok(Value::Truth(graph.make(Node::Or(x.truth()?, y.truth()?))?)),
            Meaning::Comparison(comparison) => {
                let node = Node::Compare(comparison, x.number()?, y.number()?);
                Ok(Value::Truth(graph.make(node)?))
            }
            Meaning::Contraction => self.contraction(x, y),
            Meaning::Number(operator) => match (x, y) {
                (Value::Number(x), Value::Number(y)) => {
                    Ok(Value::Number(self.algebra.operation(operator, x, y)?))
                }
                (x @ Value::OfStretch(_), y) | (x, y @ Value::OfStretch(_)) => {
                    let (x, y) = (self.of_stretch(x)?, self.of_stretch(y)?);
                    Ok(Value::OfStretch(self.algebra.operation(operator, x, y)?))
                }
                (x, y) => Ok(Value::Tensor(self.of_tensors(operator, x, y)?)),
            },
        }
    }

    /// Sums, products, quotients and powers of which at least one operand is a tensor.
    fn of_tensors(
        &mut self,
        operator: Operator,
        x: Value,
        y: Value,
    ) -> Result<Tensor, NotInTensors> {
        let algebra = &mut self.algebra;
        match (operator, x, y) {
            (Operator::Add, Value::Tensor(x), Value::Tensor(y)) => algebra.sum(&x, &y),
            (Operator::Subtract, Value::Tensor(x), Value::Tensor(y)) => {
                let y = algebra.scaled_by(&y, -1.0)?;
                algebra.sum(&x, &y)
            }
            (Operator::Multiply, Value::Tensor(x), Value::Tensor(y)) => algebra.product(&x, &y),
            (Operator::Multiply, Value::Tensor(x), Value::Number(by))
            | (Operator::Multiply, Value::Number(by), Value::Tensor(x)) => algebra.scaled(&x, by),
            (Operator::Divide, Value::Tensor(x), Value::Number(by)) => {
                let one = algebra.graph.number(1.0)?;
                let by = algebra.graph.divide(one, by)?;
                algebra.scaled(&x, by)
            }
            (Operator::Power, Value::Tensor(x), Value::Number(exponent)) => {
                let exponent = algebra.graph.graph().as_number(exponent);
                let n = exponent.ok_or(NotInTensors::Foreign)? as usize;
                let mut power = x.clone();
                for _ in 1..n {
                    power = algebra.product(&power, &x)?;
                }
                Ok(power)
            }
            _ => Err(NotInTensors::Foreign),
        }
    }

    /// A number, or a known multiple of the unit tensor, as a function of `U`.
    fn of_stretch(&self, x: Value) -> Result<NodeId, NotInTensors> {
        match x {
            Value::Number(node) | Value::OfStretch(node) => Ok(node),
            Value::Tensor(tensor) => match &tensor[..] {
                [term] if term.word.is_empty() => Ok(term.coefficient),
                _ => Err(NotInTensors::Foreign),
            },
            Value::Truth(_) => Err(NotInTensors::Foreign),
        }
    }

    fn contraction(&mut self, x: Value, y: Value) -> Reading {
        if matches!(x, Value::OfStretch(_)) || matches!(y, Value::OfStretch(_)) {
            let (x, y) = (self.of_stretch(x)?, self.of_stretch(y)?);
            let product = self.algebra.graph.multiply(x, y)?;
            return Ok(Value::Number(self.algebra.trace_of_stretch(product)?));
        }
        let (x, y) = (transposed(&x.tensor()?), y.tensor()?);
        let product = self.algebra.product(&x, &y)?;
        Ok(Value::Number(self.algebra.trace(&product)?))
    }

    fn call(&mut self, name: &str, actual: Vec<Value>) -> Reading {
        if let Some(Symbol::Function(number)) = self.symbols.get(name) {
            let ast: &'a Ast = self.ast;
            let Statement::Definition(definition) = &ast.statements[number] else {
                return Err(NotInTensors::Foreign);
            };
            let formals = definition.parameters.as_deref().unwrap_or(&[]);
            let arguments: Vec<(&Ident, Value)> = formals.iter().zip(actual).collect();
            return self.body(definition.body, &arguments);
        }
        if let Some(function) = Function::named(name) {
            return match actual.into_iter().next() {
                Some(Value::OfStretch(x)) => {
                    Ok(Value::OfStretch(self.algebra.graph.unary(function, x)?))
                }
                Some(Value::Number(x)) => Ok(Value::Number(self.algebra.graph.unary(function, x)?)),
                _ => Err(NotInTensors::Foreign),
            };
        }
        if let Some(function) = TensorFunction::named(name) {
            return self.tensor_call(function, actual);
        }
        let Some(operator) = Operator::named(name) else { return Err(NotInTensors::Foreign) };
        let mut numbers = Vec::new();
        for value in actual {
            numbers.push(value.number()?);
        }
        let mut rest = numbers.into_iter();
        let mut result = rest.next().ok_or(NotInTensors::Foreign)?;
        for number in rest {
            result = self.algebra.operation(operator, result, number)?;
        }
        Ok(Value::Number(result))
    }

    fn tensor_call(&mut self, function: TensorFunction, actual: Vec<Value>) -> Reading {
        let algebra = &mut self.algebra;
        if function == TensorFunction::Dyad {
            let mut vector = Vec::new();
            for value in actual {
                vector.push(value.number()?);
            }
            let varies = |x: &NodeId| {
                let of_gradient = |input| matches!(input, Input::Variable(_));
                super::algebra::depends(algebra.graph.graph(), *x, of_gradient)
            };
            if vector.iter().any(varies) {
                return Err(NotInTensors::VaryingVector);
            }
            return Ok(Value::Tensor(algebra.dyad(vector)?));
        }
        let x = actual.into_iter().next().ok_or(NotInTensors::Foreign)?;
        if let Value::OfStretch(x) = x {
            return match function {
                TensorFunction::Trace => Ok(Value::Number(algebra.trace_of_stretch(x)?)),
                TensorFunction::Inverse => {
                    let one = algebra.graph.number(1.0)?;
                    Ok(Value::OfStretch(algebra.graph.divide(one, x)?))
                }
                TensorFunction::Symmetric => Ok(Value::OfStretch(x)),
                _ => Err(NotInTensors::Foreign),
            };
        }
        let x = x.tensor()?;
        Ok(match function {
            TensorFunction::Trace => Value::Number(algebra.trace(&x)?),
            TensorFunction::Determinant => Value::Number(algebra.determinant(&x)?),
            TensorFunction::Inverse => Value::Tensor(algebra.inverse(&x)?),
            TensorFunction::Deviator => Value::Tensor(algebra.deviator(&x)?),
            TensorFunction::Symmetric => Value::Tensor(algebra.symmetric(&x)?),
            TensorFunction::Dyad | TensorFunction::Vector | TensorFunction::Norm => {
                return Err(NotInTensors::Foreign);
            }
        })
    }
}
