# SPDX-License-Identifier: GPL-3.0-or-later
"""Log on stderr: JSON lines for programs, no duplicates for users."""

import json
import logging

import pytest

from patchnet.patchnet_addon.runtime import log
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import Progress
from patchnet.patchnet_addon.runtime.progress_log import ProgressLog

pytestmark = pytest.mark.usefixtures("text_log")

EVENTS = ("start", "stage", "progress", "warning", "result", "error")


def lines(capsys: pytest.CaptureFixture[str]) -> list[dict]:
    return [json.loads(line) for line in capsys.readouterr().err.splitlines()]


def test_an_event_is_an_object_on_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    log.set_up(log.JSON)
    log.start("run", file="/scene.blend")
    log.event("result", "two\nlines, 100 %s done", file=None, frame=3)
    first, second = lines(capsys)
    assert first["event"] == "start" and first["command"] == "run" and first["seconds"] >= 0.0
    assert second["message"] == "two\nlines, 100 %s done" and second["level"] == "info"
    assert second["frame"] == 3 and "file" not in second
    assert second["time"].endswith("+00:00")


def test_warnings_of_the_engine_are_events(capsys: pytest.CaptureFixture[str]) -> None:
    log.set_up(log.JSON, "ERROR")  # what is asked for in so many words counts more than a preference
    logging.getLogger("patchnet").warning("A page is baked again: %s", "damaged")
    (line,) = lines(capsys)
    assert line["event"] == line["level"] == "warning" and line["message"] == "A page is baked again: damaged"


def test_users_are_told_nothing_twice(capsys: pytest.CaptureFixture[str]) -> None:
    log.set_up(log.TEXT, "INFO")
    for name in EVENTS:
        log.event(name, f"this is {name}", logging.ERROR)
    log.LOG.warning("this is the engine's")
    assert capsys.readouterr().err.splitlines() == ["this is stage", "this is the engine's"]
    log.set_up(log.TEXT)
    log.event("stage", "not at the usual level")
    assert capsys.readouterr().err == ""


def test_variable_chooses_the_format(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(log.VARIABLE, "json")
    log.set_up()
    assert log.is_json()
    log.set_up(log.TEXT)
    assert not log.is_json()
    monkeypatch.setenv(log.VARIABLE, "xml")
    with pytest.raises(SettingError, match="'xml'"):
        log.set_up()


def test_progress_is_said_once_a_second(capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    log.set_up(log.JSON)
    progress = ProgressLog("Run All", lambda: now)
    for done in range(100):
        progress.see(Progress(done, 100, "Baking light"))
        now += 0.25
    progress.see(Progress(0, 1, "Frame 7, 1 of 2: Encoding", frame=7, step="Encoding", whole=0.5))
    said = lines(capsys)
    assert [line["event"] for line in said] == ["stage", *["progress"] * 24, "stage"]
    assert [line["fraction"] for line in said[:3]] == [0.0, 0.04, 0.08]
    assert said[0]["message"] == "Run All: Baking light" and said[0]["stage"] == "Baking light"
    assert 0.0 < said[20]["seconds_left"] < 10.0
    assert said[-1]["frame"] == 7 and said[-1]["stage"] == "Encoding" and said[-1]["whole"] == 0.5
