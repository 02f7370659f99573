# SPDX-License-Identifier: GPL-3.0-or-later
"""Setting: the declaration of one value that users choose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from ...patchnet_addon.runtime.bounds import Bounds


class Kind(Enum):
    """Type of a setting's value. AUTOMATIC: a number that is found where it is 0. SHARE: 0 to 1. PAIR: two numbers."""

    NUMBER = "number"
    AUTOMATIC = "automatic"
    SHARE = "share"
    SWITCH = "switch"
    CHOICE = "choice"
    TEXT = "text"
    PAIR = "pair"
    FILE = "file"
    FOLDER = "folder"


class Effect(Enum):
    """Effect of a setting on the result of its step.

    ALWAYS: another value gives another result. PERHAPS: it bounds or decorates the result, which is told as stale by
    nothing, but kept apart by keys. NEVER: it decides what computes.
    """

    ALWAYS = "always"
    PERHAPS = "perhaps"
    NEVER = "never"


@dataclass(frozen=True, eq=False)
class Setting:
    """Row of the table of settings.

    name: of the property of scenes and operators. label, description: as the panel shows them. stage: of the job.
    bounds: of a number. choices: (value, label, description) of a CHOICE. field_name: its flat name in `JobSettings`,
    if that is another one. effect: on the result. counts: whether it matters beside the other values. argument: of the
    command line, "" for none or for one that means something else, --no-NAME of a switch that is on; help, unit: of it.
    widget: further options of the property. automatic: what 0 means, in two words, where a checkbox says so; first: the
    number that the checkbox begins with, of a PAIR each side's.
    """

    name: str
    label: str
    description: str
    stage: str
    kind: Kind
    default: Any = None
    bounds: Bounds | None = None
    choices: tuple[tuple[str, str, str], ...] = ()
    field_name: str = ""
    effect: Effect = Effect.ALWAYS
    counts: Callable[[Any], bool] = lambda _: True
    argument: str = ""
    help: str = ""
    unit: str = ""
    widget: Mapping[str, Any] = field(default_factory=dict)
    automatic: str = ""
    first: Any = None

    @property
    def job_field(self) -> str:
        """Its flat name in `JobSettings`."""
        return self.field_name or self.name
