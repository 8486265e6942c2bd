//! `summary.json`: everything about a run that fits a page.
//!
//! Numbers are written as the shortest decimals that read back as the same `f64`; JSON has no
//! infinities, so numbers that are not finite become the strings `"inf"`, `"-inf"`, `"nan"`,
//! never a silent `null`.

use std::time::Instant;

use piola_mechanics::interaction::Inverted;
use serde::ser::{SerializeMap, SerializeSeq};
use serde::{Serialize, Serializer};

use super::motion::MotionSummary;
use super::{History, OutputError, OutputFile, OutputFolder, StepRecord};

/// The summary of a run; the names of the fields are the names in the file.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Program and format versions: [`versions`] and what the caller adds.
    #[serde(serialize_with = "as_map")]
    pub versions: Vec<(String, String)>,
    /// The scene's name and the energies of its body, as the headline of its picture has them.
    pub title: String,
    /// [`scene_hash`] of what was run.
    pub scene_hash: String,
    /// Why the run ended.
    pub exit_reason: ExitReason,
    /// The reason in words, for instance the solver's message; empty if there is nothing to add.
    pub exit_message: String,
    /// 2 or 3.
    pub dimension: usize,
    /// How many points the body has.
    pub points: usize,
    /// The spacing in m where they are a lattice, else `null`.
    pub spacing: Option<Number>,
    /// Where the probes are.
    pub probes: Vec<ProbeSummary>,
    /// Interactions that the energy sums over.
    pub interactions: InteractionCounts,
    /// Degenerate interactions that were left out: collinear triangles, coplanar tetrahedra.
    pub dropped: InteractionCounts,
    /// What the user was warned of.
    pub warnings: Vec<String>,
    /// How the equations of load steps were solved.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub solver: Option<SolverSummary>,
    /// How a body moved, and what its account of energy says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionSummary>,
    /// Threads that worked.
    pub threads: usize,
    /// Wall time of the run in s.
    pub wall_seconds: Number,
    /// Wall time and memory by phase, in order.
    pub phases: Vec<Phase>,
    /// Largest memory of the process in bytes; `null` where the system does not tell.
    pub peak_memory_bytes: Option<u64>,
    /// Where the memory numbers come from.
    pub memory_source: &'static str,
    /// The converged steps.
    pub steps: Vec<StepSummary>,
}

impl Summary {
    /// The file's text: indented JSON.
    pub fn to_json(&self) -> String {
        let mut json = serde_json::to_string_pretty(self)
            .expect("every key is a string and every number is finite or a string");
        json.push('\n');
        json
    }

    /// Writes `summary.json`.
    pub fn write(&self, folder: &OutputFolder) -> Result<(), OutputError> {
        folder.write(OutputFile::Summary, self.to_json().as_bytes())
    }
}

/// A probe: the point next to a place.
#[derive(Clone, Debug, Serialize)]
pub struct ProbeSummary {
    /// Its name.
    pub name: String,
    /// The place that the scene names, in m.
    pub at: Vec<Number>,
    /// The point at rest, in m.
    pub point: Vec<Number>,
}

/// How the equations of a run were solved.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SolverSummary {
    /// The method for linear systems, in words.
    pub linear: String,
    /// Why this one.
    pub linear_reason: String,
    /// The preconditioner of conjugate gradients; `null` where none was made.
    pub preconditioner: Option<String>,
    /// Iterations of conjugate gradients and minimum residuals for the converged steps.
    pub linear_iterations: usize,
    /// Linear systems solved.
    pub linear_solves: usize,
    /// Factorisations tried, those that judge an equilibrium included.
    pub factorizations: usize,
    /// How often energy, forces and tangent were assembled.
    pub tangents: usize,
    /// How often energy and forces alone were.
    pub gradients: usize,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ExitReason {
    /// All steps converged.
    Completed,
    /// A step did not converge after all cut-backs.
    NotConverged,
    /// An energy or one of its derivatives is not a finite number.
    NonFinite,
    /// Parts of the body came loose, and the scene says that the run ends there.
    CameLoose,
    /// Breaking left families too small, and the scene says that the run ends there.
    Singular,
    /// The user stopped the run.
    Interrupted,
    /// Something else went wrong; the message says what.
    Failed,
}

/// Numbers of interactions by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct InteractionCounts {
    /// Unordered bonds.
    pub bonds: usize,
    /// Unordered triangles.
    pub triangles: usize,
    /// Unordered tetrahedra.
    pub tetrahedra: usize,
}

/// One step as the file shows it; see [`StepRecord`] for units.
#[derive(Clone, Debug, Serialize)]
pub struct StepSummary {
    /// Load parameter at the end of the step.
    pub t: Number,
    /// Newton iterations.
    pub iterations: usize,
    /// 2-norms of the free components of the residual in N.
    pub residual: Vec<Number>,
    /// The same over the reaction.
    pub residual_over_reaction: Vec<Number>,
    /// Total energy in J.
    pub energy: Number,
    /// The energy in J by its parts, `psi(l)`.
    #[serde(serialize_with = "as_map")]
    pub energy_parts: Vec<(String, Number)>,
    /// Reaction of each set: `d` numbers in N.
    #[serde(serialize_with = "as_map")]
    pub reactions: Vec<(String, Vec<Number>)>,
    /// Whether the tangent at the equilibrium is positive definite; `null` if unknown.
    pub positive_definite: Option<bool>,
    /// How that is known.
    pub positive_definite_by: String,
    /// Estimated condition of the tangent on the free degrees of freedom; `null` if unknown.
    pub condition: Option<Number>,
    /// The relative error of the displacements that rounding implies: condition times 2^-53.
    pub displacement_error: Option<Number>,
    /// Interactions turned inside out.
    pub inverted: Inverted,
    /// How many bonds broke at this step, of a body that can break.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bonds_broke: Option<usize>,
    /// How many triangles broke at it by criteria of their own, where they have any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub areas_broke: Option<usize>,
    /// How many tetrahedra broke at it by criteria of their own, where they have any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volumes_broke: Option<usize>,
    /// In how many rounds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rounds: Option<usize>,
    /// How many bonds are broken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub broken_bonds: Option<usize>,
    /// How many triangles broke by criteria of their own, where they have any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub broken_areas: Option<usize>,
    /// How many tetrahedra broke by criteria of their own, where they have any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub broken_volumes: Option<usize>,
    /// What bonds held when they broke, since the start, in J.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub released: Option<Number>,
}

/// Unit roundoff of f64.
const ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// The steps of a history as the summary shows them.
pub fn step_summaries(history: &History) -> Vec<StepSummary> {
    history.steps.iter().map(|step| step_summary(&history.sets, step)).collect()
}

fn step_summary(sets: &[String], step: &StepRecord) -> StepSummary {
    let numbers = |values: &[f64]| values.iter().copied().map(Number).collect::<Vec<_>>();
    let parts = &step.energy_parts;
    let all_cliques = |kind: usize| step.broken.and_then(|broken| broken.all_cliques[kind]);
    let cliques_broke = |kind: usize| {
        let broken = step.broken?;
        broken.all_cliques[kind].map(|_| broken.cliques[kind])
    };
    StepSummary {
        t: Number(step.t),
        iterations: step.iterations,
        residual: numbers(&step.residual),
        residual_over_reaction: numbers(&step.residual_over_reaction),
        energy: Number(parts.total()),
        energy_parts: parts.iter().map(|(part, value)| (part.to_string(), Number(value))).collect(),
        reactions: sets.iter().cloned().zip(step.reactions.iter().map(|r| numbers(r))).collect(),
        positive_definite: step.definiteness.positive_definite,
        positive_definite_by: step.definiteness.method.clone(),
        condition: step.condition.map(Number),
        displacement_error: step.condition.map(|condition| Number(condition * ROUNDOFF)),
        inverted: step.inverted,
        bonds_broke: step.broken.map(|broken| broken.bonds),
        areas_broke: cliques_broke(0),
        volumes_broke: cliques_broke(1),
        rounds: step.broken.map(|broken| broken.rounds),
        broken_bonds: step.broken.map(|broken| broken.all),
        broken_areas: all_cliques(0),
        broken_volumes: all_cliques(1),
        released: step.broken.map(|broken| Number(broken.released)),
    }
}

/// A number in JSON: a number if finite, else `"inf"`, `"-inf"` or `"nan"`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number(pub f64);

impl Serialize for Number {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.0.is_finite() {
            serializer.serialize_f64(self.0)
        } else {
            serializer.serialize_str(&super::decimal(self.0))
        }
    }
}

/// Numbers in JSON, for `#[serde(serialize_with = ..)]` on a field of type `Vec<f64>`.
pub fn numbers<S: Serializer>(values: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
    let mut list = serializer.serialize_seq(Some(values.len()))?;
    for &value in values {
        list.serialize_element(&Number(value))?;
    }
    list.end()
}

/// Pairs as a JSON object in their order.
fn as_map<S: Serializer, V: Serialize>(
    pairs: &[(String, V)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(pairs.len()))?;
    for (key, value) in pairs {
        map.serialize_entry(key, value)?;
    }
    map.end()
}

/// The versions that every summary names: piola's own, and the machine's kind.
pub fn versions() -> Vec<(String, String)> {
    let platform = format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS);
    vec![
        ("piola".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("platform".to_owned(), platform),
    ]
}

/// Names what was run: FNV-1a (64 bits) of the resolved scene's UTF-8 text, a zero byte, and the
/// texts of the potentials, a zero byte between two, as `fnv1a64:` and 16 hexadecimal digits. What was read of
/// other files is another text, their [`fnv1a64`] for instance.
///
/// It tells runs apart and is no protection against someone who wants two runs to look alike.
/// FNV-1a: Fowler, Noll, Vo; offset basis 0xcbf29ce484222325, prime 0x100000001b3.
pub fn scene_hash<'a>(
    resolved_scene: &'a str,
    potentials: impl IntoIterator<Item = &'a str>,
) -> String {
    let scene = fnv1a64(FNV1A64_OF_NOTHING, resolved_scene.as_bytes());
    let hash = potentials
        .into_iter()
        .fold(scene, |hash, text| fnv1a64(fnv1a64(hash, &[0]), text.as_bytes()));
    format!("fnv1a64:{hash:016x}")
}

/// FNV-1a of no bytes.
pub const FNV1A64_OF_NOTHING: u64 = 0xcbf2_9ce4_8422_2325;

/// FNV-1a of the bytes behind those that it is known of.
pub fn fnv1a64(before: u64, bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(before, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

/// Time and memory of one phase of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Phase {
    /// For instance `neighborhood`, `compile`, `solve`, `output`.
    pub name: String,
    /// Wall time in s.
    pub wall_seconds: Number,
    /// Memory of the process at the end of the phase, in bytes.
    pub memory_bytes: Option<u64>,
    /// Largest memory of the process up to the end of the phase, in bytes.
    pub peak_memory_bytes: Option<u64>,
}

/// Where [`memory`] reads.
pub const MEMORY_SOURCE: &str =
    if cfg!(target_os = "linux") { "VmRSS and VmHWM of /proc/self/status" } else { "none" };

/// Measures phases; a phase entered several times is one line with the summed time.
#[derive(Debug)]
pub struct PhaseClock {
    start: Instant,
    running: Option<(String, Instant)>,
    phases: Vec<Phase>,
}

impl Default for PhaseClock {
    fn default() -> Self {
        PhaseClock::new()
    }
}

impl PhaseClock {
    /// Starts the clock of the whole run.
    pub fn new() -> PhaseClock {
        PhaseClock { start: Instant::now(), running: None, phases: Vec::new() }
    }

    /// Ends the phase that runs, if any, and starts this one.
    pub fn enter(&mut self, name: &str) {
        self.leave();
        self.running = Some((name.to_owned(), Instant::now()));
    }

    /// Ends the phase that runs, if any.
    pub fn leave(&mut self) {
        let Some((name, since)) = self.running.take() else { return };
        let seconds = since.elapsed().as_secs_f64();
        let memory = memory();
        let place = self.phases.iter().position(|phase| phase.name == name).unwrap_or_else(|| {
            self.phases.push(Phase {
                name,
                wall_seconds: Number(0.0),
                memory_bytes: None,
                peak_memory_bytes: None,
            });
            self.phases.len() - 1
        });
        let phase = &mut self.phases[place];
        phase.wall_seconds.0 += seconds;
        phase.memory_bytes = memory.map(|memory| memory.now);
        phase.peak_memory_bytes = memory.map(|memory| memory.peak);
    }

    /// The phases so far, without the one that runs.
    pub fn phases(&self) -> &[Phase] {
        &self.phases
    }

    /// Seconds since the clock was started.
    pub fn wall_seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}

/// Memory of this process in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// Resident now.
    pub now: u64,
    /// Largest so far.
    pub peak: u64,
}

/// Memory of this process from `/proc/self/status`; `None` on systems without it.
pub fn memory() -> Option<Memory> {
    // sysinfo knows the present size only, not the peak, so the kernel is asked directly.
    parse_status(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn parse_status(status: &str) -> Option<Memory> {
    let kibibytes = |name: &str| -> Option<u64> {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        line.trim().strip_suffix("kB")?.trim().parse().ok()
    };
    Some(Memory { now: kibibytes("VmRSS:")? * 1024, peak: kibibytes("VmHWM:")? * 1024 })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use serde_json::{Value, json};

    use super::*;
    use crate::Definiteness;
    use piola_mechanics::energy::EnergyParts;

    fn summary() -> Summary {
        let names: Arc<[String]> = ["psi(l)", "psi(a)", "psi(v)"].map(str::to_owned).into();
        let sets = vec!["right".to_owned(), "left".to_owned()];
        let mut history = History::new(2, names.to_vec(), sets, Vec::new());
        history.push(StepRecord {
            t: 0.04,
            iterations: 2,
            residual: vec![0.1 + 0.2, 1e-7, f64::NAN],
            residual_over_reaction: vec![f64::INFINITY, 1e-12, 0.0],
            energy_parts: EnergyParts::new(&names, vec![1.0, 0.5, 0.25]),
            reactions: vec![vec![1.0, -2.0], vec![f64::NEG_INFINITY, 1e300]],
            forces: vec![vec![0.0; 2]; 2],
            moved: vec![vec![0.0; 2]; 2],
            probes: Vec::new(),
            definiteness: Definiteness {
                positive_definite: Some(true),
                method: "cholesky".to_owned(),
            },
            condition: Some(1.0 / ROUNDOFF),
            inverted: Inverted { triangles: 3, tetrahedra: 0 },
            broken: None,
        });
        Summary {
            versions: versions(),
            title: "bar: psi(l) of rubber".to_owned(),
            scene_hash: scene_hash("a", ["b"]),
            exit_reason: ExitReason::NotConverged,
            exit_message: "step 2 did not converge".to_owned(),
            dimension: 2,
            points: 441,
            spacing: Some(Number(0.05)),
            probes: Vec::new(),
            interactions: InteractionCounts { bonds: 3, triangles: 2, tetrahedra: 0 },
            dropped: InteractionCounts::default(),
            warnings: vec!["a set boundary is close to points".to_owned()],
            solver: Some(SolverSummary {
                linear: "Cholesky".to_owned(),
                ..SolverSummary::default()
            }),
            motion: None,
            threads: 2,
            wall_seconds: Number(0.5),
            phases: Vec::new(),
            peak_memory_bytes: None,
            memory_source: MEMORY_SOURCE,
            steps: step_summaries(&history),
        }
    }

    #[test]
    fn the_json_has_the_fields_of_the_contract() {
        let text = summary().to_json();
        let json: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["versions"]["piola"], env!("CARGO_PKG_VERSION"));
        assert_eq!(json["exit_reason"], "not_converged");
        assert_eq!(json["points"], 441);
        assert_eq!(json["interactions"], json!({"bonds": 3, "triangles": 2, "tetrahedra": 0}));
        assert_eq!(json["peak_memory_bytes"], Value::Null);
        assert_eq!(json["solver"]["linear"], "Cholesky");
        assert_eq!(json["solver"]["preconditioner"], Value::Null);
        let expected = json!({
            "t": 0.04,
            "iterations": 2,
            "residual": [0.30000000000000004, 1e-7, "nan"],
            "residual_over_reaction": ["inf", 1e-12, 0.0],
            "energy": 1.75,
            "energy_parts": {"psi(l)": 1.0, "psi(a)": 0.5, "psi(v)": 0.25},
            "reactions": {"right": [1.0, -2.0], "left": ["-inf", 1e300]},
            "positive_definite": true,
            "positive_definite_by": "cholesky",
            "condition": 9007199254740992.0,
            "displacement_error": 1.0,
            "inverted": {"triangles": 3, "tetrahedra": 0},
        });
        assert_eq!(json["steps"], json!([expected]));
        assert!(text.contains("0.30000000000000004"), "{text}");
        let (right, left) = (text.find("\"right\"").unwrap(), text.find("\"left\"").unwrap());
        assert!(right < left, "sets keep the scene's order");
    }

    #[test]
    fn the_hash_is_fnv1a_and_separates_its_parts() {
        // Published test vectors of FNV-1a, 64 bits.
        let of = |text: &str| fnv1a64(FNV1A64_OF_NOTHING, text.as_bytes());
        assert_eq!(of(""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(of("a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(of("foobar"), 0x8594_4171_f739_67e8);
        assert_ne!(scene_hash("ab", ["c"]), scene_hash("a", ["bc"]));
        assert!(scene_hash("", [""]).starts_with("fnv1a64:"));
        assert_eq!(scene_hash("x", ["y"]).len(), 8 + 16);
    }

    #[test]
    fn memory_is_read_in_bytes() {
        let status = "Name:\tpiola\nVmHWM:\t    2048 kB\nVmRSS:\t    1024 kB\n";
        assert_eq!(parse_status(status), Some(Memory { now: 1 << 20, peak: 2 << 20 }));
        assert_eq!(parse_status("VmRSS: 12 kB"), None);
        assert_eq!(parse_status("VmHWM: x kB\nVmRSS: 1 kB"), None);
        #[cfg(target_os = "linux")]
        {
            // Other tests of this process take and free memory at the same time.
            let held = vec![1u8; 64 << 20];
            let found = memory().unwrap();
            assert!(held.iter().step_by(4096).all(|&byte| byte == 1));
            assert!(found.now >= 48 << 20 && found.peak >= found.now, "{found:?}");
        }
    }

    #[test]
    fn phases_add_up_and_keep_their_order() {
        let mut clock = PhaseClock::new();
        for name in ["neighborhood", "solve", "output", "solve"] {
            clock.enter(name);
            std::thread::sleep(std::time::Duration::from_millis(4));
        }
        clock.leave();
        let names: Vec<&str> = clock.phases().iter().map(|phase| phase.name.as_str()).collect();
        assert_eq!(names, ["neighborhood", "solve", "output"]);
        let seconds: Vec<f64> = clock.phases().iter().map(|phase| phase.wall_seconds.0).collect();
        assert!(seconds[1] >= 0.008, "{seconds:?}");
        assert!(seconds.iter().sum::<f64>() <= clock.wall_seconds());
    }
}
