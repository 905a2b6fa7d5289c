"""Small scaffolds of every kind and format, with the counts and volumes that gmsh and meshio report.

    pip install gmsh meshio pyvista
    python tests/data/make_scaffolds.py tests/data/scaffold

The shape is a quarter of a thick cylinder shell, so that second-order elements are truly curved.
Volumes come from gmsh's own quadrature of the Jacobian.
"""
import json
import pathlib
import sys

import gmsh
import meshio
import numpy as np
import pyvista
from vtkmodules.vtkIOCore import vtkZLibDataCompressor
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

out = pathlib.Path(sys.argv[1])
out.mkdir(exist_ok=True)
table = {}

# Names of ours, by Gmsh element type.
KINDS = {4: "Tet4", 11: "Tet10", 5: "Hex8", 17: "Hex20", 12: "Hex27"}
MESHIO = {"tetra": "Tet4", "tetra10": "Tet10", "hexahedron": "Hex8", "hexahedron20": "Hex20", "hexahedron27": "Hex27"}


def shell(hexes, order, incomplete):
    """A curved block: inner radius 1, outer 1.6, a quarter turn, height 0.8."""
    gmsh.clear()
    gmsh.model.add("shell")
    g = gmsh.model.geo
    o = g.addPoint(0, 0, 0)
    p = [g.addPoint(1, 0, 0), g.addPoint(1.6, 0, 0), g.addPoint(0, 1.6, 0), g.addPoint(0, 1, 0)]
    curves = [g.addLine(p[0], p[1]), g.addCircleArc(p[1], o, p[2]), g.addLine(p[2], p[3]), g.addCircleArc(p[3], o, p[0])]
    face = g.addPlaneSurface([g.addCurveLoop(curves)])
    if hexes:
        for c, n in zip(curves, [2, 3, 2, 3]):
            g.mesh.setTransfiniteCurve(c, n)
        g.mesh.setTransfiniteSurface(face)
        g.mesh.setRecombine(2, face)
        solid = g.extrude([(2, face)], 0, 0, 0.8, [2], recombine=True)
    else:
        solid = g.extrude([(2, face)], 0, 0, 0.8)
    g.synchronize()
    volume = [tag for dim, tag in solid if dim == 3]
    gmsh.model.addPhysicalGroup(3, volume, 7, "part \"one\"" if hexes else "shell")
    gmsh.model.addPhysicalGroup(2, [face], 3, "floor")
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.7)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.7)
    gmsh.option.setNumber("Mesh.ElementOrder", order)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", incomplete)
    gmsh.model.mesh.generate(3)


def facts():
    kinds, volume = {}, 0.0
    types, tags, _ = gmsh.model.mesh.getElements(3)
    for t, elements in zip(types, tags):
        kinds[KINDS[t]] = len(elements)
        points, weights = gmsh.model.mesh.getIntegrationPoints(t, "Gauss8")
        _, det, _ = gmsh.model.mesh.getJacobians(t, points)
        volume += float((np.array(det).reshape(len(elements), -1) @ np.array(weights)).sum())
    return {"kinds": kinds, "volume": volume}


gmsh.initialize()
gmsh.option.setNumber("General.Verbosity", 2)
gmsh.option.setNumber("General.NumThreads", 1)
for name, hexes, order, incomplete in [
    ("tet4", 0, 1, 0),
    ("tet10", 0, 2, 0),
    ("hex8", 1, 1, 0),
    ("hex20", 1, 2, 1),
    ("hex27", 1, 2, 0),
]:
    shell(hexes, order, incomplete)
    known = facts()
    for version in (2.2, 4.1):
        for binary in (0, 1):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            # Everything that has no group is left out unless asked for; take both ways.
            gmsh.option.setNumber("Mesh.SaveAll", binary)
            file = f"{name}_{version:.1f}_{'binary' if binary else 'ascii'}.msh".replace(".", "", 1)
            gmsh.write(str(out / file))
            table[file] = known
    for binary in (0, 1):
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.option.setNumber("Mesh.SaveAll", 0)
        file = f"{name}_{'binary' if binary else 'ascii'}.vtk"
        gmsh.write(str(out / file))
        table[file] = known

    # Second opinions on node order and layout: meshio's and pyvista's writers.
    mesh = meshio.read(out / f"{name}_22_binary.msh")
    solid = [c for c in mesh.cells if c.type in MESHIO]
    assert {MESHIO[c.type]: len(c.data) for c in solid} == known["kinds"]
    bare = meshio.Mesh(mesh.points, solid)
    for compression in ("zlib", None):
        file = f"{name}_{compression or 'base64'}.vtu"
        bare.write(out / file, file_format="vtu", compression=compression)
        table[file] = known
    file = f"{name}_text.vtu"
    bare.write(out / file, file_format="vtu", binary=False)
    table[file] = known
    grid = pyvista.from_meshio(bare)
    if name in ("tet10", "hex8"):
        file = f"{name}_vtk.vtu"
        grid.save(out / file)
        table[file] = known
        # ParaView's ways: appended, raw or base64, compressed or not, either width of header.
        for form, encode, compress, wide in [
            ("raw", 0, 1, 1),
            ("plain", 0, 0, 0),
            ("base64", 1, 1, 0),
            ("base64plain", 1, 0, 1),
        ]:
            writer = vtkXMLUnstructuredGridWriter()
            file = f"{name}_appended_{form}.vtu"
            writer.SetFileName(str(out / file))
            writer.SetInputData(grid)
            writer.SetDataModeToAppended()
            writer.SetEncodeAppendedData(encode)
            writer.SetCompressor(vtkZLibDataCompressor() if compress else None)
            writer.SetHeaderTypeToUInt64() if wide else writer.SetHeaderTypeToUInt32()
            assert writer.Write() == 1
            table[file] = known
        file = f"{name}_51_binary.vtk"
        grid.save(out / file)
        table[file] = known
        file = f"{name}_51_ascii.vtk"
        grid.save(out / file, binary=False)
        table[file] = known

gmsh.finalize()
(out / "facts.json").write_text(json.dumps(table, indent=1) + "\n")
