# SPDX-License-Identifier: GPL-3.0-or-later
"""What unexpected errors leave out of a job that goes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .errors import PatchNetError
from .log import omitted
from .quantities import subject

_EXPLAINED = (PatchNetError, ImportError, MemoryError)  # these end the job with a sentence of their own
_logged: set[str] = set()  # what is read over and over is logged once


class Omissions:
    """Names of what unexpected errors left out, and the first of these errors."""

    def __init__(self) -> None:
        self._names: dict[str, None] = {}
        self._first = ""

    def __contains__(self, name: str) -> bool:
        return name in self._names

    @contextmanager
    def leaving_out(self, name: str) -> Iterator[None]:
        """Note and log an unexpected error within the block, which concerns `name` alone, and go on behind it."""
        try:
            yield
        except _EXPLAINED:
            raise
        except Exception as error:  # noqa: BLE001
            text = f"{type(error).__name__}: {error}"
            self._names[name] = None
            self._first = self._first or text
            if (said := f"'{name}': {text}") not in _logged:
                _logged.add(said)
                omitted(error, said)

    def sentences(self, kind: str, outcome: str) -> list[str]:
        """Sentence that these things of a kind are `outcome`; none without any."""
        where = "the log and Copy Diagnostics have its traceback"
        names = subject(kind, self._names)
        return [f"{names} {outcome}, after an unexpected error ({self._first}): {where}"] if names else []
