# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line. Commands import what they need when they run."""
