//! What breaks, and what it leaves behind.

/// What bonds leave behind that break, or that remember something else.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Release {
    /// How many bonds broke.
    pub bonds: usize,
    /// How many triangles and tetrahedra broke by criteria of their own.
    pub cliques: [usize; 2],
    /// The energy that they held, in J, with that of triangles and tetrahedra that went with their edges.
    pub energy: f64,
    /// How many others changed what they remember.
    pub changed: usize,
    /// The energy in J that these lost by it.
    pub dissipated: f64,
    /// The work in J that the forces which went would have done over the second half of the way that led
    /// here: half of their power with the displacements of that way.
    pub timing: f64,
}

impl Release {
    /// Of so many bonds that break, without energy so far.
    pub(crate) fn of(bonds: usize) -> Release {
        Release { bonds, ..Release::default() }
    }

    /// Adds that of other bonds.
    pub fn add(&mut self, other: Release) {
        self.bonds += other.bonds;
        self.cliques.iter_mut().zip(other.cliques).for_each(|(all, own)| *all += own);
        self.energy += other.energy;
        self.changed += other.changed;
        self.dissipated += other.dissipated;
        self.timing += other.timing;
    }

    /// The same with all that a bond held.
    pub(crate) fn and_all_of(self, held: &Held) -> Release {
        Release { energy: self.energy + held.energy, timing: self.timing + held.timing, ..self }
    }

    /// Whether anything broke.
    pub fn breaks(&self) -> bool {
        self.bonds > 0 || self.cliques != [0; 2]
    }

    /// Whether energy and forces are others than before.
    pub fn has_changed(&self) -> bool {
        self.breaks() || self.changed > 0
    }
}

/// What a bond holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Held {
    /// Its energy in J.
    pub energy: f64,
    /// The work in J of its forces over the second half of a way; see [`Release::timing`].
    pub timing: f64,
}

impl Held {
    /// What both hold.
    pub(crate) fn and(self, other: &Held) -> Held {
        Held { energy: self.energy + other.energy, timing: self.timing + other.timing }
    }

    /// What one holds more than another.
    pub(crate) fn less(&self, other: &Held) -> Held {
        Held { energy: self.energy - other.energy, timing: self.timing - other.timing }
    }
}

/// Bonds, triangles and tetrahedra of a body by their numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Interactions {
    /// Bonds, ascending.
    pub bonds: Vec<usize>,
    /// Triangles, and tetrahedra, by their [`Ranks`](crate::interaction::Ranks), ascending: those that break by criteria of their own.
    pub cliques: [Vec<usize>; 2],
}

impl Interactions {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.bonds.is_empty() && self.cliques.iter().all(Vec::is_empty)
    }
}
