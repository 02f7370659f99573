# SPDX-License-Identifier: GPL-3.0-or-later
"""Catalogue of evaluation scenes: file, light, cut, credits, and their octrees, which are created once."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from ...patchnet_addon.runtime.errors import SceneError, SettingError
from ...patchnet_addon.runtime.file_kinds import OCTREE
from ...patchnet_addon.runtime.replace import replaced_path
from ...patchnet_addon.runtime.source_hash import source_hash
from ...patchnet_addon.runtime.versions import installed_version

FOLDER = "PATCHNET_SCENES"  # environment variable: folder of the scene files
CYCLES, TWO_LIGHTS = "cycles", "two-lights"
OWN_SCENES = ("demo", "room")  # built-in scenes
_CODE = "commands.octree"  # creates the octrees
# Lamps far above San Miguel, and street and ground around the house, which would enlarge the cube.
_SURROUNDINGS = ("sun_light", "fill_light", "baked:negro", "baked:banqueta", "calle")
_ROOF = ("z", 0.76)  # below the ceilings of San Miguel's upper floor; with the light of the whole house
# In San Miguel names of nodes begin with the plant's name.
_PLANTS = (
    "aglaonema", "azalea", "brevipedunculata", "cercis", "chusan_palm", "cinquefoil", "default_stengel",
    "default_wchrype", "dracaena", "dutch_iris", "fern", "ficus", "fragrans", "geranium", "hoja seca", "hybrids_",
    "ivy", "lagerstroemia", "leave a_", "lilium", "mona_lisa", "oxeye_daisy", "paniceum", "pansy", "pendula",
    "phyllostachya", "poinsettia", "rose", "verschaffeltii", "zebrina",
)  # fmt: skip
_SAN_MIGUEL = ("san_miguel.glb", CYCLES, "San Miguel by Guillermo M. Leal Llaguno", "CC BY 3.0")
_LDRAW = ("Parts of the LDraw.org parts library", "CC BY 2.0")
_FURNISHED_LICENCE = "CC BY 3.0 US; GPL-3.0-or-later"


@dataclass(frozen=True)
class Scene:
    """Scene and the settings of its octree, as arguments of `patchnet octree`.

    name: in commands and file names. title: in tables. file: in the folder PATCHNET_SCENES, or one of OWN_SCENES.
    light: "cycles" (diffuse light with global illumination; a scene without lamps gets sun and sky) or "two-lights"
    (methods 7.3). max_samples: most Cycles samples of a place. depth: of the octree. without: lower-case texts; objects
    below a name with one of them are left out. bisect: axis ("x", "y" or "z") and position of a cut plane, as a share
    of the extent. views: position and target (6 numbers, world units) of cameras to fit the octree to, instead of
    `depth`; view_px: size of their square pictures. source, licence: credits of the file. composed: arguments of
    `patchnet` that create the file, without --out; "" for a downloaded file.
    """

    name: str
    title: str
    file: str
    light: str
    source: str
    licence: str
    max_samples: int = 64
    depth: int = 10
    without: tuple[str, ...] = ()
    bisect: tuple[str, float] | None = None
    views: tuple[tuple[float, ...], ...] = ()
    view_px: int = 130
    composed: str = ""

    def path(self) -> Path:
        """Path of the file, or the name of a built-in scene; raises SceneError if PATCHNET_SCENES does not have it."""
        if self.file in OWN_SCENES:
            return Path(self.file)
        path = self._folder() / self.file
        if path.is_file():
            return path
        advice = f"make it by `patchnet lab {self.composed} --out {path}`" if self.composed else "put it there"
        raise SceneError(f"Scene {self.name!r} needs {self.file}, which is not in {path.parent}: {advice}")

    def is_there(self) -> bool:
        """Return whether the file exists; raises SceneError if PATCHNET_SCENES is not a folder."""
        return self.file in OWN_SCENES or (bool(os.environ.get(FOLDER)) and (self._folder() / self.file).is_file())

    def _folder(self) -> Path:
        folder = os.environ.get(FOLDER, "")
        if not folder:
            raise SceneError(f"Scene {self.name!r} needs its file: set {FOLDER} to the folder of the scene files")
        if not Path(folder).is_dir():
            raise SceneError(f"{FOLDER} is {folder}, which is not a folder: set it to the folder of the scene files")
        return Path(folder)

    def arguments(self) -> list[str]:
        """Arguments of `patchnet octree` without scene and --out; voxels have one luminance, as in the paper."""
        words = ["--depth", "auto" if self.views else str(self.depth), "--light", self.light, "--sides", "one"]
        for view in self.views:
            words += ["--view", *map(str, view)]
        if self.views:
            words += ["--size", str(self.view_px), str(self.view_px)]
        if self.light == CYCLES:
            words += ["--max-samples", str(self.max_samples)]
        if self.without:
            words += ["--without", ",".join(self.without)]
        if self.bisect is not None:
            words += ["--bisect", self.bisect[0], str(self.bisect[1])]
        return words


_TABLE = (
    # Without most plants, under sun and sky.
    Scene("san-miguel-bare", "San Miguel, bare", *_SAN_MIGUEL, without=(*_PLANTS, *_SURROUNDINGS), bisect=_ROOF),
    # A courtyard with tables, chairs and plants; its roof is cut off to show the inside.
    Scene("san-miguel", "San Miguel", *_SAN_MIGUEL, without=_SURROUNDINGS, bisect=_ROOF),
    # Bisected along its length as in the paper, to show the inside.
    Scene(
        "sponza", "Sponza", "sponza_crytek.glb", TWO_LIGHTS, "Sponza by Frank Meinl, Crytek",
        "geometry CC BY 3.0; licence of the textures not stated", bisect=("y", 0.5),
    ),
    # Ducts, pipes and wires without walls, instead of the paper's power plant.
    Scene(
        "clinic", "Clinic", "bim_clinic.glb", TWO_LIGHTS,
        "Medical-Dental Test Files by buildingSMART International", "CC BY 4.0",
        without=("architectural", "structural"),
    ),
    # Thousands of CAD parts, instead of the paper's airplane.
    Scene("shuttle", "Shuttle", "ldraw_space_shuttle.glb", TWO_LIGHTS, *_LDRAW),
    # Trusses and panels.
    Scene("station", "Space station", "ldraw_iss.glb", TWO_LIGHTS, *_LDRAW),
    # Smooth surfaces.
    Scene(
        "sports-car", "Sports car", "sports_car.glb", TWO_LIGHTS, "Sports car by Yasutoshi Mori", "CC BY 4.0"
    ),
    # The built-in demo scene, held out from training.
    Scene("courtyard", "Courtyard", "demo", CYCLES, "built by `patchnet demo`", "GPL-3.0-or-later"),
    # With people, from a held-out library; cut open, since inside it is dark beside its sunlit outside.
    Scene(
        "furnished-room", "Furnished room", "furnished_room.glb", CYCLES,
        "people by Reallusion, the room and its furniture built by `patchnet lab furnish`", _FURNISHED_LICENCE,
        without=("ceiling",), composed="furnish Reallusion.sh3f --kind interior --seed 1",
    ),
    # With people behind a fence of thin bars.
    Scene(
        "furnished-garden", "Furnished garden", "furnished_garden.glb", CYCLES,
        "people by Reallusion, the garden and its plants built by `patchnet lab furnish`", _FURNISHED_LICENCE,
        composed="furnish Reallusion.sh3f --kind garden --seed 1",
    ),
)  # fmt: skip
SCENES: dict[str, Scene] = {scene.name: scene for scene in _TABLE}


def scene_named(name: str) -> Scene:
    """Find a scene; raises SettingError for a name that is not in the catalogue."""
    if name not in SCENES:
        raise SettingError(f"Unknown scene {name!r}: choose one of {', '.join(SCENES)}")
    return SCENES[name]


def scene_octree(scene: Scene, folder: Path) -> Path:
    """Octree file of a scene in `folder`, created by `patchnet octree` in a subprocess if missing.

    Its name contains a hash of settings, scene file and code, so that any change leads to another file. Raises
    SceneError if the scene file is missing or fails, OutputError if the octree cannot be written.
    """
    path = octree_path(scene, folder)
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with replaced_path(path, OCTREE) as temporary:
            _make(scene, scene.path(), temporary)
    return path


def octree_path(scene: Scene, folder: Path) -> Path:
    """Path of a scene's octree file in `folder`, existing or not; raises SceneError for a missing scene file."""
    return folder / f"{scene.name}-{_key(scene, scene.path())}.safetensors"


def _key(scene: Scene, source: Path) -> str:
    """Hash (16 hex digits) of all dependencies of the octree: arguments, size and time of the file, code, Blender."""
    stat = None if scene.file in OWN_SCENES else source.stat()
    file = [scene.file] if stat is None else [scene.file, stat.st_size, stat.st_mtime_ns]
    what = json.dumps([scene.arguments(), file, source_hash(_CODE), installed_version("bpy")])
    return hashlib.sha256(what.encode()).hexdigest()[:16]


def _make(scene: Scene, source: Path, out: Path) -> None:
    package = __name__.partition(".training")[0]
    command = [sys.executable, "-m", package, "octree", str(source), *scene.arguments(), "--out", str(out)]
    code = subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode
    if code:
        how = f"ended with code {code}, see above" if code > 0 else "was killed, perhaps for want of memory"
        raise SceneError(f"Scene {scene.name!r} did not become an octree: `patchnet octree` {how}")
