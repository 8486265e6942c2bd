//! `fracture.csv`: what broke, row by row, and where the tips of cracks are.

/// Names of what the table has columns for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FractureColumns {
    /// Whether triangles, and tetrahedra, can break by criteria of their own.
    pub cliques: [bool; 2],
    /// The tracks, in the scene's order.
    pub tracks: Vec<TrackColumns>,
}

/// What there is of a track.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackColumns {
    /// Its name.
    pub name: String,
    /// Whether there are speeds: of a motion.
    pub has_speed: bool,
    /// Whether the speed of Rayleigh waves is known.
    pub has_rayleigh: bool,
}

/// What is broken at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct FractureRow {
    /// The time in s, or the load parameter.
    pub t: f64,
    /// How many bonds broke since the row before, and how many are broken.
    pub bonds: [usize; 2],
    /// The same of triangles and tetrahedra by criteria of their own; nothing where they have none.
    pub cliques: [Option<[usize; 2]>; 2],
    /// The energy in J that all of them held when they broke.
    pub released: f64,
    /// As [`FractureColumns::tracks`].
    pub tracks: Vec<TrackRow>,
}

/// Where a tip is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackRow {
    /// Its coordinate at rest along the axis of the track in m; not a number before there is one.
    pub tip: f64,
    /// In m/s.
    pub speed: f64,
    /// The same over the speed of Rayleigh waves.
    pub over_rayleigh: f64,
    /// What was released over the new area of the crack, in J/m^2; not a number before it has grown.
    pub released_per_area: f64,
}

/// The table of load steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FractureTable {
    /// Its columns.
    pub columns: FractureColumns,
    /// One row per converged step.
    pub rows: Vec<FractureRow>,
}

/// Names of triangles and tetrahedra in columns.
const CLIQUES: [&str; 2] = ["areas", "volumes"];

impl FractureColumns {
    /// The names of all columns.
    pub(super) fn header(&self) -> Vec<String> {
        let kinds = |prefix: &str| {
            let cliques = CLIQUES.iter().zip(self.cliques).filter(|one| one.1);
            let all = std::iter::once("bonds").chain(cliques.map(|one| *one.0));
            all.map(|kind| format!("{prefix}_{kind}")).collect::<Vec<String>>()
        };
        let mut header = vec!["t".to_owned()];
        header.extend(kinds("new"));
        header.extend(kinds("broken"));
        header.push("released".to_owned());
        for TrackColumns { name, has_speed, has_rayleigh } in &self.tracks {
            header.push(format!("{name}_tip"));
            header.extend(has_speed.then(|| format!("{name}_speed")));
            header.extend(has_rayleigh.then(|| format!("{name}_speed_over_c_R")));
            header.push(format!("{name}_released_per_area"));
        }
        header
    }

    /// The numbers of a row, as the names are.
    pub(super) fn numbers(&self, row: &FractureRow) -> Vec<f64> {
        let kinds = |which: usize| {
            let cliques = row.cliques.iter().flatten().map(move |one| one[which]);
            std::iter::once(row.bonds[which]).chain(cliques).map(|n| n as f64)
        };
        let mut numbers: Vec<f64> =
            std::iter::once(row.t).chain(kinds(0)).chain(kinds(1)).collect();
        numbers.push(row.released);
        for (columns, track) in self.tracks.iter().zip(&row.tracks) {
            numbers.push(track.tip);
            numbers.extend(columns.has_speed.then_some(track.speed));
            numbers.extend(columns.has_rayleigh.then_some(track.over_rayleigh));
            numbers.push(track.released_per_area);
        }
        numbers
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_below_their_names() {
        let track = |name: &str, has_speed, has_rayleigh| TrackColumns {
            name: name.to_owned(),
            has_speed,
            has_rayleigh,
        };
        let columns = FractureColumns {
            cliques: [true, false],
            tracks: vec![track("a", true, true), track("b", false, false)],
        };
        let tip = |tip| TrackRow { tip, speed: 5.0, over_rayleigh: 0.5, released_per_area: 7.0 };
        let row = FractureRow {
            t: 0.5,
            bonds: [1, 10],
            cliques: [Some([2, 20]), None],
            released: 3.0,
            tracks: vec![tip(4.0), tip(6.0)],
        };
        let expected = [
            ("t", 0.5),
            ("new_bonds", 1.0),
            ("new_areas", 2.0),
            ("broken_bonds", 10.0),
            ("broken_areas", 20.0),
            ("released", 3.0),
            ("a_tip", 4.0),
            ("a_speed", 5.0),
            ("a_speed_over_c_R", 0.5),
            ("a_released_per_area", 7.0),
            ("b_tip", 6.0),
            ("b_released_per_area", 7.0),
        ];
        let (names, numbers) = (columns.header(), columns.numbers(&row));
        assert_eq!(names, expected.map(|one| one.0));
        assert_eq!(numbers, expected.map(|one| one.1));
    }
}
