"""The scene of a sequence, as USD's own library reads it.

    PYTHON_WITH_USD usda_sequence.py SCENE.usda FIRST LAST FPS

Expects a time sample of the file and of the extent at every frame, and files that are there.
"""

import os
import sys

from pxr import Usd, UsdGeom, UsdVol


def main():
    stage = Usd.Stage.Open(sys.argv[1])
    first, last, fps = (float(v) for v in sys.argv[2:])
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (first, last)
    assert stage.GetTimeCodesPerSecond() == fps
    volume = UsdVol.Volume(stage.GetDefaultPrim())
    frames = [float(f) for f in range(int(first), int(last) + 1)]
    assert volume.GetExtentAttr().GetTimeSamples() == frames
    fields = volume.GetFieldPaths()
    assert "vel" in fields, fields
    for name, path in fields.items():
        asset = UsdVol.OpenVDBAsset(stage.GetPrimAtPath(path))
        attribute = asset.GetFilePathAttr()
        assert attribute.GetTimeSamples() == frames, name
        files = [attribute.Get(f).resolvedPath for f in frames]
        assert all(os.path.exists(f) for f in files) and len(set(files)) == len(frames), files
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    print(f"{len(fields)} fields with {len(frames)} time samples")


if __name__ == "__main__":
    main()
