//! A potential on arrays.

use std::path::PathBuf;

use numpy::{IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use piola_compiler::{
    Batch, Form, GradientBatch, Kernel, Kind, Level, Measure, Mode, Model, Order, Outputs, Setting,
    Values, check_text_with,
};
use piola_grammar::names::entry;
use piola_runtime::scene::files_below;
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::error;

/// Names of the potentials that come with piola, and the text of each.
#[pyfunction]
pub(crate) fn library() -> Vec<(&'static str, &'static str)> {
    let names = piola::library::names().into_iter();
    names.filter_map(|name| Some((name, piola::library::find(name)?))).collect()
}

/// A checked potential with values of its parameters, compiled where it is first evaluated.
#[pyclass(frozen)]
pub(crate) struct Law {
    model: Model,
    values: Values,
    compiled: piola_compiler::Compiled,
}

/// psi and P.
type Stresses<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// The three columns that an evaluation gives.
type Columns<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl Law {
    /// `text` is called `name` in messages, its tables and imports stand below `folder`; `settings` are
    /// names of parameters with a number in the declared unit or a text with a unit.
    #[new]
    #[pyo3(signature = (name, text, folder, settings, dimension=None, delta=None))]
    fn new(
        py: Python<'_>,
        name: &str,
        text: &str,
        folder: PathBuf,
        settings: Vec<(String, Either)>,
        dimension: Option<usize>,
        delta: Option<f64>,
    ) -> PyResult<Law> {
        let (_, model) = check_text_with(text, &files_below(&folder))
            .map_err(|found| error::in_text(name, text, &found))?;
        let settings: Vec<(String, Setting)> =
            settings.into_iter().flat_map(|(name, value)| value.settings(&name)).collect();
        let largest = model.dimensions().max().unwrap_or(3);
        let values = model.values(dimension.unwrap_or(largest), &settings, delta);
        let values = values.map_err(|found| {
            let of =
                |e: &piola_compiler::ValueError| format!("[{}] {}; {}", e.code, e.message, e.help);
            error::plain(found.iter().map(of).collect::<Vec<String>>().join("\n"))
        })?;
        let kinds = [Kind::Measures, Kind::Gradient];
        let mode = Mode::Jit(Level::Fast);
        let compiled = py
            .detach(|| model.compile_only(&kinds, &values, mode, Form::Accurate))
            .map_err(|failed| error::plain(failed.to_string()))?;
        Ok(Law { model, values, compiled })
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        self.model.name()
    }

    /// 2 or 3.
    #[getter]
    fn dimension(&self) -> usize {
        self.values.dimension
    }

    /// What its energies are of: `l`, `a`, `v`, `F` and others.
    #[getter]
    fn arguments(&self) -> Vec<String> {
        self.model.arguments().into_iter().map(String::from).collect()
    }

    /// Its parameters: name, value in SI units, unit as declared.
    #[getter]
    fn parameters(&self) -> Vec<(String, f64, Option<String>)> {
        let all = self.model.parameters().iter().zip(&self.values.parameters);
        all.map(|(p, value)| (p.name.clone(), *value, p.unit.clone())).collect()
    }

    /// psi and its first two derivatives by a measure, element by element; `rest` has as many elements or
    /// one.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        measure: &str,
        now: PyReadonlyArray1<'py, f64>,
        rest: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Columns<'py>> {
        let measure = Measure::ALL
            .into_iter()
            .find(|known| known.symbol() == measure)
            .ok_or_else(|| error::plain(format!("there is no measure `{measure}`: l, a, v")))?;
        let (now, rest) = (now.as_slice()?, rest.as_slice()?);
        let n = now.len();
        if rest.len() != n && rest.len() != 1 {
            let message = format!("{n} measures and {} at rest: as many, or one", rest.len());
            return Err(error::plain(message));
        }
        if let Some(wrong) = rest.iter().find(|x| !(x.is_finite() && **x > 0.0)) {
            let message = format!("a measure at rest is finite and greater than 0, not {wrong}");
            return Err(error::plain(message));
        }
        let kernel = self.compiled.kernels.iter().find(|kernel| kernel.measure() == measure);
        let Some(kernel) = kernel.filter(|kernel| kernel.fields().is_empty()) else {
            let symbol = measure.symbol();
            if self.model.arguments().contains(&symbol) && kernel.is_none() {
                // A coefficient that is 0: so is the energy.
                let zeros = || vec![0.0; n].into_pyarray(py);
                return Ok((zeros(), zeros(), zeros()));
            }
            let message = format!(
                "`{}` has no psi({symbol}) of a length alone; it has energies of {}",
                self.model.name(),
                self.model.arguments().join(", ")
            );
            return Err(error::plain(message));
        };
        // Arrays of NumPy's own memory, which asks the system for large pages.
        let all = [(); 3].map(|()| PyArray1::<f64>::zeros(py, n, false));
        {
            let [mut psi, mut dpsi, mut d2psi] = all.each_ref().map(|array| array.readwrite());
            let out = Outputs {
                psi: psi.as_slice_mut()?,
                dpsi: dpsi.as_slice_mut()?,
                d2psi: d2psi.as_slice_mut()?,
            };
            py.detach(|| evaluate(kernel, now, rest, out));
        }
        let [psi, dpsi, d2psi] = all;
        Ok((psi, dpsi, d2psi))
    }

    /// psi and P of deformation gradients, `n x d x d` row by row.
    fn evaluate_gradient<'py>(
        &self,
        py: Python<'py>,
        gradients: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Stresses<'py>> {
        let dd = self.values.dimension * self.values.dimension;
        if !self.model.arguments().contains(&"F") {
            let message = format!(
                "`{}` has no psi(F); it has energies of {}",
                self.model.name(),
                self.model.arguments().join(", ")
            );
            return Err(error::plain(message));
        }
        if gradients.len() % dd != 0 {
            return Err(error::plain(format!(
                "{} numbers are no whole gradients",
                gradients.len()
            )));
        }
        let rows = gradients.as_slice()?;
        let n = rows.len() / dd;
        let (psi, stress) = py.detach(|| {
            let (mut psi, mut columns) = (vec![0.0; n], vec![0.0; n * dd]);
            if let Some(kernel) = &self.compiled.gradient {
                let d = self.values.dimension;
                let rest = |k: usize| if k / d == k % d { 1.0 } else { 0.0 };
                let column = |k: usize| rows.iter().skip(k).step_by(dd).copied();
                let gradient: Vec<f64> = (0..dd).flat_map(column).collect();
                let change: Vec<f64> =
                    (0..dd).flat_map(|k| column(k).map(move |f| f - rest(k))).collect();
                let at = GradientBatch { n, gradient: &gradient, change: &change, fields: &[] };
                kernel.evaluate(at, &mut psi, &mut columns);
            }
            let by_rows = (0..n).flat_map(|p| (0..dd).map(move |k| (p, k)));
            let stress: Vec<f64> = by_rows.map(|(p, k)| columns[k * n + p]).collect();
            (psi, stress)
        });
        Ok((psi.into_pyarray(py), stress.into_pyarray(py)))
    }
}

/// So many elements are evaluated at once: what is made for them stays near the processor.
const CHUNK: usize = 512;

/// psi, psi' and psi'' on all threads; `rest` has as many elements as `now`, or one.
fn evaluate(kernel: &Kernel, now: &[f64], rest: &[f64], out: Outputs<'_>) {
    let Outputs { psi, dpsi, d2psi } = out;
    let columns =
        (psi.par_chunks_mut(CHUNK), dpsi.par_chunks_mut(CHUNK), d2psi.par_chunks_mut(CHUNK));
    let chunks = now.par_chunks(CHUNK).zip(columns.0).zip(columns.1).zip(columns.2).enumerate();
    let alone = if let [alone] = rest { Some(*alone) } else { None };
    let room = || ([alone.unwrap_or(1.0); CHUNK], [0.0; CHUNK]);
    chunks.for_each_init(room, |(reference, change), (place, (((measure, psi), dpsi), d2psi))| {
        let (reference, change) = (&mut reference[..measure.len()], &mut change[..measure.len()]);
        if alone.is_none() {
            reference.copy_from_slice(&rest[place * CHUNK..][..measure.len()]);
        }
        let each = measure.iter().zip(&*reference).zip(&mut *change);
        each.for_each(|((l, rest), change)| *change = (l - rest) / rest);
        let batch = Batch { measure, reference, change, fields: &[] };
        kernel.evaluate(batch, Order::Tangent, Outputs { psi, dpsi, d2psi });
    });
}

/// A number, a text with a unit, or those of a vector.
#[derive(FromPyObject)]
pub(crate) enum Either {
    Number(f64),
    Text(String),
    Several(Vec<Either>),
}

impl Either {
    /// What a parameter is set to; of a vector each entry.
    fn settings(self, name: &str) -> Vec<(String, Setting)> {
        match self {
            Either::Number(number) => vec![(name.to_string(), Setting::Number(number))],
            Either::Text(text) => vec![(name.to_string(), Setting::Text(text))],
            Either::Several(all) => {
                let each = all.into_iter().zip(1..);
                each.flat_map(|(one, k)| one.settings(&entry(name, k))).collect()
            }
        }
    }
}
