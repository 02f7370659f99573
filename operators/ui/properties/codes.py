# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the codes: the network's weights, and the device that encodes."""

from __future__ import annotations

from .shapes import device_choice, relative_path


class CodesProperties:
    """Which network looks ahead."""

    weights: relative_path("Weights", "Weights file; empty for the one that is shipped", "FILE_PATH")
    encoder_device: device_choice(
        "Encode On",
        "What the network encodes on. The codes are the same",
        automatic="The Python of the preferences if one is named, else a GPU where torch has one, else CPU",
        cpu="All cores of the CPU, without torch if none is there",
        gpu="An NVIDIA GPU through torch; an error if there is none",
    )
