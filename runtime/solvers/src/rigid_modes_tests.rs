use piola_mechanics::energy::Energy;
use piola_mechanics::testing::{SpringNetwork, linear};

use super::*;

fn motions(network: &SpringNetwork, fixed: &[usize]) -> Vec<Vec<String>> {
    let constraints = Constraints::new(network.positions.len(), fixed).unwrap();
    match check_rigid_motions(network.pattern(), &network.positions, &constraints) {
        Ok(()) => Vec::new(),
        Err(error) => error.components.into_iter().map(|component| component.motions).collect(),
    }
}

#[test]
fn a_free_square_has_three_motions() {
    let square = SpringNetwork::lattice(&[5, 5], 2.0, linear);
    let expected =
        ["rotation about z through (2, 2)", "translation along x", "translation along y"];
    assert_eq!(motions(&square, &[]), [expected]);
    assert_eq!(motions(&square, &[0, 1]), [["rotation about z through (0, 0)"]]);
    // Point 1 lies at (0, 1): its u_y does not hold the rotation, its u_x does.
    assert_eq!(motions(&square, &[0, 1, 3]), [["rotation about z through (0, 0)"]]);
    assert!(motions(&square, &[0, 1, 2]).is_empty());
}

#[test]
fn rollers_leave_what_they_leave() {
    let square = SpringNetwork::lattice(&[5, 5], 2.0, linear);
    let sideways: Vec<usize> = (0..5).map(|p| 2 * p).collect();
    assert_eq!(motions(&square, &sideways), [["translation along y"]]);
    // u_x on the left and u_y on the lower side hold everything.
    let mut corner = sideways;
    corner.extend((0..5).map(|p| 2 * 5 * p + 1));
    corner.sort_unstable();
    corner.dedup();
    assert!(motions(&square, &corner).is_empty());
}

#[test]
fn a_free_cube_has_six_motions() {
    let cube = SpringNetwork::lattice(&[3, 3, 3], 2.0, linear);
    let expected = [
        "rotation about x through (1, 1, 1)",
        "rotation about y through (1, 1, 1)",
        "rotation about z through (1, 1, 1)",
        "translation along x",
        "translation along y",
        "translation along z",
    ];
    assert_eq!(motions(&cube, &[]), [expected]);
    // Two points on an edge along z fixed: a hinge.
    let hinge = cube.dofs_where(|x| x[0] == 0.0 && x[1] == 0.0 && x[2] != 1.0);
    assert_eq!(motions(&cube, &hinge), [["rotation about z through (0, 0, 1)"]]);
    // All of the face x = 0 fixed along x only.
    let face: Vec<usize> = cube.dofs_where(|x| x[0] == 0.0).into_iter().step_by(3).collect();
    let expected =
        ["rotation about x through (1, 1, 1)", "translation along y", "translation along z"];
    assert_eq!(motions(&cube, &face), [expected]);
    assert!(motions(&cube, &cube.dofs_where(|x| x[0] == 0.0)).is_empty());
}

#[test]
fn each_component_is_judged_by_itself() {
    // Two triangles and a single point; the second triangle held, the first hinged.
    let positions = vec![0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 10.0, 0.0, 11.0, 0.0, 10.0, 1.0, 5.0, 7.5];
    let bonds = vec![(0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5)];
    let network = SpringNetwork::new(2, positions, bonds, linear);
    assert_eq!(connected_components(network.pattern()), [&[0, 1, 2][..], &[3, 4, 5], &[6]]);
    let constraints = Constraints::new(14, &[2, 3, 6, 7, 8, 9]).unwrap();
    let error =
        check_rigid_motions(network.pattern(), &network.positions, &constraints).unwrap_err();
    assert_eq!(error.components.len(), 2);
    assert_eq!(error.components[0].example_point, 0);
    assert_eq!(error.components[1].example_position, [5.0, 7.5]);
    assert_eq!(
        error.to_string(),
        "the part of 3 points with a point at (0, 0) is free to move: rotation about z through (1, 0); \
         the point at (5, 7.5) is free to move: translation along x, translation along y"
    );
}

#[test]
fn a_line_of_points_in_space_does_not_turn_about_itself() {
    let line = SpringNetwork::lattice(&[1, 1, 4], 1.0, linear);
    let ends = line.dofs_where(|x| x[2] == 0.0 || x[2] == 3.0);
    assert!(motions(&line, &ends).is_empty());
    let one_end = line.dofs_where(|x| x[2] == 0.0);
    let expected = ["rotation about x through (0, 0, 0)", "rotation about y through (0, 0, 0)"];
    assert_eq!(motions(&line, &one_end), [expected]);
}

#[test]
fn the_unit_of_length_and_the_origin_do_not_matter() {
    for (scale, offset) in [(1e-9, 0.0), (1e6, 0.0), (1.0, 1e6), (1e-3, -500.0)] {
        let mut cube = SpringNetwork::lattice(&[4, 3, 3], 2.0, linear);
        cube.positions.iter_mut().for_each(|x| *x = offset + scale * *x);
        // Three components of a corner, two of the next along z, none of the others: a hinge.
        let least = vec![0, 1, 2, 3 * 2, 3 * 2 + 1];
        assert_eq!(motions(&cube, &[])[0].len(), 6, "{scale} {offset}");
        assert_eq!(motions(&cube, &least)[0].len(), 1, "{scale} {offset}");
        let held = vec![0, 1, 2, 3 * 2, 3 * 2 + 1, 3 * 9 + 1];
        assert!(motions(&cube, &held).is_empty(), "{scale} {offset}");
    }
}

#[test]
fn many_parts_are_counted_not_listed() {
    let positions: Vec<f64> = (0..16).map(f64::from).collect();
    let dust = SpringNetwork::new(2, positions, Vec::new(), linear);
    let constraints = Constraints::new(16, &[]).unwrap();
    let error = check_rigid_motions(dust.pattern(), &dust.positions, &constraints).unwrap_err();
    assert!(error.to_string().contains("and 3 more parts"), "{error}");
}
