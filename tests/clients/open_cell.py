"""The opening and the permeability of a designed .cell file, by numpy and scipy alone, against the figures in the file.

    python3 open_cell.py X.cell [N]

The opening is the radius of the greatest ball that travels through the void to the next period along x. Distances to
solid voxels are minima over all of them, axis by axis, on the torus; a flood of the voxels that are farther than a
radius, over three periods, tells whether a ball gets through, and bisection gives the greatest. The permeability is that
of creeping flow on a staggered grid, solved by MINRES on a sparse matrix.
"""

import json
import sys

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import minres

from cell_numpy import evaluate

PERIODS = 3


def field(path, n, shift):
    """Phi at the points (j + shift) / n - 1/2 of a cell with the mirrors of the cube, shift 0 or 1/2."""
    u = (np.arange(n) + shift) / n - 0.5
    # One point of each pair of mirror images along an axis.
    first = np.arange(n // 2 + (shift == 0))
    image = np.minimum(np.arange(n), n - 1 - np.arange(n) if shift else (n - np.arange(n)) % n)
    points = u[np.array(list(np.ndindex(*[len(first)] * 3)))]
    phi = np.concatenate([evaluate(path, part) for part in np.array_split(points, 16)]).reshape([len(first)] * 3)
    return phi[np.ix_(image, image, image)]


def distances(solid):
    """Of every node to the wall, periods: to the nearest solid node, less half a step."""
    n = len(solid)
    square = np.where(solid, 0.0, np.inf)
    off = np.abs(np.arange(n)[:, None] - np.arange(n))
    off = np.minimum(off, n - off) ** 2
    for axis in range(3):
        lines = np.moveaxis(square, axis, -1)
        found = np.stack([(lines + off[i]).min(-1) for i in range(n)], -1)
        square = np.moveaxis(found, -1, axis)
    return (np.sqrt(square) - 0.5) / n


def gets_through(free):
    """Whether the free voxels lead through three periods along x, on the torus of y and z."""
    n = len(free)
    free = np.concatenate([free] * PERIODS)
    reached = np.zeros_like(free)
    reached[0] = free[0]
    front = reached.copy()
    while front.any():
        grown = front.copy()
        grown[1:] |= front[:-1]
        grown[:-1] |= front[1:]
        # Steps along edges, faces and diagonals.
        for axis in (1, 2):
            grown |= np.roll(grown, 1, axis) | np.roll(grown, -1, axis)
        front = grown & free & ~reached
        reached |= front
    return bool(reached[PERIODS * n - 1].any())


def opening(void):
    far = distances(~void)
    low, high = 0.0, 0.5
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (middle, high) if gets_through(void & (far >= middle)) else (low, middle)
    return low


def permeability(void):
    """Mean velocity along x under a unit force, viscosity 1, squares of the period."""
    n = len(void)
    inside = [void & np.roll(void, 1, a) for a in range(3)]  # faces between two void voxels, below each voxel
    number, count = [], 0
    for mask in [*inside, void]:
        own = np.full(void.shape, -1)
        own[mask] = count + np.arange(mask.sum())
        count += mask.sum()
        number.append(own)
    rows, columns, entries = [], [], []

    def add(r, c, v):
        rows.append(r), columns.append(c), entries.append(np.broadcast_to(v, r.shape))

    for c in range(3):
        here, mask = number[c][inside[c]], inside[c]
        for axis in range(3):
            for step in (1, -1):
                other = np.roll(number[c], step, axis)[mask]
                known = other >= 0
                # A face inside the solid beside a wall mirrors the velocity; on the wall it is 0.
                buried = np.roll(~void & ~np.roll(void, 1, c), step, axis)[mask] & (axis != c)
                add(here, here, np.where(~known & buried, 2.0, 1.0) * n * n)
                add(here[known], other[known], -1.0 * n * n)
        for cell, sign in [(number[3][mask], 1.0), (np.roll(number[3], 1, c)[mask], -1.0)]:
            add(here, cell, sign * n)
            add(cell, here, sign * n)
    matrix = sp.csr_matrix((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), (count, count))
    force = np.zeros(count)
    force[number[0][inside[0]]] = 1.0
    scale = np.ones(count)
    scale[: count - void.sum()] = 1 / np.sqrt(6.0 * n * n)  # both kinds of unknowns alike
    scaled = sp.diags(scale) @ matrix @ sp.diags(scale)
    found, _ = minres(scaled, scale * force, rtol=1e-7, maxiter=20000)
    return (scale * found)[number[0][inside[0]]].sum() / n**3


def main():
    path = sys.argv[1]
    cell = json.load(open(path))
    own = cell["report"]["design"]["properties"][0]
    n = int(sys.argv[2]) if len(sys.argv) > 2 else 96
    phi, level = field(path, n, 0), cell["level"]
    is_sheet = cell["solid"] == "sheet"
    voids = [phi > level, phi < -level] if is_sheet else [phi > level]
    found = min(opening(v) for v in voids)
    print(f"{path}: {n} voxels, opening {found:.4f}; Druse: {own['opening']:.4f}")
    coarse = 32
    phi = field(path, coarse, 0.5)
    flow = sum(permeability(v) for v in ([phi > level, phi < -level] if is_sheet else [phi > level]))
    print(f"{path}: {coarse} voxels, permeability {flow:.3e}; Druse: {own.get('permeability', float('nan')):.3e}")
    # A wall lies anywhere between two nodes.
    sys.exit(0 if abs(found - own["opening"]) < 0.9 / n else 1)


if __name__ == "__main__":
    main()
