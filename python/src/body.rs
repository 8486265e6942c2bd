//! The body of a scene: its energy and what derives from it, on arrays in the user's order of points.

use std::path::Path;

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use piola_runtime::case::{Case, Library};
use piola_runtime::energy::{Energy as _, NonFinite, Total};
use piola_runtime::matrix::BlockMatrix;
use pyo3::prelude::*;

use crate::error;

/// A case and its energy, at the parameters of t = 0.
#[pyclass(frozen)]
pub(crate) struct Body {
    case: Case,
    energy: Total<'static>,
}

/// Reads a scene with overrides `KEY=VALUE`.
pub(crate) fn read(scene: &str, overrides: &[String]) -> PyResult<Case> {
    let names = piola::library::names();
    let library = Library { find: &piola::library::find, names: &names };
    Case::read(Path::new(scene), overrides, &library).map_err(|found| error::of_case(&found))
}

/// An array of numbers.
type Vector<'py> = Bound<'py, PyArray1<f64>>;

/// Energies by part in J, and dE/du in N.
type Evaluated<'py> = (Vec<(String, f64)>, Vector<'py>);

/// A matrix in compressed rows: values, columns, where each row begins.
type Rows<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>);

#[pymethods]
impl Body {
    #[new]
    fn new(py: Python<'_>, scene: &str, overrides: Vec<String>) -> PyResult<Body> {
        py.detach(|| {
            let case = read(scene, &overrides)?;
            let made = case.check_rest().and_then(|()| case.energy(case.compile()?));
            let energy = made.map_err(|found| error::of_case(&found))?;
            Ok(Body { case, energy })
        })
    }

    /// 2 or 3.
    #[getter]
    fn dimension(&self) -> usize {
        self.case.body.dimension()
    }

    /// Positions at rest in m, point by point.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let body = &self.case.body;
        body.to_user_order(body.positions(), body.dimension()).into_pyarray(py)
    }

    /// Volumes in m^d.
    #[getter]
    fn volumes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.case.body.to_user_order(self.case.body.volumes(), 1).into_pyarray(py)
    }

    /// How many bonds, triangles and tetrahedra there are.
    #[getter]
    fn interactions(&self) -> (u64, u64, u64) {
        let report = self.energy.report();
        (report.bonds, report.triangles, report.tetrahedra)
    }

    /// Energies by part in J, and dE/du in N.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        displacement: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Evaluated<'py>> {
        let u = self.inside(displacement.as_slice()?)?;
        let mut gradient = vec![0.0; u.len()];
        let parts = py.detach(|| self.energy.forces(&u, &mut gradient));
        let parts = parts.map_err(|found| self.describe(&found))?;
        let parts = parts.iter().map(|(name, value)| (name.to_string(), value)).collect();
        Ok((parts, self.outside(&gradient).into_pyarray(py)))
    }

    /// d2E/du2 in N/m, both triangles.
    fn tangent<'py>(
        &self,
        py: Python<'py>,
        displacement: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Rows<'py>> {
        let u = self.inside(displacement.as_slice()?)?;
        let d = self.case.body.dimension();
        let rows = py.detach(|| {
            let mut gradient = vec![0.0; u.len()];
            let mut tangent = BlockMatrix::zeros(self.energy.pattern());
            self.energy.tangent(&u, &mut gradient, &mut tangent)?;
            let order = self.case.body.user_index();
            let user = |dof: usize| d * order[dof / d] as usize + dof % d;
            let mut entries: Vec<(usize, usize, f64)> =
                tangent.entries().map(|(r, c, value)| (user(r), user(c), value)).collect();
            entries.sort_unstable_by_key(|entry| (entry.0, entry.1));
            Ok(entries)
        });
        let entries: Vec<(usize, usize, f64)> =
            rows.map_err(|found: NonFinite| self.describe(&found))?;
        let mut starts = vec![0_i64; u.len() + 1];
        entries.iter().for_each(|entry| starts[entry.0 + 1] += 1);
        (0..u.len()).for_each(|row| starts[row + 1] += starts[row]);
        let values: Vec<f64> = entries.iter().map(|entry| entry.2).collect();
        let columns: Vec<i64> = entries.iter().map(|entry| entry.1 as i64).collect();
        Ok((values.into_pyarray(py), columns.into_pyarray(py), starts.into_pyarray(py)))
    }

    /// d2E/du2 times each of the vectors, one behind the other.
    fn products<'py>(
        &self,
        py: Python<'py>,
        displacement: PyReadonlyArray1<'py, f64>,
        vectors: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let u = self.inside(displacement.as_slice()?)?;
        let vectors: Vec<Vec<f64>> = vectors
            .as_slice()?
            .chunks(u.len().max(1))
            .map(|vector| self.inside(vector))
            .collect::<PyResult<_>>()?;
        let products = py.detach(|| {
            let hessian = self.energy.hessian(&u)?;
            let product = |vector: &Vec<f64>| {
                let mut product = vec![0.0; u.len()];
                hessian.multiply(vector, &mut product);
                self.outside(&product)
            };
            Ok(vectors.iter().flat_map(product).collect::<Vec<f64>>())
        });
        let products = products.map_err(|found: NonFinite| self.describe(&found))?;
        Ok(products.into_pyarray(py))
    }
}

impl Body {
    /// A vector in the body's order.
    fn inside(&self, vector: &[f64]) -> PyResult<Vec<f64>> {
        let body = &self.case.body;
        let (n, d) = (body.n_points(), body.dimension());
        if vector.len() != n * d {
            let message = format!(
                "{} numbers for {n} points in {d} dimensions: {} are wanted",
                vector.len(),
                n * d
            );
            return Err(error::plain(message));
        }
        Ok(body.from_user_order(vector, d))
    }

    fn outside(&self, vector: &[f64]) -> Vec<f64> {
        self.case.body.to_user_order(vector, self.case.body.dimension())
    }

    fn describe(&self, found: &NonFinite) -> PyErr {
        error::plain(self.case.describe(found))
    }
}
