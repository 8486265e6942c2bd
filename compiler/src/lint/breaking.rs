//! Conditions under which bonds, triangles and tetrahedra break: that hold at rest, never, or in
//! compression, or that take nothing away.

use super::Finding;
use super::subject::{example, short};
use crate::breaking::Criterion;
use crate::kernel::Mode;
use crate::measure::Measure;
use crate::model::{Break, Model};
use crate::remember::Remembering;
use crate::specialise::Form;
use crate::verify::sample::{Point, contains};

/// Lengths at rest that are tried, over the horizon; areas and volumes are their powers.
const REFERENCES: [f64; 2] = [0.5, 0.15];

/// Points of every decade of the measure.
const POINTS_PER_DECADE: i32 = 100;

/// A time in s in which all has happened that time can do.
const AGE: f64 = 1e12;

/// A condition with values for everything it depends on.
pub(super) struct Breaking<'m> {
    pub(super) condition: &'m Break,
    /// Whether what breaks by it has an energy. Bonds always count as if: triangles go with them.
    has_energy: bool,
    /// Stretches in the declared domain, ratios of the measure to that at rest, and whether one breaks there.
    tried: Vec<(f64, bool)>,
}

impl<'m> Breaking<'m> {
    /// The conditions of a model for some values; none if no values are found, or they are too large to be
    /// compiled.
    pub(super) fn examples(model: &'m Model, dimension: usize) -> Vec<Breaking<'m>> {
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
        let breaking = |(condition, criterion): (&'m Break, Criterion)| {
            let measure = condition.measure;
            let one = of_kinds[measure as usize].as_ref()?;
            let tried = |point: &Point| {
                let stretch = point.measure / point.reference;
                (stretch, breaks_in_time(one.clone(), &criterion, *point))
            };
            let points = &of_measures[measure as usize];
            let has_energy = measure == Measure::Length
                || model.measures().contains(&measure)
                || model.coupled().contains(&measure);
            let tried = points.iter().map(tried).collect();
            Some(Breaking { condition, has_energy, tried })
        };
        let criteria = criteria.unwrap_or_default();
        variant.breaks.iter().zip(criteria).filter_map(breaking).collect()
    }

    /// The measure, that at rest, and what has them.
    fn words(&self) -> [&'static str; 3] {
        let measure = self.condition.measure;
        let all = match measure {
            Measure::Length => "bond",
            Measure::Area => "triangle",
            Measure::Volume => "tetrahedron",
        };
        [measure.symbol(), measure.reference_symbol(), all]
    }

    /// The same of many.
    fn many(&self) -> &'static str {
        match self.condition.measure {
            Measure::Length => "bonds",
            Measure::Area => "triangles",
            Measure::Volume => "tetrahedra",
        }
    }

    /// A stretch at which one breaks.
    fn broken_at(&self, wanted: impl Fn(f64) -> bool) -> Option<f64> {
        self.tried.iter().find(|(stretch, breaks)| *breaks && wanted(*stretch)).map(|tried| tried.0)
    }
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
pub(super) fn at_rest(breaking: &Breaking<'_>) -> Option<Finding> {
    breaking.broken_at(|stretch| stretch == 1.0)?;
    let ([m, rest, _], many) = (breaking.words(), breaking.many());
    Some(Finding {
        message: format!("{many} break at rest: the condition holds at {m} = {rest}"),
        help: format!("let it hold beyond a stretch: `break when {m}/{rest} - 1 > s0`"),
    })
}

/// A condition that holds nowhere in the domain.
pub(super) fn never(breaking: &Breaking<'_>) -> Option<Finding> {
    if breaking.broken_at(|_| true).is_some() {
        return None;
    }
    let largest = breaking.tried.iter().fold(0.0, |most: f64, tried| most.max(tried.0));
    let [m, rest, one] = breaking.words();
    let quantity = match breaking.condition.measure {
        Measure::Length => "length",
        Measure::Area => "area",
        Measure::Volume => "volume",
    };
    Some(Finding {
        message: format!(
            "no {one} breaks: the condition holds nowhere in the domain, up to {m}/{rest} = {}",
            short(largest)
        ),
        help: format!("compare a quantity that grows with the {quantity}, or widen the `domain`"),
    })
}

/// A condition that holds for bonds that are shortened, and not at rest. Areas shrink where a body is stretched
/// along one side, and volumes that fail by changing at all are meant so.
pub(super) fn in_compression(breaking: &Breaking<'_>) -> Option<Finding> {
    if breaking.condition.measure != Measure::Length {
        return None;
    }
    let is_at_rest = breaking.broken_at(|stretch| stretch == 1.0).is_some();
    let stretch = breaking.broken_at(|stretch| stretch < 1.0).filter(|_| !is_at_rest)?;
    Some(Finding {
        message: format!("bonds break in compression, at l/L = {} for instance", short(stretch)),
        help: "a crack opens by tension: compare `l/L - 1` and not its absolute value".into(),
    })
}

/// A condition of triangles or tetrahedra in a potential that gives them no energy.
pub(super) fn nothing(breaking: &Breaking<'_>) -> Option<Finding> {
    if breaking.has_energy {
        return None;
    }
    let ([m, rest, one], many) = (breaking.words(), breaking.many());
    Some(Finding {
        message: format!("a {one} that breaks loses no energy: there is no psi({m})"),
        help: format!(
            "give {many} an energy, `psi({m}) = 1/2*C*{rest}*({m}/{rest} - 1)^2`, or compare `l/L - 1`: then \
             bonds break"
        ),
    })
}
