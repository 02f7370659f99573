# SPDX-License-Identifier: GPL-3.0-or-later
"""Script of the engine process: Blender's process starts it, with its settings as a line of JSON in the standard input.

It imports the extension as Blender does, computes for Blender's process, and ends when the input does.
"""

import faulthandler
import importlib
import json
import os
import shutil
import signal
import sys
import threading
from multiprocessing.connection import Listener
from pathlib import Path
from types import ModuleType

_NICE = 10  # Blender's window and Cycles come first where cores are few
_SWITCH_S = 0.001  # between two threads: Blender's window waits for answers while others compute
_STACK_BYTES = 64 << 20  # compilers recurse


def main() -> None:
    """Serve until Blender's process ends."""
    settings = json.loads(sys.stdin.buffer.readline())
    sys.path[:] = settings["path"]
    _import_package(settings["package"], settings["folder"])
    wheels = importlib.import_module(f"{settings['package']}.patchnet_addon.process.own_wheels")
    sys.path[:0] = wheels.own_path()
    # Ctrl-C in a terminal ends this process at once. Blender in background only ends what it renders or bakes, as if
    # that were complete: the next call fails then, before such light is kept.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(os, "nice"):
        os.nice(_NICE)
    faulthandler.enable()
    sys.setswitchinterval(_SWITCH_S)
    threading.stack_size(_STACK_BYTES)
    served = importlib.import_module(f"{settings['package']}.patchnet_addon.process.server")
    engine = served.Engine()
    listener = Listener(settings["address"], authkey=bytes.fromhex(settings["key"]))
    threading.Thread(target=engine.accept, args=(listener,), daemon=True).start()
    sys.stdin.buffer.read()
    engine.finish()
    shutil.rmtree(settings["own_folder"], ignore_errors=True)
    os._exit(0)  # at once: kernels may be running


def _import_package(name: str, folder: str) -> None:
    """Import the extension under its name in Blender, whose parents exist there alone."""
    parents = name.split(".")[:-1]
    for count in range(1, len(parents) + 1):
        parent = ModuleType(".".join(parents[:count]))
        parent.__path__ = [str(Path(folder).parent)] if count == len(parents) else []
        sys.modules[parent.__name__] = parent
    if not parents:
        sys.path.insert(0, str(Path(folder).parent))
    importlib.import_module(name)


if __name__ == "__main__":
    main()
