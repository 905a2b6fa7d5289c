"""Packs the extension, installs the archive as a user does in Blender 4.2 and newer, and fills Suzanne with it.

    python blender_install.py DRUSE FOLDER      # with the package bpy of PyPI
"""

import glob
import os
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
SOURCE = os.path.join(HERE, "..", "..", "examples", "blender", "druse")


def main():
    program, folder = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    # Where Blender keeps extensions; read when it starts.
    os.environ["BLENDER_USER_RESOURCES"] = os.path.join(folder, "resources")
    os.makedirs(os.environ["BLENDER_USER_RESOURCES"])
    import bpy

    # What `blender --command extension` runs.
    pattern = os.path.join(bpy.utils.resource_path("LOCAL"), "scripts", "addons_core", "bl_pkg", "cli", "blender_ext.py")
    tool = glob.glob(pattern)[0]
    subprocess.run([sys.executable, tool, "build", "--source-dir", SOURCE, "--output-dir", folder], check=True)
    archive = glob.glob(os.path.join(folder, "druse-*.zip"))[0]
    subprocess.run([sys.executable, tool, "validate", archive], check=True)

    bpy.ops.wm.read_factory_settings(use_empty=True)
    install = bpy.ops.extensions.package_install_files
    assert install(filepath=archive, repo="user_default", enable_on_install=True) == {"FINISHED"}
    name = "bl_ext.user_default.druse"
    bpy.context.preferences.addons[name].preferences.program = program
    bpy.ops.mesh.primitive_monkey_add()
    settings = bpy.context.scene.druse
    settings.folder, settings.voxel_size = os.path.join(folder, "fills"), 0.05
    assert bpy.ops.druse.fill() == {"FINISHED"}
    assert {o.name for o in bpy.data.objects} == {"Suzanne", "Suzanne mesh", "Suzanne volume"}
    bpy.ops.preferences.addon_disable(module=name)
    assert not hasattr(bpy.types.Scene, "druse") and not hasattr(bpy.types, "DRUSE_OT_fill")
    print("blender", bpy.app.version_string, "installs the extension")


if __name__ == "__main__":
    main()
