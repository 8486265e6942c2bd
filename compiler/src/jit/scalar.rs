//! The energy of one measure as machine code.

use cranelift_codegen::isa::OwnedTargetIsa;

use super::code::{Code, Listing, isa};
use crate::expression::Input;
use crate::kernel::{Batch, Level, Order, Outputs};
use crate::measure::Measure;
use crate::program::Program;
use crate::specialise::{CompileError, ScalarEnergy};

/// psi, psi' and psi'' of one measure as machine code, one function per order.
#[derive(Debug)]
pub struct CompiledKernel {
    code: Code,
}

fn inputs(measure: Measure) -> [Input; 3] {
    [Input::Current(measure), Input::Reference(measure), Input::Change(measure)]
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
        let inputs = inputs(energy.measure);
        let program = Program { graph: &energy.graph, inputs: &inputs, roots: &energy.roots };
        Ok(CompiledKernel { code: Code::new(program, &Order::ALL.map(Order::wanted), level, isa)? })
    }

    /// Runs the kernel over a batch.
    ///
    /// # Panics
    /// If the slices of the batch differ in length or an output is too short: a mistake of the
    /// caller, not of a user.
    pub fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>) {
        let inputs = [batch.measure, batch.reference, batch.change];
        let mut outputs = [out.psi, out.dpsi, out.d2psi];
        self.code.run(order as usize, &inputs, &mut outputs[order.wanted()]);
    }

    /// The intermediate form and the machine instructions of an energy's kernel for all derivatives.
    ///
    /// # Errors
    /// What the code generator reports.
    pub fn listing(energy: &ScalarEnergy, level: Level) -> Result<Listing, CompileError> {
        let inputs = inputs(energy.measure);
        let program = Program { graph: &energy.graph, inputs: &inputs, roots: &energy.roots };
        Code::listing(program, level)
    }
}
