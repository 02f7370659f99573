# SPDX-License-Identifier: GPL-3.0-or-later
"""Start of a real Blender, with and without a window."""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 15.0  # three times the longest that a stop may take: machines that test do other things too
SCREEN = (1500, 1500)  # as high as the tab with all its lines
SMALL_SCREEN = (1000, 800)  # drawn and rendered sooner


@dataclass(frozen=True)
class Blender:
    """Command that starts it: a prefix of the command line, and the variables it is given."""

    prefix: tuple[str, ...]
    program: str
    environment: dict[str, str]

    def run(self, *arguments: str | Path, seconds: float = 300.0) -> subprocess.CompletedProcess[str]:
        """Run Blender without a window to its end."""
        return self._start((self.program, *map(str, arguments)), seconds)

    def start(self, *arguments: str | Path) -> subprocess.Popen[str]:
        """Start Blender without a window; the process is Blender's own, so that it can be sent signals."""
        words = self._words((self.program, *map(str, arguments)))
        return subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

    def run_window(
        self,
        *arguments: str | Path,
        seconds: float = 400.0,
        simulate: bool = True,
        screen: tuple[int, int] = SCREEN,
        backend: str = "",
    ) -> subprocess.CompletedProcess[str]:
        """Run Blender with a window on a virtual screen to its end.

        simulate: it hears events that its scripts simulate, and then none of the window system's.
        screen: its width and height in pixels, which are the window's. backend: graphics library, such as "vulkan".
        """
        width, height = screen
        virtual = ("xvfb-run", "-a", "-s", f"-screen 0 {width}x{height}x24")
        place = (*(("--enable-event-simulate",) if simulate else ()), "-p", "0", "0", str(width), str(height))
        library = ("--gpu-backend", backend) if backend else ()
        return self._start((*virtual, self.program, *library, *place, *map(str, arguments)), seconds)

    def visit(
        self,
        name: str,
        out: Path,
        *arguments: str | Path,
        file: Path | None = None,
        script: str = "",
        ended: str = "",
        simulate: bool = True,
        screen: tuple[int, int] = SMALL_SCREEN,
        backend: str = "",
        seconds: float = 900.0,
    ) -> dict:
        """Let NAME_window.py play in a window that shows a file; its report `out`/NAME.json, and what Blender said.

        Fails if the visit did not come to its end without errors. ended: "problem" of a visit that ends Blender itself.
        """
        path = ROOT / "tests" / "real_blender" / f"{script or name}_window.py"
        opened = () if file is None else (file,)
        done = self.run_window(
            *opened, "-P", path, "--", out, *arguments,
            seconds=seconds, simulate=simulate, screen=screen, backend=backend,
        )  # fmt: skip
        said, report = done.stdout + done.stderr, out / f"{name}.json"
        (out / f"{name}.log").write_text(said)
        assert report.exists(), f"Blender ended with code {done.returncode} before the visit did:\n{said}"
        found: dict = json.loads(report.read_text())
        assert found["problem"] == ended and "Traceback" not in said, f"{found['problem']}\n{said}"
        return found | {"said": said, "code": done.returncode}

    def execute(self, line: str) -> str:
        """Run a line of Python in background; what was printed. Fails if it fails."""
        done = self.run("-b", "--python-exit-code", "1", "--python-expr", line)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def value(self, expression: str) -> str:
        """Evaluate a Python expression in this Blender; its value as text."""
        said = self.execute(f"import addon_utils, bpy, sys; print('value:', {expression})")
        return next(line for line in said.splitlines() if line.startswith("value: ")).removeprefix("value: ")

    def _start(self, command: tuple[str, ...], seconds: float) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            self._words(command), cwd=ROOT, capture_output=True, text=True, timeout=seconds, check=False
        )

    def _words(self, command: tuple[str, ...]) -> tuple[str, ...]:
        variables = tuple(f"{name}={value}" for name, value in self.environment.items())
        return (*self.prefix, "env", *variables, *command)
