"""Makes strut cells as closed triangle meshes in the reference coordinates of their element (no unit).

    pip install manifold3d==3.5.4 numpy && python make_strut.py strut.stl          # tet
    python make_strut.py --element hex ../../tests/data/strut_hex.stl

tet: a ball at the centroid and a strut to the centroid of each face. hex: struts to the faces and, thinner, to the
corners. Every strut is cut by the element's faces, so its caps lie exactly in the face planes: neighbours meet there.
The shape has the whole symmetry of its element (24 or 48 operations).
"""

import argparse
import itertools
import struct
from pathlib import Path

import manifold3d
import numpy as np

SIDES = 36  # of a strut; a multiple of 12 keeps its facets symmetric under the element's group
TET = np.array([(-1, -1, -1), (1, 1, -1), (-1, 1, 1), (1, -1, 1)]) / 2


def strut(end, radius):
    """A prism from the origin through `end`, a facet's middle towards each mirror plane of the group."""
    axis = end / np.linalg.norm(end)
    side = np.array([1.0, -1.0, 0.0]) if np.ptp(np.abs(end)) < 1e-12 else np.roll(np.abs(axis), 1)
    side = side - axis * (side @ axis)
    side /= np.linalg.norm(side)
    turn = 2 * np.pi * (np.arange(SIDES) + 0.5) / SIDES
    ring = radius / np.cos(np.pi / SIDES) * (np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(axis, side)))
    return manifold3d.Manifold.hull_points(np.concatenate([ring, ring + 1.5 * end]))


def ball(radius, divisions=12):
    """A sphere with the symmetry of the cube: a subdivided octahedron."""
    steps = range(-divisions, divisions + 1)
    grid = np.array([p for p in itertools.product(steps, repeat=3) if np.abs(p).sum() == divisions], dtype=float)
    return manifold3d.Manifold.hull_points(radius * grid / np.linalg.norm(grid, axis=1)[:, None])


def cell(element):
    """The solid inside its element."""
    if element == "tet":
        parts = [strut(-vertex / 3, 0.12) for vertex in TET] + [ball(0.17)]
        return manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add) ^ manifold3d.Manifold.hull_points(TET)
    faces = np.concatenate([np.eye(3), -np.eye(3)]) / 2
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    parts = [strut(face, 0.10) for face in faces] + [strut(corner, 0.07) for corner in corners] + [ball(0.16)]
    return manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add) ^ manifold3d.Manifold.hull_points(
        np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    )


def planes(element):
    """Unit normals of the faces and their distance from the centroid."""
    if element == "tet":
        return -TET / np.linalg.norm(TET[0]), np.sqrt(3) / 6
    return np.concatenate([np.eye(3), -np.eye(3)]), 0.5


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("output", type=Path)
    arguments.add_argument("--element", choices=["tet", "hex"], default="tet")
    options = arguments.parse_args()
    mesh = cell(options.element).to_mesh64()
    corners = np.array(mesh.vert_properties)[:, :3]
    normals, offset = planes(options.element)
    height = corners @ normals.T - offset
    assert height.max() < 1e-12
    on_face = np.abs(height) < 1e-9
    for normal in range(len(normals)):  # exactly planar caps, whatever the rounding of the booleans
        corners[on_face[:, normal]] -= np.outer(height[on_face[:, normal], normal], normals[normal])
    triangles = corners[np.asarray(mesh.tri_verts)]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    record = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["n"], record["v"] = normal, triangles
    options.output.write_bytes(
        f"{options.element} strut cell, reference coordinates".encode().ljust(80) + struct.pack("<I", len(record)) + record.tobytes()
    )
    caps = np.abs(record["v"].astype(float) @ normals.T - offset).max(1) < 1e-6
    volume = np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6
    whole = 1 / 3 if options.element == "tet" else 1.0
    print(f"{options.output}: {len(record)} triangles, {caps.any(1).sum()} of them caps, "
          f"volume {volume:.5f}, {100 * volume / whole:.1f} % of the element")


if __name__ == "__main__":
    main()
