//! `[correspondence]`: how a body gets its deformation gradients.

use piola_grammar::Diagnostic;
use piola_mechanics::deformation::{Discretisation, Stabilisation};
use piola_mechanics::words::Words;

use super::super::expression::Role;
use super::super::reader::{Field, Reader, Schema, Table};
use super::super::tree::Kind;
use super::super::{CorrespondenceSettings, InfluenceChoice, NamedInfluence};

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

impl Reader {
    pub(super) fn correspondence(
        &mut self,
        table: &Table<'_>,
        dimension: Option<usize>,
    ) -> Option<CorrespondenceSettings> {
        let discretisation = self.discretisation(table);
        let order = self.option(table, "order");
        let influence =
            self.or(Some(table), "influence", InfluenceChoice::default(), Reader::influence);
        let plane = self.option(table, "plane");
        let in_plane =
            self.belongs(table, "plane", dimension != Some(3), "bodies in two dimensions");
        let settings = CorrespondenceSettings {
            discretisation: discretisation?,
            order: order?,
            influence: influence?,
            plane: plane?,
        };
        in_plane.then_some(settings)
    }

    fn discretisation(&mut self, table: &Table<'_>) -> Option<Discretisation> {
        let discretisation = self.option(table, "discretisation");
        let stabilisation = self.option(table, "stabilisation");
        let stiffness =
            self.or(Some(table), "stiffness", None, |r, field| r.positive(field).map(Some));
        let (discretisation, stabilisation, stiffness) =
            (discretisation?, stabilisation?, stiffness?);
        let found = match (discretisation, stabilisation) {
            (Discretisation::Stabilised(_), Stabilisation::Silling { .. }) => {
                if stiffness.is_none() {
                    self.required(table, "stiffness");
                }
                Discretisation::Stabilised(Stabilisation::Silling { stiffness: stiffness? })
            }
            (Discretisation::Stabilised(_), other) => Discretisation::Stabilised(other),
            (other, _) => other,
        };
        let stabilised = matches!(found, Discretisation::Stabilised(_));
        let silling = matches!(found, Discretisation::Stabilised(Stabilisation::Silling { .. }));
        let fits =
            self.belongs(table, "stabilisation", stabilised, "discretisation = \"stabilised\"")
                & self.belongs(table, "stiffness", silling, "stabilisation = \"silling\"");
        fits.then_some(found)
    }

    /// One of the names, or an expression of `L` and `delta`.
    fn influence(&mut self, field: Field<'_>) -> Option<InfluenceChoice> {
        let named = match &field.node.kind {
            Kind::Text(text) => NamedInfluence::of_word(&text.value),
            _ => None,
        };
        match named {
            Some(named) => Some(InfluenceChoice::Named(named)),
            None => self.expression(field, Role::Influence, None).map(InfluenceChoice::Expression),
        }
    }

    /// Whether a key stands where it means something, or not at all.
    pub(super) fn belongs(&mut self, table: &Table<'_>, key: &str, here: bool, to: &str) -> bool {
        let Some(entry) = table.get(key).filter(|_| !here) else { return true };
        let message = format!("`{key}` belongs to {to}");
        self.error(Diagnostic::error("conflicting-keys", entry.key_span, message));
        false
    }
}
