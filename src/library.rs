//! The library of potentials, part of the program.

use clap::ValueEnum;

/// What a potential is for: as `piola info` lists the library.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Kind {
    /// Bonds alone
    Bond,
    /// Lengths, areas, volumes and angles
    Clique,
    /// Families of points, by gathered states
    State,
    /// Solids, by the deformation gradient
    Solid,
    /// Rubber, by the deformation gradient
    Rubber,
    /// Foam, by the deformation gradient
    Foam,
    /// Soft tissue and fibres, by the deformation gradient
    Tissue,
}

impl Kind {
    /// The word that is typed.
    pub(crate) fn word(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_string())
    }

    /// What it says of itself.
    pub(crate) fn title(self) -> String {
        let help = self.to_possible_value().and_then(|value| value.get_help().cloned());
        help.unwrap_or_default().to_string()
    }
}

/// A potential of the library.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    /// The name under which scenes use it.
    pub(crate) name: &'static str,
    /// What it is for.
    pub(crate) kind: Kind,
    /// The whole file.
    pub(crate) text: &'static str,
}

macro_rules! entries {
    ($($name:literal is $kind:ident),* $(,)?) => {
        &[$(Entry {
            name: $name,
            kind: Kind::$kind,
            text: include_str!(concat!("../potentials/", $name, ".piola")),
        }),*]
    };
}

/// Every file of `potentials/`, in alphabetical order.
pub(crate) const LIBRARY: &[Entry] = entries![
    "arruda_boyce" is Rubber,
    "bilinear_softening" is Bond,
    "blatz_ko" is Foam,
    "exponential_softening" is Bond,
    "exponentiated_hencky" is Solid,
    "fatigue" is Bond,
    "fibre_bonds" is Bond,
    "fibre_reinforced" is Tissue,
    "firooz2023" is Clique,
    "fung" is Tissue,
    "gasser_ogden_holzapfel" is Tissue,
    "gent" is Rubber,
    "guccione" is Tissue,
    "harmonic_angles" is Clique,
    "hencky" is Solid,
    "hyperfoam" is Foam,
    "javili2020" is Clique,
    "javili2020_brittle" is Clique,
    "kelvin_voigt" is Bond,
    "lennard_jones" is Bond,
    "linear_peridynamic_solid" is State,
    "linear_peridynamic_solid_brittle" is State,
    "logarithmic" is Clique,
    "logarithmic_states" is State,
    "lopez_pamies" is Rubber,
    "micro_plastic" is Bond,
    "miranda_modified_stretch" is Bond,
    "miranda_modified_stretch_brittle" is Bond,
    "mooney_rivlin" is Rubber,
    "morse" is Bond,
    "neo_hooke" is Solid,
    "neo_hooke_stable" is Solid,
    "ogden" is Rubber,
    "prototype_microelastic_brittle" is Bond,
    "silling2000" is Bond,
    "st_venant_kirchhoff" is Solid,
    "st_venant_kirchhoff_brittle" is Solid,
    "standard_linear_solid" is Bond,
    "tension_only" is Bond,
    "yeoh" is Rubber,
];

/// The text of a potential of the library.
pub fn find(name: &str) -> Option<&'static str> {
    LIBRARY.iter().find(|entry| entry.name == name).map(|entry| entry.text)
}

/// All names.
pub fn names() -> Vec<&'static str> {
    LIBRARY.iter().map(|entry| entry.name).collect()
}

#[cfg(test)]
mod tests {
    use super::LIBRARY;

    #[test]
    fn every_file_is_listed() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/potentials");
        let mut files: Vec<String> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter_map(|name| name.strip_suffix(".piola").map(str::to_string))
            .collect();
        files.sort();
        assert_eq!(files, super::names());
    }

    #[test]
    fn the_page_gives_every_kind() {
        let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/library.md"));
        let page = page.unwrap();
        for entry in LIBRARY {
            let (name, kind) = (entry.name, entry.kind.word());
            let row = format!("\n| [{name}](#{name}) | {kind} | ");
            assert!(page.contains(&row), "docs/library.md has no row {row}");
        }
        assert_eq!(page.matches("](#").count(), LIBRARY.len(), "one row each");
    }
}
