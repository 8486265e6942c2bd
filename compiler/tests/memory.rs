//! Code memory has an owner and is freed: ten thousand compilations leave nothing behind.

#[path = "support/machine.rs"]
mod machine;

use std::ops::Range;
use std::time::Instant;

use machine::memory_kib;
use piola_compiler::{Batch, Form, Kernel, Level, Mode, Model, Setting, check};
use piola_grammar::parse;

const COMPILATIONS: usize = 10_000;
/// After so many compilations allocators and caches have their working size.
const WARM_UP: usize = 500;
/// One leaked kernel is at least a page of 4 KiB, so leaking every one would show 37 MiB.
const ALLOWED_GROWTH_KIB: u64 = 8 << 10;

#[test]
fn ten_thousand_compilations_leave_nothing_behind() {
    // What is in use, and the address space.
    let now = || memory_kib("VmRSS").zip(memory_kib("VmSize"));
    if now().is_none() {
        return;
    }
    let text = include_str!("../../potentials/firooz2023.piola");
    let model = check(&parse(text).unwrap()).unwrap();
    let start = Instant::now();
    on_two_threads(&model, 0..WARM_UP / 2);
    let warm = now().unwrap();
    on_two_threads(&model, WARM_UP / 2..COMPILATIONS / 2);
    let (resident, mapped) = now().unwrap();
    let (resident, mapped) = (resident.saturating_sub(warm.0), mapped.saturating_sub(warm.1));
    println!(
        "{COMPILATIONS} kernels in {:.1} s; resident memory grew by {resident} KiB, address space by \
         {mapped} KiB after the first {WARM_UP}",
        start.elapsed().as_secs_f64()
    );
    assert!(resident <= ALLOWED_GROWTH_KIB, "{resident} KiB");
    // A kernel reserves 4 MiB of addresses: leaking every one would show 37 GiB.
    assert!(mapped <= 64 << 10, "{mapped} KiB of address space");
}

/// Compiles the kernels of these numbers on each of two threads, and asks each for its derivatives.
fn on_two_threads(model: &Model, numbers: Range<usize>) {
    std::thread::scope(|scope| {
        for thread in 0..2 {
            let mut left = numbers.clone().map(move |k| 2 * k + thread).peekable();
            scope.spawn(move || {
                while let Some(&number) = left.peek() {
                    for kernel in kernels(model, number) {
                        let batch = Batch {
                            measure: &[1.5],
                            reference: &[1.0],
                            change: &[0.5],
                            fields: &[],
                        };
                        let out = kernel.derivatives(batch);
                        assert!(out.psi[0] > 0.0 && out.d2psi[0].is_finite());
                        left.next();
                    }
                }
            });
        }
    });
}

/// The kernels of an exponent of its own: no two are equal.
fn kernels(model: &Model, number: usize) -> Vec<Kernel> {
    let n = 0.5 + number as f64 / 1000.0;
    let settings = [("C1", 1.0), ("C2", 1.0), ("C3", 1.0), ("n", n)];
    let settings = settings.map(|(name, x)| (name.to_string(), Setting::Number(x)));
    let values = model.values(3, &settings, None).unwrap();
    model.compile(&values, Mode::Jit(Level::Strict), Form::Accurate).unwrap().kernels
}
