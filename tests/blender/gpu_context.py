# SPDX-License-Identifier: GPL-3.0-or-later
"""Context of Blender's module `gpu` without a window."""

from collections.abc import Callable
from typing import TypeVar

import bpy
import gpu

Found = TypeVar("Found")


def with_gpu(work: Callable[[], Found]) -> Found:
    """Result of `work`, called where `gpu` works: Blender 4.5 has no `gpu.init()`, but gives engines a context."""
    if hasattr(gpu, "init"):
        gpu.init()
        return work()
    results: list[Found | BaseException] = []

    class Engine(bpy.types.RenderEngine):
        bl_idname, bl_label, bl_use_gpu_context = "PATCHNET_GPU_TEST", "GPU Test", True

        def render(self, depsgraph: object) -> None:
            try:
                results.append(work())
            except BaseException as error:  # noqa: BLE001  Blender would only print it
                results.append(error)

    bpy.utils.register_class(Engine)
    scene, camera = bpy.data.scenes.new("GPU"), bpy.data.objects.new("GPU", bpy.data.cameras.new("GPU"))
    scene.collection.objects.link(camera)
    scene.camera, scene.render.engine, scene.render.resolution_percentage = camera, Engine.bl_idname, 1
    try:
        bpy.ops.render.render(scene=scene.name)
    finally:
        bpy.data.scenes.remove(scene)
        bpy.data.cameras.remove(camera.data)
        bpy.utils.unregister_class(Engine)  # or Blender hangs at its exit
    (found,) = results
    if isinstance(found, BaseException):
        raise found
    return found
