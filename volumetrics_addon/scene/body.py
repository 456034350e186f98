# SPDX-License-Identifier: GPL-3.0-or-later
"""What the engines show as one object: a family, its values, and the volumes that they stand for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..parameters.model import Group
from .model import Shape, Volume


@dataclass(frozen=True)
class Body:
    """One object with one material: coincident domains lose one in Cycles, so the media of one domain are one body.

    ``domain`` is where the engines follow the media. It is smaller than the volumes' own where those reach farther than
    anything that a picture shows. A depth fog has neither volumes nor domain.
    """

    family: Group
    values: Mapping[str, Any]
    volumes: tuple[Volume, ...]
    domain: Shape | None
