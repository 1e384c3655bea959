"""Light from all of space, which no planar light explains: what the program must catch.

    python3 -m generator.surround OUT [--environment MAP.exr]     in the folder testdata/

renders a set per material by Mitsuba's own path integrator, under a room of lamps at all elevations or
under any lat-long map. There is no truth to recover: no lighting in the plane is right.
"""
import argparse
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

from .cases import Case, Light, copper, phong
from .files import view_name, write_capture, write_exr, write_recipe
from .render import bsdf_description, sensor_description, shape_description

MATERIALS = {
    "lambertian": {"model": "lambertian", "albedo": [0.6, 0.5, 0.4]},
    "phong8": phong(8),
    "ggx01": copper(0.1),
}


def room(width=512, height=256):
    """A grey room with a bright floor, and lamps of 8 to 30 degrees at many elevations: radiance, (height, width, 3)."""
    phi, elevation = np.meshgrid(
        2 * np.pi * (np.arange(width) + 0.5) / width, np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height
    )
    direction = np.stack([np.cos(elevation) * np.cos(phi), np.cos(elevation) * np.sin(phi), np.sin(elevation)], -1)
    pixels = np.full((height, width, 3), 0.1) + 0.2 * (elevation < 0)[..., None]
    lamps = [(20, 55, 10, 8.0), (110, -35, 15, 4.0), (190, 30, 8, 12.0), (250, 70, 12, 6.0), (310, 5, 6, 9.0), (80, 15, 5, 7.0)]
    for azimuth, height_deg, radius, radiance in lamps:
        a, e = np.radians([azimuth, height_deg])
        towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        lit = direction @ towards > np.cos(np.radians(radius))
        pixels[lit] = radiance * np.array([1.0, 0.9, 0.75])
    return pixels


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--environment", type=Path)
    parser.add_argument("--shape", default="sphere", choices=["sphere", "cylinder"])
    parser.add_argument("--material", action="append", choices=list(MATERIALS))
    parser.add_argument("--size", default="160x5")
    parser.add_argument("--views", type=int, default=24)
    parser.add_argument("--samples", type=int, default=1024)
    parser.add_argument("--visible", action="store_true", help="the surroundings are seen behind the object")
    options = parser.parse_args()
    dr.set_thread_count(2)
    # Mitsuba's up is +Y; ours is +Z.
    upright = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    light = {"type": "envmap", "to_world": upright}
    if options.environment:
        light["filename"] = str(options.environment)
    else:
        light["bitmap"] = mi.Bitmap(room().astype(np.float32))
    width, height = map(int, options.size.split("x"))
    for name in options.material or MATERIALS:
        case = Case(
            f"surround-{name}", f"{name} {options.shape} in a room lit from everywhere", MATERIALS[name], Light(),
            views=options.views, size=(width, height), shape=options.shape,
        )
        folder = options.out / case.name
        (folder / "views").mkdir(parents=True, exist_ok=True)
        scene = mi.load_dict({
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2, "hide_emitters": not options.visible},
            "light": light,
            "shape": {**shape_description(case), "bsdf": bsdf_description(case.material)},
        })
        for index, orbit in enumerate(case.orbit_degrees()):
            sensor = mi.load_dict(sensor_description(case.camera, orbit, options.samples))
            pixels = np.array(mi.render(scene, sensor=sensor, seed=index))[..., :3]
            write_exr(folder / view_name(index), pixels, ("R", "G", "B"), "half")
        write_capture(folder, case)
        write_recipe(folder, case)
        print(folder)


if __name__ == "__main__":
    main()
