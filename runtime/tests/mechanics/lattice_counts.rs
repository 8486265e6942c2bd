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

/// Neighbours, contributing pairs and triples of an interior point, and the flat cliques left out,
/// are those of integer coordinates at 6 spacings and 4 offsets. With a horizon of 3 spacings they
/// are 28 and 180 in the plane; 122, 3276 and 35328 in space.
#[test]
fn e09_e11_an_interior_point_has_the_same_family_at_every_spacing_and_offset() {
    for (dimension, ratio) in [(2, 2_i64), (2, 3), (3, 2), (3, 3)] {
        let bulk = bulk_counts(dimension, ratio as f64);
        match (dimension, ratio) {
            (2, 3) => assert_eq!((bulk.neighbors, bulk.pairs / 2), (28, 180)),
            (3, 3) => {
                let found = (bulk.neighbors, bulk.pairs / 2, bulk.triples / 6);
                assert_eq!(found, (122, 3276, 35328));
            }
            _ => {}
        }
        let mut flat = None;
        for spacing in [1.0, 0.1, 0.05, 0.02, 0.01, 1.0 / 3.0, 0.7] {
            for offset in [0.0, 1.0, 1e3, 1e6] {
                let body = lattice(
                    &vec![offset; dimension],
                    &vec![2 * ratio as usize; dimension],
                    spacing,
                );
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
                let found = (census.dropped_triangles, census.dropped_tetrahedra);
                // The first has integer coordinates.
                let expected =
                    *flat.get_or_insert_with(|| flat_cliques(body.positions(), dimension, ratio));
                assert_eq!(found, expected, "{case}");
                assert!(neighborhood.shell_bonds() > 0, "{case}");
            }
        }
    }
}

/// Collinear triples and coplanar quadruples of points with whole coordinates that are all within the
/// horizon of each other.
fn flat_cliques(positions: &[f64], dimension: usize, horizon: i64) -> (u64, u64) {
    let point = |x: &[f64]| [0, 1, 2].map(|a| if a < dimension { x[a] as i64 } else { 0 });
    let points: Vec<[i64; 3]> = positions.chunks_exact(dimension).map(point).collect();
    let minus = |p: usize, q: usize| [0, 1, 2].map(|a| points[p][a] - points[q][a]);
    let dot = |p: [i64; 3], q: [i64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let cross =
        |p: [i64; 3], q: [i64; 3]| [[1, 2], [2, 0], [0, 1]].map(|[a, b]| p[a] * q[b] - p[b] * q[a]);
    let is_near = |p: usize, q: usize| dot(minus(p, q), minus(p, q)) <= horizon * horizon;
    let (mut triples, mut quadruples) = (0, 0);
    for i in 0..points.len() {
        let members: Vec<usize> = (i + 1..points.len()).filter(|&j| is_near(i, j)).collect();
        for (n_j, &j) in members.iter().enumerate() {
            for (n_k, &k) in members.iter().enumerate().skip(n_j + 1).filter(|k| is_near(j, *k.1)) {
                let normal = cross(minus(j, i), minus(k, i));
                triples += u64::from(normal == [0; 3]);
                let fourth = members[n_k + 1..].iter().filter(|&&l| is_near(j, l) && is_near(k, l));
                let flat = fourth.filter(|&&l| dot(normal, minus(l, i)) == 0).count() as u64;
                quadruples += flat;
            }
        }
    }
    (triples, quadruples)
}
