"""Decks of parts solved by CalculiX: bars and blocks against closed forms.

    python3 voxel_deck.py DRUSE [WORK]

Needs ccx (Debian: calculix-ccx). A bar of 10 x 4 x 3 mm under tension, without and with lateral contraction, and
in shear by prescribed displacements: displacements and reaction forces must be those of the closed form.
"""

import pathlib
import subprocess
import sys
import tempfile

YOUNG, POISSON, STRETCH = 2100.0, 0.3, 0.01
RECIPE = """
druse = 1
unit = "mm"
[band]
voxel_size = 0.5
[[op]]
union = { box = { size = [10, 4, 3], centre = [5, 2, 1.5] } }
[[output]]
fe = "part.inp"
kind = "hex8"
element_size = 1
young = %g
poisson = %g
""" % (YOUNG, POISSON)
SIZE = (10.0, 4.0, 3.0)

TENSION = """*INCLUDE, INPUT=part.inp
*STEP
*STATIC
*BOUNDARY
XMIN, 1, 1
YMIN, 2, 2
ZMIN, 3, 3
XMAX, 1, 1, %g
*NODE PRINT, NSET=XMIN, TOTALS=ONLY
RF
*NODE PRINT, NSET=YMAX
U
*END STEP
""" % (STRETCH * SIZE[0])

SHEAR = """*INCLUDE, INPUT=part.inp
*STEP
*STATIC
*BOUNDARY
ALL_NODES, 2, 3
XMIN, 1, 1
XMAX, 1, 1, %g
*NODE PRINT, NSET=XMIN, TOTALS=ONLY
RF
*END STEP
""" % (STRETCH * SIZE[0])


def solve(work, name, text):
    """Numbers printed by ccx: the sum of reaction forces, and rows of displacements."""
    (work / f"{name}.inp").write_text(text)
    run = subprocess.run(["ccx", name], cwd=work, capture_output=True, text=True, timeout=120)
    printed = work / f"{name}.dat"
    if run.returncode or not printed.exists():
        sys.exit(f"ccx failed: {run.stdout[-800:]}")
    force, rows, kind = None, [], None
    for line in printed.read_text().splitlines():
        if "total force" in line:
            kind = "force"
        elif "displacements" in line:
            kind = "rows"
        elif line.split():
            numbers = [float(w) for w in line.split()]
            if kind == "force":
                force = numbers
            elif kind == "rows":
                rows.append(numbers)
    return force, rows


def check(name, found, expected, tolerance=1e-4):
    error = abs(found / expected - 1)
    print(f"{name:40} {found:12.6g} {expected:12.6g} {error:9.1e}")
    if not error < tolerance:
        sys.exit(f"{name}: {found}, expected {expected}")


def main():
    druse = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as scratch:
        work = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else scratch)
        work.mkdir(parents=True, exist_ok=True)
        (work / "part.toml").write_text(RECIPE)
        subprocess.run([druse, "run", "part.toml", "-q"], cwd=work, check=True)
        area = SIZE[1] * SIZE[2]
        force, rows = solve(work, "tension", TENSION)
        check("bar: reaction, E strain A", -force[0], YOUNG * STRETCH * area)
        check("bar: contraction, nu strain width", -rows[0][2], POISSON * STRETCH * SIZE[1])
        force, _ = solve(work, "confined", SHEAR)
        confined = YOUNG * (1 - POISSON) / ((1 + POISSON) * (1 - 2 * POISSON))
        check("confined bar: reaction, M strain A", -force[0], confined * STRETCH * area)


if __name__ == "__main__":
    main()
