# SPDX-License-Identifier: GPL-3.0-or-later
"""Training of the paper's networks in one run: for each scene, without a scene, by look-ahead and by encoder."""
