# SPDX-License-Identifier: GPL-3.0-or-later
"""A small scene for whole jobs of one or two seconds: laths before a slab, a lamp, a camera."""

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest

from patchnet.operators.pipeline.run import JobResult, run_job
from patchnet.operators.pipeline.views import View, view
from patchnet.operators.scene.cameras import tracing_camera
from patchnet.operators.session import results
from patchnet.operators.session.scene_result import SceneResult
from patchnet.operators.session.staleness import look_again
from patchnet.operators.settings.groups import ViewSettings
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.patchnet_addon.network.weights import Weights, save_weights
from patchnet.patchnet_addon.runtime.progress import Progress, drain
from patchnet.tests.blender.objects import cuboid, lamp, new_camera, slid
from patchnet.tests.blender.shaders import simple

SMALL = {"depth": 7, "size": (24, 16)}
QUICK = ["--light", "two-lights", "--size", "16", "16", "--depth", "5"]  # words of a command


def frames_of_calls(monkeypatch: pytest.MonkeyPatch, module: ModuleType, name: str) -> list[int]:
    """Frames at which a function of a module, whose first argument is a context, is called from now on."""
    frames: list[int] = []
    called = getattr(module, name)

    def noted(context: bpy.types.Context, *rest: object) -> object:
        frames.append(context.scene.frame_current)
        return called(context, *rest)

    monkeypatch.setattr(module, name, noted)
    return frames


def box(name: str, low: tuple[float, float, float], high: tuple[float, float, float], gray: float) -> bpy.types.Object:
    """A box with one material of the given gray."""
    return cuboid(name, low, high, simple("BsdfPrincipled", name, Base_Color=(gray, gray, gray, 1.0)))


def build(light: bool = True, camera: bool = True) -> None:
    """Replace what is open by the small scene; the slab is selected, the laths are not."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    slab = box("Slab", (-1, 0.5, -1), (1, 0.6, 1), 0.2)
    for index in range(5):
        box(f"Lath {index}", (-0.9 + 0.4 * index, -0.5, -1), (-0.85 + 0.4 * index, -0.45, 1), 0.9)
    if light:
        item = lamp("SUN", 3.0, (0.0, 0.0, 0.0))
        item.name, item.data.name, item.rotation_euler = "Lamp", "Lamp", (0.9, 0.2, 0.1)
    if camera:
        scene.camera = new_camera("Eye", (0.3, -5.0, 0.4))
        scene.camera.rotation_euler = (1.5, 0.0, 0.05)
    for item in scene.objects:
        item.select_set(item is slab)
    bpy.context.view_layer.objects.active = slab
    bpy.context.view_layer.update()


def moving_slab(folder: Path) -> Path:
    """The small scene, whose slab moves at its frames 1 to 3, as a .blend file."""
    build()
    slid(bpy.data.objects["Slab"], {1: 0.0, 3: -0.8}, axis=1)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 3
    return saved(folder / "small.blend")


def read_until(process: subprocess.Popen[bytes], text: bytes) -> None:
    """Read what a process says on stderr, until it has said a text."""
    said = b""
    assert process.stderr is not None
    while text not in said:
        more = process.stderr.read(1)
        assert more, said.decode()
        said += more


def principled(name: str) -> bpy.types.Node:
    """The shader of a material."""
    return bpy.data.materials[name].node_tree.nodes["Principled BSDF"]


def saved(path: Path) -> Path:
    """Save what is open as a .blend file; its path."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def random_weights(folder: Path, lookahead: int = 2) -> Path:
    """A file of untrained weights."""
    path = folder / "random.safetensors"
    save_weights(Weights.random(3, bias=0.1, lookahead=lookahead), path)
    return path


def pixels_of(image: bpy.types.Image) -> np.ndarray:
    """Values (H, W, channels) of an image, row 0 at the bottom."""
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values.reshape(image.size[1], image.size[0], image.channels)


def pixels_in(path: Path) -> np.ndarray:
    """Values of a picture's file."""
    image = bpy.data.images.load(str(path))
    found = pixels_of(image)
    bpy.data.images.remove(image)
    return found


def render_by_cycles(path: Path, size: tuple[int, int], samples: int) -> np.ndarray:
    """Cycles' own picture (H, W, 4) of the open scene, linear, over nothing; its file is an EXR."""
    scene, render = bpy.context.scene, bpy.context.scene.render
    render.engine, render.filepath, render.film_transparent = "CYCLES", str(path), True
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.pixel_filter_type = samples, False, "BOX"
    bpy.ops.render.render(write_still=True)
    return pixels_in(path)


def view_of(scene: bpy.types.Scene, wanted: ViewSettings, *, color: bool = False) -> View:
    """The active camera's view of the small scene's own colours, compared with the reference; it is not kept."""
    scene.patchnet.color = color
    bpy.ops.patchnet.voxelize(depth=6)
    bpy.ops.patchnet.precompute_codes()
    camera = tracing_camera(scene.camera, scene, wanted.size)
    return drain(view(results.codes_of(scene), camera, replace(wanted, reference=True), "VISIBLE"))


def drop_result_images() -> None:
    """Remove the pictures that operators are meant to leave."""
    for image in list(bpy.data.images):
        if image.get("patchnet_result"):
            bpy.data.images.remove(image)


def run_small(**values: object) -> None:
    """Run all stages on the open scene, in the two lights unless `values` say otherwise."""
    assert bpy.ops.patchnet.run_all(**{"light": "two-lights", **SMALL, **values}) == {"FINISHED"}


def ran(hear: Callable[[Progress], object] | None = None, **settings: object) -> JobResult:
    """Result of a job on the open scene, as scripts and commands run it; `hear` gets its reports."""
    return drain(run_job(bpy.context, JobSettings.of(**settings)), hear)


def result() -> SceneResult:
    """What the open scene has of such a job, compared with the scene as it is before each use."""
    found = results.voxels_of(bpy.context.scene)
    look_again(found, bpy.context.scene)
    return found
