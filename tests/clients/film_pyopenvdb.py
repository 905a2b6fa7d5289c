"""The grid `vel` of a twisting bar, as pyopenvdb reads it, against the closed form at every active voxel.

    /usr/bin/python3 film_pyopenvdb.py FOLDER FRAME...

Expects the bar of examples/twisting_bar: the top of 60 mm turns by a quarter of a turn in a second. Files are in metres.
"""

import math
import sys

import pyopenvdb

RATE = math.pi / 2 / 0.06  # radians per second and metre of height


def on_bar(x, y, z, seconds):
    """The nearest point of the bar, 20 x 20 x 60 mm, after so many seconds of its twist: velocities beyond its faces are
    those of the faces."""
    z = min(max(z, 0.0), 0.06)
    angle = RATE * z * seconds
    c, s = math.cos(angle), math.sin(angle)
    u, v = (min(max(w, -0.01), 0.01) for w in (c * x + s * y, c * y - s * x))
    return c * u - s * v, s * u + c * v, z


def rms(path, seconds):
    """The rms error of the velocities relative to their rms, and the number of voxels."""
    grid = pyopenvdb.read(path, "vel")
    assert type(grid).__name__ == "Vec3SGrid", type(grid)
    error = whole = count = 0
    for item in grid.citerOnValues():
        if item.min != item.max:
            continue
        x, y, z = on_bar(*grid.transform.indexToWorld(item.min), seconds)
        turn = RATE * z
        exact = (-y * turn, x * turn, 0.0)
        error += sum((a - b) ** 2 for a, b in zip(item.value, exact))
        whole += sum(b**2 for b in exact)
        count += 1
    return math.sqrt(error / whole), count


def main():
    folder, frames = sys.argv[1], sys.argv[2:]
    worst = 0.0
    for frame in frames:
        found, count = rms(f"{folder}/bar.{int(frame):04d}.vdb", (int(frame) - 1) / 24)
        print(f"frame {frame}: rms error {found:.5f} of {count} vectors")
        worst = max(worst, found)
    assert worst < 0.01, worst
    print(f"figure: velocities of a twisting bar in the band, rms | {worst:.4f} | 0.01")


if __name__ == "__main__":
    main()
