# SPDX-License-Identifier: GPL-3.0-or-later
"""Ducts, pipes and wires of a clinic without its walls, in the place of the paper's power plant."""

from ..scene import TRAIN, TWO_LIGHTS, Scene

SCENE = Scene(
    name="clinic",
    title="Clinic",
    file="bim_clinic.glb",
    light=TWO_LIGHTS,
    without=("architectural", "structural"),
    source="Medical-Dental Test Files by buildingSMART International",
    licence="CC BY 4.0",
    role=TRAIN,
)
