# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumetrics: volumetric lighting presets for Cycles and EEVEE, each with its error against a reference.

Importing the package costs nothing; ``register`` and ``unregister`` are what Blender calls.
"""


def register() -> None:
    from . import ui

    ui.register()


def unregister() -> None:
    from . import ui

    ui.unregister()
