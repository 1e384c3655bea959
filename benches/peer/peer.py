#!/usr/bin/env python3
"""The main job as a good user of OpenImageIO, NumPy and SciPy would write it: the light around a cylinder of known
material from its photographs. No report, no error bars, no outline fit beyond a threshold, no masks, no formats: what it
leaves out is in its favour.

    peer.py SET [--rows first:last]

Whole photographs are read, as `oiio.ImageBuf` or `ImageInput.read_image` do, unless --rows gives scan lines."""
import argparse
import json
import re
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import map_coordinates

THREADS = 2
ORDER = 48
COLUMNS = np.radians(np.arange(-80.5, 81.0, 1.0))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("set", type=Path)
    parser.add_argument("--rows", help="first:last, read only these scan lines")
    parser.add_argument("--read-only", action="store_true", help="stop after reading whole photographs")
    options = parser.parse_args()
    start = time.perf_counter()
    oiio.attribute("threads", THREADS)
    capture = describe((options.set / "capture.toml").read_text())
    files = sorted((options.set / "views").iterdir())
    rows = tuple(int(r) for r in options.rows.split(":")) if options.rows else None
    if options.read_only:
        # OpenImageIO decodes one file with all threads; a second file at a time would only add memory.
        total = sum(float(whole(file)[0, 0, 0]) for file in files)
        print(json.dumps({"seconds": time.perf_counter() - start, "sum": total}))
        return
    with ThreadPoolExecutor(THREADS) as pool:
        views = list(pool.map(lambda file: line_of(file, capture, rows), files))
    read = time.perf_counter() - start
    orbit = np.radians(capture["start"] + capture["step"] * np.arange(len(files)))
    samples = np.stack([at_columns(view, capture) for view in views])  # [view, column, channel]
    light = recover(samples, orbit, capture, (options.set / "recipe.toml").read_text())
    print(json.dumps({
        "seconds": time.perf_counter() - start,
        "reading": read,
        "L0": [float(l[0].real) for l in light],
    }))


def describe(text):
    def number(key, default=None):
        found = re.search(rf"^{key} *= *([-\d.e]+)", text, re.M)
        return float(found[1]) if found else default
    width, height = (int(n) for n in re.search(r"image_size *= *\[(\d+), *(\d+)\]", text).groups())
    focal = number("focal_px") or number("focal_mm") / number("sensor_width_mm") * width
    return {"radius": number("radius"), "distance": number("distance"), "focal": focal, "size": (width, height),
            "start": number("orbit_start_deg", 0.0), "step": number("orbit_step_deg")}


def whole(file):
    image = oiio.ImageInput.open(str(file))
    pixels = image.read_image(0, 0, 0, 3, oiio.FLOAT)
    image.close()
    return pixels


def line_of(file, capture, rows):
    """Mean over the middle rows, which a parabola in the height takes to the cross-section, and both limbs."""
    width, height = capture["size"]
    if rows:
        image = oiio.ImageInput.open(str(file))
        pixels = image.read_scanlines(0, 0, rows[0], rows[1], 0, 0, 3, oiio.FLOAT)
        image.close()
        first = rows[0]
    else:
        pixels, first = whole(file), 0
    t = np.arange(first, first + len(pixels)) + 0.5 - height / 2
    used = np.abs(t) <= capture["focal"] * 0.026
    basis = np.stack([np.ones(used.sum()), t[used], t[used] ** 2], axis=1)
    weights = np.linalg.pinv(basis)[0].astype(np.float32)
    line = np.tensordot(weights, pixels[used], axes=1)  # [x, channel]
    # The limb: where the brightness crosses half of what is inside, to a fraction of a pixel.
    grey = line.mean(axis=1)
    lit = np.flatnonzero(grey > 0.02 * grey.max())
    left, right = lit[0], lit[-1] + 1

    def crossing(outside, inside):
        level = 0.5 * grey[inside]
        a, b = grey[outside], grey[inside]
        return min(max((level - a) / (b - a), 0.0), 1.0) if b != a else 0.5
    return line, left - crossing(max(left - 1, 0), left) + 1.0, right + crossing(min(right, width - 1), right - 1) - 1.0


def at_columns(view, capture):
    """Samples at the columns' angles to the normal: the line of sight of each, cubic interpolation along the line."""
    line, _, _ = view
    radius, distance, focal = capture["radius"], capture["distance"], capture["focal"]
    normal = -COLUMNS + np.arcsin(radius / distance * np.sin(COLUMNS))
    u = focal * radius * np.sin(normal) / (distance - radius * np.cos(normal)) + capture["size"][0] / 2 - 0.5
    return np.stack([map_coordinates(line[:, c], [u], order=3, mode="nearest") for c in range(line.shape[1])], axis=1)


def recover(samples, orbit, capture, recipe):
    """Weighted least squares for the light's Fourier coefficients, by the normal matrix's structure, with a ridge that
    generalised cross-validation chooses."""
    def values(key):
        found = re.search(rf"^{key} *= *\[?([^\]\n]*)", recipe, re.M)[1]
        return np.array([float(x) for x in found.split(",")])
    diffuse, specular, exponent = values("diffuse"), values("specular"), values("exponent")[0]
    radius, distance = capture["radius"], capture["distance"]
    normal = -COLUMNS + np.arcsin(radius / distance * np.sin(COLUMNS))
    alpha = orbit[:, None] + normal[None, :]
    p = np.arange(ORDER + 1)
    nodes, weights = np.polynomial.legendre.leggauss(256)
    incident, weights = nodes * np.pi / 2, weights * np.pi / 2
    phase = np.exp(1j * np.outer(incident, p))
    lobe = np.clip(np.cos(incident[None, :] + COLUMNS[:, None]), 0, None) ** exponent
    waves = np.exp(1j * alpha[..., None] * p)  # [view, column, p]
    light = []
    for c in range(samples.shape[2]):
        rho = diffuse[c] / np.pi + specular[c] * (exponent + 2) / (2 * np.pi) * lobe
        transfer = (rho * np.cos(incident) * weights) @ phase  # [column, p]
        design = waves * transfer[None]
        design = design.reshape(-1, ORDER + 1)
        real = np.concatenate([design[:, :1].real, 2 * design[:, 1:].real, -2 * design[:, 1:].imag], axis=1)
        b = samples[..., c].ravel()
        matrix, vector = real.T @ real, real.T @ b
        scale = np.trace(matrix) / len(matrix)
        best = None
        eigenvalues = np.linalg.eigvalsh(matrix)
        for ridge in scale * 10.0 ** np.arange(-12, -2):
            x = cho_solve(cho_factor(matrix + ridge * np.eye(len(matrix))), vector)
            freedom = len(b) - np.sum(eigenvalues / (eigenvalues + ridge))
            misfit = b @ b - 2 * x @ vector + x @ matrix @ x
            score = misfit / freedom ** 2
            if best is None or score < best[0]:
                best = score, x
        x = best[1]
        light.append(np.concatenate([x[:1].astype(complex), x[1:ORDER + 1] + 1j * x[ORDER + 1:]]))
    theta = np.radians(np.arange(-180, 180, 0.5))
    for l in light:  # the table that a user wants
        (l[0] + 2 * np.real(np.exp(1j * np.outer(theta, p[1:])) @ l[1:])).real.clip(0)
    return light


if __name__ == "__main__":
    main()
