"""The figures of designed .cell files that powder can leave, by numpy alone.

    python3 open_cell.py DRUSE X.cell... [--voxels N]

Of each cell, which has the mirrors of the cube: the opening by a flood of the nodes that are farther from the wall than
a radius; the bulk modulus by conjugate gradients on N sharp voxels; the permeability by creeping flow on a staggered
grid, with MINRES; the width of walls and gaps by balls inscribed in the mesh that Druse writes. The first is compared with the
figure in the file, the next two with `druse cell homogenize` on as many voxels, the last with what a printer needs.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from cell_numpy import evaluate
from designed_cell import bulk_modulus

NODES = 64  # of the opening, along the period
FLOW_VOXELS = 24
MESH_VOXEL = 1 / 48
BALLS = 500
LEAST_WIDTH = 0.08
# Greatest relative differences.
OPENING, BULK, FLOW = 0.005, 0.001, 0.001

RECIPE = """druse = 1
[cell.c]
file = "{}"
[scaffold]
box = {{ size = [2, 2, 2], cell_size = 1 }}
[tiling]
cell = "c"
[band]
voxel_size = {}
[[output]]
mesh = "walls.stl"
"""


def octant(path, u):
    """Phi at the points of coordinates u along each axis."""
    points = np.array(list(np.ndindex(*[len(u)] * 3)))
    phi = np.concatenate([evaluate(path, u[part]) for part in np.array_split(points, 32)])
    return phi.reshape([len(u)] * 3)


def sides(cell, phi):
    """Values that are positive in each void: one of a network, two of a sheet."""
    return [phi - cell["level"], -phi - cell["level"]] if cell["solid"] == "sheet" else [phi - cell["level"]]


def gets_through(free):
    """Whether nodes of the octant lead from its first layer to its last: mirrored, they lead through the period."""
    reached = np.zeros_like(free)
    reached[0] = free[0]
    front = reached
    while front.any():
        grown = front
        for axis in range(3):
            padded = np.pad(grown, [(1, 1) if a == axis else (0, 0) for a in range(3)])
            grown = grown | np.take(padded, range(len(free)), axis) | np.take(padded, range(2, len(free) + 2), axis)
        front = grown & free & ~reached
        reached = reached | front
    return bool(reached[-1].any())


def opening(depth):
    """The radius of the greatest ball that travels through the void where depth is positive, at nodes of the octant."""
    n = len(depth)
    nodes = np.array(list(np.ndindex(n, n, n)), float)
    walls = []
    for axis in range(3):
        low, high = (np.take(depth, range(first, n - 1 + first), axis) for first in (0, 1))
        crossed = np.argwhere((low > 0) != (high > 0)).astype(float)
        crossed[:, axis] += (low / (low - high + (low == high)))[(low > 0) != (high > 0)]
        walls.append(crossed)
    walls = np.concatenate(walls)
    # The nearest wall of a place lies in its own octant: its mirror image there is nearer than any beyond.
    square = (walls**2).sum(1)
    near = [((part**2).sum(1)[:, None] + square - 2 * part @ walls.T).min(1) for part in np.array_split(nodes, 64)]
    far = np.sqrt(np.maximum(np.concatenate(near), 0)).reshape(depth.shape) / (2 * (n - 1))
    levels = np.unique(far[depth > 0])
    low, high = 0, len(levels)
    while high - low > 1:
        middle = (low + high) // 2
        through = gets_through((depth > 0) & (far >= levels[middle]))
        low, high = (middle, high) if through else (low, middle)
    return levels[low]


def sharp(cell, phi):
    """Whether voxels of the octant are void, by the share of eight parts that planes cut."""
    step = 0.5 / len(phi)
    around = np.pad(phi, 1, mode="symmetric")  # samples lie half a step off the mirrors
    slope = np.sqrt(sum(np.square(g[1:-1, 1:-1, 1:-1]) for g in np.gradient(around, step))) + 1e-12
    voids = [np.clip(depth / (slope * step) + 0.5, 0, 1) for depth in sides(cell, phi)]
    half = len(phi) // 2
    return [void.reshape([half, 2] * 3).mean((1, 3, 5)) > 0.5 for void in voids]


def mirrored(part):
    """The whole period of the part with positive coordinates."""
    for axis in range(3):
        part = np.concatenate([np.flip(part, axis), part], axis)
    return part


def minres(apply, b, tolerance, most):
    """The solution of a symmetric system (Paige and Saunders 1975)."""
    x, v, old = np.zeros_like(b), b / np.linalg.norm(b), np.zeros_like(b)
    beta, eta, c, s, c_old, s_old = 0.0, np.linalg.norm(b), 1.0, 0.0, 1.0, 0.0
    w, w_old, goal = np.zeros_like(b), np.zeros_like(b), tolerance * np.linalg.norm(b)
    for _ in range(most):
        image = apply(v)
        alpha = v @ image
        image -= alpha * v + beta * old
        after = np.linalg.norm(image)
        # Givens rotations make the tridiagonal matrix triangular.
        delta, third = c * alpha - c_old * s * beta, s_old * beta
        second, first = s * alpha + c_old * c * beta, np.hypot(delta, after)
        c_old, s_old, c, s = c, s, delta / first, after / first
        w, w_old = (v - second * w - third * w_old) / first, w
        x += c * eta * w
        eta *= -s
        if abs(eta) < goal:
            return x
        old, v, beta = v, image / after, after
    raise SystemExit(f"the flow has not converged in {most} steps")


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
    rows, columns, entries = (np.concatenate(v) for v in (rows, columns, entries))
    scale = np.ones(count)
    scale[: count - void.sum()] = 1 / np.sqrt(6.0 * n * n)  # both kinds of unknowns alike
    entries = entries * scale[rows] * scale[columns]
    force = np.zeros(count)
    force[number[0][inside[0]]] = 1.0
    found = minres(lambda x: np.bincount(rows, entries * x[columns], count), scale * force, 1e-6, 20000)
    return (scale * found)[number[0][inside[0]]].sum() / n**3


def widths(path, druse, room):
    """The first percentiles of inscribed balls of a mesh that Druse writes: of walls, of gaps."""
    recipe = room / "walls.toml"
    recipe.write_text(RECIPE.format(path.resolve(), MESH_VOXEL))
    subprocess.run([druse, "run", recipe, "--quiet", "--out", room], check=True, capture_output=True)
    data = np.fromfile(room / "walls.stl", np.uint8)[84:].reshape(-1, 50)[:, 12:48].copy().view("<f4").reshape(-1, 3)
    points, corner = np.unique(data, axis=0, return_inverse=True)
    corner = corner.reshape(-1, 3)
    a, b, c = (points[corner[:, k]] for k in range(3))
    normals = np.zeros(points.shape)
    across = np.cross(b - a, c - a)
    for k in range(3):
        for axis in range(3):
            normals[:, axis] += np.bincount(corner[:, k], across[:, axis], len(points))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    # An eighth of the period in the middle of eight; balls of half a period end nearby.
    inner = np.flatnonzero(((points > 0.5) & (points < 1)).all(1))
    chosen = np.random.default_rng(1).choice(inner, min(BALLS, len(inner)), replace=False)
    chosen, (points, normals) = (points[chosen], normals[chosen]), (v[(points < 1.5).all(1)] for v in (points, normals))
    found = []
    for sign in (-1, 1):
        own = []
        for p, m in zip(chosen[0], sign * chosen[1]):
            off = points - p
            along, square = off @ m, (off**2).sum(1)
            radius = np.where(along > 1e-6, square / np.maximum(2 * along, 2e-6), np.inf)
            least = radius.min()
            # Touching places more than a right angle apart span a wall or a gap.
            if square[radius <= 1.02 * least].max() > 2 * least**2:
                own.append(2 * least)
        found.append(np.percentile(own, 1) if own else np.inf)
    return found


def homogenised(druse, path, voxels, only):
    command = [druse, "cell", "homogenize", path, "--sharp", "--resolution", str(voxels), "--only", only, "--json"]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("druse")
    parser.add_argument("cells", nargs="+", type=Path)
    parser.add_argument("--voxels", type=int, default=32)
    given = parser.parse_args()
    is_good = True

    def compare(path, what, ours, theirs, most):
        nonlocal is_good
        off = abs(ours / theirs - 1)
        is_good &= bool(off <= most)
        verdict = "" if off <= most else f", more than {100 * most:g} % apart"
        print(f"{path.stem:24} {what:32} numpy {ours:.5f}, Druse {theirs:.5f}{verdict}", flush=True)

    for path in given.cells:
        cell = json.loads(path.read_text())
        assert cell["group"] == "Oh", "a cell without the mirrors of the cube"
        design = cell["report"]["design"]
        own = design["properties"][0]
        phi = octant(path, np.arange(NODES // 2 + 1) / NODES)
        radius = min(opening(depth) for depth in sides(cell, phi))
        compare(path, f"opening, {NODES} nodes", radius, own["opening"], OPENING)
        u = (np.arange(given.voxels) + 0.5) / (2 * given.voxels)
        bulk = bulk_modulus(mirrored(~np.any(sharp(cell, octant(path, u)), 0)))
        found = homogenised(given.druse, path, given.voxels, "stiffness")
        compare(path, f"bulk modulus, {given.voxels} voxels", bulk, found["engineering"]["bulk"], BULK)
        u = (np.arange(FLOW_VOXELS) + 0.5) / (2 * FLOW_VOXELS)
        flow = sum(permeability(mirrored(void)) for void in sharp(cell, octant(path, u)))
        found = homogenised(given.druse, path, FLOW_VOXELS, "permeability")
        compare(path, f"permeability, {FLOW_VOXELS} voxels", 1e3 * flow, 1e3 * found["permeability"][0][0], FLOW)
        with tempfile.TemporaryDirectory() as room:
            wall, gap = widths(path, given.druse, Path(room))
        is_good &= bool(min(wall, gap) >= LEAST_WIDTH)
        print(f"{path.stem:24} walls {wall:.4f}, gaps {gap:.4f}; expected {LEAST_WIDTH} or more", flush=True)
    sys.exit(0 if is_good else 1)


if __name__ == "__main__":
    main()
