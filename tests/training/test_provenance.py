# SPDX-License-Identifier: GPL-3.0-or-later
"""Provenance of a run: commit and command."""

import subprocess
from pathlib import Path

import pytest

from patchnet.training.run.provenance import describe_command, describe_commit


def git(folder: Path, *words: str) -> str:
    who = ("-c", "user.name=Ada", "-c", "user.email=ada@example.org")
    command = ["git", "-C", str(folder), *who, *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    folder = tmp_path / "checkout"
    folder.mkdir()
    git(folder, "init", "-q")
    (folder / "a.py").write_text("a = 1\n")
    git(folder, "add", "a.py")
    git(folder, "commit", "-q", "-m", "First")
    return folder


def test_commit_of_a_checkout(checkout: Path) -> None:
    commit = git(checkout, "rev-parse", "HEAD")
    assert describe_commit(checkout) == commit
    (checkout / "results.txt").write_text("not tracked")
    assert describe_commit(checkout) == commit
    (checkout / "a.py").write_text("a = 2\n")
    assert describe_commit(checkout) == f"{commit}, with changes"


def test_installed_package_has_no_commit(checkout: Path, tmp_path: Path) -> None:
    """Nor does it take that of the repository of somebody else around it."""
    (checkout / "site-packages").mkdir()
    assert describe_commit(checkout / "site-packages") == ""
    assert describe_commit(tmp_path) == ""


def test_command_without_folders() -> None:
    words = "/usr/bin/patchnet lab train /data/samples --out=/home/me/run room=/data/a=b/room.glb /my=data/x --rate 0.1"
    assert describe_command(words.split()) == "patchnet lab train samples --out=run room=room.glb x --rate 0.1"
