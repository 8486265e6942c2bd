//! Conditions under which bonds, triangles and tetrahedra break: that hold at rest, never, or in
//! compression, or that take nothing away; those of deformation gradients and of gathered values, too.

use piola_grammar::Span;

use super::Finding;
use super::subject::{example, short};
use crate::breaking::Criterion;
use crate::kernel::Mode;
use crate::measure::Measure;
use crate::model::{Break, Model, Of, OfFamily};
use crate::remember::{
    History, Remembering, RememberingFamily, RememberingGradient, RememberingPoint,
};
use crate::specialise::Form;
use crate::verify::sample::{Point, contains};

/// Lengths at rest that are tried, over the horizon; areas and volumes are their powers.
const REFERENCES: [f64; 2] = [0.5, 0.15];

/// Points of every decade of the measure.
const POINTS_PER_DECADE: i32 = 100;

/// Largest stretches of bodies that are tried, for gradients and gathered values, between those that are in hundredths.
const STRETCHES_OF_BODIES: [f64; 11] =
    [1.0, 0.1, 0.5, 0.8, 0.999, 0.9999, 1.0001, 1.001, 1.5, 3.0, 10.0];

/// In hundredths: of bodies that domains let stretch little.
const HUNDREDTHS: std::ops::RangeInclusive<i32> = 90..=130;

/// A time in s in which all has happened that time can do.
const AGE: f64 = 1e12;

/// A condition with values for everything it depends on.
pub(super) struct Breaking {
    pub(super) span: Span,
    of: Of,
    /// Whether what breaks by it has an energy. Bonds always count as if: triangles go with them.
    has_energy: bool,
    /// Stretches in the declared domain, ratios of the measure to that at rest, and whether one breaks there. Of
    /// families the largest stretch of the body; below 1 it is the same in all directions.
    tried: Vec<(f64, bool)>,
}

impl Breaking {
    /// The conditions of a model for some values; none if no values are found, or they are too large to be
    /// compiled.
    pub(super) fn examples(model: &Model, dimension: usize) -> Vec<Breaking> {
        let mut all = Breaking::of_measures(model, dimension);
        all.extend(Breaking::of_gradients(model, dimension));
        all.extend(Breaking::of_points(model, dimension));
        all.extend(Breaking::of_vectors(model, dimension));
        all
    }

    /// Those of deformation gradients.
    fn of_gradients(model: &Model, dimension: usize) -> Vec<Breaking> {
        let (mode, form) = (Mode::Interpreter, Form::Textbook);
        let Some(values) = example(model, dimension) else { return Vec::new() };
        let made = RememberingGradient::new(model, &values, mode, form)
            .and_then(|(begin, values)| Ok((begin, model.gradient_criteria(&values, mode, form)?)));
        let Ok((begin, criteria)) = made else { return Vec::new() };
        let places = deformed(dimension);
        Breaking::of_families(model, dimension, |condition| {
            let one = criteria.iter().find(|one| one.text == condition.text)?;
            Some(places.iter().map(|place| breaks_at(&begin, one, place)).collect())
        })
    }

    /// Those of gathered numbers.
    fn of_points(model: &Model, dimension: usize) -> Vec<Breaking> {
        let (mode, form) = (Mode::Interpreter, Form::Textbook);
        let is_gathered = |one: &Break<OfFamily>| one.of != OfFamily::Gradient;
        let variant = model.variant(dimension);
        let Some(variant) = variant.filter(|own| own.family_breaks.iter().any(is_gathered)) else {
            return Vec::new();
        };
        let Some(values) = example(model, dimension) else { return Vec::new() };
        let Ok(Some((begin, _, with_states))) = RememberingPoint::new(model, &values, (mode, form))
        else {
            return Vec::new();
        };
        let Ok(criteria) = model.gathered_criteria(&with_states, mode, form) else {
            return Vec::new();
        };
        let mut places = deformed(dimension);
        places.retain(|(_, change)| begin.is_declared(variant, &values, change));
        Breaking::of_families(model, dimension, |condition| {
            let one = criteria.iter().find(|one| one.text == condition.text)?;
            Some(places.iter().map(|place| breaks_at(&begin, one, place)).collect())
        })
    }

    /// Those of what points gather of vectors.
    fn of_vectors(model: &Model, dimension: usize) -> Vec<Breaking> {
        let ways = (Mode::Interpreter, Form::Textbook);
        let found = || {
            let family =
                RememberingFamily::new(model, &example(model, dimension)?, ways).ok()??;
            let criteria = model.vector_criteria(family.values(), ways.0, ways.1).ok()?;
            (!criteria.is_empty()).then_some((family, criteria))
        };
        let Some((family, criteria)) = found() else { return Vec::new() };
        let mut places = deformed(dimension);
        places.retain(|(_, change)| family.is_declared(change));
        Breaking::of_families(model, dimension, |condition| {
            let one = criteria.iter().find(|one| one.text == condition.text)?;
            let breaks =
                |(stretch, change): &(f64, Vec<f64>)| (*stretch, family.breaks(one, change));
            Some(places.iter().map(breaks).collect())
        })
    }

    /// Those of families for which something is tried.
    fn of_families(
        model: &Model,
        dimension: usize,
        tried: impl Fn(&Break<OfFamily>) -> Option<Vec<(f64, bool)>>,
    ) -> Vec<Breaking> {
        let Some(variant) = model.variant(dimension) else { return Vec::new() };
        let breaking = |condition: &Break<OfFamily>| {
            let (span, of) = (condition.span, Of::Family(condition.of));
            Some(Breaking { span, of, has_energy: true, tried: tried(condition)? })
        };
        variant.family_breaks.iter().filter_map(breaking).collect()
    }

    fn of_measures(model: &Model, dimension: usize) -> Vec<Breaking> {
        let Some(variant) = model.variant(dimension) else { return Vec::new() };
        let Some(values) = example(model, dimension) else { return Vec::new() };
        let values = values.with_states(model);
        let begin = |measure| {
            Remembering::new(model, measure, &values, Mode::Interpreter, Form::Textbook).ok()
        };
        let of_kinds = Measure::ALL.map(begin);
        let criteria = model.criteria(&values, Mode::Interpreter, Form::Textbook);
        let stretches: Vec<f64> = (-3 * POINTS_PER_DECADE..=POINTS_PER_DECADE)
            .map(|k| libm::pow(10.0, f64::from(k) / f64::from(POINTS_PER_DECADE)))
            .chain((2..=12).flat_map(|k| {
                let strain = libm::pow(10.0, f64::from(-k));
                [1.0 - strain, 1.0 + strain]
            }))
            .collect();
        let points = |measure: Measure, part: f64| {
            let length = part * values.horizon;
            let reference = (1..measure.points()).fold(1.0, |power, _| power * length);
            let point = move |stretch: f64| Point { measure: stretch * reference, reference };
            let declares = |point: &Point| contains(variant, measure, &values, *point);
            stretches.iter().map(|stretch| point(*stretch)).filter(declares).collect::<Vec<_>>()
        };
        let of_measures = Measure::ALL.map(|measure| -> Vec<Point> {
            REFERENCES.into_iter().flat_map(|part| points(measure, part)).collect()
        });
        let breaking = |(condition, criterion): (&Break<Measure>, Criterion)| {
            let measure = condition.of;
            let one = of_kinds[measure as usize].as_ref()?;
            let tried = |point: &Point| {
                let stretch = point.measure / point.reference;
                (stretch, breaks_in_time(one.clone(), &criterion, *point))
            };
            let points = &of_measures[measure as usize];
            let has_energy = measure == Measure::Length
                || model.measures().contains(&measure)
                || model.coupled().contains(&measure);
            let (span, of) = (condition.span, Of::Measure(measure));
            let tried = points.iter().map(tried).collect();
            Some(Breaking { span, of, has_energy, tried })
        };
        let criteria = criteria.unwrap_or_default();
        variant.breaks.iter().zip(criteria).filter_map(breaking).collect()
    }

    /// What breaks, one and many.
    fn words(&self) -> [&'static str; 2] {
        let measure = match self.of {
            Of::Measure(measure) => measure,
            Of::Family(_) => Measure::Length,
        };
        [measure.interaction(), measure.interactions()]
    }

    /// A stretch at which one breaks.
    fn broken_at(&self, wanted: impl Fn(f64) -> bool) -> Option<f64> {
        self.tried.iter().find(|(stretch, breaks)| *breaks && wanted(*stretch)).map(|tried| tried.0)
    }
}

/// Bodies that are stretched in all directions, or in one, or sheared: the largest stretch with `F - I`, row by row.
fn deformed(dimension: usize) -> Vec<(f64, Vec<f64>)> {
    let unit = |k: usize| if k / dimension == k % dimension { 1.0 } else { 0.0 };
    let all = |of: &dyn Fn(usize) -> f64| (0..dimension * dimension).map(of).collect();
    let mut places: Vec<(f64, Vec<f64>)> = Vec::new();
    let hundredths = HUNDREDTHS.filter(|k| *k != 100).map(|k| f64::from(k) / 100.0);
    for stretch in STRETCHES_OF_BODIES.into_iter().chain(hundredths) {
        let e = stretch - 1.0;
        places.push((stretch, all(&|k| e * unit(k))));
        if e > 0.0 {
            places.push((stretch, all(&|k| if k == 0 { e } else { 0.0 })));
            places.push((stretch, all(&|k| if k == 1 { e } else { 0.0 })));
        }
    }
    places
}

/// A stretch with whether bonds break in a body that is deformed so: at once, with what is remembered there, and
/// after a long time.
fn breaks_at<H: History>(
    begin: &H,
    criterion: &H::Criterion,
    (stretch, change): &(f64, Vec<f64>),
) -> (f64, bool) {
    let mut place = begin.clone();
    let breaks = [0.0, 0.0, AGE].into_iter().any(|dt| {
        let breaks = place.breaks(criterion, change);
        place.advance(change, dt);
        breaks || place.breaks(criterion, change)
    });
    (*stretch, breaks)
}

/// Whether one breaks that comes to a measure and stays there for a long time, but at rest.
fn breaks_in_time(mut bond: Remembering, criterion: &Criterion, point: Point) -> bool {
    let mut breaks = bond.breaks(criterion, point);
    if point.measure != point.reference {
        for dt in [0.0, AGE] {
            breaks |= bond.advance(point, dt) && bond.breaks(criterion, point);
        }
    }
    breaks
}

/// A condition that holds where nothing is deformed.
pub(super) fn at_rest(breaking: &Breaking) -> Option<Finding> {
    breaking.broken_at(|stretch| stretch == 1.0)?;
    let [_, many] = breaking.words();
    let (place, help) = match breaking.of {
        Of::Measure(measure) => {
            let (m, rest) = (measure.symbol(), measure.reference_symbol());
            let help = format!("let it hold beyond a stretch: `break when {m}/{rest} - 1 > s0`");
            (format!("at {m} = {rest}"), help)
        }
        Of::Family(OfFamily::Gradient) => {
            let help = "let it hold beyond a change of volume: `break when J - 1 > h0`";
            ("at F = I".into(), help.into())
        }
        Of::Family(_) => {
            let help =
                "compare what is gathered with more than it is at rest: `break when theta > t0`";
            ("in a body that is not deformed".into(), help.into())
        }
    };
    Some(Finding { message: format!("{many} break at rest: the condition holds {place}"), help })
}

/// A condition that holds nowhere in the domain.
pub(super) fn never(breaking: &Breaking) -> Option<Finding> {
    if breaking.tried.is_empty() || breaking.broken_at(|_| true).is_some() {
        return None;
    }
    let largest = short(breaking.tried.iter().fold(0.0, |most: f64, tried| most.max(tried.0)));
    let [one, _] = breaking.words();
    let (where_, help) = match breaking.of {
        Of::Measure(measure) => {
            let (m, rest) = (measure.symbol(), measure.reference_symbol());
            let quantity = measure.quantity();
            (
                format!("in the domain, up to {m}/{rest} = {largest}"),
                format!("compare a quantity that grows with the {quantity}, or widen the `domain`"),
            )
        }
        Of::Family(kind) => {
            let example = match kind {
                OfFamily::Gradient => "`J - 1`, `E : E`",
                _ => "`theta` with `theta = integral(l/L - 1)`",
            };
            (
                format!("up to a stretch of {largest}, of all directions or one, and in no shear"),
                format!("compare a quantity that grows with the deformation: {example}"),
            )
        }
    };
    Some(Finding {
        message: format!("no {one} breaks: the condition holds nowhere {where_}"),
        help,
    })
}

/// A condition that holds for bonds that are shortened, and not at rest. Areas shrink where a body is stretched
/// along one side, and volumes that fail by changing at all are meant so.
pub(super) fn in_compression(breaking: &Breaking) -> Option<Finding> {
    let is_at_rest = breaking.broken_at(|stretch| stretch == 1.0).is_some();
    let stretch = breaking.broken_at(|stretch| stretch < 1.0).filter(|_| !is_at_rest)?;
    let at = short(stretch);
    let (place, ask) = match breaking.of {
        Of::Measure(Measure::Length) => {
            (format!("at l/L = {at}"), "compare `l/L - 1` and not its absolute value")
        }
        Of::Measure(_) => return None,
        Of::Family(OfFamily::Gradient) => {
            (format!("at F = {at}*I"), "ask for `J > 1`, too: `break when J > 1 and ..`")
        }
        Of::Family(_) => (
            format!("in a body that shrinks to {at} of its size in all directions"),
            "ask for growth, too: `break when theta > 0 and ..` with `theta = integral(l/L - 1)`",
        ),
    };
    Some(Finding {
        message: format!("bonds break in compression, {place} for instance"),
        help: format!("a crack opens by tension: {ask}"),
    })
}

/// A condition of triangles or tetrahedra in a potential that gives them no energy.
pub(super) fn nothing(breaking: &Breaking) -> Option<Finding> {
    let Of::Measure(measure) = breaking.of else { return None };
    if breaking.has_energy {
        return None;
    }
    let (m, rest) = (measure.symbol(), measure.reference_symbol());
    let [one, many] = breaking.words();
    Some(Finding {
        message: format!("a {one} that breaks loses no energy: there is no psi({m})"),
        help: format!(
            "give {many} an energy, `psi({m}) = 1/2*C*{rest}*({m}/{rest} - 1)^2`, or compare `l/L - 1`: then \
             bonds break"
        ),
    })
}
