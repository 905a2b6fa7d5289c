"""Meshes that nobody here wrote: Druse's counts of elements against those of meshio and pyvista.

    python3 foreign_meshes.py DRUSE [DIRECTORY]

Needs meshio, pyvista, gmsh and, for the packages' data, Debian's apt-get (packages are unpacked below
DIRECTORY, not installed). Formats that Druse does not read are converted by meshio to .vtu first. Prints a
table; a row fails if counts differ, or if Druse refuses a mesh of kinds that it fills without saying which
element is at fault.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import meshio

KINDS = {
    "tetra": "Tet4", "tetra10": "Tet10", "hexahedron": "Hex8", "hexahedron20": "Hex20",
    "hexahedron27": "Hex27", "wedge": "Wedge6", "wedge15": "Wedge15", "wedge18": "Wedge18",
    "pyramid": "Pyramid5", "triangle": "Tri3", "triangle6": "Tri6", "quad": "Quad4",
    "quad8": "Quad8", "quad9": "Quad9",
}
SOLID = ("Tet", "Hex", "Wedge", "Pyramid")
PACKAGES = ["python3-sfepy", "calculix-ccx-test", "netgen-doc"]


def unpack(directory):
    """The packages' files, downloaded once."""
    for package in PACKAGES:
        target = directory / package
        if not target.exists():
            subprocess.run(["apt-get", "download", package], cwd=directory, check=True, capture_output=True)
            archive = next(directory.glob(f"{package}_*.deb"))
            subprocess.run(["dpkg-deb", "-x", archive, target], check=True)
    return directory


def expected(mesh):
    """Counts by Druse's kinds: the solids if there are any, else the planar elements."""
    counts = {}
    for block in mesh.cells:
        if block.type in KINDS:
            kind = KINDS[block.type]
            counts[kind] = counts.get(kind, 0) + len(block.data)
    solids = {k: n for k, n in counts.items() if k.startswith(SOLID)}
    return solids or counts


def ours(druse, path):
    run = subprocess.run([druse, "scaffold", "info", "--json", path], capture_output=True, text=True)
    answer = json.loads(run.stdout or run.stderr)
    if run.returncode == 0:
        return answer["elements"], ""
    return None, answer.get("error", answer).get("message", "?")


def deck_counts(path):
    """Elements of an Abaqus deck by number of lines that begin one, counted without any reader."""
    nodes = {"C3D4": 4, "C3D10": 10, "C3D8": 8, "C3D20": 20, "C3D6": 6, "C3D15": 15}
    counts, numbers, kind = {}, 0, None
    for line in path.read_text(errors="replace").splitlines():
        line = line.strip()
        if line.startswith("**") or not line:
            continue
        if line.startswith("*"):
            words = [w.strip().upper() for w in line.split(",")]
            kind, numbers = None, 0
            if words[0].replace(" ", "") == "*ELEMENT":
                name = next(w.split("=")[1].strip() for w in words if w.startswith("TYPE"))
                kind = next((k for k in sorted(nodes, key=len, reverse=True) if name.startswith(k)), None)
                kind = None if kind is None or name[len(kind):][:1].isdigit() else kind
        elif kind:
            numbers += len([w for w in line.split(",") if w.strip()])
            if numbers == nodes[kind] + 1:
                ours_kind = KINDS[{4: "tetra", 10: "tetra10", 8: "hexahedron", 20: "hexahedron20", 6: "wedge",
                                   15: "wedge15"}[nodes[kind]]]
                counts[ours_kind] = counts.get(ours_kind, 0) + 1
                numbers = 0
    return counts


def main():
    druse = sys.argv[1]
    temporary = tempfile.TemporaryDirectory()
    directory = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else temporary.name)
    unpack(directory)
    rows = []

    for path in sorted((directory / "python3-sfepy").rglob("meshes/**/*")):
        if path.suffix not in (".mesh", ".vtk", ".msh", ".inp", ".txt", ".hmascii", ".h5"):
            continue
        try:
            mesh = meshio.read(path)
        except (Exception, SystemExit) as e:  # meshio ends the program on some files
            rows.append((path.name, "-", "-", f"meshio: {type(e).__name__}"))
            continue
        converted = pathlib.Path(temporary.name) / (path.stem + path.suffix.replace(".", "_") + ".vtu")
        if path.suffix != ".vtk":
            if len(mesh.points[0]) == 2:
                mesh.points = [[*p, 0.0] for p in mesh.points]
            meshio.Mesh(mesh.points, mesh.cells).write(converted)
            path = converted
        rows.append((path.name, expected(mesh), *ours(druse, path)))

    from pyvista import examples
    for name in ("hexbeamfile", "tetbeamfile"):
        path = getattr(examples, name, None) or pathlib.Path(examples.dir_path) / name.replace("file", ".vtk")
        if pathlib.Path(path).exists():
            rows.append((pathlib.Path(path).name, expected(meshio.read(path)), *ours(druse, path)))

    decks = []
    for path in sorted((directory / "calculix-ccx-test").rglob("*.inp*")):
        plain = path
        if path.suffix == ".gz":
            import gzip
            plain = pathlib.Path(temporary.name) / path.stem
            plain.write_bytes(gzip.decompress(path.read_bytes()))
        counts = deck_counts(plain)
        if counts and any(k in counts for k in ("Hex20", "Tet10")):
            decks.append((plain, counts))
    for path, counts in decks[:: max(1, len(decks) // 12)]:
        rows.append((path.name, counts, *ours(druse, path)))

    import gmsh
    gmsh.initialize(["gmsh", "-v", "0"])
    for step in sorted((directory / "netgen-doc").rglob("*.step*")):
        source = step
        if step.suffix == ".gz":
            import gzip
            source = pathlib.Path(temporary.name) / step.stem
            source.write_bytes(gzip.decompress(step.read_bytes()))
        for order in (1, 2):
            gmsh.clear()
            gmsh.open(str(source))
            gmsh.option.setNumber("Mesh.MeshSizeMax", 20)
            gmsh.option.setNumber("Mesh.ElementOrder", order)
            try:
                gmsh.model.mesh.generate(3)
            except Exception as e:
                rows.append((f"{source.stem}.{order}.msh", "-", "-", f"gmsh: {e}"))
                continue
            path = pathlib.Path(temporary.name) / f"{source.stem}.{order}.msh"
            gmsh.write(str(path))
            rows.append((path.name, expected(meshio.read(path)), *ours(druse, path)))
    gmsh.finalize()

    failed = 0
    for name, theirs, mine, error in rows:
        if theirs == "-":
            verdict = "not read elsewhere"
        elif mine is not None:
            verdict = "ok" if mine == theirs else "DIFFERS"
        else:
            verdict = "refused"
        failed += verdict == "DIFFERS" or (verdict == "refused" and not error)
        print(f"{name:32} {verdict:18} {theirs if mine != theirs else mine}  {'' if mine == theirs else error or mine}")
    print(f"{len(rows)} meshes, {sum(1 for r in rows if r[2] == r[1])} with equal counts, {failed} failed")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
