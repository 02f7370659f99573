# SPDX-License-Identifier: GPL-3.0-or-later
"""Traces of an enabled extension in Blender, to check that disabling removes all of them.

Blender lists classes, properties, handlers, key maps, menus and compatible engines. It has no lists of timers, drawing
callbacks, message bus subscriptions and command line commands: `watch()` records their calls.
"""

from collections.abc import Callable
from typing import Any

import bpy

WORD = "patchnet"
_timers: list[Any] = []
_held: list[tuple[str, Any]] = []  # kind and handle of each registered item
# Spaces that add-ons usually draw in.
_SPACES = ("SpaceView3D", "SpaceImageEditor", "SpaceNodeEditor", "SpaceProperties")


def traces() -> dict[str, list[str]]:
    """Names of everything that PatchNet has registered in Blender, by kind, sorted."""
    found = {
        "classes": [name for name in dir(bpy.types) if WORD in name.lower()],
        "properties": _properties(),
        "handlers": _handlers(),
        "keys": _keys(),
        "drawn by": _draw_functions(),
        "engines": _panels_of_engines(),
        "timers": [str(timer) for timer in _timers if bpy.app.timers.is_registered(timer)],
        "held": [what for what, _ in _held],
    }
    return {kind: sorted(names) for kind, names in found.items() if names}


def watch() -> None:
    """Start recording what PatchNet registers and unregisters."""
    _keep(bpy.utils, "register_cli_command", "command", lambda handle, _values, _settings: handle)
    _drop(bpy.utils, "unregister_cli_command")
    _keep(bpy.msgbus, "subscribe_rna", "message bus", lambda _result, _values, settings: settings["owner"])
    _drop(bpy.msgbus, "clear_by_owner")
    for space in _SPACES:
        _keep(getattr(bpy.types, space), "draw_handler_add", space, lambda handle, _values, _settings: handle)
        _drop(getattr(bpy.types, space), "draw_handler_remove")
    _keep(bpy.app.timers, "register", "timer", lambda _result, values, _settings: _timers.append(values[0]))


def _is_ours(item: Any) -> bool:
    return callable(item) and WORD in str(getattr(item, "__module__", ""))


def _keep(owner: Any, name: str, what: str, key: Callable[[Any, Any, Any], Any]) -> None:
    """Wrap a registering function of Blender to record PatchNet's items; `key` returns an item's handle."""
    before = getattr(owner, name)

    def noted(*values: Any, **settings: Any) -> Any:
        result = before(*values, **settings)
        if any(map(_is_ours, (*values, *settings.values()))):
            found = key(result, values, settings)
            if found is not None:
                _held.append((what, found))
        return result

    setattr(owner, name, staticmethod(noted) if isinstance(owner, type) else noted)


def _drop(owner: Any, name: str) -> None:
    """Wrap an unregistering function of Blender to remove its item from the record."""
    before = getattr(owner, name)

    def noted(item: Any, *values: Any) -> Any:
        _held[:] = [entry for entry in _held if entry[1] is not item and entry[1] != item]
        return before(item, *values)

    setattr(owner, name, staticmethod(noted) if isinstance(owner, type) else noted)


def _properties() -> list[str]:
    types = (getattr(bpy.types, name) for name in dir(bpy.types))
    ids = [kind for kind in types if isinstance(kind, type) and issubclass(kind, bpy.types.ID)]
    owners = [*ids, bpy.types.WindowManager, bpy.types.ViewLayer, bpy.types.Bone]
    return [f"{kind.__name__}.{name}" for kind in owners for name in vars(kind) if WORD in name.lower()]


def _handlers() -> list[str]:
    lists = ((name, getattr(bpy.app.handlers, name)) for name in dir(bpy.app.handlers))
    ours = ((name, item) for name, items in lists if isinstance(items, list) for item in items if _is_ours(item))
    return [f"{name}: {item.__name__}" for name, item in ours]


def _keys() -> list[str]:
    configurations = bpy.context.window_manager.keyconfigs
    maps = (keymap for configuration in (configurations.addon, configurations.user) for keymap in configuration.keymaps)
    return [f"{keymap.name}: {item.idname}" for keymap in maps for item in keymap.keymap_items if WORD in item.idname]


def _draw_functions() -> list[str]:
    """Blender's menus, panels and headers with draw functions of PatchNet."""
    kinds = (kind for base in (bpy.types.Menu, bpy.types.Panel, bpy.types.Header) for kind in base.__subclasses__())
    drawn = ((kind, item) for kind in kinds for item in getattr(getattr(kind, "draw", None), "_draw_funcs", ()))
    return [f"{kind.__name__}: {item.__name__}" for kind, item in drawn if _is_ours(item)]


def _panels_of_engines() -> list[str]:
    """Panels that support a render engine of PatchNet."""
    panels = [kind for kind in bpy.types.Panel.__subclasses__() if kind.is_registered]
    engines = ((kind.__name__, getattr(kind, "COMPAT_ENGINES", ())) for kind in panels)
    return [name for name, names in engines if any(WORD in str(item).lower() for item in names)]
