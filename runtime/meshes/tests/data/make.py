"""Meshes of every kind that is read, written by Gmsh, and what Gmsh says of them.

    pip install gmsh==4.15.2 && python make.py

Volumes and centres are Gmsh's own: Gauss integration of its Jacobian determinants, exact for each kind.
"""

import json
import math
import os

import gmsh

FORMATS = {"22a": (2.2, 0), "22b": (2.2, 1), "41a": (4.1, 0), "41b": (4.1, 1)}
KINDS = {}


def bar(order, kind, serendipity=False):
    """A wedge-shaped, twisted bar: every cell is distorted."""
    gmsh.model.add(kind)
    geo = gmsh.model.geo
    corners = [(0, 0, 0), (2, 0.1, 0), (2.2, 1, 0.1), (-0.1, 0.9, 0)]
    points = [geo.addPoint(*x, 0.8) for x in corners]
    lines = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    face = geo.addPlaneSurface([geo.addCurveLoop(lines)]) if kind == "flat" else geo.addSurfaceFilling([geo.addCurveLoop(lines)])
    if kind in ("hex", "wedge"):
        for line in lines:
            geo.mesh.setTransfiniteCurve(line, 3)
        geo.mesh.setTransfiniteSurface(face)
        if kind == "hex":
            geo.mesh.setRecombine(2, face)
    if kind == "tet":
        out = geo.twist([(2, face)], 1, 0.5, 0, 0, 0, 1, 0, 0, 1, 0.3)
    else:
        out = geo.twist([(2, face)], 1, 0.5, 0, 0, 0, 1, 0, 0, 1, 0.3, numElements=[2], recombine=True)
    geo.synchronize()
    gmsh.model.addPhysicalGroup(3, [out[1][1]], 7, "steel")
    gmsh.model.addPhysicalGroup(2, [face], 1, "bottom")
    gmsh.model.addPhysicalGroup(2, [out[0][1]], 2, "top face")
    gmsh.model.addPhysicalGroup(1, [lines[0]], 3)
    gmsh.model.addPhysicalGroup(0, [points[0]], 4, "corner")
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", int(serendipity))
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(order)


def sheet(order, quads, serendipity=False):
    """A quarter of a ring of two materials."""
    gmsh.model.add("sheet")
    geo = gmsh.model.geo
    o = geo.addPoint(0, 0, 0)
    a, b, c = (geo.addPoint(r, 0, 0) for r in (1, 1.5, 2))
    d, e, f = (geo.addPoint(0, r, 0) for r in (1, 1.5, 2))
    arcs = [geo.addCircleArc(p, o, q) for p, q in ((a, d), (b, e), (c, f))]
    feet = [geo.addLine(a, b), geo.addLine(b, c)]
    heads = [geo.addLine(d, e), geo.addLine(e, f)]
    faces = []
    for i in range(2):
        loop = geo.addCurveLoop([feet[i], arcs[i + 1], -heads[i], -arcs[i]])
        faces.append(geo.addPlaneSurface([loop]))
    for curve, n in [(x, 7) for x in arcs] + [(x, 3) for x in feet + heads]:
        geo.mesh.setTransfiniteCurve(curve, n)
    for face in faces:
        geo.mesh.setTransfiniteSurface(face)
        if quads:
            geo.mesh.setRecombine(2, face)
    geo.synchronize()
    for tag, name in zip(faces, ("inner", "outer")):
        gmsh.model.addPhysicalGroup(2, [tag], name=name)
    gmsh.model.addPhysicalGroup(2, faces, name="all")
    gmsh.model.addPhysicalGroup(1, feet, name="foot")
    gmsh.model.addPhysicalGroup(1, heads, name="head")
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", int(serendipity))
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(order)


def pyramids(order, serendipity=False):
    """A distorted cube cut into six pyramids, and a tetrahedron on one of its faces."""
    gmsh.model.add("pyramids")
    tag = gmsh.model.addDiscreteEntity(3)
    xs = [(0, 0, 0), (1, 0.1, 0), (1.1, 1, 0), (0, 1, 0.1), (0, 0, 1), (1, 0, 1.2), (1.2, 1.1, 1), (0, 0.9, 1), (0.5, 0.45, 0.55)]
    gmsh.model.mesh.addNodes(3, tag, list(range(1, 10)), [x for p in xs for x in p])
    faces = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    cells = []
    for f in faces:
        # Inward, so that the sign is that of Gmsh.
        cells += [i + 1 for i in reversed(f)] + [9]
    gmsh.model.mesh.addElements(3, tag, [7], [list(range(1, 7))], [cells])
    gmsh.model.addPhysicalGroup(3, [tag], name="core")
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", int(serendipity))
    if order == 2:
        gmsh.model.mesh.setOrder(order)
        # Curved edges: every mid-node is moved a little.
        for node in gmsh.model.mesh.getNodes()[0]:
            if node > 9:
                x, u, _, _ = gmsh.model.mesh.getNode(node)
                moved = [x[i] + 0.02 * math.sin(17.0 * node + i) for i in range(3)]
                gmsh.model.mesh.setNode(node, moved, [])


def facts():
    """Of every cell: type, volume, centre; of every physical group its elements."""
    dimension = gmsh.model.getDimension()
    if gmsh.model.getCurrent() == "pyramids":
        dimension = 3
    cells = []
    for kind in gmsh.model.mesh.getElementTypes(dimension):
        name, _, order, n, _, _ = gmsh.model.mesh.getElementProperties(kind)
        where, weights = gmsh.model.mesh.getIntegrationPoints(kind, "CompositeGauss8")
        tags, _ = gmsh.model.mesh.getElementsByType(kind)
        _, determinants, positions = gmsh.model.mesh.getJacobians(kind, where)
        q = len(weights)
        for c, tag in enumerate(tags):
            ds = determinants[c * q : (c + 1) * q]
            volume = math.fsum(w * d for w, d in zip(weights, ds))
            centre = []
            for axis in range(3):
                xs = positions[3 * c * q + axis : 3 * (c + 1) * q : 3]
                centre.append(math.fsum(w * d * x for w, d, x in zip(weights, ds, xs)) / volume)
            cells.append({"tag": int(tag), "kind": name, "volume": abs(volume), "centre": centre})
    groups = {}
    for dim, tag in gmsh.model.getPhysicalGroups():
        name = gmsh.model.getPhysicalName(dim, tag) or str(tag)
        nodes, _ = gmsh.model.mesh.getNodesForPhysicalGroup(dim, tag)
        groups[name] = {"dimension": dim, "nodes": sorted(int(n) for n in nodes)}
    return {"dimension": dimension, "cells": cells, "groups": groups}


def write(name, formats=FORMATS):
    for suffix, (version, binary) in formats.items():
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(f"{name}.{suffix}.msh")
    gmsh.option.setNumber("Mesh.SaveGroupsOfElements", 1)
    gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", 1)
    if not name.startswith("pyramid1"):
        gmsh.write(f"{name}.inp")
    with open(f"{name}.json", "w") as out:
        json.dump(facts(), out, indent=0)
    gmsh.model.remove()


def main():
    os.chdir(os.path.dirname(os.path.abspath(__file__)))
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    one = {"41a": (4.1, 0)}
    bar(1, "tet"), write("tet4")
    bar(2, "tet"), write("tet10")
    bar(1, "hex"), write("hex8")
    bar(2, "hex"), write("hex27", one)
    bar(2, "hex", True), write("hex20", one)
    bar(1, "wedge"), write("wedge6", one)
    bar(2, "wedge"), write("wedge18", one)
    bar(2, "wedge", True), write("wedge15", one)
    sheet(1, False), write("tri3")
    sheet(2, False), write("tri6", one)
    sheet(1, True), write("quad4", one)
    sheet(2, True), write("quad9", one)
    sheet(2, True, True), write("quad8", one)
    pyramids(1), write("pyramid5", one)
    pyramids(2), write("pyramid14", one)
    pyramids(2, True), write("pyramid13", one)
    gmsh.finalize()


main()
