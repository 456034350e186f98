# SPDX-License-Identifier: GPL-3.0-or-later
"""Mean and spread of rounds of one picture, added one by one, so that a picture can be gone on with later."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


class Rounds:
    """Running mean of equally long, independent renders (height, width, 3).

    Sums are of the deviations from the first round, in float64, so that rounds that are all equal have no spread.
    ``squares``: what each round but the first added to the spread, see plan.effort.
    """

    def __init__(self) -> None:
        self.count = 0
        self.squares: list[float] = []
        self._first = self._sum = self._even_sum = self._square_sum = np.zeros((0, 0, 3))

    def add(self, image: np.ndarray) -> None:
        """Raises ValueError where a pixel is not finite or the shape is another one."""
        image = np.asarray(image, np.float64)
        if not np.isfinite(image).all():
            row, column = np.argwhere(~np.isfinite(image))[0][:2]
            raise ValueError(f"round {self.count + 1} has a pixel that is not finite, at row {row}, column {column}; look for "
                             "a division by zero or an infinite strength in the scene")
        if self.count == 0:
            self._first = image.copy()
            self._sum, self._even_sum, self._square_sum = (np.zeros_like(image) for _ in range(3))
        elif image.shape != self._first.shape:
            raise ValueError(f"round {self.count + 1} has the shape {image.shape}, those before it {self._first.shape}")
        deviation = image - self._first
        if self.count:
            self.squares.append(float(np.mean((deviation - self._sum / self.count) ** 2)) * self.count / (self.count + 1))
        self._sum += deviation
        if self.count % 2 == 0:
            self._even_sum += deviation
        self._square_sum += deviation**2
        self.count += 1

    @property
    def mean(self) -> np.ndarray:
        return self._first + self._sum / self.count

    @property
    def standard_error(self) -> np.ndarray:
        """Of the mean, pixel by pixel; infinite for a single round."""
        if self.count < 2:
            return np.full_like(self._first, np.inf)
        spread = np.maximum(0.0, self._square_sum - self._sum**2 / self.count)
        return np.sqrt(spread / (self.count - 1) / self.count)

    @property
    def halves(self) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Means of every second round from the first and from the second, and their variances, pixel by pixel; of two rounds at least."""
        odd = self.count // 2
        counts = self.count - odd, odd
        means = self._first + self._even_sum / counts[0], self._first + (self._sum - self._even_sum) / counts[1]
        variance = self.standard_error**2 * self.count
        return means, tuple(variance / count for count in counts)

    def state(self) -> dict[str, np.ndarray]:
        """As arrays that can be saved."""
        return {"count": np.array(self.count), "squares": np.array(self.squares), "first": self._first, "sum": self._sum,
                "even_sum": self._even_sum, "square_sum": self._square_sum}

    @classmethod
    def restored(cls, state: Mapping[str, Any]) -> "Rounds":
        """From what ``state`` gave: goes on to the last bit as if it had never been away."""
        result = cls()
        result.count, result.squares = int(state["count"]), [float(value) for value in state["squares"]]
        result._first, result._sum, result._even_sum, result._square_sum = (
            np.array(state[name]) for name in ("first", "sum", "even_sum", "square_sum"))
        return result
