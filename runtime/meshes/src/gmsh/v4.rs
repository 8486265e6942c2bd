//! Version 4.1: nodes and elements in blocks, one per entity of the geometry.

use super::{File, kind};
use crate::error::MeshError;
use crate::scan::Scan;

impl File {
    /// `$Entities`: of which physical groups the points, curves, surfaces and volumes are.
    pub(super) fn entities(&mut self, scan: &mut Scan<'_>) -> Result<(), MeshError> {
        let mut counts = [0; 4];
        for count in &mut counts {
            *count = scan.size("a number of entities")?;
        }
        for (dimension, count) in counts.into_iter().enumerate() {
            let count = scan.count(count, 8, "entities")?;
            for _ in 0..count {
                let tag = scan.int("the number of an entity")?;
                scan.skip(if dimension == 0 { 3 } else { 6 }, 8, "bounds of an entity")?;
                let n_groups = scan.size("a number of physical groups")?;
                let n_groups = scan.count(n_groups, 2, "physical groups")?;
                let mut groups = Vec::with_capacity(n_groups);
                for _ in 0..n_groups {
                    groups.push(scan.int("the number of a physical group")?);
                }
                self.groups.insert((dimension as i64, tag), groups);
                if dimension > 0 {
                    let n_bounds = scan.size("a number of bounding entities")?;
                    scan.skip(n_bounds, 4, "bounding entities")?;
                }
            }
        }
        Ok(())
    }

    /// `$Nodes`
    pub(super) fn nodes_of_blocks(&mut self, scan: &mut Scan<'_>) -> Result<(), MeshError> {
        let n_blocks = scan.size("the number of blocks")?;
        let announced = scan.size("the number of nodes")?;
        let announced = scan.count(announced, 8, "nodes")?;
        scan.skip(2, 8, "the least and largest number of a node")?;
        let mut nodes = Vec::with_capacity(announced);
        for _ in 0..n_blocks {
            let dimension = scan.int("the dimension of an entity")?;
            scan.int("the number of an entity")?;
            let is_parametric = scan.int("0 or 1")? == 1;
            let n = scan.size("the number of nodes of a block")?;
            let n = scan.count(n, 8, "nodes")?;
            for _ in 0..n {
                let tag = scan.size("the number of a node")?;
                self.number_node(tag, scan)?;
            }
            for _ in 0..n {
                let mut x = [0.0; 3];
                for x in &mut x {
                    *x = scan.float("a coordinate of a node")?;
                }
                nodes.push(x);
                if is_parametric {
                    scan.skip(dimension.clamp(0, 3) as u64, 8, "parameters of a node")?;
                }
            }
        }
        if nodes.len() != announced {
            let message = format!("{announced} nodes are announced, and {} are there", nodes.len());
            return Err(scan.error(message));
        }
        self.take_nodes(nodes, scan)
    }

    /// `$Elements`
    pub(super) fn elements_of_blocks(&mut self, scan: &mut Scan<'_>) -> Result<(), MeshError> {
        let n_blocks = scan.size("the number of blocks")?;
        let announced = scan.size("the number of elements")?;
        let announced = scan.count(announced, 4, "elements")?;
        scan.skip(2, 8, "the least and largest number of an element")?;
        let mut found = 0;
        for _ in 0..n_blocks {
            let dimension = scan.int("the dimension of an entity")?;
            let entity = scan.int("the number of an entity")?;
            let number = scan.int("the type of elements")?;
            let kind = kind(number, scan)?;
            let n = scan.size("the number of elements of a block")?;
            let n = scan.count(n, 2 * kind.nodes, "elements")?;
            found += n;
            let first = self.mesh.n_elements() as u32;
            self.block(scan, kind, n)?;
            let last = self.mesh.n_elements() as u32;
            let groups = self.groups.get(&(dimension, entity)).cloned().unwrap_or_default();
            for group in groups {
                let name = self.name(dimension.clamp(0, 3) as usize, group);
                self.mesh.group(&name).elements.extend(first..last);
            }
        }
        if found != announced {
            let message = format!("{announced} elements are announced, and {found} are there");
            return Err(scan.error(message));
        }
        Ok(())
    }

    fn block(
        &mut self,
        scan: &mut Scan<'_>,
        kind: crate::kind::Kind,
        n: usize,
    ) -> Result<(), MeshError> {
        let mut nodes = Vec::with_capacity(kind.nodes);
        for _ in 0..n {
            let start = scan.at;
            let tag = scan.size("the number of an element")?;
            scan.in_row = true;
            nodes.clear();
            for _ in 0..kind.nodes {
                let node = scan.size("a node of an element")?;
                nodes.push(self.node(node, tag, scan)?);
            }
            scan.in_row = false;
            let place = (scan.trimmed(start), scan.at);
            self.mesh.push(kind, nodes.iter().copied(), (tag, place, !scan.binary));
        }
        Ok(())
    }
}
