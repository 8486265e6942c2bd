//! Which method `auto` takes, and why.

use super::report::LinearMethod;

/// In three dimensions `auto` factorises up to this many operations and iterates beyond.
///
/// 2e9 take a tenth of a second on one core. Conjugate gradients with two levels are faster from less
/// than that on (`docs/performance.md`, "Linear solution in 3D"), but a factorisation proves
/// whether an equilibrium is stable and does not mind how the tangent is conditioned. For bonds with
/// a horizon of three spacings 10^3 points take 1.6e9 operations, 20^3 points 2.3e11.
pub const AUTO_OPERATIONS_3D: f64 = 2e9;

/// In two dimensions `auto` factorises up to this many operations (a minute each): the fill grows
/// slowly.
pub const AUTO_OPERATIONS_2D: f64 = 2e12;

/// Three-dimensional bodies with more unknowns are not even ordered: that alone takes as long as
/// solving for them by conjugate gradients, and a factorisation is cheap for thin ones at most.
pub const AUTO_UNKNOWNS_3D: usize = 60_000;

/// The part of the machine's memory that a factor or a matrix may take.
pub const MEMORY_SHARE: f64 = 0.7;

/// What `auto` needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circumstances {
    /// 2 or 3.
    pub dimension: usize,
    /// Free degrees of freedom.
    pub unknowns: usize,
    /// Operations of one Cholesky factorisation and bytes of its factor; `None` for a
    /// three-dimensional body of more than [`AUTO_UNKNOWNS_3D`] unknowns.
    pub factorization: Option<(f64, f64)>,
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
    /// Why.
    pub reason: String,
}

/// Chooses by dimension, size and memory.
///
/// How well the tangent is conditioned is seen on the way: where conjugate gradients need more
/// iterations than a factorisation is worth, the solver goes over to Cholesky.
pub fn choose(circumstances: &Circumstances) -> Choice {
    let Circumstances { dimension, unknowns, factorization, matrix_bytes, memory_limit } =
        *circumstances;
    let choice = |method, reason| Choice { method, reason };
    let space = if dimension == 2 { "two" } else { "three" };
    let limit = if dimension == 2 { AUTO_OPERATIONS_2D } else { AUTO_OPERATIONS_3D };
    if matrix_bytes > memory_limit {
        let reason = format!(
            "the tangent alone would take {matrix_bytes:.1e} of the {memory_limit:.1e} bytes that may be taken"
        );
        return choice(LinearMethod::MatrixFree, reason);
    }
    let reason = match factorization {
        Some((operations, bytes)) if operations > limit => format!(
            "{unknowns} unknowns in {space} dimensions: a factorisation would take {operations:.1e} operations \
             and {bytes:.1e} bytes"
        ),
        Some((_, bytes)) if bytes > memory_limit => {
            format!(
                "a factor of {bytes:.1e} bytes exceeds the {memory_limit:.1e} that may be taken"
            )
        }
        Some((operations, _)) => {
            let reason = format!(
                "a factorisation takes {operations:.1e} operations, no more than the {limit:.0e} that are \
                 worth while in {space} dimensions"
            );
            return choice(LinearMethod::Cholesky, reason);
        }
        None => format!("{unknowns} unknowns in {space} dimensions are too many to factorise"),
    };
    choice(LinearMethod::Cg, reason)
}

/// How many iterations of conjugate gradients take the time of a factorisation: an iteration reads
/// the upper triangle once, 8 bytes for 4 operations at some 20 GB/s; factorisations make some 2e10
/// operations in a second.
pub(super) fn iterations_worth(operations: f64, matrix_bytes: f64) -> f64 {
    operations / matrix_bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(
        dimension: usize,
        factorization: Option<(f64, f64)>,
        memory_limit: f64,
    ) -> (LinearMethod, String) {
        let Choice { method, reason } = choose(&Circumstances {
            dimension,
            unknowns: 22_800,
            factorization,
            matrix_bytes: 3e7,
            memory_limit,
        });
        (method, reason)
    }

    #[test]
    fn size_dimension_and_memory_decide_and_say_so() {
        let (method, reason) = of(3, Some((2.3e11, 5e8)), 8e9);
        assert_eq!(method, LinearMethod::Cg);
        assert!(reason.contains("22800 unknowns in three dimensions") && reason.contains("2.3e11"));
        let (method, reason) = of(2, Some((2.3e11, 5e8)), 8e9);
        assert_eq!(method, LinearMethod::Cholesky);
        assert!(reason.contains("2.3e11") && reason.contains("2e12"), "{reason}");
        let (method, reason) = of(2, Some((2.3e11, 5e8)), 1e8);
        assert_eq!(method, LinearMethod::Cg);
        assert!(reason.contains("5.0e8 bytes"), "{reason}");
        let (method, reason) = of(3, None, 1e8);
        assert_eq!(method, LinearMethod::Cg);
        assert!(reason.contains("too many"), "{reason}");
        let (method, reason) = of(3, None, 1e7);
        assert_eq!(method, LinearMethod::MatrixFree);
        assert!(reason.contains("3.0e7"), "{reason}");
    }
}
