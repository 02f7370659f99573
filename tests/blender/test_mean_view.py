# SPDX-License-Identifier: GPL-3.0-or-later
"""Layers of a Principled BSDF dim what is below them as Cycles does in the mean of all views.

A view of a surface counts by its cosine, so the mean is that over a ball's disc. A sun has no noise.
"""

import bpy
import numpy as np
import pytest

from patchnet.operators.cycles.camera_render import render_reference
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.tests.blender.light_scene import assert_mean_of_views, bake
from patchnet.tests.blender.objects import lamp, look_from, slab
from patchnet.tests.blender.shaders import material, shader, shown, simple, world

pytestmark = pytest.mark.usefixtures("empty_scene")

COAT = {"Coat Weight": 1.0, "Coat Roughness": 0.2, "Specular IOR Level": 0.0}


def floor_seen(cosine: float) -> float:
    """Luminance of the floor's middle in Cycles from a direction at this cosine to its normal."""
    sine = np.sqrt(1.0 - cosine**2)
    away, up = np.array([0.0, -sine, cosine]), np.array([0.0, cosine, sine])
    camera = Camera(5.0 * away, np.array([1.0, 0.0, 0.0]), up, -away, 0.1, 0.1, 8, 8, ORTHOGRAPHIC)
    return float(render_reference(bpy.context, camera, 4, 1).luminance.mean())


def sunlit_floor() -> None:
    """A default Principled floor below a sharp sun."""
    slab(paint=simple("BsdfPrincipled"))
    lamp("SUN", 3.0, angle=0.0)


def floor_baked(**light: object) -> float:
    """Baked luminance of the floor's top."""
    fragments = bake(depth=4, **light).fragments
    return fragments.only((np.abs(fragments.place) < (0.9, 0.9, 1e-5)).all(axis=1)).mean


def test_floor_is_the_mean_of_its_views() -> None:
    """Views of equal weight have equal steps of the cosine's square."""
    sunlit_floor()
    above, oblique, grazing = (floor_seen(cosine) for cosine in (1.0, 0.5**0.5, 0.3))
    assert above > 1.005 * oblique > 1.05 * grazing, "the views must differ"
    mean = np.mean([floor_seen(cosine) for cosine in np.sqrt((np.arange(16) + 0.5) / 16)])
    assert floor_baked() == pytest.approx(mean, rel=0.003)


def test_floor_from_the_camera_is_as_it_sees_it() -> None:
    """Dimmed once: the bake has the camera's view."""
    sunlit_floor()
    look_from((0.0, -50.0, 50.0), (0.0, 0.0, 0.0))
    assert floor_baked(from_camera=True) == pytest.approx(floor_seen(0.5**0.5), rel=0.003)


@pytest.mark.parametrize("linked", [False, True])
@pytest.mark.parametrize(
    ("distribution", "inputs", "error"),
    [
        ("MULTI_GGX", {}, 0.003),
        ("GGX", {"Roughness": 0.2, "IOR": 1.8, "Specular IOR Level": 0.6}, 0.003),
        ("MULTI_GGX", {"Roughness": 1.0, "Specular Tint": (0.5, 0.7, 1.0, 1.0), "Metallic": 0.3}, 0.003),
        ("GGX", COAT, 0.004),
        ("GGX", COAT | {"Coat Weight": 0.5, "Coat IOR": 1.4, "Coat Tint": (0.6, 0.7, 0.8, 1.0)}, 0.004),
        ("MULTI_GGX", {"Coat Weight": 1.0}, 0.006),
    ],
)
def test_layers_dim_as_the_mean_of_all_views(distribution: str, inputs: dict, error: float, linked: bool) -> None:
    """Numbers and linked inputs; coat above specular errs more, as the mean of a product is not that of means."""
    world().nodes["Background"].inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    paint, tree = material("Layers")
    surface = shader(tree, "BsdfPrincipled", **inputs)
    surface.node.distribution = distribution
    shown(tree, surface)
    if linked:
        for socket in surface.node.inputs:
            if socket.name.startswith(("Roughness", "IOR", "Specular", "Coat")) and socket.name != "Coat Normal":
                constant = tree.nodes.new("ShaderNodeRGB" if socket.type == "RGBA" else "ShaderNodeValue")
                constant.outputs[0].default_value = socket.default_value
                tree.links.new(constant.outputs[0], socket)
    assert assert_mean_of_views(paint, 256, paths=64, rel=error).warnings == (), "most materials have layers"
