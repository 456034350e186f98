# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of the panel share."""

import pytest


@pytest.fixture(scope="module")
def extension():
    """The extension enabled for a module, and Blender's start-up file behind it."""
    bpy = pytest.importorskip("bpy")
    import volumetrics_addon

    volumetrics_addon.register()
    yield
    bpy.ops.wm.read_factory_settings()
    volumetrics_addon.unregister()
