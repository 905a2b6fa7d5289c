"""Runs the programs of examples/*.rs and compares what they print with closed forms.

    examples.py FOLDER_OF_PROGRAMS WORK_FOLDER
"""

import re
import subprocess
import sys
from math import pi
from pathlib import Path

programs, work = Path(sys.argv[1]), Path(sys.argv[2])
ball = lambda r: 4 / 3 * pi * r**3
lens = pi * (4 * 5 + 6) * (2 * 5 - 6) ** 2 / 12
# Of each program: the label of a line, the first number on it, the relative or absolute tolerance; the files.
EXPECTED = {
    "fit_cell": ({"volume fraction": (ball(0.3), 2e-3)}, ["ball.stl", "ball.cell"]),
    "evaluate_tiling": (
        {"elements": (8, 0), "greatest difference of phi": (0, 1e-4), "distance on the surface": (0, 1e-3)},
        ["tiling.csv"],
    ),
    "stream_band": ({"active voxels": (4 * pi * (10**2 + 0.15**2 / 3) * 0.3 / 0.05**3, 2e-3)}, ["ball.vdb"]),
    "level_set_operations": (
        {"dilated ball": (ball(5), 1e-3), "union": (2 * ball(5) - lens, 1e-3), "its mesh": (2 * ball(5) - lens, 1e-3)},
        ["small_ball.vdb", "union.ply"],
    ),
    "crystal": (
        {"faces": (12, 0), "volume of the polygons": (4 * 2**0.5, 1e-5), "volume of the level set": (4 * 2**0.5, 5e-3)},
        ["crystal.vdb"],
    ),
    "own_field": (
        {"volume": (2 * pi**2 * 8 * 2**2, 1e-3), "area": (4 * pi**2 * 8 * 2, 1e-3)},
        ["torus.vdb"],
    ),
}

sources = {p.stem for p in (Path(__file__).parents[2] / "examples").glob("*.rs")}
assert sources == set(EXPECTED), f"found the programs {sorted(sources)}, expected {sorted(EXPECTED)}"
for name, (figures, files) in EXPECTED.items():
    folder = work / name
    run = subprocess.run([programs / name, folder], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, f"{name}: exit code {run.returncode}: {run.stderr}"
    for label, (expected, tolerance) in figures.items():
        line = re.search(rf"^{label}\s+(\S+?),?(\s|$)", run.stdout, re.MULTILINE)
        assert line, f"{name}: no line {label!r} in\n{run.stdout}"
        found = float(line[1])
        off = abs(found / expected - 1) if expected else abs(found)
        assert off <= tolerance, f"{name}: {label} is {found}, expected {expected} to {tolerance}"
        print(f"{name:22}{label:29}{found:<14g}expected {expected:<12g}off by {off:.1e}")
    for file in files:
        assert (folder / file).stat().st_size > 100, f"{name}: {file} is missing or empty"
