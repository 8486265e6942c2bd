//! The tables of a body in motion, which grow by whole lines: a motion has too many rows for tables
//! that are replaced after every one.

use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::PathBuf;

use serde::Serialize;

use super::atomic::Operation;
use super::fracture::{FractureColumns, FractureRow};
use super::picture::Series;
use super::summary::Number;
use super::table::{AXES, COMPONENTS, quoted, time_and};
use super::{OutputError, OutputFile, OutputFolder, decimal};

/// Names of what the tables have columns for.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionColumns {
    /// 2 or 3.
    pub dimension: usize,
    /// The parts of the energy, `psi(l)`.
    pub parts: Vec<String>,
    /// The sets, in the scene's order.
    pub sets: Vec<String>,
    /// The probes, in the scene's order.
    pub probes: Vec<String>,
    /// Whether parameters of the energy change with time.
    pub parameters_change: bool,
    /// Whether bonds can break.
    pub breaks: bool,
    /// Whether triangles, and tetrahedra, can break by criteria of their own.
    pub breaks_cliques: [bool; 2],
    /// Whether they remember something that changes.
    pub remembers: bool,
    /// Of `fracture.csv`, where bonds can break.
    pub fracture: Option<FractureColumns>,
}

/// A body in motion at one time; energies and work are in J.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionRow {
    /// How many steps led here.
    pub step: usize,
    /// In s.
    pub t: f64,
    /// Kinetic energy.
    pub kinetic: f64,
    /// Kinetic energy between the velocities before and after, of free components.
    pub kinetic_leapfrog: f64,
    /// The stored energy by its parts.
    pub parts: Vec<f64>,
    /// What damping took.
    pub damping: f64,
    /// The work of loads.
    pub external: f64,
    /// The work of what is prescribed.
    pub prescribed: f64,
    /// The error of the integration.
    pub quadrature: f64,
    /// What does not close.
    pub rounding: f64,
    /// The work of changing parameters of the energy, where they change.
    pub parameters: Option<f64>,
    /// Of a body whose bonds can break.
    pub broken: Option<BrokenRow>,
    /// In kg m/s, one number per dimension.
    pub momentum: Vec<f64>,
    /// In kg m^2/s: one number in the plane, three in space.
    pub angular_momentum: Vec<f64>,
    /// Sum of `dE/du` minus the loads over each set, `d` numbers in N.
    pub reactions: Vec<Vec<f64>>,
    /// Displacement at each probe, `d` numbers in m.
    pub probes: Vec<Vec<f64>>,
    /// What broke, and where tips are, where bonds can break.
    pub fracture: Option<FractureRow>,
}

/// What bonds left that are broken, or remember something else.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrokenRow {
    /// How many.
    pub bonds: usize,
    /// How many triangles and tetrahedra broke by criteria of their own; nothing where they have none.
    pub cliques: [Option<usize>; 2],
    /// The energy that they held when they broke, in J.
    pub released: f64,
    /// The energy in J that bonds lost by what they came to remember; nothing where they remember nothing.
    pub dissipated: Option<f64>,
    /// The work that the forces which went would have done over the halves of steps before, in J.
    pub timing: f64,
    /// The energy in J that breaking and remembering added to the stored energy, where they did not take from it.
    pub created: f64,
}

/// Columns of triangles and tetrahedra that broke by criteria of their own.
pub(super) const BROKEN_CLIQUES: [&str; 2] = ["broken_areas", "broken_volumes"];

/// `motion.csv`, `reactions.csv` and `probes.csv` as they grow, and `fracture.csv` of a body that can break.
#[derive(Debug)]
pub struct MotionTables {
    motion: Lines,
    reactions: Lines,
    probes: Lines,
    fracture: Option<(FractureColumns, Lines)>,
}

impl MotionTables {
    /// Tables with a header and no rows.
    pub fn new(
        folder: &OutputFolder,
        columns: &MotionColumns,
    ) -> Result<MotionTables, OutputError> {
        let axes = &AXES[..columns.dimension];
        let turns = if columns.dimension == 2 { &AXES[2..] } else { &AXES };
        let mut names: Vec<String> =
            ["step", "t", "kinetic", "kinetic_leapfrog", "stored"].map(str::to_owned).to_vec();
        names.extend(columns.parts.iter().cloned());
        let work = ["damping", "external", "prescribed", "quadrature", "rounding"];
        names.extend(work.map(str::to_owned));
        names.extend(columns.parameters_change.then(|| "parameters".to_owned()));
        if columns.breaks {
            names.push("released".to_owned());
            names.extend(columns.remembers.then(|| "dissipated".to_owned()));
            names.extend(["timing", "created", "broken_bonds"].map(str::to_owned));
            let cliques = columns.breaks_cliques.into_iter().zip(BROKEN_CLIQUES);
            names.extend(cliques.filter(|one| one.0).map(|one| one.1.to_owned()));
        }
        names.extend(axes.iter().map(|axis| format!("momentum_{axis}")));
        names.extend(turns.iter().map(|axis| format!("angular_momentum_{axis}")));
        let probes = time_and(&columns.probes, &COMPONENTS[..columns.dimension]);
        Ok(MotionTables {
            motion: Lines::new(folder, OutputFile::Motion, names)?,
            reactions: Lines::new(folder, OutputFile::Reactions, time_and(&columns.sets, axes))?,
            probes: Lines::new(folder, OutputFile::Probes, probes)?,
            fracture: match &columns.fracture {
                Some(columns) => {
                    let lines = Lines::new(folder, OutputFile::Fracture, columns.header())?;
                    Some((columns.clone(), lines))
                }
                None => None,
            },
        })
    }

    /// The tables of an earlier run, cut to these lengths in bytes.
    ///
    /// # Errors
    /// Tables that are shorter, or gone.
    pub fn resume(
        folder: &OutputFolder,
        columns: &MotionColumns,
        lengths: &[u64],
    ) -> Result<MotionTables, OutputError> {
        let mut files = vec![OutputFile::Motion, OutputFile::Reactions, OutputFile::Probes];
        files.extend(columns.fracture.as_ref().map(|_| OutputFile::Fracture));
        // Nothing is cut unless all are there.
        for (file, expected) in files.iter().zip(lengths.iter().copied()) {
            let path = folder.path_of(*file);
            let found = fs::metadata(&path).map_or(0, |metadata| metadata.len());
            if found < expected {
                return Err(OutputError::Table { path, found, expected });
            }
        }
        let mut lines = files.iter().zip(lengths).map(|(file, length)| {
            let path = folder.path_of(*file);
            Lines::resume(path, *length)
        });
        let mut next = || {
            let path = folder.path_of(OutputFile::Checkpoint);
            lines.next().ok_or(OutputError::Checkpoint { path })?
        };
        Ok(MotionTables {
            motion: next()?,
            reactions: next()?,
            probes: next()?,
            fracture: match &columns.fracture {
                Some(columns) => Some((columns.clone(), next()?)),
                None => None,
            },
        })
    }

    /// Energies in J and displacements at probes in m, against time in s, as the tables in the folder have
    /// them: also those of an earlier part of the run.
    ///
    /// # Errors
    /// Tables that cannot be read.
    pub fn series(
        folder: &OutputFolder,
        columns: &MotionColumns,
    ) -> Result<[Vec<Series>; 2], OutputError> {
        let stored = 4;
        let work = stored + columns.parts.len() + 1;
        let mut named = vec![
            ("kinetic", 2),
            ("stored", stored),
            ("damping", work),
            ("external", work + 1),
            ("prescribed", work + 2),
        ];
        if columns.breaks {
            named.push(("released", work + 5 + usize::from(columns.parameters_change)));
        }
        if columns.parameters_change {
            named.push(("parameters", work + 5));
        }
        let named = named.into_iter().map(|(name, place)| (name.to_owned(), place));
        let is_there = |one: &Series| one.points.iter().any(|point| point.1 != 0.0);
        let energies = read_series(folder, OutputFile::Motion, 1, named)?;
        let probes = time_and(&columns.probes, &COMPONENTS[..columns.dimension]);
        let named = probes.into_iter().zip(0..).skip(1);
        let probes = read_series(folder, OutputFile::Probes, 0, named)?;
        Ok([energies.into_iter().filter(is_there).collect(), probes])
    }

    /// How long the tables are, in bytes.
    pub fn lengths(&self) -> Vec<u64> {
        self.all().map(|lines| lines.length).collect()
    }

    fn all(&self) -> impl Iterator<Item = &Lines> {
        let fracture = self.fracture.iter().map(|(_, lines)| lines);
        [&self.motion, &self.reactions, &self.probes].into_iter().chain(fracture)
    }

    /// Returns when the tables would survive a power cut.
    pub fn synchronise(&self) -> Result<(), OutputError> {
        for lines in self.all() {
            lines.file.sync_data().map_err(Operation::Write.on(&lines.path))?;
        }
        Ok(())
    }

    /// A line at the end of each table.
    pub fn push(&mut self, row: &MotionRow) -> Result<(), OutputError> {
        let stored = row.parts.iter().fold(0.0, |sum, part| sum + part);
        let first = [row.step as f64, row.t, row.kinetic, row.kinetic_leapfrog, stored];
        let work = [row.damping, row.external, row.prescribed, row.quadrature, row.rounding];
        let broken = row.broken.map(|row| {
            let cliques = row.cliques.map(|n| n.map(|n| n as f64));
            (row.released, row.dissipated, [row.timing, row.created, row.bonds as f64], cliques)
        });
        let broken = broken.iter().flat_map(|(released, dissipated, others, cliques)| {
            let cliques = cliques.iter().flatten();
            std::iter::once(released).chain(dissipated).chain(others).chain(cliques)
        });
        let work = work.iter().chain(&row.parameters);
        let all = first.iter().chain(&row.parts).chain(work).chain(broken);
        self.motion.push(all.chain(&row.momentum).chain(&row.angular_momentum))?;
        let t = || [&row.t].into_iter();
        self.reactions.push(t().chain(row.reactions.iter().flatten()))?;
        self.probes.push(t().chain(row.probes.iter().flatten()))?;
        match (&mut self.fracture, &row.fracture) {
            (Some((columns, lines)), Some(row)) => lines.push(columns.numbers(row).iter()),
            _ => Ok(()),
        }
    }
}

/// Columns of a table in the folder, with names, against the one that has the time.
fn read_series(
    folder: &OutputFolder,
    file: OutputFile,
    time: usize,
    columns: impl Iterator<Item = (String, usize)>,
) -> Result<Vec<Series>, OutputError> {
    let path = folder.path_of(file);
    let text = fs::read_to_string(&path).map_err(Operation::Read.on(&path))?;
    let number = |field: &str| field.parse().unwrap_or(f64::NAN);
    let rows: Vec<Vec<f64>> =
        text.lines().skip(1).map(|line| line.split(',').map(number).collect()).collect();
    let at = |row: &[f64], place: usize| row.get(place).copied().unwrap_or(f64::NAN);
    let series = |(name, place)| {
        let points = rows.iter().map(|row| (at(row, time), at(row, place))).collect();
        Series { name, points }
    };
    Ok(columns.map(series).collect())
}

/// A file of lines: each is there as a whole or not yet.
#[derive(Debug)]
struct Lines {
    path: PathBuf,
    file: File,
    /// In bytes.
    length: u64,
}

impl Lines {
    fn new(
        folder: &OutputFolder,
        file: OutputFile,
        header: Vec<String>,
    ) -> Result<Lines, OutputError> {
        let header: Vec<String> = header.iter().map(|name| quoted(name)).collect();
        let header = header.join(",") + "\n";
        folder.write(file, header.as_bytes())?;
        Lines::resume(folder.path_of(file), header.len() as u64)
    }

    fn resume(path: PathBuf, length: u64) -> Result<Lines, OutputError> {
        let file = OpenOptions::new().append(true).open(&path);
        let file = file.map_err(Operation::Write.on(&path))?;
        let found = file.metadata().map_err(Operation::Read.on(&path))?.len();
        if found < length {
            return Err(OutputError::Table { path, found, expected: length });
        }
        file.set_len(length).map_err(Operation::Write.on(&path))?;
        Ok(Lines { path, file, length })
    }

    fn push<'a>(&mut self, values: impl Iterator<Item = &'a f64>) -> Result<(), OutputError> {
        let values: Vec<String> = values.map(|value| decimal(*value)).collect();
        let line = values.join(",") + "\n";
        // One call: whoever reads, or ends the process, sees the line or does not. A full disk may take a
        // part of it, which goes again.
        self.file.write_all(line.as_bytes()).map_err(|error| {
            let _ = self.file.set_len(self.length);
            Operation::Write.on(&self.path)(error)
        })?;
        self.length += line.len() as u64;
        Ok(())
    }
}

/// What `summary.json` says of a motion.
#[derive(Clone, Debug, Serialize)]
pub struct MotionSummary {
    /// The rule of integration.
    pub method: String,
    /// The step in s.
    pub step_seconds: Number,
    /// The critical step at the start in s; `null` where the body has no stiffness there.
    pub critical_step_seconds: Option<Number>,
    /// The smallest critical step that was found on the way, in s.
    pub least_critical_step_seconds: Option<Number>,
    /// How many steps there are, and how many were made.
    pub steps: usize,
    /// How many were made.
    pub steps_made: usize,
    /// The step of the checkpoint that the run went on from; `null` where it went from the start.
    pub resumed_at_step: Option<usize>,
    /// The time that was reached, in s.
    pub t: Number,
    /// The mass of the body in kg.
    pub mass: Number,
    /// Energies at that time, and work up to there, in J.
    pub energies: MotionEnergies,
    /// The largest of `rounding` in `motion.csv`, over the largest of its energies.
    pub rounding: Number,
}

/// Energies and work in J.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct MotionEnergies {
    /// Kinetic energy.
    pub kinetic: Number,
    /// Stored energy.
    pub stored: Number,
    /// What damping took.
    pub damping: Number,
    /// The work of loads.
    pub external: Number,
    /// The work of what is prescribed.
    pub prescribed: Number,
    /// The error of the integration.
    pub quadrature: Number,
    /// The work of changing parameters of the energy; nothing where they do not change.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameters: Option<Number>,
    /// What broken bonds held; nothing where none can break.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub released: Option<Number>,
    /// What bonds lost by what they remember; nothing where they remember nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dissipated: Option<Number>,
    /// The energy that breaking and remembering created, where bonds can break.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub created: Option<Number>,
    /// How many bonds are broken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub broken_bonds: Option<usize>,
    /// How many triangles broke by criteria of their own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub broken_areas: Option<usize>,
    /// How many tetrahedra did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub broken_volumes: Option<usize>,
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn lines_are_appended_whole() {
        let dir = tempfile::tempdir().unwrap();
        let folder = OutputFolder::create(dir.path(), false).unwrap();
        let columns = MotionColumns {
            dimension: 2,
            parts: vec!["psi(l)".to_owned(), "psi(l, m)".to_owned()],
            sets: vec!["left".to_owned()],
            probes: vec!["tip".to_owned()],
            parameters_change: true,
            breaks: true,
            breaks_cliques: [true, false],
            remembers: false,
            fracture: Some(FractureColumns::default()),
        };
        let mut tables = MotionTables::new(&folder, &columns).unwrap();
        let row = MotionRow {
            step: 12,
            t: 1e-6,
            kinetic: 0.5,
            kinetic_leapfrog: 0.25,
            parts: vec![1.0, 2.0],
            damping: 0.0,
            external: 4.0,
            prescribed: f64::NAN,
            quadrature: -1e-9,
            rounding: 1e-17,
            parameters: Some(-2.5),
            broken: Some(BrokenRow {
                bonds: 7,
                cliques: [Some(11), None],
                released: 0.25,
                dissipated: None,
                timing: -0.5,
                created: 0.125,
            }),
            momentum: vec![7.0, 8.0],
            angular_momentum: vec![9.0],
            reactions: vec![vec![1.0, -1.0]],
            probes: vec![vec![0.1, 0.2]],
            fracture: Some(FractureRow {
                t: 1e-6,
                bonds: [3, 7],
                cliques: [None, None],
                released: 0.25,
                tracks: Vec::new(),
            }),
        };
        tables.push(&row).unwrap();
        let read = |file| fs::read_to_string(folder.path_of(file)).unwrap();
        let first = read(OutputFile::Motion);
        assert_eq!(
            first,
            "step,t,kinetic,kinetic_leapfrog,stored,psi(l),\"psi(l, m)\",damping,external,\
             prescribed,quadrature,rounding,parameters,released,timing,created,broken_bonds,broken_areas,momentum_x,\
             momentum_y,angular_momentum_z\n\
             12,1e-6,0.5,0.25,3,1,2,0,4,nan,-1e-9,1e-17,-2.5,0.25,-0.5,0.125,7,11,7,8,9\n"
        );
        tables.push(&row).unwrap();
        let lines: Vec<String> = first.lines().map(str::to_owned).collect();
        assert_eq!(read(OutputFile::Motion), first + &lines[1] + "\n");
        assert_eq!(read(OutputFile::Reactions), "t,left_x,left_y\n1e-6,1,-1\n1e-6,1,-1\n");
        assert_eq!(read(OutputFile::Probes), "t,tip_u,tip_v\n1e-6,0.1,0.2\n1e-6,0.1,0.2\n");
        let [energies, probes] = MotionTables::series(&folder, &columns).unwrap();
        let names = |all: &[Series]| all.iter().map(|one| one.name.clone()).collect::<Vec<_>>();
        let there = ["kinetic", "stored", "external", "prescribed", "released", "parameters"];
        assert_eq!(names(&energies), there);
        assert_eq!([4, 5].map(|k| energies[k].points[1].1), [0.25, -2.5]);
        assert_eq!(energies[1].points, [(1e-6, 3.0); 2]);
        assert_eq!(names(&probes), ["tip_u", "tip_v"]);
        assert_eq!(probes[1].points, [(1e-6, 0.2); 2]);
    }
}
