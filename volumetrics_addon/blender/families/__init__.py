# SPDX-License-Identifier: GPL-3.0-or-later
"""One module per family: ``outputs`` makes the shaders of its node group."""

from __future__ import annotations

from collections.abc import Callable

from ..shaders import Outputs
from . import air, cloud, fog, glass, godray

BUILDERS: dict[str, Callable[..., Outputs]] = {module.__name__.rpartition(".")[2]: module.outputs
                                               for module in (cloud, glass, fog, godray, air)}
