//! The one door to the compiler: everything the runtime needs of an energy is a [`Law`] or, where it
//! has several variables, a [`VariablesLaw`].

pub use piola_compiler::{Batch, Level, Measure, Order, Outputs};

/// An energy density of one measure with its first two derivatives, evaluated over arrays.
///
/// The runtime never sees an expression: compiled kernels, interpreters and the closures of tests
/// all stand behind this trait.
pub trait Law: Send + Sync {
    /// Fills `out` with psi and, as the order asks, dpsi/dm and d2psi/dm2 for every entry of the batch.
    ///
    /// The unit of psi is J/m^(2d), J/m^(3d), J/m^(4d) for bonds, triangles, tetrahedra. There is room
    /// for psi where no energies are asked for, too: they may be written or not.
    fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>);

    /// Whether it is known to depend on the measure at rest alone.
    fn is_constant(&self) -> bool {
        false
    }

    /// Whether psi' is known to be affine in the measure, so that psi, psi' and psi'' at rest say
    /// everything. Passes may then work it out themselves: other roundings, the same law.
    fn is_affine(&self) -> bool {
        false
    }

    /// Typical values of the parameters that vary, in the order in which [`Batch::fields`] has their values
    /// of each interaction.
    fn fields(&self) -> &[f64] {
        &[]
    }

    /// Whether it is known to be a multiple of its only field, and affine.
    fn is_multiple_of_field(&self) -> bool {
        false
    }

    /// The same energy as a function of the square of its measure, where it is one: it takes
    /// `q = m^2/M`, `M` and `(q - M)/M`, and its derivatives are those by `q`.
    fn squared(&self) -> Option<&dyn Law> {
        None
    }
}

impl<F> Law for F
where
    F: Fn(Batch<'_>, Order, Outputs<'_>) + Send + Sync,
{
    fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>) {
        self(batch, order, out);
    }
}

impl Law for piola_compiler::Kernel {
    fn evaluate(&self, batch: Batch<'_>, order: Order, out: Outputs<'_>) {
        piola_compiler::Kernel::evaluate(self, batch, order, out);
    }

    fn is_constant(&self) -> bool {
        piola_compiler::Kernel::is_constant(self)
    }

    fn is_affine(&self) -> bool {
        piola_compiler::Kernel::is_affine(self)
    }

    fn fields(&self) -> &[f64] {
        piola_compiler::Kernel::fields(self)
    }

    fn is_multiple_of_field(&self) -> bool {
        piola_compiler::Kernel::is_multiple_of_field(self)
    }

    fn squared(&self) -> Option<&dyn Law> {
        piola_compiler::Kernel::squared(self).map(|kernel| kernel as &dyn Law)
    }
}

/// Variables of `n` places, variable by variable: entry `k*n + p` is variable `k` at place `p`.
#[derive(Clone, Copy, Debug)]
pub struct Variables<'a> {
    /// How many places there are.
    pub n: usize,
    /// The variables. Of a deformation gradient: `F`, row by row; of gathered states: the integrals,
    /// behind the length for energies of bonds.
    pub current: &'a [f64],
    /// Their changes from rest, as exact as displacements are. Of a deformation gradient: `F - I`;
    /// of bonds with gathered states `(l - L)/L` alone, of points with such states nothing.
    pub change: &'a [f64],
    /// What is given at each place, laid out alike. Of bonds with gathered states: their lengths at rest
    /// in m; then of all laws the parameters that are fields, in SI units.
    pub given: &'a [f64],
    /// The number of the law that holds at each place of a body of several materials; nothing where one
    /// law holds at all places.
    pub laws: &'a [u8],
}

/// An energy density of several variables with its derivatives, evaluated over arrays.
///
/// All arrays are laid out like [`Variables`].
pub trait VariablesLaw: Send + Sync {
    /// How many variables there are: `d*d` for a deformation gradient.
    fn n_variables(&self) -> usize;

    /// Fills `psi` and, unless it is empty, `gradient` with the derivatives by each variable. For a
    /// deformation gradient `psi` is in J/m^3 and its derivative the first Piola-Kirchhoff stress.
    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]);

    /// Fills `product` with the second derivatives times `direction`.
    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]);

    /// Of a sheet in plane stress: fills in the stretch across it, `F33`, at every place, not a number where
    /// nothing leaves the faces free. `false` of other laws, which fill in nothing.
    fn stretch_across(&self, _at: Variables<'_>, _across: &mut [f64]) -> bool {
        false
    }

    /// Of an energy of bonds: whether its derivative by the length is known to be affine in it, and
    /// whether it changes with no integral but those that are fixed.
    fn is_affine_beside(&self, _is_fixed: &dyn Fn(usize) -> bool) -> bool {
        false
    }
}

/// A part of a triangle or a tetrahedron that an energy is a function of, or of a bond.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CliquePart {
    /// What is measured.
    pub measure: Measure,
    /// Whose measure it is: numbers of points in the interaction, that of the owner is 0.
    pub points: Vec<u8>,
    /// Not the measure, but how far the second point has moved against the first along this axis, in m.
    pub axis: Option<usize>,
}

/// An energy density of several measures of one interaction: of a triangle's area and its sides, of a
/// tetrahedron's volume and its faces; of a bond's length and the components of its vector.
///
/// Each of them is a variable, at most [`piola_compiler::MAX_VARIABLES`]; `change` has `(m - M)/M` of each,
/// `given` the values at rest of each, then fields. What a bond's end has moved by has 0 and 1 there.
pub trait CoupledLaw: VariablesLaw {
    /// What its variables are.
    fn parts(&self) -> &[CliquePart];

    /// The same as written in `psi(..)`.
    fn argument(&self) -> &str;

    /// Typical values of the parameters that vary.
    fn fields(&self) -> &[f64] {
        &[]
    }
}

/// A kernel of several measures.
pub struct Coupled {
    kernel: piola_compiler::CoupledKernel,
    parts: Vec<CliquePart>,
}

impl Coupled {
    /// With what it is a function of.
    pub fn new(kernel: piola_compiler::CoupledKernel) -> Coupled {
        let part = |variable: &piola_compiler::Variable| CliquePart {
            measure: variable.measure,
            points: variable.points().to_vec(),
            axis: variable.component(),
        };
        let parts = kernel.variables().iter().map(part).collect();
        Coupled { kernel, parts }
    }

    fn batch<'a>(&self, at: Variables<'a>) -> piola_compiler::CoupledBatch<'a> {
        let (reference, fields) = at.given.split_at(at.current.len());
        let (n, variables, change) = (at.n, at.current, at.change);
        piola_compiler::CoupledBatch { n, variables, reference, change, fields }
    }
}

impl CoupledLaw for Coupled {
    fn parts(&self) -> &[CliquePart] {
        &self.parts
    }

    fn argument(&self) -> &str {
        self.kernel.argument()
    }

    fn fields(&self) -> &[f64] {
        self.kernel.fields()
    }
}

impl VariablesLaw for Coupled {
    fn n_variables(&self) -> usize {
        self.parts.len()
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        self.kernel.evaluate(self.batch(at), psi, gradient);
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        self.kernel.product(self.batch(at), direction, product);
    }
}

impl VariablesLaw for Box<dyn VariablesLaw> {
    fn n_variables(&self) -> usize {
        (**self).n_variables()
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        (**self).evaluate(at, psi, gradient);
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        (**self).product(at, direction, product);
    }

    fn stretch_across(&self, at: Variables<'_>, across: &mut [f64]) -> bool {
        (**self).stretch_across(at, across)
    }

    fn is_affine_beside(&self, is_fixed: &dyn Fn(usize) -> bool) -> bool {
        (**self).is_affine_beside(is_fixed)
    }
}

impl VariablesLaw for piola_compiler::GradientKernel {
    fn n_variables(&self) -> usize {
        self.dimension() * self.dimension()
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        let at = batch(at, !self.fields().is_empty());
        piola_compiler::GradientKernel::evaluate(self, at, psi, gradient);
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        let at = batch(at, !self.fields().is_empty());
        piola_compiler::GradientKernel::product(self, at, direction, product);
    }
}

impl VariablesLaw for piola_compiler::GatheredKernel {
    fn n_variables(&self) -> usize {
        piola_compiler::GatheredKernel::n_variables(self)
    }

    fn evaluate(&self, at: Variables<'_>, psi: &mut [f64], gradient: &mut [f64]) {
        piola_compiler::GatheredKernel::evaluate(self, gathered(self, at), psi, gradient);
    }

    fn product(&self, at: Variables<'_>, direction: &[f64], product: &mut [f64]) {
        piola_compiler::GatheredKernel::product(self, gathered(self, at), direction, product);
    }

    fn is_affine_beside(&self, is_fixed: &dyn Fn(usize) -> bool) -> bool {
        piola_compiler::GatheredKernel::is_affine_beside(self, is_fixed)
    }
}

fn gathered<'a>(
    kernel: &piola_compiler::GatheredKernel,
    at: Variables<'a>,
) -> piola_compiler::GatheredBatch<'a> {
    let (reference, fields) = at.given.split_at(if kernel.of_bonds() { at.n } else { 0 });
    let fields = if kernel.fields().is_empty() { &[] } else { fields };
    let (n, variables, change) = (at.n, at.current, at.change);
    piola_compiler::GatheredBatch { n, variables, change, reference, fields }
}

fn batch(at: Variables<'_>, takes_fields: bool) -> piola_compiler::GradientBatch<'_> {
    let fields = if takes_fields { at.given } else { &[] };
    piola_compiler::GradientBatch { n: at.n, gradient: at.current, change: at.change, fields }
}
