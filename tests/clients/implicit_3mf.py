"""lib3mf reads the implicit parts that Druse wrote; their nodes give the values of `druse cell eval`.

    python implicit_3mf.py DRUSE FOLDER
"""

import csv
import io
import json
import math
import pathlib
import random
import subprocess
import sys
import xml.etree.ElementTree as xml
import zipfile

import lib3mf

I = "{http://schemas.3mf.io/3dmanufacturing/implicit/2023/12}"
V = "{http://schemas.3mf.io/3dmanufacturing/volumetric/2022/01}"
CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
EDGE = 4.0


def run(*words):
    return subprocess.run([str(w) for w in words], check=True, capture_output=True, text=True).stdout


def evaluate(function, place):
    """The output `shape` of the graph of nodes at a place."""
    values = {"inputs.pos": place}
    two = {
        "addition": lambda a, b: a + b,
        "subtraction": lambda a, b: a - b,
        "multiplication": lambda a, b: a * b,
        "min": min,
        "max": max,
        "dot": lambda a, b: sum(x * y for x, y in zip(a, b)),
    }
    one = {"cos": math.cos, "abs": abs}
    for node in function:
        kind, name = node.tag.removeprefix(I), node.get("identifier")
        if kind == "in":
            continue
        if kind == "out":
            return values[node[0].get("ref")]
        if kind == "constant":
            values[f"{name}.value"] = float(node.get("value"))
        elif kind == "constvec":
            values[f"{name}.vector"] = [float(node.get(a)) for a in "xyz"]
        else:
            inputs = {r.get("identifier"): values[r.get("ref")] for r in node.find(f"{I}in")}
            ordered = [inputs[letter] for letter in sorted(inputs)]
            values[f"{name}.result"] = (two[kind] if len(ordered) == 2 else one[kind])(*ordered)
    raise AssertionError("a function without an output")


def check(druse, folder, cell, extra, box):
    out = folder / "part.3mf"
    answer = json.loads(run(druse, "cell", "implicit", cell, "-o", out, "--edge", f"{EDGE}mm", "--json", *extra))
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(out))
    assert reader.GetWarningCount() == 0, [reader.GetWarning(n) for n in range(reader.GetWarningCount())]
    levels = model.GetLevelSets()
    assert levels.MoveNext(), "no level set"
    level = levels.GetCurrentLevelSet()
    assert level.GetMeshBBoxOnly() == box
    items = model.GetBuildItems()
    assert items.MoveNext() and items.GetCurrent().GetObjectResource().IsLevelSetObject()

    root = xml.fromstring(zipfile.ZipFile(out).read("3D/3dmodel.model"))
    function = root.find(f".//{I}implicitfunction")
    facts = json.loads(run(druse, "cell", "info", cell, "--json"))
    planar = facts["element"] in ("quad", "tri")
    draw = random.Random(1)
    places = [[draw.uniform(-0.4, 0.4) for _ in range(3)] for _ in range(40)]
    points = folder / "points.csv"
    names = "xy" if planar else "xyz"
    points.write_text("\n".join([",".join(names)] + [",".join(map(repr, p[: len(names)])) for p in places]))
    table = list(csv.DictReader(io.StringIO(run(druse, "cell", "eval", cell, "--points", points))))
    worst = 0.0
    for place, row in zip(places, table):
        phi, level = float(row["phi"]), facts["level"]
        solid = {"below": phi - level, "above": level - phi, "sheet": abs(phi) - level, "channels": level - abs(phi)}
        wanted = solid[facts["solid"]] / facts["gamma"] * EDGE
        worst = max(worst, abs(evaluate(function, [c * EDGE for c in place]) - wanted))
    print(f"{cell} {' '.join(map(str, extra))}: {answer['nodes']} nodes, {answer['bytes']} bytes, error {worst:.1e} mm")
    assert worst < 1e-9
    return root


def refused(druse, *words):
    done = subprocess.run([druse, *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 2 or done.returncode == 3, (words, done)
    assert "expected" in done.stderr, done.stderr


def main():
    druse, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    root = check(druse, folder, "gyroid", ["--repeat", "3,2,1"], True)
    corners = [[float(v.get(a)) for a in "xyz"] for v in root.iter(f"{CORE}vertex")]
    shift = [float(c) for c in root.find(f".//{CORE}item").get("transform").split()[9:]]
    size = [max(c[a] for c in corners) - min(c[a] for c in corners) for a in range(3)]
    assert size == [3 * EDGE, 2 * EDGE, EDGE] and [min(c[a] for c in corners) + shift[a] for a in range(3)] == [0] * 3

    sheet, strut = folder / "sheet.cell", folder / "strut.cell"
    run(druse, "fit", "diamond", "--solid", "sheet", "--level", "0.3", "-o", sheet)
    run(druse, "fit", "examples/bracket/strut.stl", "--element", "tet", "--band-limit", "6", "-o", strut)
    check(druse, folder, sheet, [], True)
    check(druse, folder, strut, ["--repeat", "2,2,2"], True)

    ball = folder / "ball.stl"
    recipe = folder / "ball.toml"
    recipe.write_text('druse = 1\nunit = "mm"\n[band]\nvoxel_size = 0.5\n[[op]]\nunion = { sphere = { radius = 6 } }\n'
                      '[[output]]\nmesh = "ball.stl"\n')
    run(druse, "run", recipe, "--out", folder)
    root = check(druse, folder, "schwarz_p", ["--inside", ball], False)
    assert len(list(root.iter(f"{CORE}triangle"))) > 500

    out = folder / "no.3mf"
    refused(druse, "cell", "implicit", "f_rd", "-o", out, "--edge", "0mm")
    refused(druse, "cell", "implicit", "f_rd", "-o", out, "--edge", "2vx")
    refused(druse, "cell", "implicit", "f_rd", "-o", out, "--edge", "2mm", "--repeat", "2,2")
    refused(druse, "cell", "implicit", "f_rd", "-o", folder / "no.stl", "--edge", "2mm")
    assert not out.exists()


if __name__ == "__main__":
    main()
