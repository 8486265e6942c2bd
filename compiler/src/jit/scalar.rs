//! The energy of one measure as machine code.

use cranelift_codegen::isa::OwnedTargetIsa;

use super::code::{Code, Listing, isa};
use crate::expression::Input;
use crate::kernel::{Batch, Level, Order, Outputs};
use crate::program::Program;
use crate::specialise::{CompileError, ScalarEnergy};
use crate::values::MAX_FIELDS;

/// psi, psi' and psi'' of one measure as machine code, one function per order.
#[derive(Debug)]
pub struct CompiledKernel {
    code: Code,
    n_fields: usize,
}

/// Most arrays that go in: the measure, and fields.
const SOURCES: usize = 3 + MAX_FIELDS;

fn inputs(energy: &ScalarEnergy) -> Vec<Input> {
    let measure = energy.measure;
    let own = [Input::Current(measure), Input::Reference(measure), Input::Change(measure)];
    own.into_iter().chain(energy.fields.iter().map(|(i, _)| Input::Parameter(*i))).collect()
}

impl CompiledKernel {
    /// Compiles an energy for this computer.
    ///
    /// # Errors
    /// What the code generator reports; the message is Cranelift's.
    pub fn new(energy: &ScalarEnergy, level: Level) -> Result<CompiledKernel, CompileError> {
        CompiledKernel::with_isa(energy, level, isa(true)?)
    }

    pub(super) fn with_isa(
        energy: &ScalarEnergy,
        level: Level,
        isa: OwnedTargetIsa,
    ) -> Result<CompiledKernel, CompileError> {
        let inputs = inputs(energy);
        let program = Program { graph: &energy.graph, inputs: &inputs, roots: &energy.roots };
        let code = Code::new(program, &Order::ALL.map(Order::wanted), level, isa)?;
        Ok(CompiledKernel { code, n_fields: energy.fields.len() })
    }

    /// Runs the kernel over a batch.
    ///
    /// # Panics
    /// If the slices of the batch differ in length or an output is too short: a mistake of the
    /// caller, not of a user.
    pub fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>) {
        let own = [batch.measure, batch.reference, batch.change];
        let mut outputs = [out.psi, out.dpsi, out.d2psi];
        let outputs = &mut outputs[order.wanted()];
        if self.n_fields == 0 {
            return self.code.run(order as usize, &own, outputs);
        }
        let n = batch.measure.len();
        let mut room = [&[][..]; SOURCES];
        let sources = &mut room[..own.len() + self.n_fields];
        sources[..own.len()].copy_from_slice(&own);
        for (field, source) in sources[own.len()..].iter_mut().enumerate() {
            *source = &batch.fields[field * n..][..n];
        }
        self.code.run(order as usize, sources, outputs);
    }

    /// The intermediate form and the machine instructions of an energy's kernel for all derivatives.
    ///
    /// # Errors
    /// What the code generator reports.
    pub fn listing(energy: &ScalarEnergy, level: Level) -> Result<Listing, CompileError> {
        let inputs = inputs(energy);
        let program = Program { graph: &energy.graph, inputs: &inputs, roots: &energy.roots };
        Code::listing(program, level)
    }
}
