# SPDX-License-Identifier: GPL-3.0-or-later
"""The path tracer of ``path_tracing`` compiled with numba: the same estimators, one path at a time.

Importing this module needs numba. Vectors are tuples of three floats; a path's random numbers are SplitMix64 (Steele, Lea
and Flood 2014) started from a hash of seed, pixel and sample, so that an image depends on its seed alone, not on the
number of threads.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ..scene import noise
from ..scene.compilation import forget_stale_kernels
from ..scene.model import Camera, look_frame
from .path_scene import (
    ALBEDO, ALTITUDE, APEX, AXES, AXIS, BOX, CELLS, CENTER, COLOR, COS2, DARK, DENSITY, DUST, ELLIPSOID, EMISSION, ENVIRONMENT,
    EPSILON, FULL, HALF, HEIGHT, HOMOGENEOUS, LAYER, LENGTH, LIGHT, LIGHTS, LOW, MEAN, MIE, NOISE, PARAMETERS, PHASE,
    POSITION, RAYLEIGH, ROULETTE_START, ROULETTE_THRESHOLD, SIGMA_S, SIGMA_T, SIZE, SUN, SURFACE, SURFACES, TOWARD,
    VOLUME, VOLUMES, VOXELS,
)

INF = math.inf
TRACKING_THRESHOLD = 0.1  # transmittances below it are followed on with a chance in proportion
SPAN, ROW = 3, 6  # numbers of a path's workspace for each volume and each light
CHUNKS = 64  # work items of a parallel loop; the pixels are dealt out to them in turn

forget_stale_kernels(__file__)
# Infinities mark what is not hit, so that fast-math may not assume them away.
compiled = numba.njit(fastmath={"contract", "arcp", "nsz", "afn", "reassoc"}, error_model="numpy", cache=True)
_noise, _, _noise_density, _dust_density = noise.implementation(compiled)


# --- vectors and random numbers ------------------------------------------------------------------------------


@compiled
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def along(origin, direction, t):
    return origin[0] + t * direction[0], origin[1] + t * direction[1], origin[2] + t * direction[2]


@compiled
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def scaled(a, factor):
    return a[0] * factor, a[1] * factor, a[2] * factor


@compiled
def times(a, b):
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@compiled
def largest(a):
    return max(a[0], max(a[1], a[2]))


@compiled
def size_of(a):
    return max(abs(a[0]), max(abs(a[1]), abs(a[2])))


@compiled
def vector(numbers, at):
    return numbers[at], numbers[at + 1], numbers[at + 2]


@compiled
def hashed(x):
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@compiled
def uniform(state):
    """The next number in [0, 1) of the generator whose state is the array's only element."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    return (hashed(state[0]) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@compiled
def exponential(state):
    return -math.log(1.0 - uniform(state))


@compiled
def turned(direction, cosine, state):
    """Unit vector at the polar cosine around ``direction``, at a random azimuth (basis of Duff et al. 2017)."""
    x, y, z = direction
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    angle = 2.0 * math.pi * uniform(state)
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    u, v = sine * math.cos(angle), sine * math.sin(angle)
    result = (u * (1.0 + sign * x * x * a) + v * b + cosine * x,
              u * sign * b + v * (sign + y * y * a) + cosine * y,
              -u * sign * x - v * y + cosine * z)
    return scaled(result, 1.0 / math.sqrt(dot(result, result)))


# --- shapes --------------------------------------------------------------------------------------------------


@compiled
def local(scene, shape, v):
    """The vector in the axes of a box or ellipsoid."""
    axes = shape + AXES
    return dot(vector(scene, axes), v), dot(vector(scene, axes + 3), v), dot(vector(scene, axes + 6), v)


@compiled
def interval(scene, shape, origin, direction):
    """Entry and exit of the line through a convex shape, see ``scene.geometry``."""
    if scene[shape] == BOX:
        p, d = local(scene, shape, minus(origin, vector(scene, shape + CENTER))), local(scene, shape, direction)
        near, far = -INF, INF
        for k in range(3):
            half = scene[shape + HALF + k]
            if d[k] == 0.0:
                if abs(p[k]) > half:
                    return INF, -INF
            else:
                inverse = 1.0 / d[k]
                middle, reach = -p[k] * inverse, abs(half * inverse)
                near, far = max(near, middle - reach), min(far, middle + reach)
        return near, far
    if scene[shape] == ELLIPSOID:
        half = vector(scene, shape + HALF)
        inverse = (1.0 / half[0], 1.0 / half[1], 1.0 / half[2])
        p = times(local(scene, shape, minus(origin, vector(scene, shape + CENTER))), inverse)
        d = times(local(scene, shape, direction), inverse)
        dd = dot(d, d)
        middle = -dot(p, d) / dd
        closest = along(p, d, middle)
        discriminant = (1.0 - dot(closest, closest)) / dd
        if discriminant < 0.0:
            return INF, -INF
        root = math.sqrt(discriminant)
        return middle - root, middle + root
    axis, p = vector(scene, shape + AXIS), minus(origin, vector(scene, shape + APEX))
    near, far = nappe_interval(p, direction, axis, scene[shape + COS2])
    height, slope = dot(p, axis), dot(direction, axis)
    if slope == 0.0:
        return (near, far) if height <= scene[shape + LENGTH] else (INF, -INF)
    end = (scene[shape + LENGTH] - height) / slope
    return (near, min(far, end)) if slope > 0.0 else (max(near, end), far)


@compiled
def nappe_interval(p, d, axis, cos2):
    """The part of the line in the infinite cone around ``axis`` with its apex at the origin, see ``scene.geometry``."""
    pa, da = dot(p, axis), dot(d, axis)
    a, b, c = da * da - cos2 * dot(d, d), pa * da - cos2 * dot(p, d), pa * pa - cos2 * dot(p, p)
    discriminant = b * b - a * c
    if discriminant <= 0.0:
        if a < 0.0 or da == 0.0:
            return INF, -INF
        return (-pa / da, INF) if da > 0.0 else (-INF, -pa / da)
    root = math.sqrt(discriminant)
    q = -(b + (root if b >= 0.0 else -root))
    first = q / a if a != 0.0 else INF
    second = c / q if q != 0.0 else INF
    low, high = min(first, second), max(first, second)
    if a < 0.0:
        return (low, high) if pa + (low + high) / 2.0 * da > 0.0 else (INF, -INF)
    return (high if a > 0.0 else low, INF) if da > 0.0 else (-INF, low)


@compiled
def first_hit(scene, origin, direction):
    """Distance to the nearest surface (inf: none) and its index (-1: none)."""
    distance, found = INF, -1
    for i in range(int(scene[SURFACES])):
        surface = int(scene[SURFACES + 1]) + i * SURFACE
        near, far = interval(scene, surface, origin, direction)
        t = near if near > scene[EPSILON] else far
        if near <= far and scene[EPSILON] < t < distance:
            distance, found = t, surface
    return distance, found


@compiled
def normal(scene, shape, position):
    """Outward unit normal at a point of a box or ellipsoid."""
    p, axes = local(scene, shape, minus(position, vector(scene, shape + CENTER))), shape + AXES
    half = vector(scene, shape + HALF)
    if scene[shape] == ELLIPSOID:
        outward = scaled(vector(scene, axes), p[0] / half[0] ** 2)
        outward = along(outward, vector(scene, axes + 3), p[1] / half[1] ** 2)
        outward = along(outward, vector(scene, axes + 6), p[2] / half[2] ** 2)
        return scaled(outward, 1.0 / math.sqrt(dot(outward, outward)))
    face, gap = 0, INF
    for k in range(3):
        here = abs(abs(p[k]) - half[k])
        if here < gap:
            face, gap = k, here
    return scaled(vector(scene, axes + 3 * face), 1.0 if p[face] >= 0.0 else -1.0)


# --- media ---------------------------------------------------------------------------------------------------


@compiled
def density(scene, v, p):
    """Density of volume v at a point of its domain."""
    kind, at = scene[v + DENSITY], v + PARAMETERS
    if kind == HOMOGENEOUS:
        return 1.0
    if kind == HEIGHT:
        return math.exp(-(p[2] - scene[at + 1]) / scene[at])
    if kind == ALTITUDE:
        offset = minus(p, vector(scene, at + 2))
        return math.exp(-(math.sqrt(dot(offset, offset)) - scene[at + 1]) / scene[at])
    if kind == NOISE:
        return _noise_density(scene, at, p[0], p[1], p[2])
    if kind == DUST:
        return _dust_density(scene, at, p[0], p[1], p[2])
    return voxel_density(scene, v, p)


@compiled
def lattice(scene, at):
    """Counts along the axes and index of the first number of an array."""
    return int(scene[at]), int(scene[at + 1]), int(scene[at + 2]), int(scene[at + 3])


@compiled
def voxel_density(scene, v, p):
    nx, ny, nz, start = lattice(scene, v + VOXELS)
    low, high = vector(scene, v + PARAMETERS), vector(scene, v + PARAMETERS + 3)
    if not (low[0] <= p[0] <= high[0] and low[1] <= p[1] <= high[1] and low[2] <= p[2] <= high[2]):
        return 0.0
    x = min(max((p[0] - low[0]) / (high[0] - low[0]) * nx - 0.5, 0.0), nx - 1.0)
    y = min(max((p[1] - low[1]) / (high[1] - low[1]) * ny - 0.5, 0.0), ny - 1.0)
    z = min(max((p[2] - low[2]) / (high[2] - low[2]) * nz - 0.5, 0.0), nz - 1.0)
    i, j, k = int(x), int(y), int(z)
    x, y, z = x - i, y - j, z - k
    right = ny * nz if i + 1 < nx else 0
    back = nz if j + 1 < ny else 0
    up = 1 if k + 1 < nz else 0
    c = start + (i * ny + j) * nz + k
    a00 = scene[c] + z * (scene[c + up] - scene[c])
    a01 = scene[c + back] + z * (scene[c + back + up] - scene[c + back])
    c += right
    a10 = scene[c] + z * (scene[c + up] - scene[c])
    a11 = scene[c + back] + z * (scene[c + back + up] - scene[c + back])
    a0, a1 = a00 + y * (a01 - a00), a10 + y * (a11 - a10)
    return a0 + x * (a1 - a0)


@compiled
def majorant(scene, v, origin, direction, t):
    """Bound of the density in the cell of volume v ahead of t, and the distance at which the ray leaves the cell."""
    kind, at = scene[v + DENSITY], v + PARAMETERS
    if kind == HOMOGENEOUS:
        return 1.0, INF
    if kind == HEIGHT:
        thickness = LAYER * scene[at]
        slope = direction[2]
        level = (origin[2] + t * slope - scene[at + 1]) / thickness
        if abs(slope) * 1e12 < 1.0:
            return math.exp(-LAYER * (level - 1e-6)), INF
        k = math.floor(level + math.copysign(1e-6, slope))
        edge = k + 1.0 if slope > 0.0 else k
        return math.exp(-LAYER * k), max(t + (edge - level) * thickness / slope, t)
    if kind == ALTITUDE:
        return shell_majorant(scene, at, origin, direction, t)
    low, size = vector(scene, v + LOW), vector(scene, v + SIZE)
    nx, ny, nz, start = lattice(scene, v + CELLS)
    x, y, z = along(origin, direction, t + 1e-6 * size[0])
    i, j, k = math.floor((x - low[0]) / size[0]), math.floor((y - low[1]) / size[1]), math.floor((z - low[2]) / size[2])
    leave = min(cell_exit(low[0], size[0], nx, i, origin[0], direction[0]),
                min(cell_exit(low[1], size[1], ny, j, origin[1], direction[1]),
                    cell_exit(low[2], size[2], nz, k, origin[2], direction[2])))
    leave = max(leave, t + 1e-6 * size[0])
    if 0 <= i < nx and 0 <= j < ny and 0 <= k < nz:
        return scene[start + (i * ny + j) * nz + k], leave
    return 0.0, leave


@compiled
def cell_exit(low, size, count, index, origin, slope):
    """Where the ray leaves layer ``index`` of ``count`` along one axis; the layers before and behind reach to infinity."""
    edge = index + 1 if slope > 0.0 else index
    if slope == 0.0 or (index < 0 and slope < 0.0) or (index >= count and slope > 0.0):
        return INF
    return (low + size * min(max(edge, 0), count) - origin) / slope


@compiled
def shell_majorant(scene, at, origin, direction, t):
    thickness = LAYER * scene[at]
    ground = scene[at + 1]
    p = along(minus(origin, vector(scene, at + 2)), direction, t)
    radius = math.sqrt(dot(p, p))
    climb = dot(p, direction)
    k = math.floor((radius - ground) / thickness + math.copysign(1e-6, climb))
    bound = math.exp(min(-LAYER * k, 600.0))
    # With q = |p|^2 - climb^2 the squared distance of the line from the centre.
    inner, outer = ground + k * thickness, ground + (k + 1.0) * thickness
    closest2 = radius * radius - climb * climb
    if climb < 0.0 and inner > 0.0 and inner * inner > closest2:
        leave = -climb - math.sqrt(inner * inner - closest2)
    else:
        leave = -climb + math.sqrt(max(outer * outer - closest2, 0.0))
    return bound, t + max(leave, 1e-6 * thickness)


@compiled
def phase_value(scene, v, c):
    kind, at = scene[v + PHASE], v + PHASE
    if kind == RAYLEIGH:
        return 3.0 / (16.0 * math.pi) * (1.0 + c * c)
    value = (1.0 - scene[at + 3]) * lobe(c, scene[at + 1])
    if scene[at + 3] > 0.0:
        second = lobe(c, scene[at + 2])
        if kind == MIE:
            alpha, g = scene[at + 4], scene[at + 2]
            second *= (1.0 + alpha * c * c) / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0)
        value += scene[at + 3] * second
    return value


@compiled
def lobe(c, g):
    """Henyey-Greenstein in the form that does not cancel at its peak."""
    size = abs(g)
    gap = 1.0 - size
    denominator = gap * gap + 2.0 * size * (1.0 - (c if g >= 0.0 else -c))
    return gap * (1.0 + size) / (4.0 * math.pi * denominator * math.sqrt(denominator))


@compiled
def sample_lobe(g, state):
    u, size = uniform(state), abs(g)
    gap = 1.0 - size
    ratio = gap / (gap + 2.0 * size * u)
    c = 1.0 - 2.0 * ratio * ratio * (1.0 - u) * (1.0 + size * u)
    return c if g >= 0.0 else -c


@compiled
def sample_phase(scene, v, state):
    """A cosine distributed as the phase function of volume v."""
    kind, at = scene[v + PHASE], v + PHASE
    if kind == RAYLEIGH:
        return min(1.0, max(-1.0, 2.0 * math.sinh(math.asinh(4.0 * uniform(state) - 2.0) / 3.0)))
    if scene[at + 3] == 0.0 or uniform(state) >= scene[at + 3]:
        return sample_lobe(scene[at + 1], state)
    if kind != MIE:
        return sample_lobe(scene[at + 2], state)
    while True:  # Draine's function is Henyey-Greenstein's times 1 + alpha c^2: at least every third is accepted
        c = sample_lobe(scene[at + 2], state)
        if uniform(state) * (1.0 + scene[at + 4]) < 1.0 + scene[at + 4] * c * c:
            return c


@compiled
def transmittance(scene, origin, direction, limit, state):
    """Unbiased estimate of the transmittance over [0, limit]: closed form, or ratio tracking from cell to cell."""
    value = (1.0, 1.0, 1.0)
    for i in range(int(scene[VOLUMES])):
        v = int(scene[VOLUMES + 1]) + i * VOLUME
        near, far = interval(scene, v, origin, direction)
        near, far = max(near, 0.0), min(far, limit)
        if near >= far:
            continue
        sigma_t, kind = vector(scene, v + SIGMA_T), scene[v + DENSITY]
        if kind == HOMOGENEOUS or kind == HEIGHT:
            depth = far - near
            if kind == HEIGHT:
                depth *= mean_over_height(scene, v + PARAMETERS, origin[2] + near * direction[2], depth * direction[2])
            if sigma_t[0] == sigma_t[1] == sigma_t[2]:
                value = scaled(value, math.exp(-sigma_t[0] * depth))
            else:
                value = times(value, (math.exp(-sigma_t[0] * depth), math.exp(-sigma_t[1] * depth),
                                      math.exp(-sigma_t[2] * depth)))
        else:
            value = ratio_tracking(scene, v, value, sigma_t, origin, direction, near, far, state)
            if size_of(value) == 0.0:
                break
    return value


@compiled
def mean_over_height(scene, at, z, rise):
    """Mean of exp(-(z - base) / scale) between the heights z and z + rise."""
    x = rise / scene[at]
    start = math.exp(-(z - scene[at + 1]) / scene[at])
    return start * (-math.expm1(-x) / x if abs(x) > 1e-9 else 1.0 - x / 2.0)


@compiled
def ratio_tracking(scene, v, value, sigma_t, origin, direction, t, far, state):
    strongest = largest(sigma_t)
    relative = scaled(sigma_t, 1.0 / strongest)
    depth = exponential(state)
    while t < far:
        bound, leave = majorant(scene, v, origin, direction, t)
        leave = min(leave, far)
        here = strongest * bound
        if depth >= here * (leave - t):
            depth -= here * (leave - t)
            t = leave
            continue
        t += depth / here
        share = density(scene, v, along(origin, direction, t)) / bound
        value = times(value, (1.0 - relative[0] * share, 1.0 - relative[1] * share, 1.0 - relative[2] * share))
        size = size_of(value)
        if size < TRACKING_THRESHOLD:
            if uniform(state) * TRACKING_THRESHOLD >= size:
                return 0.0, 0.0, 0.0
            value = scaled(value, TRACKING_THRESHOLD / size)
        depth = exponential(state)
    return value


# --- lights --------------------------------------------------------------------------------------------------


@compiled
def arriving(scene, light, position):
    """Direction towards the light, distance, and unattenuated irradiance facing it."""
    if scene[light + SUN] == 1.0:
        return vector(scene, light + TOWARD), INF, vector(scene, light + COLOR)
    offset = minus(vector(scene, light + POSITION), position)
    squared = max(dot(offset, offset), 1e-300)
    distance = math.sqrt(squared)
    toward = scaled(offset, 1.0 / distance)
    factor = 1.0 / squared
    dark, full = scene[light + DARK], scene[light + FULL]
    if dark >= -1.0:
        cosine = -dot(toward, vector(scene, light + TOWARD))
        if cosine < dark:
            factor = 0.0
        elif cosine < full:
            s = (cosine - dark) / (full - dark)
            factor *= s * s * (3.0 - 2.0 * s)
    return toward, distance, scaled(vector(scene, light + COLOR), factor)


@compiled
def unoccluded(scene, position, toward, distance):
    for i in range(int(scene[SURFACES])):
        near, far = interval(scene, int(scene[SURFACES + 1]) + i * SURFACE, position, toward)
        t = near if near > scene[EPSILON] else far
        if near <= far and scene[EPSILON] < t < distance - scene[EPSILON]:
            return False
    return True


@compiled
def next_event(scene, direct, position, toward, distance, state):
    """What remains of the light ``direct`` on its way to the position."""
    if largest(direct) <= 0.0 or not unoccluded(scene, position, toward, distance):
        return 0.0, 0.0, 0.0
    return times(direct, transmittance(scene, position, toward, distance, state))


@compiled
def angular_range(scene, light, origin, direction, start, stop, work, row):
    """Prepare equiangular sampling of [start, stop]: foot, distance from the line, angle at its lit start and over it."""
    offset = minus(vector(scene, light + POSITION), origin)
    foot = dot(offset, direction)
    across = minus(offset, scaled(direction, foot))
    height = max(math.sqrt(dot(across, across)), 1e-9 * scene[EPSILON])
    dark = scene[light + DARK]
    if dark > 0.0:
        near, far = nappe_interval(scaled(offset, -1.0), direction, vector(scene, light + TOWARD), dark * dark)
        start, stop = max(start, near), min(stop, far)
    work[row], work[row + 1], work[row + 2], work[row + 3] = foot, height, 0.0, 0.0
    if start < stop:
        work[row + 2] = math.atan((start - foot) / height)
        work[row + 3] = max(math.atan((stop - foot) / height) - work[row + 2], 0.0)
    work[row + 4], work[row + 5] = start, stop


@compiled
def equiangular_pdf(work, row, t):
    if work[row + 3] <= 0.0 or t < work[row + 4] or t > work[row + 5]:
        return 0.0
    return work[row + 1] / (work[row + 3] * (work[row + 1] * work[row + 1] + (t - work[row]) ** 2))


@compiled
def distance_pdf(rate, start, t):
    """Of free flight through a medium of extinction ``rate`` from ``start`` on: the proxy in the weights."""
    return rate * math.exp(-rate * (t - start))


@compiled
def equiangular_scattering(scene, light, row, rate, start, origin, direction, work, state):
    """Light scattered once into the ray at a distance drawn equiangularly, weighted against distance sampling."""
    if work[row + 3] <= 0.0:
        return 0.0, 0.0, 0.0
    t = work[row] + work[row + 1] * math.tan(work[row + 2] + uniform(state) * work[row + 3])
    t = min(max(t, work[row + 4]), work[row + 5])
    position = along(origin, direction, t)
    toward, distance, direct = arriving(scene, light, position)
    if largest(direct) <= 0.0:
        return 0.0, 0.0, 0.0
    cosine = min(1.0, max(-1.0, dot(toward, direction)))
    scattering = (0.0, 0.0, 0.0)
    for i in range(int(scene[VOLUMES])):
        if work[SPAN * i] <= t <= work[SPAN * i + 1]:
            v = int(scene[VOLUMES + 1]) + i * VOLUME
            factor = density(scene, v, position) * phase_value(scene, v, cosine)
            scattering = along(scattering, vector(scene, v + SIGMA_S), factor)
    if largest(scattering) <= 0.0:
        return 0.0, 0.0, 0.0
    # Weight over density, with the balance heuristic.
    factor = 1.0 / (equiangular_pdf(work, row, t) + distance_pdf(rate, start, t))
    direct = next_event(scene, scaled(times(direct, scattering), factor), position, toward, distance, state)
    if direct == (0.0, 0.0, 0.0):
        return direct
    return times(direct, transmittance(scene, origin, direction, t, state))


# --- paths ---------------------------------------------------------------------------------------------------


@compiled
def collide(scene, origin, direction, beta, ratio, hero, work, state):
    """Distance and volume (-1: none) of the next real collision, and the path's factors after it.

    Tentative collisions follow the sum of the volumes' majorants. Where a density exceeds its majorant, null collisions
    have negative weights and the estimate remains unbiased.
    """
    count = int(scene[VOLUMES])
    t, depth = INF, exponential(state)
    for i in range(count):
        if work[SPAN * i] < work[SPAN * i + 1]:
            t = min(t, work[SPAN * i])
    while t < INF:
        # The piece ahead on which all majorants are constant.
        total, leave = 0.0, INF
        for i in range(count):
            near, far, bound = work[SPAN * i], work[SPAN * i + 1], 0.0
            if t < near < far:
                leave = min(leave, near)
            elif near <= t < far:
                v = int(scene[VOLUMES + 1]) + i * VOLUME
                bound, end = majorant(scene, v, origin, direction, t)
                bound *= largest(vector(scene, v + SIGMA_T))
                total += bound
                leave = min(leave, min(end, far))
            work[SPAN * i + 2] = bound
        if leave == INF:
            break
        if depth >= total * (leave - t):
            depth -= total * (leave - t)
            t = leave
            continue
        t += depth / total
        depth = exponential(state)
        i, choice = 0, total * uniform(state) if count > 1 else 0.0
        while i < count - 1 and choice >= work[SPAN * i + 2]:
            choice -= work[SPAN * i + 2]
            i += 1
        v = int(scene[VOLUMES + 1]) + i * VOLUME
        factor = density(scene, v, along(origin, direction, t)) / work[SPAN * i + 2]
        share = scaled(vector(scene, v + SIGMA_T), factor)
        real = collision_chance(share[hero])
        if uniform(state) < real:
            beta = times(beta, scaled(vector(scene, v + SIGMA_S), factor / real))
            ratio = times(ratio, (collision_chance(share[0]) / real, collision_chance(share[1]) / real,
                                  collision_chance(share[2]) / real))
            return t, v, beta, ratio
        rest = 1.0 - real
        beta = times(beta, ((1.0 - share[0]) / rest, (1.0 - share[1]) / rest, (1.0 - share[2]) / rest))
        ratio = times(ratio, ((1.0 - collision_chance(share[0])) / rest, (1.0 - collision_chance(share[1])) / rest,
                              (1.0 - collision_chance(share[2])) / rest))
    return INF, -1, beta, ratio


@compiled
def collision_chance(share):
    """Chance that a tentative collision is real: the extinction's share of the majorant, where that bounds it."""
    return share / (share + abs(1.0 - share))


@compiled
def weighted(beta, ratio):
    return scaled(beta, 3.0 / (ratio[0] + ratio[1] + ratio[2]))


@compiled
def trace(scene, orders, origin, direction, work, state):
    """One path's estimate of the radiance along a ray, and the vertices visited.

    ``work`` holds SPAN numbers for each volume (where the ray enters and leaves it, its majorant) and ROW for each light.
    """
    value, beta, ratio = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)
    hero = int(3.0 * uniform(state))
    volumes, lights = int(scene[VOLUMES]), int(scene[LIGHTS])
    vertices = 0
    for order in range(orders + 1):
        hit, surface = first_hit(scene, origin, direction)
        start, stop, rate = INF, 0.0, 0.0
        for i in range(volumes):
            v = int(scene[VOLUMES + 1]) + i * VOLUME
            near, far = interval(scene, v, origin, direction)
            near, far = max(near, 0.0), min(far, hit)
            work[SPAN * i], work[SPAN * i + 1] = near, far
            if near < far and largest(vector(scene, v + SIGMA_S)) > 0.0:
                start, stop = min(start, near), max(stop, far)
                rate += (far - near) * scene[v + MEAN]
        if order < orders and start < stop:
            rate /= stop - start
            for l in range(lights):
                light, row = int(scene[LIGHTS + 1]) + l * LIGHT, SPAN * volumes + ROW * l
                if scene[light + SUN] == 0.0:
                    angular_range(scene, light, origin, direction, start, stop, work, row)
                    scattered = equiangular_scattering(scene, light, row, rate, start, origin, direction, work, state)
                    value = along(value, times(weighted(beta, ratio), scattered), 1.0)
        distance, v, beta, ratio = collide(scene, origin, direction, beta, ratio, hero, work, state)
        if v < 0 and surface < 0:
            value = along(value, times(weighted(beta, ratio), vector(scene, ENVIRONMENT)), 1.0)
            break
        if v < 0:
            value = along(value, times(weighted(beta, ratio), vector(scene, surface + EMISSION)), 1.0)
            albedo = vector(scene, surface + ALBEDO)
            if order == orders or largest(albedo) <= 0.0:
                break
            beta = times(beta, albedo)
            position = along(origin, direction, hit)
            outward = normal(scene, surface, position)
            if dot(outward, direction) > 0.0:
                outward = scaled(outward, -1.0)
            origin = along(position, outward, scene[EPSILON])
        else:
            if order == orders or largest(vector(scene, v + SIGMA_S)) <= 0.0:
                break
            origin = along(origin, direction, distance)
        for l in range(lights):
            light, row = int(scene[LIGHTS + 1]) + l * LIGHT, SPAN * volumes + ROW * l
            toward, reach, direct = arriving(scene, light, origin)
            if v < 0:
                factor = max(dot(outward, toward), 0.0) / math.pi
            else:
                factor = phase_value(scene, v, min(1.0, max(-1.0, dot(toward, direction))))
                angular = equiangular_pdf(work, row, distance) if scene[light + SUN] == 0.0 else 0.0
                if angular > 0.0:
                    free = distance_pdf(rate, start, distance)
                    factor *= free / (free + angular)
            direct = next_event(scene, scaled(direct, factor), origin, toward, reach, state)
            value = along(value, times(weighted(beta, ratio), direct), 1.0)
        if v < 0:
            direction = turned(outward, math.sqrt(1.0 - uniform(state)), state)
        else:
            direction = turned(direction, sample_phase(scene, v, state), state)
        vertices += 1
        if order >= ROULETTE_START:
            survival = size_of(weighted(beta, ratio)) / ROULETTE_THRESHOLD
            if survival < 1.0:
                if uniform(state) >= survival:
                    break
                beta = scaled(beta, 1.0 / survival)
    return value, vertices


@numba.njit(parallel=True, error_model="numpy", cache=True)
def trace_paths(scene, orders, camera, width, height, strata, samples, first, last, seed, image):
    """Add the paths first <= j < last of an image to ``image`` (height * width, 3), and return the vertices visited.

    Path j is sample j // pixels of pixel j % pixels. ``camera`` comes from ``camera_numbers``, ``seed`` is an uint64.
    """
    pixels, cells = width * height, strata * strata
    vertices = np.zeros(CHUNKS, np.int64)
    for chunk in numba.prange(CHUNKS):
        work = np.empty(SPAN * int(scene[VOLUMES]) + ROW * int(scene[LIGHTS]))
        state = np.empty(1, np.uint64)
        for pixel in range(chunk, pixels, CHUNKS):
            for sample in range(first // pixels, (last - 1) // pixels + 1):
                path = sample * pixels + pixel
                if not first <= path < last:
                    continue
                state[0] = hashed(seed + np.uint64(0x9E3779B97F4A7C15) * np.uint64(path + 1))
                x, y = 0.5, 0.5
                if cells > 0 and sample < samples - samples % cells:
                    cell = sample % cells
                    x, y = (cell % strata + uniform(state)) / strata, (cell // strata + uniform(state)) / strata
                elif cells > 0:
                    x, y = uniform(state), uniform(state)
                x, y = (pixel % width + x - width / 2.0) * camera[12], (height / 2.0 - pixel // width - y) * camera[12]
                direction = along(along(scaled(vector(camera, 3), x), vector(camera, 6), y), vector(camera, 9), -1.0)
                direction = scaled(direction, 1.0 / math.sqrt(dot(direction, direction)))
                value, visited = trace(scene, orders, vector(camera, 0), direction, work, state)
                vertices[chunk] += visited
                for c in range(3):
                    image[pixel, c] += value[c]
    return vertices.sum()


def camera_numbers(camera: Camera, width: int) -> np.ndarray:
    """Position, right, up, back, and the size of a pixel at distance 1."""
    right, up, back = look_frame(camera.direction)
    return np.array([*camera.position, *right, *up, *back, 2.0 * math.tan(camera.field_of_view / 2.0) / width])
