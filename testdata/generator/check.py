"""A set read back from disk against quadrature of eq. 4.

Nothing here comes from the renderer or from the case's description: geometry is taken from the
written capture.toml, light and material from the written truth. So the check also covers what the
files say.
"""
import glob
import tomllib
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from .light import Light, Source
from .quadrature import reflected

LIMIT = 1e-3
LIMIT_DEG = 75.0
# Points across a pixel at which the quadrature is averaged, as the photograph is over its footprint.
ACROSS = 16


def check(folder):
    """Returns {limb angle in degrees: rms difference / maximum} for the clean set in a folder."""
    folder = Path(folder)
    capture = tomllib.loads((folder / "capture.toml").read_text())
    material, light = read_scene(folder / "truth" / "scene.toml")
    files, orbit = list_views(folder, capture)
    alpha, theta_o = pixel_angles(capture)
    seen = np.isfinite(theta_o).all(axis=1)
    alpha, theta_o = alpha[seen], theta_o[seen]
    orbit_alpha = alpha.ravel()[None] + np.radians(orbit)[:, None]
    expected = reflected(material, light, orbit_alpha, theta_o.ravel())
    expected = expected.reshape(len(files), *theta_o.shape, 3).mean(axis=2)
    measured = np.stack([equator(read_exr(file))[seen] for file in files])
    steepest = np.degrees(np.abs(theta_o).max(axis=1))
    error = (measured - expected) / expected.max()
    return {limit: float(np.sqrt(np.mean(error[:, steepest < limit] ** 2))) for limit in (LIMIT_DEG, 85.0)}


def list_views(folder, capture):
    if "view" in capture:
        views = capture["view"]
        return [folder / v["photos"][0]["file"] for v in views], np.array([v["orbit_deg"] for v in views])
    views = capture["views"]
    files = sorted(glob.glob(str(folder / views["files"])))
    return files, views["orbit_start_deg"] + views["orbit_step_deg"] * np.arange(len(files))


def read_scene(path):
    """The material and the light of a scene.toml."""
    scene = tomllib.loads(path.read_text())
    lighting = scene["lighting"]
    sources = tuple(Source(s["theta_deg"], tuple(s["irradiance"])) for s in lighting.get("sources", []))
    light = Light(sources, tuple(lighting.get("uniform", (0, 0, 0))))
    if "table" in lighting:
        table = np.loadtxt(path.parent / lighting["table"], delimiter=",", skiprows=1)
        # Equally spaced samples of a band-limited function: its Fourier series is exact.
        p = np.arange(61)
        phase = np.exp(-1j * np.multiply.outer(p, np.radians(table[:, 0])))
        light = Light(sources, light.uniform, phase @ table[:, 1:] / len(table))
    return scene["brdf"], light


def pixel_angles(capture):
    """alpha - orbit and theta_o' (radians; nan off the object) at points across each column: (width, ACROSS)."""
    camera, radius = capture["camera"], capture["object"]["radius"]
    width, height = camera["image_size"]
    u = np.arange(width)[:, None] + (np.arange(ACROSS) + 0.5) / ACROSS
    with np.errstate(invalid="ignore"):
        if camera["projection"] == "orthographic":
            turn = np.arcsin((u - width / 2) * camera["width_m"] / width / radius)
            return turn, -turn
        centre = camera.get("principal_point_px", [width / 2, height / 2])[0]
        # The ray leaves the camera at `slant` to the axis and passes the centre at distance D sin(slant).
        slant = np.arctan((u - centre) / focal_px(camera))
        turn = np.arcsin(camera["distance"] * np.sin(slant) / radius)
    return turn - slant, -turn


def focal_px(camera):
    width = camera["image_size"][0]
    if "fov_x_deg" in camera:
        return width / 2 / np.tan(np.radians(camera["fov_x_deg"]) / 2)
    if "focal_mm" in camera:
        return camera["focal_mm"] / camera["sensor_width_mm"] * width
    return camera["focal_px"]


def read_exr(path):
    image = oiio.ImageInput.open(str(path))
    if image is None:
        raise OSError(f"cannot read {path}: {oiio.geterror()}")
    pixels = image.read_image("float")
    image.close()
    return np.asarray(pixels, dtype=float)


def equator(pixels):
    """The row of the measurement plane: (width, 3).

    A pixel off the plane by z differs by a multiple of z^2, whose mean over the pixel is known;
    two rows on each side remove it. The weights are for pixels one unit high about z = 0.
    """
    height = len(pixels)
    folded = (pixels + pixels[::-1]) / 2
    middle = height // 2
    if height % 2:
        return (13 * folded[middle] - folded[middle + 1]) / 12
    return (7 * folded[middle] - folded[middle + 1]) / 6
