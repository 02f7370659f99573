# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance mask of a viewport, read again when other strokes are chosen or painted.

Images are read while the viewport draws. Vertex groups need render geometry, and data must not change while Blender
draws, so a timer reads them between two redraws.
"""

from __future__ import annotations

import time

import bpy
import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError, SettingError
from ..importance.painted import Importance
from ..importance.pixels import Strokes, painted_image, read_strokes
from ..scene_access.own import quiet
from ..scene_access.window_state import Part
from ..schema.values import VISIBLE

_REST = 5.0  # pause between two reads of an image, as a multiple of the time of one


class ViewportMask:
    """Importance mask of painted strokes.

    strokes: None if all pixels matter alike. version: number that changes with the strokes.
    """

    def __init__(self) -> None:
        self.strokes: Strokes | None = None
        self.version = 0
        self._chosen: Importance | None = None
        self._touched = False  # to be read, or read again
        self._reading = False
        self._problem = ""
        self._rest_until = 0.0
        self._where = "", ""  # names of scene and view layer

    @property
    def waiting(self) -> bool:
        """Return whether strokes are still to be read, after this drawing."""
        return self._touched and not self._problem

    def meshes_changed(self) -> None:
        """Note that weights may have been painted."""
        if self._chosen is not None and self._chosen.vertex_group and not self._reading:
            self._touched, self._problem = True, ""

    def ready(self, context: bpy.types.Context, *, idle: bool) -> bool:
        """Return whether `strokes` can be used; old ones are valid until new ones are read.

        idle: no other work is left, so an image may be read again. Raises SettingError if the painted image or vertex
        group does not exist.
        """
        values = context.scene.patchnet
        chosen = Importance.chosen(values.importance, values.importance_image, values.importance_group)
        if chosen != self._chosen:
            self._chosen, self._touched, self._problem = chosen, chosen is not None, ""
            self._take(None)
        if chosen is not None and not chosen.vertex_group:
            self._look_at_image(chosen.image, idle)
        elif self._touched:
            self._where = context.scene.name, context.view_layer.name
            if self not in _waiting():
                _waiting().append(self)
            if not bpy.app.timers.is_registered(_read_masks):
                bpy.app.timers.register(_read_masks)
        if self._problem:
            raise SettingError(self._problem)
        return chosen is None or self.strokes is not None

    def _take(self, strokes: Strokes | None) -> None:
        self.strokes = strokes
        self.version += 1

    def _look_at_image(self, name: str, idle: bool) -> None:
        before = None if self.strokes is None else self.strokes.picture
        if before is not None and not idle:
            return
        start = time.perf_counter()
        if before is not None and start < self._rest_until:
            self._touched = True  # perhaps, by the last stroke
            return
        picture = painted_image(name)
        end = time.perf_counter()
        self._touched, self._rest_until = False, end + _REST * (end - start)
        if before is None or not np.array_equal(picture, before):
            self._take(Strokes(picture=picture))

    def read(self) -> None:
        """Read the strokes of a vertex group."""
        scene = bpy.data.scenes.get(self._where[0])
        layer = scene and scene.view_layers.get(self._where[1])
        if layer is None or self._chosen is None:
            return
        self._touched, self._reading = False, True
        try:
            layer.update()
            with quiet():
                self._take(read_strokes(self._chosen, VISIBLE, layer.depsgraph))
        except PatchNetError as error:
            self._problem = str(error)
        finally:
            self._reading = False


_waiting = Part("masks", list[ViewportMask])  # to read between two redraws


def _read_masks() -> None:
    while _waiting():
        _waiting().pop(0).read()


TIMERS = (_read_masks,)
