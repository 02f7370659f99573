# SPDX-License-Identifier: GPL-3.0-or-later
"""Source of painted importance; its values are checked."""

from __future__ import annotations

from dataclasses import dataclass

from ...patchnet_addon.runtime.errors import SettingError
from ..schema.values import IMAGE, NOTHING, VERTEX_GROUP


@dataclass(frozen=True)
class Importance:
    """Source of importance, one of two.

    image: name of an image of the open file, painted in an Image Editor and stretched over each view.
    vertex_group: name of a group; objects without it weigh 0.
    """

    image: str = ""
    vertex_group: str = ""

    def __post_init__(self) -> None:
        if bool(self.image) == bool(self.vertex_group):
            raise SettingError("Importance needs one source: choose an image or a vertex group")

    @property
    def choice(self) -> dict[str, str]:
        """Settings of a scene that choose it."""
        if self.vertex_group:
            return {"importance": VERTEX_GROUP, "importance_group": self.vertex_group}
        return {"importance": IMAGE, "importance_image": self.image}

    @classmethod
    def chosen(cls, kind: str, image: str, vertex_group: str) -> Importance | None:
        """Choose by the settings of a scene; None for none; raises SettingError if the chosen source is not named."""
        if kind == NOTHING:
            return None
        name = image if kind == IMAGE else vertex_group
        if not name:
            what = "image" if kind == IMAGE else "vertex group"
            raise SettingError(f"Importance needs a painted {what}: choose one, or set Importance to None")
        return cls(image=name) if kind == IMAGE else cls(vertex_group=name)
