# SPDX-License-Identifier: GPL-3.0-or-later
"""San Miguel, a courtyard with tables, chairs and plants, its roof cut off, so that one can look into it."""

from ..scene import CYCLES, TRAIN, Scene

# Lamps far above the model, and the street and ground around the house: they would enlarge the cube.
SURROUNDINGS = ("sun_light", "fill_light", "baked:negro", "baked:banqueta", "calle")
ROOF = ("z", 0.76)  # below the ceilings of the upper floor; light is still that of the whole house

SCENE = Scene(
    name="san-miguel",
    title="San Miguel",
    file="san_miguel.glb",
    light=CYCLES,
    without=SURROUNDINGS,
    bisect=ROOF,
    source="San Miguel by Guillermo M. Leal Llaguno",
    licence="CC BY 3.0",
    role=TRAIN,
)
