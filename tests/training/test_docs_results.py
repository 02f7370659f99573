# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers of docs/lab/results.md are those of the evaluation."""

import json
import re

import numpy as np
import pytest

pytest.importorskip("pandas")
from patchnet.docs import make_results as script

NUMBER = re.compile(r"\d*\.\d+|\d+")


def test_numbers_of_the_page_are_those_of_the_evaluation() -> None:
    """But for the last digit, and counts of scenes where two errors are the same to four digits."""
    results = json.loads(script.PAGE.with_name("results.json").read_text(encoding="utf-8"))
    page = script.PAGE.read_text(encoding="utf-8")
    now, then = (np.array(NUMBER.findall(text), float) for text in (page, script.filled(page, results)))
    assert np.isclose(now, then, rtol=0.01, atol=0.0101).mean() > 0.999
