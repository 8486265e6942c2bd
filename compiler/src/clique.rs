//! Parts of triangles and tetrahedra, which energies of several measures hold beside the whole.

use crate::expression::Input;
use crate::measure::Measure;

/// A measure of a part of a triangle or a tetrahedron. Numbers count from 0, names from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Part {
    /// `l1` .. `l6`: the length of an edge, in m; of a triangle there are three.
    Edge(u8),
    /// `a1` .. `a4`: the area measure of a face of a tetrahedron, in m^2.
    Face(u8),
    /// The angle at a corner of a triangle, in radian; energies are written with that at the first,
    /// `angle`.
    Angle(u8),
    /// A component of `xi - Xi`: how far one end of a bond has moved against the other, in m.
    Moved(u8),
}

/// The ends of the edges of a triangle, and of a tetrahedron: those at the first point come first.
const EDGES_OF_TRIANGLES: [[u8; 2]; 3] = [[0, 1], [0, 2], [1, 2]];
const EDGES_OF_TETRAHEDRA: [[u8; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// The points of the faces of a tetrahedron: face `k` does not hold the end of edge `k`, the last one
/// not the first point.
const FACES: [[u8; 3]; 4] = [[0, 2, 3], [0, 1, 3], [0, 1, 2], [1, 2, 3]];

impl Part {
    /// The parts that energies may be written with.
    pub fn named() -> impl Iterator<Item = Part> {
        let (edges, faces) = ((0..6).map(Part::Edge), (0..4).map(Part::Face));
        edges.chain(faces).chain([Part::Angle(0)])
    }

    /// As written in `psi(..)`: `l1`, `a2`, `angle`.
    pub fn symbol(self) -> &'static str {
        match self {
            Part::Edge(k) => ["l1", "l2", "l3", "l4", "l5", "l6"][usize::from(k)],
            Part::Face(k) => ["a1", "a2", "a3", "a4"][usize::from(k)],
            Part::Angle(k) => ["angle", "angle2", "angle3"][usize::from(k)],
            Part::Moved(k) => {
                ["(xi(1) - Xi(1))", "(xi(2) - Xi(2))", "(xi(3) - Xi(3))"][usize::from(k)]
            }
        }
    }

    /// Its value at rest, as written: `L1`, `A2`, `Angle`.
    pub fn reference_symbol(self) -> &'static str {
        match self {
            Part::Edge(k) => ["L1", "L2", "L3", "L4", "L5", "L6"][usize::from(k)],
            Part::Face(k) => ["A1", "A2", "A3", "A4"][usize::from(k)],
            Part::Angle(k) => ["Angle", "Angle2", "Angle3"][usize::from(k)],
            Part::Moved(_) => "0",
        }
    }

    /// The part with this symbol.
    pub fn from_symbol(symbol: &str) -> Option<Part> {
        Part::named().find(|part| part.symbol() == symbol)
    }

    /// The part whose value at rest has this symbol.
    pub(crate) fn at_rest(symbol: &str) -> Option<Part> {
        Part::named().find(|part| part.reference_symbol() == symbol)
    }

    /// The dimension is this power of a length: 1, 2, or 0 of an angle.
    pub(crate) fn length_exponent(self) -> i64 {
        match self {
            Part::Edge(_) | Part::Moved(_) => 1,
            Part::Face(_) => 2,
            Part::Angle(_) => 0,
        }
    }

    /// Whether triangles, or tetrahedra, have it.
    pub(crate) fn is_of(self, clique: Measure) -> bool {
        match self {
            Part::Edge(k) => clique != Measure::Length && usize::from(k) < edges(clique).len(),
            Part::Moved(_) => clique == Measure::Length,
            Part::Face(_) => clique == Measure::Volume,
            Part::Angle(_) => clique == Measure::Area,
        }
    }

    /// What it becomes where the points of its triangle or tetrahedron take this order.
    pub(crate) fn reordered(self, clique: Measure, order: &[u8]) -> Part {
        let at = |point: u8| order[usize::from(point)];
        match self {
            Part::Edge(k) => {
                let mut ends = edges(clique)[usize::from(k)].map(at);
                ends.sort_unstable();
                Part::Edge(place(edges(clique), &ends))
            }
            Part::Face(k) => {
                let mut points = FACES[usize::from(k)].map(at);
                points.sort_unstable();
                Part::Face(place(&FACES, &points))
            }
            Part::Angle(k) => Part::Angle(at(k)),
            Part::Moved(k) => Part::Moved(k),
        }
    }

    /// For the angle at a corner of a triangle: the sides that meet there, and the one across.
    pub(crate) fn sides(corner: u8) -> [Part; 3] {
        [[0, 1, 2], [0, 2, 1], [1, 2, 0]][usize::from(corner)].map(Part::Edge)
    }
}

fn edges(clique: Measure) -> &'static [[u8; 2]] {
    if clique == Measure::Volume { &EDGES_OF_TETRAHEDRA } else { &EDGES_OF_TRIANGLES }
}

fn place<const N: usize>(all: &[[u8; N]], one: &[u8; N]) -> u8 {
    all.iter().position(|known| known == one).unwrap_or(0) as u8
}

/// A variable of an energy of several measures: a measure of some points of an interaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Variable {
    /// What is measured: a length of two points, an area of three, a volume of four.
    pub measure: Measure,
    points: [u8; 4],
    /// Its input now, at rest, and for what it changes by.
    pub(crate) inputs: [Input; 3],
}

impl Variable {
    /// The measure of the whole triangle or tetrahedron.
    pub(crate) fn whole(clique: Measure) -> Variable {
        let inputs = [Input::Current(clique), Input::Reference(clique), Input::Change(clique)];
        Variable { measure: clique, points: [0, 1, 2, 3], inputs }
    }

    /// An edge or a face; nothing of an angle, which follows from sides and area.
    pub(crate) fn of(part: Part, clique: Measure) -> Option<Variable> {
        let mut points = [0; 4];
        let measure = match part {
            Part::Edge(k) => {
                points[..2].copy_from_slice(edges(clique).get(usize::from(k))?);
                Measure::Length
            }
            Part::Face(k) => {
                points[..3].copy_from_slice(&FACES[usize::from(k)]);
                Measure::Area
            }
            Part::Moved(_) => {
                points[1] = 1;
                Measure::Length
            }
            Part::Angle(_) => return None,
        };
        let inputs = [Input::Part(part), Input::PartAtRest(part), Input::PartChange(part)];
        Some(Variable { measure, points, inputs })
    }

    /// As written: `a`, `l1`.
    pub fn symbol(&self) -> &'static str {
        match self.inputs[0] {
            Input::Part(part) => part.symbol(),
            _ => self.measure.symbol(),
        }
    }

    /// Which component of `xi - Xi` it is, from 0; nothing of a measure.
    pub fn component(&self) -> Option<usize> {
        match self.inputs[0] {
            Input::Part(Part::Moved(k)) => Some(usize::from(k)),
            _ => None,
        }
    }

    /// Whose measure it is, by their numbers in the interaction: the owner has number 0.
    pub fn points(&self) -> &[u8] {
        &self.points[..self.measure.points()]
    }
}

/// All orders of the points of a triangle, or of a tetrahedron; the first is that in which they stand.
pub(crate) fn orders(clique: Measure) -> Vec<Vec<u8>> {
    let mut orders = vec![Vec::new()];
    for _ in 0..clique.points() {
        let longer = |order: &Vec<u8>| {
            let order = order.clone();
            let free = (0..clique.points() as u8).filter(|point| !order.contains(point));
            free.map(|point| [&order[..], &[point]].concat()).collect::<Vec<_>>()
        };
        orders = orders.iter().flat_map(longer).collect();
    }
    orders
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_moves_parts_with_their_points() {
        assert_eq!([Measure::Area, Measure::Volume].map(|clique| orders(clique).len()), [6, 24]);
        for clique in [Measure::Area, Measure::Volume] {
            assert!(orders(clique)[0].is_sorted());
            for order in orders(clique) {
                for part in Part::named().filter(|part| part.is_of(clique)) {
                    let moved = part.reordered(clique, &order);
                    let Some(before) = Variable::of(part, clique) else {
                        assert_eq!(moved, Part::Angle(order[0]));
                        continue;
                    };
                    let after = Variable::of(moved, clique).unwrap();
                    let mut points: Vec<u8> =
                        before.points().iter().map(|p| order[usize::from(*p)]).collect();
                    points.sort_unstable();
                    assert_eq!(points, after.points());
                }
            }
        }
    }

    #[test]
    fn faces_lie_across_and_sides_meet() {
        let tetrahedron = |part| Variable::of(part, Measure::Volume).unwrap();
        for k in 0..3u8 {
            let end = tetrahedron(Part::Edge(k)).points()[1];
            assert!(!tetrahedron(Part::Face(k)).points().contains(&end), "a{k} does not hold it");
        }
        assert!(!tetrahedron(Part::Face(3)).points().contains(&0));
        for corner in 0..3u8 {
            let [p, q, across] = Part::sides(corner).map(|side| Variable::of(side, Measure::Area));
            let holds = |side: Option<Variable>| side.unwrap().points().contains(&corner);
            assert_eq!([holds(p), holds(q), holds(across)], [true, true, false]);
        }
    }
}
