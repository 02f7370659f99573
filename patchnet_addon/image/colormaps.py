# SPDX-License-Identifier: GPL-3.0-or-later
"""Colour maps for heatmaps: viridis by default, turbo as an option."""

import numpy as np

# Every fifth of 256 entries, sRGB bytes in hexadecimal; linear between them is within 1/255 of the full tables.
# viridis is by Stefan van der Walt and Nathaniel Smith (CC0), turbo by Anton Mikhailov (Apache-2.0).
_KNOTS = {
    "viridis": """
        440154 46085c 471063 481769 481d6f 482475 472a7a 46307e 453781 433d84 414287 3f4889 3d4e8a
        3a538b 38598c 355e8d 33638d 31688e 2e6d8e 2c718e 2a768e 297b8e 27808e 25848e 23898e 218e8d
        20928c 1f978b 1e9c89 1fa188 21a585 24aa83 28ae80 2eb37c 35b779 3dbc74 46c06f 50c46a 5ac864
        65cb5e 70cf57 7cd250 89d548 95d840 a2da37 b0dd2f bddf26 cae11f d8e219 e5e419 f1e51d fde725""",
    "turbo": """
        30123b 36215f 3b2f80 3f3e9c 424bb5 4559cb 4666dd 4773eb 4680f6 458cfd 4099ff 38a5fb 2fb2f4
        27bee9 1fc9dd 1ad4d0 18ddc2 1ae4b6 22ebaa 2ff19b 3ff68a 52fa7a 65fd69 79fe59 8bff4b 9cfe40
        a9fb39 b7f735 c3f134 d0ea34 dbe236 e5d938 eecf3a f5c53a faba39 fdae35 fea130 fe932a fc8423
        f9751d f46617 ef5811 e84b0c e14109 d83706 ce2d04 c32503 b71d02 a91601 9b0f01 8b0902 7a0403""",
}
COLORMAPS: tuple[str, ...] = tuple(_KNOTS)


def colormap(values: np.ndarray, name: str = "viridis") -> np.ndarray:
    """sRGB colours (..., 3) float32 in [0, 1] of `values` (...); clamped to [0, 1], NaN counts as 0."""
    knots = np.array([list(bytes.fromhex(entry)) for entry in _KNOTS[name].split()], np.float32) / 255  # (52, 3)
    position = np.clip(np.nan_to_num(values, nan=0.0), 0.0, 1.0)
    positions = np.linspace(0.0, 1.0, len(knots))
    return np.stack([np.interp(position, positions, knots[:, c]) for c in range(3)], axis=-1).astype(np.float32)


def red_ramp(amount: np.ndarray) -> np.ndarray:
    """sRGB colours (..., 3) float32 of `amount` (...) in [0, 1]: pale orange for little, deep red for 1."""
    pale, deep = np.array([1.0, 0.82, 0.55], np.float32), np.array([0.85, 0.0, 0.0], np.float32)
    weight = np.clip(amount, 0.0, 1.0)[..., None].astype(np.float32)
    return pale * (1 - weight) + deep * weight


def diverging(values: np.ndarray) -> np.ndarray:
    """sRGB colours (..., 3) float32 of `values` (...) in [-1, 1]: deep blue, pale grey for 0, deep red; clamped."""
    amount = np.clip(np.nan_to_num(values), -1.0, 1.0)[..., None].astype(np.float32)
    pale, blue, red = (
        np.array(color, np.float32) for color in ((0.95, 0.95, 0.95), (0.02, 0.19, 0.60), (0.60, 0.0, 0.1))
    )
    middle_blue, middle_red = np.array([0.35, 0.60, 0.85], np.float32), np.array([0.93, 0.45, 0.35], np.float32)
    size = np.abs(amount)
    half = np.where(amount < 0, middle_blue, middle_red)
    end = np.where(amount < 0, blue, red)
    inner = pale + (half - pale) * np.minimum(2.0 * size, 1.0)
    return (inner + (end - inner) * np.maximum(2.0 * size - 1.0, 0.0)).astype(np.float32)
