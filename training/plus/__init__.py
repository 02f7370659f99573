# SPDX-License-Identifier: GPL-3.0-or-later
"""Training of the estimator of pixel errors (methods 12.3)."""
