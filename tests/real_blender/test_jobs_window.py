# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the report of jobs_window.py: Blender stays usable during a job."""

from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

BLOCKS = "{kind: sorted(item.name for item in getattr(bpy.data, kind)) for kind in KINDS}"
KINDS = ("objects", "meshes", "materials", "worlds", "lights", "cameras", "collections", "scenes", "node_groups")


@pytest.fixture(scope="module")
def jobs(installed: Blender, courtyard: Path, out: Path) -> dict:
    """Report of jobs_window.py."""
    return installed.visit("jobs", out, file=courtyard)


def test_keys_and_menus_save_beside_a_job(jobs: dict) -> None:
    assert jobs["saves"] == 2


def test_a_file_saved_beside_a_job_is_the_users_own(jobs: dict, installed: Blender, courtyard: Path, out: Path) -> None:
    contents = []
    for path in (courtyard, out / "jobs-saved.blend"):
        values = f"[{BLOCKS}, s.render.engine, s.cycles.samples, s.world.name]"
        line = f"import bpy, json; s = bpy.context.scene; KINDS = {KINDS}; print('blocks:', json.dumps({values}))"
        done = installed.run("-b", path, "--python-exit-code", "1", "--python-expr", line)
        contents.append(next(line for line in done.stdout.splitlines() if line.startswith("blocks: ")))
    assert contents[0] == contents[1] and "PatchNet Bake" not in contents[0]


def test_nothing_is_edited_by_accident(jobs: dict) -> None:
    assert not jobs["grabbed"]
    assert jobs["meanwhile"]["running"] == "Preview Selection"


def test_image_editors_keep_their_pictures(jobs: dict) -> None:
    assert jobs["meanwhile"]["shown"] == jobs["stopped"]["shown"] == jobs["ended"]["shown"] == "Mine"


def test_a_new_window_leaves_the_viewport_free(jobs: dict) -> None:
    opened = jobs["new window"]
    assert opened["width"] * opened["height"] < 0.5 * opened["view"][0] * opened["view"][1]


def test_escape_says_that_a_bake_goes_on(jobs: dict) -> None:
    first, refined = "Stopped. Press again to go on.", "Stopped. The pictures have light of noise "
    assert jobs["stopped with"] and all(text == first or text.startswith(refined) for text in jobs["stopped with"])


def test_escape_is_never_swallowed(jobs: dict) -> None:
    assert jobs["at once"] == {"running": "", "modal": []}


def test_blenders_stop_button_stops_the_job(jobs: dict) -> None:
    """Cycles ends its bake as if it were complete."""
    assert len(jobs["button"]["told"]) == 1 and jobs["button"]["told"][0].startswith("Stopped. The pictures have light")
    assert jobs["button"]["modal"] == []


def test_jobs_leave_no_handler(jobs: dict) -> None:
    assert jobs["stopped"]["running"] == "" and jobs["stopped"]["modal"] == jobs["ended"]["modal"] == []


def test_a_change_of_what_is_baked_ends_the_job(jobs: dict) -> None:
    assert jobs["edited"]["edited"] and not jobs["edited"]["result"] and jobs["edited"]["modal"] == []
    assert "Lamp 'Sun' changed while its light was baked" in jobs["edited"]["told"][0]


def test_undo_ends_the_job(jobs: dict) -> None:
    assert jobs["undone"] == {"running": "", "modal": [], "same": True}


def test_demo_scene_resumes(jobs: dict) -> None:
    assert len(jobs["resumed"]) >= 1


def test_users_are_not_told_to_save_what_was_baked(jobs: dict) -> None:
    assert any("Preview" in line or "Saved" in line for line in jobs["reports"]), "there are reports"
    assert not [line for line in jobs["reports"] if line.startswith("Baking map")]


def test_the_job_itself_makes_nothing_stale(jobs: dict) -> None:
    assert jobs["ended"]["stale"] == {}


def test_a_fly_through_is_baked_and_rendered_beside_the_window(jobs: dict) -> None:
    film = jobs["film"]
    assert film["files"] == ["0001.png", "0002.png", "0003.png"] and film["ended"] == ["complete"]
    assert film["engine"] == "CYCLES" and film["track"] and film["modal"] == [] and film["again"]
    assert any(line.startswith("3 frames ") for line in film["estimate"])


def test_render_takes_the_voxels_that_are_there(jobs: dict) -> None:
    assert jobs["render"]["ended"] == ["complete"] and jobs["render"]["same voxels"] and jobs["render"]["mean"] > 0.01
