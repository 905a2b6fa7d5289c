"""Models the bearing bracket and meshes it: bracket.msh (scaffold) and bracket.stl (envelope), millimetres.

    pip install gmsh==4.15.2 numpy && python make_bracket.py

A base plate with two bolt holes carries an upright with a bearing bore; a rib stiffens the filleted inner corner.
The scaffold is quadratic (Tet10, curved to the CAD surface); the envelope is the same CAD model, triangulated so
finely that its chords stay within CHORD of it. The files it made are committed: Druse itself needs no Python.
"""

import math
from pathlib import Path

import gmsh
import numpy as np

HERE = Path(__file__).resolve().parent
EDGE = 7.5  # mm, target edge of the tets: one unit cell each
CHORD = 0.025  # mm, largest distance allowed between envelope and CAD surface


def bracket():
    """The solid, by OpenCASCADE; returns its volume tag."""
    occ = gmsh.model.occ
    half = 22.0
    base = occ.addBox(0, -half, 0, 60, 2 * half, 12)
    upright = occ.addBox(0, -half, 0, 12, 2 * half, 42)
    crown = occ.addCylinder(0, 0, 42, 12, 0, 0, half)
    corners = [occ.addPoint(*p) for p in [(6, -5, 6), (42, -5, 6), (42, -5, 12), (12, -5, 31), (6, -5, 31)]]
    loop = occ.addCurveLoop([occ.addLine(a, b) for a, b in zip(corners, corners[1:] + corners[:1])])
    rib = occ.extrude([(2, occ.addPlaneSurface([loop]))], 0, 10, 0)
    rib = [entity for entity in rib if entity[0] == 3]
    solid, _ = occ.fuse([(3, base)], [(3, upright), (3, crown), *rib])
    occ.synchronize()

    def edges(lo, hi):
        """Curves whose bounding box runs from lo to hi, whatever it does where they say None."""
        want = np.array([*lo, *hi], dtype=float)  # None becomes NaN
        boxes = {curve: np.array(gmsh.model.getBoundingBox(1, curve)) for _, curve in gmsh.model.getEntities(1)}
        return [curve for curve, box in boxes.items() if not (abs(box - want) > 1e-3).any()]

    inner = edges((12, None, 12), (12, None, 12))  # the corner of base and upright, on both sides of the rib
    front = edges((60, None, 0), (60, None, 12))  # the upright edges at the free end of the base
    assert len(inner) == 2 and len(front) == 2
    solid = occ.fillet([solid[0][1]], inner + front, [7.0] * len(inner) + [9.0] * len(front))
    occ.synchronize()

    holes = [occ.addCylinder(-1, 0, 42, 14, 0, 0, 10)]
    holes += [occ.addCylinder(49, y, -1, 0, 0, 14, 4.5) for y in (-13, 13)]
    solid, _ = occ.cut(solid, [(3, hole) for hole in holes])
    occ.synchronize()
    return solid[0][1]


def mesh_scaffold(volume):
    """Tet10 of nearly uniform size, no element inverted."""
    option = gmsh.option.setNumber
    option("Mesh.MeshSizeMin", 0.55 * EDGE)
    option("Mesh.MeshSizeMax", EDGE)
    option("Mesh.MeshSizeFromCurvature", 6)  # elements per turn: quadratic edges need no more
    option("Mesh.Algorithm", 6)  # frontal
    option("Mesh.Algorithm3D", 10)  # HXT
    option("Mesh.OptimizeNetgen", 1)
    gmsh.model.mesh.generate(3)
    option("Mesh.HighOrderOptimize", 0)  # interior elements keep straight edges: their maps are affine
    gmsh.model.mesh.setOrder(2)
    types, tags, _ = gmsh.model.mesh.getElements(3)
    assert list(types) == [11], types  # 11 is gmsh's Tet10
    for name in ("minSJ", "minSICN", "gamma"):
        quality = np.array(gmsh.model.mesh.getElementQualities(tags[0], name))
        print(f"scaffold {name}: least {quality.min():.3f}, median {np.median(quality):.3f}")
        assert quality.min() > 0.1, name
    sizes = np.array(gmsh.model.mesh.getElementQualities(tags[0], "volume"))
    print(f"scaffold: {len(tags[0])} Tet10, {len(gmsh.model.mesh.getNodes()[0])} nodes, "
          f"edge of the regular tet of median volume {(np.median(sizes) * 6 * math.sqrt(2)) ** (1 / 3):.2f} mm")
    assert len(tags[0]) >= 1000
    gmsh.model.addPhysicalGroup(3, [volume], name="bracket")  # the file holds the tets alone
    option("Mesh.MshFileVersion", 4.1)
    option("Mesh.Binary", 1)
    gmsh.write(str(HERE / "bracket.msh"))


def mesh_envelope():
    """Triangles as large as CHORD lets them be: sqrt(8 r CHORD) where the radius is r, anything where it is flat."""
    gmsh.model.mesh.clear()
    gmsh.model.removePhysicalGroups()
    option = gmsh.option.setNumber
    for name in ("HighOrderOptimize", "MeshSizeMin", "MeshSizeFromCurvature", "MeshSizeExtendFromBoundary"):
        option("Mesh." + name, 0)
    option("Mesh.MeshSizeMax", 60.0)
    option("Mesh.Algorithm", 5)  # Delaunay

    def size(dimension, tag, *_):
        kind = gmsh.model.getType(dimension, tag)
        if kind == "Line":
            return min(size(2, face) for face in gmsh.model.getAdjacencies(1, tag)[0])
        if dimension == 0 or kind == "Plane":
            return 60.0
        first, last = gmsh.model.getParametrizationBounds(dimension, tag)
        curvature = gmsh.model.getCurvature(dimension, tag, [(a + b) / 2 for a, b in zip(first, last)])[0]
        return 0.66 * math.sqrt(8 * CHORD / curvature)

    gmsh.model.mesh.setSizeCallback(size)
    gmsh.model.mesh.generate(2)
    worst = 0.0
    count = 0
    for _, face in gmsh.model.getEntities(2):
        _, tags, nodes = gmsh.model.mesh.getElements(2, face)
        count += len(tags[0])
        where = {t: i for i, t in enumerate(gmsh.model.mesh.getNodes()[0])}
        xyz = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)
        corners = xyz[[where[t] for t in nodes[0]]].reshape(-1, 3, 3)
        samples = np.concatenate([corners.mean(1)] + [(corners[:, i] + corners[:, i - 1]) / 2 for i in range(3)])
        closest, _ = gmsh.model.getClosestPoint(2, face, samples.ravel())
        worst = max(worst, np.linalg.norm(np.array(closest).reshape(-1, 3) - samples, axis=1).max())
    print(f"envelope: {count} triangles, within {worst:.4f} mm of the CAD surface")
    assert worst < CHORD
    option("Mesh.Binary", 1)
    gmsh.write(str(HERE / "bracket.stl"))


def main():
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)  # the same mesh every time
    gmsh.model.add("bracket")
    volume = bracket()
    lo_hi = gmsh.model.getBoundingBox(3, volume)
    print(f"part: {gmsh.model.occ.getMass(3, volume):.1f} mm3, box " + " ".join(f"{v:.2f}" for v in lo_hi))
    mesh_scaffold(volume)
    mesh_envelope()
    gmsh.finalize()


if __name__ == "__main__":
    main()
