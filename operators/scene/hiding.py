# SPDX-License-Identifier: GPL-3.0-or-later
"""Hide objects from renders by parts of their names."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import bpy


def hide_from_renders(texts: Sequence[str]) -> list[str]:
    """Hide objects whose own or an ancestor's name contains one of `texts` (lower case); returns those of no object."""
    unused = set(texts)
    for item in bpy.data.objects:
        ancestor = item
        while ancestor is not None and not (found := [text for text in texts if text in ancestor.name.lower()]):
            ancestor = ancestor.parent
        if ancestor is not None:
            item.hide_render = True
            unused.difference_update(found)
    return sorted(unused)


def keep_hidden(texts: Sequence[str]) -> None:
    """Hide them at every frame that the scene goes to: their keys may show them again."""
    if texts:
        bpy.app.handlers.frame_change_post.append(_hider(texts))


def _hider(texts: Sequence[str]) -> Callable[..., None]:
    def hide(*_: object) -> None:
        hide_from_renders(texts)

    return hide
