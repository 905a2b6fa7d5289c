"""Decks of scaffolds with homogenised cells, solved by CalculiX, against closed forms and resolved decks.

    python3 macro_deck.py DRUSE [WORK]

Needs ccx (Debian: calculix-ccx). A bar of solid cells obeys E A strain, in hexes, tets and the curved hexes of a
cylinder. Confined bars of Schwarz P have the reactions of the deck of their voxels. A scaffold of bricks that is
turned as a whole has the same energy under a strain that turns with it. Stresses and displacements in the .frd are
those that ccx prints, and `druse grade` reads them: its stress in the solid is the printed one over the fraction.
"""

import json
import math
import pathlib
import subprocess
import sys
import tempfile

YOUNG, POISSON, DENSITY, STRETCH = 2100.0, 0.3, 7.8e-9, 0.01
CONFINED = YOUNG * (1 - POISSON) / ((1 + POISSON) * (1 - 2 * POISSON))
MATERIAL = f"young = {YOUNG}\npoisson = {POISSON}\ndensity = {DENSITY}\n"
SOLID = '[cell.c]\nsurface = "schwarz_p"\nlevel = 9\n'
HEADER = 'druse = 1\nunit = "mm"\n[band]\nvoxel_size = {h}\n'


def run(command, work):
    done = subprocess.run(command, cwd=work, capture_output=True, text=True, timeout=300)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}: {done.stdout[-800:]}{done.stderr[-800:]}")
    return done.stdout


def deck(druse, work, name, text):
    (work / f"{name}.toml").write_text(text)
    return json.loads(run([druse, "run", f"{name}.toml", "-q", "--json"], work))


def solve(work, name, text):
    """Blocks of numbers that ccx prints, by the first words of their titles."""
    (work / f"{name}.inp").write_text(text)
    run(["ccx", name], work)
    blocks, rows = {}, None
    for line in (work / f"{name}.dat").read_text().splitlines():
        words = line.split()
        if words and words[0][0].isalpha():
            rows = blocks.setdefault(line.split(" (")[0].split(" for ")[0].strip(), [])
        elif words:
            rows.append([float(w) for w in words if w[0] in "-.0123456789"])
    return blocks


def nodes_of(path):
    nodes, reads = {}, False
    for line in path.read_text().splitlines():
        if line.startswith("*"):
            reads = line.startswith("*NODE,")
        elif reads:
            words = line.split(",")
            nodes[int(words[0])] = tuple(float(w) for w in words[1:4])
    return nodes


def check(name, found, expected, tolerance):
    error = abs(found / expected - 1)
    print(f"{name:58} {found:12.6g} {expected:12.6g} {error:9.1e}")
    if not error < tolerance:
        sys.exit(f"{name}: {found}, expected {expected}")


def bars(druse, work):
    """Bars of solid cells: tension with free sides."""
    shapes = {
        "hexes": ('box = { size = [10, 4, 3], cell_size = 1 }', 0, 12.0, 10.0),
        "tets": ('box = { size = [10, 4, 3], cell_size = 1, kind = "tet" }', 0, 12.0, 10.0),
        "curved hexes": ("cylinder = { radius = 3, height = 8, cell_size = 2 }", 2, math.pi * 9, 8.0),
    }
    for name, (shape, axis, area, length) in shapes.items():
        word = name.replace(" ", "_")
        cell = SOLID if "tet" not in word else '[cell.c]\nformula = "hypot(x, y, z) - 0.4"\nelement = "tet"\nband_limit = 2\nlevel = 9\n'
        text = f'{HEADER.format(h=0.5)}{cell}[scaffold]\n{shape}\n[tiling]\ncell = "c"\n' \
               f'[[output]]\nfe = "{word}.inp"\nresolution = 8\n{MATERIAL}'
        facts = deck(druse, work, f"{word}_recipe", text)["outputs"][0]["macro_deck"]
        check(f"{name}: volume of the elements", facts["volume"], area * length, 1e-3)
        check(f"{name}: mass", facts["mass"], DENSITY * area * length, 1e-3)
        side, upper = ["XMIN", "YMIN", "ZMIN"][axis], ["XMAX", "YMAX", "ZMAX"][axis]
        other = [a for a in range(3) if a != axis]
        nodes = nodes_of(work / f"{word}.inp")
        ends = [n for n, p in nodes.items() if abs(p[axis] - min(q[axis] for q in nodes.values())) < 1e-6]
        # A node on the axis, or a corner, and one beside it hold the bar without force.
        first = min(ends, key=lambda n: sum(abs(nodes[n][a]) for a in other))
        second = max(ends, key=lambda n: (-abs(nodes[n][other[1]] - nodes[first][other[1]]),
                                          nodes[n][other[0]]))
        found = solve(work, f"{word}_tension", f"""*INCLUDE, INPUT={word}.inp
*STEP
*STATIC
*BOUNDARY
{side}, {axis + 1}, {axis + 1}
{upper}, {axis + 1}, {axis + 1}, {STRETCH * length}
{first}, {other[0] + 1}, {other[0] + 1}
{first}, {other[1] + 1}, {other[1] + 1}
{second}, {other[1] + 1}, {other[1] + 1}
*NODE PRINT, NSET={side}, TOTALS=ONLY
RF
*END STEP
""")
        force = abs(found["total force"][0][axis])
        check(f"{name}: reaction, E strain A", force, YOUNG * STRETCH * area, 2e-3)


CONFINE = """*INCLUDE, INPUT=%s.inp
*STEP
*STATIC
*BOUNDARY
XMIN, 1, 1
YMIN, 2, 2
YMAX, 2, 2
ZMIN, 3, 3
ZMAX, 3, 3
XMAX, 1, 1, %g
*NODE PRINT, NSET=XMIN, TOTALS=ONLY
RF
*NODE PRINT, NSET=YMIN, TOTALS=ONLY
RF
*NODE PRINT, NSET=XMAX
U
*EL PRINT, ELSET=%s
S
*NODE FILE
U
*EL FILE
S, ENER
*END STEP
"""


def resolved(druse, work):
    """Schwarz P of volume fraction 0.4 in a bar of cubes, as macro deck and as voxels; the same graded."""
    for name, grading, cells in (("uniform", "0.4", 1), ("graded", '"0.35 + 0.1*bx"', 2)):
        common = f'{HEADER.format(h=0.05)}[cell.c]\nsurface = "schwarz_p"\n' \
                 f"[scaffold]\nbox = {{ size = [{cells}, 1, 1], cell_size = 1 }}\n" \
                 f'[tiling]\ncell = "c"\nvolume_fraction = {grading}\n'
        macro = common + f'[[output]]\nfe = "{name}_macro.inp"\nresolution = 24\n{MATERIAL}'
        facts = deck(druse, work, f"{name}_macro_recipe", macro)["outputs"][0]["macro_deck"]
        voxels = common + f'[[output]]\nfe = "{name}_voxels.inp"\nkind = "hex8"\n{MATERIAL}'
        part = deck(druse, work, f"{name}_voxel_recipe", voxels)["outputs"][0]["deck"]
        check(f"Schwarz P, {name}: volume of the solid", facts["solid_volume"], part["volume"], 0.025)
        forces = {}
        for kind, elements in (("macro", "ALL_ELEMENTS"), ("voxels", "SOLID")):
            file = f"{name}_{kind}"
            found = solve(work, f"{file}_load", CONFINE % (file, STRETCH * cells, elements))
            forces[kind] = [found["total force"][0][0], found["total force"][1][1]]
        # Over two cells a gradient and a cell are of one size: the law of the cell holds less well there.
        limit, sideways = (0.04, 0.05) if name == "uniform" else (0.12, 0.2)
        check(f"Schwarz P, {name}: reaction, macro and resolved", forces["macro"][0], forces["voxels"][0], limit)
        check(f"Schwarz P, {name}: sideways reaction", forces["macro"][1], forces["voxels"][1], sideways)


def turned(druse, work):
    """Bricks of a layered cell, turned as a whole, under a strain that turns with them."""
    strain = [[0.004, 0.001, -0.002], [0.001, -0.003, 0.0015], [-0.002, 0.0015, 0.002]]
    a, b = 0.5, 0.3
    about_z = [[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]]
    about_x = [[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]]
    product = lambda p, q: [[sum(p[i][k] * q[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
    transpose = lambda m: [list(r) for r in zip(*m)]
    turn = product(about_z, about_x)
    counts, size = (3, 2, 2), (2.0, 1.0, 1.5)
    number = lambda i, j, k: 1 + i + (counts[0] + 1) * (j + (counts[1] + 1) * k)
    energies = {}
    for name, matrix in (("straight", [[1, 0, 0], [0, 1, 0], [0, 0, 1]]), ("turned", turn)):
        lines = ["*NODE"]
        for k in range(counts[2] + 1):
            for j in range(counts[1] + 1):
                for i in range(counts[0] + 1):
                    p = [size[0] * i, size[1] * j, size[2] * k]
                    p = [sum(matrix[r][c] * p[c] for c in range(3)) for r in range(3)]
                    lines.append(f"{number(i, j, k)}, " + ", ".join(map(repr, p)))
        lines.append("*ELEMENT, TYPE=C3D8, ELSET=PART A")
        element = 0
        for k in range(counts[2]):
            for j in range(counts[1]):
                for i in range(counts[0]):
                    element += 1
                    corners = [(i, j, k), (i + 1, j, k), (i + 1, j + 1, k), (i, j + 1, k)]
                    corners += [(i, j, k + 1) for i, j, k in corners]
                    lines.append(f"{element}, " + ", ".join(str(number(*c)) for c in corners))
        (work / f"{name}_mesh.inp").write_text("\n".join(lines) + "\n")
        # Plates across z with rods along x: no axis is like another.
        text = f'{HEADER.format(h=0.1)}[cell.c]\nformula = "min(abs(z) - 0.2, hypot(y, z - 0.5) - 0.3)"\n' \
               f'element = "hex"\ngroup = "D2h"\nband_limit = 6\n[scaffold]\nfile = "{name}_mesh.inp"\n[tiling]\ncell = "c"\n' \
               f'[[output]]\nfe = "{name}.inp"\nresolution = 16\n{MATERIAL}'
        facts = deck(druse, work, f"{name}_recipe", text)["outputs"][0]["macro_deck"]
        if max(abs(x / y - 1) for x, y in zip(facts["laws"][0]["aspect"], (1.3867, 0.6934, 1.0400))) > 1e-3:
            sys.exit(f"found the aspect {facts['laws'][0]['aspect']}, expected that of 2 : 1 : 1.5")
        if "PART_A" not in (work / f"{name}.inp").read_text():
            sys.exit("the deck has no set of the scaffold's group")
        own = product(product(matrix, strain), transpose(matrix))
        prescribed = []
        for n, p in nodes_of(work / f"{name}.inp").items():
            u = [sum(own[r][c] * p[c] for c in range(3)) for r in range(3)]
            prescribed += [f"{n}, {r + 1}, {r + 1}, {u[r]!r}" for r in range(3)]
        found = solve(work, f"{name}_strain", f"*INCLUDE, INPUT={name}.inp\n*STEP\n*STATIC\n*BOUNDARY\n"
                      + "\n".join(prescribed) + "\n*EL PRINT, ELSET=ALL_ELEMENTS, TOTALS=ONLY\nELSE\n*END STEP\n")
        energies[name] = found["total internal energy"][0][0]
    check("turned bricks of plates and rods: energy", energies["turned"], energies["straight"], 1e-5)


def frd(druse, work):
    """The .frd of the graded bar beside the .dat, by `druse grade`."""
    text = (work / "graded_macro_load.dat").read_text()
    stresses = {}
    reads = False
    for line in text.splitlines():
        words = line.split()
        if words and words[0][0].isalpha():
            reads = words[0] == "stresses"
        elif words and reads:
            stresses.setdefault(int(words[0]), []).append([float(w) for w in words[2:8]])
    out = json.loads(run([druse, "grade", "graded_macro_recipe.toml", "--results", "graded_macro_load.frd", "--field",
                          "S", "-o", "field.vtu", "--json", "--filter", "0"], work))
    found = 0.0
    for element, rows in stresses.items():
        s = [sum(c) / len(rows) for c in zip(*rows)]
        mises = math.sqrt(((s[0] - s[1]) ** 2 + (s[1] - s[2]) ** 2 + (s[2] - s[0]) ** 2) / 2
                          + 3 * (s[3] ** 2 + s[4] ** 2 + s[5] ** 2))
        found = max(found, mises / (0.35 + 0.1 * (element - 0.5) / 2))
    # Stresses at nodes are means of neighbours.
    check("greatest stress in the solid: .frd and .dat", out["greatest"], found, 0.1)
    check("mass that grade keeps", out["new_solid_volume"], out["solid_volume"], 1e-4)
    again = deck(druse, work, "again", (work / "graded_macro_recipe.toml").read_text().replace(
        '"0.35 + 0.1*bx"', '{ file = "field.vtu", field = "volume_fraction" }'))
    check("mass of the recipe with the new field", again["outputs"][0]["macro_deck"]["solid_volume"],
          out["new_solid_volume"], 2e-3)


def main():
    druse = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as scratch:
        work = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else scratch)
        work.mkdir(parents=True, exist_ok=True)
        bars(druse, work)
        resolved(druse, work)
        turned(druse, work)
        frd(druse, work)


if __name__ == "__main__":
    main()
