# SPDX-License-Identifier: GPL-3.0-or-later
"""Statistical comparison of a render with a reference, both with known or measured noise.

Two questions are kept apart because they have different answers:

* How far is the render off? `mean_relative_error` with its confidence interval, `rmse`,
  `rmse_denoised` and `percentile95`.
* Could noise alone explain what is seen? `z_pass_fraction`, the share of pixels that pass a
  two-sided test at a level corrected for the number of tests.

Everything is linear radiance in float64. Arrays are (height, width, 3).
"""

import math
from dataclasses import dataclass, field
from functools import lru_cache
from statistics import NormalDist

import numpy as np

# The share of pixels that must pass the pixel test (Mitsuba 3, `test_renders.py`).
REQUIRED_PASS_FRACTION = 0.9975

# Images are stored as float32, and engines sum their samples in float32: rounding to nearest moves
# every partial sum by at most 2**-24 of its value, hence a mean of n equal samples by at most n times
# that.
FLOAT32_ROUNDING = 2.0**-24
# Below the smallest normal float32 the rounding is absolute: half of 2**-149 for each image.
FLOAT32_SUBNORMAL = 2.0**-149

# Relative errors of single pixels are taken against at least this fraction of the mean
# reference, so that nearly black pixels do not decide the figure.
DARK_PIXEL_FRACTION = 0.01

# Radii, in pixels, of the square neighbourhoods over which variances are pooled: 7x7, 15x15
# and 31x31. The smallest with enough degrees of freedom is used, pixel by pixel.
POOLING_RADII = (3, 7, 15)
# A variance with 40 degrees of freedom has a relative standard deviation of sqrt(2/40) = 22 %,
# and the standard error made of it 11 %. Two Gaussian repeats give 49 in 7x7 pixels.
ENOUGH_DEGREES_OF_FREEDOM = 40.0


# Degrees of freedom of which critical values are kept. From 16 on, neighbours differ by at most
# 5 % in the critical value for a million pixels, from 40 on by 2 %.
_TABLE_DOF = np.concatenate((np.arange(1.0, 21.0), np.geomspace(21.0, 1e5, 120), [np.inf]))

# Estimates ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Estimate:
    """An image with the standard error of each pixel and of its mean.

    value : (h, w, 3) linear radiance, finite.
    standard_error : (h, w, 3) standard error of `value`, finite, >= 0.
    repeats : number of independent repeats, >= 2, from which the errors were measured, so that
        each has `repeats - 1` degrees of freedom; None where the errors are known.
    mean_value : mean of `value` over pixels and channels.
    mean_standard_error : standard error of `mean_value`.
    third_cumulant : (h, w, 3) third central moment of the error of `value`, radiance cubed,
        finite; None where it is not known, which is taken as symmetric noise.
    samples : number of float32 values that were summed for each pixel of a repeat; 1 for a value
        that was only stored. It bounds the rounding, see FLOAT32_ROUNDING.

    mean_dof : degrees of freedom of `mean_standard_error`; None where they follow from `repeats`.

    The arrays are copied and read-only. Raises ValueError on wrong shapes, pixels that are not
    finite, or negative errors. Use `from_repeats`, `from_errors` or `exact` to make one.
    """

    value: np.ndarray
    standard_error: np.ndarray
    repeats: int | None
    mean_value: float
    mean_standard_error: float
    third_cumulant: np.ndarray | None = None
    samples: int = 1
    mean_dof: float | None = None

    def __post_init__(self):
        for name in ("value", "standard_error", "third_cumulant"):
            if getattr(self, name) is not None:
                array = _checked_image(getattr(self, name), name)
                if name != "value":
                    _check_shape(array, self.value.shape, name)
                array.setflags(write=False)
                object.__setattr__(self, name, array)
        _check_errors(self.standard_error)
        if self.repeats is not None and self.repeats < 2:
            raise ValueError(
                f"repeats must be >= 2, got {self.repeats}: a spread needs two images; render "
                "another seed, or use from_errors or exact where the error is known"
            )

    @classmethod
    def from_repeats(cls, images, samples=1, independent_pixels=False):
        """Mean of independent repeats (seeds), with errors measured from their spread.

        images : (k, h, w, 3), k >= 2. samples : see the class. A pixel is mean +- s / sqrt(k), s**2 the unbiased sample
        variance. The error of the image mean comes from the spread of the k image means, so
        that correlations between pixels and channels are honoured. From three repeats on the
        skewness of the noise is measured too.

        independent_pixels : the pixels share no random numbers, as in our own references. The
        error of the image mean then follows from the spread of every pixel, averaged over its
        channels, which share their paths: far more degrees of freedom than k - 1 images give.
        """
        images = np.asarray(images, dtype=np.float64)
        if images.ndim != 4 or images.shape[-1] != 3 or 0 in images.shape:
            raise ValueError(
                f"images must have the shape (repeats, height, width, 3), got {images.shape}: "
                "stack one RGB image for each seed along the first axis"
            )
        repeats = images.shape[0]
        if repeats < 2:
            raise ValueError(
                f"images must hold >= 2 repeats, got {repeats}: a spread needs two images; "
                "render another seed"
            )
        _check_finite(images, "images", ("repeat", "row", "column", "channel"))
        value, standard_error = _mean_and_error(images)
        mean_value, mean_error = _mean_and_error(images.mean(axis=(1, 2, 3)))
        third = _third_cumulant_of_mean(images - value) if repeats > 2 else None
        mean_dof = None
        if independent_pixels:
            mean_error, mean_dof = _error_of_pixel_sum(images.mean(axis=-1))
        return cls(
            value, standard_error, repeats, float(mean_value), float(mean_error), third, samples, mean_dof
        )

    @classmethod
    def from_errors(cls, value, standard_error):
        """Image with known, independent errors: the mean's error is sqrt(sum se**2) / n."""
        value = np.asarray(value, dtype=np.float64)
        standard_error = np.broadcast_to(np.asarray(standard_error, dtype=np.float64), value.shape)
        mean_error = math.sqrt(np.sum(standard_error**2)) / max(value.size, 1)
        return cls(value, standard_error, None, _mean(value), mean_error)

    @classmethod
    def exact(cls, value):
        """Image without error, for closed forms and for engines without noise."""
        value = np.asarray(value, dtype=np.float64)
        return cls(value, np.zeros_like(value), None, _mean(value), 0.0)


def _mean(values):
    # A non-finite image is refused later, with a message that says where; no warning before.
    with np.errstate(invalid="ignore", over="ignore"):
        return float(np.mean(values)) if values.size else math.nan


def _error_of_pixel_sum(grey):
    """Error of the mean of independent pixels (k, h, w), and its Satterthwaite degrees of freedom."""
    variance = grey.var(axis=0, ddof=1) / len(grey)
    total = variance.sum()
    squares = np.sum(variance**2) / (len(grey) - 1)
    dof = float(total**2 / squares) if squares > 0.0 else math.inf
    return math.sqrt(total) / variance.size, dof


def _mean_and_error(samples):
    """Mean over the first axis and its standard error, exact where all samples are equal."""
    first = samples[0]
    deviations = samples - first
    mean = deviations.mean(axis=0)
    variance = np.sum((deviations - mean) ** 2, axis=0) / (len(samples) - 1)
    return first + mean, np.sqrt(variance / len(samples))


def _third_cumulant_of_mean(deviations):
    """Unbiased third central moment of a sample (k >= 3), over k**2: that of the sample's mean."""
    k = len(deviations)
    return np.sum(deviations**3, axis=0) / (k * (k - 1.0) * (k - 2.0))


def _checked_image(array, name):
    array = np.array(array, dtype=np.float64)
    if array.ndim != 3 or array.shape[-1] != 3 or 0 in array.shape:
        raise ValueError(
            f"{name} must have the shape (height, width, 3), got {array.shape}: give linear RGB"
        )
    _check_finite(array, name, ("row", "column", "channel"))
    return array


def _check_finite(array, name, axes):
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        first = tuple(int(index) for index in bad[0])
        where = ", ".join(f"{axis} {index}" for axis, index in zip(axes, first, strict=True))
        raise ValueError(
            f"{name} must be finite, got {len(bad)} of {array.size} values that are not, the "
            f"first {array[first]} at {where}: a NaN or infinity is a fault of the render, "
            "find it there rather than masking it"
        )


def _check_shape(array, shape, name):
    if array.shape != shape:
        raise ValueError(
            f"{name} must have the shape of value {shape}, got {array.shape}: give one number "
            "for each pixel and channel"
        )


def _check_errors(standard_error):
    lowest = float(standard_error.min())
    if lowest < 0.0:
        raise ValueError(
            f"standard_error must be >= 0, got {lowest}: an error is a size; give its magnitude"
        )


# Comparison -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Comparison:
    """What `compare` found. Relative figures are None where the reference is all black.

    mean_render, mean_reference : means over pixels and channels, radiance.
    mean_difference, mean_difference_interval : mean(render) - mean(reference), radiance.
    mean_relative_error, mean_relative_interval : the same over mean(reference), signed.
    mean_p_value : two-sided p-value of "the means are equal".
    mean_degrees_of_freedom : Welch-Satterthwaite, of the difference; may be infinite.
    rms_difference : sqrt(mean(d**2)), radiance, noise included.
    rmse : rms_difference / mean(reference), noise included.
    rmse_denoised : sqrt(max(0, mean(d**2 - se_render**2 - se_reference**2))) / mean(reference).
        Unbiased in the square before the clamp at zero, for any distribution of the noise.
    rmse_noise_floor : the `rmse_denoised` that noise alone stays under with probability
        `confidence`; a smaller one is not distinguishable from zero. It takes pixels as
        independent; a pixel filter that correlates c neighbours raises it by c**(1/4).
    percentile95 : 95th percentile, over pixels and channels, of |d| / max(reference, 1 % of the
        mean reference), noise included.
    z_pass_fraction : share of pixels of which all three channels pass the pixel test.
    z : (h, w, 3) signed score of the pixel test (see `compare`): difference over standard error,
        corrected for skewness; infinite where an error of zero meets a difference.
    pixel_passes : (h, w) result of the pixel test.
    """

    mean_render: float
    mean_reference: float
    mean_difference: float
    mean_difference_interval: tuple[float, float]
    mean_relative_error: float | None
    mean_relative_interval: tuple[float, float] | None
    mean_p_value: float
    mean_degrees_of_freedom: float
    rms_difference: float
    rmse: float | None
    rmse_denoised: float | None
    rmse_noise_floor: float | None
    percentile95: float | None
    z_pass_fraction: float
    confidence: float
    significance: float
    z: np.ndarray = field(repr=False)
    pixel_passes: np.ndarray = field(repr=False)

    @property
    def worst_mean_error(self):
        """Magnitude of the farther end of the mean error's interval; None without one."""
        interval = self.mean_relative_interval
        return None if interval is None else max(abs(end) for end in interval)

    def passes(self, tolerance):
        """Whether |mean_relative_error| <= tolerance and enough pixels pass their test.

        A noisy render can pass by luck; hold `worst_mean_error` against the tolerance where
        the error itself must be known to be small. An all-black reference has no relative
        error: there the interval of the mean difference must contain zero.
        """
        if not tolerance >= 0.0:
            raise ValueError(
                f"tolerance must be >= 0, got {tolerance}: it bounds a magnitude; 0.01 is 1 %"
            )
        if self.mean_relative_error is None:
            low, high = self.mean_difference_interval
            mean_passes = low <= 0.0 <= high
        else:
            mean_passes = abs(self.mean_relative_error) <= tolerance
        return mean_passes and self.z_pass_fraction >= REQUIRED_PASS_FRACTION

    def to_json(self):
        """The figures as a dict of floats, lists of floats and None; nothing infinite."""
        arrays = ("z", "pixel_passes")
        figures = {k: _plain(v) for k, v in vars(self).items() if k not in arrays}
        return figures | {
            "worst_mean_error": _plain(self.worst_mean_error),
            "height": self.z.shape[0],
            "width": self.z.shape[1],
        }


def _plain(figure):
    if isinstance(figure, tuple):
        return [_plain(item) for item in figure]
    if figure is None or not math.isfinite(figure):
        return None
    return float(figure)


def compare(render, reference, confidence=0.95, significance=0.01):
    """Compare two `Estimate`s of the same image. Returns a `Comparison`.

    confidence : of the interval of the mean error, in (0, 1).
    significance : probability that any pixel of an unbiased image fails its test, in (0, 1).

    Mean: R = M_r / M_f - 1 with variance (se_r**2 + (M_r / M_f)**2 se_f**2) / M_f**2 (delta
    method, for se_f well under M_f) and Student's t of Welch-Satterthwaite degrees of freedom.

    Pixels: z = d / sqrt(v_r + v_f) against Student's t of Welch-Satterthwaite degrees of freedom
    at the Sidak level 1 - (1 - significance)**(1 / n), n = 3 * pixels; a pixel fails if any
    channel does, and always passes within float32 rounding. Known errors (`repeats` None) are
    used as they are. With k repeats a pixel's own variance has k - 1 degrees of freedom and
    cannot be trusted: where light arrives in rare bright samples, k samples without one show a
    variance far too small together with a mean too low. The variance v is therefore the larger of

    * the mean of the variances in the pixel's neighbourhood, with the degrees of freedom that
      their spread implies (`_pooled_noise`): it knows the bright samples this pixel missed;
    * its own: in the pixel that did get a bright sample it is as large as the excess.

    Noise that is skewed reaches far in one direction even where its variance is known exactly,
    so z is brought to the normal scale by the skewness pooled over the same neighbourhood
    (`_normal_score`). This needs k >= 3.

    Probability that any of 32x32 pixels fails without bias, at significance 1 %, measured for
    k = 4, 8, 16 over a gradient and over an edge of contrast 100: 0.4 to 1.0 % for Gaussian
    noise, 0 to 0.3 % for exponential, gamma (shape 0.2) and spotty noise; at most 1.6 % where both
    images are noisy. Two repeats cannot show skewness: with them, noise as skewed as these fails
    some 0.1 % of the pixels, and spotty noise several percent. Render four or more.
    Noise with no spread at all in 31x31 pixels counts as no noise.

    Raises ValueError if shapes differ, or if the mean reference is <= 0 without the reference
    being all black.
    """
    _check_comparable(render, reference)
    _check_probability(confidence, "confidence")
    _check_probability(significance, "significance")
    difference = render.value - reference.value
    relative = reference.mean_value > 0.0
    z, pixel_passes = _pixel_test(render, reference, significance)
    return Comparison(
        **_compare_means(render, reference, confidence, relative),
        **_compare_spreads(difference, render, reference, confidence, relative),
        z_pass_fraction=float(pixel_passes.mean()),
        confidence=float(confidence),
        significance=float(significance),
        z=z,
        pixel_passes=pixel_passes,
    )


def _check_comparable(render, reference):
    if render.value.shape != reference.value.shape:
        raise ValueError(
            f"render and reference must have the same shape, got {render.value.shape} and "
            f"{reference.value.shape}: render both at the same resolution"
        )
    if reference.mean_value <= 0.0 and np.any(reference.value):
        raise ValueError(
            f"mean reference must be > 0, got {reference.mean_value}: a relative error is "
            "undefined against it; check the reference for negative radiance"
        )


def _check_probability(value, name):
    if not 0.0 < value < 1.0:
        raise ValueError(
            f"{name} must be between 0 and 1, got {value}: it is a probability; give 0.95 for 95 %"
        )


def _degrees_of_freedom(estimate):
    """Of the error of the image mean."""
    if estimate.mean_dof is not None:
        return estimate.mean_dof
    return math.inf if estimate.repeats is None else estimate.repeats - 1.0


def _welch(variance_a, dof_a, variance_b, dof_b):
    """Welch-Satterthwaite degrees of freedom of a sum of two independent variances."""
    # Scaled by the larger variance, so that squares neither overflow nor vanish.
    scale = np.maximum(np.maximum(variance_a, variance_b), np.finfo(float).tiny)
    a, b = variance_a / scale, variance_b / scale
    spread = np.asarray(a**2 / dof_a + b**2 / dof_b)
    infinite = np.full(spread.shape, np.inf)
    return np.divide((a + b) ** 2, spread, out=infinite, where=spread > 0.0)


# Means


def _compare_means(render, reference, confidence, relative):
    difference = render.mean_value - reference.mean_value
    error, dof = _mean_error(render, reference, 1.0)
    figures = {
        "mean_render": render.mean_value,
        "mean_reference": reference.mean_value,
        "mean_difference": difference,
        "mean_difference_interval": _interval(difference, error, dof, confidence),
        "mean_p_value": _mean_p_value(render, reference, error, dof),
        "mean_degrees_of_freedom": dof,
        "mean_relative_error": None,
        "mean_relative_interval": None,
    }
    if relative:
        ratio = render.mean_value / reference.mean_value
        error, dof = _mean_error(render, reference, ratio)
        relative_error = difference / reference.mean_value
        figures["mean_relative_error"] = relative_error
        figures["mean_relative_interval"] = _interval(
            relative_error, error / reference.mean_value, dof, confidence
        )
    return figures


def _mean_error(render, reference, slope):
    """Standard error and degrees of freedom of M_r - slope * M_f, slope held fixed."""
    variance_r = render.mean_standard_error**2
    variance_f = (slope * reference.mean_standard_error) ** 2
    dof = _welch(
        variance_r, _degrees_of_freedom(render), variance_f, _degrees_of_freedom(reference)
    )
    return math.sqrt(variance_r + variance_f), float(dof)


def _interval(centre, error, dof, confidence):
    half_width = error * _interval_factor(confidence, dof)
    return (centre - half_width, centre + half_width)


@lru_cache(maxsize=256)
def _interval_factor(confidence, dof):
    return float(student_t_isf(0.5 * (1.0 - confidence), dof))


def _mean_p_value(render, reference, error, dof):
    difference = abs(render.mean_value - reference.mean_value)
    if error > 0.0:
        return min(1.0, 2.0 * float(student_t_sf(difference / error, dof)))
    return float(difference <= _rounding(render, reference, render.mean_value, reference.mean_value))


def _rounding(render, reference, a, b):
    """Largest difference that float32 arithmetic alone can make between two equal radiances."""
    steps = render.samples + reference.samples
    return steps * FLOAT32_ROUNDING * np.maximum(np.abs(a), np.abs(b)) + FLOAT32_SUBNORMAL


# Spreads


def _compare_spreads(difference, render, reference, confidence, relative):
    figures = {
        "rms_difference": math.sqrt(np.mean(difference**2)),
        "rmse": None,
        "rmse_denoised": None,
        "rmse_noise_floor": None,
        "percentile95": None,
    }
    if relative:
        excess = difference**2 - render.standard_error**2 - reference.standard_error**2
        mean = reference.mean_value
        dark = DARK_PIXEL_FRACTION * mean
        figures["rmse"] = figures["rms_difference"] / mean
        figures["rmse_denoised"] = math.sqrt(max(0.0, excess.mean())) / mean
        noisy = (render.standard_error > 0.0) | (reference.standard_error > 0.0)
        figures["rmse_noise_floor"] = _noise_floor(excess * noisy, confidence) / mean
        figures["percentile95"] = float(
            np.percentile(np.abs(difference) / np.maximum(reference.value, dark), 95.0)
        )
    return figures


def _noise_floor(excess, confidence):
    """Root of the quantile, over noise alone, of the mean of `excess` = d**2 - variances.

    Its expectation without bias is zero, so its own mean square is its variance, whatever the
    distribution of the noise; a bias raises the floor too, but by less than the RMSE if
    it reaches three pixels or more. Channels of a pixel share their light paths, hence are
    averaged first. Pixels without noise come in as zero and add nothing.
    """
    pixels = excess.mean(axis=-1)
    error_of_mean = math.sqrt(np.mean(pixels**2) / pixels.size)
    return math.sqrt(max(0.0, float(normal_isf(1.0 - confidence)) * error_of_mean))


# Pixels


def _pixel_test(render, reference, significance):
    """z (h, w, 3) and pixel_passes (h, w); see `compare`."""
    difference = render.value - reference.value
    negligible = np.abs(difference) <= _rounding(render, reference, render.value, reference.value)
    variance_r, third_r, dof_r = _pixel_noise(render)
    variance_f, third_f, dof_f = _pixel_noise(reference)
    error = np.sqrt(variance_r + variance_f)
    noisy = error > 0.0
    z = np.where(noisy | negligible, 0.0, np.copysign(np.inf, difference))
    skewness = (third_r - third_f)[noisy] / error[noisy] ** 3
    z[noisy] = _normal_score(difference[noisy] / error[noisy], skewness)
    # log1p and expm1 keep the level exact for millions of tests.
    level = -math.expm1(math.log1p(-significance) / difference.size)
    critical = _critical_values(level, _welch(variance_r, dof_r, variance_f, dof_f))
    return z, np.all((np.abs(z) <= critical) | negligible, axis=-1)


def _normal_score(z, skewness):
    """Score that is normal where z has a gamma distribution of this skewness (Wilson-Hilferty).

    6 / g ((1 + g z / 2)**(1/3) - 1) + g / 6, for skewness g towards the side of z. Never larger
    than z: the measured skewness has an error of its own, and on the short side of a skewed
    distribution nothing needs to be forgiven.
    """
    size = np.abs(z)
    # Under 1e-6 the correction is lost in rounding, and the formula too.
    g = np.maximum(np.copysign(1.0, z) * skewness, 1e-6)
    corrected = 6.0 / g * np.expm1(np.log1p(0.5 * g * size) / 3.0) + g / 6.0
    return np.copysign(np.minimum(size, corrected), z)


def _critical_values(level, dof):
    """Two-sided Student-t critical values for an array of degrees of freedom >= 1.

    Degrees of freedom are rounded down to the table's, which only widens the acceptance.
    """
    table = _critical_table(level)
    return table[np.searchsorted(_TABLE_DOF, dof, side="right") - 1]


@lru_cache(maxsize=16)
def _critical_table(level):
    return student_t_isf(0.5 * level, _TABLE_DOF)


def _pixel_noise(estimate):
    """Variance, third cumulant and degrees of freedom of each value for the pixel test."""
    own = estimate.standard_error**2
    third = np.zeros_like(own) if estimate.third_cumulant is None else estimate.third_cumulant
    if estimate.repeats is None:
        return own, third, np.full(own.shape, np.inf)
    pooled, third, dof = _pooled_noise(own, third, estimate.repeats - 1)
    return np.maximum(own, pooled), third, dof


def _pooled_noise(variance, third_cumulant, dof_per_pixel):
    """Means over each pixel's neighbourhood, and the degrees of freedom of the mean variance.

    The neighbourhood grows through POOLING_RADII until it has ENOUGH_DEGREES_OF_FREEDOM, for
    the pixel and also for the image as a whole (mean weighted by variance): a neighbourhood
    that missed the bright samples looks well known, and only the rest of the image can tell.
    """
    pooled, third, dof = (np.zeros_like(variance) for _ in range(3))
    undecided = np.ones(variance.shape, dtype=bool)
    for radius in POOLING_RADII:
        wider, wider_dof = _window_variance(variance, dof_per_pixel, radius)
        pooled[undecided] = wider[undecided]
        third[undecided] = _window_mean(third_cumulant, radius)[undecided]
        dof[undecided] = wider_dof[undecided]
        if np.sum(wider * wider_dof) >= ENOUGH_DEGREES_OF_FREEDOM * np.sum(wider):
            undecided &= dof < ENOUGH_DEGREES_OF_FREEDOM
        if not undecided.any():
            break
    # No spread anywhere near: an error of zero, known for certain.
    return pooled, third, np.where(pooled > 0.0, dof, np.inf)


def _window_variance(variance, dof_per_pixel, radius):
    """Mean of the variances in a window and its degrees of freedom, (h, w, 3) each.

    Satterthwaite: 2 m**2 / var(m) for the mean m of n variances, with var(m) measured from
    their spread; at most n * dof_per_pixel. One bright sample alone in a window gives 2,
    Gaussian noise nearly the full number, a border between quiet and noisy something between.
    """
    # Scaled to at most 1, so that squares of faint variances do not vanish.
    scale = variance.max() or 1.0
    mean = _window_mean(variance / scale, radius)
    mean_square = _window_mean((variance / scale) ** 2, radius)
    count = _window_count(variance.shape, radius)
    # Sample variance n / (n - 1) (mean_square - mean**2), over n for the mean.
    spread = np.maximum(mean_square - mean**2, 0.0) / np.maximum(count - 1.0, 1.0)
    limit = np.broadcast_to(count * dof_per_pixel, mean.shape)
    dof = np.divide(2.0 * mean**2, spread, out=limit.copy(), where=spread > 0.0)
    return mean * scale, np.where(mean > 0.0, np.minimum(dof, limit), 0.0)


def _window_mean(array, radius):
    return _window_sum(array, radius) / _window_count(array.shape, radius)


@lru_cache(maxsize=4)
def _window_count(shape, radius):
    return _window_sum(np.ones((*shape[:2], 1)), radius)


def _window_sum(array, radius):
    """Sum over the square window of `radius` around each pixel, cut at the image's border.

    Plain additions of shifted copies: running sums would leave the rounding residue of a
    firefly behind in every dark pixel after it.
    """
    for axis in (0, 1):
        array = np.moveaxis(array, axis, 0)
        total = array.copy()
        for shift in range(1, min(radius, len(array) - 1) + 1):
            total[shift:] += array[:-shift]
            total[:-shift] += array[shift:]
        array = np.moveaxis(total, 0, axis)
    return array


# Distributions --------------------------------------------------------------------------------

# Few values are ever needed, so each is computed by itself with the standard library.

# Above this many degrees of freedom the continued fraction loses digits to cancellation and
# Hill's expansion is exact to rounding.
_MANY_DEGREES_OF_FREEDOM = 1e4
# From here on the difference of lgammas loses digits, and the series beside it is exact.
_LARGE_ARGUMENT = 50.0


def normal_sf(x):
    """Upper tail of the standard normal, erfc(x / sqrt(2)) / 2, relative error about 1e-15."""
    return _normal_tail(x)[()]


def normal_isf(p):
    """The x with `normal_sf(x)` = p, 0 < p < 1. Wichura's AS 241, by the standard library."""
    return _normal_quantile(_checked_tail(p))[()]


def student_t_sf(t, dof):
    """Upper tail of Student's t: half the regularised incomplete beta I_x(dof/2, 1/2).

    x = dof / (dof + t**2). t and dof > 0 broadcast; dof may be infinite (normal). Relative
    error under 1e-10 for tails down to 1e-50. Abramowitz & Stegun 26.5.27, 26.7.
    """
    return _student_t_tail(t, _checked_dof(dof))[()]


def student_t_isf(p, dof):
    """The t with `student_t_sf(t, dof)` = p, 1e-100 < p < 1; p and dof > 0 broadcast."""
    return _student_t_quantile(_checked_tail(p), _checked_dof(dof))[()]


def _checked_tail(p):
    p = np.asarray(p, dtype=np.float64)
    if not np.all((p > 0.0) & (p < 1.0)):
        raise ValueError(
            f"p must be between 0 and 1, got {p}: quantiles at 0 and 1 are infinite; give a "
            "tail probability inside"
        )
    return p


def _checked_dof(dof):
    dof = np.asarray(dof, dtype=np.float64)
    if not np.all(dof > 0.0):
        raise ValueError(
            f"dof must be > 0, got {dof.min()}: a variance from k repeats has k - 1; use k >= 2"
        )
    return dof


def _elementwise(function):
    return np.vectorize(function, otypes=[float])


@_elementwise
def _normal_tail(x):
    return 0.5 * math.erfc(x / math.sqrt(2.0))


@_elementwise
def _normal_quantile(p):
    return -NormalDist().inv_cdf(p)


@_elementwise
def _student_t_tail(t, dof):
    tail = _tail(abs(t), dof)
    return tail if t >= 0.0 else 1.0 - tail


@_elementwise
def _student_t_quantile(p, dof):
    if p == 0.5:
        return 0.0
    t = _quantile(min(p, 1.0 - p), dof)
    return t if p < 0.5 else -t


def _tail(t, dof):
    """Upper tail at t >= 0, held at 1e150 so that squares stay finite."""
    t = min(t, 1e150)
    if math.isinf(dof):
        return 0.5 * math.erfc(t / math.sqrt(2.0))
    if dof > _MANY_DEGREES_OF_FREEDOM:
        return 0.5 * math.erfc(_hill_score(t, dof) / math.sqrt(2.0))
    a, ratio = 0.5 * dof, t**2 / dof
    # x**a (1 - x)**(1/2) / B(a, 1/2), with x = 1 / (1 + ratio).
    front = math.sqrt(ratio) * math.exp(-(a + 0.5) * math.log1p(ratio) - _log_beta_half(a))
    # The fraction converges on this side of the mean of the beta distribution.
    if (a + 2.5) < (a + 1.0) * (1.0 + ratio):
        return 0.5 * front * _beta_fraction(a, 0.5, 1.0 / (1.0 + ratio)) / a
    return 0.5 - front * _beta_fraction(0.5, a, ratio / (1.0 + ratio))


def _quantile(p, dof):
    """The t with tail p < 1/2.

    Newton's method on log(tail) against log(t), a concave falling curve: after the first step
    it approaches from the right and cannot overshoot.
    """
    t = -NormalDist().inv_cdf(p)
    if math.isinf(dof):
        return t
    for _ in range(200):
        tail = _tail(t, dof)
        step = math.log(tail / p) * tail / (t * _density(t, dof))
        t *= math.exp(step)
        # Convergence is quadratic: a last step of 1e-7 leaves an error near 1e-14.
        if abs(step) < 1e-7:
            return t
    raise ArithmeticError(f"Student-t quantile of {p}, {dof} degrees of freedom: no convergence")


def _density(t, dof):
    """Student's t probability density."""
    power = 0.5 * (dof + 1.0) * math.log1p(t * t / dof)
    return math.exp(-0.5 * math.log(dof) - _log_beta_half(0.5 * dof) - power)


def _hill_score(t, dof):
    """Normal score of t (Hill 1970, CACM algorithm 395); the next term is of order dof**-4."""
    a = dof - 0.5
    b = 48.0 * a**2
    w = math.sqrt(a * math.log1p(t**2 / dof))
    return w + (w**3 + 3.0 * w) / b


def _log_beta_half(a):
    """log B(a, 1/2), relative error of B under 1e-13 for every a > 0."""
    if a < _LARGE_ARGUMENT:
        ratio = math.lgamma(a) - math.lgamma(a + 0.5)
    else:
        # DLMF 5.11.13; the next term is 17 / (14336 a**7), under 2e-15.
        ratio = -0.5 * math.log(a) + 1 / (8 * a) - 1 / (192 * a**3) + 1 / (640 * a**5)
    return 0.5 * math.log(math.pi) + ratio


def _beta_fraction(a, b, x):
    """Continued fraction of the incomplete beta (DLMF 8.17.22) by Lentz's method."""
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    fraction = d
    for m in range(1, 2000):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        for coefficient in (even, odd):
            d = 1.0 / (1.0 + coefficient * d)
            c = 1.0 + coefficient / c
            fraction *= c * d
        if abs(c * d - 1.0) < 2e-15:
            return fraction
    raise ArithmeticError(f"incomplete beta of {a}, {b} at {x}: no convergence")
