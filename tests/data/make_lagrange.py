"""Lagrange cells of order 1 and 2 beside the same cells of VTK's classic types, written by VTK.

    pip install vtk
    python tests/data/make_lagrange.py tests/data/scaffold

Nodes stand at the parametric coordinates that VTK gives for the type, moved by a quadratic map of space.
"""
import pathlib
import sys

import vtk

out = pathlib.Path(sys.argv[1])

PYRAMID = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 0.8)]
PYRAMID_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)]


def mean(points):
    return tuple(sum(c) / len(points) for c in zip(*points))


def pyramid(count):
    """Corners, edges, base, triangles, a point on the axis: the first `count` of them."""
    p = list(PYRAMID)
    p += [mean([p[a], p[b]]) for a, b in PYRAMID_EDGES]
    p += [mean(p[:4])]
    p += [mean([p[i], p[(i + 1) % 4], p[4]]) for i in range(4)]
    p += [(0.5, 0.5, 0.2)]
    return p[:count]


def nodes(name, count):
    if name == "Pyramid":
        return pyramid(count)
    cell = getattr(vtk, "vtk" + name)()
    cell.GetPointIds().SetNumberOfIds(count)
    cell.GetPoints().SetNumberOfPoints(count)
    for i in range(count):
        cell.GetPoints().SetPoint(i, 0, 0, 0)
    if hasattr(cell, "SetUniformOrderFromNumPoints"):
        cell.SetUniformOrderFromNumPoints(count)
    if hasattr(cell, "Initialize"):
        cell.Initialize()
    flat = cell.GetParametricCoords()
    return [tuple(flat[3 * i : 3 * i + 3]) for i in range(count)]


def curved(p, shift):
    x, y, z = p
    return (x + 0.1 * y * y - 0.05 * x * z + shift, y + 0.08 * x * z + 0.06 * z * z, z - 0.1 * x * y + 0.05 * x * x)


def grid(cells):
    g, points = vtk.vtkUnstructuredGrid(), vtk.vtkPoints()
    points.SetDataTypeToDouble()
    for i, (code, name, count) in enumerate(cells):
        ids = [points.InsertNextPoint(curved(p, 2.0 * i)) for p in nodes(name, count)]
        g.InsertNextCell(code, count, ids)
    g.SetPoints(points)
    return g


def write(name, cells):
    data = grid(cells)
    if name.startswith("classic"):
        return xml(name, data)
    xml(name, data)
    w = vtk.vtkUnstructuredGridWriter()
    w.SetInputData(data)
    w.SetFileTypeToBinary()
    w.SetFileName(str(out / (name + ".vtk")))
    assert w.Write()


def xml(name, data):
    w = vtk.vtkXMLUnstructuredGridWriter()
    w.SetInputData(data)
    w.SetDataModeToBinary()
    w.SetFileName(str(out / (name + ".vtu")))
    assert w.Write()


LAGRANGE = {
    "solids1": [(71, "LagrangeTetra", 4), (72, "LagrangeHexahedron", 8), (73, "LagrangeWedge", 6), (74, "Pyramid", 5), (68, "LagrangeCurve", 2)],
    "solids2": [(71, "LagrangeTetra", 10), (72, "LagrangeHexahedron", 27), (73, "LagrangeWedge", 18), (74, "Pyramid", 14), (68, "LagrangeCurve", 3)],
    "surface1": [(69, "LagrangeTriangle", 3), (70, "LagrangeQuadrilateral", 4)],
    "surface2": [(69, "LagrangeTriangle", 6), (70, "LagrangeQuadrilateral", 9)],
}
CLASSIC = {
    "solids1": [(10, "Tetra", 4), (12, "Hexahedron", 8), (13, "Wedge", 6), (14, "Pyramid", 5), (3, "Line", 2)],
    "solids2": [(24, "QuadraticTetra", 10), (29, "TriQuadraticHexahedron", 27), (32, "BiQuadraticQuadraticWedge", 18), (37, "Pyramid", 19), (21, "QuadraticEdge", 3)],
    "surface1": [(5, "Triangle", 3), (9, "Quad", 4)],
    "surface2": [(22, "QuadraticTriangle", 6), (28, "BiQuadraticQuad", 9)],
}
for key, cells in LAGRANGE.items():
    write("lagrange_" + key, cells)
for key, cells in CLASSIC.items():
    write("classic_" + key, cells)
