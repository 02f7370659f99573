# SPDX-License-Identifier: GPL-3.0-or-later
"""Hide objects from renders by parts of their names."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import bpy


def hide_from_renders(texts: Sequence[str]) -> None:
    """Hide objects whose own or an ancestor's name contains one of `texts` (lower case)."""
    for item in bpy.data.objects:
        ancestor = item
        while ancestor is not None and not any(text in ancestor.name.lower() for text in texts):
            ancestor = ancestor.parent
        item.hide_render = item.hide_render or ancestor is not None


def keep_hidden(texts: Sequence[str]) -> None:
    """Hide them at every frame that the scene goes to: their keys may show them again."""
    if texts:
        bpy.app.handlers.frame_change_post.append(_hider(texts))


def _hider(texts: Sequence[str]) -> Callable[..., None]:
    return lambda *_: hide_from_renders(texts)
