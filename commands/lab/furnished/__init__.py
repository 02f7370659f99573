# SPDX-License-Identifier: GPL-3.0-or-later
"""Furnished rooms and gardens, composed by script of models from furniture libraries (.sh3f), to train on."""
