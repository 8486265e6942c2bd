//! Checks that need more than one value: lattices that fit, horizons that reach, idle entries.

use piola_grammar::{Diagnostic, Span};
use piola_mechanics::surface::Volumes;
use piola_mechanics::weights::Weights;
use piola_mechanics::words::Words;

use super::{AXES, Horizon, LatticeShape, Load, Prescription, SetDefinition};

/// Extents are whole multiples of the spacing to this many spacings.
const LATTICE_TOLERANCE: f64 = 1e-6;

/// Point numbers are kept in 32 bits.
const MAX_POINTS: f64 = 4_294_967_295.0;

/// Why a lattice does not fill its box exactly, or has more points than can be numbered.
pub(super) fn lattice(
    lattice: &LatticeShape,
    spacing_span: Span,
    box_span: Span,
) -> Option<Diagnostic> {
    for axis in 0..lattice.low.len() {
        let extent = lattice.high[axis] - lattice.low[axis];
        if !extent.is_finite() || extent <= 0.0 {
            let message = format!("the box has no extent along {}", AXES[axis]);
            return Some(
                Diagnostic::error("box-corners", box_span, message)
                    .help("give two opposite corners that differ in every coordinate"),
            );
        }
        let cells = extent / lattice.spacing;
        if (cells - cells.round()).abs() > LATTICE_TOLERANCE || cells.round() < 1.0 {
            let message = format!(
                "the spacing {} does not divide the extent {extent} along {}",
                lattice.spacing, AXES[axis]
            );
            let near = extent / cells.round().max(1.0);
            return Some(
                Diagnostic::error("extent-not-a-multiple", spacing_span, message)
                    .note(box_span, "the box")
                    .help(format!("the nearest that does is spacing = {near}")),
            );
        }
    }
    let total: f64 = (0..lattice.low.len())
        .map(|axis| ((lattice.high[axis] - lattice.low[axis]) / lattice.spacing).round() + 1.0)
        .product();
    if total > MAX_POINTS {
        let message =
            format!("this spacing makes {total:.1e} points; at most 4.2e9 can be numbered");
        return Some(Diagnostic::error("too-many-points", spacing_span, message));
    }
    None
}

/// Why a horizon does not fit the points; `spacing` is 0 where they are of no lattice.
pub(super) fn horizon(radius: f64, spacing: f64, span: Span) -> Option<Diagnostic> {
    if spacing == 0.0 {
        return None;
    }
    if radius < spacing * (1.0 - LATTICE_TOLERANCE) {
        let message = format!("the horizon {radius} is smaller than the spacing {spacing}");
        return Some(
            Diagnostic::error("horizon-too-small", span, message)
                .label("no point would have a neighbour")
                .help("write spacings = 3"),
        );
    }
    None
}

/// Why bonds cannot be corrected with these weights.
pub(super) fn correction(horizon: &Horizon) -> Option<Diagnostic> {
    let (weights, span) = (horizon.weights.word(), horizon.correction_span?);
    let (message, help) = match (horizon.weights, horizon.volumes) {
        (Weights::Unit, _) => (
            "a correction of bonds compares energies per volume, and weights = \"unit\" have no volumes"
                .to_string(),
            "leave it out, or write weights = \"volumes\"",
        ),
        (Weights::Uniform | Weights::Truncated, Volumes::Partial) => (
            format!(
                "`volumes` takes parts of the volumes of neighbours, and weights = \"{weights}\" are \
                 made of a ball over their number"
            ),
            "write weights = \"volumes\", or leave `weights` out",
        ),
        _ => return None,
    };
    Some(Diagnostic::error("conflicting-keys", span, message).help(help))
}

/// Entries that have no effect.
pub(super) fn warnings(
    prescriptions: &[Prescription],
    loads: &[Load],
    sets: &[SetDefinition],
) -> Vec<Diagnostic> {
    let name = |set: usize| sets.get(set).map_or("", |set| set.name.value.as_str());
    let idle_prescriptions = prescriptions
        .iter()
        .filter(|entry| entry.components.iter().all(|component| component.value.is_none()))
        .map(|entry| {
            let message =
                format!("every component of `{}` is left free here", name(entry.set.value));
            Diagnostic::warning("idle-entry", entry.set.span, message)
                .help("leave the entry out, or prescribe a number")
        });
    let idle_loads = loads
        .iter()
        .filter(|load| load.components.iter().all(|component| component.value.is_zero()))
        .map(|load| {
            let message =
                format!("nothing acts on `{}` here: every component is 0", name(load.set.value));
            Diagnostic::warning("idle-entry", load.set.span, message)
        });
    idle_prescriptions.chain(idle_loads).collect()
}
