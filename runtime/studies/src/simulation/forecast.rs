//! What a case will model and what it costs, said before anything large is built.
//!
//! | body | what is known |
//! |---|---|
//! | up to 4 million neighbours in all | everything that a run would refuse, interactions counted |
//! | larger | sets and conditions; interactions from some of its points |
//! | a box of more than 400,000 points, not filled | energies; interactions from the box |

use std::time::Duration;

use piola_grammar::counted;
use piola_mechanics::assembly::Elements;
use piola_mechanics::element::Element;
use piola_mechanics::energy::Products;
use piola_mechanics::kernel::Measure;
use piola_mechanics::matrix::BlockPattern;
use piola_mechanics::neighborhood::Neighborhood;
use piola_mechanics::weights::Weights;

use super::{rehearsal, run};
use crate::case::{Case, CaseError, Compiled, Potential, size};
use crate::machine::Machine;
use crate::plan::{
    Extent, Families, InteractionCount, KernelNote, Needed, Pace, Plan, PlanInput, RanksPlan,
    available_memory, count_in_box, count_interactions, estimate_interactions, families,
};
use crate::scene::boundary::BoundaryConditions;
use crate::scene::{LatticeShape, Passes, Points, Scene};

/// Boxes of more points than this are not filled for a plan.
const FILLED: f64 = 4e5;

/// Bodies with more neighbours in all are not searched whole for a plan.
const SEARCHED: f64 = 4e6;

/// How long a plan may work on the first increment.
const PATIENCE: Duration = Duration::from_millis(500);

/// What a plan is told of a body.
struct Outline {
    extent: Extent,
    interactions: InteractionCount,
    prescribed: usize,
    notes: Vec<String>,
}

impl Case {
    /// The box of a case that was read by [`Case::outline`] and has no points yet, if it is too large
    /// to be filled for a plan.
    pub fn large_box(&self) -> Option<&LatticeShape> {
        let Points::Lattice(shape) = &self.scene.body.points else { return None };
        let points: f64 = shape.counts().iter().map(|n| *n as f64).product();
        (points > FILLED && self.body.n_points() == 0).then_some(shape)
    }

    /// As [`Case::plan`], with the first increment of bodies that are small enough for it solved as far as
    /// half a second allows; the times of others are those of this machine.
    ///
    /// # Errors
    /// As [`Case::plan`].
    pub fn rehearsed_plan(&self, threads: usize, machine: &Machine) -> Result<Plan, CaseError> {
        let pace = Pace::of(machine, threads);
        let (mut plan, compiled) = self.plan_and_energies(threads, pace)?;
        let is_quick = plan.time.setup + 2.0 * plan.time.assembly < 0.5 * PATIENCE.as_secs_f64();
        let stored = plan.stored.as_ref().map_or(0.0, |stored| stored.assembly + stored.linear);
        let stored = Duration::try_from_secs_f64(stored).unwrap_or(Duration::MAX);
        if self.large_box().is_none()
            && self.scene.motion.is_none()
            && is_quick
            && let Ok(Some(first)) = rehearsal::first_increment(self, compiled, PATIENCE, stored)
        {
            plan.rehearsed(first);
        }
        Ok(plan)
    }

    /// What will be modelled and what it costs; within a second or so for any case.
    ///
    /// # Errors
    /// What a run would refuse: as [`Case::compile`] and [`Case::check_rest`], more neighbours than the
    /// machine's memory holds, wrong sets and conditions, and motions that nothing holds. Of large
    /// bodies not all of that is looked for; the plan's notes say what is not.
    pub fn plan(&self, threads: usize) -> Result<Plan, CaseError> {
        Ok(self.plan_and_energies(threads, Pace::usual(threads))?.0)
    }

    fn plan_and_energies(
        &self,
        threads: usize,
        pace: Pace,
    ) -> Result<(Plan, Vec<Compiled>), CaseError> {
        self.check_rest()?;
        self.check_cut_families()?;
        let compiled = self.compile()?;
        let needed = Needed {
            triangles: compiled.iter().any(|all| all.measures.contains(&Measure::Area)),
            tetrahedra: compiled.iter().any(|all| all.measures.contains(&Measure::Volume)),
        };
        let Outline { extent, interactions, prescribed, notes } = match self.large_box() {
            Some(shape) => self.outline_of_box(shape, needed),
            None => self.outline_of_points(needed)?,
        };
        let without_kernels = self.without_kernels(&compiled, extent.is_lattice);
        let [areas, volumes] = self.can_break_cliques();
        let breaks_cliques = [areas && needed.triangles, volumes && needed.tetrahedra];
        let plan = Plan::new(PlanInput {
            scene: &self.scene,
            extent,
            interactions,
            kernels: self.kernel_notes(&compiled),
            energies: costs(&compiled),
            without_kernels,
            breaks: self.can_break(),
            breaks_cliques,
            states: self.n_states_of(),
            of_interactions: layers(&compiled, Compiled::has_interactions),
            families: self.families(&compiled),
            prescribed,
            notes,
            threads,
            pace,
            available_memory: available_memory(),
        });
        Ok((plan, compiled))
    }

    /// Of which passes need no kernels; see [`PlanInput::without_kernels`].
    fn without_kernels(&self, compiled: &[Compiled], is_lattice: bool) -> [bool; 3] {
        let by_direction = self.potentials.iter().all(Potential::varies_by_direction_alone);
        // A measure that may not change its sign is looked at in batches.
        let goes_so = |element: &dyn Element| {
            let may_invert = element.measure() == Measure::Length || !element.forbids_inversion();
            element.has_affine_law(by_direction) && may_invert
        };
        let all_do = |pick: fn(&Elements) -> Option<&dyn Element>| {
            compiled.iter().filter_map(|one| pick(&one.elements)).all(goes_so)
        };
        let solver = &self.scene.solver;
        let may = solver.passes == Passes::Auto
            && solver.products == Products::Exact
            && !self.changes_in_time();
        [
            may && all_do(|elements| elements.bond.as_deref()),
            may && is_lattice && all_do(|elements| elements.triangle.as_deref()),
            may && is_lattice && all_do(|elements| elements.tetrahedron.as_deref()),
        ]
    }

    fn outline_of_box(&self, shape: &LatticeShape, needed: Needed) -> Outline {
        let mut notes = vec![
            "sets, conditions and motions that nothing holds: the box has too many points to be \
             filled for a plan"
                .to_string(),
        ];
        if !self.scene.body.remove.is_empty() {
            notes.push("how many points are removed: all of the box are counted".to_string());
        }
        let interactions = count_in_box(shape, self.scene.horizon_radius(), needed);
        Outline { extent: Extent::of_box(shape), interactions, prescribed: 0, notes }
    }

    fn outline_of_points(&self, needed: Needed) -> Result<Outline, CaseError> {
        let horizon = self.scene.horizon_radius();
        let family = size::family(&self.body, horizon);
        size::check_neighbors(&self.body, horizon, family)?;
        let selection = self.selection()?;
        let boundary = BoundaryConditions::new(&self.scene, &self.body, &selection)?;
        let mut notes = Vec::new();
        let interactions = if family * self.body.n_points() as f64 <= SEARCHED {
            let neighborhood = Neighborhood::new(&self.body, horizon)?;
            let bonds = BlockPattern::of_bonds(&neighborhood, self.body.dimension());
            if self.scene.motion.is_none() {
                run::check_held(self, &bonds, &boundary)?;
            }
            count_interactions(&self.body, &neighborhood, needed)
        } else {
            notes.push(
                "motions that nothing holds, and points at one place: the body has too many \
                 neighbours to be searched for a plan"
                    .to_string(),
            );
            estimate_interactions(&self.body, horizon, family, needed)?
        };
        let prescribed = boundary.fixed_dofs().len();
        Ok(Outline { extent: Extent::of(&self.body), interactions, prescribed, notes })
    }

    /// What each of so many processes takes of a case with this plan.
    ///
    /// # Errors
    /// As [`Case::compile`]; more processes than points.
    pub fn plan_over_ranks(&self, plan: &Plan, ranks: usize) -> Result<RanksPlan, CaseError> {
        let extent = match self.large_box() {
            Some(shape) => Extent::of_box(shape),
            None => Extent::of(&self.body),
        };
        enough_points(extent.points, ranks)?;
        let coupled = families::reach(&self.families(&self.compile()?));
        let lengths = (self.scene.horizon_radius(), self.reach(), coupled);
        let dissipates = |potential: &Potential| !potential.model.dissipations().is_empty();
        let dissipates = self.potentials.iter().any(dissipates);
        Ok(RanksPlan::new(plan, &extent, lengths, dissipates, ranks))
    }

    /// How far away points are on which the force on a point depends, in m.
    ///
    /// An interaction is of points within the horizon of one another. Where interactions are corrected or weighted by
    /// what surrounds their points it is that which lies a horizon further. What a family gathers is felt by its members,
    /// and energies of bonds take what both ends gather: three horizons.
    pub(super) fn reach(&self) -> f64 {
        let horizon = &self.scene.horizon;
        let horizons = if self.potentials.iter().any(Potential::has_families) {
            3.0
        } else if horizon.correction_span.is_some() || horizon.weights == Weights::Truncated {
            2.0
        } else {
            1.0
        };
        horizons * self.scene.horizon_radius()
    }

    /// Energies that the scene does not need, each with its reason.
    ///
    /// # Errors
    /// As [`Case::compile`].
    pub fn dropped_energies(&self) -> Result<Vec<String>, CaseError> {
        let notes = self.kernel_notes(&self.compile()?);
        Ok(notes.into_iter().filter(|note| !note.modelled).map(|note| note.reason).collect())
    }

    /// What points know of their families, for each energy that needs it.
    pub(super) fn families(&self, compiled: &[Compiled]) -> Vec<Families> {
        let settings = self.scene.correspondence.clone().unwrap_or_default();
        let of = |layer: usize| {
            let own = compiled.iter().filter(move |one| one.layer == layer);
            let n_integrals = |one: &Compiled| one.gathered.as_ref().map(|g| g.integrals.len());
            let gathered = own.clone().filter_map(n_integrals).max().map(Families::States);
            let vectors = own.clone().filter_map(|one| one.vectors.as_ref()).next();
            let of_vectors = |one: &piola_compiler::VectorKernels| {
                Families::Vectors(one.n_gathered, one.has_neighbours())
            };
            let gradient = own.filter_map(|one| one.gradient.as_ref()).next();
            [gathered, vectors.map(of_vectors), gradient.map(|_| settings.discretisation.into())]
        };
        let n_layers = compiled.iter().map(|one| one.layer + 1).max().unwrap_or(0);
        (0..n_layers).flat_map(of).flatten().collect()
    }

    /// What becomes of the energies; of several potentials with their names.
    fn kernel_notes(&self, compiled: &[Compiled]) -> Vec<KernelNote> {
        let alone = compiled.len() == 1;
        let of = |compiled: &Compiled| {
            let name = compiled.label.clone();
            let notes = kernel_notes(compiled, &self.scene).into_iter();
            notes.map(move |note| match alone {
                true => note,
                false => KernelNote { energy: format!("{name}: {}", note.energy), ..note },
            })
        };
        compiled.iter().flat_map(of).collect()
    }
}

/// Refuses more processes than there are points.
pub(super) fn enough_points(n_points: usize, ranks: usize) -> Result<(), CaseError> {
    if ranks <= n_points {
        return Ok(());
    }
    let points = counted(n_points, "point");
    let message =
        format!("the body has {points}, too few for {ranks} ranks: start at most {n_points}");
    Err(CaseError::Body { message })
}

/// How many energies of bonds, triangles and tetrahedra there are.
pub(super) fn energies(compiled: &[Compiled]) -> [usize; 3] {
    [Measure::Length, Measure::Area, Measure::Volume]
        .map(|measure| layers(compiled, |one| one.measures.contains(&measure)))
}

/// How many times as long as those of one measure energies of several take, of triangles and of
/// tetrahedra: measured were 12 and 22 times for forces and tangents of triangles with an angle.
const SEVERAL: [usize; 2] = [20, 40];

/// The same, energies of several measures as so many.
fn costs(compiled: &[Compiled]) -> [usize; 3] {
    let several = |pick: fn(&Elements) -> Option<&dyn Element>| {
        layers(compiled, |one| {
            pick(&one.elements).is_some_and(|own| own.argument() != own.measure().symbol())
        })
    };
    let [bonds, triangles, tetrahedra] = energies(compiled);
    let of_triangles = several(|elements| elements.triangle.as_deref());
    let of_tetrahedra = several(|elements| elements.tetrahedron.as_deref());
    [
        bonds,
        triangles + (SEVERAL[0] - 1) * of_triangles,
        tetrahedra + (SEVERAL[1] - 1) * of_tetrahedra,
    ]
}

/// How many sums have a part like this: potentials of several materials in one are one.
pub(super) fn layers(compiled: &[Compiled], has: impl Fn(&Compiled) -> bool) -> usize {
    let own = compiled.iter().filter(|one| has(one)).map(|one| one.layer);
    own.collect::<std::collections::BTreeSet<_>>().len()
}

fn kernel_notes(compiled: &Compiled, scene: &Scene) -> Vec<KernelNote> {
    let modelled = |argument: &str, reason: String| KernelNote {
        energy: format!("psi({argument})"),
        modelled: true,
        reason,
    };
    let measures = compiled.of_interactions().map(|argument| modelled(argument, String::new()));
    let gradient = compiled.gradient.iter().map(|_| {
        let reason = scene.correspondence.as_ref().map_or_else(String::new, |c| c.to_string());
        modelled("F", reason)
    });
    let laws = compiled.gathered.as_ref();
    let vectors = compiled.vectors.as_ref();
    let has = [
        laws.is_some_and(|g| g.points.is_some()) || vectors.is_some_and(|g| g.points.is_some()),
        laws.is_some_and(|g| g.bonds.is_some()) || vectors.is_some_and(|g| g.bonds.is_some()),
    ];
    let gathered = compiled.arguments.iter().zip(has).filter(|(_, has)| *has);
    let gathered =
        gathered.map(|(argument, _)| modelled(argument, "gathered over families".into()));
    let dropped = compiled.dropped.iter().map(|d| KernelNote {
        energy: format!("psi({})", d.argument),
        modelled: false,
        reason: d.reason.clone(),
    });
    measures.chain(gradient).chain(gathered).chain(dropped).collect()
}
