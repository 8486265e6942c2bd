//! Which operations are worked out only where a choice needs them.
//!
//! Before: a graph in which every operation is evaluated. After: the operations that only one side of
//! an `if` needs form a region of that side, provided that a call of an elementary function is among
//! them; all others stay where they were. What the choice returns does not change, because a graph
//! has no side effects.

use rustc_hash::FxHashMap;

use super::called::Called;
use crate::expression::{ExprGraph, Node, NodeId};

/// Deepest nesting of regions; what lies deeper is evaluated with the region around it. It bounds the
/// recursion of whoever follows the regions.
const DEEPEST: usize = 16;

/// The region of operations that are always evaluated.
pub(super) const ALWAYS: usize = 0;

/// The operations of a graph by the condition under which they are needed.
pub(super) struct Regions {
    nodes: Vec<Vec<NodeId>>,
    sides: FxHashMap<NodeId, [Option<usize>; 2]>,
}

impl Regions {
    /// The regions of what the roots need.
    pub(super) fn new(graph: &ExprGraph, roots: &[NodeId]) -> Regions {
        let mut places = Places { of: vec![None; graph.len()], regions: vec![ROOT] };
        let mut sides = FxHashMap::default();
        for &root in roots {
            places.widen(root, ALWAYS);
        }
        for (id, node) in graph.nodes().rev() {
            let Some(place) = places.of[id.0 as usize] else { continue };
            match node {
                Node::Select(condition, x, y) if places.regions[place].depth < DEEPEST => {
                    places.widen(condition, place);
                    let pair = [places.inside(place), places.inside(place)];
                    places.widen(x, pair[0]);
                    places.widen(y, pair[1]);
                    sides.insert(id, pair);
                }
                _ => node.operands().for_each(|operand| places.widen(operand, place)),
            }
            if Called::of(node).is_some() {
                places.mark(place);
            }
        }
        let mut nodes = vec![Vec::new(); places.regions.len()];
        for (id, _) in graph.nodes() {
            if let Some(place) = places.of[id.0 as usize] {
                nodes[places.settled(place)].push(id);
            }
        }
        let kept = |region: usize| places.regions[region].calls.then_some(region);
        let sides = sides.into_iter().map(|(id, pair)| (id, pair.map(kept))).collect();
        Regions { nodes, sides }
    }

    /// The operations of a region, operands before users.
    pub(super) fn nodes(&self, region: usize) -> &[NodeId] {
        &self.nodes[region]
    }

    /// All operations.
    pub(super) fn all(&self) -> impl Iterator<Item = NodeId> {
        self.nodes.iter().flatten().copied()
    }

    /// The regions of the two sides of a choice, where they are worth a branch.
    pub(super) fn sides(&self, select: NodeId) -> [Option<usize>; 2] {
        self.sides.get(&select).copied().unwrap_or_default()
    }
}

struct Region {
    parent: usize,
    depth: usize,
    /// Whether it, or a region in it, calls an elementary function.
    calls: bool,
}

const ROOT: Region = Region { parent: ALWAYS, depth: 0, calls: true };

/// The smallest region that holds all users of each operation.
struct Places {
    of: Vec<Option<usize>>,
    regions: Vec<Region>,
}

impl Places {
    fn inside(&mut self, parent: usize) -> usize {
        let depth = self.regions[parent].depth + 1;
        self.regions.push(Region { parent, depth, calls: false });
        self.regions.len() - 1
    }

    /// An operation has one more user, in this region.
    fn widen(&mut self, id: NodeId, region: usize) {
        let place = &mut self.of[id.0 as usize];
        let (mut x, mut y) = (place.unwrap_or(region), region);
        while x != y {
            let deeper =
                if self.regions[x].depth >= self.regions[y].depth { &mut x } else { &mut y };
            *deeper = self.regions[*deeper].parent;
        }
        *place = Some(x);
    }

    fn mark(&mut self, mut region: usize) {
        while !self.regions[region].calls {
            self.regions[region].calls = true;
            region = self.regions[region].parent;
        }
    }

    /// The region itself, or the next around it that is kept.
    fn settled(&self, mut region: usize) -> usize {
        while !self.regions[region].calls {
            region = self.regions[region].parent;
        }
        region
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{model, values};

    /// The calls that are always made, and those of each side of a choice, for psi of a bond.
    fn calls(psi: &str) -> Vec<Vec<&'static str>> {
        let model = model(&format!("potential p\npsi(l) = {psi}"));
        let specialised = model.specialise_as(&values(&model, 3, &[]), crate::Form::Textbook);
        let energy = &specialised.unwrap().energies[0];
        let regions = Regions::new(&energy.graph, &energy.roots[..1]);
        let name = |id: &NodeId| match energy.graph[*id] {
            Node::Unary(function, _) if function.libm().is_some() => Some(function.name()),
            _ => None,
        };
        let all = regions.nodes.iter().map(|nodes| nodes.iter().filter_map(name).collect());
        all.filter(|calls: &Vec<_>| !calls.is_empty()).collect()
    }

    #[test]
    fn a_side_holds_what_only_it_needs() {
        assert_eq!(calls("if l < L then sin(l) else cos(l)"), [vec!["sin"], vec!["cos"]]);
        assert_eq!(calls("if l < L then sin(l) else l"), [vec!["sin"]]);
    }

    #[test]
    fn what_both_sides_or_others_need_is_always_evaluated() {
        assert_eq!(calls("if l < L then sin(l) else sin(l) + l"), [vec!["sin"]]);
        assert_eq!(
            calls("(if l < L then sin(l) else cos(l)) + cos(l)"),
            [vec!["cos"], vec!["sin"]]
        );
        assert_eq!(calls("if sin(l) < 0 then sin(l) else l"), [vec!["sin"]]);
    }

    #[test]
    fn choices_nest_and_deep_ones_join_the_region_around_them() {
        let nested = "if l < 1 then (if l < 2 then sin(l) else cos(l)) else tan(l)";
        assert_eq!(calls(nested), [vec!["tan"], vec!["sin"], vec!["cos"]]);
        let deep = (0..40).fold("l".to_string(), |inner, k| {
            format!("if l < {k} then sin(l + {k}) else ({inner})")
        });
        let found = calls(&deep);
        assert_eq!(found.iter().map(Vec::len).sum::<usize>(), 40);
        assert_eq!(found.len(), DEEPEST + 1);
        assert!(found.iter().any(|calls| calls.len() == 40 - DEEPEST));
    }
}
