//! The files of the collection.

use std::path::Path;

/// What energies are functions of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Bonds,
    Areas,
    Volumes,
    Gradients,
    Gathered,
}

impl Kind {
    pub(crate) const ALL: [Kind; 5] =
        [Kind::Bonds, Kind::Areas, Kind::Volumes, Kind::Gradients, Kind::Gathered];

    /// Its folder.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Kind::Bonds => "bonds",
            Kind::Areas => "areas",
            Kind::Volumes => "volumes",
            Kind::Gradients => "gradients",
            Kind::Gathered => "gathered",
        }
    }
}

/// One energy.
pub(crate) struct Law {
    pub(crate) name: String,
    pub(crate) kind: Kind,
    pub(crate) text: String,
    /// Sets of parameters under which it is tried, beside the defaults; the first is empty.
    pub(crate) values: Vec<(String, Vec<(String, f64)>)>,
}

/// What a line begins with that has other values than the defaults.
const ALSO: &str = "# Also with ";

/// Every law, kind by kind, by name.
pub(crate) fn collection() -> Vec<Law> {
    Kind::ALL.into_iter().flat_map(of_kind).collect()
}

fn of_kind(kind: Kind) -> Vec<Law> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/laws").join(kind.name());
    let entries = std::fs::read_dir(folder).unwrap();
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let law = |path: &std::path::PathBuf| {
        let text = std::fs::read_to_string(path).unwrap();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        assert!(text.starts_with(&format!("potential {name} ")), "{name} is called as its file");
        assert!(text.contains("\nsource \""), "{name} has a source");
        let mut values = vec![(String::new(), Vec::new())];
        for with in text.lines().filter_map(|line| line.strip_prefix(ALSO)) {
            let with = with.trim_end_matches('.');
            let setting = |part: &str| {
                let (name, value) = part.split_once(" = ").unwrap();
                (name.trim().to_string(), value.parse().unwrap())
            };
            values.push((with.to_string(), with.split(',').map(setting).collect()));
        }
        Law { name, kind, text, values }
    };
    paths.iter().map(law).collect()
}
