//! Parameters of a scene that vary: expressions of X, Y, Z, t and of the columns of a point cloud.
//!
//! Before: texts of a scene. After: [`FieldsInTime`], values at all points that energies look up, worked
//! out anew where they change with t.

use std::ops::Range;
use std::sync::Arc;

use piola_compiler::{Formula, Model, Values, is_quantity};
use piola_grammar::{Diagnostic, Span};
use piola_mechanics::materials::{Fields, Materials};
use piola_output::read;
use rayon::prelude::*;

use super::directions::direction;
use super::{Case, CaseError, Potential};
use crate::scene::expression::{names, placed};
use crate::scene::selection::coordinates;
use crate::scene::{Interface, Material, ParameterSetting, ParameterText, Points, Scene};

/// See [`Case::with_fields_of`].
pub(crate) type InTheMiddle<'m> =
    dyn Fn(usize, usize, &dyn Fn(usize) -> Option<Vec<f64>>) -> Option<Vec<f64>> + 'm;

/// What an expression may always name.
const VARIABLES: [&str; 4] = ["X", "Y", "Z", "t"];

/// What the direction of bonds is called among fields, where no parameter can have its name.
const DIRECTION: &str = "Xi/L";

/// What stands between an expression and its unit.
const IN: &str = " in ";

/// Columns of a point cloud beside positions and volumes, of the points that are left.
#[derive(Clone, Debug, Default)]
pub(crate) struct Columns {
    pub(crate) names: Vec<String>,
    /// Column by column, in the user's order.
    pub(crate) values: Vec<Vec<f64>>,
}

impl Columns {
    /// Those of a cloud that parameters of the scene name. `keep` says which points are left.
    pub(super) fn read(
        text: &str,
        scene: &Scene,
        keep: &[bool],
    ) -> Result<Columns, Vec<read::TableError>> {
        let given = scene.materials.iter().flat_map(|material| &material.parameters);
        let texts: Vec<&str> = given.filter_map(expression_text).collect();
        let is_named = |column: &String| {
            !VARIABLES.contains(&column.as_str())
                && texts.iter().any(|text| names(without_unit(text).0, column).next().is_some())
        };
        let columns: Vec<String> = read::column_names(text).into_iter().filter(is_named).collect();
        let wanted: Vec<&str> = columns.iter().map(String::as_str).collect();
        if wanted.is_empty() {
            return Ok(Columns::default());
        }
        let rows = read::read_numbers(text, &wanted, |values| {
            let bad = values.iter().position(|x| !x.is_finite())?;
            Some((bad, "a value that a parameter takes must be finite".to_string()))
        })?;
        let kept = || rows.iter().zip(keep).filter(|(_, keep)| **keep).map(|(row, _)| row);
        let values = (0..wanted.len()).map(|k| kept().map(|row| row[k]).collect()).collect();
        Ok(Columns { names: columns, values })
    }
}

/// An expression and the unit behind it.
fn without_unit(text: &str) -> (&str, Option<&str>) {
    match text.rsplit_once(IN) {
        Some((expression, unit)) => (expression, Some(unit.trim())),
        None => (text, None),
    }
}

/// The text of a parameter that is no number with a unit.
fn expression_text(parameter: &ParameterSetting) -> Option<&str> {
    match &parameter.value.value {
        ParameterText::Quantity(text) if !is_quantity(text) => Some(text),
        _ => None,
    }
}

/// The text of a parameter that varies. Of a lattice nothing but X, Y, Z and t can; what a cloud has
/// columns of is not known before it is read.
pub(super) fn varying<'a>(scene: &Scene, parameter: &'a ParameterSetting) -> Option<&'a str> {
    let is_cloud = !matches!(scene.body.points, Points::Lattice(_));
    let varies = |text: &&str| VARIABLES.iter().any(|name| names(text, name).next().is_some());
    expression_text(parameter).filter(|text| is_cloud || varies(text))
}

/// A parameter that varies.
#[derive(Clone, Debug)]
pub(crate) struct Field {
    name: String,
    text: String,
    /// Its place in the scene.
    span: Span,
    formula: Formula,
    /// One of its unit in SI units.
    factor: f64,
    is_steady: bool,
}

impl Field {
    /// Whether it is the same at all t.
    pub(super) fn is_steady(&self) -> bool {
        self.is_steady
    }

    /// Compiles the fields of a material, in the order of the parameters of its potential; states with what they
    /// begin with.
    pub(super) fn of(
        scene: &Scene,
        material: &Material,
        (model, values): (&Model, &Values),
        columns: &Columns,
    ) -> Result<Vec<Field>, CaseError> {
        let mut errors = Vec::new();
        let mut fields = Vec::new();
        for (parameter, value) in model.parameters().iter().zip(&values.parameters) {
            let given = material.parameters.iter().find(|p| p.name.value == parameter.name);
            let Some((setting, text)) = given.and_then(|p| Some((p, varying(scene, p)?))) else {
                let span = given.map_or(material.potential.span, |setting| setting.value.span);
                let even = || Field::even(&parameter.name, *value, span);
                fields.extend(parameter.is_state.then(even).flatten());
                continue;
            };
            match Field::new(scene, setting, text, (model, values.dimension), columns) {
                Ok(field) if parameter.is_state && !field.is_steady => {
                    let message =
                        format!("the state `{}` begins with a value that knows no t", field.name);
                    let found = Diagnostic::error("conflicting-keys", field.span, message);
                    errors.push(found.help("leave t out of it: it changes as the potential says"));
                }
                Ok(field) => fields.push(field),
                Err(found) => errors.extend(found),
            }
        }
        for number in model.directions(values.dimension) {
            // Each bond has its own, by its ends; this is a typical one.
            let typical = values.parameters[usize::from(number)];
            fields.extend(Field::even(DIRECTION, typical, material.potential.span));
        }
        if values.follow_states(model) {
            // Energies hold what is remembered, but where load steps say otherwise.
            fields.extend(Field::even("dt", -1.0, material.potential.span));
        }
        if errors.is_empty() { Ok(fields) } else { Err(CaseError::Scene(scene.report(errors))) }
    }

    /// The same value in SI units everywhere.
    fn even(name: &str, value: f64, span: Span) -> Option<Field> {
        let formula = Formula::number("1", &[]).ok()?;
        let (name, text) = (name.to_string(), value.to_string());
        Some(Field { name, text, span, formula, factor: value, is_steady: true })
    }

    fn new(
        scene: &Scene,
        setting: &ParameterSetting,
        text: &str,
        (model, dimension): (&Model, usize),
        columns: &Columns,
    ) -> Result<Field, Vec<Diagnostic>> {
        let (name, span) = (&setting.name.value, setting.value.span);
        let (expression, unit) = without_unit(text);
        let factor = model.unit_of(name, unit, dimension).unwrap_or(Ok(1.0)).map_err(|error| {
            vec![Diagnostic::error(error.code, span, error.message).help(error.help)]
        })?;
        if scene.body.dimension == 2
            && let Some(place) = names(expression, "Z").next()
        {
            let message = "there is no Z in two dimensions";
            let found = Diagnostic::error("no-third-dimension", place, message);
            return Err(vec![placed(found.help("use X and Y"), text, span)]);
        }
        let known = columns.names.iter().map(String::as_str);
        let variables: Vec<&str> = VARIABLES.into_iter().chain(known).collect();
        let formula = Formula::number(expression, &variables).map_err(|found| {
            found.into_iter().map(|one| placed(one, text, span)).collect::<Vec<Diagnostic>>()
        })?;
        let is_steady = names(expression, "t").next().is_none();
        let (name, text) = (name.clone(), text.to_string());
        Ok(Field { name, text, span, formula, factor, is_steady })
    }

    /// Its value in SI units at a reference position, with what columns have there, and a time.
    fn value(&self, position: &[f64], columns: impl Iterator<Item = f64>, t: f64) -> f64 {
        let z = position.get(2).copied().unwrap_or(0.0);
        let arguments: Vec<f64> =
            [position[0], position[1], z, t].into_iter().chain(columns).collect();
        self.factor * self.formula.value(&arguments)
    }

    /// The same in the middle of a box, at `t = 0`.
    pub(super) fn in_the_middle(&self, low: &[f64], high: &[f64]) -> f64 {
        let middle: Vec<f64> = low.iter().zip(high).map(|(low, high)| 0.5 * (low + high)).collect();
        let value = self.value(&middle, std::iter::empty(), 0.0);
        if value.is_finite() { value } else { self.factor }
    }
}

/// A value that a parameter cannot have at a point.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("parameter `{name}` = {text} is {value:e} in SI units at {} and t = {t}: {reason}", coordinates(.position))]
pub struct WrongField {
    /// The parameter.
    pub name: String,
    /// What the scene says.
    pub text: String,
    /// What came out.
    pub value: f64,
    /// The reference position of the point in m.
    pub position: Vec<f64>,
    /// The time.
    pub t: f64,
    /// Why it cannot be.
    pub reason: String,
    /// Its place in the scene.
    span: Span,
}

impl WrongField {
    /// At its place in the scene.
    pub(super) fn report(self, scene: &Scene) -> CaseError {
        let found = Diagnostic::error("field-out-of-range", self.span, self.to_string());
        CaseError::Scene(scene.report(vec![found]))
    }
}

/// The fields of a case with the arrays that its energies look them up in.
pub struct FieldsInTime<'a> {
    case: &'a Case,
    /// Of each layer, where it has fields.
    layers: Vec<Option<Arc<Fields>>>,
}

impl<'a> FieldsInTime<'a> {
    /// Those at `t = 0`.
    pub(super) fn new(case: &'a Case) -> Result<FieldsInTime<'a>, WrongField> {
        let n_laws = case.scene.n_laws();
        let places = case.places();
        let n_layers = places.iter().map(|(_, layer)| layer + 1).max().unwrap_or(0);
        let of_layer = |layer: usize| {
            let mut typical = vec![Vec::new(); n_laws];
            let mut states = vec![Vec::new(); n_laws];
            let mut axes = vec![Vec::new(); n_laws];
            let mut is_steady = true;
            let own = case.potentials.iter().zip(&places).filter(|(_, place)| place.1 == layer);
            for (potential, (law, _)) in own {
                let values = potential.values.fields.iter();
                let values = values.map(|i| potential.values.parameters[usize::from(*i)]);
                typical[*law] = values.collect();
                states[*law] = potential.which_are_states(&case.scene);
                axes[*law] = potential.axes_of_directions();
                is_steady &= potential.fields.iter().all(|field| field.is_steady);
            }
            let fields = Fields::new(case.body.n_points(), &typical, is_steady);
            let follow =
                case.potentials.iter().zip(&places).filter(|(one, place)| {
                    place.1 == layer && one.values.follow_states(&one.model)
                });
            let time_steps = follow.map(|(_, (law, _))| fields.of_law(*law).end - 1).collect();
            let fields = fields.with_states(states.concat()).with_time_steps(time_steps);
            let fields = fields.with_directions(axes.concat(), &case.body);
            (!fields.is_empty()).then(|| Arc::new(fields))
        };
        let fields = FieldsInTime { case, layers: (0..n_layers).map(of_layer).collect() };
        fields.set(0.0, |_| true)?;
        Ok(fields)
    }

    /// The materials of a layer with its fields.
    pub(super) fn materials(&self, layer: usize) -> Option<Arc<Materials>> {
        let Some(fields) = self.layers.get(layer).and_then(Option::as_ref) else {
            return self.case.materials.clone();
        };
        let of_one = || Materials::new(vec![0; self.case.body.n_points()], Vec::new());
        let materials = self.case.materials.as_deref().cloned().unwrap_or_else(of_one);
        Some(Arc::new(materials.with_fields(Arc::clone(fields))))
    }

    /// Whether the scene gives any that changes with t; what is remembered changes without.
    pub(crate) fn change(&self) -> bool {
        self.case.parameters_change()
    }

    /// Whether none changes with t.
    pub fn are_steady(&self) -> bool {
        self.layers.iter().flatten().all(|fields| fields.is_steady())
    }

    /// Gives those that change with t their values at `t`; energies are others from then on. Whether any
    /// does.
    ///
    /// # Errors
    /// A value that is not finite, or breaks a condition of the potential.
    pub fn advance(&self, t: f64) -> Result<bool, WrongField> {
        if self.are_steady() {
            return Ok(false);
        }
        self.set(t, |field| !field.is_steady)?;
        Ok(true)
    }

    fn set(&self, t: f64, is_wanted: impl Fn(&Field) -> bool) -> Result<(), WrongField> {
        for (potential, (law, layer)) in self.case.potentials.iter().zip(self.case.places()) {
            let Some(fields) = &self.layers[layer] else { continue };
            let own = fields.of_law(law);
            if !potential.fields.iter().any(&is_wanted) {
                continue;
            }
            // What points remember by now is no longer what they began with.
            let wanted: Vec<bool> = potential.fields.iter().map(&is_wanted).collect();
            self.case.each_value(potential, law, t, |point, values| {
                let values = own.clone().zip(values).zip(&wanted).filter(|(_, wanted)| **wanted);
                values.for_each(|((field, value), _)| fields.set(field, point, *value));
            })?;
        }
        Ok(())
    }
}

impl Case {
    /// Whether parameters of its energies change with t.
    pub(crate) fn parameters_change(&self) -> bool {
        self.potentials.iter().flat_map(|one| &one.fields).any(|field| !field.is_steady)
    }

    /// Of each potential its law, and how many of the same law come before it.
    pub(super) fn places(&self) -> Vec<(usize, usize)> {
        let mut seen = vec![0; self.scene.n_laws()];
        let place = |material: &Material| {
            let layer = seen[material.law];
            seen[material.law] += 1;
            (material.law, layer)
        };
        self.scene.materials.iter().map(place).collect()
    }

    /// The points whose interactions may take a law: those of its material; of an interface all of the
    /// two materials that it lies between.
    fn points_of_law(&self, law: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.body.n_points()).filter(move |point| self.is_of_law(*point, law))
    }

    fn is_of_law(&self, point: usize, law: usize) -> bool {
        let Some(materials) = self.materials.as_deref() else { return true };
        let material = usize::from(materials.of(point));
        let mut interfaces = self.scene.interfaces.iter();
        let joins = |interface: &Interface| {
            let between = interface.between.iter();
            interface.rule.law() == Some(law) && between.map(|m| m.value).any(|m| m == material)
        };
        material == law || interfaces.any(joins)
    }

    /// Shows what the fields of a potential are at all points of a law; the first that cannot be is an
    /// error.
    fn each_value(
        &self,
        potential: &Potential,
        law: usize,
        t: f64,
        see: impl Fn(usize, &[f64]) + Sync,
    ) -> Result<(), WrongField> {
        let points: Vec<usize> = self.points_of_law(law).collect();
        let wrong = points.par_iter().filter_map(|point| {
            self.values_of(potential, *point, t).map(|values| see(*point, &values)).err()
        });
        wrong.find_first(|_| true).map_or(Ok(()), Err)
    }

    /// What the fields of a potential are at a point, in SI units.
    fn values_of(
        &self,
        potential: &Potential,
        point: usize,
        t: f64,
    ) -> Result<Vec<f64>, WrongField> {
        let position = self.body.position(point);
        let wrong = |field: &Field, value: f64, reason: String| WrongField {
            name: field.name.clone(),
            text: field.text.clone(),
            value,
            position: position.to_vec(),
            t,
            reason,
            span: field.span,
        };
        let row = self.body.places()[point] as usize;
        let columns = || self.columns.values.iter().map(move |column| column[row]);
        let mut values = Vec::with_capacity(potential.fields.len());
        for field in &potential.fields {
            let value = field.value(position, columns(), t);
            if !value.is_finite() {
                return Err(wrong(field, value, "it must be a finite number".into()));
            }
            values.push(value);
        }
        if let Some(error) = potential.model.check_fields(&potential.values, &values).pop() {
            let place = potential.fields.iter().position(|field| field.name == error.parameter);
            let place = place.unwrap_or(0);
            let reason = format!("{}; {}", error.message, error.help);
            return Err(wrong(&potential.fields[place], values[place], reason));
        }
        Ok(values)
    }

    /// The values of a potential's parameters between some points, of fields the mean of theirs at `t = 0`.
    pub(super) fn values_between(
        &self,
        (potential, law): (&Potential, usize),
        points: &[usize],
    ) -> Values {
        let mut values = potential.values.without_fields();
        let own = points.iter().filter(|point| self.is_of_law(**point, law));
        let of_points: Vec<Vec<f64>> =
            own.filter_map(|p| self.values_of(potential, *p, 0.0).ok()).collect();
        for (k, parameter) in potential.values.fields.iter().enumerate() {
            let sum = of_points.iter().fold(0.0, |sum, row| sum + row[k]);
            if !of_points.is_empty() {
                values.parameters[usize::from(*parameter)] = sum / of_points.len() as f64;
            }
        }
        if let [from, to] = *points {
            let (from, to) = (self.body.position(from), self.body.position(to));
            values = values.with_direction(&potential.model, &direction(from, to));
        }
        values
    }

    /// Compiles the fields anew where columns are known, and gives them typical values: those of the
    /// middle one of their points at `t = 0`.
    pub(super) fn with_fields(self) -> Result<Case, CaseError> {
        let own = 0..self.body.n_points();
        self.with_fields_of(own, &|count, _, value| value(count / 2))
    }

    /// The same of a part of a body, of which points `own` are nobody else's: how many of these take a law the last
    /// function is given, with how many fields this has and what these are at the one of a number, and gives back what
    /// they are at the middle one of the body. It is called as often for any part.
    pub(crate) fn with_fields_of(
        mut self,
        own: Range<usize>,
        in_the_middle: &InTheMiddle<'_>,
    ) -> Result<Case, CaseError> {
        let mut found = Ok(());
        for number in 0..self.potentials.len() {
            let (potential, material) = (&self.potentials[number], &self.scene.materials[number]);
            if potential.values.fields.is_empty() {
                continue;
            }
            let of = (&potential.model, &potential.values);
            match Field::of(&self.scene, material, of, &self.columns) {
                Ok(fields) => self.potentials[number].fields = fields,
                Err(error) => return found.and(Err(error)),
            }
            let (law, potential) = (self.scene.materials[number].law, &self.potentials[number]);
            let checked = self.each_value(potential, law, 0.0, |_, _| ());
            found = found.and(checked.map_err(|wrong| wrong.report(&self.scene)));
            let points = || self.points_of_law(law).filter(|point| own.contains(point));
            let value = |number: usize| -> Option<Vec<f64>> {
                self.values_of(potential, points().nth(number)?, 0.0).ok()
            };
            let middle = in_the_middle(points().count(), potential.values.fields.len(), &value);
            let values = &mut self.potentials[number].values;
            for (parameter, value) in values.fields.iter().zip(middle.into_iter().flatten()) {
                values.parameters[usize::from(*parameter)] = value;
            }
        }
        found.map(|()| self)
    }

    /// The same body where parameters that vary have everywhere the values that they have in the middle
    /// of their points at `t = 0`.
    pub fn without_fields(&self) -> Case {
        let mut case = self.clone();
        for potential in &mut case.potentials {
            let Potential { model, values, fields, .. } = potential;
            *values = values.without_parameters_that_vary(model);
            fields.retain(|field| field.name == DIRECTION);
        }
        case
    }

    /// The same with what is remembered as the only fields: for single interactions.
    pub(crate) fn with_states_alone(&self) -> Case {
        let mut case = self.without_fields();
        for potential in &mut case.potentials {
            potential.values = potential.values.clone().with_states(&potential.model);
        }
        case
    }

    /// Of each potential the typical values of its fields, in SI units.
    pub(crate) fn typical_fields(&self) -> Vec<Vec<f64>> {
        let of = |Potential { values, .. }: &Potential| {
            values.fields.iter().map(|k| values.parameters[usize::from(*k)]).collect()
        };
        self.potentials.iter().map(of).collect()
    }

    /// Whether a parameter changes with t.
    pub fn changes_in_time(&self) -> bool {
        self.potentials.iter().any(Potential::changes_in_time)
    }

    /// Whether a parameter varies; what is remembered is none.
    pub fn has_fields(&self) -> bool {
        let varies = |potential: &Potential| {
            let is_parameter = |field: &u16| {
                let parameters = potential.model.parameters();
                parameters.get(usize::from(*field)).is_some_and(|parameter| !parameter.is_state)
            };
            potential.values.fields.iter().any(is_parameter)
        };
        self.potentials.iter().any(varies)
    }

    /// A value of a field that only shows at a later time, at its place in the scene.
    pub fn wrong_field(&self, wrong: WrongField) -> CaseError {
        wrong.report(&self.scene)
    }
}

/// A typical value of a field in SI units before there are points.
pub(super) fn typical(scene: &Scene, field: &Field) -> f64 {
    match &scene.body.points {
        Points::Lattice(shape) => field.in_the_middle(&shape.low, &shape.high),
        Points::Cloud { .. } | Points::Mesh(_) => field.factor,
    }
}
