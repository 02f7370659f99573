# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the tables of fly-throughs in worth-it.md and lab/benchmarks.md from figures of `patchnet bench walkthrough`.

    patchnet bench walkthrough --scene demo ... > demo.json
    patchnet bench walkthrough --scene sponza ... > sponza.json
    python docs/make_walkthroughs.py demo.json sponza.json

Without files from those that lab/walkthroughs.json keeps. A comment above a table names its scenes, in worth-it.md with
the samples of Cycles. Frames are counted by the rule of Bake Fly-Through. Check the sentences about them afterwards.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from statistics import median
from typing import Any

from patchnet.operators.render_engine.fly_through import frames_until_ahead

Report = dict[str, Any]
DOCS = Path(__file__).parent
KEPT = DOCS / "lab" / "walkthroughs.json"
PAGES = DOCS / "worth-it.md", DOCS / "lab" / "benchmarks.md"
_TITLES = {"demo": "courtyard", "sponza": "Sponza"}
_TABLE = re.compile(r"(<!-- (walkthrough|ahead): (.+) -->\n\n\|.+\n\|[-|]+\n)(?:\|.+\n)*")
_RANGE = re.compile(r"from \d+ to \d+ frames on")


def filled(page: str, reports: dict[str, Report]) -> str:
    """A page with the figures of reports, by scene."""
    ahead: list[int] = []

    def table(found: re.Match[str]) -> str:
        if found[2] == "walkthrough":
            rows = _all_rows(reports[found[3]])
        else:
            named = [(reports[scene], samples) for scene, samples in map(str.split, found[3].split(", "))]
            ahead.extend(_ahead(*pair) for pair in named)
            rows = [_rival(*pair) for pair in named]
        return found[1] + "".join(f"| {' | '.join(cells)} |\n" for cells in rows)

    page = _TABLE.sub(table, page)
    return _RANGE.sub(f"from {min(ahead)} to {max(ahead)} frames on", page) if ahead else page


def _frame_s(report: Report, name: str) -> float:
    return float(median(report["frames_s"][name]))


def _once_s(report: Report) -> float:
    return float(sum(report["setup_s"].values()))


def _ahead(report: Report, samples: str) -> int:
    """First frame at which PatchNet has taken no more time than Cycles with so many samples."""
    first = frames_until_ahead(_once_s(report), _frame_s(report, "patchnet"), _frame_s(report, samples))
    assert first is not None, f"PatchNet is never ahead of Cycles with {samples} samples: name other ones"
    return first


def _all_rows(report: Report) -> list[list[str]]:
    """Time, error and flicker of PatchNet and of Cycles by its samples."""
    rows = []
    for name, total_s in report["total_s"].items():
        ours = name == "patchnet"
        title = "PatchNet" if ours else f"Cycles, {name} samples{', denoised' if report['denoised'] else ''}"
        errors = [f"{report[kind][name] * 1e4:.1f}" for kind in ("mse", "flicker", "moved")]
        once = _once_s(report) if ours else 0.0
        rows.append([title, f"{once:.1f}", f"{_frame_s(report, name):.2f}", f"{total_s:.0f}", *errors])
    return rows


def _rival(report: Report, samples: str) -> list[str]:
    """PatchNet beside Cycles with some samples."""
    ours, peer = _frame_s(report, "patchnet"), _frame_s(report, samples)
    errors = ", ".join(f"{report['mse'][name] * 1e4:.1f}" for name in ("patchnet", samples))
    return [
        f"{_TITLES[report['scene']]}, Cycles with {samples} samples and its denoiser",
        f"{_once_s(report):.0f}",
        f"{ours:.2f}, {peer:.2f}",
        errors,
        f"{_ahead(report, samples)} frames",
        f"{peer / ours:.2g} times as fast a frame",
    ]


def main() -> None:
    """Write the pages, and keep the figures."""
    parser = argparse.ArgumentParser(description="Write tables of fly-throughs.")
    parser.add_argument("reports", type=Path, nargs="*", help="output of `patchnet bench walkthrough`")
    reports = json.loads(KEPT.read_text())
    for path in parser.parse_args().reports:
        report = json.loads(path.read_text())
        reports[report["scene"]] = report
    KEPT.write_text(json.dumps(reports, indent=1) + "\n")
    for page in PAGES:
        page.write_text(filled(page.read_text(), reports))


if __name__ == "__main__":
    main()
