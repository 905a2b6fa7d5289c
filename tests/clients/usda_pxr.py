"""The scene beside a .vdb, as USD's own library reads it.

    PYTHON_WITH_USD usda_pxr.py SHADED.usda

Expects the scene of grids_pyopenvdb.py: one Volume whose eight fields are grids of a file that is there.
"""

import os
import sys

from pxr import Usd, UsdGeom, UsdValidation, UsdVol

CLASSES = {"surface": "levelSet", "density": "fogVolume"}


def main():
    stage = Usd.Stage.Open(sys.argv[1])
    volume = UsdVol.Volume(stage.GetDefaultPrim())
    assert volume, "the default prim is no Volume"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1e-3, UsdGeom.GetStageMetersPerUnit(stage)
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    fields = volume.GetFieldPaths()
    assert len(fields) == 8, fields
    for name, path in fields.items():
        asset = UsdVol.OpenVDBAsset(stage.GetPrimAtPath(path))
        assert asset, f"{path} is no OpenVDBAsset"
        assert os.path.exists(asset.GetFilePathAttr().Get().resolvedPath), f"{name}: its file is missing"
        assert asset.GetFieldNameAttr().Get() == name
        kind = "float3" if name in ("uvw", "fold") else "float"
        assert asset.GetFieldDataTypeAttr().Get() == kind, f"{name}: {asset.GetFieldDataTypeAttr().Get()}"
        assert asset.GetFieldClassAttr().Get() == CLASSES.get(name, "unknown"), name
    low, high = volume.GetExtentAttr().Get()
    for axis, edge in enumerate((4, 2, 2)):
        assert 0.9 * edge < high[axis] - low[axis] < 1.2 * edge, f"extent {low} to {high}"
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert validators, "USD has no validators"
    complaints = [e.GetErrorAsString() for e in UsdValidation.ValidationContext(validators).Validate(stage)]
    assert not complaints, complaints
    print(f"{len(fields)} fields of one Volume, extent {low} to {high}")


if __name__ == "__main__":
    main()
