//! The library of potentials, part of the program.

/// A potential of the library.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    /// The name under which scenes use it.
    pub(crate) name: &'static str,
    /// The whole file.
    pub(crate) text: &'static str,
}

macro_rules! entries {
    ($($name:literal),* $(,)?) => {
        &[$(Entry {
            name: $name,
            text: include_str!(concat!("../potentials/", $name, ".piola")),
        }),*]
    };
}

/// Every file of `potentials/`, in alphabetical order.
pub(crate) const LIBRARY: &[Entry] = entries![
    "fibre_reinforced",
    "firooz2023",
    "fung",
    "hencky",
    "javili2020",
    "linear_peridynamic_solid",
    "logarithmic",
    "miranda_modified_stretch",
    "mooney_rivlin",
    "neo_hooke",
    "neo_hooke_stable",
    "ogden",
    "silling2000",
    "st_venant_kirchhoff",
    "yeoh",
];

/// The text of a potential of the library.
pub(crate) fn find(name: &str) -> Option<&'static str> {
    LIBRARY.iter().find(|entry| entry.name == name).map(|entry| entry.text)
}

/// All names.
pub(crate) fn names() -> Vec<&'static str> {
    LIBRARY.iter().map(|entry| entry.name).collect()
}

#[cfg(test)]
mod tests {
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
}
