"""The code of the Python SOP in examples/houdini with a stand-in for Houdini's module: a cube in, a volume out.

    python houdini_sop.py DRUSE FOLDER

The stand-in has what the code uses of `hou`, as Houdini's documentation describes it: polygons are clockwise seen from
outside. It shows that the recipe, the files and the command line fit together, not that the node works in Houdini.
"""

import importlib.util
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
# The faces of a cube from -1 to 1, clockwise seen from outside, by axis and side.
CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


class Has:
    """An object whose methods return fixed values."""

    def __init__(self, **values):
        for name, value in values.items():
            setattr(self, name, lambda *_, value=value: value)


class Geometry:
    """The geometry of the node: what is loaded into it."""

    def __init__(self):
        self.loaded = ["something old"]

    def clear(self):
        self.loaded = []

    def loadFromFile(self, path):  # noqa: N802, Houdini's name
        self.loaded.append(path)


def outward(face):
    """Whether corners are counter-clockwise seen from outside."""
    a, b, c = (CORNERS[n] for n in face[:3])
    u, v = ([q - p for p, q in zip(a, other)] for other in (b, c))
    normal = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
    return sum(n * p for n, p in zip(normal, a)) > 0


def houdini(druse, **values):
    """The stand-in, and the geometry of its node."""
    parameters = {"druse": druse, "cell_size": 0.5, "thickness": 0.12, "voxel_size": 0.04, **values}
    faces = [face[::-1] if outward(face) else face for face in FACES]
    prims = [Has(vertices=[Has(point=Has(position=CORNERS[n])) for n in face]) for face in faces]
    geometry = Geometry()
    node = Has(path="/obj/part/druse", inputs=[Has(geometry=Has(prims=prims))], geometry=geometry)
    node.parm = lambda name: Has(eval=parameters[name])
    hou = Has(pwd=node, frame=7.0, fps=24.0)
    hou.NodeError = type("NodeError", (Exception,), {})
    return hou, geometry


def main():
    druse, folder = os.path.abspath(sys.argv[1]), pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    tempfile.tempdir = str(folder.resolve())
    spec = importlib.util.spec_from_file_location("python_sop", ROOT / "examples/houdini/python_sop.py")
    sop = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sop)

    hou, geometry = houdini(druse)
    sop.cook(hou)
    [path] = geometry.loaded
    assert path.endswith("part.0007.vdb"), path
    info = json.loads(subprocess.run([druse, "info", "--json", path], check=True, capture_output=True).stdout)
    names = {grid["name"]: grid["class"] for grid in info["grids"]}
    assert names == {"surface": "level set", "density": "fog volume"}, names
    checked = subprocess.run([druse, "check", "--json", path], check=True, capture_output=True)
    assert json.loads(checked.stdout)["passed"], checked.stdout
    # A sheet of thickness t around a surface of area A and Euler characteristic X has the volume
    # A t + 4/3 pi X (t/2)^3 (Steiner); the gyroid has A = 3.0915 and X = -8 in a cube of edge 1.
    half = 0.12 / 0.5 / 2
    expected = 3.0915 * 2 * half - 4 / 3 * math.pi * 8 * half**3
    mesh = folder / "part.stl"
    subprocess.run([druse, "mesh", path, "-o", mesh, "-q"], check=True)
    facts = json.loads(subprocess.run([druse, "info", "--json", mesh], check=True, capture_output=True).stdout)
    share = facts["volume"] / 1e9 / 8  # meshes of files are in millimetres
    assert abs(share / expected - 1) < 0.01, (share, expected)

    hou, geometry = houdini(druse, voxel_size=-1.0)
    try:
        sop.cook(hou)
    except hou.NodeError as error:
        assert "voxel_size" in str(error), error
    else:
        raise AssertionError("a negative voxel size was taken")
    print(f"Python SOP: {path} holds {sorted(names)}, {100 * share:.1f} % of the cube")


if __name__ == "__main__":
    main()
