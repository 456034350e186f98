# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark: every rival over the same scenes, run time against error."""
