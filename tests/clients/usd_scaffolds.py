"""Tets and meshes that pxr wrote, read by Druse: counts, volumes, boxes, time samples, also flattened from references.

    python usd_scaffolds.py DRUSE FOLDER
"""

import json
import pathlib
import subprocess
import sys

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

# The corners of a cube and its five tets.
CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
TETS = [(0, 1, 2, 4), (3, 2, 1, 7), (5, 4, 7, 1), (6, 7, 4, 2), (1, 4, 7, 2)]
FACES = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]


def info(druse, path):
    shown = subprocess.run([druse, "scaffold", "info", "--json", str(path)], check=True, capture_output=True, text=True)
    return json.loads(shown.stdout)


def turned(xform):
    xform.AddTranslateOp().Set(Gf.Vec3d(3, -2, 1))
    xform.AddRotateXYZOp().Set(Gf.Vec3f(20, 30, 40))
    xform.AddScaleOp().Set(Gf.Vec3f(2, 3, 4))


def box(stage, path, points):
    """The box that pxr computes of the points of a prim."""
    map_ = UsdGeom.XformCache().GetLocalToWorldTransform(stage.GetPrimAtPath(path))
    placed = np.array([map_.Transform(Gf.Vec3d(*p)) for p in points.tolist()])
    return placed.min(axis=0), placed.max(axis=0)


def main():
    druse, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    stage = Usd.Stage.CreateNew(str(folder / "tets.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.001)
    turned(UsdGeom.Xform.Define(stage, "/part"))
    tets = UsdGeom.TetMesh.Define(stage, "/part/tets")
    tets.CreatePointsAttr(CORNERS)
    tets.CreateTetVertexIndicesAttr([Gf.Vec4i(*t) for t in TETS])
    size = UsdGeom.PrimvarsAPI(tets).CreatePrimvar("size", Sdf.ValueTypeNames.FloatArray, "vertex")
    size.Set([0.1 * n for n in range(8)])
    stage.Save()
    found = info(druse, folder / "tets.usda")
    least, greatest = box(stage, "/part/tets", CORNERS)
    assert found["elements"] == {"Tet4": 5}, found
    assert abs(found["volume"] - 24) < 1e-5, found["volume"]
    assert np.allclose(found["box"], [least, greatest], atol=1e-5), found["box"]

    # A reference is refused; pxr flattens it.
    outer = Usd.Stage.CreateNew(str(folder / "outer.usda"))
    held = outer.DefinePrim("/held")
    held.GetReferences().AddReference("./tets.usda", "/part")
    UsdGeom.Xformable(held).AddTranslateOp(opSuffix="more").Set(Gf.Vec3d(100, 0, 0))
    outer.Save()
    refused = subprocess.run([druse, "scaffold", "info", str(folder / "outer.usda")], capture_output=True, text=True)
    assert refused.returncode == 65 and "usdcat --flatten" in refused.stderr, refused
    outer.Export(str(folder / "flat.usda"))
    assert abs(info(druse, folder / "flat.usda")["volume"] - 24) < 1e-5

    # A surface of quads under the same map, and points that move by time samples.
    stage = Usd.Stage.CreateNew(str(folder / "moving.usda"))
    mesh = UsdGeom.Mesh.Define(stage, "/cube")
    turned(mesh)
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr(FACES)
    points = mesh.CreatePointsAttr()
    for frame in range(1, 4):
        points.Set(CORNERS * frame, frame)
    stage.Save()
    checked = subprocess.run([druse, "check", "--json", str(folder / "moving.usda")], capture_output=True, text=True)
    facts = json.loads(checked.stdout)
    assert checked.returncode == 0 and abs(facts["volume"] - 24) < 1e-4, facts

    recipe = folder / "moving.toml"
    recipe.write_text(
        'druse = 1\nunit = "mm"\nframe = 2\nfps = 24\n[cell.p]\nsurface = "schwarz_p"\n[scaffold]\nfile = "tets.usda"\n'
        '[scaffold.motion]\npoints = "tets_moving.usda"\n[tiling]\ncell = "p"\n[band]\nvoxel_size = 0.2\n'
        '[[output]]\nvdb = "moving.vdb"\ngrids = ["surface", "vel"]\n'
    )
    stage = Usd.Stage.Open(str(folder / "tets.usda"))
    points = UsdGeom.TetMesh.Get(stage, "/part/tets").GetPointsAttr()
    points.Clear()
    for frame in range(1, 4):
        # One edge of the box, 2 units, a second to and fro along x in the part's own frame.
        points.Set(CORNERS + [frame / 24, 0, 0], frame)
    stage.Export(str(folder / "tets_moving.usda"))
    subprocess.run([druse, "run", str(recipe), "--out", str(folder), "--quiet"], check=True)
    shown = subprocess.run([druse, "info", "--json", str(folder / "moving.vdb")], check=True, capture_output=True, text=True)
    grids = {g["name"]: g for g in json.loads(shown.stdout)["grids"]}
    print("usd:", found["elements"], "of volume", found["volume"], "| grids", ", ".join(grids))
    assert "vel" in grids


if __name__ == "__main__":
    main()
