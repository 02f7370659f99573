# SPDX-License-Identifier: GPL-3.0-or-later
"""Open Image Denoise as the rival of our filter: it takes noise from pages, keeps their order, and leaves the file."""

import bpy
import numpy as np
import pytest

from patchnet.commands.benches.image_denoiser import denoised_image, image_denoised, is_there
from patchnet.patchnet_addon.surface.mesh import Material
from patchnet.tests.engine.test_denoise import atlas_of, squares

pytestmark = [
    pytest.mark.usefixtures("empty_scene"),
    pytest.mark.skipif(not is_there(), reason="this Blender has no Open Image Denoise"),
]


def test_an_image_loses_its_noise_and_keeps_its_edge() -> None:
    truth = np.full((96, 80, 3), 3.0, np.float32)
    truth[:, 40:] = 0.3
    truth[:20] *= 0.1
    noisy = truth * np.random.default_rng(0).gamma(4.0, 0.25, (96, 80, 1)).astype(np.float32)
    up = np.zeros_like(truth)
    up[..., 2] = 1.0
    found = denoised_image(noisy, np.full_like(truth, 0.5), up)
    for kind in (bpy.data.scenes, bpy.data.cameras, bpy.data.objects, bpy.data.images, bpy.data.node_groups):
        assert not [block.name for block in kind if block.name.startswith("PatchNet")]
    assert found.shape == truth.shape and found.dtype == np.float32
    assert ((found - truth) ** 2).mean() < ((noisy - truth) ** 2).mean() / 10.0


@pytest.mark.parametrize("demodulated", [False, True])
@pytest.mark.parametrize("colored", [False, True])
def test_pages_of_an_atlas(demodulated: bool, colored: bool) -> None:
    source = squares(Material("Wall", (0.5, 0.5, 0.5)))
    atlas, index, truth = atlas_of(source, lambda points: 1.0 + points[:, 0] / 40.0, colored)
    found = image_denoised(atlas, source, demodulated=demodulated)
    before, after = (((each.texels[index, 0] - truth) ** 2).mean() for each in (atlas, found))
    assert after < before / 2.0
    np.testing.assert_array_equal(found.texels[:, 1], atlas.texels[:, 1])
