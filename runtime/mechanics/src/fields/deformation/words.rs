//! Words of discretisations.

use super::{Discretisation, OperatorOrder, Stabilisation};
use crate::words::Words;

impl Words for Discretisation {
    const WORDS: &'static [(&'static str, Discretisation)] = &[
        ("bond-quadrature", Discretisation::BondQuadrature),
        ("nodal", Discretisation::Nodal),
        ("stabilised", Discretisation::Stabilised(Stabilisation::Isotropic)),
    ];
}

impl Words for Stabilisation {
    const WORDS: &'static [(&'static str, Stabilisation)] = &[
        ("isotropic", Stabilisation::Isotropic),
        ("wan", Stabilisation::Wan),
        ("silling", Stabilisation::Silling { stiffness: 0.0 }),
    ];
}

impl Words for OperatorOrder {
    const WORDS: &'static [(&'static str, OperatorOrder)] = &[
        ("first", OperatorOrder::First),
        ("first-with-constant", OperatorOrder::FirstWithConstant),
        ("second", OperatorOrder::Second),
    ];
}
