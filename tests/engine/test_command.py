# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: help, wrong words, bad input, interruption."""

import platform
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from patchnet import commands
from patchnet.patchnet_addon.runtime.errors import PatchNetError
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.training import commands as all_commands


@pytest.mark.parametrize("program", [["-m", "patchnet"], [str(Path(sys.executable).with_name("patchnet"))]])
def test_help_of_both_entry_points(program: list[str]) -> None:
    command = [sys.executable, *program] if program[0] == "-m" else program
    done = subprocess.run([*command, "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "usage: patchnet" in done.stdout
    for name in (*commands.NAMES, *all_commands.NAMES):
        assert name in done.stdout


@pytest.mark.parametrize("name", [*commands.NAMES, *all_commands.NAMES])
def test_help_of_every_sub_command(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        all_commands.main([name, "--help"])
    assert stop.value.code == 0
    assert f"usage: patchnet {name}" in capsys.readouterr().out


@pytest.mark.parametrize(
    "argv",
    [
        ["nonsense"], [], ["--nonsense"], ["run", "a.blend", "--scope", "some"], ["bench", "nothing"],
        ["lab", "train", "x", "--out", "y", "--network", "deep"],
    ],
)  # fmt: skip
def test_wrong_words_are_one_sentence_and_exit_2(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        all_commands.main(argv)
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("patchnet: error: ") and said.count("\n") == 1 and "--help` lists" in said


def test_help_of_run_names_every_strategy_and_its_rays(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        commands.main(["run", "--help"])
    said = " ".join(capsys.readouterr().out.split()).replace("- ", "-")  # argparse breaks lines at hyphens
    assert all(f"{name} ({strategy.cost})" in said for name, strategy in STRATEGIES.items())
    assert "patchnet-plus (6 rays a pixel)" in said and "optimal (oracle: needs the reference)" in said


def test_version_names_what_computes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        commands.main(["--version"])
    said = capsys.readouterr().out
    assert not stop.value.code and said.startswith("patchnet 1.") and said.count("\n") == 1
    assert f"numpy {np.__version__}" in said and f"Python {platform.python_version()}" in said


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (PatchNetError("nothing is selected; select a mesh"), 2, "error: nothing is selected; select a mesh\n"),
        (OSError(28, "No space left on device", "/cache/a"), 2, "error: /cache/a: No space left on device; "),
    ],
)
def test_errors_are_one_line_and_an_exit_code(
    error: Exception, code: int, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(args) -> int:
        raise error

    module = SimpleNamespace(add_arguments=lambda parser: parser.add_argument("name"), run=run)
    monkeypatch.setitem(sys.modules, "patchnet.commands.greet", module)
    monkeypatch.setitem(commands.NAMES, "greet", "greet a user")
    assert commands.main(["greet", "Ada"]) == code
    written = capsys.readouterr().err
    assert written.startswith(f"patchnet: {said}") and written.count("\n") == 1
