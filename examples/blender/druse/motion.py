# SPDX-License-Identifier: MIT OR Apache-2.0
"""Cubes that follow a mesh: their corners at every frame, for cells that stay with the material and for velocities.

The cubes fill the mesh at the first frame. A corner moves as the affine map that fits the motion of the mesh's points
best, near ones counting most (moving least squares): moves, turns and stretches are exact, bends are smooth.
"""

import math
import os
import struct

import mathutils
import numpy
from mathutils.bvhtree import BVHTree

# Corners of a cube in VTK's order.
CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
# Rays of the test for inside; skew, so that they seldom meet edges.
RAYS = [mathutils.Vector(v).normalized() for v in ((1, 0.13, 0.07), (-0.11, 1, 0.17), (0.19, -0.05, -1))]
MAX_CUBES = 4_000_000
# Corners times points that a binding holds: 80 MB.
MAX_WEIGHTS = 10_000_000


def is_inside(tree, point):
    """Whether most rays leave the surface more often than they enter it; holes mislead some of them at most."""
    votes = 0
    for ray in RAYS:
        at, balance = point, 0
        for _ in range(64):
            hit, normal, _, _ = tree.ray_cast(at, ray)
            if hit is None:
                break
            balance += 1 if normal.dot(ray) > 0.0 else -1
            at = hit + ray * 1e-5 * max(1.0, hit.length)
        votes += balance > 0
    return 2 * votes > len(RAYS)


def cubes(points, triangles, size):
    """Corners (n, 3) and cubes (m, 8) that cover the inside of a mesh with faces turned outward."""
    low, high = points.min(axis=0), points.max(axis=0)
    counts = numpy.maximum(numpy.ceil((high - low) / size - 1e-6), 1)
    if counts.prod() > MAX_CUBES:
        raise ValueError(f"{counts.prod():.3g} cells of size {size:g} in the mesh's box; expected at most {MAX_CUBES}")
    counts = counts.astype(int)
    origin = (low + high) / 2 - counts * size / 2
    tree = BVHTree.FromPolygons(points.tolist(), triangles.tolist())
    reach = size * math.sqrt(3.0) / 2
    kept = []
    for index in numpy.ndindex(*counts):
        centre = mathutils.Vector(origin + (numpy.array(index) + 0.5) * size)
        if tree.find_nearest(centre, reach)[0] is not None or is_inside(tree, centre):
            kept.append(index)
    lattice = (numpy.array(kept)[:, None, :] + numpy.array(CORNERS)[None]).reshape(-1, 3)
    corners, elements = numpy.unique(lattice, axis=0, return_inverse=True)
    return origin + corners * size, elements.reshape(-1, 8)


def samples(points, most):
    """Indices of points far from each other, and how many points each stands for."""
    if len(points) <= most:
        return numpy.arange(len(points)), numpy.ones(len(points))
    chosen = [0]
    label = numpy.zeros(len(points), dtype=int)
    distance = numpy.full(len(points), numpy.inf)
    while True:
        new = ((points - points[chosen[-1]]) ** 2).sum(axis=1)
        nearer = new < distance
        label[nearer] = len(chosen) - 1
        distance[nearer] = new[nearer]
        if len(chosen) == most:
            return numpy.array(chosen), numpy.bincount(label, minlength=most).astype(float)
        chosen.append(int(distance.argmax()))


def weights(corners, points, shares, size):
    """The matrix (corners, points) from displacements of the points to those of the corners."""
    rows = []
    step = max(MAX_WEIGHTS // 8 // len(points), 1)
    for start in range(0, len(corners), step):
        at = corners[start : start + step]
        away = points[None] - at[:, None]
        w = shares / ((away**2).sum(axis=2) + (size / 4) ** 2) ** 2
        w /= w.sum(axis=1, keepdims=True)
        centre = numpy.einsum("np,npi->ni", w, away)
        away -= centre[:, None]
        moment = numpy.einsum("np,npi,npj->nij", w, away, away)
        # Keeps flat clouds of points solvable.
        moment += 1e-9 * numpy.trace(moment, axis1=1, axis2=2)[:, None, None] * numpy.eye(3)
        slope = numpy.linalg.solve(moment, -centre[:, :, None])[:, :, 0]
        rows.append(w * (1.0 + numpy.einsum("npi,ni->np", away, slope)))
    return numpy.concatenate(rows)


class Binding:
    """Cubes in a mesh, and where they are at the frames seen so far."""

    def __init__(self, points, triangles, size):
        self._points, self._triangles = points, triangles
        self.corners, self.elements = cubes(points, triangles, size)
        used = numpy.unique(triangles)
        most = max(MAX_WEIGHTS // len(self.corners), 64)
        chosen, shares = samples(points[used], most)
        self._chosen = used[chosen]
        self._weights = weights(self.corners, points[self._chosen], shares, size)
        self._frames = [self.corners]

    def fits(self, points, triangles):
        """Whether a frame's mesh has the faces of the first."""
        return len(points) == len(self._points) and numpy.array_equal(triangles, self._triangles)

    def add(self, points):
        """The next frame."""
        moved = points[self._chosen] - self._points[self._chosen]
        self._frames.append(self.corners + self._weights @ moved)

    def greatest_step(self):
        """The longest way of a corner from frame to frame."""
        pairs = zip(self._frames, self._frames[1:])
        return max((math.sqrt(((b - a) ** 2).sum(axis=1).max()) for a, b in pairs), default=0.0)

    def write(self, folder, first):
        """Writes cubes.vtk and cubes.pc2, whose first sample is at the frame `first`."""
        with open(os.path.join(folder, "cubes.vtk"), "w", encoding="ascii") as file:
            file.write("# vtk DataFile Version 3.0\ncubes\nASCII\nDATASET UNSTRUCTURED_GRID\n")
            file.write(f"POINTS {len(self.corners)} double\n")
            file.writelines(f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in self.corners)
            count = len(self.elements)
            file.write(f"CELLS {count} {9 * count}\n")
            file.writelines("8 " + " ".join(map(str, row)) + "\n" for row in self.elements)
            file.write(f"CELL_TYPES {count}\n" + "12\n" * count)
        with open(os.path.join(folder, "cubes.pc2"), "wb") as file:
            file.write(struct.pack("<12siiffi", b"POINTCACHE2", 1, len(self.corners), first, 1.0, len(self._frames)))
            for frame in self._frames:
                file.write(frame.astype("<f4").tobytes())
