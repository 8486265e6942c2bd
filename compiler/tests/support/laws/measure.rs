//! Energies of bonds, areas and volumes: what `piola audit` finds in every regime of their domain.

use piola_compiler::audit::{Place, Settings, audit};
use piola_compiler::{Argument, Level};

use super::{BAR, Case, FORM, Found};

/// Strains up to this are near rest; those of the regime 1e-1 reach three tenths.
const NEAR: f64 = 0.25;

/// Points in a regime.
const POINTS: usize = 2;

pub(super) fn look_at(case: &Case, found: &mut Found) {
    for level in [Level::Fast, Level::Strict] {
        // Other values than the defaults at one level; and what is lost at one is lost.
        if level == Level::Strict && !(case.with.is_empty() && found.is_kept()) {
            break;
        }
        let settings = Settings { form: FORM, level, points: POINTS, bar: BAR };
        let (audits, _) = audit(case.model, &case.values, &settings).unwrap();
        for audit in audits {
            for regime in &audit.regimes {
                found.n_places += regime.n_points;
                for (order, place) in regime.at.iter().enumerate() {
                    let Some(Place::Interaction(point)) = place else { continue };
                    let change = match audit.argument {
                        Some(Argument::Square(_)) => point.root().change(),
                        _ => point.change(),
                    };
                    let is_near = regime.strain.is_some() || change.abs() <= NEAR;
                    found.see(is_near, order, regime.worst[order], || {
                        let symbol = audit.symbol();
                        format!("{}, e = {change:.1e} of {symbol} {}", regime.name, case.with)
                    });
                }
            }
        }
    }
}
