# SPDX-License-Identifier: GPL-3.0-or-later
"""Versions of PatchNet and of installed packages; imports none of them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_MANIFEST = Path(__file__).parents[2] / "blender_manifest.toml"


def own_version() -> str:
    """Version of PatchNet, as its manifest states it."""
    return str(tomllib.loads(_MANIFEST.read_text(encoding="utf-8"))["version"])


def installed_version(package: str) -> str | None:
    """Version of a package, None if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def installed_versions(packages: Iterable[str]) -> list[str]:
    """Names and versions of the installed ones of `packages`."""
    return [f"{package} {found}" for package in packages if (found := installed_version(package)) is not None]
