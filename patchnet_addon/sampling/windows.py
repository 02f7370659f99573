# SPDX-License-Identifier: GPL-3.0-or-later
"""Windows W(x) of 3x3 around every pixel, as the screen-space strategies read them (methods 2)."""

import numpy as np


def windows(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (H, W, 9) of the windows of `picture` (H, W), and which of them lie in the picture (H, W, 9) bool.

    Values outside the picture are 0. The window is in row-major order, the pixel itself at index 4.
    """
    height, width = picture.shape
    padded = np.pad(picture, 1)
    inside = np.pad(np.ones((height, width), bool), 1)
    corners = [(row, column) for row in range(3) for column in range(3)]
    return tuple(
        np.stack([plane[row : row + height, column : column + width] for row, column in corners], axis=-1)
        for plane in (padded, inside)
    )  # type: ignore[return-value]
