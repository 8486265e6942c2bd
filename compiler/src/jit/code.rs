//! The owner of executable memory.
#![allow(unsafe_code)] // each block states the fact it rests on

use std::collections::HashMap;

use cranelift_codegen::control::ControlPlane;
use cranelift_codegen::ir::{AbiParam, FuncRef, Signature, UserFuncName, types};
use cranelift_codegen::isa::OwnedTargetIsa;
use cranelift_codegen::settings::{self, Configurable};
use cranelift_codegen::{Context, ir};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};
use cranelift_jit::{ArenaMemoryProvider, JITBuilder, JITModule};
use cranelift_module::{Linkage, Module, default_libcall_names};

use super::lower::{self, Called, POINTERS};
use crate::expression::Function;
use crate::expression::function::log1pmx;
use crate::kernel::{Batch, Order, Outputs};
use crate::specialise::{CompileError, ScalarEnergy};

/// Address space reserved for one kernel; pages are used as needed. A kernel of the largest
/// allowed size takes some 300 kB.
const ARENA: usize = 4 << 20;

type Entry =
    unsafe extern "C" fn(*const f64, *const f64, *const f64, *mut f64, *mut f64, *mut f64, i64);

/// psi, psi' and psi'' of one measure as machine code, one function per order.
pub struct CompiledKernel {
    /// Only taken out when dropped.
    module: Option<JITModule>,
    /// By order; each computes nothing that its order does not need.
    entries: [Entry; 3],
}

// SAFETY: the code is immutable once finalised and reads nothing but its arguments.
unsafe impl Send for CompiledKernel {}
// SAFETY: as above; the module is never touched between construction and drop.
unsafe impl Sync for CompiledKernel {}

impl std::fmt::Debug for CompiledKernel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CompiledKernel").finish_non_exhaustive()
    }
}

/// A compiled kernel as text.
#[derive(Clone, Debug)]
pub struct Listing {
    /// Cranelift's intermediate form before optimisation.
    pub clif: String,
    /// The machine instructions of this computer.
    pub assembly: String,
}

impl CompiledKernel {
    /// Compiles an energy for this computer.
    ///
    /// # Errors
    /// What the code generator reports; the message is Cranelift's.
    pub fn new(energy: &ScalarEnergy) -> Result<CompiledKernel, CompileError> {
        let mut module = new_module()?;
        let result = define(&mut module, energy);
        match result {
            Ok(addresses) => {
                let entries = addresses.map(|address| {
                    // SAFETY: `address` is the entry of a function that `define` has just compiled
                    // with exactly this signature and calling convention, and `module` keeps it mapped.
                    unsafe { std::mem::transmute::<*const u8, Entry>(address) }
                });
                Ok(CompiledKernel { module: Some(module), entries })
            }
            Err(error) => {
                // SAFETY: no function of this module was ever handed out.
                unsafe { module.free_memory() };
                Err(error)
            }
        }
    }

    /// Runs the kernel over a batch.
    ///
    /// # Panics
    /// If the slices of the batch differ in length or an output is too short: a mistake of the
    /// caller, not of a user.
    pub fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>) {
        let n = batch.measure.len();
        assert!(batch.is_even() && out.hold(n, order), "one entry per interaction");
        // SAFETY: the inputs, and the outputs of this order, hold `n` numbers each, as checked above;
        // the function of an order writes no other output; outputs are borrowed mutably and so do
        // not overlap the inputs; the code lives as long as `self`.
        unsafe {
            (self.entries[order as usize])(
                batch.measure.as_ptr(),
                batch.reference.as_ptr(),
                batch.change.as_ptr(),
                out.psi.as_mut_ptr(),
                out.dpsi.as_mut_ptr(),
                out.d2psi.as_mut_ptr(),
                n as i64,
            );
        }
    }

    /// The intermediate form and the machine instructions of an energy's kernel for all derivatives.
    ///
    /// # Errors
    /// What the code generator reports.
    pub fn listing(energy: &ScalarEnergy) -> Result<Listing, CompileError> {
        let mut module = new_module()?;
        let result = list(&mut module, energy);
        // SAFETY: no function of this module was finalised or handed out.
        unsafe { module.free_memory() };
        result
    }
}

impl Drop for CompiledKernel {
    fn drop(&mut self) {
        if let Some(module) = self.module.take() {
            // SAFETY: `entries` are private, are called only through `&self`, and `self` ends here.
            unsafe { module.free_memory() };
        }
    }
}

fn backend(error: impl std::fmt::Display) -> CompileError {
    CompileError::Backend(error.to_string())
}

fn native_isa() -> Result<OwnedTargetIsa, CompileError> {
    let mut flags = settings::builder();
    for (name, value) in
        [("opt_level", "speed"), ("use_colocated_libcalls", "false"), ("is_pic", "false")]
    {
        flags.set(name, value).map_err(backend)?;
    }
    let isa = cranelift_native::builder().map_err(backend)?;
    isa.finish(settings::Flags::new(flags)).map_err(backend)
}

fn new_module() -> Result<JITModule, CompileError> {
    let mut builder = JITBuilder::with_isa(native_isa()?, default_libcall_names());
    let arena = ArenaMemoryProvider::new_with_size(ARENA).map_err(backend)?;
    builder.memory_provider(Box::new(arena));
    // Every function is registered: a name that is not would be looked up in the process.
    for function in Function::NAMED {
        if let Some(address) = address_of(function) {
            builder.symbol(Called::Unary(function).symbol(), address);
        }
    }
    builder.symbol(Called::Pow.symbol(), pow as *const u8);
    Ok(JITModule::new(builder))
}

/// Compiles and finalises the functions of all orders; their addresses stay valid as long as the
/// module.
fn define(module: &mut JITModule, energy: &ScalarEnergy) -> Result<[*const u8; 3], CompileError> {
    let mut ids = Vec::new();
    for order in Order::ALL {
        let mut context = build(module, energy, order)?;
        let id = module.declare_anonymous_function(&context.func.signature).map_err(backend)?;
        module.define_function(id, &mut context).map_err(|e| backend(format!("{e:?}")))?;
        ids.push(id);
    }
    module.finalize_definitions().map_err(backend)?;
    Ok([0, 1, 2].map(|order| module.get_finalized_function(ids[order])))
}

fn list(module: &mut JITModule, energy: &ScalarEnergy) -> Result<Listing, CompileError> {
    let mut context = build(module, energy, Order::Tangent)?;
    let clif = context.func.display().to_string();
    context.set_disasm(true);
    let compiled = context
        .compile(module.isa(), &mut ControlPlane::default())
        .map_err(|e| backend(format!("{e:?}")))?;
    let assembly = compiled.vcode.clone().unwrap_or_default();
    Ok(Listing { clif, assembly })
}

fn build(
    module: &mut JITModule,
    energy: &ScalarEnergy,
    order: Order,
) -> Result<Context, CompileError> {
    let mut context = module.make_context();
    let pointer = module.target_config().pointer_type();
    for _ in 0..POINTERS {
        context.func.signature.params.push(AbiParam::new(pointer));
    }
    context.func.signature.params.push(AbiParam::new(types::I64));
    context.func.name = UserFuncName::user(0, 0);
    let functions = import(module, &mut context.func, energy)?;
    let mut builder_context = FunctionBuilderContext::new();
    let mut builder = FunctionBuilder::new(&mut context.func, &mut builder_context);
    lower::emit(&mut builder, energy, order, &functions);
    builder.finalize(module.target_config());
    Ok(context)
}

fn import(
    module: &mut JITModule,
    function: &mut ir::Function,
    energy: &ScalarEnergy,
) -> Result<HashMap<Called, FuncRef>, CompileError> {
    let mut functions = HashMap::new();
    for called in lower::called_functions(energy) {
        let mut signature: Signature = module.make_signature();
        let arity = if called == Called::Pow { 2 } else { 1 };
        signature.params = vec![AbiParam::new(types::F64); arity];
        signature.returns = vec![AbiParam::new(types::F64)];
        let id = module
            .declare_function(&called.symbol(), Linkage::Import, &signature)
            .map_err(backend)?;
        functions.insert(called, module.declare_func_in_func(id, function));
    }
    Ok(functions)
}

extern "C" fn pow(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

/// `libm`'s bodies under the calling convention of machine code.
fn address_of(function: Function) -> Option<*const u8> {
    macro_rules! address {
        ($name:ident) => {{
            extern "C" fn call(x: f64) -> f64 {
                libm::$name(x)
            }
            Some(call as *const u8)
        }};
    }
    match function {
        Function::Negate | Function::Abs | Function::Sign | Function::Sqrt => None,
        Function::Exp => address!(exp),
        Function::Ln => address!(log),
        Function::Log1p => address!(log1p),
        Function::Expm1 => address!(expm1),
        Function::Log1pmx => {
            extern "C" fn call(x: f64) -> f64 {
                log1pmx(x)
            }
            Some(call as *const u8)
        }
        Function::Sin => address!(sin),
        Function::Cos => address!(cos),
        Function::Tan => address!(tan),
        Function::Asin => address!(asin),
        Function::Acos => address!(acos),
        Function::Atan => address!(atan),
        Function::Sinh => address!(sinh),
        Function::Cosh => address!(cosh),
        Function::Tanh => address!(tanh),
    }
}
