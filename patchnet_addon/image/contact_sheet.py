# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of several cameras in rows, under titles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .pixel_font import GLYPH_HEIGHT, draw_text

_PAPER = 0.11
_GAP = 6
_CELL_PX = 380  # smaller pictures are magnified by a whole factor to about this width
_SCALE = 3


def contact_sheet(rows: Sequence[Sequence[np.ndarray]], names: Sequence[str], titles: Sequence[str]) -> np.ndarray:
    """(H, W, 3) sRGB-encoded: one row of pictures (h, w, 3) per name, the columns under `titles`; row 0 is the bottom.

    Each row has pictures of one size; rows may differ.
    """
    line = GLYPH_HEIGHT * _SCALE + 2 * _GAP
    strips = [_strip(row, name, line) for row, name in zip(rows, names, strict=True)]
    width = max(strip.shape[1] for strip in strips)
    head = np.full((line, width, 3), _PAPER, np.float32)
    cell = strips[0].shape[1] // len(titles)
    for column, title in enumerate(titles):
        draw_text(head, title, column * cell, _GAP, _SCALE)
    parts = [np.pad(strip, ((0, 0), (0, width - strip.shape[1]), (0, 0)), constant_values=_PAPER) for strip in strips]
    sheet = np.concatenate([*reversed(parts), head])
    return np.pad(sheet, ((_GAP, _GAP), (_GAP, _GAP), (0, 0)), constant_values=_PAPER)


def _strip(row: Sequence[np.ndarray], name: str, line: int) -> np.ndarray:
    factor = max(1, round(_CELL_PX / row[0].shape[1]))
    spaced = [
        np.pad(picture.repeat(factor, 0).repeat(factor, 1), ((0, 0), (0, _GAP), (0, 0)), constant_values=_PAPER)
        for picture in row
    ]
    pictures = np.concatenate(spaced, axis=1).astype(np.float32)
    head = np.full((line, pictures.shape[1], 3), _PAPER, np.float32)
    draw_text(head, name, 0, _GAP, _SCALE)
    return np.concatenate([pictures, head])
