"""A .vdb file seen by pyopenvdb and vdb_print, against what Druse says about it.

    /usr/bin/python3 vdb_pyopenvdb.py FILE.vdb [REPORT.json | INFO.json]

The second file is the report of the run that wrote it, or the output of `druse info --json`. Prints what is in the
file as one JSON object; exits with 1 when something differs. pyopenvdb runs under Debian's own Python only.
"""

import json
import os
import shutil
import subprocess
import sys

import pyopenvdb as vdb

METRES = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254, "ft": 0.3048}


def describe(grid):
    """What pyopenvdb sees of a grid."""
    low, high = grid.evalActiveVoxelBoundingBox()
    return {
        "name": grid.name,
        "class": grid.gridClass,
        "type": grid.valueTypeName,
        "voxel_size": list(grid.transform.voxelSize()),
        "origin": list(grid.transform.indexToWorld((0, 0, 0))),
        "background": grid.background,
        "active_voxels": grid.activeVoxelCount(),
        "bbox": [list(low), list(high)],
        "half": grid.saveFloatAsHalf,
        "metadata": {key: str(value) for key, value in grid.metadata.items()},
    }


class Findings(list):
    """Differences, one line each."""

    def same(self, what, theirs, ours, tolerance=0.0):
        if isinstance(ours, (list, tuple)):
            alike = len(ours) == len(theirs) and all(abs(a - b) <= tolerance for a, b in zip(theirs, ours))
        elif isinstance(ours, (int, float)) and not isinstance(ours, bool):
            alike = abs(theirs - ours) <= tolerance
        else:
            alike = theirs == ours
        if not alike:
            self.append(f"{what}: pyopenvdb says {theirs}, Druse says {ours}")


def against_info(grids, info, findings):
    """`druse info --json`: every grid, number by number."""
    findings.same("number of grids", len(grids), len(info["grids"]))
    for theirs, ours in zip(sorted(grids, key=lambda g: g["name"]), info["grids"]):
        for key in ("name", "class", "active_voxels", "half"):
            findings.same(f"{ours['name']}: {key}", theirs[key], ours[key])
        for key in ("voxel_size", "origin"):
            findings.same(f"{ours['name']}: {key}", theirs[key], ours[key], 1e-12 * theirs["voxel_size"][0])
        findings.same(f"{ours['name']}: background", theirs["background"], ours["background"])
        for corner, other in zip(theirs["bbox"], ours["bbox"]):
            findings.same(f"{ours['name']}: box", corner, other)


def against_report(path, grids, report, findings):
    """report.json of the run: in the recipe's unit, while the file may be in another."""
    surface = next(g for g in grids if g["class"] == "level set")
    output = next(o for o in report["outputs"] if os.path.basename(o["path"]) == os.path.basename(path))
    unit = surface["metadata"]["druse.unit"]
    findings.same("unit", unit, output["unit"])
    findings.same("content hash", surface["metadata"]["druse.content_hash"], output["content_hash"])
    findings.same("active voxels", surface["active_voxels"], report["band"]["active_voxels"])
    factor = METRES[report["unit"]] / METRES[unit]
    size = report["band"]["voxel_size"] * factor
    findings.same("voxel size", surface["voxel_size"], [size] * 3, 1e-9 * size)
    findings.same("background", surface["background"], report["band"]["half_width"] * size, 1e-5 * size)
    # The band reaches as far beyond the solid as it is wide.
    reach = (report["band"]["half_width"] + 1) * size
    for corner, voxel in zip(report["solid"]["box"], surface["bbox"]):
        findings.same("box", [v * size for v in voxel], [c * factor for c in corner], reach)


def conventions(grids, findings):
    """What readers of .vdb expect, whoever wrote it."""
    for grid in grids:
        findings.same(f"{grid['name']}: creator", grid["metadata"]["creator"].startswith("druse/"), True)
        x, y, z = grid["voxel_size"]
        findings.same(f"{grid['name']}: cubic voxels", x == y == z, True)
        findings.same(f"{grid['name']}: known class", grid["class"] in ("level set", "fog volume", "unknown"), True)


def against_vdb_print(path, grids, findings):
    """The command line tool lists every grid with its class and voxels."""
    listing = subprocess.run(["vdb_print", "-m", path], capture_output=True, text=True, check=True).stdout
    for grid in grids:
        for text in (grid["name"], grid["class"], f"file_voxel_count: {grid['active_voxels']}"):
            findings.same(f"vdb_print has {text!r}", text in listing, True)


def main():
    path = sys.argv[1]
    found, metadata = vdb.readAll(path)
    grids = [describe(grid) for grid in found]
    findings = Findings()
    conventions(grids, findings)
    if shutil.which("vdb_print"):
        against_vdb_print(path, grids, findings)
    if len(sys.argv) > 2:
        with open(sys.argv[2]) as file:
            ours = json.load(file)
        if "grids" in ours:
            against_info(grids, ours, findings)
        else:
            against_report(path, grids, ours, findings)
    print(json.dumps({"metadata": {k: str(v) for k, v in metadata.items()}, "grids": grids}, indent=1))
    for line in findings:
        print(f"{path}: {line}", file=sys.stderr)
    sys.exit(1 if findings else 0)


if __name__ == "__main__":
    main()
