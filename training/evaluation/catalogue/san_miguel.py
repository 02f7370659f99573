# SPDX-License-Identifier: GPL-3.0-or-later
"""San Miguel, a courtyard with tables, chairs and plants, whole."""

from ..scene import CYCLES, TRAIN, Scene

SCENE = Scene(
    name="san-miguel",
    title="San Miguel",
    file="san_miguel.glb",
    light=CYCLES,
    without=("sun_light", "fill_light"),  # lamps of the model, far above it: they would enlarge the cube
    source="San Miguel by Guillermo M. Leal Llaguno",
    licence="CC BY 3.0",
    role=TRAIN,
)
