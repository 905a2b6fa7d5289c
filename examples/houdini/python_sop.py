"""Code of a Python SOP that fills its input with a cell. Not run in Houdini.

Spare parameters of the node: druse (string, path of the program), cell_size, thickness, voxel_size (floats, metres).
The input is a closed polygon mesh.
"""

import os
import subprocess
import tempfile

RECIPE = """druse = 1
unit = "m"
fps = {fps}
[cell.cell]
element = "hex"
surface = "gyroid"
solid = "sheet"
[scaffold]
fill = {{ mesh = "input.$F4.stl", cell_size = {cell_size} }}
boundary = "extend"
[tiling]
cell = "cell"
thickness = {thickness}
[band]
voxel_size = {voxel_size}
[[op]]
intersect = {{ mesh = "input.$F4.stl" }}
[[output]]
vdb = "part.$F4.vdb"
fog = true
"""


def write_stl(path, geometry):
    """The polygons as text STL, each as a fan of triangles. Houdini's are clockwise seen from outside."""
    with open(path, "w", encoding="ascii") as file:
        file.write("solid input\n")
        for prim in geometry.prims():
            corners = [v.point().position() for v in prim.vertices()][::-1]
            for b, c in zip(corners[1:], corners[2:]):
                file.write("facet normal 0 0 0\nouter loop\n")
                for p in (corners[0], b, c):
                    file.write(f"vertex {p[0]:.9g} {p[1]:.9g} {p[2]:.9g}\n")
                file.write("endloop\nendfacet\n")
        file.write("endsolid input\n")


def cook(hou):
    """Runs druse on the input of the current node and reads the volume."""
    node = hou.pwd()
    frame = int(hou.frame())
    folder = os.path.join(tempfile.gettempdir(), "druse_" + node.path().strip("/").replace("/", "_"))
    os.makedirs(folder, exist_ok=True)
    values = {name: node.parm(name).eval() for name in ("cell_size", "thickness", "voxel_size")}
    write_stl(os.path.join(folder, f"input.{frame:04d}.stl"), node.inputs()[0].geometry())
    with open(os.path.join(folder, "part.toml"), "w", encoding="utf-8") as file:
        file.write(RECIPE.format(fps=hou.fps(), **values))
    command = [node.parm("druse").eval() or "druse", "run", os.path.join(folder, "part.toml"), "--frames", str(frame)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise hou.NodeError(done.stderr)
    geometry = node.geometry()
    geometry.clear()
    geometry.loadFromFile(os.path.join(folder, f"part.{frame:04d}.vdb"))
