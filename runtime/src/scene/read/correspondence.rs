//! `[correspondence]`: how a body gets its deformation gradients.

use piola_grammar::Diagnostic;

use super::super::expression::Role;
use super::super::reader::{Field, Reader, Schema, Table};
use super::super::tree::Kind;
use super::super::{
    CorrespondenceSettings, DiscretisationChoice, InfluenceChoice, OrderChoice, Plane,
    StabilisationChoice,
};

pub(super) static CORRESPONDENCE: Schema = Schema {
    title: "[correspondence]",
    keys: &[
        ("discretisation", "\"bond-quadrature\""),
        ("stabilisation", "\"isotropic\""),
        ("stiffness", "1e12"),
        ("order", "\"first\""),
        ("influence", "\"cubic-spline\""),
        ("plane", "\"strain\""),
    ],
};

pub(in super::super) const DISCRETISATIONS: &[(&str, DiscretisationChoice)] = &[
    ("bond-quadrature", DiscretisationChoice::BondQuadrature),
    ("nodal", DiscretisationChoice::Nodal),
    ("stabilised", DiscretisationChoice::Stabilised),
];
pub(in super::super) const STABILISATIONS: &[(&str, StabilisationChoice)] = &[
    ("isotropic", StabilisationChoice::Isotropic),
    ("wan", StabilisationChoice::Wan),
    ("silling", StabilisationChoice::Silling),
];
pub(in super::super) const ORDERS: &[(&str, OrderChoice)] = &[
    ("first", OrderChoice::First),
    ("first-with-constant", OrderChoice::FirstWithConstant),
    ("second", OrderChoice::Second),
];
pub(in super::super) const PLANES: &[(&str, Plane)] =
    &[("strain", Plane::Strain), ("stress", Plane::Stress)];
pub(in super::super) const INFLUENCES: &[(&str, InfluenceChoice)] = &[
    ("cubic-spline", InfluenceChoice::CubicSpline),
    ("constant", InfluenceChoice::Constant),
    ("inverse", InfluenceChoice::Inverse),
];

impl Reader {
    pub(super) fn correspondence(
        &mut self,
        table: &Table<'_>,
        dimension: Option<usize>,
    ) -> Option<CorrespondenceSettings> {
        let found = Some(table);
        let discretisation = self.or(found, "discretisation", DISCRETISATIONS[0].1, |r, field| {
            r.choice(field, DISCRETISATIONS)
        });
        let stabilisation = self.or(found, "stabilisation", STABILISATIONS[0].1, |r, field| {
            r.choice(field, STABILISATIONS)
        });
        let stiffness = self.or(found, "stiffness", None, |r, field| r.positive(field).map(Some));
        let order = self.or(found, "order", ORDERS[0].1, |r, field| r.choice(field, ORDERS));
        let influence = self.or(found, "influence", InfluenceChoice::default(), Reader::influence);
        let plane = self.or(found, "plane", PLANES[0].1, |r, field| r.choice(field, PLANES));
        let settings = CorrespondenceSettings {
            discretisation: discretisation?,
            stabilisation: stabilisation?,
            stiffness: stiffness?,
            order: order?,
            influence: influence?,
            plane: plane?,
        };
        self.fits(table, &settings, dimension).then_some(settings)
    }

    /// One of the names, or an expression of `L` and `delta`.
    fn influence(&mut self, field: Field<'_>) -> Option<InfluenceChoice> {
        let text = match &field.node.kind {
            Kind::Text(text) => text.value.clone(),
            _ => String::new(),
        };
        match INFLUENCES.iter().find(|(name, _)| *name == text) {
            Some((_, choice)) => Some(choice.clone()),
            None => self.expression(field, Role::Influence, None).map(InfluenceChoice::Expression),
        }
    }

    /// Whether keys stand where they mean something.
    fn fits(
        &mut self,
        table: &Table<'_>,
        settings: &CorrespondenceSettings,
        dimension: Option<usize>,
    ) -> bool {
        let stabilised = settings.discretisation == DiscretisationChoice::Stabilised;
        let silling = stabilised && settings.stabilisation == StabilisationChoice::Silling;
        let mut fits = true;
        for (key, belongs, to) in [
            ("stabilisation", stabilised, "discretisation = \"stabilised\""),
            ("stiffness", silling, "stabilisation = \"silling\""),
            ("plane", dimension != Some(3), "bodies in two dimensions"),
        ] {
            if let Some(entry) = table.get(key).filter(|_| !belongs) {
                let message = format!("`{key}` belongs to {to}");
                self.error(Diagnostic::error("conflicting-keys", entry.key_span, message));
                fits = false;
            }
        }
        if silling && settings.stiffness.is_none() && table.get("stiffness").is_none() {
            self.required(table, "stiffness");
            fits = false;
        }
        fits
    }
}
