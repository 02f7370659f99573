# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights files of map networks; needs no torch to be read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ....patchnet_addon.runtime.errors import WeightsFileError
from ....patchnet_addon.runtime.files import content_hash, read_arrays, write_arrays

KIND = "sampling-map"


def save_map(path: Path, network: str, weights: Mapping[str, np.ndarray], notes: Mapping[str, Any]) -> None:
    """Write the weights of the network called `network`, and how they were made; raises OutputError."""
    write_arrays(path, weights, dict(notes) | {"network": network}, KIND)


def read_map(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Weights by name, and how they were made; raises WeightsFileError for a file that is missing, foreign, damaged."""
    return read_arrays(path, KIND, WeightsFileError)


def map_hash(path: Path) -> str:
    """Hash (32 hex digits) of a file's weights, for keys of what depends on them; raises as `read_map`."""
    return content_hash(read_map(path)[0])
