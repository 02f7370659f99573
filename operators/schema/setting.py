# SPDX-License-Identifier: GPL-3.0-or-later
"""Setting: the declaration of one value that users choose, as the metadata of the field that holds it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from typing import Any

from ...patchnet_addon.runtime.bounds import Bounds
from ...patchnet_addon.runtime.errors import SettingError


class Kind(Enum):
    """Type of a setting's value.

    AUTOMATIC: a number that is found where it is 0. SHARE: 0 to 1. TEXT: names with commas between. PAIR: two numbers.
    """

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


class Place(Enum):
    """Panel of a setting. OWN: that of its stage. ADVANCED: a closed part of it. FIRST: the first panel of the tab."""

    OWN = "own"
    ADVANCED = "advanced"
    FIRST = "first"
    COMPARE = "compare"


@dataclass(frozen=True, eq=False)
class Setting:
    """Declaration of a setting, a row of the table of settings.

    label, description: as the panel shows them. stage: of the job. default: in jobs; shown: of the property, if that is
    another one. name: of the property of scenes and operators, if it is not that of the field.
    bounds: of a number. choices: (value, label, description) of a CHOICE. gone: numbers of former choices, which files
    may hold. check: of a value that is not one of the choices alone; raises SettingError. effect: on the result.
    counts: whether it matters beside the other values; active: whether panels do not gray it out. place: in panels.
    argument: of the command line if it is not --NAME, "" for none; --no-NAME too, of a switch that is on; help, unit:
    of it. widget: further options of the property. automatic: what 0 or an empty text means, in two words; first: the
    number that a checkbox begins with, of a PAIR each side's.
    """

    label: str
    description: str
    stage: str
    kind: Kind
    default: Any = None
    bounds: Bounds | None = None
    shown: Any = None
    name: str = ""
    choices: tuple[tuple[str, str, str], ...] = ()
    gone: frozenset[int] = frozenset()
    check: Callable[[Any], object] | None = None
    effect: Effect = Effect.ALWAYS
    counts: Callable[[Any], bool] = lambda _: True
    active: Callable[[Any], bool] = lambda _: True
    place: Place = Place.OWN
    argument: str | None = None
    help: str = ""
    unit: str = ""
    widget: Mapping[str, Any] = field(default_factory=dict)
    automatic: str = ""
    first: Any = None

    @property
    def flag(self) -> str:
        """Argument of the command line, "" for none."""
        return f"--{self.name.replace('_', '-')}" if self.argument is None else self.argument

    def as_field(self, *, before: tuple[Setting, ...] = (), after: tuple[Setting, ...] = ()) -> Any:
        """Field of a dataclass that holds the setting's value.

        before, after: settings around it whose values the field's follows from; they have no fields.
        """
        rows = {_OWN: self, _ALL: (*before, self, *after)}
        return field(default=self.default, repr=self.effect is not Effect.NEVER, metadata=rows)

    def check_value(self, value: Any) -> None:
        """Raise SettingError for a value outside bounds or choices; None is automatic."""
        if self.check is not None:
            self.check(value)
        elif self.choices and value not in (known := [choice for choice, _, _ in self.choices]):
            raise SettingError(f"{self.label} {value!r} is unknown: choose one of {', '.join(known)}")
        elif self.bounds is not None and value is not None:
            for number in value if self.kind is Kind.PAIR else (value,):
                self.bounds.check(number)


_OWN, _ALL = "setting", "settings"  # metadata of a field: its own setting, and those around it too


def rows_of(group: type) -> Iterator[Setting]:
    """Settings that the fields of a dataclass declare, in their order."""
    for item in fields(group):
        for row in item.metadata.get(_ALL, ()):
            yield replace(row, name=row.name or item.name)


def names_of(group: type) -> dict[str, str]:
    """Fields of a dataclass by the names of their settings, others by their own."""
    found = [(item.metadata.get(_OWN), item.name) for item in fields(group)]
    return {name if row is None else row.name or name: name for row, name in found}


def check_values(group: Any) -> None:
    """Raise SettingError for a value of a dataclass outside the bounds or choices of its setting."""
    for item in fields(group):
        if _OWN in item.metadata:
            item.metadata[_OWN].check_value(getattr(group, item.name))
