//! The CSV tables of a run.
//!
//! Numbers are the shortest decimals that read back as the same `f64` ([`decimal`]); numbers that
//! are not finite are written `inf`, `-inf`, `nan`. Every table has a header, also without rows.

use super::fracture::FractureTable;
use super::motion::BROKEN_CLIQUES;
use super::{Broken, History, OutputError, OutputFile, OutputFolder, Points, decimal};

/// Names of reference coordinates in tables.
const COORDINATES: [&str; 3] = ["X", "Y", "Z"];
/// Names of displacement components in tables.
pub(super) const COMPONENTS: [&str; 3] = ["u", "v", "w"];
/// Suffixes of the components of a reaction.
pub(super) const AXES: [&str; 3] = ["x", "y", "z"];

/// The header of `displacement.csv`: `X,Y[,Z],u,v[,w]` in m, one row per point in the user's order.
fn displacement_header(d: usize) -> String {
    let names = COORDINATES[..d].iter().chain(&COMPONENTS[..d]).map(|name| name.to_string());
    Table::new(names).text
}

/// Rows of it, of points at `positions`; both are `n x d`, in m.
fn displacement_rows(d: usize, positions: &[f64], displacement: &[f64]) -> String {
    let mut table = Table { text: String::new() };
    for (position, u) in positions.chunks_exact(d).zip(displacement.chunks_exact(d)) {
        table.row(position.iter().chain(u));
    }
    table.text
}

/// `reactions.csv`: `t`, then for every set its reaction in N by component: `left_x,left_y`.
pub fn reactions_table(history: &History) -> String {
    let mut table = Table::new(time_and(&history.sets, &AXES[..history.dimension]));
    for step in &history.steps {
        table.row([&step.t].into_iter().chain(step.reactions.iter().flatten()));
    }
    table.text
}

/// `force_displacement.csv`: `t`, then for every set its mean displacement in m and the force on it in N, which
/// is its reaction and the loads on it: `left_u,left_v,left_x,left_y`. The body at rest comes first.
pub fn force_table(history: &History) -> String {
    let d = history.dimension;
    let suffixes: Vec<&str> = COMPONENTS[..d].iter().chain(&AXES[..d]).copied().collect();
    let mut table = Table::new(time_and(&history.sets, &suffixes));
    let mut row = |t: &f64, moved: &[Vec<f64>], forces: &[Vec<f64>]| {
        let sets = moved.iter().zip(forces);
        let values: Vec<f64> = sets.flat_map(|(u, force)| u.iter().chain(force)).copied().collect();
        table.row([t].into_iter().chain(&values));
    };
    if let Some(at_rest) = &history.at_rest {
        row(&0.0, &vec![vec![0.0; d]; history.sets.len()], &at_rest.forces);
    }
    for step in &history.steps {
        row(&step.t, &step.moved, &step.forces);
    }
    table.text
}

/// Columns of what broke, behind those of the energies.
const BROKEN: [&str; 7] =
    ["released", "dissipated", "relaxed", "external", "prescribed", "quadrature", "broken_bonds"];

/// `energy.csv`: `t,total`, then every part of the energy by its name, `psi(l)`; in J. Of a body that breaks
/// the account of energy behind that, `released` to `quadrature`, how many bonds are broken, and how many
/// triangles and tetrahedra broke by criteria of their own where they have any.
pub fn energy_table(history: &History) -> String {
    let first = ["t", "total"].map(str::to_owned).into_iter();
    let first_broken = history.steps.iter().find_map(|step| step.broken);
    let has_cliques =
        first_broken.map_or([false; 2], |first| first.all_cliques.map(|n| n.is_some()));
    let cliques = BROKEN_CLIQUES.iter().zip(has_cliques).filter(|(_, has)| *has);
    let bonds = BROKEN.iter().filter(|_| first_broken.is_some());
    let broken = bonds.chain(cliques.map(|(name, _)| name)).map(|name| (*name).to_owned());
    let mut table = Table::new(first.chain(history.parts.iter().cloned()).chain(broken));
    for step in &history.steps {
        let values = history.parts.iter().map(|part| step.energy_parts.of(part));
        let mut row: Vec<f64> =
            [step.t, step.energy_parts.total()].into_iter().chain(values).collect();
        if let Some(broken) = step.broken {
            let Broken { released, dissipated, relaxed, external, prescribed, .. } = broken;
            row.extend([released, dissipated, relaxed, external, prescribed]);
            row.extend([broken.quadrature, broken.all as f64]);
            row.extend(broken.all_cliques.into_iter().flatten().map(|n| n as f64));
        }
        table.row(&row);
    }
    table.text
}

/// `probes.csv`: `t`, then for every probe its displacement in m: `tip_u,tip_v`.
pub fn probes_table(history: &History) -> String {
    let mut table = Table::new(time_and(&history.probes, &COMPONENTS[..history.dimension]));
    for step in &history.steps {
        table.row([&step.t].into_iter().chain(step.probes.iter().flatten()));
    }
    table.text
}

/// `fracture.csv` of load steps.
pub fn fracture_table(fracture: &FractureTable) -> String {
    let mut table = Table::new(fracture.columns.header());
    for row in &fracture.rows {
        table.row(&fracture.columns.numbers(row));
    }
    table.text
}

/// Writes `reactions.csv`, `force_displacement.csv`, `energy.csv` and `probes.csv`, and `fracture.csv` of a body
/// that can break; they are small enough to be replaced after every step.
pub fn write_history(folder: &OutputFolder, history: &History) -> Result<(), OutputError> {
    folder.write(OutputFile::Reactions, reactions_table(history).as_bytes())?;
    folder.write(OutputFile::Forces, force_table(history).as_bytes())?;
    folder.write(OutputFile::Energy, energy_table(history).as_bytes())?;
    if let Some(fracture) = &history.fracture {
        folder.write(OutputFile::Fracture, fracture_table(fracture).as_bytes())?;
    }
    folder.write(OutputFile::Probes, probes_table(history).as_bytes())
}

/// Points whose rows are text at once.
const ROWS_AT_ONCE: usize = 1 << 12;

/// Writes `displacement.csv`.
pub fn write_displacement(
    folder: &OutputFolder,
    points: &Points,
    displacement: &[f64],
) -> Result<(), OutputError> {
    let d = points.dimension;
    let parts = points.positions.chunks(ROWS_AT_ONCE * d);
    let mut parts = parts.zip(displacement.chunks(ROWS_AT_ONCE * d));
    write_displacement_of(folder, d, || parts.next())
}

/// The same of points that come part by part, in the user's order: positions and displacements of the next ones, until
/// there are none.
pub fn write_displacement_of<P: AsRef<[f64]>>(
    folder: &OutputFolder,
    d: usize,
    mut next: impl FnMut() -> Option<(P, P)>,
) -> Result<(), OutputError> {
    folder.write_with(OutputFile::Displacement, |out| {
        out.write_all(displacement_header(d).as_bytes())?;
        while let Some((positions, displacement)) = next() {
            let rows = displacement_rows(d, positions.as_ref(), displacement.as_ref());
            out.write_all(rows.as_bytes())?;
        }
        Ok(())
    })
}

/// `t`, then every name with every suffix.
pub(super) fn time_and(names: &[String], suffixes: &[&str]) -> Vec<String> {
    let columns =
        names.iter().flat_map(|name| suffixes.iter().map(move |suffix| format!("{name}_{suffix}")));
    ["t".to_owned()].into_iter().chain(columns).collect()
}

/// Lines of comma-separated fields.
struct Table {
    text: String,
}

impl Table {
    fn new(header: impl IntoIterator<Item = String>) -> Table {
        let header: Vec<String> = header.into_iter().map(|name| quoted(&name)).collect();
        Table { text: header.join(",") + "\n" }
    }

    fn row<'a>(&mut self, values: impl IntoIterator<Item = &'a f64>) {
        for (index, &value) in values.into_iter().enumerate() {
            if index > 0 {
                self.text.push(',');
            }
            self.text.push_str(&decimal(value));
        }
        self.text.push('\n');
    }
}

/// A field in quotes if it needs them (RFC 4180): names of sets and probes are the user's.
pub(super) fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::read::read_displacement;
    use crate::{Definiteness, StepRecord};
    use piola_mechanics::energy::EnergyParts;
    use piola_mechanics::interaction::Inverted;

    fn history() -> History {
        let sets = vec!["left".to_owned(), "a,\"b".to_owned()];
        let parts = ["psi(l)", "psi(l, m)"].map(str::to_owned).to_vec();
        let names: Arc<[String]> = parts.clone().into();
        let mut history = History::new(2, parts, sets, vec!["tip".to_owned()]);
        history.push(StepRecord {
            t: 0.1,
            iterations: 2,
            residual: vec![1.0, 1e-3, 1e-9],
            residual_over_reaction: vec![0.5, 5e-4, 5e-10],
            energy_parts: EnergyParts::new(&names, vec![0.5, 0.25]),
            reactions: vec![vec![-1.5, 0.1 + 0.2], vec![f64::NAN, f64::NEG_INFINITY]],
            forces: vec![vec![-1.5, 2.0], vec![3.0, 4.0]],
            moved: vec![vec![0.0, 0.5], vec![0.25, -1.0]],
            probes: vec![vec![1e-7, -0.0]],
            definiteness: Definiteness { positive_definite: None, method: "none".to_owned() },
            condition: None,
            inverted: Inverted::default(),
            broken: None,
        });
        history
    }

    #[test]
    fn tables_have_the_columns_of_the_contract() {
        let history = history();
        assert_eq!(
            reactions_table(&history),
            "t,left_x,left_y,\"a,\"\"b_x\",\"a,\"\"b_y\"\n\
             0.1,-1.5,0.30000000000000004,nan,-inf\n"
        );
        assert_eq!(energy_table(&history), "t,total,psi(l),\"psi(l, m)\"\n0.1,0.75,0.5,0.25\n");
        assert_eq!(probes_table(&history), "t,tip_u,tip_v\n0.1,1e-7,-0\n");
        let empty = History::new(3, Vec::new(), vec!["s".to_owned()], Vec::new());
        assert_eq!(reactions_table(&empty), "t,s_x,s_y,s_z\n");
        assert_eq!(probes_table(&empty), "t\n");
    }

    #[test]
    fn displacements_are_written_in_order_and_read_back_bit_for_bit() {
        for dimension in [2, 3] {
            let n = 5;
            let numbers = |seed: f64| -> Vec<f64> {
                (0..n * dimension).map(|i| (i as f64 + seed).sqrt() / 3.0 * 1e-3).collect()
            };
            let points = Points {
                dimension,
                positions: numbers(2.0),
                volumes: vec![1.0; n],
                spacing: None,
                mesh: None,
                held: Vec::new(),
            };
            let displacement = numbers(7.0);
            let folder = tempfile::tempdir().unwrap();
            let folder = OutputFolder::create(folder.path(), false).unwrap();
            write_displacement(&folder, &points, &displacement).unwrap();
            let file = folder.path_of(OutputFile::Displacement);
            let text = std::fs::read_to_string(file).unwrap();
            let header = if dimension == 2 { "X,Y,u,v" } else { "X,Y,Z,u,v,w" };
            assert_eq!(text.lines().next(), Some(header));
            assert_eq!(text.lines().count(), n + 1);
            let read = read_displacement(&text, dimension, n).unwrap();
            assert_eq!(read, displacement);
        }
    }
}
