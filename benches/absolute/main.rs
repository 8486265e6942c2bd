//! Seconds, not ratios: what the parts take on this machine, for those who change them.
//!
//! `cargo bench --bench absolute` (criterion); `-- kernels` runs the names that hold this word.

#[allow(dead_code)] // Some of it serves the ratios only.
#[path = "../ratios/ours.rs"]
mod ours;
#[allow(dead_code)]
#[path = "../ratios/samples.rs"]
mod samples;

use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use piola_compiler::{Form, Level, Measure, Mode};
use piola_runtime::case::{Case, Library};
use piola_runtime::element::{Contributions, InteractionBatch, Order};
use piola_runtime::energy::{Energy, Wanted};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::neighborhood::Neighborhood;
use piola_runtime::output::OutputFolder;
use piola_runtime::output::summary::ExitReason;
use piola_runtime::simulation::{RunOptions, run};
use piola_runtime::solve::Watch;
use piola_runtime::solve::constraint::Constraints;
use piola_runtime::solve::linear::{LinearMethod, LinearOptions, LinearSolver};

use ours::{SethHill, cube, displacement};
use samples::{COUNT, Samples};

const ORDERS: [(&str, Order); 4] = [
    ("energy", Order::Energy),
    ("forces", Order::Force),
    ("gradient", Order::Gradient),
    ("tangent", Order::Tangent),
];

/// One interaction of each kind; throughput is interactions per second.
fn kernels(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("kernels");
    group.throughput(Throughput::Elements(COUNT as u64));
    for measure in Measure::ALL {
        let batches: Vec<InteractionBatch> = match measure {
            Measure::Length => Samples::<3>::new().batches::<1>(),
            Measure::Area => Samples::<6>::new().batches::<2>(),
            Measure::Volume => Samples::<9>::new().batches::<3>(),
        };
        for n in [1.0, 2.0, 2.7, 0.0] {
            let element = SethHill::new(n).element(measure);
            let mut out = Contributions::new(measure, 3);
            for (name, order) in ORDERS {
                let id = BenchmarkId::new(format!("{} {name}", measure.interaction()), n);
                group.bench_function(id, |bencher| {
                    bencher.iter(|| {
                        for batch in &batches {
                            element.evaluate(black_box(batch), order, &mut out).expect("finite");
                        }
                    });
                });
            }
        }
    }
    group.finish();
}

/// From the checked potential to machine code, three energies.
fn compile(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("compile");
    for n in [1.0, 2.7] {
        let law = SethHill::new(n);
        group.bench_function(BenchmarkId::from_parameter(n), |bencher| {
            bencher.iter(|| {
                law.model
                    .compile(black_box(&law.values), Mode::Jit(Level::Strict), Form::Accurate)
                    .expect("it compiles")
            });
        });
    }
    group.finish();
}

/// Who is within three spacings; throughput is points per second.
fn neighbors(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("neighbors");
    for points in [20, 30] {
        let body = cube(points);
        group.throughput(Throughput::Elements(body.n_points() as u64));
        group.bench_function(BenchmarkId::from_parameter(points), |bencher| {
            bencher.iter(|| Neighborhood::new(black_box(&body), 3.0).expect("a cube"));
        });
    }
    group.finish();
}

/// Passes over all interactions of a cube; throughput is interactions per second.
fn assembly(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("assembly");
    group.sample_size(10);
    for (measure, points) in [(Measure::Length, 20), (Measure::Area, 12), (Measure::Volume, 9)] {
        let body = cube(points);
        let u = displacement(&body);
        let energy = SethHill::new(1.0).energy(&body, 3.0, &[measure]);
        let report = energy.report();
        group.throughput(Throughput::Elements(report.bonds + report.triangles + report.tetrahedra));
        let mut gradient = vec![0.0; u.len()];
        let mut tangent = BlockMatrix::zeros(energy.pattern());
        for (name, order) in ORDERS {
            let id = BenchmarkId::new(format!("{} {name}", measure.interaction()), points);
            group.bench_function(id, |bencher| {
                bencher.iter(|| match order {
                    Order::Energy => energy.energy(&u).map(drop),
                    Order::Force => energy.evaluate(&u, Wanted::Forces(&mut gradient), &mut []),
                    Order::Gradient => energy.forces(&u, &mut gradient).map(drop),
                    Order::Tangent => energy.tangent(&u, &mut gradient, &mut tangent).map(drop),
                });
            });
        }
    }
    group.finish();
}

/// One linear system of bonds with one face held, from its matrix to its solution.
fn solvers(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("solvers");
    group.sample_size(10);
    let body = cube(10);
    let energy = SethHill::new(1.0).energy(&body, 3.0, &[Measure::Length]);
    let u = displacement(&body);
    let mut gradient = vec![0.0; u.len()];
    let mut tangent = BlockMatrix::zeros(energy.pattern());
    energy.tangent(&u, &mut gradient, &mut tangent).expect("all is finite");
    let held: Vec<usize> = (0..3 * 10 * 10).collect();
    let constraints = Constraints::new(u.len(), &held).expect("ascending");
    for method in [LinearMethod::Cholesky, LinearMethod::Ldlt, LinearMethod::Cg] {
        let options = LinearOptions { method, ..LinearOptions::default() };
        let mut solver =
            LinearSolver::new(energy.pattern(), energy.body().positions(), &constraints, options)
                .expect("it fits");
        let mut solution = vec![0.0; u.len()];
        group.bench_function(BenchmarkId::from_parameter(method.name()), |bencher| {
            bencher
                .iter(|| solver.solve(&tangent, &gradient, &mut solution).expect("it is solved"));
        });
    }
    group.finish();
}

/// A whole run of the scene of the README, with all its files.
fn scene(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("scene");
    group.sample_size(10);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/first/scene.toml");
    let library = Library { find: &|_| None, names: &[] };
    let overrides = ["steps.increments=4".to_string(), "output.frames=1".to_string()];
    let case = Case::read(&path, &overrides, &library).expect("it names a file of its own");
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("scene");
    group.bench_function("first, 4 increments", |bencher| {
        bencher.iter(|| {
            let folder = OutputFolder::create(&out, true).expect("the build folder");
            let options = RunOptions { title: "first", ..RunOptions::default() };
            let ending = run(&case, &folder, options, &Watch::default()).expect("it runs");
            assert_eq!(ending.reason, ExitReason::Completed);
        });
    });
    group.finish();
}

fn quick() -> Criterion {
    let short = Duration::from_millis(500);
    Criterion::default().warm_up_time(short / 2).measurement_time(short)
}

criterion_group! {
    name = all;
    config = quick();
    targets = kernels, compile, neighbors, assembly, solvers, scene
}
criterion_main!(all);
