# SPDX-License-Identifier: GPL-3.0-or-later
"""Clinic with ducts, wires and shell, in the place of the paper's power plant."""

from ..scene import TRAIN, TWO_LIGHTS, Scene

SCENE = Scene(
    name="clinic",
    title="Clinic",
    file="bim_clinic.glb",
    light=TWO_LIGHTS,
    source="Medical-Dental Test Files by buildingSMART International",
    licence="CC BY 4.0",
    role=TRAIN,
)
