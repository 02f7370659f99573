# SPDX-License-Identifier: GPL-3.0-or-later
"""Functions that the tests of the engine process have computed."""

import importlib
import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from patchnet.patchnet_addon.process.segments import shared_zeros
from patchnet.patchnet_addon.process.transfer import Remote
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import Progress, Steps


@dataclass(frozen=True, eq=False)
class Volume:
    """Arrays, equal only to itself."""

    values: np.ndarray
    inner: "Volume | None" = None


class Pair(NamedTuple):
    """Two arrays."""

    one: np.ndarray
    other: np.ndarray


def doubled(values: np.ndarray) -> np.ndarray:
    return values * 2


def pair_of(values: np.ndarray) -> Pair:
    return Pair(values[::3], values[1:])


def same(volume: Volume) -> Volume:
    return volume


def inner_of(volume: Volume) -> tuple[Volume | None, int]:
    return volume.inner, id(volume)


def added(values: np.ndarray, number: float) -> None:
    values += number


def held(values: np.ndarray) -> tuple[Remote[Volume], int]:
    return Remote(Volume(values)), len(values)


def sum_of(volume: Volume) -> float:
    return float(volume.values.sum())


def counting(count: int, pause_s: float = 0.0) -> Steps[int]:
    for number in range(count):
        yield Progress(number, count, f"Number {number}")
        time.sleep(pause_s)
    return count


def filling(size: int) -> Steps[np.ndarray]:
    picture = shared_zeros((size,), np.float32)
    yield Progress(0, size, "Filling", partial=picture)
    for number in range(size):
        picture[number] = number + 1
        yield Progress(number, size, "Filling")
        time.sleep(0.0005)
    return picture


def failing() -> None:
    raise SettingError("Depth 99 is too large: choose less")


def unpicklable() -> None:
    class Local(Exception):
        pass

    raise Local("what")


def asleep(seconds: float, path: Path | None = None) -> str:
    time.sleep(seconds)
    if path is not None:
        path.write_text("done")
    return "awake"


def killed(number: int = signal.SIGKILL) -> None:
    os.kill(os.getpid(), number)


def place_of(package: str) -> str | None:
    return importlib.import_module(package).__file__


def process_facts() -> dict[str, object]:
    return {"pid": os.getpid(), "numba": "numba" in sys.modules, "executable": sys.executable}


def kernel_total(values: np.ndarray) -> float:
    from patchnet.tests.engine.process_kernel import total  # only the engine imports numba

    return float(total(values))
