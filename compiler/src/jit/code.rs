//! The owner of executable memory.
#![allow(unsafe_code)] // each block states the fact it rests on

use std::collections::HashMap;

use cranelift_codegen::control::ControlPlane;
use cranelift_codegen::ir::{AbiParam, Signature, UserFuncName, types};
use cranelift_codegen::isa::{OwnedTargetIsa, TargetIsa};
use cranelift_codegen::settings::{self, Configurable};
use cranelift_codegen::{Context, ir};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};
use cranelift_jit::{ArenaMemoryProvider, JITBuilder, JITModule};
use cranelift_module::{DataDescription, DataId, FuncId, Linkage, Module, default_libcall_names};

use super::called::Called;
use super::lanes::LANES;
use super::log_table::LOGARITHMS;
use super::lower::{self, Fast, Linked, POINTERS};
use crate::kernel::{Batch, Level, Order, Outputs};
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
    pub fn new(energy: &ScalarEnergy, level: Level) -> Result<CompiledKernel, CompileError> {
        CompiledKernel::with_isa(energy, level, isa(true)?)
    }

    pub(super) fn with_isa(
        energy: &ScalarEnergy,
        level: Level,
        isa: OwnedTargetIsa,
    ) -> Result<CompiledKernel, CompileError> {
        let mut module = new_module(isa)?;
        let result = define(&mut module, energy, level);
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
        if n == 1 {
            return self.evaluate_one(batch, order, out);
        }
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

    /// Code works on two entries at a time: a single one goes through as two.
    fn evaluate_one(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>) {
        let twice = |x: &[f64]| [x[0]; 2];
        let pair = Batch {
            measure: &twice(batch.measure),
            reference: &twice(batch.reference),
            change: &twice(batch.change),
        };
        let [mut psi, mut dpsi, mut d2psi] = [[0.0; 2]; 3];
        let room = Outputs { psi: &mut psi, dpsi: &mut dpsi, d2psi: &mut d2psi };
        self.evaluate(pair, order, room);
        out.psi[0] = psi[0];
        if order >= Order::Gradient {
            out.dpsi[0] = dpsi[0];
        }
        if order == Order::Tangent {
            out.d2psi[0] = d2psi[0];
        }
    }

    /// The intermediate form and the machine instructions of an energy's kernel for all derivatives.
    ///
    /// # Errors
    /// What the code generator reports.
    pub fn listing(energy: &ScalarEnergy, level: Level) -> Result<Listing, CompileError> {
        let mut module = new_module(isa(true)?)?;
        let result = list(&mut module, energy, level);
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

/// The instructions of this computer, or only those that every computer of its kind has.
pub(super) fn isa(native: bool) -> Result<OwnedTargetIsa, CompileError> {
    let mut flags = settings::builder();
    // The verifier takes a fifth of the time; tests run it.
    let verified = if cfg!(any(test, debug_assertions)) { "true" } else { "false" };
    for (name, value) in [
        ("opt_level", "speed"),
        ("enable_verifier", verified),
        ("use_colocated_libcalls", "false"),
        ("is_pic", "false"),
        // Nobody unwinds through a kernel, and it loads nothing twice.
        ("unwind_info", "false"),
        ("enable_alias_analysis", "false"),
    ] {
        flags.set(name, value).map_err(backend)?;
    }
    let isa = cranelift_native::builder_with_options(native).map_err(backend)?;
    isa.finish(settings::Flags::new(flags)).map_err(backend)
}

/// Whether the processor multiplies and adds vectors with one rounding.
fn has_fma(isa: &dyn TargetIsa) -> bool {
    let flags = isa.isa_flags();
    let flag = flags.iter().find(|flag| flag.name == "has_fma");
    flag.and_then(|flag| flag.as_bool()).unwrap_or(isa.name() == "aarch64")
}

/// The symbol of the table of logarithms.
const LOGARITHMS_SYMBOL: &str = "piola_logarithms";

fn new_module(isa: OwnedTargetIsa) -> Result<JITModule, CompileError> {
    let mut builder = JITBuilder::with_isa(isa, default_libcall_names());
    let arena = ArenaMemoryProvider::new_with_size(ARENA).map_err(backend)?;
    builder.memory_provider(Box::new(arena));
    // Everything is registered: a name that is not would be looked up in the process.
    for called in Called::all() {
        if let Some(address) = called.address() {
            builder.symbol(called.symbol(), address);
        }
    }
    builder.symbol(LOGARITHMS_SYMBOL, (&raw const LOGARITHMS).cast());
    Ok(JITModule::new(builder))
}

/// Compiles and finalises the functions of all orders; their addresses stay valid as long as the
/// module.
fn define(
    module: &mut JITModule,
    energy: &ScalarEnergy,
    level: Level,
) -> Result<[*const u8; 3], CompileError> {
    let strict = match level {
        Level::Fast if inlines(energy) => Some(function(module, energy, Order::Tangent, None)?),
        _ => None,
    };
    let mut ids = Vec::new();
    for order in Order::ALL {
        ids.push(function(module, energy, order, strict)?);
    }
    module.finalize_definitions().map_err(backend)?;
    Ok([0, 1, 2].map(|order| module.get_finalized_function(ids[order])))
}

/// Whether the fast level differs from the strict one.
fn inlines(energy: &ScalarEnergy) -> bool {
    energy.graph.nodes().any(|(_, node)| Called::of(node).is_some_and(Called::is_inlined))
}

/// Defines the function of one order: at the fast level if there is a strict one beside it.
fn function(
    module: &mut JITModule,
    energy: &ScalarEnergy,
    order: Order,
    strict: Option<FuncId>,
) -> Result<FuncId, CompileError> {
    let Built { mut context, pool } = build(module, energy, order, strict)?;
    if let Some((id, constants)) = pool {
        let mut data = DataDescription::new();
        let lanes = constants.iter().flat_map(|bits| [bits.to_ne_bytes(); LANES as usize]);
        data.define(lanes.flatten().collect());
        data.set_align(16);
        module.define_data(id, &data).map_err(backend)?;
    }
    let id = module.declare_anonymous_function(&context.func.signature).map_err(backend)?;
    module.define_function(id, &mut context).map_err(|e| backend(format!("{e:?}")))?;
    Ok(id)
}

fn list(
    module: &mut JITModule,
    energy: &ScalarEnergy,
    level: Level,
) -> Result<Listing, CompileError> {
    let strict = match level {
        Level::Fast if inlines(energy) => {
            let signature = signature(module);
            Some(module.declare_anonymous_function(&signature).map_err(backend)?)
        }
        _ => None,
    };
    let Built { mut context, .. } = build(module, energy, Order::Tangent, strict)?;
    let clif = context.func.display().to_string();
    context.set_disasm(true);
    let compiled = context
        .compile(module.isa(), &mut ControlPlane::default())
        .map_err(|e| backend(format!("{e:?}")))?;
    let assembly = compiled.vcode.clone().unwrap_or_default();
    Ok(Listing { clif, assembly })
}

fn signature(module: &JITModule) -> Signature {
    let mut signature = module.make_signature();
    let pointer = AbiParam::new(module.target_config().pointer_type());
    signature.params = vec![pointer; POINTERS];
    signature.params.push(AbiParam::new(types::I64));
    signature
}

/// A function in Cranelift's intermediate form.
struct Built {
    context: Context,
    /// The data that it loads its constants from, and those constants.
    pool: Option<(DataId, Vec<u64>)>,
}

fn build(
    module: &mut JITModule,
    energy: &ScalarEnergy,
    order: Order,
    strict: Option<FuncId>,
) -> Result<Built, CompileError> {
    let mut context = module.make_context();
    context.func.signature = signature(module);
    context.func.name = UserFuncName::user(0, 0);
    let pool = match strict {
        Some(_) => Some(module.declare_anonymous_data(false, false).map_err(backend)?),
        None => None,
    };
    let linked = link(module, &mut context.func, energy, strict.zip(pool))?;
    let mut builder_context = FunctionBuilderContext::new();
    let mut builder = FunctionBuilder::new(&mut context.func, &mut builder_context);
    let constants = lower::emit(&mut builder, energy, order, &linked);
    builder.finalize(module.target_config());
    Ok(Built { context, pool: pool.map(|pool| (pool, constants)) })
}

fn link(
    module: &mut JITModule,
    function: &mut ir::Function,
    energy: &ScalarEnergy,
    fast: Option<(FuncId, DataId)>,
) -> Result<Linked, CompileError> {
    let mut functions = HashMap::new();
    for called in energy.graph.nodes().filter_map(|(_, node)| Called::of(node)) {
        let inlined = fast.is_some() && called.is_inlined();
        if inlined || functions.contains_key(&called) {
            continue;
        }
        let mut signature: Signature = module.make_signature();
        signature.params = vec![AbiParam::new(types::F64); called.arity()];
        signature.returns = vec![AbiParam::new(types::F64)];
        let id = module
            .declare_function(&called.symbol(), Linkage::Import, &signature)
            .map_err(backend)?;
        functions.insert(called, module.declare_func_in_func(id, function));
    }
    let mut linked = Linked { functions, fast: None };
    if let Some((strict, pool)) = fast {
        let table = module
            .declare_data(LOGARITHMS_SYMBOL, Linkage::Import, false, false)
            .map_err(backend)?;
        linked.fast = Some(Fast {
            strict: module.declare_func_in_func(strict, function),
            logarithms: module.declare_data_in_func(table, function),
            pool: module.declare_data_in_func(pool, function),
            fma: has_fma(module.isa()),
        });
    }
    Ok(linked)
}
