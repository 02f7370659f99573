# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine process: what it computes equals what this process computes; its stop, its end, and memory that both share."""

import gc
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.process import client
from patchnet.patchnet_addon.process import computed as process
from patchnet.patchnet_addon.process.computed import answer, computed, engine_pid, settle
from patchnet.patchnet_addon.process.segments import segment_of
from patchnet.patchnet_addon.runtime import threads
from patchnet.patchnet_addon.runtime.compiling import NOTE
from patchnet.patchnet_addon.runtime.errors import EngineGoneError, SettingError
from patchnet.patchnet_addon.runtime.progress import Progress, Steps, drain
from patchnet.tests.engine import process_work as work
from patchnet.tests.engine.octree_samples import random_octree

AT = Progress(0, 1, "Working")


@pytest.fixture
def engine() -> Iterator[None]:
    process.use_engine_process()
    yield
    process.leave_engine_process()


def is_running(pid: int) -> bool:
    """Return whether a process runs; one that has ended may still wait for its parent."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def ends_within(pid: int, seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    while is_running(pid) and time.monotonic() < deadline:
        time.sleep(0.01)
    return not is_running(pid)


@pytest.fixture(params=["inside", "process"])
def both(request: pytest.FixtureRequest) -> Iterator[str]:
    """Compute in this process, and in the engine's."""
    if request.param == "process":
        process.use_engine_process()
    yield request.param
    process.leave_engine_process()


@pytest.mark.usefixtures("both")
def test_results_are_equal() -> None:
    values = np.random.default_rng(0).normal(size=100_000)
    assert np.array_equal(answer(work.doubled, values), 2 * values)
    one, other = answer(work.pair_of, values)
    assert np.array_equal(one, values[::3]) and np.array_equal(other, values[1:])
    few = np.arange(4)[::-1]
    assert np.array_equal(answer(work.doubled, few), 2 * few)
    records = np.zeros(500, [("key", np.uint64), ("place", np.float32, 3)])
    records["key"] = np.arange(500)
    assert np.array_equal(answer(work.pair_of, records).other, records[1:])
    assert answer(work.kernel_total, values) == pytest.approx(values.sum())


@pytest.mark.usefixtures("both")
def test_steps_report_and_return() -> None:
    reports = []
    assert drain(computed(work.counting, 5, 0.02, at=AT), reports.append) == 5
    labels = list(dict.fromkeys(report.label for report in reports))
    assert labels == ["Working", *(f"Number {number}" for number in range(5))]


@pytest.mark.usefixtures("both")
def test_errors_are_those_of_the_function() -> None:
    with pytest.raises(SettingError, match="Depth 99 is too large: choose less"):
        answer(work.failing)
    with pytest.raises(Exception, match="what"):
        answer(work.unpicklable)
    assert answer(len, [1, 2]) == 2


@pytest.mark.usefixtures("both")
def test_remotes_stay_where_they_are() -> None:
    remote, count = answer(work.held, np.ones(1000))
    assert count == 1000
    assert answer(work.sum_of, remote) == 1000.0


@pytest.mark.usefixtures("both")
def test_partial_results_are_shown_while_they_grow() -> None:
    steps, picture, seen = computed(work.filling, 200), None, []
    for report in steps:
        picture = report.partial if report.partial is not None else picture
        if picture is not None:
            seen.append(int(np.count_nonzero(picture)))
    assert picture is not None and len(set(seen)) > 3 and seen == sorted(seen)
    assert np.array_equal(picture, np.arange(1, 201))


@pytest.mark.usefixtures("engine")
def test_another_process_computes() -> None:
    facts = answer(work.process_facts)
    assert facts["pid"] == engine_pid() != os.getpid()


@pytest.mark.usefixtures("engine")
def test_arrays_are_shared() -> None:
    values = answer(work.doubled, np.ones(100_000))
    assert segment_of(values) is not None
    answer(work.added, values, 3.0)
    assert (values == 5.0).all()
    part = values.reshape(100, 1000)[10:20, ::2]
    answer(work.added, part, 1.0)
    assert (part == 6.0).all() and values.sum() == 5.0 * 100_000 + part.size


@pytest.mark.usefixtures("engine")
def test_objects_stay_themselves() -> None:
    inner = work.Volume(np.arange(5000))
    volume = work.Volume(np.zeros(4), inner)
    assert answer(work.same, volume) is volume
    found, first = answer(work.inner_of, volume)
    assert found is inner
    assert answer(work.inner_of, volume)[1] == first, "the engine has kept it"
    made = answer(work.same, answer(work.held, np.ones(3))[0])
    assert isinstance(made, work.Volume) and answer(work.same, made) is made


@pytest.mark.usefixtures("engine")
def test_memory_is_freed() -> None:
    """Segments and objects go as soon as this process has none of their arrays."""

    def segments(pid: int) -> int:
        return sum("memfd:patchnet" in line for line in Path(f"/proc/{pid}/maps").read_text().splitlines())

    answer(len, [])
    pid = engine_pid()
    assert pid is not None
    kept = [answer(work.doubled, np.ones(100_000)) for _ in range(5)]
    kept.append(work.Volume(np.ones(100_000)))
    answer(work.same, kept[-1])
    assert segments(os.getpid()) == 5 and segments(pid) >= 1
    kept.clear()
    gc.collect()
    answer(len, [])
    time.sleep(0.3)
    assert segments(os.getpid()) == 0
    assert segments(pid) == 0


@pytest.mark.usefixtures("engine")
def test_closing_stops_after_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "_STOP_S", 10.0)
    answer(len, [])
    pid, steps = engine_pid(), computed(work.counting, 1000, 0.01, at=AT)
    for _ in range(20):
        next(steps)
    steps.close()
    settle()
    assert engine_pid() == pid, "a short step ends by itself"


def assert_killed(steps: Steps[object]) -> None:
    """Close steps that the engine cannot end soon."""
    begun, pid = time.monotonic(), engine_pid()
    steps.close()
    settle()
    assert time.monotonic() - begun < 2.0, "0.2 s, beside other processes"
    assert pid is not None and not is_running(pid)


@pytest.mark.usefixtures("engine")
def test_a_long_step_is_killed() -> None:
    answer(len, [])
    steps = computed(work.asleep, 60.0, at=AT)
    for _ in range(20):
        next(steps)
    assert_killed(steps)
    begun = time.monotonic()
    assert answer(len, [1]) == 1
    assert time.monotonic() - begun < 5.0, "0.1 s, beside other processes"


@pytest.mark.usefixtures("engine")
def test_a_compiling_step_is_killed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(client, "user_cache_folder", lambda: tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # no kernels are copied from there
    steps = computed(encode_octree, random_octree(), load_weights(), at=AT)
    assert any(report.note == NOTE for report in steps)
    assert_killed(steps)


@pytest.mark.usefixtures("engine")
def test_the_end_of_the_engine_is_told() -> None:
    volume = work.Volume(np.arange(5000.0))
    shown = answer(work.doubled, volume.values)
    remote, _ = answer(work.held, shown)
    with pytest.raises(EngineGoneError, match=r"PatchNet's engine has ended \(signal 9\): run this again"):
        answer(work.killed)
    assert shown[7] == 14.0, "results stay"
    with pytest.raises(EngineGoneError, match="ended meanwhile"):
        answer(work.sum_of, remote)
    assert answer(work.same, volume) is volume
    assert np.array_equal(answer(work.doubled, shown), 2 * shown), "they are handed to the next engine"


ENDING = """
import sys, time
from pathlib import Path
sys.path[:] = {path!r}
from patchnet.patchnet_addon.process import client
from patchnet.patchnet_addon.process import computed as process
from patchnet.tests.engine import process_work as work
process.use_engine_process()
print(process.answer(work.process_facts)["pid"], flush=True)
steps = process.computed(work.asleep, 1.0, Path({file!r}), lasts={lasts})
for _ in range(10):
    next(steps)
{end}
"""


@pytest.mark.parametrize("end", ["pass", "import os; os._exit(3)", "import os; os.kill(os.getpid(), 9)"])
@pytest.mark.parametrize("lasts", [False, True])
def test_it_ends_with_its_owner(end: str, lasts: bool, tmp_path: Path) -> None:
    file = tmp_path / "file"
    code = ENDING.format(path=sys.path, file=str(file), lasts=lasts, end=end)
    temporary = os.environ | {"TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=temporary)
    pid = int(done.stdout)
    assert ends_within(pid, 20.0), done.stderr
    assert file.exists() == lasts
    assert [path for path in tmp_path.iterdir() if path != file] == [], "its folder goes with it"


def test_ten_owners_have_ten_engines(tmp_path: Path) -> None:
    code = ENDING.format(path=sys.path, file=str(tmp_path / "file"), lasts=False, end="sys.stdin.read()")
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    owners = [subprocess.Popen([sys.executable, "-c", code], **pipes) for _ in range(10)]
    pids = [int(owner.stdout.readline()) for owner in owners]
    assert len(set(pids)) == 10 and all(map(is_running, pids))
    for owner in owners:
        owner.kill()
        owner.communicate()
    assert all(ends_within(pid, 20.0) for pid in pids)


@pytest.mark.usefixtures("engine")
def test_a_forbidden_process_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_words: object, **_how: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(subprocess, "Popen", forbidden)
    monkeypatch.setattr(threads, "_limit", None)
    assert answer(work.process_facts)["pid"] == os.getpid()
    assert process.refused().startswith("PatchNet cannot start its engine process (Permission denied): allow")
    assert threads.thread_count() == 1


@pytest.mark.usefixtures("engine")
def test_python_that_does_not_run_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "_python", lambda: "/bin/false")
    monkeypatch.setattr(threads, "_limit", None)
    assert answer(work.process_facts)["pid"] == os.getpid()
    assert "(exit code 1)" in process.refused()
