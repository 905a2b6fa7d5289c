"""Meshes that nobody here wrote: Druse's counts of elements and volumes against those of other readers.

    python3 foreign_meshes.py DRUSE [--all] [DIRECTORY]

Needs pyvista and Debian's apt-get (packages are unpacked below DIRECTORY, not installed); with --all meshio and
gmsh too. Prints a table. Files of formats that Druse reads are given to it as they are, others as .vtu that
meshio writes. A row fails if counts differ, or if Druse refuses a mesh of kinds that it fills without a reason.
"""

import gzip
import json
import pathlib
import re
import subprocess
import sys
import tempfile

KINDS = {
    "tetra": "Tet4", "tetra10": "Tet10", "hexahedron": "Hex8", "hexahedron20": "Hex20",
    "hexahedron27": "Hex27", "wedge": "Wedge6", "wedge15": "Wedge15", "wedge18": "Wedge18",
    "pyramid": "Pyramid5", "triangle": "Tri3", "triangle6": "Tri6", "quad": "Quad4",
    "quad8": "Quad8", "quad9": "Quad9",
}
SOLID = ("Tet", "Hex", "Wedge", "Pyramid")
OURS = (".vtk", ".vtu", ".msh", ".inp", ".mesh", ".bdf", ".unv")
DECK = {"C3D4": "tetra", "C3D10": "tetra10", "C3D8": "hexahedron", "C3D20": "hexahedron20", "C3D6": "wedge",
        "C3D15": "wedge15"}


def unpack(directory, package):
    """A package's files, downloaded once."""
    target = directory / package
    if not target.exists():
        subprocess.run(["apt-get", "download", package], cwd=directory, check=True, capture_output=True)
        archive = next(directory.glob(f"{package}_*.deb"))
        subprocess.run(["dpkg-deb", "-x", archive, target], check=True)
    return target


def plain(path, directory):
    """The path of a file without gzip around it."""
    if path.suffix != ".gz":
        return path
    out = directory / path.stem
    out.write_bytes(gzip.decompress(path.read_bytes()))
    return out


def expected(mesh):
    """Counts by Druse's kinds: the solids if there are any, else the planar elements."""
    counts = {}
    for block in mesh.cells:
        if block.type in KINDS:
            kind = KINDS[block.type]
            counts[kind] = counts.get(kind, 0) + len(block.data)
    solids = {k: n for k, n in counts.items() if k.startswith(SOLID)}
    return solids or counts


def seen_by_pyvista(path):
    """Counts by Druse's kinds as VTK itself reads them, for files that meshio cannot."""
    import pyvista

    names = {3: None, 5: "triangle", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid",
             22: "triangle6", 23: "quad8", 24: "tetra10", 25: "hexahedron20", 28: "quad9", 29: "hexahedron27"}
    counts = {}
    for cell_type in pyvista.read(path).celltypes:
        kind = KINDS.get(names.get(int(cell_type)))
        if kind:
            counts[kind] = counts.get(kind, 0) + 1
    return {k: n for k, n in counts.items() if k.startswith(SOLID)} or counts


def ours(druse, path):
    run = subprocess.run([druse, "scaffold", "info", "--json", path], capture_output=True, text=True)
    answer = json.loads(run.stdout or run.stderr)
    if run.returncode == 0:
        return answer["elements"], ""
    return None, answer.get("error", answer).get("message", "?")


def deck_counts(path):
    """Elements of an Abaqus deck by number of lines that begin one, counted without any reader."""
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
                known = re.match(r"C3D\d+", name)
                kind = DECK.get(known[0]) if known else None
        elif kind:
            numbers += len([w for w in line.split(",") if w.strip()])
            if numbers > int(re.search(r"\d+$", next(k for k, v in DECK.items() if v == kind))[0]):
                counts[KINDS[kind]] = counts.get(KINDS[kind], 0) + 1
                numbers = 0
    return counts


def decks(druse, directory, temporary):
    """Decks of second-order elements from CalculiX' test suite: twelve of hexes, all of tets."""
    found = {"Hex20": [], "Tet10": []}
    for path in sorted(unpack(directory, "calculix-ccx-test").rglob("*.inp*")):
        path = plain(path, temporary)
        counts = deck_counts(path)
        for kind, own in found.items():
            if kind in counts:
                own.append((path, counts))
    chosen = found["Hex20"][:: max(1, len(found["Hex20"]) // 12)] + found["Tet10"][:12]
    for path, counts in chosen:
        yield path.name, counts, *ours(druse, path)


def package_meshes(druse, directory, temporary, everything):
    """Sfepy's meshes: all that meshio reads, or those that Druse and VTK read by themselves."""
    for path in sorted(unpack(directory, "python3-sfepy").rglob("meshes/**/*")):
        if path.suffix == ".vtk":
            yield path.name, seen_by_pyvista(path), *ours(druse, path)
            continue
        if not everything or path.suffix not in (".mesh", ".bdf", ".msh", ".inp", ".txt", ".hmascii", ".h5"):
            continue
        import meshio

        try:
            mesh = meshio.read(path)
        except (Exception, SystemExit) as e:  # meshio ends the program on some files
            yield path.name, None, None, f"meshio: {type(e).__name__}"
            continue
        counts = expected(mesh)
        if path.suffix not in OURS:
            converted = temporary / (path.stem + path.suffix.replace(".", "_") + ".vtu")
            mesh.points = [[*p, 0.0, 0.0][:3] for p in mesh.points]
            meshio.Mesh(mesh.points, mesh.cells).write(converted)
            path = converted
        yield path.name, counts, *ours(druse, path)


def beams(druse):
    """The beams that pyvista brings along."""
    from pyvista import examples

    for path in sorted(pathlib.Path(examples.dir_path).glob("*beam.vt*")):
        yield path.name, seen_by_pyvista(path), *ours(druse, path)


def surfaces(druse, temporary):
    """Closed surfaces of triangles, quads, polygons and strips as VTK writes them: triangles and volume."""
    import pyvista
    from vtkmodules.vtkIOGeometry import vtkOBJWriter
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    ball = pyvista.Sphere(radius=3, theta_resolution=24, phi_resolution=16)
    strips = ball.strip()
    blocks = pyvista.Cube(x_length=3, y_length=4, z_length=5, clean=True)
    prism = pyvista.Cylinder(radius=2, height=5, resolution=9, capping=True).clean()
    for what, mesh in (("ball", ball), ("strips", strips), ("cube", blocks), ("prism", prism)):
        cut = mesh.triangulate()
        triangles = cut.n_cells if what != "strips" else ball.n_cells
        expected = {"triangles": triangles, "volume": round(cut.volume, 3)}
        files = []
        for mode in ("Ascii", "Binary", "Appended"):
            for packed in ("None", "ZLib"):
                writer = vtkXMLPolyDataWriter()
                getattr(writer, f"SetDataModeTo{mode}")()
                getattr(writer, f"SetCompressorTypeTo{packed}")()
                writer.SetEncodeAppendedData(packed == "None")
                writer.SetHeaderTypeToUInt64() if packed == "None" else writer.SetHeaderTypeToUInt32()
                files.append((writer, f"{what}_{mode}_{packed}.vtp"))
        for binary in (False, True):
            for version in (42, 51):
                writer = vtkPolyDataWriter()
                writer.SetFileVersion(version)
                writer.SetFileTypeToBinary() if binary else writer.SetFileTypeToASCII()
                files.append((writer, f"{what}_{version}_{'binary' if binary else 'text'}.vtk"))
        if what != "strips":
            files.append((vtkOBJWriter(), f"{what}.obj"))
        for writer, name in files:
            writer.SetFileName(str(temporary / name))
            writer.SetInputData(mesh)
            writer.Write()
        names = [name for _, name in files]
        for binary in (False, True):
            for extension in ("ply", "stl"):
                name = f"{what}_{binary}.{extension}"
                cut.save(temporary / name, binary=binary)
                names.append(name)
        for name in names:
            run = subprocess.run([druse, "info", "--json", temporary / name], capture_output=True, text=True)
            answer = json.loads(run.stdout or "{}")
            if run.returncode:
                yield name, expected, None, answer.get("message", "?")
                continue
            yield name, expected, {"triangles": answer["triangles"], "volume": round(answer["volume"], 3)}, ""


def step_meshes(druse, directory, temporary):
    """Netgen's STEP files, meshed by gmsh in both orders."""
    import gmsh
    import meshio

    gmsh.initialize(["gmsh", "-v", "0"])
    for step in sorted(unpack(directory, "netgen-doc").rglob("*.step*")):
        source = plain(step, temporary)
        for order, version, binary in ((1, 2.2, 1), (2, 4.1, 0)):
            gmsh.clear()
            gmsh.open(str(source))
            gmsh.option.setNumber("Mesh.MeshSizeMax", 20)
            gmsh.option.setNumber("Mesh.ElementOrder", order)
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            name = f"{source.stem}.{order}.msh"
            try:
                gmsh.model.mesh.generate(3)
            except Exception as e:
                yield name, None, None, f"gmsh: {e}"
                continue
            gmsh.write(str(temporary / name))
            yield name, expected(meshio.read(temporary / name)), *ours(druse, temporary / name)
    gmsh.finalize()


def main():
    words = [w for w in sys.argv[1:] if w != "--all"]
    everything = len(words) < len(sys.argv) - 1
    failed, equal, total = 0, 0, 0
    with tempfile.TemporaryDirectory() as temporary:
        temporary = pathlib.Path(temporary)
        directory = pathlib.Path(words[1]) if len(words) > 1 else temporary
        directory.mkdir(parents=True, exist_ok=True)
        rows = [*package_meshes(words[0], directory, temporary, everything), *beams(words[0]),
                *decks(words[0], directory, temporary), *surfaces(words[0], temporary)]
        if everything:
            rows += step_meshes(words[0], directory, temporary)
    for name, theirs, mine, error in rows:
        if theirs is None:
            verdict = "not read elsewhere"
        elif mine is not None:
            verdict = "ok" if mine == theirs else "DIFFERS"
        else:
            verdict = "refused"
        failed += verdict == "DIFFERS" or (verdict == "refused" and (error == "?" or bool(theirs)))
        equal += verdict == "ok"
        total += 1
        print(f"{name:32} {verdict:18} {theirs or ''}  {'' if mine == theirs else error or mine}")
    print(f"figure: foreign meshes: {total} read, {equal} with the counts of other readers, {failed} failed")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
