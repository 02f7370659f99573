# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene of an evaluation: which file, lit how, cut how, and whose it is."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from ...patchnet_addon.runtime.errors import SceneError

FOLDER = "PATCHNET_SCENES"  # environment variable that names the folder of the scenes' files
CYCLES, TWO_LIGHTS = "cycles", "two-lights"
TRAIN, TEST = "train", "test"
OWN_SCENES = ("demo", "room")  # which the project builds itself


@dataclass(frozen=True)
class Scene:
    """Scene and the recipe of its octree, as arguments of `patchnet octree`.

    name: in commands and file names. title: in tables. file: in the folder PATCHNET_SCENES, or one of OWN_SCENES.
    light: "cycles" (diffuse light with global illumination; a scene without lamps gets sun and sky) or "two-lights"
    (methods 7.3). samples: of Cycles per texel. depth: of the octree. without: texts, in lower case; objects below a
    name with one of them are left out. bisect: axis ("x", "y" or "z") and share of the extent of a plane beyond which
    all is left out. views: position and target (6 numbers, world units) of cameras that the octree is fitted to, in
    the place of `depth`; view_px: side of their square pictures. source, licence: of the file, for credits. role:
    "train" where the shipped weights have seen the scene, "test" where not. composed: arguments of `patchnet lab` that
    write the file, but for --out; "" for a file that is to be had elsewhere.
    """

    name: str
    title: str
    file: str
    light: str
    source: str
    licence: str
    role: str
    samples: int = 32
    depth: int = 10
    without: tuple[str, ...] = ()
    bisect: tuple[str, float] | None = None
    views: tuple[tuple[float, ...], ...] = ()
    view_px: int = 130
    composed: str = ""

    def path(self) -> Path:
        """Path of the file, or the name of a scene that the project builds.

        Raises SceneError if PATCHNET_SCENES is not set, is no folder, or does not have the file.
        """
        if self.file in OWN_SCENES:
            return Path(self.file)
        path = self._folder() / self.file
        if path.is_file():
            return path
        advice = f"make it by `patchnet lab {self.composed} --out {path}`" if self.composed else "put it there"
        raise SceneError(f"Scene {self.name!r} needs {self.file}, which is not in {path.parent}: {advice}")

    def is_there(self) -> bool:
        """Return whether the file is there; raises SceneError if PATCHNET_SCENES is set to what is no folder."""
        return self.file in OWN_SCENES or (bool(os.environ.get(FOLDER)) and (self._folder() / self.file).is_file())

    def _folder(self) -> Path:
        folder = os.environ.get(FOLDER, "")
        if not folder:
            raise SceneError(f"Scene {self.name!r} is a file of its own: set {FOLDER} to the folder of the scenes")
        if not Path(folder).is_dir():
            raise SceneError(f"{FOLDER} names {folder}, which is no folder: set it to the folder of the scenes")
        return Path(folder)

    def arguments(self) -> list[str]:
        """Arguments of `patchnet octree` beside the scene and --out."""
        words = ["--depth", "fit" if self.views else str(self.depth), "--light", self.light]
        for view in self.views:
            words += ["--view", *map(str, view)]
        if self.views:
            words += ["--size", str(self.view_px), str(self.view_px)]
        if self.light == CYCLES:
            words += ["--samples", str(self.samples)]
        if self.without:
            words += ["--without", ",".join(self.without)]
        if self.bisect is not None:
            words += ["--bisect", self.bisect[0], str(self.bisect[1])]
        return words
