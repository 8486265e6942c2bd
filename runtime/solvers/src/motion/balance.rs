//! The account of energy of a body that moves, in which nothing is left over.
//!
//! Velocities are known half a step before and half a step after the time `t_n` of forces, and
//! `u_(n+1) - u_n = dt v_(n+1/2)`. With the kinetic energy `K~_n = 1/2 m v_(n-1/2).v_(n+1/2)`
//! (of the free degrees of freedom) and all forces `F` on them, damping included,
//!
//! ```text
//! K~_(n+1) - K~_n = 1/2 m v_(n+1/2).(v_(n+3/2) - v_(n-1/2)) = 1/2 (F_n + F_(n+1)).(u_(n+1) - u_n)
//! ```
//!
//! holds for any step, not only in the limit of short ones. So work is summed by that rule, and
//! what does not close is rounding. What the energy changes by beside the work of its forces by
//! that rule is the error of the integration, and has a column of its own.
//!
//! Bonds break at the end of a step, before its forces: those of the broken ones are missing from the half
//! of the step behind `u_(n+1)` and from the half before it. What they would have added to the work over
//! that one is `timing`; what they held at `u_(n+1)` is `released`. With both the energy is accounted for:
//! `E - E(0) = work of dE/du + timing - released - dissipated + quadrature`, where `dissipated` is what bonds
//! lost by what they remember.
//!
//! Parameters that change with time change the energy too. What it changes by over a step while they stand
//! still, in the middle of the step, is summed up; the rest is `parameters`, the work that it takes to change them,
//! a further term on the right.

use piola_mechanics::energy::EnergyParts;
use piola_mechanics::fracture::Release;

use super::midpoint::Works;
use super::verlet::{Sides, Sums};

/// What does not close, over the largest of what was added up, is rounding up to here.
pub const CLOSES_TO: f64 = 1e-12;

/// A sum that keeps what rounding leaves behind (Neumaier, ZAMM 54, 1974).
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    value: f64,
    low: f64,
}

impl Sum {
    fn add(&mut self, term: f64) {
        let whole = self.value + term;
        self.low += match self.value.abs() >= term.abs() {
            true => (self.value - whole) + term,
            false => (term - whole) + self.value,
        };
        self.value = whole;
    }

    fn total(self) -> f64 {
        self.value + self.low
    }
}

/// The place of the largest column among [`Balance::numbers`].
const LARGEST: usize = 18;

/// The place of what breaking created.
const CREATED: usize = 27;

/// The places of what every part of a body knows of the whole body: no sums over parts.
const OF_BODY: [usize; 3] = [LARGEST, CREATED, CREATED + 1];

/// A line of the account: a body at one time. Energies and work since the start are in J.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// How many steps led here.
    pub step: usize,
    /// In s.
    pub t: f64,
    /// `1/2 m v.v` with the velocities at `t`, of all points.
    pub kinetic: f64,
    /// `1/2 m v_(n-1/2).v_(n+1/2)` of the free degrees of freedom: what closes the account.
    pub kinetic_leapfrog: f64,
    /// The stored energy by its parts.
    pub energy: EnergyParts,
    /// What damping took, and what bonds dissipated by their rates.
    pub damping: f64,
    /// The work of the loads on free degrees of freedom.
    pub external: f64,
    /// The work of changing parameters of the energy; nothing where they do not change.
    pub parameters: Option<f64>,
    /// The work against `dE/du`, and against what bonds dissipate, where displacements or velocities are
    /// prescribed.
    pub prescribed: f64,
    /// The error of the integration: the change of the stored energy less the work against its
    /// forces, which goes with the square of the step; 0 where forces are linear in `u`.
    pub quadrature: f64,
    /// `kinetic_leapfrog` and work against forces, less external and prescribed work, plus damping,
    /// since the start: zero but for rounding.
    pub rounding: f64,
    /// The energy that broken bonds held when they broke.
    pub released: f64,
    /// The energy that bonds lost by what they came to remember.
    pub dissipated: f64,
    /// The work that the forces which went would have done over the halves of steps at whose ends they
    /// went.
    pub timing: f64,
    /// The energy that breaking and remembering added to the stored energy, in the steps in which they did not
    /// take from it: what `released` and `dissipated` fell by, step by step.
    pub created: f64,
    /// How many bonds are broken, those of cracks included; nothing where none can break.
    pub broken: Option<usize>,
    /// How many triangles and tetrahedra broke by criteria of their own; nothing where they have none.
    pub broken_cliques: [Option<usize>; 2],
    /// `sum m v` in kg m/s, as many numbers as dimensions.
    pub momentum: Vec<f64>,
    /// `sum m x cross v` about the origin, `x = X + u`, in kg m^2/s: one number in the plane, three in
    /// space.
    pub angular_momentum: Vec<f64>,
}

/// The sums of a motion.
#[derive(Clone, Debug, Default)]
pub(super) struct Balance {
    /// Work since the start, up to the present time.
    internal: Sum,
    external: Sum,
    damping: Sum,
    prescribed: Sum,
    /// What bonds dissipate of the work where something is prescribed.
    held: Sum,
    released: Sum,
    dissipated: Sum,
    timing: Sum,
    /// Of the whole body.
    created: Sum,
    /// What the stored energy changed by while the body moved, where parameters change.
    moved: Sum,
    /// The other half of the trapezoid, as powers: of the step to come.
    after: [f64; 5],
    /// At the start.
    first: Option<First>,
    kinetic: f64,
    /// The largest of all columns so far.
    largest: f64,
}

#[derive(Clone, Copy, Debug)]
struct First {
    kinetic: f64,
    energy: f64,
}

impl Balance {
    /// How many numbers it is.
    pub(super) const N_NUMBERS: usize = 10 + 5 + 4 + 10;

    /// All that it knows.
    pub(super) fn numbers(&self) -> Vec<f64> {
        let sums = [self.internal, self.external, self.damping, self.prescribed, self.held];
        let first = self.first.unwrap_or(First { kinetic: f64::NAN, energy: f64::NAN });
        let sums = sums.into_iter().flat_map(|sum| [sum.value, sum.low]);
        let rest = [first.kinetic, first.energy, self.kinetic, self.largest];
        let broken = [self.released, self.timing, self.dissipated, self.moved, self.created];
        let broken = broken.into_iter().flat_map(|sum| [sum.value, sum.low]);
        sums.chain(self.after).chain(rest).chain(broken).collect()
    }

    /// Adds the numbers of another part of the body: all are sums, but for those that are of the whole body.
    pub(super) fn add_numbers(numbers: &mut [f64], more: &[f64]) {
        let own = numbers.iter_mut().zip(more).enumerate();
        own.filter(|(place, _)| !OF_BODY.contains(place)).for_each(|(_, (sum, more))| *sum += more);
    }

    /// The numbers of a part that has nothing of these sums.
    pub(super) fn nothing_beside(numbers: &[f64]) -> Vec<f64> {
        let of =
            |(place, number): (usize, &f64)| if OF_BODY.contains(&place) { *number } else { 0.0 };
        numbers.iter().enumerate().map(of).collect()
    }

    /// From these numbers, [`Balance::N_NUMBERS`] of them.
    pub(super) fn of(numbers: &[f64]) -> Balance {
        let sum = |place: usize| Sum { value: numbers[place], low: numbers[place + 1] };
        let (kinetic, energy) = (numbers[15], numbers[16]);
        Balance {
            internal: sum(0),
            external: sum(2),
            damping: sum(4),
            prescribed: sum(6),
            held: sum(8),
            released: sum(19),
            timing: sum(21),
            dissipated: sum(23),
            moved: sum(25),
            created: sum(CREATED),
            after: [10, 11, 12, 13, 14].map(|place| numbers[place]),
            first: (!energy.is_nan()).then_some(First { kinetic, energy }),
            kinetic: numbers[17],
            largest: numbers[LARGEST],
        }
    }

    /// Takes in the state at the end of a step of `dt`: `sums` of its kick, and where something is
    /// prescribed the powers of the internal forces and of what bonds dissipate. At the start no step came
    /// before.
    pub(super) fn arrive(&mut self, dt: f64, sums: &Sums, [prescribed, held]: [Sides; 2]) {
        let sides = [sums.internal, sums.external, sums.damping, prescribed, held];
        self.kinetic = sums.kinetic;
        if self.first.is_some() {
            let Balance { internal, external, damping, prescribed, held, .. } = self;
            let work = [internal, external, damping, prescribed, held];
            for ((work, after), sides) in work.into_iter().zip(self.after).zip(sides) {
                work.add(0.5 * dt * (after + sides.before));
            }
        }
        self.after = sides.map(|sides| sides.after);
    }

    /// Takes in the works of a whole step.
    pub(super) fn step(&mut self, works: &Works) {
        self.internal.add(works.internal);
        self.external.add(works.external);
        self.damping.add(works.damping);
        self.prescribed.add(works.prescribed);
        self.kinetic = works.kinetic;
    }

    /// Takes in what bonds leave that break, or remember something else, at the present time.
    pub(super) fn release(&mut self, release: &Release) {
        self.released.add(release.energy);
        self.dissipated.add(release.dissipated);
        self.timing.add(release.timing);
    }

    /// Takes in what breaking and remembering added in a step to the stored energy of the whole body, in J.
    pub(super) fn create(&mut self, energy: f64) {
        self.created.add(energy);
    }

    /// Takes in what the stored energy changed by, in J, while the body went a step and parameters stood still.
    pub(super) fn go(&mut self, change: f64) {
        self.moved.add(change);
    }

    /// Before the first step, with the kinetic energy in J of the free degrees of freedom.
    pub(super) fn begin(&mut self, kinetic: f64) {
        self.kinetic = kinetic;
    }

    /// Begins the account, unless it has begun, with the stored energy in J.
    pub(super) fn open(&mut self, energy: f64) {
        self.first.get_or_insert(First { kinetic: self.kinetic, energy });
    }

    /// The row at the present time of a body whose parts have these `numbers` together
    /// ([`Balance::numbers`]), in which the caller fills in what is no energy: of the stored energy, and
    /// whether its parameters change.
    pub(super) fn row_of(
        &mut self,
        numbers: &[f64],
        (step, t): (usize, f64),
        parts: (EnergyParts, bool),
        kinetic: f64,
    ) -> Row {
        let (largest, created) = (self.largest, self.created);
        let mut whole = Balance { largest, created, ..Balance::of(numbers) };
        let row = whole.row(step, t, parts, kinetic);
        self.largest = whole.largest;
        row
    }

    fn row(
        &mut self,
        step: usize,
        t: f64,
        (energy, changes): (EnergyParts, bool),
        kinetic: f64,
    ) -> Row {
        let stored = energy.total();
        let first = *self.first.get_or_insert(First { kinetic: self.kinetic, energy: stored });
        let [internal, external, damping, prescribed] =
            [self.internal, self.external, self.damping, self.prescribed].map(Sum::total);
        let [released, dissipated, timing] =
            [self.released, self.dissipated, self.timing].map(Sum::total);
        let held = self.held.total();
        let works = [external, damping + held, prescribed + held, released, dissipated, timing];
        let gained = (stored - first.energy) + (released + dissipated);
        let moved = if changes { self.moved.total() } else { gained };
        let parameters = gained - moved;
        let columns = [self.kinetic, kinetic, energy.magnitude(), parameters];
        let columns = columns.into_iter().chain(works);
        self.largest = columns.fold(self.largest, |most, x| most.max(x.abs()));
        Row {
            step,
            t,
            kinetic,
            kinetic_leapfrog: self.kinetic,
            energy,
            damping: damping + held,
            external,
            parameters: changes.then_some(parameters),
            prescribed: prescribed + held,
            quadrature: moved - timing - (internal + prescribed),
            rounding: (self.kinetic - first.kinetic) + internal - external + damping,
            released,
            dissipated,
            timing,
            created: self.created.total(),
            broken: None,
            broken_cliques: [None; 2],
            momentum: Vec::new(),
            angular_momentum: Vec::new(),
        }
    }

    /// Whether the account closes at this row.
    pub(super) fn closes(&self, row: &Row) -> bool {
        row.rounding.abs() <= CLOSES_TO * self.largest
    }

    /// The largest of all columns so far, in J.
    pub(super) fn largest(&self) -> f64 {
        self.largest
    }
}
