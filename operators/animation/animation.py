# SPDX-License-Identifier: GPL-3.0-or-later
"""Animation frames, made one after the other, each in a folder of its own; finished ones are skipped."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.runtime.eta import FramesEta
from ...patchnet_addon.runtime.file_kinds import FRAME_RECORD, REPORT
from ...patchnet_addon.runtime.frames import errors_of_frame
from ...patchnet_addon.runtime.outputs import check_outputs, check_room
from ...patchnet_addon.runtime.progress import Progress, Result, Steps, changed
from ...patchnet_addon.runtime.quantities import counted
from ...patchnet_addon.sampling.report import ERROR_UNIT
from ..cycles.daylight import has_light
from ..pipeline.output_files import output_folder
from ..pipeline.reports import REPORT_NAME, files_in, machine, versions, write_json
from ..scene.read import read_scene
from ..scene_access.frames import kept_frame
from ..settings.groups import Bounds
from ..settings.job_settings import JobSettings
from .frame_maker import (
    RECORD_NAME,
    FrameRecord,
    JobMaker,
    content_key,
    frame_folder,
    read_record,
)


def same_daylight(context: bpy.types.Context, frames: Sequence[int]) -> Steps[bool]:
    """Return whether no frame has light, so that sun and sky are added; dark frames of a scene with lamps get none."""
    for done, frame in enumerate(frames):
        yield Progress(done, len(frames), "Looking for light")
        context.scene.frame_set(frame)
        if has_light(context.evaluated_depsgraph_get()):
            return False
    return True


def same_bounds(context: bpy.types.Context, frames: Sequence[int], scope: str) -> Steps[Bounds]:
    """Bounds around the surface at all frames."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for done, frame in enumerate(frames):
        yield Progress(done, len(frames), f"One grid for all frames: frame {frame}")
        context.scene.frame_set(frame)
        with errors_of_frame(frame):
            source = read_scene(context.evaluated_depsgraph_get(), scope)
        low, high = np.minimum(low, source.bounds_world[0]), np.maximum(high, source.bounds_world[1])
    bounds: Any = (tuple(low.tolist()), tuple(high.tolist()))
    return bounds


@dataclass(frozen=True)
class FramePlan:
    """Plan of the frames and their folders.

    overwrite: make finished frames again. one_grid: the octrees of all frames have the same cube.
    """

    frames: tuple[int, ...]
    out: Path
    overwrite: bool = False
    one_grid: bool = False


@dataclass
class AnimationResult:
    """Frames that were made and skipped, figures of all frames, and warnings with their frames."""

    made: list[int] = field(default_factory=list)
    skipped: list[int] = field(default_factory=list)
    report: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def sentence(self) -> str:
        """Summary of what was done."""
        skipped, made = len(self.skipped), {each["frame"]: each for each in self.report["frames"]}
        octrees = len({made[frame].get("voxels_of", frame) for frame in self.made})
        there = f", {skipped} {'was' if skipped == 1 else 'were'} there" if skipped else ""
        shared = f" with the voxels of {octrees}" if octrees < len(self.made) else ""
        return f"{counted(len(self.made), 'frame')} made{shared}{there}"


def bake_frames(context: bpy.types.Context, maker: JobMaker, plan: FramePlan) -> Steps[AnimationResult]:
    """Make the missing frames; each is freed before the next.

    Afterwards, the scene's frame is restored; finished frames stay. Raises PatchNetError that names the frame.
    """
    files, inputs = maker.files(context) | {RECORD_NAME: FRAME_RECORD}, maker.inputs()
    folders = [folder for frame in plan.frames if read_record(folder := frame_folder(plan.out, frame)) is None]
    missing = {folder / name: kind for folder in folders for name, kind in files.items()}
    check_outputs({plan.out / REPORT_NAME: REPORT, **missing}, inputs, folder=plan.out)
    with kept_frame(context.scene):
        settings = maker.shared_settings(context)
        if settings.light.is_baked:
            settings = settings.changed(daylight=(yield from _before_all(same_daylight(context, plan.frames))))
        if plan.one_grid:
            bounds = yield from _before_all(same_bounds(context, plan.frames, settings.surface.scope))
            settings = settings.changed(bounds=bounds)
        animation = _Animation(context, maker, plan, settings)
        yield from animation.find_reference()
        for frame in plan.frames:
            yield from animation.bake(frame)
        animation.write_report(complete=True)
    return animation.result


def _before_all(steps: Steps[Result]) -> Steps[Result]:
    """Report steps before the first frame as 0 % of the animation."""
    return changed(steps, lambda report: replace(report, whole=0.0))


class _Animation:
    """Bake of frames, with the settings that they share, so that their pictures do not flicker.

    If no exposure is given, one frame, the reference, chooses it for all: otherwise, a dimmed lamp would not darken
    pictures. Finished frames keep their reference.
    """

    def __init__(self, context: bpy.types.Context, maker: JobMaker, plan: FramePlan, settings: JobSettings) -> None:
        self._context, self._maker, self._plan, self._settings = context, maker, plan, settings
        self._reference: int | None = None
        self._summaries: dict[int, dict[str, Any]] = {}
        # Frames without a record are likely to be made.
        self._time = FramesEta(sum(plan.overwrite or self._record(frame) is None for frame in plan.frames))
        self.result = AnimationResult()

    def find_reference(self) -> Steps[None]:
        """Choose the frame whose exposure all frames use."""
        if self._settings.light.exposure is not None:
            return
        self._reference = self._plan.frames[0]
        before = _reference_of(self._plan.out)
        if self._plan.overwrite or before is None or (record := self._record(before)) is None:
            return
        yield Progress(0, 1, f"Looking at frame {before}")
        with suppress(PatchNetError):  # the frame may have no surface any more
            if record.content == self._content(before):
                self._reference = before
                self._set_exposure(record.summary)

    def bake(self, frame: int) -> Steps[None]:
        """Make a frame or skip it."""
        record = None if self._plan.overwrite else self._record(frame)
        number = f"Frame {frame}, {self._plan.frames.index(frame) + 1} of {len(self._plan.frames)}"
        with errors_of_frame(frame):
            yield self._at(frame, number, "Looking at the scene")
            content = self._content(frame)
            if record is None or record.content != content:
                if record is not None:
                    self._time.one_more()
                yield from self._make(frame, content, number)
                return
            yield self._at(frame, f"Frame {frame} is there", "skipped")
            self.result.skipped.append(frame)
            self._done(frame, record.summary)

    def _make(self, frame: int, content: str, number: str) -> Steps[None]:
        folder = frame_folder(self._plan.out, frame)
        self._time.begin()
        files, inputs = self._maker.files(self._context), self._maker.inputs()
        with output_folder(folder, files, inputs) as temporary:
            steps = self._maker.make(self._context, self._settings_of(frame), temporary)

            def counted_in(report: Progress) -> Progress:
                label, step = f"{number}: {report.label}", report.step or report.label
                return self._time.see(replace(report, label=label, frame=frame, step=step))

            summary = yield from changed(steps, counted_in)
            written = files_in(temporary)
            (folder / RECORD_NAME).unlink(missing_ok=True)
        write_json(folder / RECORD_NAME, asdict(FrameRecord(frame, content, written, summary)), FRAME_RECORD)
        self._time.end()
        self.result.made.append(frame)
        self._done(frame, summary)
        self.write_report(complete=False)
        if len(self.result.made) == 1:
            missing = [each for each in self._plan.frames if self._record(each) is None]
            check_room(self._plan.out, len(missing) * sum(written.values()), f"{counted(len(missing), 'frame')} more")

    def _at(self, frame: int, number: str, step: str) -> Progress:
        return self._time.skip(Progress(1, 1, f"{number}: {step}", frame=frame, step=step))

    def _done(self, frame: int, summary: dict[str, Any]) -> None:
        self._summaries[frame] = summary
        if frame == self._reference:
            self._set_exposure(summary)

    def _set_exposure(self, summary: dict[str, Any]) -> None:
        self._settings = self._settings.changed(exposure=float(summary["exposure"]))

    def _settings_of(self, frame: int) -> JobSettings:
        return self._settings.changed(exposure=None) if frame == self._reference else self._settings

    def _record(self, frame: int) -> FrameRecord | None:
        record = read_record(frame_folder(self._plan.out, frame))
        return record if record is not None and "exposure" in record.summary else None

    def _content(self, frame: int) -> str:
        """Set the frame of the scene, and return its key."""
        self._context.scene.frame_set(frame)
        return content_key(
            self._context, self._settings.surface.scope, self._maker.settings_text(self._settings_of(frame))
        )

    def write_report(self, *, complete: bool) -> None:
        """Write the report of all finished frames; raises PatchNetError."""
        light, out = self._settings.light, self._plan.out
        self.result.warnings = _warnings(self._summaries)
        self.result.report = {
            "error_unit": ERROR_UNIT,
            "complete": complete,
            "reference": self._reference,
            "exposure": light.exposure,
            "daylight": light.daylight,
            "bounds_world": self._settings.surface.bounds,
            "frames": [
                {"frame": frame, "folder": frame_folder(out, frame).name, **summary}
                for frame, summary in sorted(self._summaries.items())
            ],
            "versions": versions(),
            "machine": machine(),
        }
        write_json(out / REPORT_NAME, self.result.report, REPORT)


def _reference_of(out: Path) -> int | None:
    """Frame that chose the exposure in an earlier call."""
    try:
        number = json.loads((out / REPORT_NAME).read_text(encoding="utf-8"))["reference"]
    except (OSError, ValueError, TypeError, KeyError):
        return None
    return number if isinstance(number, int) else None


def _warnings(summaries: dict[int, dict[str, Any]]) -> tuple[str, ...]:
    """List each warning once, with its frames."""
    frames: dict[str, list[int]] = {}
    for frame, summary in sorted(summaries.items()):
        for text in summary.get("warnings", ()):
            frames.setdefault(text, []).append(frame)
    which = {text: f" and {len(numbers) - 1} more" if numbers[1:] else "" for text, numbers in frames.items()}
    return tuple(f"Frame {numbers[0]}{which[text]}: {text}" for text, numbers in frames.items())
