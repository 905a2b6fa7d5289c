"""The same meshes in every format that gmsh (and meshio, where it is there) writes: what Druse finds in each.

    python3 scaffold_formats.py DRUSE [GMSH]

Needs Debian's gmsh, the program. Each model is a block of known volume; its elements are counted in gmsh's own text
of version 2.2 by the few lines here. Prints a table; a row fails if counts, volume, groups or the number of skipped
elements differ, or if Druse refuses the file.
"""

import json
import math
import pathlib
import subprocess
import sys
import tempfile

KINDS = {4: "Tet4", 5: "Hex8", 6: "Wedge6", 7: "Pyramid5", 11: "Tet10", 17: "Hex20", 18: "Wedge15", 19: "Pyramid13",
         2: "Tri3", 3: "Quad4", 9: "Tri6", 16: "Quad8"}
SOLID = ("Tet", "Hex", "Wedge", "Pyramid")

# Two blocks of volumes 1 and 2 that share a face, as groups "one", "two" and "both"; a face in the group "floor".
BLOCKS = """
SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 1, 1, 1}; Box(2) = {1, 0, 0, 2, 1, 1};
BooleanFragments{ Volume{1}; Delete; }{ Volume{2}; Delete; }
MeshSize{:} = 0.6;
Physical Volume("one", 11) = {1}; Physical Volume("two", 12) = {2}; Physical Volume("both", 13) = {1, 2};
Physical Surface("floor", 14) = {5};
"""
# The same by layers upon a plane: of triangles they make wedges, of quads hexes.
LAYERS = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1}; Rectangle(2) = {1, 0, 0, 2, 1};
BooleanFragments{ Surface{1}; Delete; }{ Surface{2}; Delete; }
%s
Extrude {0, 0, 1} { Surface{1, 2}; Layers{2}; Recombine; }
Physical Volume("one", 11) = {1}; Physical Volume("two", 12) = {2};
"""
QUADS = "Transfinite Curve{:} = 3; Transfinite Surface{:}; Recombine Surface{:};"
TRIANGLES = "MeshSize{:} = 0.6;"
PLANE = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 1, 1}; Rectangle(2) = {1, 0, 0, 2, 1};
BooleanFragments{ Surface{1}; Delete; }{ Surface{2}; Delete; }
MeshSize{:} = 0.4;
Physical Surface("one", 11) = {1}; Physical Surface("two", 12) = {2};
"""
# A hex with a pyramid on it, a wedge and a tet beside it, their skins left out.
ZOO = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
12
1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n5 0 0 1\n6 1 0 1\n7 1 1 1\n8 0 1 1\n9 2 0 0\n10 2 0 1\n11 .5 .5 2\n12 2 2 0
$EndNodes
$Elements
4
1 5 2 1 1 1 2 3 4 5 6 7 8
2 6 2 2 2 2 9 3 6 10 7
3 7 2 3 3 5 6 7 8 11
4 4 2 4 4 9 12 3 7
$EndElements
"""

# Name, geometry, dimension, order, volume (of a plane none).
MODELS = [
    ("tets", BLOCKS, 3, 1, 3.0),
    ("tets of order 2", BLOCKS, 3, 2, 3.0),
    ("hexes", LAYERS % QUADS, 3, 1, 3.0),
    ("hexes of order 2", LAYERS % QUADS, 3, 2, 3.0),
    ("wedges", LAYERS % TRIANGLES, 3, 1, 3.0),
    ("wedges of order 2", LAYERS % TRIANGLES, 3, 2, 3.0),
    ("plane", PLANE, 2, 1, None),
    ("plane of order 2", PLANE, 2, 2, None),
    ("zoo", 'Merge "zoo.msh";\n', 0, 1, 1 + 1 / 2 + 1 / 3 + 1 / 3),
    ("zoo of order 2", 'Merge "zoo.msh"; SetOrder 2;\n', 0, 1, 1 + 1 / 2 + 1 / 3 + 1 / 3),
]

# File, what gmsh is told before it is written.
FILES = [
    ("v22.msh", "Mesh.MshFileVersion = 2.2; Mesh.Binary = 0;"),
    ("v22_binary.msh", "Mesh.MshFileVersion = 2.2; Mesh.Binary = 1;"),
    ("v1.msh", "Mesh.MshFileVersion = 1; Mesh.Binary = 0;"),
    ("v40.msh", "Mesh.MshFileVersion = 4.0;"),
    ("v41.msh", "Mesh.MshFileVersion = 4.1;"),
    ("v41_binary.msh", "Mesh.MshFileVersion = 4.1; Mesh.Binary = 1;"),
    ("v41_binary_parametric.msh", "Mesh.SaveParametric = 1;"),
    ("v22_binary_parametric.msh", "Mesh.MshFileVersion = 2.2;"),
    ("v22_parametric.msh", "Mesh.Binary = 0;"),
    ("v40_parametric.msh", "Mesh.MshFileVersion = 4.0;"),
    ("a.unv", "Mesh.SaveParametric = 0;"),
    ("a.mesh", ""),
    ("a.inp", ""),
    ("free.bdf", "Mesh.BdfFieldFormat = 0;"),
    ("small.bdf", "Mesh.BdfFieldFormat = 1;"),
    ("large.bdf", "Mesh.BdfFieldFormat = 2;"),
]


def left_out(file, name):
    """Whether gmsh itself cannot write this model in this format: it leaves elements out, or their order."""
    return (file.endswith(".mesh") and (name.startswith(("wedges", "zoo", "hexes of", "plane of")))
            or file.endswith((".unv", ".inp")) and name.startswith("zoo")
            or file.endswith(".bdf") and name == "zoo of order 2"  # its pyramids are not in Nastran's order
            or file.startswith("v1.") and "order 2" in name)


def write(directory, gmsh, geometry, dimension, order):
    """All files of a model, by one run of gmsh."""
    (directory / "zoo.msh").write_text(ZOO)
    script = f"Mesh.ElementOrder = {order}; Mesh.SecondOrderIncomplete = 1;\n" + geometry
    script += f"Mesh {dimension};\n" if dimension else ""
    script += "".join(f'{options} Save "{file}";\n' for file, options in FILES)
    (directory / "model.geo").write_text(script)
    subprocess.run([gmsh, "model.geo", "-0", "-v", "1", "-nt", "1"], cwd=directory, check=True,
                   stdout=subprocess.DEVNULL, timeout=120)


def counted(path):
    """Elements by kind, of physical groups and of entities, in a text of version 2.2."""
    lines = path.read_text().splitlines()
    start = lines.index("$Elements")
    seen, kinds, physical, entities = {}, {}, {}, {}
    for line in lines[start + 2:lines.index("$EndElements")]:
        words = [int(w) for w in line.split()]
        kind, tags, nodes = KINDS.get(words[1]), words[3:3 + words[2]], tuple(words[3 + words[2]:])
        if nodes not in seen:  # once for each group that it is in
            seen[nodes] = kind
            kinds[kind] = kinds.get(kind, 0) + 1
            entities[kind, tags[1]] = entities.get((kind, tags[1]), 0) + 1
        physical[kind, tags[0]] = physical.get((kind, tags[0]), 0) + 1
    solids = {k: n for k, n in kinds.items() if k and k.startswith(SOLID)} or {k: n for k, n in kinds.items() if k}
    sizes = [sorted(n for (kind, tag), n in groups.items() if kind in solids and tag) for groups in (physical, entities)]
    return solids, sizes, sum(kinds.values()) - sum(solids.values())


def ours(druse, path):
    run = subprocess.run([druse, "scaffold", "info", "--json", path], capture_output=True, text=True)
    answer = json.loads(run.stdout or run.stderr)
    return answer if run.returncode == 0 else {"error": answer.get("error", answer).get("message", "?")}


def compare(found, file, solids, sizes, volume):
    """What is wrong with an answer."""
    if "error" in found:
        return found["error"]
    if found["elements"] != solids:
        return f"{found['elements']}, not {solids}"
    if volume is not None and not math.isclose(found["volume"], volume, rel_tol=1e-5):
        return f"volume {found['volume']}, not {volume}"
    if found.get("inverted"):
        return f"{len(found['inverted'])} inverted elements"
    # gmsh rounds the coordinates of these decks, so mid nodes lie a little beside the middle.
    if found.get("curved") and not file.endswith(".bdf"):
        return f"{found['curved']} curved elements: mid nodes in another order"
    groups = sorted(g["elements"] for g in found["groups"] if not g["name"].startswith("PhysicalVolume0"))
    # These formats carry one number for each element: gmsh writes its entity.
    if file.endswith(".inp"):
        sizes = [sorted(sizes[0] + sizes[1])] * 2  # sets of both
    wanted = sizes[1] if file.endswith((".bdf", ".mesh", ".meshb")) else sizes[0]
    if groups != wanted:
        return f"groups of {groups} elements, not {wanted}"
    return ""


def by_meshio(directory):
    """Files that meshio writes of gmsh's, if it is there."""
    try:
        import meshio
    except ImportError:
        return []
    try:
        mesh = meshio.read(directory / "v22.msh")
    except KeyError as e:  # it knows no wedges of order 2
        print(f"    meshio does not know {e}")
        return []
    known = {"tetra", "hexahedron", "wedge", "pyramid", "triangle", "quad", "tetra10", "hexahedron20"}
    tags = mesh.cell_data["gmsh:geometrical"]
    kept = [i for i, c in enumerate(mesh.cells) if c.type in known]
    files = []
    if not kept:
        return files
    for file, key in (("meshio.bdf", "nastran:ref"), ("meshio.mesh", "medit:ref"), ("meshio.meshb", "medit:ref")):
        if not file.endswith(".bdf") and any(mesh.cells[i].type[-1].isdigit() for i in kept):
            continue
        copy = meshio.Mesh(mesh.points, [mesh.cells[i] for i in kept], cell_data={key: [tags[i] for i in kept]})
        copy.write(directory / file, file_format="nastran" if file.endswith(".bdf") else None)
        files.append(file)
    return files


def main():
    druse, gmsh = sys.argv[1], (sys.argv[2:] or ["gmsh"])[0]
    failed = total = 0
    for name, geometry, dimension, order, volume in MODELS:
        with tempfile.TemporaryDirectory() as temporary:
            directory = pathlib.Path(temporary)
            write(directory, gmsh, geometry, dimension, order)
            solids, sizes, _ = counted(directory / "v22.msh")
            files = [f for f, _ in FILES if not left_out(f, name)]
            wrong = []
            for file in files + by_meshio(directory):
                fault = compare(ours(druse, directory / file), file, solids, sizes, volume)
                total += 1
                if fault:
                    wrong.append(f"{file}: {fault}")
            failed += len(wrong)
            counts = ", ".join(f"{n} {k}" for k, n in solids.items())
            print(f"{name:20} {counts:28} {len(files)} files  {'ok' if not wrong else 'DIFFERS'}")
            print("".join(f"    {w}\n" for w in wrong), end="", flush=True)
    print(f"figure: scaffold formats: {total} files of {len(MODELS)} models, {failed} failed")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
