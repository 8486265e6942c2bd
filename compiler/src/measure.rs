//! What an energy can be a function of.

/// A measure of deformation of one interaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Measure {
    /// `l`: length of a bond, one-neighbour interaction, in m.
    Length,
    /// `a`: area measure of a triangle, two-neighbour interaction, `|xi1 x xi2|` in m^2.
    Area,
    /// `v`: volume measure of a tetrahedron, three-neighbour interaction, in m^3.
    Volume,
}

impl Measure {
    /// All measures, in the order of their number of neighbours.
    pub const ALL: [Measure; 3] = [Measure::Length, Measure::Area, Measure::Volume];

    /// As written in `psi(..)`.
    pub fn symbol(self) -> &'static str {
        match self {
            Measure::Length => "l",
            Measure::Area => "a",
            Measure::Volume => "v",
        }
    }

    /// How many points the interaction joins: 2, 3 or 4.
    pub fn points(self) -> usize {
        match self {
            Measure::Length => 2,
            Measure::Area => 3,
            Measure::Volume => 4,
        }
    }

    /// Dimension of the measure: m, m^2, m^3.
    pub fn length_exponent(self) -> i64 {
        self.points() as i64 - 1
    }

    /// Whether it can change its sign in this many dimensions: volumes, and areas in the plane. All
    /// others are roots: lengths, and areas in space.
    pub fn is_signed(self, dimension: usize) -> bool {
        self.points() == dimension + 1
    }

    /// The measure with this symbol.
    pub fn from_symbol(symbol: &str) -> Option<Measure> {
        Measure::ALL.into_iter().find(|m| m.symbol() == symbol)
    }

    /// The interaction it belongs to: "bond", "triangle", "tetrahedron".
    pub fn interaction(self) -> &'static str {
        match self {
            Measure::Length => "bond",
            Measure::Area => "triangle",
            Measure::Volume => "tetrahedron",
        }
    }

    /// What it is of an interaction: `length`.
    pub fn quantity(self) -> &'static str {
        match self {
            Measure::Length => "length",
            Measure::Area => "area",
            Measure::Volume => "volume",
        }
    }

    /// The same of many: "bonds", "triangles", "tetrahedra".
    pub fn interactions(self) -> &'static str {
        match self {
            Measure::Length => "bonds",
            Measure::Area => "triangles",
            Measure::Volume => "tetrahedra",
        }
    }

    /// Its value at rest, as written.
    pub fn reference_symbol(self) -> &'static str {
        match self {
            Measure::Length => "L",
            Measure::Area => "A",
            Measure::Volume => "V",
        }
    }
}

/// What an energy is a function of, where measures and deformation gradients are treated alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Argument {
    /// A measure of an interaction.
    Measure(Measure),
    /// `m^2/M` of a measure `m`, for energies in which it has even powers alone.
    Square(Measure),
    /// The deformation gradient `F` of a place.
    Gradient,
}

impl Argument {
    /// As written in `psi(..)`; a square as made of the measure.
    pub fn symbol(self) -> &'static str {
        match self {
            Argument::Measure(measure) => measure.symbol(),
            Argument::Square(Measure::Length) => "l^2/L",
            Argument::Square(Measure::Area) => "a^2/A",
            Argument::Square(Measure::Volume) => "v^2/V",
            Argument::Gradient => "F",
        }
    }

    /// The energy and what it is differentiated to.
    pub fn orders(self) -> [&'static str; 3] {
        match self {
            Argument::Measure(_) | Argument::Square(_) => ["psi", "psi'", "psi''"],
            Argument::Gradient => ["psi", "P", "dP"],
        }
    }
}
