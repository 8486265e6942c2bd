//! The owner of executable memory.
#![allow(unsafe_code)] // each block states the fact it rests on

use std::collections::HashMap;
use std::ops::Range;

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
use crate::kernel::Level;
use crate::program::Program;
use crate::specialise::CompileError;

/// Address space reserved for one program; pages are used as needed. A kernel of the largest
/// allowed size takes some 300 kB.
const ARENA: usize = 4 << 20;

/// Most arrays that go in, or out, of one program: what both ends of a bond gather, with directions.
const MAX_ARRAYS: usize = 256;

/// As many as energies of several measures have, and of most that points gather.
const SOME_ARRAYS: usize = 64;

/// As many as the energy of one measure has.
const FEW_ARRAYS: usize = 4;

type Entry = unsafe extern "C" fn(*const *const f64, *const *mut f64, i64);

/// A program as machine code.
pub(crate) struct Code {
    /// Only taken out when dropped.
    module: Option<JITModule>,
    n_inputs: usize,
    /// How many roots each function computes, and the function.
    entries: Vec<(usize, Entry)>,
}

// SAFETY: the code is immutable once finalised and reads nothing but its arguments.
unsafe impl Send for Code {}
// SAFETY: as above; the module is never touched between construction and drop.
unsafe impl Sync for Code {}

impl std::fmt::Debug for Code {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Code").finish_non_exhaustive()
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

impl Code {
    /// Compiles functions that compute some roots of a program, one for each of `parts`, and nothing
    /// that these do not need.
    ///
    /// # Errors
    /// What the code generator reports; the message is Cranelift's.
    pub(crate) fn new(
        program: Program<'_>,
        parts: &[Range<usize>],
        level: Level,
        isa: OwnedTargetIsa,
    ) -> Result<Code, CompileError> {
        let n_inputs = program.inputs.len();
        if n_inputs == 0 || n_inputs.max(program.roots.len()) > MAX_ARRAYS {
            return Err(backend(format!("a kernel has 1 to {MAX_ARRAYS} inputs and outputs")));
        }
        let mut module = new_module(isa)?;
        match define(&mut module, program, parts, level) {
            Ok(addresses) => {
                let entry = |address| {
                    // SAFETY: `address` is the entry of a function that `define` has just compiled
                    // with exactly this signature and calling convention, and `module` keeps it mapped.
                    unsafe { std::mem::transmute::<*const u8, Entry>(address) }
                };
                let counts = parts.iter().map(Range::len);
                let entries = counts.zip(addresses.into_iter().map(entry));
                Ok(Code { n_inputs, entries: entries.collect(), module: Some(module) })
            }
            Err(error) => {
                // SAFETY: no function of this module was ever handed out.
                unsafe { module.free_memory() };
                Err(error)
            }
        }
    }

    /// Runs one of the functions over arrays of one length: the inputs in the order of the program,
    /// and the outputs of its part.
    ///
    /// # Panics
    /// If an array is missing, inputs differ in length, or an output is too short: a mistake of the
    /// caller, not of a user.
    pub(crate) fn run(&self, function: usize, inputs: &[&[f64]], outputs: &mut [&mut [f64]]) {
        let (n_outputs, entry) = self.entries[function];
        assert!(inputs.len() == self.n_inputs && outputs.len() >= n_outputs, "one array for each");
        let n = inputs[0].len();
        let outputs = &mut outputs[..n_outputs];
        assert!(inputs.iter().all(|array| array.len() == n), "inputs have one length");
        assert!(outputs.iter().all(|array| array.len() >= n), "outputs have room");
        // Most programs have few arrays: clearing room for all takes a tenth of the time of a bond.
        match (n, inputs.len().max(n_outputs)) {
            (1, ..=FEW_ARRAYS) => call_one::<FEW_ARRAYS>(entry, inputs, outputs),
            (1, ..=SOME_ARRAYS) => call_one::<SOME_ARRAYS>(entry, inputs, outputs),
            (1, _) => call_one::<MAX_ARRAYS>(entry, inputs, outputs),
            (_, ..=FEW_ARRAYS) => call::<FEW_ARRAYS>(entry, inputs, outputs),
            (_, ..=SOME_ARRAYS) => call::<SOME_ARRAYS>(entry, inputs, outputs),
            _ => call::<MAX_ARRAYS>(entry, inputs, outputs),
        }
    }

    /// The intermediate form and the machine instructions of the function for all roots.
    ///
    /// # Errors
    /// What the code generator reports.
    pub(crate) fn listing(program: Program<'_>, level: Level) -> Result<Listing, CompileError> {
        let mut module = new_module(isa(true)?)?;
        let result = list(&mut module, program, level);
        // SAFETY: no function of this module was finalised or handed out.
        unsafe { module.free_memory() };
        result
    }
}

/// Calls `entry` with the addresses of at most `ROOM` arrays either way.
#[inline(always)]
fn call<const ROOM: usize>(entry: Entry, inputs: &[&[f64]], outputs: &mut [&mut [f64]]) {
    let mut sources = [std::ptr::null(); ROOM];
    let mut targets = [std::ptr::null_mut(); ROOM];
    for (source, array) in sources[..inputs.len()].iter_mut().zip(inputs) {
        *source = array.as_ptr();
    }
    for (target, array) in targets[..outputs.len()].iter_mut().zip(outputs) {
        *target = array.as_mut_ptr();
    }
    // SAFETY: the function reads one entry of `sources` for each input of the program and one of
    // `targets` for each root it computes; `Code::run`, for which it is called, has as many, and each
    // holds as many numbers as the first input; all found room here; outputs are borrowed mutably
    // and so do not overlap the inputs or each other; the code lives as long as the `Code`.
    unsafe { entry(sources.as_ptr(), targets.as_ptr(), inputs[0].len() as i64) };
}

/// The same for arrays of one entry. Code works on two at a time: a single one goes through as two.
fn call_one<const ROOM: usize>(entry: Entry, inputs: &[&[f64]], outputs: &mut [&mut [f64]]) {
    let (mut twice, mut pairs) = ([[0.0; 2]; ROOM], [[0.0; 2]; ROOM]);
    for (pair, array) in twice.iter_mut().zip(inputs) {
        *pair = [array[0]; 2];
    }
    let sources = twice.each_ref().map(|pair| &pair[..]);
    let mut targets = pairs.each_mut().map(|pair| &mut pair[..]);
    call::<ROOM>(entry, &sources[..inputs.len()], &mut targets[..outputs.len()]);
    for (output, pair) in outputs.iter_mut().zip(&pairs) {
        output[0] = pair[0];
    }
}

impl Drop for Code {
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
pub(crate) fn isa(native: bool) -> Result<OwnedTargetIsa, CompileError> {
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

/// The processor that kernels are compiled for, with the instructions of it that they may have: from one text, kernels
/// are the same where this is.
///
/// # Errors
/// A processor that no kernel can be compiled for.
pub fn target() -> Result<String, CompileError> {
    Ok(described(&*isa(true)?))
}

/// What an architecture is called, and what it can.
pub(super) fn described(isa: &dyn TargetIsa) -> String {
    let flags = isa.isa_flags();
    let set = flags.iter().filter(|flag| flag.as_bool() == Some(true)).map(|flag| flag.name);
    std::iter::once(isa.name()).chain(set).collect::<Vec<&str>>().join(" ")
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

/// Compiles and finalises the functions; their addresses stay valid as long as the module.
fn define(
    module: &mut JITModule,
    program: Program<'_>,
    parts: &[Range<usize>],
    level: Level,
) -> Result<Vec<*const u8>, CompileError> {
    let strict = match level {
        Level::Fast if inlines(program) => Some(function(module, program, None)?),
        _ => None,
    };
    let mut ids = Vec::new();
    for part in parts {
        let strict =
            strict.map(|id| Strict { id, n_outputs: program.roots.len(), first: part.start });
        ids.push(function(module, program.part(part.clone()), strict)?);
    }
    module.finalize_definitions().map_err(backend)?;
    Ok(ids.into_iter().map(|id| module.get_finalized_function(id)).collect())
}

/// Whether the fast level differs from the strict one.
fn inlines(program: Program<'_>) -> bool {
    program.graph.nodes().any(|(_, node)| Called::of(node).is_some_and(Called::is_inlined))
}

/// A function at the strict level for all roots, beside one for some of them.
#[derive(Clone, Copy)]
struct Strict {
    id: FuncId,
    /// How many outputs it has.
    n_outputs: usize,
    /// Which of them is the first of the other function.
    first: usize,
}

/// Defines a function: at the fast level if there is a strict one beside it.
fn function(
    module: &mut JITModule,
    program: Program<'_>,
    strict: Option<Strict>,
) -> Result<FuncId, CompileError> {
    let Built { mut context, pool } = build(module, program, strict)?;
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
    program: Program<'_>,
    level: Level,
) -> Result<Listing, CompileError> {
    let strict = match level {
        Level::Fast if inlines(program) => {
            let signature = signature(module);
            let id = module.declare_anonymous_function(&signature).map_err(backend)?;
            Some(Strict { id, n_outputs: program.roots.len(), first: 0 })
        }
        _ => None,
    };
    let Built { mut context, .. } = build(module, program, strict)?;
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
    program: Program<'_>,
    strict: Option<Strict>,
) -> Result<Built, CompileError> {
    let mut context = module.make_context();
    context.func.signature = signature(module);
    context.func.name = UserFuncName::user(0, 0);
    let pool = match strict {
        Some(_) => Some(module.declare_anonymous_data(false, false).map_err(backend)?),
        None => None,
    };
    let linked = link(module, &mut context.func, program, strict.zip(pool))?;
    let mut builder_context = FunctionBuilderContext::new();
    let mut builder = FunctionBuilder::new(&mut context.func, &mut builder_context);
    let constants = lower::emit(&mut builder, program, &linked);
    builder.finalize(module.target_config());
    Ok(Built { context, pool: pool.map(|pool| (pool, constants)) })
}

fn link(
    module: &mut JITModule,
    function: &mut ir::Function,
    program: Program<'_>,
    fast: Option<(Strict, DataId)>,
) -> Result<Linked, CompileError> {
    let mut functions = HashMap::new();
    for called in program.graph.nodes().filter_map(|(_, node)| Called::of(node)) {
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
    if let Some((Strict { id, n_outputs, first }, pool)) = fast {
        let table = module
            .declare_data(LOGARITHMS_SYMBOL, Linkage::Import, false, false)
            .map_err(backend)?;
        linked.fast = Some(Fast {
            strict: module.declare_func_in_func(id, function),
            n_outputs,
            first,
            logarithms: module.declare_data_in_func(table, function),
            pool: module.declare_data_in_func(pool, function),
            fma: has_fma(module.isa()),
        });
    }
    Ok(linked)
}
