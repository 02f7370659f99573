# SPDX-License-Identifier: GPL-3.0-or-later
"""Use of furniture libraries: those for training, those for testing, and the one that nobody here touches.

Models of one source resemble each other, so what is tested with must come from another source than what is learned.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from ..runtime.errors import SettingError
from .archive import LibraryFileError

TRAIN, TEST, FREE = "train", "test", "free"  # FREE: libraries of users, which know best
ROLES = {
    "SweetHome3D#BlendSwap-CC-0-Models": TRAIN,
    "SweetHome3D#BlendSwap-CC-BY-Models": TRAIN,
    "SweetHome3D#ScopiaModels": TRAIN,
    "SweetHome3D#ReallusionModels": TEST,
}
_UNTOUCHED = "katorlegaz"


def is_untouched(text: str) -> bool:
    """Tell whether a name is that of the library that is kept for the tests of others, however it is spelled."""
    return _UNTOUCHED in re.sub(r"[^a-z]", "", text.lower())


def check_touchable(path: Path, *texts: str) -> None:
    """Raise LibraryFileError if the file's name or one of `texts` is that of the library that is not touched."""
    if any(is_untouched(text) for text in (path.name, *texts)):
        raise LibraryFileError(
            f"{path} is the library KatorLegaz, which is kept for the tests of others and never used here: "
            "choose another library"
        )


def role_of(identity: str) -> str:
    """Role of a library by the id in its catalogue."""
    return ROLES.get(identity, FREE)


def common_role(roles: Iterable[str]) -> str:
    """Role of a scene of several libraries; raises SettingError where one is for training and one for testing."""
    found = set(roles)
    if {TRAIN, TEST} <= found:
        raise SettingError(
            "A library for testing and one for training are together in a scene, which could serve neither: "
            "compose a scene of each"
        )
    return next((role for role in (TRAIN, TEST) if role in found), FREE)
