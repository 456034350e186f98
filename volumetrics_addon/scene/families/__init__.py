# SPDX-License-Identifier: GPL-3.0-or-later
"""One module per family: ``assemble`` makes an Item from its checked values."""

from __future__ import annotations

from collections.abc import Callable

from . import air, cloud, fog, glass, godray
from .item import Item

ASSEMBLERS: dict[str, Callable[..., Item]] = {module.__name__.rpartition(".")[2]: module.assemble
                                              for module in (cloud, glass, fog, godray, air)}
