# SPDX-License-Identifier: GPL-3.0-or-later
"""How torch's threads wait, as in `patchnet lab train`."""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before a test loads torch
