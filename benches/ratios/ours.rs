//! The program under test, through its public door only.

use std::sync::Arc;

use num_dual::HyperDual64;
use piola_compiler::{
    Batch, Form, Kernel, Level, Measure, Mode, Model, Order, Outputs, Setting, Values, check_text,
};
use piola_runtime::assembly::{DiscreteEnergy, Elements};
use piola_runtime::body::Body;
use piola_runtime::element::{CoordinateElement, Element, MeasureElement};
use piola_runtime::lattice::{Lattice, Nodes};
use piola_runtime::weights::Weights;

/// Seth-Hill energies of the library with their values.
pub(crate) struct SethHill {
    pub(crate) model: Model,
    pub(crate) values: Values,
}

impl SethHill {
    /// In three dimensions, all stiffnesses 1.
    pub(crate) fn new(n: f64) -> SethHill {
        SethHill::with_stiffness(n, [1.0; 3])
    }

    /// In three dimensions, with C1, C2, C3.
    pub(crate) fn with_stiffness(n: f64, c: [f64; 3]) -> SethHill {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/potentials/firooz2023.piola");
        let text = std::fs::read_to_string(path).expect("the library is there");
        let (_, model) = check_text(&text).expect("the library is right");
        let settings = [("C1", c[0]), ("C2", c[1]), ("C3", c[2]), ("n", n)]
            .map(|(name, value)| (name.to_string(), Setting::Number(value)));
        let values = model.values(3, &settings, None).expect("these values are allowed");
        SethHill { model, values }
    }

    /// The compiled energy of a measure.
    pub(crate) fn kernel(&self, measure: Measure) -> Kernel {
        self.kernel_at(Level::default(), measure)
    }

    /// The same at a level: at the strict one every pass calls the kernel.
    pub(crate) fn kernel_at(&self, level: Level, measure: Measure) -> Kernel {
        let compiled = self
            .model
            .compile(&self.values, Mode::Jit(level), Form::Accurate)
            .expect("it compiles");
        let mut kernels = compiled.kernels.into_iter();
        kernels.find(|kernel| kernel.measure() == measure).expect("all three are modelled")
    }

    /// The energy over hyper-dual coordinates, interpreted.
    pub(crate) fn coordinate_element(&self, measure: Measure) -> Box<dyn Element> {
        let written = self.model.written(&self.values, measure);
        let psi = move |m: HyperDual64, reference: f64| {
            written.evaluate(m, HyperDual64::from_re(reference))
        };
        Box::new(CoordinateElement::new(measure, 3, psi))
    }

    /// The compiled energy on the geometry of its measure.
    pub(crate) fn element(&self, measure: Measure) -> Box<dyn Element> {
        Box::new(MeasureElement::new(measure, 3, Box::new(self.kernel(measure))))
    }

    /// The same as a function of the measure even where its square would do.
    pub(crate) fn element_of_measure(&self, measure: Measure) -> Box<dyn Element> {
        let kernel = self.kernel(measure);
        let law = move |batch: Batch<'_>, order: Order, out: Outputs<'_>| {
            kernel.evaluate(batch, order, out);
        };
        Box::new(MeasureElement::new(measure, 3, Box::new(law)))
    }

    /// The discrete energy of these measures, every interaction with weight 1.
    pub(crate) fn energy(
        &self,
        body: &Arc<Body>,
        horizon: f64,
        measures: &[Measure],
    ) -> DiscreteEnergy {
        let element = |measure| self.element(measure);
        discrete(body, horizon, Weights::Unit, measures, element)
    }
}

/// The discrete energy of some measures with an element each.
pub(crate) fn discrete(
    body: &Arc<Body>,
    horizon: f64,
    weights: Weights,
    measures: &[Measure],
    element: impl Fn(Measure) -> Box<dyn Element>,
) -> DiscreteEnergy {
    let element = |measure: Measure| measures.contains(&measure).then(|| element(measure));
    let elements = Elements {
        bond: element(Measure::Length),
        triangle: element(Measure::Area),
        tetrahedron: element(Measure::Volume),
    };
    DiscreteEnergy::with_elements(Arc::clone(body), horizon, weights, elements)
        .expect("a cube can be assembled")
}

/// A cube of `n^3` points a unit apart.
pub(crate) fn cube(n: usize) -> Arc<Body> {
    let upper = vec![(n - 1) as f64; 3];
    let lattice = Lattice { lower: vec![0.0; 3], upper, spacing: 1.0, nodes: Nodes::CornersFull };
    let points = lattice.points().expect("a cube is a lattice");
    Arc::new(Body::new(3, &points.positions, &points.volumes, Some(1.0)))
}

/// A smooth displacement with strains of some percent, the same at every call.
pub(crate) fn displacement(body: &Body) -> Vec<f64> {
    displacement_at(body.positions())
}

/// The same of the points of a body, `n x 3`.
pub(crate) fn displacement_at(positions: &[f64]) -> Vec<f64> {
    let edge = positions.iter().fold(0.0, |edge: f64, x| edge.max(*x));
    let field = |x: &[f64]| {
        let [x, y, z] = [x[0], x[1], x[2]].map(|x| x / edge);
        [0.03 * x + 0.02 * y * z, 0.04 * y - 0.03 * x * z, 0.05 * x * y - 0.01 * z]
    };
    positions.chunks_exact(3).flat_map(|x| field(x).map(|u| edge * u)).collect()
}

/// Runs `work` with this many threads for all that is parallel.
pub(crate) fn with_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.expect("threads can be started").install(work)
}
