"""Meshes a STEP part into curved second-order tets, one unit cell each, by gmsh.

    pip install gmsh==4.15.2
    python mesh_step.py                                # makes lever.step, a part to try it with, then lever.msh
    python mesh_step.py part.step part.msh --size 6    # any STEP file; SIZE is the edge of a tet, in its millimetres

The recipe beside it fills the tets as they are, and with `--set scaffold.all_hex=true` as hexes, four of each tet.
"""

import argparse
import sys
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent


def lever(path):
    """Two bored bosses, joined by a bar, as a STEP file."""
    occ = gmsh.model.occ
    solid = [(3, occ.addCylinder(0, 0, 0, 0, 0, 16, 15))]
    others = [(3, occ.addCylinder(70, 0, 0, 0, 0, 12, 10)), (3, occ.addBox(0, -8, 0, 70, 16, 10))]
    solid, _ = occ.fuse(solid, others)
    bores = [(3, occ.addCylinder(0, 0, 0, 0, 0, 16, 7)), (3, occ.addCylinder(70, 0, 0, 0, 0, 12, 4.5))]
    occ.cut(solid, bores)
    occ.synchronize()
    gmsh.write(str(path))
    gmsh.clear()


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("part", nargs="?", type=Path, default=HERE / "lever.step", help="the STEP file")
parser.add_argument("mesh", nargs="?", type=Path, help="the .msh to write [beside the part]")
parser.add_argument("--size", type=float, default=7.0, help="edge of a tet [7]")
arguments = parser.parse_args()
target = arguments.mesh or arguments.part.with_suffix(".msh")

gmsh.initialize(["gmsh", "-v", "2"])
if not arguments.part.exists() and arguments.part == HERE / "lever.step":
    lever(arguments.part)
gmsh.model.occ.importShapes(str(arguments.part))
gmsh.model.occ.synchronize()
solids = gmsh.model.getEntities(3)
if not solids:
    sys.exit(f"{arguments.part}: found no solid")
options = {"MeshSizeMax": arguments.size, "MeshSizeMin": arguments.size * 0.8,
           "Optimize": 1, "ElementOrder": 2, "HighOrderOptimize": 2}
for name, value in options.items():
    gmsh.option.setNumber(f"Mesh.{name}", value)
# The solids alone: surfaces would be read as a shell's.
gmsh.model.addPhysicalGroup(3, [tag for _, tag in solids], name="part")
gmsh.model.mesh.generate(3)
gmsh.option.setNumber("Mesh.Binary", 1)
gmsh.write(str(target))
print(f"{target}: {len(gmsh.model.mesh.getElementsByType(11)[0])} tets of second order")
