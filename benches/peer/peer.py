#!/usr/bin/env python3
"""The main job as a good user of OpenImageIO, NumPy and SciPy would write it for these very sets: the light around a
Phong cylinder from its photographs, with error bars and the same products, but without a report.

    peer.py SET [--out FOLDER] [--bare] [--rows first:last] [--read-only]

What it does, as `flatlight run` does: read the photographs; find both limbs in each to a fraction of a pixel and one
displacement and radius for all; average the rows with a parabola, leaving out rows that are far off, with a variance from
their scatter; samples per view and column of theta_o' with sigma; the light field on the grid; the light by weighted
least squares with two errors of the geometry along, a spectral prior by marginal likelihood, sources by Gauss-Newton steps
on their directions as long as the likelihood asks for them, L >= 0, covariances; residuals; tables and EXR files.

What it leaves out, in its favour: blur of the limb, choice of the number of rows, exposure jitter, masks, brackets,
sensors, a lean of the object, advice, checks, other shapes, materials and formats, and the report. --bare leaves out
limbs, error bars, sources, L >= 0 and products as well: a least-squares fit and nothing else.

Whole photographs are read, as `ImageInput.read_image` does, unless --rows gives scan lines; --read-only stops then."""
import argparse
import hashlib
import json
import re
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.ndimage import gaussian_filter1d, map_coordinates, uniform_filter1d
from scipy.optimize import nnls

THREADS = 2
ORDER = 40
GRID = (720, 180)
COLUMNS = np.radians(np.arange(-80.5, 81.0, 1.0))
TABLE = np.radians(np.arange(-180, 180, 0.5))
BELIEF = 6.0
MODEL_ERROR = 1e-4


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", type=Path)
    parser.add_argument("--out", type=Path, help="folder for the products")
    parser.add_argument("--bare", action="store_true", help="a least-squares fit and nothing else")
    parser.add_argument("--rows", help="first:last, read only these scan lines")
    parser.add_argument("--read-only", action="store_true", help="stop after reading")
    options = parser.parse_args()
    start = time.perf_counter()
    oiio.attribute("threads", THREADS)
    capture = describe((options.set / "capture.toml").read_text())
    files = sorted((options.set / "views").iterdir())
    rows = tuple(int(r) for r in options.rows.split(":")) if options.rows else None
    if options.read_only:
        # OpenImageIO decodes one file with all threads; a second file at a time would only add memory.
        total = sum(float(pixels_of(file, rows)[0][0, 0, 0]) for file in files)
        print(json.dumps({"seconds": time.perf_counter() - start, "sum": total}))
        return
    recipe = (options.set / "recipe.toml").read_text()
    orbit = np.radians(capture["start"] + capture["step"] * np.arange(len(files)))
    with ThreadPoolExecutor(THREADS) as pool:
        if options.bare:
            views = list(pool.map(lambda file: bare_line(file, capture, rows), files))
            read = time.perf_counter() - start
            light = bare_light(np.stack([bare_columns(line, capture) for line in views]), orbit, capture, recipe)
            print(json.dumps({"seconds": time.perf_counter() - start, "reading": read, "L0": [float(l[0].real) for l in light]}))
            return
        hashes = list(pool.map(lambda file: hashlib.blake2b(file.read_bytes()).hexdigest(), files))
        photos = list(pool.map(lambda file: photograph(file, capture, rows), files))
        read = time.perf_counter() - start
        pose = settle([limbs for limbs, *_ in photos], orbit, capture)
        views = list(pool.map(lambda k: samples_of(photos[k], pose[k], orbit[k], capture), range(len(files))))
    measured = time.perf_counter() - start
    alpha, value, variance, slope = (np.stack(part) for part in zip(*views))  # [view, column(, channel)]
    result = recover(alpha, value, variance, slope, capture, recipe)
    done = time.perf_counter() - start
    if options.out:
        write(options.out, alpha, value, variance, result, hashes)
    print(json.dumps({"seconds": time.perf_counter() - start, "reading": read, "measured": measured, "light": done,
                      "L0": [float(l["x"][0]) for l in result["channels"]],
                      "sources": [[float(np.degrees(t)), *(float(l["x"][2 * ORDER + 1 + s]) for l in result["channels"])]
                                  for s, t in enumerate(result["directions"])],
                      "sigma_deg": [float(np.degrees(s)) for s in result["direction_sigmas"]]}))


def describe(text):
    def number(key, default=None):
        found = re.search(rf"^{key} *= *([-\d.e]+)", text, re.M)
        return float(found[1]) if found else default
    width, height = (int(n) for n in re.search(r"image_size *= *\[(\d+), *(\d+)\]", text).groups())
    focal = number("focal_px") or number("focal_mm") / number("sensor_width_mm") * width
    return {"radius": number("radius"), "distance": number("distance"), "focal": focal, "size": (width, height),
            "start": number("orbit_start_deg", 0.0), "step": number("orbit_step_deg")}


def pixels_of(file, rows):
    image = oiio.ImageInput.open(str(file))
    tile = image.spec().tile_height
    if rows and tile:
        # Whole tiles, of which all but the wanted rows are dropped.
        first, last = rows[0] // tile * tile, min(-(-rows[1] // tile) * tile, image.spec().height)
        pixels = image.read_tiles(0, 0, 0, image.spec().width, first, last, 0, 1, 0, 3, oiio.FLOAT)
        pixels = pixels.reshape(last - first, image.spec().width, 3)[rows[0] - first:rows[1] - first]
    elif rows:
        pixels = image.read_scanlines(0, 0, rows[0], rows[1], 0, 0, 3, oiio.FLOAT)
    else:
        pixels = image.read_image(0, 0, 0, 3, oiio.FLOAT)
    image.close()
    return pixels, rows[0] if rows else 0


def photograph(file, capture, rows):
    """Both limbs on the cross-section with their sigma, and the line across the object: value, variance by station."""
    pixels, first = pixels_of(file, rows)
    height = capture["size"][1]
    t = np.arange(first, first + len(pixels)) + 0.5 - height / 2
    used = np.abs(t) <= min(capture["focal"] * 0.026, 100)
    pixels, t = pixels[used], t[used]
    limbs = find_limbs(pixels.mean(axis=2), t, capture)
    basis = np.stack([np.ones(len(t)), t, t**2 + 1 / 12], axis=1)
    solver = np.linalg.pinv(basis).astype(np.float32)
    flat = pixels.reshape(len(t), -1)
    fit = solver @ flat
    residual = flat - basis.astype(np.float32) @ fit
    scatter = np.einsum("ij,ij->j", residual, residual) / (len(t) - 3)
    # Dust: rows that do not follow their station's curve, where it scatters far more than its neighbours.
    usual = np.tile(np.median(scatter.reshape(-1, 3), axis=0), len(scatter) // 3)
    doubtful = np.flatnonzero(scatter > 8 * usual)
    r = residual[:, doubtful] - np.median(residual[:, doubtful], axis=0)
    keep = np.abs(r) <= 5 * 1.4826 * np.median(np.abs(r), axis=0)
    dusty = ~keep.all(axis=0) & (keep.sum(axis=0) >= 5)
    if dusty.any():
        k, keep = doubtful[dusty], keep[:, dusty].astype(np.float64)
        normal = np.einsum("ti,tk,tj->kij", basis, keep, basis, optimize=True)
        right = np.einsum("ti,tk->ki", basis, keep * flat[:, k])
        fit[:, k] = np.linalg.solve(normal, right[..., None])[..., 0].T
        scatter[k] = (keep * (flat[:, k] - basis @ fit[:, k]) ** 2).sum(axis=0) / (keep.sum(axis=0) - 3).clip(1)
    value = fit[0].reshape(-1, 3).astype(np.float64)
    gain = float((solver[0].astype(np.float64) ** 2).sum())
    variance = gain * uniform_filter1d(scatter.reshape(-1, 3).astype(np.float64), 25, axis=0)
    # Float or half: no pixel is known better than its rounding at a thousandth of the brightest.
    variance += (np.abs(value).max() / 1000 * 2.0**-23) ** 2 / 12
    return limbs, value, variance


def find_limbs(grey, t, capture):
    """Steepest place of each row near the predicted limbs, to a fraction of a pixel, and a robust line through them."""
    radius, distance, focal = capture["radius"], capture["distance"], capture["focal"]
    half = focal * radius / np.sqrt(distance**2 - radius**2)
    centre, reach = capture["size"][0] / 2, 0.12 * half
    steep = np.abs(gaussian_filter1d(grey, 1.0, axis=1, order=1))
    found = []
    for side in (-1, 1):
        lo = int(max(centre + side * half - reach, 2))
        hi = int(min(centre + side * half + reach, grey.shape[1] - 3))
        k = steep[:, lo:hi].argmax(axis=1) + lo
        rows = np.arange(len(grey))
        a, b, c = steep[rows, k - 1], steep[rows, k], steep[rows, k + 1]
        u = k + 0.5 + 0.5 * (a - c) / np.maximum(a - 2 * b + c, -1e30).clip(None, -1e-30)
        basis, weight = np.stack([np.ones(len(t)), t], axis=1), np.ones(len(t))
        for _ in range(5):
            line, *_ = np.linalg.lstsq(basis * weight[:, None], u * weight, rcond=None)
            r = u - basis @ line
            scale = max(1.4826 * np.median(np.abs(r)), 1e-4)
            weight = np.sqrt(np.minimum(1, 1.5 * scale / np.maximum(np.abs(r), 1e-12)))
        found.append((line[0], scale / np.sqrt(len(t))))
    return found


def settle(limbs, orbit, capture):
    """One displacement in the plane, one constant shift and one apparent radius for all views: centre and half width."""
    centres = np.array([0.5 * (l[0] + r[0]) for l, r in limbs])
    widths = np.array([0.5 * (r[0] - l[0]) for l, r in limbs])
    basis = np.stack([np.ones_like(orbit), np.cos(orbit), np.sin(orbit)], axis=1)
    sound = np.ones(len(orbit), bool)  # a limb in the dark is taken for another edge
    for _ in range(5):
        fit, *_ = np.linalg.lstsq(basis[sound], centres[sound], rcond=None)
        off = np.abs(centres - basis @ fit)
        sound = off <= max(5 * np.median(off), 0.05)
    half = np.median(widths[sound])
    radius, distance, focal = capture["radius"], capture["distance"], capture["focal"]
    nominal = focal * radius / np.sqrt(distance**2 - radius**2)
    # What the limb's own brightness does to its apparent place is alike in all views and no change of size.
    scale = half / nominal if abs(half / nominal - 1) > 0.005 else 1.0
    smooth = basis @ fit
    smooth = smooth if np.abs(smooth - capture["size"][0] / 2).max() > 0.25 else np.full_like(smooth, capture["size"][0] / 2)
    return [(c, scale) for c in smooth]


def samples_of(photo, pose, orbit, capture):
    """Samples at the columns' angles to the normal: cubic interpolation along the line, noise as of the pixels in a column."""
    _, line, noise = photo
    centre, scale = pose
    radius, distance, focal = capture["radius"] * scale, capture["distance"], capture["focal"]
    beta = np.arcsin(radius / distance * np.sin(COLUMNS))
    normal = -COLUMNS + beta
    def column_px(local):
        n = -local + np.arcsin(radius / distance * np.sin(local))
        return focal * radius * np.sin(n) / (distance - radius * np.cos(n)) + centre - 0.5
    half = np.radians(0.5)
    u = column_px(COLUMNS)
    wide = np.maximum(np.abs(column_px(COLUMNS + half) - column_px(COLUMNS - half)), 1.0)
    value = np.stack([map_coordinates(line[:, c], [u], order=3, mode="nearest") for c in range(3)], axis=1)
    rise = np.gradient(line, axis=0)
    turn = np.gradient(u, COLUMNS)
    slope = np.stack([map_coordinates(rise[:, c], [u], order=1, mode="nearest") * turn for c in range(3)], axis=1)
    variance = np.stack([map_coordinates(noise[:, c], [u], order=1, mode="nearest") / wide for c in range(3)], axis=1)
    alpha = (orbit + normal + np.pi) % (2 * np.pi) - np.pi
    return alpha, value, variance, slope


class Brdf:
    def __init__(self, recipe):
        def values(key):
            found = re.search(rf"^{key} *= *\[?([^\]\n]*)", recipe, re.M)[1]
            return np.array([float(x) for x in found.split(",")])
        self.diffuse, self.specular, self.exponent = values("diffuse"), values("specular"), values("exponent")[0]

    def lobe(self, incident, local):
        return np.maximum(np.cos(incident + local), 0) ** self.exponent

    def of(self, c, lobe):
        return self.diffuse[c] / np.pi + self.specular[c] * (self.exponent + 2) / (2 * np.pi) * lobe

    def transfer(self):
        """H_p for p = 0 ... ORDER, [channel, column, p], by Gauss-Legendre quadrature up to the lobe's ends."""
        nodes, weights = np.polynomial.legendre.leggauss(256)
        incident, weights = nodes * np.pi / 2, weights * np.pi / 2
        phase = np.exp(1j * np.outer(incident, np.arange(ORDER + 1)))
        lobe = self.lobe(incident[None, :], COLUMNS[:, None])
        return np.stack([(self.of(c, lobe) * np.cos(incident) * weights) @ phase for c in range(3)])

    def responses(self, alpha, theta):
        """What a unit source at theta gives in every sample, [channel, view, column]."""
        incident = (theta - alpha + np.pi) % (2 * np.pi) - np.pi
        cosine = np.where(np.abs(incident) < np.pi / 2, np.cos(incident), 0.0)
        lobe = self.lobe(incident, COLUMNS[None, :])
        return np.stack([self.of(c, lobe) * cosine for c in range(3)])


class Channel:
    """Normal equations of one channel: series, then sources, then errors of the geometry."""

    def __init__(self, waves, transfer, value, variance, slope):
        design = waves * transfer[None]
        design = design.reshape(-1, ORDER + 1)
        self.design = np.concatenate([design[:, :1].real, 2 * design[:, 1:].real, -2 * design[:, 1:].imag], axis=1)
        self.b, weight = value.ravel(), 1 / variance.ravel()
        shift, size = (slope / np.cos(COLUMNS)).ravel() * 1e-5, (slope * np.tan(COLUMNS)).ravel() * 7e-5
        self.errors = np.stack([shift, size], axis=1)
        self.root = np.sqrt(weight)
        self.design *= self.root[:, None]
        self.errors *= self.root[:, None]
        self.wb = self.b * self.root
        self.square, self.weight = self.wb @ self.wb, weight.sum()
        both = np.concatenate([self.design, self.errors], axis=1)
        self.matrix, self.vector = both.T @ both, both.T @ self.wb
        h0 = self.design[:, 0]
        self.mean = (h0 @ self.wb) / (h0 @ h0)
        self.kappa = 1.0
        x, *_ = self.solve(self.matrix, self.vector, self.flat(), 0)
        self.measure_noise(self.misfit(self.matrix, self.vector, x), len(x))

    def flat(self, deviation=None):
        precision = np.full(2 * ORDER + 1, 1 / (deviation or self.mean) ** 2)
        precision[0] = 0
        return precision

    def shaped(self, deviation, corner, steepness):
        p = np.concatenate([[0], np.arange(1, ORDER + 1), np.arange(1, ORDER + 1)])
        precision = (1 + np.minimum((p / corner) ** (2 * steepness), 1e30)) / deviation**2
        precision[0] = 0
        return precision

    def misfit(self, matrix, vector, x):
        return self.square - 2 * x @ vector + x @ matrix @ x

    def measure_noise(self, misfit, unknowns):
        count = len(self.b)
        floor = (np.abs(self.b).max() * MODEL_ERROR) ** 2 * self.weight / count
        self.kappa = max(misfit / (count - unknowns), floor, 1.0)

    def with_sources(self, responses):
        if not len(responses):
            return self.matrix, self.vector
        f = np.stack([r.ravel() for r in responses], axis=1) * self.root[:, None]
        n, s = 2 * ORDER + 1, f.shape[1]
        size = n + s + 2
        matrix, vector = np.empty((size, size)), np.empty(size)
        old, new, end = np.r_[0:n, n + s:size], np.r_[n:n + s], self.matrix
        matrix[np.ix_(old, old)], vector[old] = end, self.vector
        cross = np.concatenate([self.design.T @ f, self.errors.T @ f])
        matrix[np.ix_(old, new)], matrix[np.ix_(new, old)] = cross, cross.T
        matrix[np.ix_(new, new)], vector[new] = f.T @ f, f.T @ self.wb
        return matrix, vector

    def solve(self, matrix, vector, precision, sources):
        """Mean, factor and log evidence."""
        q = matrix / self.kappa
        n = 2 * ORDER + 1
        diagonal = np.concatenate([precision, np.zeros(sources), np.ones(2)])
        q[np.diag_indices_from(q)] += diagonal + 1e-13 * q.diagonal().max()
        factor = cho_factor(q, lower=True, check_finite=False)
        right = vector / self.kappa
        x = cho_solve(factor, right, check_finite=False)
        log = 0.5 * (right @ x - 2 * np.log(factor[0].diagonal()).sum() + np.log(precision[1:n]).sum())
        return x, factor, log + sources * (0.5 * np.log(2 * np.pi) - np.log(2 * np.pi * self.mean))

    def choose(self, matrix, vector, sources):
        """The prior's strength and shape by marginal likelihood."""
        best = (-np.inf, None, None)
        def look(deviation, corner=None, steepness=1):
            nonlocal best
            precision = self.flat(deviation) if corner is None else self.shaped(deviation, corner, steepness)
            log = self.solve(matrix, vector, precision, sources)[2]
            if log > best[0]:
                best = (log, precision, (deviation, corner, steepness))
            return log
        last = -np.inf
        for step in range(7):
            log = look(self.mean * 10.0**-step)
            if log < last:
                break
            last = log
        deviation = min(best[2][0] * np.sqrt(10), self.mean)
        for steepness in (3, 10):
            for corner in (1.0, 1.8, 3.0, 6.0, 9.0, 13.0, 19.0, 28.0):
                look(deviation, corner, steepness)
        deviation, corner, steepness = best[2]
        for step in (-3, -2, -1, 1, 2, 3):
            look(deviation * 10 ** (step / 3), corner, steepness)
        return best[1]


def synthesis(angles):
    p = np.arange(1, ORDER + 1)
    phase = np.outer(angles, p)
    return np.concatenate([np.ones((len(angles), 1)), 2 * np.cos(phase), -2 * np.sin(phase)], axis=1)


def not_negative(x, factor, sources):
    """The nearest point, in the posterior's metric, with L >= 0 at many angles: least distance programming by nnls
    (Lawson and Hanson, chapter 23)."""
    n = 2 * ORDER + 1
    angles = np.linspace(-np.pi, np.pi, 4 * ORDER, endpoint=False)
    constraint = np.zeros((len(angles) + sources, len(x)))
    constraint[:len(angles), :n] = synthesis(angles)
    constraint[len(angles):, n:n + sources] = np.eye(sources)
    lower = np.tril(factor[0])
    g = solve_triangular(lower, constraint.T, lower=True, check_finite=False).T  # G R^-1 with Q = L L^T
    h = -constraint @ x
    if (h <= 0).all():
        return x
    e = np.concatenate([g.T, h[None]])
    u, _ = nnls(e, np.r_[np.zeros(len(x)), 1.0], maxiter=2000)
    r = e @ u - np.r_[np.zeros(len(x)), 1.0]
    y = -r[:-1] / r[-1]
    return x + solve_triangular(lower, y, lower=True, trans="T", check_finite=False)


def recover(alpha, value, variance, slope, capture, recipe):
    brdf = Brdf(recipe)
    waves = np.exp(1j * alpha[..., None] * np.arange(ORDER + 1))
    transfer = brdf.transfer()
    channels = [Channel(waves, transfer[c], value[..., c], variance[..., c], slope[..., c]) for c in range(3)]
    tables = []
    for channel in channels:
        x, factor, _ = channel.solve(channel.matrix, channel.vector, channel.flat(), 0)
        tables.append(synthesis(TABLE) @ not_negative(x, factor, 0)[:2 * ORDER + 1] / channel.mean)
    total = sum(tables)
    peaks = [k for k in range(720) if total[k] > total[k - 1] and total[k] >= total[(k + 1) % 720] and total[k] > 6]
    peaks = [TABLE[k] for k in sorted(peaks, key=lambda k: -total[k])]

    def fitted(directions, precisions=None):
        responses = [brdf.responses(alpha, theta) for theta in directions]
        fits = []
        for c, channel in enumerate(channels):
            matrix, vector = channel.with_sources([r[c] for r in responses])
            precision = channel.choose(matrix, vector, len(directions)) if precisions is None else precisions[c]
            x, factor, log = channel.solve(matrix, vector, precision, len(directions))
            fits.append({"x": x, "factor": factor, "log": log, "precision": precision, "matrix": matrix, "vector": vector,
                         "responses": [r[c] for r in responses]})
        return fits

    def steps(directions, fits):
        """Gauss-Newton steps of the directions with all else at its best, and their sigma."""
        found = []
        for s, theta in enumerate(directions):
            derivative = (brdf.responses(alpha, theta + 2e-4) - brdf.responses(alpha, theta - 2e-4)) / 4e-4
            gradient = curvature = 0.0
            for c, (channel, fit) in enumerate(zip(channels, fits)):
                d = derivative[c].ravel() * channel.root
                f = [r.ravel() * channel.root for r in fit["responses"]]
                cross = np.concatenate([d @ channel.design, [d @ r for r in f], d @ channel.errors])
                e = fit["x"][2 * ORDER + 1 + s]
                gradient += e * (d @ channel.wb - cross @ fit["x"]) / channel.kappa
                explained = cross @ cho_solve(fit["factor"], cross, check_finite=False)
                curvature += e**2 * (d @ d / channel.kappa - explained / channel.kappa**2)
            found.append((gradient / curvature, curvature**-0.5) if curvature > 11 else (0.0, np.pi))
        return found

    def refined(directions):
        directions, precisions = list(directions), [channel.flat(1e-2 * channel.mean) for channel in channels]
        for _ in range(4):
            for _ in range(8):
                fits = fitted(directions, precisions)
                found = steps(directions, fits)
                directions = [t + np.clip(step, -0.05, 0.05) for t, (step, _) in zip(directions, found)]
                if all(abs(step) < 0.1 * sigma for step, sigma in found):
                    break
            fits = fitted(directions)
            now = [fit["precision"] for fit in fits]
            if all(np.array_equal(a, b) for a, b in zip(now, precisions)):
                break
            precisions = now
        sigmas = [sigma for _, sigma in steps(directions, fits)]
        log = sum(fit["log"] for fit in fits) + sum(np.log(s) - 0.5 * np.log(2 * np.pi) for s in sigmas)
        return {"directions": directions, "direction_sigmas": sigmas, "fits": fits, "log": log}

    def lit(trial):
        n = 2 * ORDER + 1
        return all(max(fit["x"][n + s] for fit in trial["fits"]) > 0 for s in range(len(trial["directions"])))

    def extended(best):
        worse = 0
        known = list(best["directions"])
        for peak in peaks:
            if any(abs((peak - t + np.pi) % (2 * np.pi) - np.pi) < 0.07 for t in known):
                continue
            trial = refined(best["directions"] + [peak])
            if trial["log"] > best["log"] + BELIEF and lit(trial):
                best, worse = trial, 0
            else:
                worse += 1
                if worse == 2:
                    break
        return best

    fits = fitted([])
    best = extended({"directions": [], "direction_sigmas": [], "fits": fits, "log": sum(fit["log"] for fit in fits)})
    # What sources explain is no noise.
    for _ in range(2):
        if not best["directions"]:
            break
        before = [channel.kappa for channel in channels]
        for channel, fit in zip(channels, best["fits"]):
            channel.measure_noise(channel.misfit(fit["matrix"], fit["vector"], fit["x"]), len(fit["x"]))
        if all(channel.kappa > 0.9 * k for channel, k in zip(channels, before)):
            break
        best = extended(refined(best["directions"]))
    n, sources = 2 * ORDER + 1, len(best["directions"])
    table = synthesis(TABLE)
    for channel, fit in zip(channels, best["fits"]):
        fit["x"] = not_negative(fit["x"], fit["factor"], sources)
        covariance = cho_solve(fit["factor"], np.eye(len(fit["x"])), check_finite=False)
        weak = channel.solve(fit["matrix"], fit["vector"], channel.flat(), sources)[1]
        fit["weak_sigma"] = np.sqrt(cho_solve(weak, np.eye(len(fit["x"])), check_finite=False).diagonal()[:n])
        fit["sigma"] = np.sqrt(covariance.diagonal())
        fit["table"] = (table @ fit["x"][:n]).clip(0)
        fit["table_sigma"] = np.sqrt(np.einsum("ij,jk,ik->i", table, covariance[:n, :n], table, optimize=True))
        for s, theta in enumerate(best["directions"]):
            at = (theta + np.pi) % (2 * np.pi) / np.radians(0.5)
            k, part = int(at), at % 1
            fit["table"][k % 720] += (1 - part) * fit["x"][n + s] / np.radians(0.5)
            fit["table"][(k + 1) % 720] += part * fit["x"][n + s] / np.radians(0.5)
        series = (channel.design / channel.root[:, None]) @ fit["x"][:n]
        own = sum(e * r.ravel() for e, r in zip(fit["x"][n:n + sources], fit["responses"]))
        fit["residual"] = (channel.b - series - own).reshape(alpha.shape)
    return {"directions": best["directions"], "direction_sigmas": best["direction_sigmas"], "channels": best["fits"]}


def write(out, alpha, value, variance, result, hashes):
    """The products: light field and residual on the grid, the light as tables and as an environment map, provenance."""
    out.mkdir(parents=True, exist_ok=True)
    normals, locals_ = GRID
    row = ((alpha + np.pi) / (2 * np.pi) * normals).astype(int) % normals
    column = np.broadcast_to(np.round((COLUMNS + np.pi / 2) / np.pi * locals_ - 0.5).astype(int), row.shape)
    cell = (row * locals_ + column).ravel()

    def gridded(values, variances):
        weight = np.bincount(cell, 1 / variances.ravel(), normals * locals_)
        total = np.bincount(cell, values.ravel() / variances.ravel(), normals * locals_)
        count = np.bincount(cell, minlength=normals * locals_)
        seen = np.maximum(weight, 1e-300)
        return total / seen, np.where(count > 0, seen**-0.5, 0), count
    residual = np.stack([channel["residual"] for channel in result["channels"]], axis=-1)
    for name, values in (("light_field.exr", value), ("residual.exr", residual)):
        layers = [layer for c in range(3) for layer in gridded(values[..., c], variance[..., c])]
        exr(out / name, np.stack(layers, axis=-1).reshape(normals, locals_, 9).astype(np.float32),
            [f"{layer}.{c}" for c in "RGB" for layer in ("mean", "sigma", "weight")])
    tables = np.stack([channel["table"] for channel in result["channels"]], axis=1)
    sigmas = np.stack([channel["table_sigma"] for channel in result["channels"]], axis=1)
    np.savetxt(out / "lighting.csv", np.concatenate([np.degrees(TABLE)[:, None], tables, sigmas], axis=1), delimiter=",",
               fmt="%.17g", header="theta_deg,L_R,L_G,L_B,sigma_R,sigma_G,sigma_B", comments="")
    lines = ["channel,p,re,im,sigma,status"]
    for name, channel in zip("RGB", result["channels"]):
        x, sigma, weak = channel["x"], channel["sigma"], channel["weak_sigma"]
        for p in range(ORDER + 1):
            bound = weak[p] / x[0]
            status = "determined" if bound <= 0.05 else "weak" if bound <= 0.5 else "indeterminate"
            lines.append(f"{name},{p},{x[p]!r},{x[ORDER + p] if p else 0.0!r},{sigma[p]!r},{status}")
    (out / "lighting_spectrum.csv").write_text("\n".join(lines) + "\n")
    image = np.zeros((721, 1440, 3), np.float32)
    image[360] = np.repeat(tables, 2, axis=0) / np.sin(np.pi / 720)
    exr(out / "lighting.exr", image, list("RGB"))
    (out / "provenance.json").write_text(json.dumps({"inputs": hashes}))


def exr(file, pixels, names):
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    spec.channelnames = names
    spec["compression"] = "rle"
    output = oiio.ImageOutput.create(str(file))
    output.open(str(file), spec)
    output.write_image(pixels)
    output.close()


def bare_line(file, capture, rows):
    """Mean over the middle rows, which a parabola in the height takes to the cross-section."""
    pixels, first = pixels_of(file, rows)
    t = np.arange(first, first + len(pixels)) + 0.5 - capture["size"][1] / 2
    used = np.abs(t) <= capture["focal"] * 0.026
    basis = np.stack([np.ones(used.sum()), t[used], t[used] ** 2], axis=1)
    return np.tensordot(np.linalg.pinv(basis)[0].astype(np.float32), pixels[used], axes=1)  # [x, channel]


def bare_columns(line, capture):
    radius, distance, focal = capture["radius"], capture["distance"], capture["focal"]
    normal = -COLUMNS + np.arcsin(radius / distance * np.sin(COLUMNS))
    u = focal * radius * np.sin(normal) / (distance - radius * np.cos(normal)) + capture["size"][0] / 2 - 0.5
    return np.stack([map_coordinates(line[:, c], [u], order=3, mode="nearest") for c in range(line.shape[1])], axis=1)


def bare_light(samples, orbit, capture, recipe):
    """Least squares for the light's Fourier coefficients with a ridge that generalised cross-validation chooses."""
    radius, distance = capture["radius"], capture["distance"]
    alpha = orbit[:, None] + (-COLUMNS + np.arcsin(radius / distance * np.sin(COLUMNS)))[None, :]
    waves = np.exp(1j * alpha[..., None] * np.arange(ORDER + 1))  # [view, column, p]
    transfer = Brdf(recipe).transfer()
    light = []
    for c in range(samples.shape[2]):
        design = (waves * transfer[c][None]).reshape(-1, ORDER + 1)
        real = np.concatenate([design[:, :1].real, 2 * design[:, 1:].real, -2 * design[:, 1:].imag], axis=1)
        b = samples[..., c].ravel()
        matrix, vector = real.T @ real, real.T @ b
        scale = np.trace(matrix) / len(matrix)
        best, eigenvalues = None, np.linalg.eigvalsh(matrix)
        for ridge in scale * 10.0 ** np.arange(-12, -2):
            x = cho_solve(cho_factor(matrix + ridge * np.eye(len(matrix))), vector)
            freedom = len(b) - np.sum(eigenvalues / (eigenvalues + ridge))
            misfit = b @ b - 2 * x @ vector + x @ matrix @ x
            if best is None or misfit / freedom**2 < best[0]:
                best = misfit / freedom**2, x
        x = best[1]
        light.append(np.concatenate([x[:1].astype(complex), x[1:ORDER + 1] + 1j * x[ORDER + 1:]]))
    for l in light:  # the table that a user wants
        (l[0] + 2 * np.real(np.exp(1j * np.outer(TABLE, np.arange(1, ORDER + 1))) @ l[1:])).real.clip(0)
    return light


if __name__ == "__main__":
    main()
