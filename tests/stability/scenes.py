# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes at the limits of what the model can say, one change each from an ordinary one.

The camera looks along +y from y = -4, so that an odd image has one ray exactly on the axis through boxes, lights and cones.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from volumetrics_addon.scene.model import (
    Box, Camera, Cone, Cover, Dielectric, Ellipsoid, ExponentialAltitude, ExponentialHeight, Grid, Medium, MiePhase, NoiseShape,
    Phase, Point, Projector, RayleighPhase, Scene, Sheet, Spot, Sun, Surface, Volume, turned,
)  # fmt: skip

ORIGIN, DOWN, AHEAD = (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)
EYE = Camera((0.0, -4.0, 0.0), AHEAD, 1.0)
POINT = Point((0.3, 0.2, 2.5), (30.0, 20.0, 10.0))
SPOT = Spot((0.0, 0.0, 3.0), DOWN, (30.0, 20.0, 10.0), 0.8, 0.3)
SUN = Sun(DOWN, (3.0, 2.0, 1.0))
SLIDE = Projector((0.0, 0.0, 3.0), DOWN, AHEAD, (30.0, 20.0, 10.0), 0.8, 0.6, blend=0.2)
ROOM, BALL, WALL = Box(ORIGIN, (1.0, 1.0, 1.0)), Ellipsoid(ORIGIN, (1.0, 1.0, 1.0)), Box((0.0, 2.0, 0.0), (3.0, 0.1, 3.0))
HAZE = Medium((0.2, 0.15, 0.1), (0.02, 0.05, 0.1), Phase(0.5))
NOISE = NoiseShape(ORIGIN, (1.0, 1.0, 1.0), 0.3, 2.0, 0.5, 0.5, 1.0, 0.3, 1)
GRAY = (0.5, 0.5, 0.5)


def medium(extinction, albedo=0.6, **rest):
    return Medium((albedo * extinction,) * 3, ((1 - albedo) * extinction,) * 3, **{"phase": Phase(0.3)} | rest)


def lit(*lights, shape=ROOM, haze=HAZE, eye=EYE, **rest):
    return Scene(eye, lights or (POINT,), volumes=(Volume(shape, haze),), **rest)


def planet(
    radius=6.36e6,
    thickness=6e4,
    extinction=1.2e-5,
    height=8000.0,
    altitude=1.0,
    direction=(0.0, 0.6, -0.8),
    gaze=(0.0, 0.8, 0.6),
):
    sphere, air = (Ellipsoid(ORIGIN, (r, r, r)) for r in (radius, radius + thickness))
    density = ExponentialAltitude(ORIGIN, radius, height)
    media = (
        Medium((extinction,) * 3, (0.0,) * 3, RayleighPhase(), density),
        Medium((extinction,) * 3, (extinction / 10,) * 3, Phase(0.8), density),
    )
    return Scene(
        Camera((0.0, 0.0, radius + altitude), gaze, 1.0),
        (Sun(direction, (1.0, 1.0, 1.0)),),
        volumes=tuple(Volume(air, m) for m in media),
        surfaces=(Surface(sphere, (0.1, 0.1, 0.1)),),
    )


def scaled_world(k):
    """The ordinary scene in a unit k times as large: lengths times k, coefficients over k, powers times k squared."""
    room = Box(ORIGIN, (k, k, k))
    thin = replace(HAZE, sigma_s=tuple(x / k for x in HAZE.sigma_s), sigma_a=tuple(x / k for x in HAZE.sigma_a))
    light = Point(tuple(x * k for x in POINT.position), tuple(x * k * k for x in POINT.power))
    return Scene(Camera((0.0, -4.0 * k, 0.0), AHEAD, 1.0), (light,), volumes=(Volume(room, thin),))


def slab(extinction=1.0, albedo=0.9, tilt=0.8, height=0.5, position=(0.0, 0.0, 3.0), gaze=(0.0, 0.6, -0.8), orders=64):
    sun = Sun((math.sqrt(1 - tilt * tilt), 0.0, -tilt), (1.0, 1.0, 1.0))
    return Scene(
        Camera(position, gaze, 0.5),
        (sun,),
        volumes=(Volume(Box(ORIGIN, (100.0, 100.0, height)), medium(extinction, albedo)),),
        orders=orders,
    )


def behind(*surfaces, light=POINT, **rest):
    return Scene(EYE, (light,), volumes=(Volume(ROOM, HAZE),), surfaces=surfaces, **rest)


def behind_pane(pane, light=POINT, half=(1.0, 0.0, 1.0)):
    """A pane of glass before a grey wall."""
    glass = Volume(Box(ORIGIN, half), Medium((0.0,) * 3, (0.1, 0.5, 1.0)), Dielectric(1.5), sheet=pane)
    return Scene(EYE, (light,), environment=(1.0, 1.0, 1.0), volumes=(glass,), surfaces=(Surface(WALL, GRAY),))


CELLS = np.array([0.0, 1e3, 1e-308, 1.0] * 6).reshape(2, 3, 4)

SCENES: dict[str, Scene] = {
    "ordinary": lit(),
    "ordinary under a spot": lit(SPOT),
    "ordinary under the sun": lit(SUN),
    "ordinary under a projector": lit(SLIDE),
    "ordinary in many orders": lit(orders=64),
    "nothing": Scene(EYE),
    "no lights": Scene(EYE, volumes=(Volume(ROOM, HAZE),)),
    "no volumes": Scene(EYE, (POINT, SUN), surfaces=(Surface(WALL, GRAY),)),
    "no power": lit(Point(POINT.position, (0.0, 0.0, 0.0)), Sun(DOWN, (0.0, 0.0, 0.0))),
    "an empty medium": lit(haze=medium(0.0)),
    "only an environment": Scene(EYE, environment=(1.0, 1.0, 1.0), volumes=(Volume(ROOM, HAZE),)),
    "one channel": lit(haze=Medium((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))),
    **{
        f"extinction {x:g}{' under ' + name if name else ''}": lit(light, haze=medium(x))
        for x in (5e-324, 1e-30, 1e-3, 1e3, 1e30)
        for name, light in (("", POINT), ("the sun", SUN), ("a spot", SPOT))
    },
    "extinction 1e30 around everything": lit(SUN, shape=Box(ORIGIN, (9.0, 9.0, 9.0)), haze=medium(1e30)),
    "albedo 0": lit(haze=medium(1.0, 0.0)),
    "albedo 1": lit(haze=medium(1.0, 1.0)),
    "albedo 1 in many orders": lit(haze=medium(1.0, 1.0), orders=64),
    "sharp forward": lit(haze=medium(1.0, phase=Phase(0.999))),
    "sharp backward": lit(SUN, haze=medium(1.0, phase=Phase(-0.999))),
    "two sharp lobes": lit(haze=medium(1.0, phase=Phase(0.999, -0.999, 0.5))),
    "droplets": lit(SUN, haze=medium(1.0, phase=MiePhase(50.0))),
    "molecules": lit(haze=medium(1.0, phase=RayleighPhase())),
    "camera inside": lit(eye=Camera(ORIGIN, AHEAD, 1.0)),
    "camera on the boundary": lit(eye=Camera((0.0, -1.0, 0.0), AHEAD, 1.0)),
    "camera on an edge": lit(eye=Camera((1.0, -1.0, 0.0), AHEAD, 1.0)),
    "camera in a face": lit(eye=Camera((1.0, 0.0, 0.0), AHEAD, 1.0)),
    "camera at the light": lit(Point(EYE.position, (1.0, 1.0, 1.0))),
    "camera at a light inside": lit(Point(ORIGIN, (1.0, 1.0, 1.0)), eye=Camera(ORIGIN, AHEAD, 1.0)),
    "camera looks down": lit(SPOT, eye=Camera((0.0, 0.0, 4.0), DOWN, 1.0)),
    "camera looks up the light": lit(SPOT, eye=Camera((0.0, 0.0, -4.0), (0.0, 0.0, 1.0), 1.0)),
    "camera turned away": lit(eye=Camera((0.0, -4.0, 0.0), (0.0, -1.0, 0.0), 1.0)),
    "camera on the wall": replace(behind(Surface(WALL, GRAY)), camera=Camera((0.0, 1.9, 0.0), (0.0, -1.0, 0.0), 1.0)),
    "field of view of 179.9 degrees": lit(eye=Camera(EYE.position, AHEAD, math.radians(179.9))),
    "field of view of 1e-9": lit(eye=Camera(EYE.position, AHEAD, 1e-9)),
    "light on the central ray": lit(Point(ORIGIN, (1.0, 1.0, 1.0))),
    "light on the central ray before the medium": lit(Point((0.0, -2.0, 0.0), (1.0, 1.0, 1.0))),
    "light at the entry of the central ray": lit(Point((0.0, -1.0, 0.0), (1.0, 1.0, 1.0))),
    "light at the exit of the central ray": lit(Point((0.0, 1.0, 0.0), (1.0, 1.0, 1.0))),
    "light 1e-12 from the central ray": lit(Point((0.0, 0.0, 1e-12), (1.0, 1.0, 1.0))),
    "spot on the central ray": lit(Spot(ORIGIN, DOWN, (1.0, 1.0, 1.0), 1.0, 0.5)),
    "spot towards the camera": lit(Spot((0.0, 3.0, 0.0), (0.0, -1.0, 0.0), (1.0, 1.0, 1.0), 0.5, 0.5)),
    "spot with the camera": lit(Spot(EYE.position, AHEAD, (1.0, 1.0, 1.0), 0.5, 0.5)),
    "light on a surface": behind(Surface(WALL, GRAY), light=Point((0.0, 1.9, 0.0), (1.0, 1.0, 1.0))),
    "light in a surface": behind(Surface(WALL, GRAY), light=Point((0.0, 2.0, 0.0), (1.0, 1.0, 1.0))),
    "light on a corner": lit(Point((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))),
    "light far away": lit(Point((0.0, 0.0, 1e12), (1e26,) * 3)),
    "two lights in one place": lit(POINT, POINT),
    "power 1e30": lit(Point(POINT.position, (1e30,) * 3)),
    "power 1e-308": lit(Point(POINT.position, (1e-308,) * 3)),
    "spot of 1e-6": lit(replace(SPOT, cone_angle=1e-6)),
    "spot of 180 degrees": lit(replace(SPOT, cone_angle=math.pi)),
    "spot with a hard edge": lit(replace(SPOT, blend=0.0)),
    "spot with blend 1": lit(replace(SPOT, blend=1.0)),
    "spot away from the medium": lit(replace(SPOT, direction=(0.0, 0.0, 1.0))),
    "projector of 1e-6": lit(replace(SLIDE, horizontal_fov=1e-6, vertical_fov=1e-6)),
    "projector of 179 degrees": lit(replace(SLIDE, horizontal_fov=3.124, vertical_fov=3.124)),
    "round projector": lit(replace(SLIDE, elliptic=True)),
    "projector between 2.5 and 3": lit(replace(SLIDE, near=2.5, far=3.0)),
    "projector without depth": lit(replace(SLIDE, near=3.0, far=3.0)),
    "projector of falloff 0": lit(replace(SLIDE, falloff=0)),
    "projector with a gobo": lit(replace(SLIDE, gobo=np.array([[0.0, 1.0], [1e30, 0.0]]))),
    "ambient light": lit(SLIDE, haze=replace(HAZE, ambient=(0.1, 0.2, 0.3))),
    "projector on the central ray": lit(replace(SLIDE, position=ORIGIN)),
    "sun along the ray": lit(Sun(AHEAD, (1.0, 1.0, 1.0))),
    "sun against the ray": lit(Sun((0.0, -1.0, 0.0), (1.0, 1.0, 1.0))),
    "sun in the plane of a face": behind(
        Surface(Box(ORIGIN, (0.2, 0.2, 0.2)), GRAY), light=Sun((1.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    ),
    "sun almost in the plane of a face": behind(
        Surface(Box(ORIGIN, (0.2, 0.2, 0.2)), GRAY), light=Sun((1.0, 0.0, -1e-300), (1.0, 1.0, 1.0))
    ),
    **{f"box of half size {x:g}": lit(shape=Box(ORIGIN, (1.0, x, 1.0))) for x in (0.0, 1e-12, 1e12)},
    "box without size": lit(shape=Box(ORIGIN, ORIGIN)),
    "flat box along the rays": lit(SUN, shape=Box(ORIGIN, (1.0, 1.0, 0.0))),
    "huge box": lit(SUN, shape=Box(ORIGIN, (1e12,) * 3)),
    "turned box": lit(shape=Box(ORIGIN, (1.0, 1.0, 1.0), turned(math.pi / 4))),
    "ball": lit(shape=BALL),
    "flat ball": lit(shape=Ellipsoid(ORIGIN, (1.0, 1e-9, 1.0))),
    "ball touched by the central ray": lit(shape=Ellipsoid((1.0, 0.0, 0.0), (1.0, 1.0, 1.0))),
    "needle": lit(shape=Ellipsoid(ORIGIN, (1e-9, 5.0, 1e-9))),
    **{
        f"cone of {angle:g}": lit(shape=Cone((0.0, -1.0, 0.0), AHEAD, angle, 2.0))
        for angle in (1e-9, 1e-3, 0.5, math.pi / 2 - 1e-9)
    },
    "cone without length": lit(shape=Cone(ORIGIN, AHEAD, 0.5, 0.0)),
    "cone touched by the central ray": lit(shape=Cone(ORIGIN, (0.0, math.cos(0.5), math.sin(0.5)), 0.5, 2.0)),
    "cone through its apex": lit(shape=Cone(ORIGIN, DOWN, 0.5, 2.0)),
    "coincident volumes": Scene(EYE, (POINT, SUN), volumes=(Volume(ROOM, HAZE),) * 2),
    "overlapping volumes": Scene(EYE, (POINT, SPOT), volumes=(Volume(ROOM, HAZE), Volume(BALL, medium(2.0)))),
    "touching volumes": Scene(
        EYE, (SUN,), volumes=(Volume(ROOM, HAZE), Volume(Box((0.0, 2.0, 0.0), (1.0, 1.0, 1.0)), HAZE))
    ),
    "a medium and an empty one": Scene(EYE, (SUN,), volumes=(Volume(ROOM, HAZE), Volume(BALL, medium(0.0)))),
    "height fog": lit(SUN, haze=replace(HAZE, density=ExponentialHeight(1.0, 0.0))),
    "steep height fog": lit(haze=replace(HAZE, density=ExponentialHeight(1e-3, 0.0))),
    "flat height fog": lit(haze=replace(HAZE, density=ExponentialHeight(1e12, 0.0))),
    "height fog far below": lit(haze=replace(HAZE, density=ExponentialHeight(0.001, -1e3))),
    "noise": lit(haze=replace(HAZE, density=NOISE)),
    "noise of strength 0": lit(SUN, haze=replace(HAZE, density=replace(NOISE, noise_strength=0.0))),
    "noise without filling": lit(haze=replace(HAZE, density=replace(NOISE, fill=0.0, noise_strength=0.0))),
    "noise with a hard edge": lit(haze=replace(HAZE, density=replace(NOISE, softness=1e-300))),
    "a grid": lit(haze=replace(HAZE, density=Grid(CELLS, (-1.0,) * 3, (1.0,) * 3))),
    "an empty grid": lit(SUN, haze=replace(HAZE, density=Grid(np.zeros((2, 2, 2)), (-1.0,) * 3, (1.0,) * 3))),
    "a grid smaller than the domain": lit(haze=replace(HAZE, density=Grid(CELLS, (-0.5,) * 3, (0.5,) * 3))),
    "black wall": behind(Surface(WALL, (0.0, 0.0, 0.0))),
    "white wall": behind(Surface(WALL, (1.0, 1.0, 1.0))),
    "shining wall": behind(Surface(WALL, (0.0, 0.0, 0.0), (1e30, 0.0, 1e-30))),
    "wall without thickness": behind(Surface(Box((0.0, 2.0, 0.0), (3.0, 0.0, 3.0)), GRAY), light=SUN),
    "wall in the medium": behind(Surface(Box(ORIGIN, (0.3, 0.0, 0.3)), GRAY), light=SPOT),
    "ball in the medium": behind(Surface(Ellipsoid(ORIGIN, (0.3, 0.3, 0.3)), GRAY)),
    "wall over the whole medium": behind(Surface(ROOM, GRAY)),
    "glass": Scene(
        EYE, environment=(1.0, 1.0, 1.0), volumes=(Volume(BALL, Medium((0.0,) * 3, (0.1, 0.5, 1.0)), Dielectric(1.5)),)
    ),
    "glass that bends nothing": Scene(
        EYE, environment=(1.0, 1.0, 1.0), volumes=(Volume(BALL, Medium((0.0,) * 3, (0.1, 0.5, 1.0)), Dielectric(1.0)),)
    ),
    "opaque glass": Scene(
        EYE, environment=(1.0, 1.0, 1.0), volumes=(Volume(ROOM, Medium((0.0,) * 3, (1e30,) * 3), Dielectric(2.4)),)
    ),
    "glass plate without thickness": Scene(
        EYE,
        environment=(1.0, 1.0, 1.0),
        volumes=(Volume(Box(ORIGIN, (1.0, 0.0, 1.0)), Medium((0.0,) * 3, (1.0,) * 3), Dielectric(1.5)),),
    ),
    **{f"glass pane of {x:g} m": behind_pane(Sheet(x)) for x in (1e-12, 1.0, 1e12)},
    "glass pane under leads": behind_pane(Sheet(0.1, Cover("lead", 0.3, GRAY, 0.5, variation=1.0))),
    "glass pane under soft dirt": behind_pane(Sheet(0.1, Cover("dirt", 1.0, GRAY, 0.5, softness=1.0)), SUN),
    "glass pane that is covered": behind_pane(Sheet(0.1, Cover("uniform", 1.0, (0.0, 0.0, 0.0)))),
    "glass pane seen along its plane": behind_pane(Sheet(0.1), half=(1.0, 1.0, 0.0)),
    "absorbing only": lit(haze=medium(1.0, 0.0), environment=(1.0, 1.0, 1.0)),
    "slab": slab(),
    "slab without absorption": slab(albedo=1.0),
    "slab of extinction 0": slab(0.0),
    "slab of extinction 1e30": slab(1e30),
    "slab of albedo 0": slab(albedo=0.0),
    "slab seen from below": slab(position=(0.0, 0.0, -3.0), gaze=(0.0, 0.0, 1.0)),
    "slab under a vertical sun": slab(tilt=1.0),
    "thin slab": slab(height=1e-12),
    "slab seen along it": slab(gaze=AHEAD),
    "fog": lit(SUN, haze=medium(1.0, density=ExponentialHeight(0.3, -1.0))),
    "fog of extinction 1e30": lit(SUN, haze=medium(1e30, density=ExponentialHeight(0.3, -1.0))),
    "fog under a sky": replace(lit(SUN, haze=medium(0.5)), environment=(0.2, 0.3, 0.4)),
    "fog seen from above": lit(SUN, haze=medium(0.5), eye=Camera((0.0, 0.0, 4.0), DOWN, 1.0)),
    "planet": planet(),
    "planet from space": planet(altitude=1e7, gaze=DOWN),
    "planet from the top of the air": planet(altitude=6e4),
    "planet from the ground": planet(altitude=0.0),
    "planet at sunset": planet(direction=(0.0, -1.0, 0.0)),
    "planet at night": planet(direction=(0.0, 0.0, 1.0)),
    "planet with the sun in the zenith": planet(direction=DOWN, gaze=(0.0, 0.0, 1.0)),
    "planet without air": planet(extinction=0.0),
    "planet under extinction 1": planet(extinction=1.0),
    "planet under air of 1 m": planet(thickness=1.0, height=1.0),
    "planet seen along the horizon": planet(gaze=AHEAD),
    **{f"unit of {k:g} m": scaled_world(k) for k in (1e-6, 1e6)},
}


def light_on_axis(scene: Scene) -> bool:
    """Whether a light without extension stands exactly on the central ray, where single scattering is infinite."""
    axis, start = np.array(scene.camera.direction), np.array(scene.camera.position)
    offsets = [np.array(light.position) - start for light in scene.lights if not isinstance(light, Sun)]
    return any(
        np.linalg.norm(np.cross(offset, axis)) < 1e-9 * (1 + np.linalg.norm(offset)) and offset @ axis >= 0
        for offset in offsets
    )
