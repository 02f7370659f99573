# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of the networks of a run: what each is, what it took, its errors on scenes that it did not see."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...patchnet_addon.runtime.replace import replaced_file
from .files import OUTPUTS, TABLE, VALUES

TITLE = "# Networks of the paper"
_HEAD = ("network", "learned from", "encoder", "look-ahead", "parameters", "passes", "seconds")
_MEANING = (
    "Parameters: of encoder + decoder. Seconds: of training. Then errors of coverage (of luminance, over that of the "
    "voxel's own) on samples of each scene that the network has not seen."
)


def write_tables(out: Path, settings: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write networks.json and networks.md into `out`; raises OutputError."""
    values = {"networks_of_paper": dict(settings), "networks": list(rows)}
    texts = {VALUES: json.dumps(values, indent=1, allow_nan=False), TABLE: markdown_of(rows)}
    for name, text in texts.items():
        with replaced_file(out / name, OUTPUTS[name]) as file:
            file.write(text.encode())


def markdown_of(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows of networks as a table, with a column for each scene."""
    scenes = list(dict.fromkeys(scene for row in rows for scene in (*row["scenes"], *row["errors"])))
    lines = [[*_HEAD, *scenes], ["---"] * (len(_HEAD) + len(scenes))]
    for row in rows:
        about = [
            f"`{row['network']}`", ", ".join(row["scenes"]), row["encoder"], str(row["look_ahead"]),
            f"{row['encoder_parameters']:,} + {row['decoder_parameters']:,}", f"{row['passes']:,}",
            f"{row['seconds']:,.0f}",
        ]  # fmt: skip
        lines.append([*about, *(_error(row["errors"].get(scene)) for scene in scenes)])
    return "\n".join([TITLE, "", _MEANING, "", *("| " + " | ".join(line) + " |" for line in lines), ""])


def _error(errors: Mapping[str, float] | None) -> str:
    if errors is None:
        return "seen"
    ratio = errors["luminance_ratio"]
    return f"{errors['coverage']:.4f} ({'-' if ratio is None else f'{ratio:.2f}'})"
