"""A series that sfepy wrote: a beam bends over four frames; Druse plays it back with velocities.

    /usr/bin/python3 sfepy_series.py DRUSE FOLDER

Needs Debian's python3-sfepy and python3-openvdb. The end of the beam rises by the same amount in each frame.
"""

import os
import pathlib
import subprocess
import sys

import numpy as np
import pyopenvdb as vdb
from sfepy.base.base import IndexedStruct, output
from sfepy.discrete import Equation, Equations, FieldVariable, Integral, Material, Problem
from sfepy.discrete.conditions import Conditions, EssentialBC
from sfepy.discrete.fem import FEDomain, Field
from sfepy.mechanics.matcoefs import stiffness_from_youngpoisson
from sfepy.mesh.mesh_generators import gen_block_mesh
from sfepy.solvers.ls import ScipyDirect
from sfepy.solvers.nls import Newton
from sfepy.terms import Term

FRAMES, RISE, FPS, LENGTH = 4, 0.5, 24, 12
RECIPE = """druse = 1
unit = "mm"
fps = 24
[cell.p]
surface = "schwarz_p"
volume_fraction = 0.4
[scaffold]
file = "beam.$F4.vtu"
[scaffold.motion]
displacement = "u"
[tiling]
cell = "p"
[band]
voxel_size = 0.2
[[output]]
vdb = "beam.$F4.vdb"
unit = "mm"
grids = ["surface", "vel"]
"""


def series(folder):
    """Writes the mesh with the displacements of each frame."""
    output.set_output(quiet=True)
    mesh = gen_block_mesh([LENGTH, 4, 4], [7, 3, 3], [LENGTH / 2, 2, 2], name="beam", verbose=False)
    domain = FEDomain("domain", mesh)
    omega = domain.create_region("Omega", "all")
    ends = [domain.create_region(n, f"vertices in x {w}", "facet") for n, w in [("Left", "< 0.001"), ("Right", "> 11.999")]]
    field = Field.from_args("u", np.float64, "vector", omega, approx_order=1)
    u = FieldVariable("u", "unknown", field)
    v = FieldVariable("v", "test", field, primary_var_name="u")
    m = Material("m", D=stiffness_from_youngpoisson(3, 100.0, 0.3))
    term = Term.new("dw_lin_elastic(m.D, v, u)", Integral("i", order=2), omega, m=m, v=v, u=u)
    problem = Problem("beam", equations=Equations([Equation("balance", term)]))
    problem.set_solver(Newton({}, lin_solver=ScipyDirect({}), status=IndexedStruct()))
    for frame in range(1, FRAMES + 1):
        fixed = EssentialBC("fixed", ends[0], {"u.all": 0.0})
        moved = EssentialBC("moved", ends[1], {"u.0": 0.0, "u.1": 0.0, "u.2": RISE * (frame - 1)})
        problem.set_bcs(ebcs=Conditions([fixed, moved]))
        state = problem.solve()
        mesh.write(str(folder / f"beam.{frame:04}.vtu"), out=state.create_output_dict())


def main():
    druse, folder = os.path.abspath(sys.argv[1]), pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)  # sfepy leaves a domain.vtk behind
    folder = pathlib.Path()
    series(folder)
    (folder / "beam.toml").write_text(RECIPE)
    subprocess.run([druse, "run", "beam.toml", "--quiet", "--frames", f"1-{FRAMES}"], cwd=folder, check=True)
    for frame in range(1, FRAMES + 1):
        path = str(folder / f"beam.{frame:04}.vdb")
        velocity, surface = vdb.read(path, "vel"), vdb.read(path, "surface")
        ends = {0: [], LENGTH: []}
        highest = -np.inf
        for item in velocity.citerOnValues():
            if item.min != item.max:
                continue
            x, _, z = velocity.transform.indexToWorld(item.min)
            for end, found in ends.items():
                if abs(x - end) < 0.3:
                    found.append(item.value)
        for item in surface.citerOnValues():
            if item.value < 0:
                x, _, z = surface.transform.indexToWorld(item.min)
                highest = max(highest, z if x > LENGTH - 1 else -np.inf)
        still, fast = np.mean(ends[0], axis=0), np.mean(ends[LENGTH], axis=0)
        print(f"frame {frame}: end at {highest:.2f} mm, velocity {fast[2]:.2f} mm/s, at the support {still[2]:.2f}")
        assert abs(fast[2] / (RISE * FPS) - 1) < 0.05 and abs(still[2]) < 0.1 * RISE * FPS
        assert abs(highest - (4 + RISE * (frame - 1))) < 0.5


if __name__ == "__main__":
    main()
