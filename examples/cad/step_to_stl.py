"""Makes triangles of a CAD file, so that Druse can fit a cell to exact surfaces (NURBS, STEP, IGES, BREP).

    pip install gmsh==4.15.2
    python step_to_stl.py cell.step cell.stl                     # any CAD file that gmsh reads
    python step_to_stl.py --demo cell.step                       # a strut cell to try it with
    druse fit cell.stl -o cell.cell --element hex

Coordinates stay as they are: a cell's CAD model is drawn in the element's reference coordinates (a hex is the cube from
-0.5 to 0.5), or is brought there by `--place fit` or `--place '{ scale = 0.01 }'`. CHORD is the greatest distance of a
triangle's middle from the exact surface, as a share of the model's size.
"""

import argparse
import sys

import gmsh

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("model", help="the CAD file to read; with --demo the STEP file to write")
parser.add_argument("triangles", nargs="?", help="the .stl to write")
parser.add_argument("--chord", type=float, default=1e-3, metavar="CHORD", help="share of the model's size [0.001]")
parser.add_argument("--demo", action="store_true", help="write a ball with six struts as STEP and stop")
arguments = parser.parse_args()
if not arguments.demo and not arguments.triangles:
    parser.error("the .stl to write is missing")

gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
if arguments.demo:
    parts = [(3, occ.addSphere(0, 0, 0, 0.25))]
    parts += [(3, occ.addCylinder(*(-0.5 * d for d in axis), *axis, 0.1)) for axis in [(1, 0, 0), (0, 1, 0), (0, 0, 1)]]
    occ.fuse(parts[:1], parts[1:])
    occ.synchronize()
    gmsh.write(arguments.model)
    sys.exit()

occ.importShapes(arguments.model)
occ.synchronize()
solids = gmsh.model.getEntities(3)
if not solids:
    sys.exit(f"{arguments.model}: found no solid; a cell needs closed surfaces")
low, high = (gmsh.model.getBoundingBox(-1, -1)[i : i + 3] for i in (0, 3))
size = max(b - a for a, b in zip(low, high))
# An arc of angle t and radius r is off its chord by r (1 - cos(t/2)): so many elements a full turn, for r = size / 4.
turn = 3.14159 * (0.25 / (2 * arguments.chord)) ** 0.5
gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", max(12, round(turn)))
gmsh.option.setNumber("Mesh.MeshSizeMax", size / 20)
gmsh.model.mesh.generate(2)
gmsh.option.setNumber("Mesh.Binary", 1)
gmsh.write(arguments.triangles)
print(f"{arguments.triangles}: {len(solids)} solids, box {low} to {high}")
