"""A bracket graded by its stresses: deck, CalculiX, new thickness, three times; then the part.

    python3 loop.py DRUSE OUT [--turns 3] [--resolution 32] [--part VOXEL_SIZE] [--check]

Needs ccx (Debian: calculix-ccx) and nothing else. The base is held, the bore is pulled along x. At each turn the
macro deck of the recipe is solved, `druse grade` moves solid to where the stress is, and the mass stays. Printed are
mass, greatest stress in the solid, mean of that stress, and compliance (force times displacement). With --check the
program fails unless mass stays and compliance and greatest stress fall.
"""

import argparse
import json
import pathlib
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
RECIPE = HERE / "bracket_loop.toml"
BORE_AXIS, BORE_RADIUS = (0.0, 42.0), 10.0  # y and z, mm
FORCE = 2000.0  # N along x
BOUNDS = "0.5:3"  # mm
GRAMS = 1e6  # per tonne


def run(command, folder):
    done = subprocess.run([str(c) for c in command], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def bore(deck):
    """Numbers of the nodes on the bore."""
    found, reads = [], False
    for line in deck.read_text().splitlines():
        if line.startswith("*"):
            reads = line.startswith("*NODE,")
        elif reads:
            number, _, y, z = (float(w) for w in line.split(","))
            if abs(((y - BORE_AXIS[0]) ** 2 + (z - BORE_AXIS[1]) ** 2) ** 0.5 - BORE_RADIUS) < 0.05:
                found.append(int(number))
    return found


def solve(folder, deck):
    """Solves the deck and returns its compliance, N mm."""
    nodes = bore(folder / deck)
    share = FORCE / len(nodes)
    loads = "\n".join(f"{n}, 1, {share!r}" for n in nodes)
    listed = "\n".join(f"{n}," for n in nodes)
    (folder / "load.inp").write_text(f"""*INCLUDE, INPUT={deck}
*NSET, NSET=BORE
{listed}
*STEP
*STATIC
*BOUNDARY
ZMIN, 1, 3
*CLOAD
{loads}
*NODE PRINT, NSET=BORE
U
*EL FILE
S, ENER
*END STEP
""")
    run(["ccx", "load"], folder)
    rows = [line.split() for line in (folder / "load.dat").read_text().splitlines()]
    moved = [float(r[1]) for r in rows if len(r) == 4 and r[0].isdigit()]
    return share * sum(moved)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("druse", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--resolution", type=int, default=32)
    parser.add_argument("--part", type=float)
    parser.add_argument("--check", action="store_true")
    arguments = parser.parse_args()
    druse = arguments.druse.resolve()
    out = arguments.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    changes, rows = [], []
    print("turn   mass g   greatest stress MPa   mean stress MPa   compliance N mm")
    for turn in range(1, arguments.turns + 2):
        sets = [w for c in [f"output.0.resolution={arguments.resolution}", *changes] for w in ("--set", c)]
        report = json.loads(run([druse, "run", RECIPE, "--out", out, "--quiet", "--json", *sets], out))
        mass = report["outputs"][0]["macro_deck"]["mass"] * GRAMS
        compliance = solve(out, "bracket.inp")
        field = out / f"turn_{turn}.vtu"
        graded = json.loads(run([druse, "grade", RECIPE, "--results", "load.frd", "--field", "S", "-o", field,
                                 "--bounds", BOUNDS, "--quiet", "--json", *sets], out))
        rows.append((mass, graded["greatest"], graded["mean"], compliance))
        label = f"{turn}" if turn <= arguments.turns else "end"
        print(f"{label:>4} {mass:8.2f} {graded['greatest']:21.1f} {graded['mean']:17.2f} {compliance:17.1f}", flush=True)
        if turn <= arguments.turns:
            changes = [f'tiling.thickness={{ file = "{field}", field = "thickness" }}']
    if arguments.part:
        outputs = '[{ vdb = "bracket.vdb", grids = ["surface", "thickness"] }, { picture = "bracket.png" }]'
        run([druse, "run", RECIPE, "--out", out, "--quiet", "--set", f"band.voxel_size={arguments.part}",
             "--set", f"output={outputs}", "--set", changes[0]], out)
        print(out / "bracket.vdb")
    if arguments.check:
        first, last = rows[0], rows[-1]
        for name, holds in (
            ("the mass stays within 1 %", abs(last[0] / first[0] - 1) < 0.01),
            ("the greatest stress falls by a tenth", last[1] < 0.9 * first[1]),
            ("the compliance falls by a tenth", last[3] < 0.9 * first[3]),
        ):
            if not holds:
                sys.exit(f"expected that {name}; found {rows}")


if __name__ == "__main__":
    main()
