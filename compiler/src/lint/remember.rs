//! What interactions remember: states that nobody asks, and next states that create energy or do not settle.

use piola_grammar::Span;

use super::Finding;
use super::subject::{example, short};
use crate::expression::Input;
use crate::kernel::Mode;
use crate::measure::Measure;
use crate::model::{Model, Of, OfFamily, Parameter};
use crate::remember::{
    History, Remembering, RememberingFamily, RememberingGradient, RememberingPoint,
};
use crate::specialise::Form;
use crate::verify::sample::{Point, contains};

/// Stretches that lead somewhere, and from there on.
const STRETCHES: [f64; 13] =
    [1.1, 1.3, 2.0, 1.05, 1.02, 1.01, 1.0, 0.99, 0.95, 0.8, 0.5, 1.001, 0.999];

/// A length at rest, over the horizon; areas and volumes are its powers.
const REFERENCE: f64 = 0.5;

/// By which part of what it can be an energy must grow, or a state change, to be told.
const TOLD: f64 = 1e-9;

/// What bonds remember, or triangles, or tetrahedra, deformation gradients or points, with values for everything it
/// depends on.
pub(super) struct Updating<'m> {
    /// States by their numbers, with the places of their next values.
    pub(super) updates: Vec<(usize, Span)>,
    of: Of,
    model: &'m Model,
    tried: Vec<Tried>,
}

/// An interaction that has been at one stretch and comes to another, or a body that has, along one axis.
struct Tried {
    stretches: [f64; 2],
    /// psi with states before they change and behind that.
    psi: [f64; 2],
    /// The next states, one for each update, and what becomes of these at the same measure at once.
    next: [Vec<f64>; 2],
}

impl<'m> Updating<'m> {
    /// The updates of a measure of a model for some values; nothing where there are none, or no values are found.
    pub(super) fn examples(
        model: &'m Model,
        measure: Measure,
        dimension: usize,
    ) -> Option<Updating<'m>> {
        let variant = model.variant(dimension)?;
        let own = variant.updates.iter().filter(|update| update.of == measure);
        let updates: Vec<(usize, Span)> = own.map(|one| (one.state, one.span)).collect();
        if updates.is_empty() {
            return None;
        }
        let values = example(model, dimension)?.with_states(model);
        let compiled = model.compile(&values, Mode::Interpreter, Form::Textbook).ok()?;
        let kernel = compiled.kernels.iter().find(|kernel| kernel.measure() == measure);
        let begin = Remembering::new(model, measure, &values, Mode::Interpreter, Form::Textbook);
        let begin = begin.ok()?;
        let length = REFERENCE * values.horizon;
        let reference = (1..measure.points()).fold(1.0, |power, _| power * length);
        let mut tried = Vec::new();
        for [first, second] in STRETCHES.iter().flat_map(|one| STRETCHES.map(|two| [*one, two])) {
            let [one, two] =
                [first, second].map(|stretch| Point { measure: stretch * reference, reference });
            if ![one, two].iter().all(|p| contains(variant, measure, &values, *p)) {
                continue;
            }
            let mut bond = begin.clone();
            bond.advance(one, 0.0);
            let psi = |bond: &Remembering| kernel.map_or(0.0, |kernel| bond.energy(kernel, two)[0]);
            let next = |bond: &Remembering| -> Vec<f64> {
                bond.next(two, 0.0).into_iter().map(|(_, value)| value).collect()
            };
            let (before, states) = (psi(&bond), next(&bond));
            bond.advance(two, 0.0);
            tried.push(Tried {
                stretches: [first, second],
                psi: [before, psi(&bond)],
                next: [states, next(&bond)],
            });
        }
        Some(Updating { updates, of: Of::Measure(measure), model, tried })
    }

    /// The same of deformation gradients.
    pub(super) fn of_gradients(model: &'m Model, dimension: usize) -> Option<Updating<'m>> {
        let (of, updates) = of_families(model, dimension, OfFamily::Gradient)?;
        let (mode, form) = (Mode::Interpreter, Form::Textbook);
        let values = example(model, dimension)?;
        let (begin, values) = RememberingGradient::new(model, &values, mode, form).ok()?;
        let kernel = model.compile(&values, mode, form).ok()?.gradient;
        let tried = tried(dimension, &begin, kernel.as_ref(), |_| true);
        Some(Updating { updates, of, model, tried })
    }

    /// The same of points, with what they gather.
    pub(super) fn of_points(model: &'m Model, dimension: usize) -> Option<Updating<'m>> {
        let variant = model.variant(dimension)?;
        let (of, updates) = of_families(model, dimension, OfFamily::Points)?;
        let values = example(model, dimension)?;
        let ways = (Mode::Interpreter, Form::Textbook);
        if let Some(begin) = RememberingFamily::new(model, &values, ways).ok()? {
            let declares = |change: &[f64]| begin.is_declared(change);
            let tried = tried(dimension, &begin, Some(&()), declares);
            return Some(Updating { updates, of, model, tried });
        }
        let (begin, kernels, _) = RememberingPoint::new(model, &values, ways).ok()??;
        let declares = |change: &[f64]| begin.is_declared(variant, &values, change);
        let tried = tried(dimension, &begin, Some(&kernels), declares);
        Some(Updating { updates, of, model, tried })
    }

    fn name(&self, update: usize) -> &str {
        &self.model.parameters()[self.updates[update].0].name
    }

    /// In words where one has been and where it comes to.
    fn way(&self, [first, second]: [f64; 2]) -> String {
        let (first, second) = (short(first), short(second));
        match self.of {
            Of::Measure(measure) => {
                let (m, rest) = (measure.symbol(), measure.reference_symbol());
                format!("at {m}/{rest} = {second} after {m}/{rest} = {first}")
            }
            Of::Family(_) => format!("at a stretch of {second} along X after one of {first}"),
        }
    }

    /// What stays as it is while states change.
    fn held(&self) -> &'static str {
        match self.of {
            Of::Measure(measure) => measure.quantity(),
            Of::Family(OfFamily::Gradient) => "deformation gradient",
            Of::Family(_) => "deformation",
        }
    }
}

/// The updates of a kind of families; nothing where there are none.
fn of_families(
    model: &Model,
    dimension: usize,
    kind: OfFamily,
) -> Option<(Of, Vec<(usize, Span)>)> {
    let own = model.variant(dimension)?.family_updates.iter().filter(|update| update.of == kind);
    let updates: Vec<(usize, Span)> = own.map(|one| (one.state, one.span)).collect();
    (!updates.is_empty()).then_some((Of::Family(kind), updates))
}

/// Bodies that have been stretched along X and are stretched otherwise.
fn tried<H: History>(
    dimension: usize,
    begin: &H,
    energy: Option<&H::Energy>,
    declares: impl Fn(&[f64]) -> bool,
) -> Vec<Tried> {
    let change = |stretch: f64| -> Vec<f64> {
        (0..dimension * dimension).map(|k| if k == 0 { stretch - 1.0 } else { 0.0 }).collect()
    };
    let mut all = Vec::new();
    for [first, second] in STRETCHES.iter().flat_map(|one| STRETCHES.map(|two| [*one, two])) {
        let [one, two] = [first, second].map(change);
        if !declares(&one) || !declares(&two) {
            continue;
        }
        let mut place = begin.clone();
        place.advance(&one, 0.0);
        let psi = |place: &H| energy.map_or(0.0, |energy| place.energy(energy, &two));
        let (before, states) = (psi(&place), place.next(&two, 0.0));
        place.advance(&two, 0.0);
        all.push(Tried {
            stretches: [first, second],
            psi: [before, psi(&place)],
            next: [states, place.next(&two, 0.0)],
        });
    }
    all
}

/// Energy that grows at a fixed measure when states change.
pub(super) fn creates_energy(updating: &Updating<'_>) -> Option<(usize, Finding)> {
    let most = updating.tried.iter().flat_map(|tried| tried.psi).filter(|psi| psi.is_finite());
    let most = most.fold(0.0, |most: f64, psi| most.max(psi.abs()));
    let creates = |tried: &&Tried| tried.psi[1] - tried.psi[0] > TOLD * most;
    let found = updating.tried.iter().find(creates)?;
    let m = updating.of.symbol();
    let finding = Finding {
        message: format!(
            "what {} remember creates energy: psi({m}) grows from {} to {} {}, at a fixed {}",
            updating.of.many(),
            short(found.psi[0]),
            short(found.psi[1]),
            updating.way(found.stretches),
            updating.held()
        ),
        help: format!(
            "let psi({m}) fall or stay as it is when a state changes: what is lost is dissipated"
        ),
    };
    Some((0, finding))
}

/// A state that goes on changing at a fixed measure without a time.
pub(super) fn not_settled(updating: &Updating<'_>) -> Option<(usize, Finding)> {
    (0..updating.updates.len()).find_map(|update| {
        let all = updating.tried.iter().flat_map(|tried| &tried.next);
        let most = all.map(|next| next[update]).filter(|x| x.is_finite());
        let most = most.fold(0.0, |most: f64, x| most.max(x.abs()));
        let moves = |tried: &&Tried| {
            let [one, two] = tried.next.each_ref().map(|next| next[update]);
            (one - two).abs() > TOLD * most
        };
        let found = updating.tried.iter().find(moves)?;
        let [one, two] = found.next.each_ref().map(|next| short(next[update]));
        let name = updating.name(update);
        let message = format!(
            "`{name}` does not settle: {} it becomes {one}, and {two} at once again",
            updating.way(found.stretches)
        );
        let help = format!(
            "let it come to rest in one go at a fixed {}, or let it depend on the time by `dt`",
            updating.held()
        );
        Some((update, Finding { message, help }))
    })
}

/// A state that changes nothing, or that nothing changes.
pub(super) fn unused(model: &Model, state: &Parameter) -> Option<Finding> {
    let variant = model.variant(model.dimensions().next()?)?;
    let number = model.parameters().iter().position(|own| own.name == state.name)?;
    let name = &state.name;
    if model.kind_of_state(number).is_none() {
        return Some(Finding {
            message: format!("`{name}` never changes: there is no `update {name} = ..`"),
            help: format!("say what it becomes, or declare it so: `parameter {name}`"),
        });
    }
    let others = variant.updates.iter().filter(|update| update.state != number);
    let energies = variant.energies.iter().map(|energy| energy.root);
    let breaks = variant.breaks.iter().map(|one| one.root);
    let dissipations = variant.dissipations.iter().map(|one| one.root);
    let gradients = variant.gradient_energies.iter().map(|one| one.root);
    let gathered = variant.gathered_energies.iter().map(|one| one.root);
    let by_families = variant.family_breaks.iter().map(|one| one.root);
    let more = variant.family_updates.iter().filter(|update| update.state != number);
    let of_families = gradients.chain(gathered).chain(by_families).chain(more.map(|one| one.root));
    let holders = energies.chain(breaks).chain(dissipations).chain(of_families);
    let roots: Vec<_> = holders.chain(others.map(|update| update.root)).collect();
    let is_used = variant.graph.depends_on(&roots, Input::Parameter(number as u16));
    let m = model.kind_of_state(number).unwrap_or(Of::Measure(Measure::Length)).symbol();
    (!is_used).then(|| Finding {
        message: format!(
            "`{name}` changes nothing: no psi({m}), condition or other state holds it"
        ),
        help: format!("let psi({m}) or a condition depend on it, or leave it out"),
    })
}
