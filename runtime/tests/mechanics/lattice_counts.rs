//! Families of lattice points, exactly as on an endless lattice (lattice_constants.json).

use piola_runtime::interaction::{Census, Degeneracy, Slabs};
use piola_runtime::lattice::bulk_counts;
use piola_runtime::neighborhood::Neighborhood;

use crate::common::{lattice, reference};

#[test]
fn bulk_counts_are_those_of_the_reference() {
    let constants = reference("lattice_constants.json");
    let cases = constants["counts_per_interior_point"].as_array().unwrap();
    assert_eq!(cases.len(), 10);
    for case in cases {
        let counts =
            bulk_counts(case["D"].as_u64().unwrap() as usize, case["ratio"].as_f64().unwrap());
        assert_eq!(counts.neighbors, case["N1"].as_u64().unwrap(), "{case}");
        assert_eq!(counts.pairs, case["N2_ordered"].as_u64().unwrap(), "{case}");
        assert_eq!(counts.triples, case["N3_ordered"].as_u64().unwrap(), "{case}");
    }
}

#[test]
fn an_interior_point_has_the_same_family_at_every_spacing_and_offset() {
    for (dimension, ratio) in [(2, 2), (2, 3), (3, 2), (3, 3)] {
        let bulk = bulk_counts(dimension, ratio as f64);
        for spacing in [0.1, 0.05, 0.02, 0.01] {
            for offset in [0.0, 1.0, 1e3, 1e6] {
                let body = lattice(&vec![offset; dimension], &vec![2 * ratio; dimension], spacing);
                let neighborhood = Neighborhood::new(&body, ratio as f64 * spacing).unwrap();
                let slabs = Slabs::new(&neighborhood);
                let degeneracy = Degeneracy::new(&body);
                let census = Census::new(&body, &neighborhood, degeneracy, &slabs, |_| true);
                let middle = (body.n_points() - 1) / 2;
                let middle =
                    body.user_index().iter().position(|&user| user as usize == middle).unwrap();
                let case = format!("d {dimension} ratio {ratio} spacing {spacing} offset {offset}");
                assert_eq!(census.neighbors[middle], bulk.neighbors, "{case}");
                assert_eq!(census.pairs[middle], bulk.pairs, "{case}");
                assert_eq!(census.triples[middle], bulk.triples, "{case}");
                assert_eq!(census.pairs.iter().sum::<u64>(), 6 * census.triangles, "{case}");
                assert_eq!(census.triples.iter().sum::<u64>(), 24 * census.tetrahedra, "{case}");
                assert!(census.dropped_triangles > 0, "{case}");
                assert!(neighborhood.shell_bonds() > 0, "{case}");
            }
        }
    }
}
