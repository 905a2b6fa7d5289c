"""A .cell file read without Druse: the twelve lines of numpy that the README shows, against `druse cell eval`.

    python3 cell_numpy.py DRUSE X.cell
"""

import csv
import io
import json
import subprocess
import sys
from itertools import permutations, product

import numpy as np


# README: begin
def evaluate(path, x):
    """Phi at points x[n, 3] of the reference cell, from a .cell file of group Td or Oh."""
    cell = json.load(open(path))
    phi = np.zeros(len(x))
    for term in cell["coefficients"]:
        f = np.linalg.inv(cell["lattice"]) @ term["k"]  # cycles per unit length; rows of lattice are its vectors
        signs = [s for s in product([1, -1], repeat=3) if cell["group"] == "Oh" or np.prod(s) > 0]
        orbit = {tuple(np.round(2 * f[list(p)] * s).astype(int)) for p in permutations(range(3)) for s in signs}
        wave = complex(*term["c"]) * np.exp(1j * np.pi * (x @ np.array(list(orbit)).T)).sum(1)
        paired = tuple(-np.round(2 * f).astype(int)) in orbit  # else the opposite orbit adds the conjugate
        phi += wave.real if paired else 2 * wave.real
    return phi
# README: end


def main():
    druse, path = sys.argv[1:]
    points = np.random.default_rng(7).uniform(-0.5, 0.5, (200, 3))
    text = "x,y,z\n" + "".join(",".join(map(repr, map(float, p))) + "\n" for p in points)
    command = [druse, "cell", "eval", path, "--points", "-"]
    answer = subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout
    rows = list(csv.DictReader(io.StringIO(answer)))
    assert len(rows) == len(points), f"{len(rows)} rows for {len(points)} points"
    theirs = np.array([float(row["phi"]) for row in rows])
    off = np.abs(theirs - evaluate(path, points)).max()
    print(f"{path}: {len(points)} points, numpy and druse differ by at most {off:.1e}")
    sys.exit(0 if off < 1e-12 else 1)


if __name__ == "__main__":
    main()
