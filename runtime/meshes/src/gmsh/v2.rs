//! Version 2.2: one list of nodes, one of elements, each with its groups.

use super::{File, kind};
use crate::error::MeshError;
use crate::kind::Kind;
use crate::scan::Scan;

impl File {
    /// `$Nodes`
    pub(super) fn nodes(&mut self, scan: &mut Scan<'_>) -> Result<(), MeshError> {
        let n = text_count(scan, "the number of nodes", 8, "nodes")?;
        let mut nodes = Vec::with_capacity(n);
        for _ in 0..n {
            let tag = whole(scan, "the number of a node")?;
            self.number_node(tag, scan)?;
            scan.in_row = true;
            let mut x = [0.0; 3];
            for x in &mut x {
                *x = scan.float("a coordinate of a node")?;
            }
            nodes.push(x);
            scan.in_row = false;
        }
        self.take_nodes(nodes, scan)
    }

    /// `$Elements`
    pub(super) fn elements(&mut self, scan: &mut Scan<'_>) -> Result<(), MeshError> {
        let n = text_count(scan, "the number of elements", 6, "elements")?;
        let mut left = n;
        while left > 0 {
            if scan.binary {
                let number = scan.int("the type of elements")?;
                let kind = kind(number, scan)?;
                let follow = whole(scan, "how many elements follow")?;
                let n_groups = whole(scan, "how many groups follow")?;
                let follow = scan.count(follow, 4 * (1 + kind.nodes), "elements")?;
                if follow == 0 || follow > left {
                    let message = format!("{follow} elements follow, and {left} are left of {n}");
                    return Err(scan.error(message));
                }
                for _ in 0..follow {
                    let start = scan.at;
                    let tag = whole(scan, "the number of an element")?;
                    self.element(scan, kind, n_groups, (start, tag))?;
                }
                left -= follow;
            } else {
                let start = scan.at;
                let tag = whole(scan, "the number of an element")?;
                scan.in_row = true;
                let number = scan.int("the type of an element")?;
                let kind = kind(number, scan)?;
                let n_groups = whole(scan, "how many groups follow")?;
                self.element(scan, kind, n_groups, (start, tag))?;
                scan.in_row = false;
                left -= 1;
            }
        }
        Ok(())
    }

    /// Groups and nodes of an element; the first group is the physical one.
    fn element(
        &mut self,
        scan: &mut Scan<'_>,
        kind: Kind,
        n_groups: u64,
        (start, tag): (usize, u64),
    ) -> Result<(), MeshError> {
        let mut physical = 0;
        let n_groups = scan.count(n_groups, 2, "groups")?;
        for place in 0..n_groups {
            let group = scan.int("a group of an element")?;
            if place == 0 {
                physical = group;
            }
        }
        let mut nodes = Vec::with_capacity(kind.nodes);
        for _ in 0..kind.nodes {
            let node = whole(scan, "a node of an element")?;
            nodes.push(self.node(node, tag, scan)?);
        }
        let place = (scan.trimmed(start), scan.at);
        let index = self.mesh.push(kind, nodes.into_iter(), (tag, place, !scan.binary));
        if physical != 0 {
            let name = self.name(kind.shape.dimension(), physical);
            self.mesh.group(&name).elements.push(index);
        }
        Ok(())
    }
}

/// A count, which is text in binary files, too.
fn text_count(
    scan: &mut Scan<'_>,
    what: &str,
    bytes: usize,
    things: &str,
) -> Result<usize, MeshError> {
    let binary = std::mem::replace(&mut scan.binary, false);
    let count = scan.size(what)?;
    scan.binary = binary;
    if binary {
        scan.line();
    }
    scan.count(count, bytes, things)
}

/// A number that is not negative; 4 bytes.
fn whole(scan: &mut Scan<'_>, what: &str) -> Result<u64, MeshError> {
    let value = scan.int(what)?;
    u64::try_from(value)
        .map_err(|_| scan.error(format!("{what} is {value}: it cannot be negative")))
}
