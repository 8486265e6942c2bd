//! The text of the potential that a scene names.

use std::path::{Component, Path, PathBuf};

use piola_grammar::Diagnostic;
use piola_mechanics::surface::Weighting;
use piola_mechanics::weights::Weights;
use piola_mechanics::words::Words;

use super::{Horizon, Interface, InterfaceRule, Material, Scene, SceneReport};
use piola_grammar::suggest;

/// A potential file may have this many bytes.
const MAX_POTENTIAL_BYTES: u64 = 1 << 20;

/// A potential's text and where it comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PotentialText {
    /// The path as the scene writes it, or the name in the library.
    pub name: String,
    /// The file, unless it comes from the library.
    pub path: Option<PathBuf>,
    /// The whole text.
    pub text: String,
}

impl PotentialText {
    /// Where it is, for who is shown a place in it: its path, or the name in the library.
    pub fn place(&self) -> String {
        self.path.as_ref().map_or_else(|| self.name.clone(), |path| path.display().to_string())
    }
}

/// What may be meant by a path at which there is no file, as a help.
pub fn meant(path: &Path) -> Option<String> {
    let scene = path.join("scene.toml");
    if path.is_dir() {
        return scene.is_file().then(|| format!("name the scene in it: {}", scene.display()));
    }
    if path.exists() {
        return None;
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let entries = std::fs::read_dir(folder.unwrap_or(Path::new("."))).ok()?;
    let mut names: Vec<String> =
        entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).collect();
    // A folder lists its files in any order.
    names.sort_unstable();
    let near = suggest(path.file_name()?.to_str()?, names.iter().map(String::as_str))?;
    Some(format!("did you mean {}?", path.with_file_name(near).display()))
}

impl Scene {
    /// How many laws there are: one of each material, then those of interfaces.
    pub fn n_laws(&self) -> usize {
        self.materials.iter().map(|material| material.law + 1).max().unwrap_or(1)
    }

    /// What a law belongs to: the name of a material, or of two with an interface of its own.
    pub fn law_name(&self, law: usize) -> String {
        let name = |material: usize| self.regions.get(material).map_or("", |r| &r.name.value);
        let own = |interface: &&Interface| interface.rule == InterfaceRule::Potential(law);
        match self.interfaces.iter().find(own) {
            Some(Interface { between: [one, other], .. }) => {
                format!("{} and {}", name(one.value), name(other.value))
            }
            None => name(law).to_string(),
        }
    }

    /// The text of a potential of the scene: a file relative to `folder` if its name ends in `.piola`,
    /// else whatever `library` has under that name. `names` are offered where it has nothing.
    pub fn potential(
        &self,
        material: &Material,
        folder: &Path,
        library: &dyn Fn(&str) -> Option<&'static str>,
        names: &[&str],
    ) -> Result<PotentialText, SceneReport> {
        let potential = &material.potential;
        let name = potential.value.clone();
        if name.ends_with(".piola") {
            let path = folder.join(&name);
            return match read(&path) {
                Ok(text) => Ok(PotentialText { name, path: Some(path), text }),
                Err(reason) => {
                    let message = format!("cannot read the potential {}: {reason}", path.display());
                    let diagnostic = Diagnostic::error("unreadable-file", potential.span, message);
                    let near = meant(&path);
                    let diagnostic =
                        near.into_iter().fold(diagnostic, |found, help| found.help(help));
                    Err(self.report(vec![diagnostic]))
                }
            };
        }
        if let Some(text) = library(&name) {
            return Ok(PotentialText { name, path: None, text: text.into() });
        }
        let message = format!("the library has no potential `{name}`");
        let diagnostic = Diagnostic::error("unknown-potential", potential.span, message)
            .help(format!("a file beside the scene is written with its ending: {name}.piola"));
        Err(self.report(vec![match suggest(&name, names.iter().copied()) {
            Some(near) => diagnostic.label(format!("did you mean `{near}`?")),
            None if names.is_empty() => diagnostic,
            None => diagnostic.help(format!("the library has {}", names.join(", "))),
        }]))
    }

    /// Takes the weights that a potential asks for with `weights volumes`. Where the scene states
    /// others, those hold, and a warning says so.
    pub fn weigh_volumes(&mut self, potential: &str) -> Option<Diagnostic> {
        if self.horizon.weights == Weights::Volumes {
            return None;
        }
        let Some(span) = self.horizon.weights_span else {
            self.horizon.weigh_volumes();
            return None;
        };
        let weights = self.horizon.weights.word();
        let message = format!("{potential} is made for weights = \"volumes\", not \"{weights}\"");
        let warning = Diagnostic::warning("other-weights", span, message);
        Some(warning.label("energies and forces are those of another material").help(
            "write weights = \"volumes\", or leave the line out: the potential says what it needs",
        ))
    }
}

impl Horizon {
    /// How interactions are weighted, and bonds corrected.
    pub fn weighting(&self) -> Weighting {
        Weighting { weights: self.weights, surface: self.surface, volumes: self.volumes }
    }

    /// Takes products of volumes for weights, unless the scene states its own.
    pub(crate) fn weigh_volumes(&mut self) {
        if self.weights_span.is_none() {
            self.weights = Weights::Volumes;
        }
    }
}

/// Reads a file of bounded size; the reason of a failure is in words.
fn read(path: &Path) -> Result<String, String> {
    use std::io::Read;
    let file = std::fs::File::open(path).map_err(|error| error.to_string())?;
    let mut bytes = Vec::new();
    // One byte more than allowed shows that a file is too long, whatever its metadata say.
    let mut limited = file.take(MAX_POTENTIAL_BYTES + 1);
    limited.read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MAX_POTENTIAL_BYTES {
        return Err(format!("it has more than {MAX_POTENTIAL_BYTES} bytes"));
    }
    String::from_utf8(bytes).map_err(|_| "it is not UTF-8 text".into())
}

/// Gives the texts of files at or below a folder, as potentials there name them; the reason of a
/// failure is in words.
pub fn files_below(folder: &Path) -> impl Fn(&str) -> Result<String, String> + use<> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder }.to_path_buf();
    move |name| {
        let path = Path::new(name);
        let is_below = path.components().all(|part| matches!(part, Component::Normal(_)));
        let outside = || "it must lie at or below the folder of the potential".to_string();
        if !is_below {
            return Err(outside());
        }
        let real = |path: &Path| path.canonicalize().map_err(|error| error.to_string());
        let (root, file) = (real(&folder)?, real(&folder.join(path))?);
        if !file.starts_with(&root) {
            return Err(outside());
        }
        if !file.is_file() {
            return Err("it is not a file".into());
        }
        read(&file)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use piola_grammar::Severity;

    const LEAST: &str = "[body]\nbox = [[0, 0], [1, 1]]\nspacing = 0.05\n\
        [horizon]\nspacings = 3\n[material]\npotential = \"solid\"\n";

    fn read(text: &str) -> Scene {
        Scene::read(text, "scene.toml", &[]).unwrap_or_else(|report| panic!("{report}"))
    }

    #[test]
    fn files_are_read_at_or_below_the_folder_and_bounded() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("law/data")).unwrap();
        std::fs::write(at("law/data/a.csv"), "1, 2\n").unwrap();
        std::fs::write(at("secret.csv"), "1, 2\n").unwrap();
        std::fs::write(at("law/long.csv"), vec![b'1'; 2 << 20]).unwrap();
        let files = files_below(&at("law"));
        assert_eq!(files("data/a.csv").unwrap(), "1, 2\n");
        let absolute = at("secret.csv").display().to_string();
        for (name, reason) in [
            ("../secret.csv", "at or below"),
            (absolute.as_str(), "at or below"),
            ("data", "not a file"),
            ("long.csv", "more than 1048576 bytes"),
            ("b.csv", "No such file"),
        ] {
            let found = files(name).unwrap_err();
            assert!(found.contains(reason), "{name}: {found}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("secret.csv"), at("law/link.csv")).unwrap();
            assert!(files("link.csv").unwrap_err().contains("at or below"));
        }
    }

    #[test]
    fn a_potential_may_ask_for_products_of_volumes() {
        let mut silent = read(LEAST);
        assert_eq!(silent.weigh_volumes("solid"), None);
        assert_eq!(silent.horizon.weights, Weights::Volumes);
        assert!(silent.resolved_toml().contains("weights = \"volumes\""));
        let stating = |weights: &str| {
            read(&LEAST.replace("[horizon]\n", &format!("[horizon]\nweights = \"{weights}\"\n")))
        };
        assert_eq!(stating("volumes").weigh_volumes("solid"), None);
        let mut other = stating("uniform");
        let warning = other.weigh_volumes("solid").unwrap();
        assert_eq!((warning.code, warning.severity), ("other-weights", Severity::Warning));
        assert!(
            warning.message.contains("solid is made for weights = \"volumes\", not \"uniform\"")
        );
        // What the scene says holds.
        assert_eq!(other.horizon.weights, Weights::Uniform);
    }
}
