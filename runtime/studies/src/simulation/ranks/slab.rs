//! What a rank evaluates: energy, forces and tangent of the points that it holds, of which those of its own count.

use piola_mechanics::energy::{Energy as _, NonFinite, Total, Wanted};
use piola_mechanics::matrix::BlockMatrix;
use piola_output::Frame;
use piola_petsc::{Engine, EngineError, Newton, Problem, Refusal};

use super::exchange::Exchange;
use super::rows::OwnRows;
use super::share::Share;
use crate::case::Case;
use crate::simulation::run::frame;

/// The part of a body that a rank holds; vectors are `n x d`, of all points held in the body's order, or of its own.
pub(super) struct Slab<'a> {
    engine: &'a Engine,
    energy: &'a Total<'a>,
    exchange: Exchange<'a>,
    d: usize,
    /// The first degree of freedom of its own points, of all that are held.
    first_own: usize,
    rows: OwnRows,
    tangent: BlockMatrix,
    /// Of all that are held.
    is_fixed: Vec<bool>,
    /// What is prescribed in m, where that is so; of all that are held.
    prescribed: Vec<f64>,
    /// In N, of its own.
    loads: Vec<f64>,
    /// What is compared with the forces.
    tolerance: f64,
    local: Vec<f64>,
    forces: Vec<f64>,
    /// Of the present solve: 2-norms of the free residual in N, and over the larger of reactions and loads.
    pub(super) residuals: Vec<[f64; 2]>,
    /// What was not finite last.
    pub(super) found: Option<NonFinite>,
}

impl<'a> Slab<'a> {
    /// Collective; `fixed` are prescribed degrees of freedom among those held, ascending.
    ///
    /// # Errors
    /// What PETSc reports.
    pub(super) fn new(
        (engine, share): (&'a Engine, &Share),
        energy: &'a Total<'a>,
        fixed: &[usize],
        tolerance: f64,
    ) -> Result<Slab<'a>, EngineError> {
        let d = energy.dimension();
        let own = share.own_of_held();
        let n = energy.positions().len();
        let mut is_fixed = vec![false; n];
        fixed.iter().for_each(|dof| is_fixed[*dof] = true);
        Ok(Slab {
            engine,
            energy,
            exchange: Exchange::new(engine, share, d)?,
            d,
            first_own: own.start * d,
            rows: OwnRows::new(energy.pattern(), own.clone(), share.held.start),
            tangent: BlockMatrix::zeros(energy.pattern()),
            is_fixed,
            prescribed: vec![0.0; n],
            loads: vec![0.0; own.len() * d],
            tolerance,
            local: vec![0.0; n],
            forces: vec![0.0; n],
            residuals: Vec::new(),
            found: None,
        })
    }

    /// A solver for it. Rigid motions are what multigrid knows of the body. Collective.
    ///
    /// # Errors
    /// What PETSc reports.
    pub(super) fn solver(&self, share: &Share) -> Result<Newton<'a>, EngineError> {
        let modes = self.rigid_motions();
        Newton::new(self.engine, &share.ranges, &self.rows.pattern, self.d, &modes)
    }

    /// Translations and rotations of its own points, which prescribed degrees of freedom take no part in.
    fn rigid_motions(&self) -> Vec<Vec<f64>> {
        let (d, n) = (self.d, self.loads.len());
        let x = &self.energy.positions()[self.first_own..self.first_own + n];
        // About the middle of the body, so that rotations are no translations.
        let mut middle = vec![0.0; d + 1];
        for position in x.chunks_exact(d) {
            position.iter().zip(&mut middle).for_each(|(x, sum)| *sum += x);
            middle[d] += 1.0;
        }
        self.engine.sum(&mut middle);
        let arm = |dof: usize, axis: usize| x[dof / d * d + axis] - middle[axis] / middle[d];
        let free = |dof: usize| if self.is_fixed[self.first_own + dof] { 0.0 } else { 1.0 };
        let of = |motion: &dyn Fn(usize) -> f64| -> Vec<f64> {
            (0..n).map(|dof| free(dof) * motion(dof)).collect()
        };
        let mut modes: Vec<Vec<f64>> =
            (0..d).map(|axis| of(&|dof| if dof % d == axis { 1.0 } else { 0.0 })).collect();
        let planes: &[(usize, usize)] = if d == 2 { &[(0, 1)] } else { &[(0, 1), (1, 2), (2, 0)] };
        for &(a, b) in planes {
            modes.push(of(&|dof| match dof % d {
                axis if axis == a => -arm(dof, b),
                axis if axis == b => arm(dof, a),
                _ => 0.0,
            }));
        }
        modes
    }

    /// Own degrees of freedom among those held.
    fn own(&self) -> std::ops::Range<usize> {
        self.first_own..self.first_own + self.loads.len()
    }

    /// What is prescribed from now on in m, one for each of `fixed`, and loads in N of all that are held.
    pub(super) fn drive(&mut self, fixed: &[usize], values: &[f64], loads: &[f64]) {
        for (&dof, &value) in fixed.iter().zip(values) {
            self.prescribed[dof] = value;
        }
        let own = self.own();
        self.loads.copy_from_slice(&loads[own]);
    }

    /// Loads in N on its own points.
    pub(super) fn loads(&self) -> &[f64] {
        &self.loads
    }

    /// `dE/du` in N of its own points, of the last evaluation.
    pub(super) fn own_forces(&self) -> &[f64] {
        &self.forces[self.own()]
    }

    /// Displacements in m of all that are held, of the last evaluation.
    pub(super) fn local(&self) -> &[f64] {
        &self.local
    }

    /// What is held of a case at the last evaluation, at `t`, with residuals of own points.
    pub(super) fn frame(&self, case: &Case, t: f64) -> Frame {
        let mut residual = vec![0.0; self.local.len()];
        let own = self.own_forces().iter().zip(&self.loads).map(|(g, f)| g - f);
        residual[self.own()].iter_mut().zip(own).for_each(|(r, x)| *r = x);
        frame(case, t, &self.local, &residual)
    }

    /// Own displacements as they are with what is prescribed.
    pub(super) fn settle(&self, u: &mut [f64]) {
        let (own, fixed) = (self.own(), &self.is_fixed);
        for (k, dof) in own.enumerate().filter(|(_, dof)| fixed[*dof]) {
            u[k] = self.prescribed[dof];
        }
    }

    /// Displacements of all that are held, from those of its own. Collective.
    fn bring(&mut self, u: &[f64]) -> Result<(), EngineError> {
        let own = self.own();
        self.local[own.clone()].copy_from_slice(u);
        for dof in own.filter(|dof| self.is_fixed[*dof]) {
            self.local[dof] = self.prescribed[dof];
        }
        self.exchange.fill(&mut self.local)
    }

    /// Forces at own displacements, and the tangent. Collective up to the evaluation, which fails on its own.
    fn evaluate(&mut self, u: &[f64], with_tangent: bool) -> Result<(), Refusal> {
        self.bring(u)?;
        let wanted = match with_tangent {
            true => Wanted::Tangent(&mut self.forces, &mut self.tangent),
            false => Wanted::Forces(&mut self.forces),
        };
        let mut parts = vec![0.0; self.energy.parts().len()];
        let parts = if with_tangent { &mut parts[..] } else { &mut [] };
        self.energy.evaluate(&self.local, wanted, parts).map_err(|found| {
            self.found = Some(found);
            Refusal::Outside
        })
    }

    /// Forces at own displacements; whether all ranks have them. Collective.
    ///
    /// # Errors
    /// What PETSc reports.
    pub(super) fn look_at(&mut self, u: &[f64], with_tangent: bool) -> Result<bool, EngineError> {
        let mut fails = [match self.evaluate(u, with_tangent) {
            Ok(()) => 0.0,
            Err(Refusal::Outside) => 1.0,
            Err(Refusal::Failed(message)) => return Err(EngineError { message }),
        }];
        self.engine.max(&mut fails);
        Ok(fails[0] == 0.0)
    }

    /// How far the body goes, linearised at `u`, where what is prescribed and loads are new: `before` has what was
    /// prescribed there, of all that are held. With the iterations that it took; nothing where it cannot be had. Collective.
    ///
    /// # Errors
    /// What PETSc reports.
    pub(super) fn response(
        &mut self,
        newton: &mut Newton<'_>,
        u: &[f64],
        before: &[f64],
    ) -> Result<Option<(Vec<f64>, u64)>, EngineError> {
        let now = std::mem::replace(&mut self.prescribed, before.to_vec());
        let known = self.look_at(u, true);
        self.prescribed = now;
        if !known? {
            return Ok(None);
        }
        let jump: Vec<f64> =
            self.prescribed.iter().zip(before).map(|(now, then)| now - then).collect();
        let pushed = self.tangent.multiply(&jump);
        let right: Vec<f64> = (self.loads.iter().zip(self.own()))
            .map(|(load, dof)| match self.is_fixed[dof] {
                true => 0.0,
                false => load - self.forces[dof] - pushed[dof],
            })
            .collect();
        let mut way = vec![0.0; u.len()];
        let solved = newton.solve_linear(self, &right, &mut way)?;
        Ok(solved.converged.then_some((way, solved.iterations)))
    }

    /// What is prescribed, of all that are held.
    pub(super) fn prescribed(&self) -> &[f64] {
        &self.prescribed
    }

    /// The larger of the 2-norms of reactions and loads over all ranks, in N. Collective.
    fn force(&self) -> f64 {
        let mut squares = [0.0; 2];
        for (k, dof) in self.own().enumerate() {
            if self.is_fixed[dof] {
                let reaction = self.forces[dof] - self.loads[k];
                squares[0] += reaction * reaction;
            }
            squares[1] += self.loads[k] * self.loads[k];
        }
        self.engine.sum(&mut squares);
        squares[0].max(squares[1]).sqrt()
    }
}

impl Problem for Slab<'_> {
    fn residual(&mut self, u: &[f64], r: &mut [f64]) -> Result<(), Refusal> {
        self.evaluate(u, false)?;
        for (k, dof) in self.own().enumerate() {
            // What is prescribed is taken for what PETSc has there, which is that but for rounding.
            r[k] = if self.is_fixed[dof] { 0.0 } else { self.forces[dof] - self.loads[k] };
        }
        Ok(())
    }

    fn tangent(&mut self, u: &[f64]) -> Result<(), Refusal> {
        self.evaluate(u, true)
    }

    fn row(&mut self, row: usize, values: &mut [f64]) {
        self.rows.write(row, &self.tangent, &self.is_fixed, values);
    }

    fn is_converged(&mut self, iteration: usize, norm: f64) -> bool {
        if iteration == 0 {
            self.residuals.clear();
            self.found = None;
        }
        let force = self.force();
        self.residuals.push([norm, if norm == 0.0 { 0.0 } else { norm / force }]);
        norm <= self.tolerance * force
    }
}
