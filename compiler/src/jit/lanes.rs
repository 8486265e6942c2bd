//! Two numbers side by side in CLIF: `F64X2` values, and `I64X2` masks for truth values (all bits of
//! a lane set, or none).

use cranelift_codegen::ir::condcodes::{FloatCC, IntCC};
use cranelift_codegen::ir::{
    Block, BlockArg, Endianness, InstBuilder, MemFlagsData, Type, Value, types,
};
use cranelift_frontend::FunctionBuilder;

/// How many numbers stand side by side: 128 bits are the widest vectors Cranelift has.
pub(super) const LANES: i64 = 2;

/// Instructions on lanes, by the names that formulas have for them.
pub(super) struct Lanes<'a, 'b> {
    pub(super) builder: &'a mut FunctionBuilder<'b>,
    /// Whether the processor multiplies and adds with one rounding.
    pub(super) fma: bool,
    /// Where the constants of inlined functions stand; without one they are literals.
    pub(super) pool: Option<Value>,
    /// Those constants by their bits, one entry per use.
    pub(super) constants: Vec<u64>,
}

impl Lanes<'_, '_> {
    /// The same number in every lane.
    pub(super) fn number(&mut self, x: f64) -> Value {
        let scalar = self.builder.ins().f64const(x);
        self.builder.ins().splat(types::F64X2, scalar)
    }

    /// The same number in every lane, for an inlined function: a load that belongs to its one use, so
    /// that it becomes an operand in memory. Written as a literal it would be shared, hoisted out of
    /// the loop and, as there are more of them than registers, spilled.
    pub(super) fn constant(&mut self, x: f64) -> Value {
        self.pooled(types::F64X2, x.to_bits())
    }

    /// The same for bits.
    pub(super) fn mask(&mut self, bits: u64) -> Value {
        self.pooled(types::I64X2, bits)
    }

    fn pooled(&mut self, as_type: Type, bits: u64) -> Value {
        let Some(pool) = self.pool else {
            let literal = self.bits(bits);
            return self.cast(as_type, literal);
        };
        let place = self.constants.len() as i32 * 16;
        self.constants.push(bits);
        let flags = MemFlagsData::trusted().with_readonly().with_can_move();
        self.builder.ins().load(as_type, flags, pool, place)
    }

    /// The same 64 bits in every lane.
    pub(super) fn bits(&mut self, bits: u64) -> Value {
        let scalar = self.builder.ins().iconst(types::I64, bits as i64);
        self.builder.ins().splat(types::I64X2, scalar)
    }

    /// All true, or all false.
    pub(super) fn truth(&mut self, holds: bool) -> Value {
        self.bits(if holds { u64::MAX } else { 0 })
    }

    /// The bits of numbers.
    pub(super) fn as_bits(&mut self, x: Value) -> Value {
        self.cast(types::I64X2, x)
    }

    /// The numbers that bits are.
    pub(super) fn as_numbers(&mut self, bits: Value) -> Value {
        self.cast(types::F64X2, bits)
    }

    fn cast(&mut self, to: Type, x: Value) -> Value {
        if self.builder.func.dfg.value_type(x) == to {
            return x;
        }
        self.builder.ins().bitcast(to, MemFlagsData::new(), x)
    }

    /// `x*y + z`, rounded once where the processor can.
    pub(super) fn multiply_add(&mut self, x: Value, y: Value, z: Value) -> Value {
        if self.fma {
            self.builder.ins().fma(x, y, z)
        } else {
            let product = self.builder.ins().fmul(x, y);
            self.builder.ins().fadd(product, z)
        }
    }

    /// `c[0] + c[1] x + c[2] x^2 + ..` for at least one coefficient, with `square = x^2`; pairs of terms
    /// are independent.
    pub(super) fn polynomial(&mut self, coefficients: &[f64], x: Value, square: Value) -> Value {
        let mut sum = None;
        for pair in coefficients.chunks(2).rev() {
            let mut term = self.constant(pair[0]);
            if let Some(&odd) = pair.get(1) {
                let odd = self.constant(odd);
                term = self.multiply_add(odd, x, term);
            }
            sum = Some(match sum {
                None => term,
                Some(sum) => self.multiply_add(sum, square, term),
            });
        }
        sum.unwrap_or(x)
    }

    /// The mask of a comparison.
    pub(super) fn compare(&mut self, condition: FloatCC, x: Value, y: Value) -> Value {
        self.builder.ins().fcmp(condition, x, y)
    }

    /// `x` where the mask is set, else `y`; both are numbers or both are masks.
    pub(super) fn choose(&mut self, mask: Value, x: Value, y: Value) -> Value {
        let mask = self.cast(self.builder.func.dfg.value_type(x), mask);
        self.builder.ins().bitselect(mask, x, y)
    }

    /// One bit per lane of a mask.
    pub(super) fn lanes_set(&mut self, mask: Value) -> Value {
        self.builder.ins().vhigh_bits(types::I32, mask)
    }

    /// A lane of a vector.
    pub(super) fn lane(&mut self, x: Value, lane: u8) -> Value {
        self.builder.ins().extractlane(x, lane)
    }

    /// Two numbers side by side.
    pub(super) fn join(&mut self, x: [Value; 2]) -> Value {
        let first = self.builder.ins().scalar_to_vector(types::F64X2, x[0]);
        self.builder.ins().insertlane(first, x[1], 1)
    }

    /// The low lanes, or the high lanes, of two vectors of numbers side by side.
    pub(super) fn unzip(&mut self, x: [Value; 2], high: bool) -> Value {
        let first = if high { 8 } else { 0 };
        let bytes: Vec<u8> =
            (0..8).map(|k| first + k).chain((0..8).map(|k| first + 16 + k)).collect();
        let order = self.builder.func.dfg.immediates.push(bytes.as_slice().into());
        let little = MemFlagsData::new().with_endianness(Endianness::Little);
        let [x, y] = x.map(|x| self.builder.ins().bitcast(types::I8X16, little, x));
        let joined = self.builder.ins().shuffle(x, y, order);
        self.builder.ins().bitcast(types::F64X2, little, joined)
    }

    /// Goes to `then` with its arguments if a number is equal to `expected`, else to `otherwise`.
    pub(super) fn branch_if(
        &mut self,
        number: Value,
        expected: i64,
        then: (Block, &[Value]),
        otherwise: (Block, &[Value]),
    ) {
        let expected = self.builder.ins().iconst(types::I32, expected);
        let holds = self.builder.ins().icmp(IntCC::Equal, number, expected);
        let arguments =
            |values: &[Value]| values.iter().map(|x| (*x).into()).collect::<Vec<BlockArg>>();
        let (x, y) = (arguments(then.1), arguments(otherwise.1));
        self.builder.ins().brif(holds, then.0, &x, otherwise.0, &y);
    }
}
