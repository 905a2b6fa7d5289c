"""Who reads what Druse writes: one row a client and format, as a table on stdout.

    /usr/bin/python3 matrix.py DRUSE PART.vdb REPORT.json WORK [PYTHON]

PART.vdb and REPORT.json are outputs of one run. Every mesh format is made from the .vdb by `druse mesh`. Exits with 1
when a client that is installed fails; clients that are missing are named, with their package. PYTHON is one that
has pyvista and usd-core.
"""

import concurrent.futures
import json
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as tree
import zipfile

HERE = os.path.dirname(os.path.abspath(__file__))
MILLIMETRES = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "ft": 304.8}
workers = concurrent.futures.ThreadPoolExecutor(os.cpu_count())
rows, failed = [], []


def row(client, what, package, *command, expect=None):
    """Runs a client beside others; its exit code and, if asked for, a pattern in what it prints decide."""

    def verdict():
        if shutil.which(command[0]) is None:
            return f"not installed ({package})"
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        text = done.stdout + done.stderr
        if done.returncode == 0 and (expect is None or re.search(expect, text)):
            return "reads it"
        failed.append(client)
        print(f"{client}: exit code {done.returncode}\n{text[-2000:]}", file=sys.stderr)
        return "FAILS"

    rows.append((client, what, workers.submit(verdict)))
    return rows[-1][2]


def known(client, what, verdict):
    """A row that needs no client to be run."""
    rows.append((client, what, concurrent.futures.Future()))
    rows[-1][2].set_result(verdict)


def volume_of_3mf(path):
    """Volume in cubic millimetres by a reader that shares nothing with Druse's: zipfile and ElementTree."""
    with zipfile.ZipFile(path) as archive:
        model = tree.fromstring(archive.read("3D/3dmodel.model"))
    space = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    scale = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "meter": 1000.0, "inch": 25.4, "foot": 304.8}
    points = [tuple(float(v.get(c)) for c in "xyz") for v in model.iter(space + "vertex")]
    total = 0.0
    for triangle in model.iter(space + "triangle"):
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (points[int(triangle.get(k))] for k in ("v1", "v2", "v3"))
        total += ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    return total / 6 * scale[model.get("unit", "millimeter")] ** 3


def main():
    druse, part, report, work = sys.argv[1:5]
    viewer = sys.argv[5] if len(sys.argv) > 5 else None
    os.makedirs(work, exist_ok=True)
    at = lambda name: os.path.join(work, name)
    python = "/usr/bin/python3"
    row("Blender: load, mesh, volume, render", ".vdb", "blender", "blender", "-b", "--factory-startup", "-t", "2",
        "--python-exit-code", "3", "--python", os.path.join(HERE, "vdb_blender.py"), "--", part, at("blender.png"), report)
    row("pyopenvdb", ".vdb", "python3-openvdb", python, os.path.join(HERE, "vdb_pyopenvdb.py"), part, report)
    row("vdb_print", ".vdb", "libopenvdb-tools", "vdb_print", "-l", part, expect="level set")
    row("vdb_render", ".vdb", "libopenvdb-tools", "vdb_render", part, at("render.png"), "-res", "160x120")
    row("vdb_tool", ".vdb", "libopenvdb-tools", "vdb_tool", "-read", part, "-ls2mesh", "-write", at("tool.ply"))
    shaded = row("pyopenvdb: grids to shade by", ".vdb", "python3-openvdb", python, os.path.join(HERE, "grids_pyopenvdb.py"),
        druse, work, expect="8 grids")
    shaded.result()  # what the clients after it read
    row("Blender: grids to shade by", ".vdb", "blender", "blender", "-b", "--factory-startup", "-t", "2",
        "--python-exit-code", "3", "--python", os.path.join(HERE, "grids_blender.py"), "--",
        os.path.abspath(at("shaded.vdb")), "surface", "density", "cell_id", "element_id", "weight_b", "thickness", "uvw",
        "fold")
    if viewer:
        row("USD's library", ".usda", "PyPI usd-core", viewer, os.path.join(HERE, "usda_pxr.py"), at("shaded.usda"),
            expect="8 fields")
    row("nanovdb_validate", ".nvdb", "libnanovdb-tools", "nanovdb_validate", at("shaded.nvdb"))
    row("nanovdb_print", ".nvdb", "libnanovdb-tools", "nanovdb_print", at("shaded.nvdb"), expect="uvw")
    # Built beside Druse: it links a Blosc of its own.
    row("crate vdb-rs", ".vdb", "Rust", "cargo", "run", "--quiet", "--release", "--manifest-path",
        os.path.join(HERE, "vdb_rs", "Cargo.toml"), "--target-dir", at("vdb_rs"), "--", at("shaded.vdb"),
        expect=r"surface [1-9]\d+ voxels")
    with open(report, encoding="utf-8") as file:
        said = json.load(file)
    millimetres = MILLIMETRES[said["unit"]]
    solid = said["solid"]["volume"] * millimetres**3
    stated = at("millimetres.json")
    with open(stated, "w", encoding="utf-8") as file:
        json.dump({"solid": {"volume": solid}}, file)
    for extension in ("stl", "ply", "obj", "3mf"):
        mesh = at("part." + extension)
        subprocess.run([druse, "mesh", part, "-o", mesh, "-q"], check=True, stdout=subprocess.DEVNULL)
        if extension == "3mf":
            off = abs(volume_of_3mf(mesh) / solid - 1)
            known("Python's zipfile and ElementTree", ".3mf", "reads it" if off < 0.005 else "FAILS")
            if off >= 0.005:
                failed.append(f"3mf: off by {off}")
        elif viewer:
            row("pyvista", "." + extension, "PyPI pyvista", viewer, os.path.join(HERE, "mesh_pyvista.py"), mesh,
                "--report", stated)
        else:
            known("pyvista", "." + extension, "not installed (PyPI pyvista)")
    width = max(len(r[0]) for r in rows)
    for client, what, verdict in rows:
        print(f"{client:{width}}  {what:5}  {verdict.result()}")
    sys.exit(f"failed: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
