# SPDX-License-Identifier: GPL-3.0-or-later
"""``volumetrics fit-phase``: the two lobes of the cloud family nearest to a table or to water droplets."""

from __future__ import annotations

from pathlib import Path

from ..parameters.cloud import CLOUD


def read_table(path: Path) -> tuple[list[float], list[float]]:
    """Angles (degrees) and values of a text file with two columns, separated by blanks, commas or semicolons.

    Lines that begin with # and lines of words before the first number are left out. Raises ValueError with file and line.
    """
    angles, values = [], []
    for number, line in enumerate(path.read_text(encoding="utf-8-sig").splitlines(), 1):
        cells = line.replace(",", " ").replace(";", " ").split()
        if not cells or cells[0].startswith("#"):
            continue
        try:
            angle, value = (float(cell) for cell in cells[:2])
        except ValueError:
            if not angles and not any(_is_number(cell) for cell in cells):
                continue  # a heading
            raise ValueError(f"{path}, line {number}: {line.strip()!r} is not an angle in degrees and a value; "
                             "give two numbers per line") from None
        if not 0.0 <= angle <= 180.0:
            raise ValueError(f"{path}, line {number}: the angle must be from 0 to 180 degrees, got {angle:g}; 0 is forward")
        angles.append(angle)
        values.append(value)
    return angles, values


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def fit(table: Path | None, droplet: float | None, logarithmic: bool, keep_mean_cosine: bool) -> dict[str, float]:
    """Parameters of the cloud family with residual and mean cosines. Raises ValueError, OSError."""
    import numpy as np

    from ..physics.phase import mie_fit
    from ..physics.phase_fit import fit_dual_henyey_greenstein

    if (table is None) == (droplet is None):
        raise ValueError("fit-phase takes a table of the phase function or --droplet, one of them; see fit-phase --help")
    if table is not None:
        angles, values = read_table(table)
        cos_theta, value = np.cos(np.radians(angles)), np.array(values)
    else:
        mie_fit(0.0, droplet)  # the size is refused before the quadrature asks
        cos_theta, value = None, lambda c: mie_fit(c, droplet)
    result = fit_dual_henyey_greenstein(cos_theta, value, logarithmic=logarithmic, keep_mean_cosine=keep_mean_cosine)
    return {"g": result.g0, "g_back": result.g1, "lobe_weight": result.weight, "residual": result.residual,
            "mean_cosine": result.mean_cosine, "given_mean_cosine": result.given_mean_cosine}


def described(values: dict[str, float]) -> str:
    """The fit in words, and as options for the other commands."""
    options = []
    notes = []
    for name in ("g", "g_back", "lobe_weight"):
        parameter = CLOUD[name]
        options.append(f"--cloud.{name.replace('_', '-')} {values[name]:.6g}")
        if not parameter.minimum <= values[name] <= parameter.maximum:
            notes.append(f"{name} {values[name]:.6g} is outside {parameter.limits}, which the engines can show")
    return "\n".join([f"relative residual {values['residual']:.3g}, mean cosine {values['mean_cosine']:.5f} "
                      f"(given: {values['given_mean_cosine']:.5f})", "--cloud.phase dual_hg " + " ".join(options), *notes])
