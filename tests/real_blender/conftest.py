# SPDX-License-Identifier: GPL-3.0-or-later
"""A real Blender with the extension installed from its zip.

BLENDER=/path/to/blender takes that one; its window opens under xvfb-run where there is no display. Otherwise a small
Debian with Blender 5.2 is made in BLENDER_ROOT (.blender-root), which needs root.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import ROOT, Blender

OUT = ROOT / "out" / "real-blender"
_SCENE = "bl_ext.user_default.patchnet.operators.demo_scene"
# A wall, a floor and laths before a world that is a gradient, which a visit reads and bakes in a moment.
YARD = """
import bpy
bpy.ops.wm.read_homefile(use_empty=True)
scene = bpy.context.scene
stone = bpy.data.materials.new("Stone")

def box(name, place, sides):
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=place)
    bpy.context.object.name, bpy.context.object.scale = name, sides
    bpy.context.object.data.materials.append(stone)

box("Back wall", (0.0, 1.0, 1.0), (4.0, 0.2, 2.0))
box("Floor", (0.0, 0.0, -0.05), (4.0, 3.0, 0.1))
for index in range(5):
    box(f"Lath {index}", (0.5 * index - 1.0, -0.2, 0.8), (0.08, 0.08, 1.6))
bpy.ops.object.light_add(type="SUN", rotation=(0.6, 0.3, 0.0))
bpy.context.object.name = "Sun"
bpy.ops.object.camera_add(location=(0.0, -6.0, 1.2), rotation=(1.5, 0.0, 0.0))
bpy.context.object.name = "Far"
scene.camera = bpy.context.object
scene.world = bpy.data.worlds.new("Gradient")
scene.world.use_nodes = True
nodes, links = scene.world.node_tree.nodes, scene.world.node_tree.links
gradient, place = nodes.new("ShaderNodeTexGradient"), nodes.new("ShaderNodeTexCoord")
links.new(place.outputs["Generated"], gradient.inputs["Vector"])
links.new(gradient.outputs["Color"], nodes["Background"].inputs["Color"])
scene.render.engine = "CYCLES"
bpy.ops.object.select_all(action="SELECT")
bpy.ops.wm.save_as_mainfile(filepath=PATH)
"""


@pytest.fixture(scope="session")
def out() -> Path:
    """An empty folder for what the tests leave."""
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    return OUT


@pytest.fixture(scope="session")
def blender(out: Path) -> Blender:
    """Blender with user resources of its own, without the extension."""
    # A visit finds no octree of another one; test_reload.py asks for some.
    environment = {"BLENDER_USER_RESOURCES": str(out / "resources"), "PATCHNET_KEEP": "0"}
    (out / "resources").mkdir()
    if named := os.environ.get("BLENDER"):
        return Blender((), named, environment)
    root = Path(os.environ.get("BLENDER_ROOT") or ROOT / ".blender-root").absolute()
    prefix = (str(ROOT / ".ci" / "blender-root"), str(root))
    done = subprocess.run([*prefix, "true"], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.exit(f"no Blender to test with: {done.stderr.strip()}", returncode=2)
    return Blender(prefix, "blender", environment)


@pytest.fixture(scope="session")
def archive(blender: Blender, out: Path) -> Path:
    """The extension's zip for this Blender's Python."""
    python = blender.value("'%d.%d' % sys.version_info[:2]")
    command = [sys.executable, ROOT / ".ci" / "build_extension.py", "--out", out / "zips", "--wheels", python]
    subprocess.run(command, check=True, capture_output=True)
    (found,) = (out / "zips").glob("*-cp*.zip")
    return found


@pytest.fixture(scope="session")
def installed(blender: Blender, archive: Path) -> Blender:
    """Blender with the extension installed and enabled by Blender's own command."""
    done = blender.run("--command", "extension", "install-file", "-r", "user_default", "--enable", archive)
    assert done.returncode == 0, done.stdout + done.stderr
    return blender


@pytest.fixture(scope="session")
def courtyard(installed: Blender, out: Path) -> Path:
    """The demo scene, built by the installed extension."""
    path = out / "courtyard.blend"
    save = f"from {_SCENE} import save_demo_scene; save_demo_scene(Path({str(path)!r}))"
    installed.execute(f"from pathlib import Path; {save}")
    return path


@pytest.fixture(scope="session")
def yard(installed: Blender, out: Path) -> Path:
    """A small scene."""
    path = out / "yard.blend"
    installed.execute(f"exec({YARD!r}, {{'PATH': {str(path)!r}}})")
    return path
