# SPDX-License-Identifier: GPL-3.0-or-later
"""San Miguel without most of its plants, in the light of sun and sky."""

from ..scene import CYCLES, TRAIN, Scene
from .san_miguel import ROOF, SURROUNDINGS

# Names of nodes begin with the plant's name in the model.
_PLANTS = (
    "aglaonema", "azalea", "brevipedunculata", "cercis", "chusan_palm", "cinquefoil", "default_stengel",
    "default_wchrype", "dracaena", "dutch_iris", "fern", "ficus", "fragrans", "geranium", "hoja seca", "hybrids_",
    "ivy", "lagerstroemia", "leave a_", "lilium", "mona_lisa", "oxeye_daisy", "paniceum", "pansy", "pendula",
    "phyllostachya", "poinsettia", "rose", "verschaffeltii", "zebrina",
)  # fmt: skip

SCENE = Scene(
    name="san-miguel-bare",
    title="San Miguel, bare",
    file="san_miguel.glb",
    light=CYCLES,
    without=(*_PLANTS, *SURROUNDINGS),
    bisect=ROOF,
    source="San Miguel by Guillermo M. Leal Llaguno",
    licence="CC BY 3.0",
    role=TRAIN,
)
