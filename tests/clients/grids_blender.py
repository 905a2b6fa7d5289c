"""Blender loads every grid of a .vdb: blender -b --python grids_blender.py -- FILE NAMES..."""

import sys

import bpy

path, *wanted = sys.argv[sys.argv.index("--") + 1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.object.volume_import(filepath=path)
grids = bpy.context.object.data.grids
assert grids.load(), grids.error_message
found = {grid.name: grid.data_type for grid in grids}
assert sorted(found) == sorted(wanted), found
assert found["uvw"] == "VECTOR_FLOAT" and found["cell_id"] == "FLOAT", found
print("grids", found)
