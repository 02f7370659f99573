# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of costs: read as they were written, and measured again where they are damaged or of something else."""


import pytest

from patchnet.training.evaluation.costs import Costs, read_costs, total_ms, write_costs

COSTS = Costs({"patchnet": 2.5}, {"staged": [1.0, 2.0]}, {1: 0.5, 4: 8.0}, {"predicted": 0.7}, 0.01)


def test_costs_are_kept(tmp_path):
    write_costs(COSTS, tmp_path / "costs.json", "key")
    assert read_costs(tmp_path / "costs.json", "key") == COSTS
    assert read_costs(tmp_path / "costs.json", "another key") is None


@pytest.mark.parametrize("text", ["", "[]", "3", '{"key": "key"}', '{"key": "key", "uniform_ms": 3}', "\xff"])
def test_damaged_costs_are_not_there(text, tmp_path):
    (tmp_path / "costs.json").write_bytes(text.encode("latin-1"))
    assert read_costs(tmp_path / "costs.json", "key") is None


def test_ranking_in_stages_takes_what_the_budget_asks_for():
    values = {
        "active_pixels": 200,
        "frames": 2,
        "budgets": [0.0, 0.5, 1.0],
        "ms_per_frame": {"staged": 3.0, "one": 3.0},
    }
    values["ms_by_budget"] = {"staged": [1.0, 3.0, 4.0]}
    assert total_ms(values, "staged", 0.1).tolist() == [1.0, 8.0, 14.0]
    assert total_ms(values, "one", 0.1).tolist() == [3.0, 8.0, 13.0]
