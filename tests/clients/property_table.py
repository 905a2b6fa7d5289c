"""The table of the guide: properties of named surfaces and of .cell files at one volume fraction.

    python3 property_table.py DRUSE [X.cell ...] [--resolution N]

Networks are solid below the level, sheets around it. Figures are those of wholly solid or void voxels, relative to
the solid (Poisson's ratio 0.3, void 1e-4), the permeability in squares of the period's edge.
"""

import argparse
import json
import subprocess

SURFACES = ["schwarz_p", "diamond", "gyroid", "iwp", "f_rd"]
FRACTION = 0.3


def properties(druse, cell, flags, resolution):
    command = [druse, "cell", "homogenize", cell, "--sharp", "--resolution", str(resolution), "--json", *flags]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def row(name, kind, found):
    c, k = found["stiffness"], found["permeability"]
    bulk = found["engineering"]["bulk"]
    over = found["over_bounds"]["bulk"]
    return (f"| {name} | {kind} | {bulk:.4f} | {over:.3f} | {c[3][3]:.4f} | {found['engineering']['zener']:.2f} "
            f"| {found['conductivity'][0][0]:.3f} | {k[0][0]:.1e} |")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("druse")
    parser.add_argument("cells", nargs="*")
    parser.add_argument("--resolution", type=int, default=48)
    given = parser.parse_args()
    print("| cell | kind | bulk | of the bound | C44 | Zener | conductivity | permeability |")
    print("|---|---|---|---|---|---|---|---|")
    for name in SURFACES:
        for kind, solid in [("network", "below"), ("sheet", "sheet")]:
            flags = ["--element", "hex", "--solid", solid, "--volume-fraction", str(FRACTION)]
            print(row(f"`{name}`", kind, properties(given.druse, name, flags, given.resolution)), flush=True)
    for path in given.cells:
        cell = json.load(open(path))
        kind = "sheet" if cell["solid"] == "sheet" else "network"
        print(row(cell["name"], kind, properties(given.druse, path, [], given.resolution)), flush=True)


if __name__ == "__main__":
    main()
