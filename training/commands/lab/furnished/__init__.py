# SPDX-License-Identifier: GPL-3.0-or-later
"""Training scenes: furnished rooms and gardens, composed by script from models of furniture libraries (.sh3f)."""
