//! Which method serves, and why; the one place that decides, for solvers and for plans.

use piola_mechanics::energy::Products;
use piola_mechanics::words::Words;
use serde::ser::{Serialize, SerializeStruct, Serializer};

use super::fallback::FALLBACK_OPERATIONS;
use super::report::LinearMethod;

/// In three dimensions `auto` factorises up to this many operations and iterates beyond.
///
/// 2e9 take a tenth of a second on one core. Conjugate gradients with two levels are faster from less
/// than that on (`docs/measured/performance.md`, "Linear solution in 3D"), but a factorisation proves
/// whether an equilibrium is stable and does not mind how the tangent is conditioned. For bonds with
/// a horizon of three spacings 10^3 points take 1.6e9 operations, 20^3 points 2.3e11.
const AUTO_OPERATIONS_3D: f64 = 2e9;

/// In two dimensions `auto` factorises up to this many operations (a minute each): the fill grows
/// slowly.
const AUTO_OPERATIONS_2D: f64 = 2e12;

/// Three-dimensional bodies with more unknowns are not even ordered: that alone takes as long as
/// solving for them by conjugate gradients, and a factorisation is cheap for thin ones at most.
const AUTO_UNKNOWNS_3D: usize = 60_000;

/// The part of the machine's memory that a factor or a matrix may take.
pub const MEMORY_SHARE: f64 = 0.7;

/// What `auto` needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circumstances {
    /// 2 or 3.
    pub dimension: usize,
    /// Free degrees of freedom.
    pub unknowns: usize,
    /// Bytes of the upper triangle of the tangent.
    pub matrix_bytes: f64,
    /// What a factor or a matrix may take, in bytes.
    pub memory_limit: f64,
}

/// A method and the reason for it, a sentence without its full stop.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The method; never `Auto`.
    pub method: LinearMethod,
    /// Whether it works on a stored tangent.
    pub stores_matrix: bool,
    /// Why.
    pub reason: String,
}

impl Choice {
    /// A method on a stored tangent, unless it is one that needs none.
    pub(super) fn new(method: LinearMethod, reason: impl Into<String>) -> Choice {
        let stores_matrix = method != LinearMethod::MatrixFree;
        Choice { method, stores_matrix, reason: reason.into() }
    }
}

/// `linear`, a word, and `linear_reason`.
impl Serialize for Choice {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let word = match (self.method, self.stores_matrix) {
            (LinearMethod::Gmres, false) => "matrix-free-gmres",
            (method, _) => method.word(),
        };
        let mut fields = serializer.serialize_struct("Choice", 2)?;
        fields.serialize_field("linear", word)?;
        fields.serialize_field("linear_reason", &self.reason)?;
        fields.end()
    }
}

/// The method where that does not depend on what it costs: one that is asked for, or `auto` for a
/// tangent that reaches further than the bonds or of which there are products only.
pub fn settled(asked: LinearMethod, beyond_bonds: bool, products: Products) -> Option<Choice> {
    let products_only = products != Products::Exact;
    let choice = match asked {
        LinearMethod::Auto if products_only => {
            Choice::new(LinearMethod::Gmres, "products by finite differences are not symmetric")
        }
        LinearMethod::Auto if beyond_bonds => {
            Choice::new(LinearMethod::MatrixFree, "the tangent reaches further than the bonds")
        }
        LinearMethod::Auto => return None,
        asked => Choice::new(asked, "the scene says so"),
    };
    let without = choice.method == LinearMethod::Gmres && (products_only || beyond_bonds);
    Some(Choice { stores_matrix: choice.stores_matrix && !without, ..choice })
}

/// Chooses by dimension, size and memory. `factorization` gives the operations of one Cholesky
/// factorisation and the bytes of its factor, and is called only where that may be worth while.
///
/// How well the tangent is conditioned is seen on the way: where conjugate gradients need more
/// iterations than a factorisation is worth, the solver goes over to Cholesky.
///
/// # Errors
/// Those of `factorization`.
pub fn choose<E>(
    circumstances: &Circumstances,
    factorization: impl FnOnce() -> Result<(f64, f64), E>,
) -> Result<Choice, E> {
    let Circumstances { dimension, unknowns, matrix_bytes, memory_limit } = *circumstances;
    let space = if dimension == 2 { "two" } else { "three" };
    let limit = if dimension == 2 { AUTO_OPERATIONS_2D } else { AUTO_OPERATIONS_3D };
    if matrix_bytes > memory_limit {
        let reason = format!(
            "the tangent alone would take {matrix_bytes:.1e} of the {memory_limit:.1e} bytes that may be taken"
        );
        return Ok(Choice::new(LinearMethod::MatrixFree, reason));
    }
    if !may_be_ordered(dimension, unknowns) {
        let reason = format!("{unknowns} unknowns in {space} dimensions are too many to factorise");
        return Ok(Choice::new(LinearMethod::Cg, reason));
    }
    let (operations, bytes) = factorization()?;
    let (method, reason) = if operations > limit {
        let reason = format!(
            "{unknowns} unknowns in {space} dimensions: a factorisation would take {operations:.1e} operations \
             and {bytes:.1e} bytes"
        );
        (LinearMethod::Cg, reason)
    } else if bytes > memory_limit {
        let reason = format!(
            "a factor of {bytes:.1e} bytes exceeds the {memory_limit:.1e} that may be taken"
        );
        (LinearMethod::Cg, reason)
    } else {
        let reason = format!(
            "a factorisation takes {operations:.1e} operations, no more than the {limit:.0e} that are \
             worth while in {space} dimensions"
        );
        (LinearMethod::Cholesky, reason)
    };
    Ok(Choice::new(method, reason))
}

/// How many iterations of conjugate gradients take the time of a factorisation: an iteration reads
/// the upper triangle once, 8 bytes for 4 operations at some 20 GB/s; factorisations make some 2e10
/// operations in a second.
pub(super) fn iterations_worth(operations: f64, matrix_bytes: f64) -> f64 {
    operations / matrix_bytes
}

/// Products with a tangent that is not stored in the time in which it is worked out to be stored: of the
/// 10 to 170 of `docs/measured/performance.md`, "Where products end", what served whole runs best.
const PRODUCTS_OF_A_TANGENT: f64 = 30.0;

/// Operations of a factorisation in the time of one product, for each block of bonded points: 120 ns
/// of 2e10 in a second.
const OPERATIONS_PER_BOND: f64 = 2400.0;

/// How many products without a stored tangent take the time of storing and factorising it, where bonded
/// points make so many blocks.
pub(super) fn products_worth(operations: f64, blocks: usize) -> usize {
    (PRODUCTS_OF_A_TANGENT + operations / (OPERATIONS_PER_BOND * blocks as f64)) as usize
}

/// Stored tangents in memory at once: the blocks, and their free part twice.
const COPIES: f64 = 3.0;

/// How many products of one system `auto` makes with a tangent beyond the bonds before a stored one takes
/// over, which takes a factorisation of so many operations and bytes; none of a system that turns out to be
/// indefinite. `None` where no stored tangent does. Bonded points make so many blocks.
pub fn products_before_stored(
    stored: &Circumstances,
    (operations, bytes): (f64, f64),
    bonded: usize,
) -> Option<usize> {
    let fits = bytes + COPIES * stored.matrix_bytes <= stored.memory_limit;
    let serves = may_be_ordered(stored.dimension, stored.unknowns);
    let ends = operations <= FALLBACK_OPERATIONS;
    (fits && serves && ends).then(|| products_worth(operations, bonded))
}

/// Whether a body with so many unknowns is small enough to be ordered.
pub(super) fn may_be_ordered(dimension: usize, unknowns: usize) -> bool {
    dimension == 2 || unknowns <= AUTO_UNKNOWNS_3D
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    fn of(
        dimension: usize,
        unknowns: usize,
        factorization: (f64, f64),
        memory_limit: f64,
    ) -> (LinearMethod, String) {
        let circumstances = Circumstances { dimension, unknowns, matrix_bytes: 3e7, memory_limit };
        let Ok(choice) = choose(&circumstances, || Ok::<_, Infallible>(factorization));
        (choice.method, choice.reason)
    }

    #[test]
    fn size_dimension_and_memory_decide_and_say_so() {
        let cost = (2.3e11, 5e8);
        let (method, reason) = of(3, 22_800, cost, 8e9);
        assert_eq!(method, LinearMethod::Cg);
        assert!(reason.contains("22800 unknowns in three dimensions") && reason.contains("2.3e11"));
        let (method, reason) = of(2, 22_800, cost, 8e9);
        assert_eq!(method, LinearMethod::Cholesky);
        assert!(reason.contains("2.3e11") && reason.contains("2e12"), "{reason}");
        let (method, reason) = of(2, 22_800, cost, 1e8);
        assert_eq!(method, LinearMethod::Cg);
        assert!(reason.contains("5.0e8 bytes"), "{reason}");
        let (method, reason) = of(3, 60_001, cost, 1e8);
        assert_eq!(method, LinearMethod::Cg);
        assert!(reason.contains("too many"), "{reason}");
        let (method, reason) = of(3, 60_001, cost, 1e7);
        assert_eq!(method, LinearMethod::MatrixFree);
        assert!(reason.contains("3.0e7"), "{reason}");
    }

    #[test]
    fn a_stored_tangent_is_worth_the_products_of_its_assembly_and_its_factors() {
        assert_eq!(products_worth(0.0, 10_000), 30);
        // 0.1 s of factorisation against products of 1.2 ms.
        assert_eq!(products_worth(2e9, 10_000), 30 + 83);
        assert!(may_be_ordered(2, 1_000_000) && !may_be_ordered(3, 1_000_000));
    }

    #[test]
    fn a_stored_tangent_takes_over_where_it_fits_and_its_factorisation_ends() {
        let wide = |dimension, unknowns, memory_limit| Circumstances {
            dimension,
            unknowns,
            matrix_bytes: 1e8,
            memory_limit,
        };
        let small = (2e9, 1e8);
        assert_eq!(products_before_stored(&wide(3, 3000, 4e8), small, 10_000), Some(113));
        assert_eq!(products_before_stored(&wide(3, 3000, 3.9e8), small, 10_000), None);
        assert_eq!(products_before_stored(&wide(3, 60_001, 4e8), small, 10_000), None);
        assert_eq!(products_before_stored(&wide(2, 60_001, 4e8), small, 10_000), Some(113));
        assert_eq!(products_before_stored(&wide(3, 3000, 4e8), (1.1e12, 1e8), 10_000), None);
    }

    /// Every method asked for serves, and `auto` stores no tangent that it need not store.
    #[test]
    fn what_is_asked_for_and_the_kind_of_tangent_come_first() {
        let of = |asked, beyond_bonds, products| {
            settled(asked, beyond_bonds, products).map(|c| (c.method, c.stores_matrix))
        };
        let exact = Products::Exact;
        for (_, asked) in LinearMethod::WORDS.iter().filter(|(word, _)| *word != "auto") {
            let stores = *asked != LinearMethod::MatrixFree;
            assert_eq!(of(*asked, false, exact), Some((*asked, stores)));
            let stores = stores && *asked != LinearMethod::Gmres;
            assert_eq!(of(*asked, true, exact), Some((*asked, stores)));
            assert_eq!(of(*asked, false, Products::Central), Some((*asked, stores)));
        }
        assert_eq!(of(LinearMethod::Auto, false, exact), None);
        assert_eq!(of(LinearMethod::Auto, true, exact), Some((LinearMethod::MatrixFree, false)));
        let products = of(LinearMethod::Auto, true, Products::OneSided);
        assert_eq!(products, Some((LinearMethod::Gmres, false)));
    }
}
