//! What the solver reports, step by step: the input of the tables, the picture and the summary.

use piola_mechanics::energy::EnergyParts;
use piola_mechanics::interaction::Inverted;

use super::fracture::FractureTable;

/// The converged steps of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct History {
    /// 2 or 3: how many numbers a reaction has.
    pub dimension: usize,
    /// Names of the parts of the energy, `psi(l)`.
    pub parts: Vec<String>,
    /// Names of the sets, in the scene's order.
    pub sets: Vec<String>,
    /// Names of the probes, in the scene's order.
    pub probes: Vec<String>,
    /// Which of the sets have a component that is prescribed; elsewhere reactions are rounding, or those of
    /// another set.
    pub prescribed: Vec<bool>,
    /// The body at rest, where that is known.
    pub at_rest: Option<SetsAtRest>,
    /// One record per converged step.
    pub steps: Vec<StepRecord>,
    /// Of a body that can break.
    pub fracture: Option<FractureTable>,
}

/// What holds the sets of a body at rest, before the first step.
#[derive(Clone, Debug, PartialEq)]
pub struct SetsAtRest {
    /// As [`StepRecord::reactions`].
    pub reactions: Vec<Vec<f64>>,
    /// As [`StepRecord::forces`].
    pub forces: Vec<Vec<f64>>,
}

/// One converged load step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepRecord {
    /// Load parameter at the end of the step.
    pub t: f64,
    /// Newton iterations: linear systems solved.
    pub iterations: usize,
    /// 2-norm of the free components of the residual in N, before each iteration and after the last.
    pub residual: Vec<f64>,
    /// The same over the larger of the 2-norms of the reactions and the applied loads.
    pub residual_over_reaction: Vec<f64>,
    /// The energy by its parts, in J.
    pub energy_parts: EnergyParts,
    /// Sum of `dE/du` minus the applied loads over each set, `d` numbers in N, as `History::sets`.
    pub reactions: Vec<Vec<f64>>,
    /// Sum of `dE/du` over each set, its reactions and the loads on it, `d` numbers in N.
    pub forces: Vec<Vec<f64>>,
    /// Mean displacement of each set, by the volumes of its points, `d` numbers in m.
    pub moved: Vec<Vec<f64>>,
    /// Displacement at each probe, `d` numbers in m, as `History::probes`.
    pub probes: Vec<Vec<f64>>,
    /// Whether the equilibrium is stable.
    pub definiteness: Definiteness,
    /// Estimated condition of the tangent on the free degrees of freedom (1-norm); `None` where it
    /// was not factorised.
    pub condition: Option<f64>,
    /// Interactions turned inside out.
    pub inverted: Inverted,
    /// What broke, of a body that can break.
    pub broken: Option<Broken>,
}

/// What broke at a load step, and where the energy went since the start, in J.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Broken {
    /// How many bonds broke at this step.
    pub bonds: usize,
    /// How many triangles, and tetrahedra, broke at it by criteria of their own.
    pub cliques: [usize; 2],
    /// In how many rounds.
    pub rounds: usize,
    /// How many bonds are broken.
    pub all: usize,
    /// How many triangles, and tetrahedra, broke by criteria of their own; nothing where these have none.
    pub all_cliques: [Option<usize>; 2],
    /// What bonds held when they broke.
    pub released: f64,
    /// What bonds that remember lost as they came to remember something else.
    pub dissipated: f64,
    /// What the body gave away behind that at fixed loads.
    pub relaxed: f64,
    /// The work of loads.
    pub external: f64,
    /// The work where displacements are prescribed.
    pub prescribed: f64,
    /// What the trapezoidal rule of that work misses.
    pub quadrature: f64,
}

/// Whether the tangent at an equilibrium is positive definite, and how that is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Definiteness {
    /// `None` where nobody looked or the method cannot tell.
    pub positive_definite: Option<bool>,
    /// In words, for instance `Cholesky`.
    pub method: String,
}

impl History {
    /// A history without steps.
    pub fn new(
        dimension: usize,
        parts: Vec<String>,
        sets: Vec<String>,
        probes: Vec<String>,
    ) -> History {
        let prescribed = vec![true; sets.len()];
        let (at_rest, fracture, steps) = (None, None, Vec::new());
        History { dimension, parts, sets, probes, prescribed, at_rest, steps, fracture }
    }

    /// Appends a step.
    ///
    /// The record must have one reaction, force and displacement per set and one displacement per probe, `d`
    /// numbers each;
    /// anything else is a mistake of the caller, not of a user.
    pub fn push(&mut self, step: StepRecord) {
        let fits = |rows: &[Vec<f64>], names: &[String]| {
            rows.len() == names.len() && rows.iter().all(|row| row.len() == self.dimension)
        };
        assert!(fits(&step.reactions, &self.sets), "a reaction of d numbers per set");
        assert!(fits(&step.forces, &self.sets), "a force of d numbers per set");
        assert!(fits(&step.moved, &self.sets), "a displacement of d numbers per set");
        assert!(fits(&step.probes, &self.probes), "a displacement of d numbers per probe");
        self.steps.push(step);
    }
}
