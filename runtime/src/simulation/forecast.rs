//! What a case will model and what it costs, said before anything large is built.
//!
//! | body | what is known |
//! |---|---|
//! | up to 4 million neighbours in all | everything that a run would refuse, interactions counted |
//! | larger | sets and conditions; interactions from some of its points |
//! | a box of more than 400,000 points, not filled | energies; interactions from the box |

use std::time::Duration;

use super::{Case, CaseError, Compiled, rehearsal, run, size};
use crate::kernel::Measure;
use crate::matrix::BlockPattern;
use crate::neighborhood::Neighborhood;
use crate::plan::{
    Extent, Families, InteractionCount, KernelNote, Needed, Plan, PlanInput, available_memory,
    count_in_box, count_interactions, estimate_interactions,
};
use crate::scene::boundary::BoundaryConditions;
use crate::scene::{LatticeShape, Points, Scene};
use piola_compiler::Model;

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
    /// half a second allows.
    ///
    /// # Errors
    /// As [`Case::plan`].
    pub fn rehearsed_plan(&self, threads: usize) -> Result<Plan, CaseError> {
        let (mut plan, compiled) = self.plan_and_energies(threads)?;
        let is_quick = plan.time.setup + 2.0 * plan.time.assembly < 0.5 * PATIENCE.as_secs_f64();
        if self.large_box().is_none()
            && is_quick
            && let Ok(Some(first)) = rehearsal::first_increment(self, compiled, PATIENCE)
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
        Ok(self.plan_and_energies(threads)?.0)
    }

    fn plan_and_energies(&self, threads: usize) -> Result<(Plan, Compiled), CaseError> {
        self.check_rest()?;
        let compiled = self.compile()?;
        let needed = Needed {
            triangles: compiled.measures.contains(&Measure::Area),
            tetrahedra: compiled.measures.contains(&Measure::Volume),
        };
        let Outline { extent, interactions, prescribed, notes } = match self.large_box() {
            Some(shape) => self.outline_of_box(shape, needed),
            None => self.outline_of_points(needed)?,
        };
        let gathered = compiled.gathered.as_ref().map(|g| Families::States(g.integrals.len()));
        let settings = self.scene.correspondence.as_ref().filter(|_| compiled.gradient.is_some());
        let plan = Plan::new(PlanInput {
            scene: &self.scene,
            extent,
            interactions,
            kernels: kernel_notes(&compiled, &self.model, &self.scene),
            families: gathered.or(settings.map(|settings| settings.discretisation.into())),
            prescribed,
            notes,
            threads,
            available_memory: available_memory(),
        });
        Ok((plan, compiled))
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
            run::check_held(self, &bonds, &boundary)?;
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
}

fn kernel_notes(compiled: &Compiled, model: &Model, scene: &Scene) -> Vec<KernelNote> {
    let modelled = compiled.measures.iter().map(|m| KernelNote {
        energy: format!("psi({})", m.symbol()),
        modelled: true,
        reason: String::new(),
    });
    let dropped = compiled.dropped.iter().map(|d| KernelNote {
        energy: format!("psi({})", d.argument),
        modelled: false,
        reason: d.reason.clone(),
    });
    let gradient = compiled.gradient.iter().map(|_| KernelNote {
        energy: "psi(F)".to_string(),
        modelled: true,
        reason: scene.correspondence.as_ref().map_or_else(String::new, |c| c.to_string()),
    });
    let mut heads: Vec<&str> = Vec::new();
    let gathered = compiled.gathered.as_ref();
    let energies = model.variant(scene.body.dimension).map(|v| &v.gathered_energies);
    for energy in energies.into_iter().flatten() {
        let law = gathered
            .and_then(|g| if energy.of_bonds { g.bonds.as_ref() } else { g.points.as_ref() });
        if law.is_some() && !heads.contains(&energy.head.as_str()) {
            heads.push(&energy.head);
        }
    }
    let gathered = heads.into_iter().map(|head| KernelNote {
        energy: format!("psi({head})"),
        modelled: true,
        reason: "gathered over families".to_string(),
    });
    modelled.chain(gradient).chain(gathered).chain(dropped).collect()
}
