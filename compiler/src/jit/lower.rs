//! A graph to Cranelift's intermediate form (CLIF), operation by operation.
//!
//! Before: a simplified graph with its roots. After: a function
//! `fn(inputs: **f64, outputs: **f64, count: i64)` with one array for each input and each root, which
//! computes every entry of the outputs; `count` is not 1. Two entries stand side by side. Every operation becomes
//! the instruction, or the call of the function of `libm` for each entry, that the interpreter uses,
//! in the same order: both give the same bits. At the fast level some functions are code of their own.
//!
//! What only one side of a choice needs is skipped if neither entry takes that side.

use std::collections::HashMap;

use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::{
    Block, FuncRef, GlobalValue, InstBuilder, MemFlagsData, StackSlotData, StackSlotKind, Value,
    types,
};
use cranelift_frontend::{FunctionBuilder, Variable};
use rustc_hash::FxHashMap;

use super::called::Called;
use super::elementary::{Double, Partial};
use super::lanes::{LANES, Lanes};
use super::powers::{Share, shares};
use super::region::{ALWAYS, Regions};
use crate::expression::power::{PowerOps, PowerPlan};
use crate::expression::{Comparison, Function, Input, Node, NodeId, Operator};
use crate::program::Program;

/// Which arguments of the function are which.
const INPUTS: usize = 0;
const OUTPUTS: usize = 1;
const COUNT: usize = 2;

/// How many pointers come before the count.
pub(super) const POINTERS: usize = COUNT;

/// Bytes of a number, and of what stands side by side.
const SIZE: i64 = 8;
const STEP: i64 = LANES * SIZE;

/// What the code of a kernel refers to.
pub(super) struct Linked {
    /// The functions that are called.
    pub(super) functions: HashMap<Called, FuncRef>,
    /// At the fast level, what inlined functions need.
    pub(super) fast: Option<Fast>,
}

/// What inlined functions need.
pub(super) struct Fast {
    /// The same program at the strict level, for all outputs.
    pub(super) strict: FuncRef,
    /// How many outputs that has.
    pub(super) n_outputs: usize,
    /// Which of them is the first output of this function.
    pub(super) first: usize,
    /// The table of logarithms.
    pub(super) logarithms: GlobalValue,
    /// The constants of this function.
    pub(super) pool: GlobalValue,
    /// Whether the processor multiplies and adds with one rounding.
    pub(super) fma: bool,
}

/// Emits the whole function: a loop over the entries, two at a time, around the graph. Gives back the
/// constants of its pool.
pub(super) fn emit(
    builder: &mut FunctionBuilder<'_>,
    program: Program<'_>,
    linked: &Linked,
) -> Vec<u64> {
    let Program { graph, inputs, roots } = program;
    let entry = builder.create_block();
    let [head, body, done] = [(); 3].map(|()| builder.create_block());
    builder.append_block_params_for_function_params(entry);
    builder.switch_to_block(entry);
    let arguments = builder.block_params(entry).to_vec();
    let flags = MemFlagsData::trusted().with_readonly();
    let mut arrays = |table: usize, n: usize| -> Vec<Value> {
        let array = |k| builder.ins().load(types::I64, flags, arguments[table], k as i32 * 8);
        (0..n).map(array).collect()
    };
    let (sources, targets) = (arrays(INPUTS, inputs.len()), arrays(OUTPUTS, roots.len()));
    let end = builder.ins().imul_imm_s(arguments[COUNT], SIZE);
    let last = builder.ins().iadd_imm_s(end, -STEP);
    let zero = builder.ins().iconst(types::I64, 0);
    builder.append_block_param(head, types::I64);
    builder.ins().jump(head, &[zero.into()]);

    builder.switch_to_block(head);
    let next = builder.block_params(head)[0];
    let more = builder.ins().icmp(IntCC::SignedLessThan, next, end);
    builder.ins().brif(more, body, &[], done, &[]);

    builder.switch_to_block(body);
    // Of an odd number the last two entries are worked out together: one of them twice, which changes
    // nothing, because inputs and outputs are apart.
    let offset = builder.ins().smin(next, last);
    // What does not depend on the entry would be hoisted: see `Lanes::constant`.
    let pool = linked.fast.as_ref().map(|fast| {
        let pool = builder.ins().symbol_value(types::I64, fast.pool);
        let by = builder.ins().iconst(types::I64, 63);
        let zero = builder.ins().sshr(offset, by);
        builder.ins().iadd(pool, zero)
    });
    let fma = linked.fast.as_ref().is_some_and(|fast| fast.fma);
    let mut lowering = Lowering {
        lanes: Lanes { builder, fma, pool, constants: Vec::new() },
        program,
        regions: Regions::new(graph, roots),
        shares: linked.fast.as_ref().map_or_else(FxHashMap::default, |_| shares(graph)),
        linked,
        sources: &sources,
        targets: &targets,
        offset,
        values: vec![None; graph.len()],
        taken: None,
        holds: None,
        shared: Shared::default(),
    };
    lowering.start();
    lowering.region(ALWAYS);
    for (output, root) in roots.iter().enumerate() {
        lowering.store(output, *root);
    }
    lowering.finish();
    let constants = lowering.lanes.constants;
    let next = builder.ins().iadd_imm_s(offset, STEP);
    builder.ins().jump(head, &[next.into()]);

    builder.switch_to_block(done);
    builder.ins().return_(&[]);
    builder.seal_all_blocks();
    constants
}

struct Lowering<'a, 'b> {
    lanes: Lanes<'a, 'b>,
    program: Program<'a>,
    regions: Regions,
    shares: FxHashMap<NodeId, Share>,
    linked: &'a Linked,
    /// The arrays of the inputs and of the outputs.
    sources: &'a [Value],
    targets: &'a [Value],
    offset: Value,
    values: Vec<Option<Value>>,
    /// The mask of the entries that need the region being emitted, unless all do.
    taken: Option<Value>,
    /// The mask of the entries for which every inlined function holds; none if there is none.
    holds: Option<Variable>,
    shared: Shared,
}

/// What inlined functions leave for others of the same number, in the regions around.
#[derive(Default)]
struct Shared {
    /// Numbers and their logarithms.
    logarithms: Vec<(Value, Double)>,
    /// Numbers, exponents and powers.
    powers: Vec<(Value, f64, Value)>,
}

impl Lowering<'_, '_> {
    fn start(&mut self) {
        let graph = self.program.graph;
        let inlined = |id: NodeId| Called::of(graph[id]).is_some_and(Called::is_inlined);
        if self.linked.fast.is_some() && self.regions.all().any(inlined) {
            let holds = self.lanes.builder.declare_var(types::I64X2);
            let all = self.lanes.truth(true);
            self.lanes.builder.def_var(holds, all);
            self.holds = Some(holds);
        }
    }

    /// Emits the operations of a region and of the regions in it.
    fn region(&mut self, region: usize) {
        for place in 0..self.regions.nodes(region).len() {
            let id = self.regions.nodes(region)[place];
            let value = match self.program.graph[id] {
                Node::Select(condition, x, y) => self.choice(id, [condition, x, y]),
                Node::PowerConstant(x, _) if self.shares.contains_key(&id) => {
                    self.shared_power(self.value(x), self.shares[&id])
                }
                node => self.node(node),
            };
            self.values[id.0 as usize] = Some(value);
        }
    }

    fn value(&self, id: NodeId) -> Value {
        self.values[id.0 as usize].expect("operands are emitted before their users")
    }

    fn is_truth(&self, mut id: NodeId) -> bool {
        loop {
            match self.program.graph[id] {
                Node::Select(_, x, _) => id = x,
                Node::Truth(_)
                | Node::Compare(..)
                | Node::And(..)
                | Node::Or(..)
                | Node::Not(_) => {
                    return true;
                }
                _ => return false,
            }
        }
    }

    fn node(&mut self, node: Node) -> Value {
        let of = |x: NodeId| self.value(x);
        match node {
            Node::Number(bits) => self.lanes.number(f64::from_bits(bits)),
            Node::Truth(holds) => self.lanes.truth(holds),
            Node::Input(input) => self.load(input),
            // Specialisation has put accurate forms in its place.
            Node::Strain(..) => self.lanes.number(f64::NAN),
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
                let (x, y) = (of(x), of(y));
                self.lanes.compare(condition, x, y)
            }
            Node::And(x, y) => {
                let (x, y) = (of(x), of(y));
                self.lanes.builder.ins().band(x, y)
            }
            Node::Or(x, y) => {
                let (x, y) = (of(x), of(y));
                self.lanes.builder.ins().bor(x, y)
            }
            Node::Not(x) => {
                let x = of(x);
                self.lanes.builder.ins().bnot(x)
            }
            Node::Select(condition, x, y) => {
                let (condition, x, y) = (of(condition), of(x), of(y));
                self.lanes.choose(condition, x, y)
            }
        }
    }

    /// `if condition then x else y`: a side of its own is skipped where neither entry takes it.
    fn choice(&mut self, id: NodeId, [condition, x, y]: [NodeId; 3]) -> Value {
        let sides = self.regions.sides(id);
        if sides == [None; 2] {
            return self.node(self.program.graph[id]);
        }
        let mask = self.value(condition);
        let set = self.lanes.lanes_set(mask);
        let x = match sides[0] {
            None => self.value(x),
            Some(region) => {
                // Stands in for a side that no entry takes.
                let nothing = if self.is_truth(x) { mask } else { self.lanes.as_numbers(mask) };
                self.skipped_if(set, 0, nothing, |lowering| {
                    lowering.side(region, mask);
                    lowering.value(x)
                })
            }
        };
        if sides[1].is_none() {
            let y = self.value(y);
            return self.lanes.choose(mask, x, y);
        }
        self.skipped_if(set, (1 << LANES) - 1, x, |lowering| {
            if let Some(region) = sides[1] {
                let other = lowering.lanes.builder.ins().bnot(mask);
                lowering.side(region, other);
            }
            let y = lowering.value(y);
            lowering.lanes.choose(mask, x, y)
        })
    }

    /// `otherwise` if `number` is as given, else what `emit` makes; both are of one type.
    fn skipped_if(
        &mut self,
        number: Value,
        given: i64,
        otherwise: Value,
        emit: impl FnOnce(&mut Self) -> Value,
    ) -> Value {
        let [inside, after] = [(); 2].map(|()| self.lanes.builder.create_block());
        let made = self.lanes.builder.func.dfg.value_type(otherwise);
        let result = self.lanes.builder.append_block_param(after, made);
        self.lanes.branch_if(number, given, (after, &[otherwise]), (inside, &[]));
        self.lanes.builder.switch_to_block(inside);
        let value = emit(self);
        self.lanes.builder.ins().jump(after, &[value.into()]);
        self.lanes.builder.switch_to_block(after);
        result
    }

    /// A region that only the entries of a mask need.
    fn side(&mut self, region: usize, mask: Value) {
        let around = self.taken;
        self.taken = Some(match around {
            None => mask,
            Some(around) => self.lanes.builder.ins().band(around, mask),
        });
        let shared = (self.shared.logarithms.len(), self.shared.powers.len());
        self.region(region);
        self.shared.logarithms.truncate(shared.0);
        self.shared.powers.truncate(shared.1);
        self.taken = around;
    }

    fn unary(&mut self, function: Function, x: Value) -> Value {
        match function {
            Function::Negate => self.lanes.builder.ins().fneg(x),
            Function::Abs => self.lanes.builder.ins().fabs(x),
            Function::Sqrt => self.lanes.builder.ins().sqrt(x),
            Function::Sign => {
                // Zeros and non-numbers stay what they are.
                let [zero, one, minus_one] = [0.0, 1.0, -1.0].map(|x| self.lanes.number(x));
                let below = self.lanes.compare(FloatCC::LessThan, x, zero);
                let above = self.lanes.compare(FloatCC::GreaterThan, x, zero);
                let rest = self.lanes.choose(below, minus_one, x);
                self.lanes.choose(above, one, rest)
            }
            called => self.call(Called::Unary(called), &[x]),
        }
    }

    fn binary(&mut self, operator: Operator, x: Value, y: Value) -> Value {
        let ins = self.lanes.builder.ins();
        match operator {
            Operator::Add => ins.fadd(x, y),
            Operator::Subtract => ins.fsub(x, y),
            Operator::Multiply => ins.fmul(x, y),
            Operator::Divide => ins.fdiv(x, y),
            Operator::Power => self.call(Called::Pow, &[x, y]),
            Operator::Min => ins.fmin(x, y),
            Operator::Max => ins.fmax(x, y),
            Operator::Atan2 => self.call(Called::Atan2, &[x, y]),
        }
    }

    /// An elementary function: inlined, or called for one entry after the other.
    fn call(&mut self, called: Called, arguments: &[Value]) -> Value {
        if let Some(value) = self.inlined(called, arguments) {
            return value;
        }
        let function = self.linked.functions[&called];
        let results = [0, 1].map(|lane| {
            let arguments: Vec<Value> =
                arguments.iter().map(|x| self.lanes.lane(*x, lane)).collect();
            let call = self.lanes.builder.ins().call(function, &arguments);
            self.lanes.builder.inst_results(call)[0]
        });
        self.lanes.join(results)
    }

    fn inlined(&mut self, called: Called, arguments: &[Value]) -> Option<Value> {
        let fast = self.linked.fast.as_ref()?;
        let table = self.lanes.builder.ins().symbol_value(types::I64, fast.logarithms);
        let x = arguments[0];
        let partial = match called {
            Called::Pow => {
                let logarithm = self.logarithm(table, x);
                self.lanes.power(logarithm, arguments[1])
            }
            Called::Unary(function) => self.lanes.elementary(function, table, x)?,
            Called::Atan2 => return None,
        };
        Some(self.noted(partial))
    }

    fn logarithm(&mut self, table: Value, x: Value) -> Double {
        if let Some((_, known)) = self.shared.logarithms.iter().find(|(of, _)| *of == x) {
            return *known;
        }
        let (logarithm, holds) = self.lanes.logarithm(table, x);
        self.noted(Partial { value: logarithm.high, holds });
        self.shared.logarithms.push((x, logarithm));
        logarithm
    }

    /// A power that may share its elementary functions with others of the same base.
    fn shared_power(&mut self, x: Value, Share { exponent, steps }: Share) -> Value {
        let same = |&&(base, c, _): &&(Value, f64, Value)| base == x && c == exponent;
        let known = self.shared.powers.iter().find(same).map(|(.., power)| *power);
        let mut power = known.unwrap_or_else(|| {
            let c = self.lanes.number(exponent);
            let power = self.call(Called::Pow, &[x, c]);
            self.shared.powers.push((x, exponent, power));
            power
        });
        for _ in 0..steps.abs() {
            power = match steps > 0 {
                true => self.lanes.builder.ins().fmul(power, x),
                false => self.lanes.builder.ins().fdiv(power, x),
            };
        }
        power
    }

    /// The value of an inlined function; entries that need it, and for which it does not hold, are
    /// remembered.
    fn noted(&mut self, Partial { value, mut holds }: Partial) -> Value {
        if let Some(taken) = self.taken {
            let idle = self.lanes.builder.ins().bnot(taken);
            holds = self.lanes.builder.ins().bor(holds, idle);
        }
        if let Some(all) = self.holds {
            let before = self.lanes.builder.use_var(all);
            let both = self.lanes.builder.ins().band(before, holds);
            self.lanes.builder.def_var(all, both);
        }
        value
    }

    /// Entries for which an inlined function does not hold take the results of the strict level. So the
    /// results of an entry never depend on the one beside it.
    fn finish(&mut self) {
        let (Some(holds), Some(fast)) = (self.holds, &self.linked.fast) else { return };
        let holds = self.lanes.builder.use_var(holds);
        let set = self.lanes.lanes_set(holds);
        let [again, after] = [(); 2].map(|()| self.lanes.builder.create_block());
        self.lanes.branch_if(set, (1 << LANES) - 1, (after, &[]), (again, &[]));
        self.lanes.builder.set_cold_block(again);
        self.lanes.builder.switch_to_block(again);
        self.repeat(fast, holds, after);
        self.lanes.builder.switch_to_block(after);
    }

    /// Overwrites the entries outside the mask by the strict level's.
    fn repeat(&mut self, fast: &Fast, holds: Value, after: Block) {
        let inputs: Vec<Value> = self.sources.iter().map(|array| self.address(*array)).collect();
        let slots: Vec<Value> = (0..fast.n_outputs).map(|_| self.room(STEP)).collect();
        let tables = [self.table(&inputs), self.table(&slots)];
        let count = self.lanes.builder.ins().iconst(types::I64, LANES);
        self.lanes.builder.ins().call(fast.strict, &[tables[0], tables[1], count]);
        let flags = MemFlagsData::new().with_notrap();
        for (&target, &slot) in self.targets.iter().zip(&slots[fast.first..]) {
            let address = self.address(target);
            let fast = self.lanes.builder.ins().load(types::F64X2, flags, address, 0);
            let exact = self.lanes.builder.ins().load(types::F64X2, flags, slot, 0);
            let value = self.lanes.choose(holds, fast, exact);
            self.lanes.builder.ins().store(flags, value, address, 0);
        }
        self.lanes.builder.ins().jump(after, &[]);
    }

    /// The address of that many bytes on the stack.
    fn room(&mut self, bytes: i64) -> Value {
        let data = StackSlotData::new(StackSlotKind::ExplicitSlot, bytes as u32, 4);
        let slot = self.lanes.builder.create_sized_stack_slot(data);
        self.lanes.builder.ins().stack_addr(types::I64, slot, 0)
    }

    /// The address of a table of addresses.
    fn table(&mut self, addresses: &[Value]) -> Value {
        let table = self.room(SIZE * addresses.len() as i64);
        for (k, &address) in addresses.iter().enumerate() {
            let place = k as i32 * SIZE as i32;
            self.lanes.builder.ins().store(MemFlagsData::trusted(), address, table, place);
        }
        table
    }

    /// The address of the entries of an array that are worked out.
    fn address(&mut self, array: Value) -> Value {
        self.lanes.builder.ins().iadd(array, self.offset)
    }

    fn load(&mut self, input: Input) -> Value {
        let place = self.program.inputs.iter().position(|known| *known == input);
        // Specialisation has put numbers in the place of all others.
        let Some(place) = place else { return self.lanes.number(f64::NAN) };
        let address = self.address(self.sources[place]);
        let flags = MemFlagsData::new().with_notrap().with_readonly();
        self.lanes.builder.ins().load(types::F64X2, flags, address, 0)
    }

    fn store(&mut self, output: usize, root: NodeId) {
        let address = self.address(self.targets[output]);
        let value = self.value(root);
        self.lanes.builder.ins().store(MemFlagsData::new().with_notrap(), value, address, 0);
    }
}

impl PowerOps for Lowering<'_, '_> {
    type Value = Value;
    fn one(&mut self) -> Value {
        self.lanes.number(1.0)
    }
    fn multiply(&mut self, x: Value, y: Value) -> Value {
        self.lanes.builder.ins().fmul(x, y)
    }
    fn reciprocal(&mut self, x: Value) -> Value {
        let one = self.lanes.number(1.0);
        self.lanes.builder.ins().fdiv(one, x)
    }
    fn sqrt(&mut self, x: Value) -> Value {
        self.lanes.builder.ins().sqrt(x)
    }
    fn pow(&mut self, x: Value, c: f64) -> Value {
        let exponent = self.lanes.number(c);
        self.call(Called::Pow, &[x, exponent])
    }
}
