//! Newton's method without a stored tangent on the traction bar.

use std::sync::{Arc, Mutex};

use piola_runtime::deformation::{Discretisation, Stabilisation};
use piola_runtime::energy::{Energy, Products, Total};
use piola_runtime::matrix::BlockMatrix;
use piola_runtime::solve::linear::{
    LinearMethod, LinearOptions, LinearSolver, PreconditionerChoice, Tangent,
};
use piola_runtime::solve::newton::{Newton, NewtonFailure, NewtonSettings};
use piola_runtime::solve::{Event, Observer, Watch};

use crate::common::{error, norm};
use crate::traction_bar::Bar;

#[test]
fn elongations_are_those_recomputed_from_the_paper() {
    let wan = Discretisation::Stabilised(Stabilisation::Wan);
    for (discretisation, horizon, expected) in [
        (Discretisation::BondQuadrature, 2, -0.4694e-2),
        (Discretisation::BondQuadrature, 3, -0.1839e-2),
        (wan, 2, -1.4714e-2),
        (wan, 3, -1.5304e-2),
    ] {
        let solved = Bar::new(5, horizon, discretisation).solve(LinearOptions::default());
        println!(
            "{discretisation:?} m = {horizon}: {:+.4} %, {:?} iterations, {:.2} s, {}",
            100.0 * solved.error,
            solved.linear_iterations,
            solved.seconds,
            solved.preconditioner
        );
        // Half a unit of the last digit.
        assert!((solved.error - expected).abs() < 0.5e-6, "{discretisation:?} {horizon}");
        assert!(solved.newton_iterations <= 6);
        assert!(solved.linear_iterations.iter().all(|&n| n < 60));
    }
}

#[test]
fn indefinite_tangents_are_solved_by_minimum_residuals() {
    let bar = Bar::new(3, 2, Discretisation::BondQuadrature);
    let energy = &bar.energy;
    // Pressed together to a half: St Venant-Kirchhoff material has lost its stability.
    let squeeze = |(dof, x): (usize, &f64)| if dof % 3 == 0 { -0.5 * x } else { 0.0 };
    let u: Vec<f64> = energy.positions().iter().enumerate().map(squeeze).collect();
    let pattern = energy.bond_pattern().unwrap();
    let mut bonds = BlockMatrix::zeros(pattern);
    energy.springs(&u, &mut bonds);
    let options = LinearOptions { cg_tolerance: 1e-6, ..LinearOptions::default() };
    let mut solver = LinearSolver::of_energy(energy, &bar.constraints, options).unwrap();
    let mut x = vec![0.0; u.len()];
    let hessian = energy.hessian(&u).unwrap();
    let tangent = Tangent::Bonds { hessian: &*hessian, bonds: &bonds };
    let report = solver.solve(tangent, &bar.loads, &mut x).unwrap();
    assert_eq!(report.method, LinearMethod::MinimumResidual, "{report:?}");
    assert_eq!(report.positive_definite, Some(false));
    let mut product = vec![0.0; u.len()];
    energy.hessian(&u).unwrap().multiply(&x, &mut product);
    let left = |x: &[f64]| norm(&bar.constraints.free_part(x));
    let residual: Vec<f64> = product.iter().zip(&bar.loads).map(|(p, f)| p - f).collect();
    println!("{} iterations, {:.1e}", report.iterations, left(&residual) / left(&bar.loads));
    assert!(left(&residual) < options.cg_tolerance * left(&bar.loads), "{:e}", left(&residual));
}

#[test]
fn stored_and_not_stored_tangents_lead_to_the_same_equilibrium() {
    for discretisation in
        [Discretisation::BondQuadrature, Discretisation::Stabilised(Stabilisation::Isotropic)]
    {
        let bar = Bar::new(3, 2, discretisation);
        let of = |method, preconditioner| {
            bar.solve(LinearOptions { method, preconditioner, ..LinearOptions::default() })
        };
        let direct = of(LinearMethod::Cholesky, PreconditionerChoice::Auto);
        for preconditioner in [
            PreconditionerChoice::Auto,
            PreconditionerChoice::TwoLevel,
            PreconditionerChoice::BlockJacobi,
        ] {
            let free = of(LinearMethod::MatrixFree, preconditioner);
            println!("{preconditioner:?}: {:?} {}", free.linear_iterations, free.preconditioner);
            // Both at the floor of Newton's method: measured are 1.3e-15.
            assert!(error(&free.u, &direct.u) < 1e-14, "{preconditioner:?}");
        }
        assert_eq!(direct.linear_iterations, vec![0; direct.newton_iterations]);
        assert!(bar.energy.bond_pattern().is_some());
    }
}

/// What is well preconditioned never stores its tangent; points that alternate freely take so many
/// products that a stored one and its factors are cheaper, and prove that the bar is stable.
#[test]
fn a_stored_tangent_takes_over_where_products_cost_more() {
    for (discretisation, goes_over) in
        [(Discretisation::BondQuadrature, false), (Discretisation::Nodal, true)]
    {
        let bar = Bar::new(4, 3, discretisation);
        let of = |method| bar.solve(LinearOptions { method, ..LinearOptions::default() });
        let (auto, products) = (of(LinearMethod::Auto), of(LinearMethod::MatrixFree));
        println!(
            "{discretisation:?}: {:?} {:?}",
            auto.linear_iterations, products.linear_iterations
        );
        let most = products.linear_iterations.iter().max().copied().unwrap_or(0);
        assert_eq!((most > 150, most < 60), (goes_over, !goes_over), "{most}");
        assert_eq!(auto.stores_matrix, goes_over, "{:?}", auto.linear_iterations);
        assert_eq!(bar.energy.has_pattern(), goes_over);
        assert!(error(&auto.u, &products.u) < 1e-9, "{:e}", error(&auto.u, &products.u));
        // Given up once at most: what follows takes no products.
        let with_products = auto.linear_iterations.iter().filter(|&&n| n > 0).count();
        assert!(!goes_over || with_products == 0, "{:?}", auto.linear_iterations);
    }
}

/// Wants an end once a stored tangent is to take over, and keeps why.
#[derive(Default)]
struct UntilStored(Mutex<Vec<String>>);

impl Observer for UntilStored {
    fn notice(&self, event: Event<'_>) {
        if let Event::Stores(choice) = event {
            assert_eq!((choice.method, choice.stores_matrix), (LinearMethod::Cholesky, true));
            self.0.lock().unwrap().push(choice.reason.clone());
        }
    }

    fn wants_end(&self) -> bool {
        !self.0.lock().unwrap().is_empty()
    }
}

/// Whoever looks on sees the change-over before it costs anything, and the solver stays what it was
/// where that ends the search.
#[test]
fn a_search_may_end_before_the_tangent_is_stored() {
    for (discretisation, goes_over) in
        [(Discretisation::BondQuadrature, false), (Discretisation::Nodal, true)]
    {
        let bar = Bar::new(4, 3, discretisation);
        let settings = NewtonSettings::default();
        let options = LinearOptions::default();
        let mut newton = Newton::new(&bar.energy, &bar.constraints, settings, options).unwrap();
        let observer = Arc::new(UntilStored::default());
        newton.watched(&Watch::by(Arc::clone(&observer) as Arc<dyn Observer>));
        let ended = bar.solve_with(&mut newton).err().map(|error| error.failure);
        assert_eq!(ended, goes_over.then_some(NewtonFailure::Interrupted));
        let reasons = observer.0.lock().unwrap();
        assert_eq!(reasons.len(), usize::from(goes_over));
        assert!(reasons.iter().all(|reason| reason.contains("did not converge")), "{reasons:?}");
        assert!(!newton.linear().stores_matrix());
        assert_eq!(newton.linear().n_factorizations(), 0);
    }
}

#[test]
fn products_by_differences_lead_to_the_same_bar() {
    let bar = Bar::new(5, 2, Discretisation::BondQuadrature);
    let exact = bar.solve(LinearOptions::default());
    for products in [Products::OneSided, Products::Central] {
        let energy = Total::of(&bar.energy as &dyn Energy).with_products(products);
        let settings = NewtonSettings::default();
        let found = bar.solve_by(&energy, settings, LinearOptions::default()).unwrap();
        println!("{products:?}: {:?} {:.1e}", found.linear_iterations, found.residual);
        assert_eq!(found.newton_iterations, exact.newton_iterations);
        assert_eq!(found.preconditioner, exact.preconditioner);
        assert!(found.residual <= 1e-10 && error(&found.u, &exact.u) < 4e-13, "{products:?}");
    }
}
