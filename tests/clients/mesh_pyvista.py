"""pyvista looks at a mesh that Druse wrote: closed, manifold, and of the volume that the report states.

    python mesh_pyvista.py part.stl [part.ply ...] --report report.json
"""

import argparse
import json
import sys

import numpy as np
import pyvista


def check(path, volume):
    """Reads one mesh and returns what is wrong with it."""
    soup = pyvista.read(path)
    mesh = soup.clean(tolerance=0.0, absolute=True)  # an STL repeats its corners; bitwise equal ones are one vertex
    edges = mesh.n_open_edges  # of one triangle, or of more than two
    corners = mesh.points.astype(float)[mesh.regular_faces]
    signed = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    off = abs(signed - volume) / volume if volume else 0.0
    print(
        f"{path}: {mesh.n_cells} triangles, {edges} open or non-manifold edges, "
        f"volume {signed:.3f} (pyvista {mesh.volume:.3f}, report {volume}, off by {100 * off:.3f} %), "
        f"box {np.round(mesh.bounds, 3).tolist()}"
    )
    faults = []
    if mesh.n_cells == 0:
        faults.append("it is empty")
    if edges:
        faults.append("it is not closed and manifold")
    if signed <= 0:
        faults.append("its triangles face inwards")
    if off > 0.005:
        faults.append("its volume is not the report's")
    return faults


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("meshes", nargs="+")
    arguments.add_argument("--report", help="report.json of the run, lengths in the meshes' unit")
    options = arguments.parse_args()
    volume = None
    if options.report:
        with open(options.report, encoding="utf-8") as file:
            volume = json.load(file)["solid"]["volume"]
    faults = [f"{path}: {fault}" for path in options.meshes for fault in check(path, volume)]
    sys.exit("\n".join(faults) if faults else 0)


if __name__ == "__main__":
    main()
