# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing panels where there is no window: a layout that takes every call and remembers texts, names and operators."""

from typing import Any

import bpy


class Layout:
    """Stands in for Blender's layout; what hangs below it belongs to it."""

    def __init__(self, texts: list[str] | None = None) -> None:
        self.texts: list[str] = [] if texts is None else texts

    def panel(self, name: str) -> tuple["Layout", "Layout"]:
        """Header and body of a part that users close, which is open."""
        return Layout(self.texts), Layout(self.texts)

    def __getattr__(self, name: str) -> Any:
        def call(*args: object, **keywords: object) -> "Layout":
            self.texts.extend(str(value) for value in (*args, *keywords.values()) if isinstance(value, str))
            return Layout(self.texts)

        return call


def drawn(panel: type, **values: object) -> list[str]:
    """Drawing of a panel: labels, names of settings, identifiers of operators, icons. `values`: its own properties."""
    layout = Layout()
    panel.draw(type("Drawn", (), {"layout": layout, **values})(), bpy.context)
    return layout.texts
