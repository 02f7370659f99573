# SPDX-License-Identifier: GPL-3.0-or-later
"""Sports car with smooth surfaces."""

from ..scene import TEST, TWO_LIGHTS, Scene

SCENE = Scene(
    name="sports-car",
    title="Sports car",
    file="sports_car.glb",
    light=TWO_LIGHTS,
    source="Sports car by Yasutoshi Mori",
    licence="CC BY 4.0",
    role=TEST,
)
