# SPDX-License-Identifier: GPL-3.0-or-later
"""Training runs: steps on threads, processes and GPUs, validation, checkpoints, logs."""
