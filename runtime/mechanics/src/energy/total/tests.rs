use super::*;
use crate::testing::{SpringNetwork, linear, pseudo_random, softening};
use crate::vector::norm_of;

#[test]
fn only_what_a_position_holds_is_seen() {
    let mut springs = SpringNetwork::lattice(&[3, 1], 1.5, linear);
    springs.positions = vec![1e6, 0.0, 1e6 + 1.0, 0.0, 1e6 + 2.0, 0.0];
    let energy = Total::of(&springs as &dyn Energy).from_positions(true);
    // Half a unit of the last place of 1e6 is 5.8e-11: less is lost, more is rounded.
    assert_eq!(
        energy.held(&[1e-12, 1e-12, 2.5 * 1.1641532182693481e-10, 0.0, 1.0, 0.0], &mut Vec::new()),
        [0.0, 1e-12, 2.0 * 1.1641532182693481e-10, 0.0, 1.0, 0.0]
    );
    let lost = energy.energy(&[0.0, 0.0, 1e-12, 0.0, 0.0, 0.0]).unwrap();
    assert_eq!(lost.total(), springs.energy(&[0.0; 6]).unwrap().total());
}

/// Two networks that reach differently far: one adds to the other's matrix.
#[test]
fn all_derivatives_add_up() {
    let near = SpringNetwork::lattice(&[4, 3], 1.0, softening);
    let far = SpringNetwork::lattice(&[4, 3], 2.0, linear);
    let names: Arc<[String]> = ["near", "far"].map(String::from).into();
    let terms = vec![Term::from(&near as &dyn Energy), Term::from(&far as &dyn Energy)];
    let sum = Total::named(terms, names);
    let n = near.positions.len();
    let u: Vec<f64> = pseudo_random(n, 3).iter().map(|x| 0.03 * x).collect();
    let p = pseudo_random(n, 4);
    let all = |energy: &dyn Energy| {
        let mut found = [const { Vec::new() }; 4];
        found.iter_mut().for_each(|x| x.resize(n, f64::NAN));
        let [forces, product, stored, diagonal] = &mut found;
        let mut matrix = BlockMatrix::zeros(energy.pattern());
        matrix.values.fill(f64::NAN);
        let parts = energy.tangent(&u, forces, &mut matrix).unwrap();
        energy.hessian(&u).unwrap().multiply(&p, product);
        stored.copy_from_slice(&matrix.multiply(&p));
        diagonal.resize(2 * n, f64::NAN);
        assert_eq!(energy.tangent_diagonal(&u, &mut vec![0.0; n], diagonal).unwrap(), parts);
        assert_eq!(energy.forces(&u, &mut vec![0.0; n]).unwrap(), parts);
        assert_eq!(energy.energy(&u).unwrap(), parts);
        (parts, found)
    };
    let ((one, ones), (other, others), (both, boths)) = (all(&near), all(&far), all(&sum));
    assert_eq!(both.iter().collect::<Vec<_>>(), [("near", one.total()), ("far", other.total())]);
    assert!(one.total() > 0.0 && other.total() > 0.0);
    for ((one, other), both) in ones.iter().zip(&others).zip(&boths) {
        let error: Vec<f64> =
            one.iter().zip(other).zip(both).map(|((x, y), sum)| x + y - sum).collect();
        assert!(norm_of(&error) <= 1e-15 * norm_of(both), "{:e}", norm_of(&error));
    }
}
