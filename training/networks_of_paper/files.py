# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of a run that trains several networks: where each stands in its folder."""

from __future__ import annotations

from pathlib import Path

from ...patchnet_addon.runtime.bounds import DEFAULT_LOOKAHEAD
from ...patchnet_addon.runtime.file_kinds import NETWORKS, NETWORKS_TABLE
from ..data.dataset import SUFFIX
from ..run.run_files import WEIGHTS

RECORD = "record.json"
VALUES, TABLE = "networks.json", "networks.md"
OUTPUTS = {VALUES: NETWORKS, TABLE: NETWORKS_TABLE}


def octrees_folder(out: Path) -> Path:
    """Folder of the scenes' octrees, where `patchnet lab evaluate --out` of the same folder looks for them."""
    return out / "octrees"


def samples_path(out: Path, scene: str, lookahead: int) -> Path:
    """File of a scene's samples."""
    folder = out / "samples"
    return (folder if lookahead == DEFAULT_LOOKAHEAD else folder / f"look-ahead-{lookahead}") / (scene + SUFFIX)


def network_folder(out: Path, name: str) -> Path:
    """Folder of a network's run."""
    return out / "networks" / name


def weights_path(out: Path, name: str) -> Path:
    """File of a network's weights."""
    return network_folder(out, name) / WEIGHTS
