# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour maps against published tables, the sRGB curve, heatmap and overlay pictures."""

import numpy as np
import pytest

from patchnet.patchnet_addon.image.colormaps import COLORMAPS, colormap
from patchnet.patchnet_addon.image.heatmap import heatmap, magnify, overlay
from patchnet.patchnet_addon.image.tone import srgb_encode, to_bytes
from patchnet.patchnet_addon.runtime.errors import SettingError


@pytest.mark.parametrize("name", COLORMAPS)
def test_colormap_against_matplotlib(name: str) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    values = np.linspace(0, 1, 256)
    np.testing.assert_allclose(colormap(values, name), matplotlib.colormaps[name](values)[:, :3], atol=1 / 255)


def test_colormap_outside_its_range() -> None:
    np.testing.assert_array_equal(colormap(np.array([-1.0, np.nan, 7.0])), colormap(np.array([0.0, 0.0, 1.0])))
    with pytest.raises(SettingError, match="viridis, turbo"):
        colormap(np.zeros(3), "jet")


def test_srgb_anchors() -> None:
    # 18 % gray is byte 118; 0.0031308 is where the two pieces meet.
    assert to_bytes(srgb_encode(np.array([0.0, 0.18, 1.0, 5.0, np.nan]))).tolist() == [0, 118, 255, 255, 0]
    around = srgb_encode(np.array([0.0031307, 0.0031309]))
    assert abs(around[1] - around[0]) < 1e-4


def test_heatmap_uses_the_configured_maximum() -> None:
    priority = np.linspace(0, 0.2, 130 * 130, dtype=np.float32).reshape(130, 130)
    page = heatmap(priority, 0.5, "expected luminance error")
    assert page.shape[1] == 520 and page.dtype == np.float32
    # 0.2 of 0.5: never brighter than 40 % of the map, outside of the legend.
    foot = page.shape[0] - 520 - 26
    view = page[foot : foot + 520]
    np.testing.assert_allclose(view[0, 0], colormap(np.array(0.0)), atol=1e-6)
    np.testing.assert_allclose(view[-1, -1], colormap(np.array(0.4)), atol=1e-6)
    assert page.min() >= 0.0 and page.max() <= 1.0
    assert heatmap(priority[:, :4], 0.5, "expected luminance error").shape[1] == 16, "too narrow for a legend"
    with pytest.raises(SettingError, match="positive"):
        heatmap(priority, 0.0, "x")


def test_overlay_leaves_other_pixels_gray() -> None:
    luminance = np.full((64, 64), 0.3, np.float32)
    urgency = np.zeros((64, 64), np.float32)
    urgency[10, 20], urgency[30, 20] = 1.0, 0.1
    page = overlay(luminance, urgency, "a budget of 30%")
    factor = magnify(luminance).shape[0] // 64
    foot = next(row for row in range(page.shape[0]) if np.allclose(page[row, 0], srgb_encode(np.float32(0.3))))
    view = page[foot : foot + 64 * factor : factor, : 64 * factor : factor]
    np.testing.assert_allclose(view[0, 0], srgb_encode(np.float32(0.3)), atol=1e-6)
    redness = view[..., 0] - view[..., 1]
    assert redness[10, 20] > redness[30, 20] > redness[0, 0] == 0.0
