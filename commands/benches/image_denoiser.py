# SPDX-License-Identifier: GPL-3.0-or-later
"""Open Image Denoise of Blender's compositor on the pages of an atlas: the rival of `patchnet bench denoise`.

It works in the space of texels, where neighbours on a page may be strangers on the surface.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...patchnet_addon.surface.chroma import REC709

if TYPE_CHECKING:
    import bpy

    from ...patchnet_addon.lightmap.atlas import Atlas
    from ...patchnet_addon.surface.mesh import MeshSource

_NAME = "PatchNet Denoise"


def is_there() -> bool:
    """Return whether this Blender was built with Open Image Denoise."""
    try:
        import _cycles  # type: ignore[import-not-found]
    except ImportError:
        return False
    return bool(getattr(_cycles, "with_openimagedenoise", False))


def image_denoised(atlas: Atlas, source: MeshSource, *, demodulated: bool) -> Atlas:
    """Atlas whose pages went through Open Image Denoise, with base colours and normals as guides.

    demodulated: base colours are divided out before and multiplied in afterwards, as our own filter does it.
    """
    from ...patchnet_addon.lightmap.atlas import COLOR_CHANNELS
    from ...patchnet_addon.lightmap.denoised_atlas import divisor, placed_texels

    place, base, _, texels = placed_texels(atlas, source)
    shape = (atlas.charts.page_count, atlas.charts.page_side, atlas.charts.page_side, 3)
    color, guide, normal = (np.zeros((atlas.charts.texel_count, 3), np.float32) for _ in range(3))
    columns = [0, 2, 3] if atlas.texels.shape[1] == COLOR_CHANNELS else [0]
    opacity, albedo = atlas.texels[place, 1:2], divisor(base[:, : len(columns)])
    shining = atlas.texels[place][:, columns] / opacity
    color[place] = texels.light if demodulated else _rgb(shining)
    guide[place], normal[place] = (1.0 if demodulated else _rgb(albedo)), texels.normals
    pages = zip(*(each.reshape(shape) for each in (color, guide, normal)), strict=True)
    found = np.concatenate([denoised_image(*page).reshape(-1, 3) for page in pages])[place]
    luminance = found[:, 0] * albedo[:, 0] if demodulated else found @ REC709
    values = atlas.texels.copy()
    values[place, 0] = np.maximum(luminance, 0.0) * opacity[:, 0]
    return replace(atlas, texels=values, noise=None)


def _rgb(values: np.ndarray) -> np.ndarray:
    """(N, 3) red, green, blue of luminance (N, 1), or of luminance, red, blue (N, 3)."""
    if values.shape[1] == 1:
        return np.repeat(values, 3, axis=1)
    red, blue = values[:, 1], values[:, 2]
    green = (values[:, 0] - REC709[0] * red - REC709[2] * blue) / REC709[1]
    return np.stack([red, np.maximum(green, 0.0), blue], axis=1)


def denoised_image(color: np.ndarray, albedo: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Image (H, W, 3) float32, linear, without its noise, by the compositor's node Denoise; guides of its shape."""
    import bpy

    from ...operators.scene_access.temporary import temporary
    from ...patchnet_addon.image.exr import read_exr

    height, width = color.shape[:2]
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="patchnet-")))
        scene = stack.enter_context(temporary(bpy.data.scenes.new(_NAME)))
        eye = stack.enter_context(temporary(bpy.data.cameras.new(_NAME)))
        scene.camera = stack.enter_context(temporary(bpy.data.objects.new(_NAME, eye)))
        scene.collection.objects.link(scene.camera)
        tree, out = stack.enter_context(_compositor(scene))
        node = tree.nodes.new("CompositorNodeDenoise")
        for socket, pixels in (("Image", color), ("Albedo", albedo), ("Normal", normal)):
            reader = tree.nodes.new("CompositorNodeImage")
            reader.image = stack.enter_context(_image(pixels))
            tree.links.new(reader.outputs[0], node.inputs[socket])
        tree.links.new(node.outputs[0], out)
        _write_exr(scene, width, height, folder / "denoised.exr")
        bpy.ops.render.render(scene=scene.name, write_still=True)
        channels = read_exr(folder / "denoised.exr")
    return np.stack([channels[name] for name in "RGB"], axis=-1)


@contextmanager
def _compositor(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.NodeTree, bpy.types.NodeSocket]]:
    """Empty compositor of a scene, and the socket that its result goes to."""
    import bpy

    if not hasattr(scene, "compositing_node_group"):  # Blender 4.5
        scene.use_nodes = True
        scene.node_tree.nodes.clear()
        yield scene.node_tree, scene.node_tree.nodes.new("CompositorNodeComposite").inputs[0]
        return
    tree = bpy.data.node_groups.new(_NAME, "CompositorNodeTree")
    try:
        scene.compositing_node_group = tree
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        yield tree, tree.nodes.new("NodeGroupOutput").inputs[0]
    finally:
        bpy.data.node_groups.remove(tree)


@contextmanager
def _image(pixels: np.ndarray) -> Iterator[bpy.types.Image]:
    import bpy

    from ...operators.scene_access.temporary import temporary

    height, width = pixels.shape[:2]
    image = bpy.data.images.new(_NAME, width, height, alpha=True, float_buffer=True, is_data=True)
    with temporary(image):
        image.pixels.foreach_set(np.dstack([pixels, np.ones((height, width), np.float32)]).ravel())
        image.update()
        yield image


def _write_exr(scene: bpy.types.Scene, width: int, height: int, path: Path) -> None:
    """Let a scene write what its compositor makes, in single precision and linear."""
    render = scene.render
    render.engine, render.filepath = "CYCLES", str(path)
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "IMAGE"
    for name, value in (
        ("file_format", "OPEN_EXR"), ("color_depth", "32"), ("color_mode", "RGB"), ("exr_codec", "NONE")
    ):  # fmt: skip
        setattr(render.image_settings, name, value)
