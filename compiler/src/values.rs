//! Values for the parameters of a potential: defaults, settings with units, conditions.

use piola_grammar::names::entry;
use piola_grammar::suggest;

use crate::check::dimension::Dimension;
use crate::check::in_unit::unit_help;
use crate::check::unit::named_unit;
use crate::expression::Input;
use crate::expression::interpret::Interpreter;
use crate::model::{Conditions, Model, Variant, number_of_time_step};

/// Most parameters of a potential that are fields: kernels take an array of each.
pub const MAX_FIELDS: usize = 8;

/// A value a user gives to a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// A number in the declared unit.
    Number(f64),
    /// A number with a unit, `200 GPa`, or a plain number as text.
    Text(String),
    /// A parameter that varies from place to place; the number, in the declared unit, is a typical value
    /// of it. Conditions on it are checked where its values are: see [`Model::check_fields`].
    Field(f64),
}

/// All inputs of a potential but the measures, in SI units.
#[derive(Clone, Debug, PartialEq)]
pub struct Values {
    /// 2 or 3.
    pub dimension: usize,
    /// One per parameter, in SI units; of fields typical ones. Behind them the components of a typical direction of
    /// bonds ([`Model::directions`]) and the time step in s, where something depends on them.
    pub parameters: Vec<f64>,
    /// The numbers of the parameters that are fields, ascending: kernels take their values place by place,
    /// in this order, where all others are folded in.
    pub fields: Vec<u16>,
    /// The horizon in m; not a number where none is given.
    pub horizon: f64,
}

impl Values {
    /// The fields with typical values.
    pub(crate) fn typical(&self) -> impl Iterator<Item = (u16, f64)> + '_ {
        self.fields.iter().map(|number| (*number, self.parameters[usize::from(*number)]))
    }

    /// The value of a parameter by its number, or of what stands behind all parameters; nothing of what no energy
    /// depends on, such as a direction that only a definition without use holds.
    pub fn parameter(&self, number: u16) -> Option<f64> {
        self.parameters.get(usize::from(number)).copied()
    }

    /// The same with the typical values that others have of its fields.
    pub fn with_fields_of(mut self, others: &Values) -> Values {
        for number in &self.fields {
            self.parameters[usize::from(*number)] = others.parameters[usize::from(*number)];
        }
        self
    }

    /// The same with the states of a model among the fields: each bond has its own.
    pub fn with_states(self, model: &Model) -> Values {
        model.states().fold(self, |values, state| values.with_field(state as u16))
    }

    /// The same with the time step, where updates depend on it, behind all fields.
    pub(crate) fn with_time_step(self, model: &Model) -> Values {
        model.time_step().into_iter().fold(self, Values::with_field)
    }

    /// The same with a parameter among the fields.
    pub(crate) fn with_field(mut self, number: u16) -> Values {
        if let Err(place) = self.fields.binary_search(&number) {
            self.fields.insert(place, number);
        }
        self
    }

    /// The same with nothing among the fields but the direction of a bond, which no two bonds share.
    pub fn without_parameters_that_vary(&self, model: &Model) -> Values {
        let directions = model.directions(self.dimension);
        let fields = self.fields.iter().copied().filter(|field| directions.contains(field));
        Values { fields: fields.collect(), ..self.clone() }
    }

    /// The same with nothing among the fields but the direction of a bond, whatever was.
    pub(crate) fn with_directions_alone(&self, model: &Model) -> Values {
        model.directions(self.dimension).fold(self.without_fields(), Values::with_field)
    }

    /// The same where the bonds that are meant have this direction at rest, a unit vector of d components.
    pub fn with_direction(mut self, model: &Model, direction: &[f64]) -> Values {
        for (number, component) in model.directions(self.dimension).zip(direction) {
            self.parameters[usize::from(number)] = *component;
        }
        self
    }

    /// The same where fields have their typical values everywhere.
    pub fn without_fields(&self) -> Values {
        Values { fields: Vec::new(), ..self.clone() }
    }
}

/// Why a setting cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct ValueError {
    /// Stable kebab-case name.
    pub code: &'static str,
    /// The parameter it is about.
    pub parameter: String,
    /// What is wrong.
    pub message: String,
    /// What to write instead.
    pub help: String,
}

impl Model {
    /// The values in `dimension` dimensions with these settings; defaults elsewhere.
    ///
    /// # Errors
    /// All of: a dimension the potential is not defined in, unknown names, units that do not fit,
    /// numbers that are not finite, missing values, conditions that do not hold.
    pub fn values(
        &self,
        dimension: usize,
        settings: &[(String, Setting)],
        horizon: Option<f64>,
    ) -> Result<Values, Vec<ValueError>> {
        let Some(variant) = self.variant(dimension) else {
            let stated: Vec<String> = self.dimensions().map(|d| d.to_string()).collect();
            let stated = stated.join(" and ");
            return Err(vec![ValueError {
                code: "wrong-dimensions",
                parameter: String::new(),
                message: format!("`{}` is not defined in {dimension} dimensions", self.name),
                help: format!("it is defined in {stated} dimensions"),
            }]);
        };
        let mut declared: Vec<Option<f64>> = variant.defaults.clone();
        let (mut errors, mut fields) = (Vec::new(), Vec::new());
        for (name, setting) in settings {
            match self.parameters.iter().position(|p| p.name == *name) {
                None => errors.push(self.unknown_parameter(name)),
                Some(i) => match self.declared_value(i, variant, setting) {
                    Ok(value) => {
                        declared[i] = Some(value);
                        fields.retain(|field| usize::from(*field) != i);
                        fields.extend(matches!(setting, Setting::Field(_)).then_some(i as u16));
                    }
                    Err(error) => {
                        // A value of any kind is there: it is not missing as well.
                        declared[i] = Some(f64::NAN);
                        errors.push(error);
                    }
                },
            }
        }
        for (parameter, value) in self.parameters.iter().zip(&declared) {
            if value.is_none() {
                errors.push(ValueError {
                    code: "missing-parameter",
                    parameter: parameter.name.clone(),
                    message: format!("parameter `{}` has no value and no default", parameter.name),
                    help: format!("set it, for instance `{} = 1`", parameter.name),
                });
            }
        }
        let states = self.states().map(|state| state as u16);
        let states: Vec<u16> = states.filter(|state| !fields.contains(state)).collect();
        // A time step is one more input: load steps tell it all bonds that remember.
        // So is a length: dissipation takes it beside its rate.
        let more = [self.has_memory(), !self.dissipations().is_empty()];
        let n_more = more.into_iter().filter(|is_there| *is_there).count();
        let n_more = n_more + self.directions(dimension).len();
        let n_inputs = fields.len() + states.len() + n_more;
        if n_inputs > MAX_FIELDS {
            let last = fields.last().or(states.last()).copied().unwrap_or_default();
            errors.push(ValueError {
                code: "too-large",
                parameter: self.parameters[usize::from(last)].name.clone(),
                message: format!(
                    "a potential has at most {MAX_FIELDS} parameters that vary; states count, `dt` of \
                     updates does, the length beside `rate(l)`, and the components of `Xi`"
                ),
                help: "give some of them one number".into(),
            });
        }
        if !errors.is_empty() {
            return Err(errors);
        }
        let declared: Vec<f64> = declared.into_iter().flatten().collect();
        fields.sort_unstable();
        errors.extend(self.broken_constraints(variant, &declared, horizon, |of| {
            of.iter().all(|parameter| !fields.contains(parameter))
        }));
        let mut parameters: Vec<f64> =
            declared.iter().zip(&variant.units).map(|(x, unit)| x * unit.scale).collect();
        for (parameter, value) in self.parameters.iter().zip(&parameters) {
            if !value.is_finite() {
                let message = format!("parameter `{}` is {value} in SI units", parameter.name);
                errors.push(ValueError {
                    code: "not-a-number",
                    parameter: parameter.name.clone(),
                    message,
                    help: "give a smaller number".into(),
                });
            }
        }
        if errors.is_empty() {
            let directions = self.directions(dimension);
            if !directions.is_empty() {
                parameters.extend(typical_direction(dimension));
            }
            fields.extend(directions);
            if self.has_memory() {
                // Statics have no time step.
                parameters.resize(number_of_time_step(self.parameters.len()), 0.0);
                parameters.push(0.0);
            }
            let horizon = horizon.unwrap_or(f64::NAN);
            Ok(Values { dimension, parameters, fields, horizon })
        } else {
            Err(errors)
        }
    }

    fn unknown_parameter(&self, name: &str) -> ValueError {
        let names: Vec<&str> = self.parameters.iter().map(|p| p.name.as_str()).collect();
        let entries = (1..).map(|k| entry(name, k));
        let entries: Vec<String> =
            entries.take_while(|entry| names.contains(&entry.as_str())).collect();
        let help = match suggest(name, names.iter().copied()) {
            _ if entries.len() > 1 => format!(
                "there are {}; in a scene `{name} = [{}]` gives them all",
                entries.join(", "),
                vec!["1.0"; entries.len()].join(", ")
            ),
            Some(near) => format!("did you mean `{near}`?"),
            None if names.is_empty() => "it has no parameters".to_string(),
            None => format!("its parameters are {}", names.join(", ")),
        };
        ValueError {
            code: "unknown-parameter",
            parameter: name.to_string(),
            message: format!("the potential `{}` has no parameter `{name}`", self.name),
            help,
        }
    }

    /// A setting in the parameter's declared unit.
    fn declared_value(
        &self,
        number: usize,
        variant: &Variant,
        setting: &Setting,
    ) -> Result<f64, ValueError> {
        let parameter = &self.parameters[number];
        let error = |code, message: String, help: String| ValueError {
            code,
            parameter: parameter.name.clone(),
            message: format!("parameter `{}`: {message}", parameter.name),
            help,
        };
        let value = match setting {
            Setting::Number(value) | Setting::Field(value) => *value,
            Setting::Text(text) => {
                let (value, unit) = split_quantity(text).ok_or_else(|| {
                    let message = format!("`{text}` is not a number with a unit");
                    error("not-a-number", message, "write for instance \"200 GPa\"".into())
                })?;
                if unit.is_empty() {
                    value
                } else {
                    let own = variant.units[number];
                    let (dimension, scale) = unit_product(unit).ok_or_else(|| {
                        if unit.starts_with(['*', '+', '-', '/', '^', '(']) {
                            let message = format!("`{text}` is not a number with a unit");
                            let help = "write \"200 GPa\" or 2e11; in a scene what varies is an \
                                        expression of X, Y, Z and t, such as \"2e11*(1 + X)\" or \
                                        \"200*(1 + X) in GPa\"";
                            return error("not-a-number", message, help.to_string());
                        }
                        error("unknown-unit", format!("unknown unit `{unit}`"), unit_help(unit))
                    })?;
                    if dimension != own.dimension {
                        let message = format!(
                            "`{text}` is {}, the parameter is {}",
                            dimension.describe(),
                            own.dimension.describe()
                        );
                        let help = match &parameter.unit {
                            None => "write a number without a unit".to_string(),
                            Some(like) => {
                                format!(
                                    "write the value in `{like}`, or in another unit of that kind"
                                )
                            }
                        };
                        return Err(error("dimension-mismatch", message, help));
                    }
                    value * (scale / own.scale)
                }
            }
        };
        if value.is_finite() {
            Ok(value)
        } else {
            let help = "give a finite number".to_string();
            Err(error("not-a-number", format!("{value} is not a finite number"), help))
        }
    }

    /// Conditions on fields that do not hold where these have some values, one for each of
    /// [`Values::fields`], in SI units; empty where all hold.
    pub fn check_fields(&self, values: &Values, fields: &[f64]) -> Vec<ValueError> {
        let Some(variant) = self.variant(values.dimension) else { return Vec::new() };
        let mut all = values.parameters.clone();
        for (number, value) in values.fields.iter().zip(fields) {
            all[usize::from(*number)] = *value;
        }
        let declared: Vec<f64> =
            all.iter().zip(&variant.units).map(|(x, unit)| x / unit.scale).collect();
        let horizon = Some(values.horizon).filter(|horizon| !horizon.is_nan());
        self.broken_constraints(variant, &declared, horizon, |of| {
            of.iter().any(|parameter| values.fields.contains(parameter))
        })
    }

    /// One of a unit, or one of the declared unit where none is given, in SI units, as values of a
    /// parameter; nothing where the potential has no such parameter.
    ///
    /// # Errors
    /// A unit that is none, or one of another quantity.
    pub fn unit_of(
        &self,
        name: &str,
        unit: Option<&str>,
        dimension: usize,
    ) -> Option<Result<f64, ValueError>> {
        let i = self.parameters.iter().position(|p| p.name == name)?;
        let variant = self.variant(dimension)?;
        let scale = variant.units[i].scale;
        let one = unit.map_or(Setting::Number(1.0), |unit| Setting::Text(format!("1 {unit}")));
        Some(self.declared_value(i, variant, &one).map(|value| value * scale))
    }

    /// Conditions that do not hold, of those on parameters that are `wanted`. One that needs a horizon
    /// where none is given stays open.
    fn broken_constraints(
        &self,
        variant: &Variant,
        declared: &[f64],
        horizon: Option<f64>,
        wanted: impl Fn(&[u16]) -> bool,
    ) -> Vec<ValueError> {
        let Conditions { graph, roots } = &variant.conditions;
        let mut interpreter = Interpreter::<f64>::new();
        interpreter.run(graph, |input| match input {
            Input::Parameter(i) => declared[usize::from(i)],
            Input::Horizon => horizon.unwrap_or(f64::NAN),
            _ => f64::NAN,
        });
        let open = |root| horizon.is_none() && graph.depends_on(&[root], Input::Horizon);
        let depends = |root| {
            let all = 0..declared.len() as u16;
            let held = all.filter(|i| graph.depends_on(&[root], Input::Parameter(*i)));
            held.collect::<Vec<u16>>()
        };
        let broken = self.constraints.iter().zip(roots);
        let broken = broken.filter(|(_, root)| !interpreter.truth(**root) && !open(**root));
        let broken = broken.filter(|(_, root)| wanted(&depends(**root)));
        broken
            .map(|(c, _)| c)
            .map(|c| {
                let name = &self.parameters[c.parameter].name;
                ValueError {
                    code: "constraint-violated",
                    parameter: name.clone(),
                    message: format!(
                        "parameter `{name}` = {} breaks `{}`",
                        declared[c.parameter], c.text
                    ),
                    help: format!("choose values for which `{}` holds", c.text),
                }
            })
            .collect()
    }
}

/// A direction of a bond that no symmetry singles out.
fn typical_direction(dimension: usize) -> &'static [f64] {
    if dimension == 2 { &[0.6, 0.8] } else { &[0.48, 0.6, 0.64] }
}

/// Whether a text is a number, or a number with the name of a unit, known or not.
pub fn is_quantity(text: &str) -> bool {
    let is_name = |unit: &str| unit.is_empty() || unit.starts_with(char::is_alphabetic);
    split_quantity(text).is_some_and(|(_, unit)| is_name(unit))
}

/// A number with a unit, such as `2440 kg/m^3`, in SI units; `like` is a unit of the kind that it must
/// be of, itself one of the SI, and that of a plain number.
///
/// # Errors
/// A text that is none, and another kind of unit; `name` says of what.
pub fn quantity(name: &str, text: &str, like: &str) -> Result<f64, ValueError> {
    let error = |code, message: String, help: String| ValueError {
        code,
        parameter: name.to_string(),
        message: format!("`{name}`: {message}"),
        help,
    };
    let example = || format!("write for instance \"1 {like}\"");
    let (value, unit) = split_quantity(text).ok_or_else(|| {
        let message = format!("`{text}` is not a number with a unit");
        error("not-a-number", message, example())
    })?;
    if unit.is_empty() {
        return Ok(value);
    }
    let (dimension, scale) = unit_product(unit)
        .ok_or_else(|| error("unknown-unit", format!("unknown unit `{unit}`"), unit_help(unit)))?;
    match unit_product(like) {
        Some((wanted, _)) if wanted != dimension => {
            let (found, wanted) = (dimension.describe(), wanted.describe());
            let message = format!("`{text}` is {found}, and {wanted} is expected");
            Err(error("dimension-mismatch", message, example()))
        }
        _ => Ok(value * scale),
    }
}

/// "200 GPa" into 200 and "GPa".
fn split_quantity(text: &str) -> Option<(f64, &str)> {
    let text = text.trim();
    // The longest prefix that is a number: "2e3 m" must not end at the `e`.
    let end = (1..=text.len()).rev().filter(|&end| text.is_char_boundary(end)).find(|&end| {
        text[..end].ends_with(|c: char| c.is_ascii_digit() || c == '.')
            && text[..end].parse::<f64>().is_ok()
    })?;
    Some((text[..end].parse().ok()?, text[end..].trim()))
}

/// The dimension and scale of a product such as `J/m^4`.
pub(crate) fn unit_product(text: &str) -> Option<(Dimension, f64)> {
    let (unit, arena) = piola_grammar::parse_unit(text).ok()?;
    let mut dimension = Dimension::NONE;
    let mut scale = 1.0;
    for factor in &unit.factors {
        let base = named_unit(&factor.name.name)?;
        let exponent = match factor.exponent {
            None => 1.0,
            Some(id) => literal(&arena, id)?,
        };
        let exponent = if factor.divided { -exponent } else { exponent };
        dimension = dimension.times(base.dimension.power(exponent)?);
        scale *= libm::pow(base.scale, exponent);
    }
    Some((dimension, scale))
}

fn literal(arena: &piola_grammar::ast::Arena, id: piola_grammar::ast::ExprId) -> Option<f64> {
    use piola_grammar::ast::{ExprKind, UnaryOperator};
    match &arena[id].kind {
        ExprKind::Number(x) => Some(*x),
        ExprKind::Unary { operator: UnaryOperator::Negate, operand } => {
            literal(arena, *operand).map(|x| -x)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_split_at_the_unit() {
        assert_eq!(split_quantity("200 GPa"), Some((200.0, "GPa")));
        assert_eq!(split_quantity("2e3m"), Some((2e3, "m")));
        assert_eq!(split_quantity(" -1.5 "), Some((-1.5, "")));
        assert_eq!(split_quantity("3.J/m^4"), Some((3.0, "J/m^4")));
        assert_eq!(split_quantity("GPa"), None);
    }

    #[test]
    fn quantities_are_in_si_units() {
        let density = |text| quantity("density", text, "kg/m^3");
        assert!((density("7.8 g/cm^3").unwrap() - 7800.0).abs() < 1e-9);
        assert_eq!(density("2440"), Ok(2440.0));
        let code = |text| density(text).unwrap_err().code;
        assert_eq!(code("heavy"), "not-a-number");
        assert_eq!(code("1 stone/m^3"), "unknown-unit");
        assert_eq!(code("1 kg/m^2"), "dimension-mismatch");
    }

    #[test]
    fn units_multiply() {
        let (dimension, scale) = unit_product("kJ/mm^2").unwrap();
        assert_eq!(dimension.unit(), "J/m^2");
        assert!((scale - 1e9).abs() < 1e-3);
        assert!(unit_product("furlong").is_none());
    }
}
