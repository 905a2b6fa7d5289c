"""A gyroid on a warped grid of hexes whose nodes are shuffled, against numpy's closed form on the ordered grid.

    python3 gyroid_numpy.py DRUSE WORK

numpy writes the mesh, orders the nodes of every hex at random in one of the 48 ways that a cube has, and knows where
each point lies in its element. What druse evaluates there must be sin X cos Y + sin Y cos Z + sin Z cos X in the
coordinates of the ordered grid, which druse never sees.
"""

import csv
import io
import subprocess
import sys
from itertools import permutations, product
from pathlib import Path

import numpy as np

COUNT = 5  # hexes along an edge
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])  # VTK's order
RECIPE = """druse = 1
[cell.g]
surface = "gyroid"
[scaffold]
file = "mixed.vtu"
[tiling]
cell = "g"
[band]
voxel_size = 0.1
"""


def orders():
    """The 48 orders of a cube's corners."""
    found = []
    for axes, flips in product(permutations(range(3)), product([0, 1], repeat=3)):
        image = np.abs(CORNERS[:, axes] - flips)
        found.append([int((image == corner).all(1).argmax()) for corner in CORNERS])
    return found


def bent(p):
    x, y, z = p.T
    return p + np.stack([0.2 * np.sin(y), 0.1 * np.cos(z), 0.15 * np.sin(x + y)], axis=1)


def write(path, nodes, hexes):
    def array(name, kind, numbers, values):
        text = " ".join(map(repr, np.ravel(values).tolist()))
        return f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{numbers}" format="ascii">{text}</DataArray>\n'

    cells = array("connectivity", "Int64", 1, hexes) + array("offsets", "Int64", 1, 8 * np.arange(1, len(hexes) + 1))
    path.write_text(
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>'
        f'<Piece NumberOfPoints="{len(nodes)}" NumberOfCells="{len(hexes)}"><Points>{array("p", "Float64", 3, nodes)}</Points>'
        f'<Cells>{cells}{array("types", "UInt8", 1, [12] * len(hexes))}</Cells></Piece></UnstructuredGrid></VTKFile>'
    )


def main():
    druse, work = sys.argv[1], Path(sys.argv[2])
    work.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(11)
    side = COUNT + 1
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), -1).reshape(-1, 3)
    nodes = bent(grid.astype(float))
    first = np.array(list(np.ndindex(COUNT, COUNT, COUNT)))
    hexes = ((first[:, None] + CORNERS) @ [side * side, side, 1]).astype(int)
    ways = orders()
    assert len({tuple(w) for w in ways}) == 48
    mixed = np.array([own[ways[random.integers(48)]] for own in hexes])
    mixed = mixed[random.permutation(len(mixed))]
    write(work / "mixed.vtu", nodes, mixed)
    (work / "g.toml").write_text(RECIPE)
    # Two points in every hex of the ordered grid, in world coordinates by the eight corners' weights.
    of = np.repeat(np.arange(len(hexes)), 2)
    xi = random.uniform(0.01, 0.99, (len(of), 3))
    weights = np.prod(np.where(CORNERS == 1, xi[:, None], 1 - xi[:, None]), axis=2)
    points = np.einsum("nc,nci->ni", weights, nodes[hexes[of]])
    text = "x,y,z\n" + "".join(",".join(map(repr, map(float, p))) + "\n" for p in points)
    command = [druse, "eval", str(work / "g.toml"), "--points", "-", "--exact"]
    answer = subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout
    found = np.array([float(row["phi"]) for row in csv.DictReader(io.StringIO(answer))])
    assert len(found) == len(points), f"{len(found)} rows for {len(points)} points"
    x, y, z = (2 * np.pi * (xi - 0.5)).T
    off = np.abs(found - (np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x))).max()
    print(f"{len(points)} points of {len(hexes)} shuffled hexes: numpy's gyroid and druse differ by at most {off:.1e}")
    sys.exit(0 if off < 1e-9 else 1)


if __name__ == "__main__":
    main()
