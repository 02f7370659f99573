# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of San Miguel under its bright cloth, seen from several distances (Fig. 4 of the paper): octree and cameras.

The table's dark wood lies one centimetre below its cloth.
"""

from __future__ import annotations

import numpy as np

from ....patchnet_addon.runtime.bounds import LOOKAHEADS
from ....patchnet_addon.tracing.camera import Camera
from ..catalogue import san_miguel_bare
from ..scene import TWO_LIGHTS, Scene

BOX_WORLD = np.array([[11.705, -8.33, 0.488], [13.325, -6.71, 0.699]])
"""Box of the table's cloth, an object `Tela Mesa A` of the file."""
NEAREST_WORLD = (
    2.0  # from the middle of the cloth: rays then stop in voxels of 2.66 cm, which is the cube's side / 2^11
)
DISTANCES = (1.0, 2.0**0.5, 2.0, 2.0**1.5, 4.0)  # times NEAREST_WORLD
SHOWN = (1.0, 2.0, 4.0)  # of DISTANCES
AZIMUTHS = (70.0, 90.0, 110.0)  # degrees; the middle one is shown, errors are of all
ELEVATION = 40.0
SIZE_PX = 130  # of the nearest picture; all pictures have pixels of the same angle, and show the table alone
# What stands on tables, which would hide the cloths.
_TABLEWARE = (
    "cenicero", "copas", "cromo", "cubiertos", "individual", "pimienta", "plato a", "sal", "vela", "vidriosalero",
)  # fmt: skip
_FIT_FOV = np.radians(50.0)  # of the views of `patchnet octree`, and of the nearest picture
_PIXEL = 2.0 * np.tan(_FIT_FOV / 2) / SIZE_PX  # side of a pixel at distance 1


def table_camera(distance: float, azimuth: float) -> Camera:
    """Camera that frames the table from `distance` times NEAREST_WORLD; azimuth in degrees."""
    size = round(SIZE_PX / distance)
    fov = 2.0 * np.arctan(size * _PIXEL / 2)
    name = f"{distance * NEAREST_WORLD:.1f} m, azimuth {azimuth:g}"
    return Camera.look_at(_position(distance, azimuth), _middle(), fov=fov, size_px=(size, size), name=name)


def _middle() -> np.ndarray:
    """(3,) middle of the upper side of the cloth."""
    return np.append(BOX_WORLD.mean(axis=0)[:2], BOX_WORLD[1, 2])


def _position(distance: float, azimuth: float) -> np.ndarray:
    around, above = np.radians([azimuth, ELEVATION])
    away = np.array([np.cos(above) * np.cos(around), np.cos(above) * np.sin(around), np.sin(above)])
    return np.asarray(_middle() + NEAREST_WORLD * distance * away)


def _views() -> tuple[tuple[float, ...], ...]:
    """Positions and targets of the cameras, rounded to a tenth of a millimetre as they are said in a command."""
    target = _middle()
    cameras = [_position(distance, azimuth) for distance in DISTANCES for azimuth in AZIMUTHS]
    return tuple(tuple(float(value) for value in np.round([*position, *target], 4)) for position in cameras)


SCENE = Scene(
    name="san-miguel-table",
    title="San Miguel, a table",
    file=san_miguel_bare.SCENE.file,
    light=TWO_LIGHTS,
    without=(*san_miguel_bare.SCENE.without, *_TABLEWARE),
    views=_views(),
    # Views of twice the pixels have leaves a level deeper: for the look-ahead of 2 that octrees are fitted to, and 3.
    view_px=SIZE_PX * 2 ** (max(LOOKAHEADS) - 2),
    source=san_miguel_bare.SCENE.source,
    licence=san_miguel_bare.SCENE.licence,
    role=san_miguel_bare.SCENE.role,
)
