//! A graph to Cranelift's intermediate form (CLIF), operation by operation.
//!
//! Before: a simplified graph with the roots psi, psi', psi''. After: a function
//! `fn(measure, reference, change, psi, dpsi, d2psi: *f64, count: i64)` that computes, for every entry,
//! what an order asks for. Every operation becomes the instruction, or the call of the function of `libm`, that the
//! interpreter uses, in the same order: both give the same bits.

use std::collections::HashMap;

use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::{FuncRef, InstBuilder, MemFlagsData, Value, types};
use cranelift_frontend::FunctionBuilder;

use crate::expression::power::{PowerOps, PowerPlan};
use crate::expression::{Comparison, Function, Input, Node, NodeId, Operator};
use crate::kernel::Order;
use crate::specialise::ScalarEnergy;

/// Which arguments of the function are which.
const MEASURE: usize = 0;
const REFERENCE: usize = 1;
const CHANGE: usize = 2;
const OUTPUTS: usize = 3;
const COUNT: usize = 6;

/// How many pointers come before the count.
pub(super) const POINTERS: usize = COUNT;

/// The functions of `libm` that an energy calls.
pub(super) fn called_functions(energy: &ScalarEnergy) -> Vec<Called> {
    let mut called = Vec::new();
    for (_, node) in energy.graph.nodes() {
        let function = match node {
            Node::Unary(f, _) if f.libm().is_some() => Called::Unary(f),
            Node::Binary(Operator::Power, ..) => Called::Pow,
            Node::PowerConstant(_, bits) => match PowerPlan::new(f64::from_bits(bits)) {
                PowerPlan::General(_) => Called::Pow,
                PowerPlan::Chain { .. } => continue,
            },
            _ => continue,
        };
        if !called.contains(&function) {
            called.push(function);
        }
    }
    called
}

/// A function of `libm`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Called {
    Unary(Function),
    Pow,
}

impl Called {
    /// The symbol under which the code generator knows it; never a name of the C library.
    pub(super) fn symbol(self) -> String {
        match self {
            Called::Unary(f) => format!("piola_{}", f.name()),
            Called::Pow => "piola_pow".to_string(),
        }
    }
}

/// Emits the whole function: a loop over the entries around the graph.
pub(super) fn emit(
    builder: &mut FunctionBuilder<'_>,
    energy: &ScalarEnergy,
    order: Order,
    functions: &HashMap<Called, FuncRef>,
) {
    let roots = &energy.roots[..=order as usize];
    let needed = energy.graph.reachable(roots);
    let entry = builder.create_block();
    let head = builder.create_block();
    let body = builder.create_block();
    let done = builder.create_block();
    builder.append_block_params_for_function_params(entry);
    builder.switch_to_block(entry);
    let arguments = builder.block_params(entry).to_vec();
    let zero = builder.ins().iconst(types::I64, 0);
    builder.append_block_param(head, types::I64);
    builder.ins().jump(head, &[zero.into()]);

    builder.switch_to_block(head);
    let offset = builder.block_params(head)[0];
    let eight = builder.ins().iconst(types::I64, 8);
    let end = builder.ins().imul(arguments[COUNT], eight);
    let more = builder.ins().icmp(IntCC::SignedLessThan, offset, end);
    builder.ins().brif(more, body, &[], done, &[]);

    builder.switch_to_block(body);
    let mut lowering =
        Lowering { builder, functions, arguments: &arguments, offset, values: Vec::new() };
    for (id, node) in energy.graph.nodes() {
        let value = needed[id.0 as usize].then(|| lowering.node(node));
        // What is not needed has no needed user, which would read this.
        lowering.values.push(value.unwrap_or(offset));
    }
    for (output, root) in roots.iter().enumerate() {
        lowering.store(OUTPUTS + output, *root);
    }
    let next = builder.ins().iadd(offset, eight);
    builder.ins().jump(head, &[next.into()]);

    builder.switch_to_block(done);
    builder.ins().return_(&[]);
    builder.seal_all_blocks();
}

struct Lowering<'a, 'b> {
    builder: &'a mut FunctionBuilder<'b>,
    functions: &'a HashMap<Called, FuncRef>,
    arguments: &'a [Value],
    offset: Value,
    values: Vec<Value>,
}

impl Lowering<'_, '_> {
    fn node(&mut self, node: Node) -> Value {
        let of = |x: NodeId| self.values[x.0 as usize];
        match node {
            Node::Number(bits) => self.builder.ins().f64const(f64::from_bits(bits)),
            Node::Truth(holds) => self.builder.ins().iconst(types::I8, i64::from(holds)),
            Node::Input(Input::Current(_)) => self.load(MEASURE),
            Node::Input(Input::Reference(_)) => self.load(REFERENCE),
            Node::Input(Input::Change(_)) => self.load(CHANGE),
            // Specialisation has put numbers, and accurate forms, in their place.
            Node::Input(Input::Horizon | Input::Parameter(_)) | Node::Strain(..) => {
                self.builder.ins().f64const(f64::NAN)
            }
            Node::Unary(function, x) => self.unary(function, of(x)),
            Node::PowerConstant(x, bits) => PowerPlan::new(f64::from_bits(bits)).apply(self, of(x)),
            Node::Binary(operator, x, y) => self.binary(operator, of(x), of(y)),
            Node::Compare(comparison, x, y) => {
                let condition = match comparison {
                    Comparison::Equal => FloatCC::Equal,
                    Comparison::NotEqual => FloatCC::NotEqual,
                    Comparison::Less => FloatCC::LessThan,
                    Comparison::LessEqual => FloatCC::LessThanOrEqual,
                    Comparison::Greater => FloatCC::GreaterThan,
                    Comparison::GreaterEqual => FloatCC::GreaterThanOrEqual,
                };
                self.builder.ins().fcmp(condition, of(x), of(y))
            }
            Node::And(x, y) => self.builder.ins().band(of(x), of(y)),
            Node::Or(x, y) => self.builder.ins().bor(of(x), of(y)),
            Node::Not(x) => {
                let one = self.builder.ins().iconst(types::I8, 1);
                self.builder.ins().bxor(of(x), one)
            }
            Node::Select(c, x, y) => self.builder.ins().select(of(c), of(x), of(y)),
        }
    }

    fn unary(&mut self, function: Function, x: Value) -> Value {
        match function {
            Function::Negate => self.builder.ins().fneg(x),
            Function::Abs => self.builder.ins().fabs(x),
            Function::Sqrt => self.builder.ins().sqrt(x),
            Function::Sign => {
                // Zeros and non-numbers stay what they are.
                let zero = self.builder.ins().f64const(0.0);
                let one = self.builder.ins().f64const(1.0);
                let minus_one = self.builder.ins().f64const(-1.0);
                let below = self.builder.ins().fcmp(FloatCC::LessThan, x, zero);
                let above = self.builder.ins().fcmp(FloatCC::GreaterThan, x, zero);
                let rest = self.builder.ins().select(below, minus_one, x);
                self.builder.ins().select(above, one, rest)
            }
            called => self.call(Called::Unary(called), &[x]),
        }
    }

    fn binary(&mut self, operator: Operator, x: Value, y: Value) -> Value {
        match operator {
            Operator::Add => self.builder.ins().fadd(x, y),
            Operator::Subtract => self.builder.ins().fsub(x, y),
            Operator::Multiply => self.builder.ins().fmul(x, y),
            Operator::Divide => self.builder.ins().fdiv(x, y),
            Operator::Power => self.call(Called::Pow, &[x, y]),
            Operator::Min => self.builder.ins().fmin(x, y),
            Operator::Max => self.builder.ins().fmax(x, y),
        }
    }

    fn call(&mut self, called: Called, arguments: &[Value]) -> Value {
        let call = self.builder.ins().call(self.functions[&called], arguments);
        self.builder.inst_results(call)[0]
    }

    fn address(&mut self, argument: usize) -> Value {
        self.builder.ins().iadd(self.arguments[argument], self.offset)
    }

    fn load(&mut self, argument: usize) -> Value {
        let address = self.address(argument);
        let flags = MemFlagsData::new().with_notrap().with_readonly();
        self.builder.ins().load(types::F64, flags, address, 0)
    }

    fn store(&mut self, argument: usize, root: NodeId) {
        let address = self.address(argument);
        let value = self.values[root.0 as usize];
        self.builder.ins().store(MemFlagsData::new().with_notrap(), value, address, 0);
    }
}

impl PowerOps for Lowering<'_, '_> {
    type Value = Value;
    fn one(&mut self) -> Value {
        self.builder.ins().f64const(1.0)
    }
    fn multiply(&mut self, x: Value, y: Value) -> Value {
        self.builder.ins().fmul(x, y)
    }
    fn reciprocal(&mut self, x: Value) -> Value {
        let one = self.builder.ins().f64const(1.0);
        self.builder.ins().fdiv(one, x)
    }
    fn sqrt(&mut self, x: Value) -> Value {
        self.builder.ins().sqrt(x)
    }
    fn pow(&mut self, x: Value, c: f64) -> Value {
        let exponent = self.builder.ins().f64const(c);
        self.call(Called::Pow, &[x, exponent])
    }
}
