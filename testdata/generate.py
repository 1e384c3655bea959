#!/usr/bin/env python3
"""Renders the test photographs and writes their truth. See README.md beside this file."""
import argparse
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import drjit as dr
import numpy as np

from generator import check, files
from generator.cases import CASES, TWO_SUNS
from generator.light import Light
from generator.render import Renderer, stock_view

HERE = Path(__file__).resolve().parent


def main():
    options = parse_arguments()
    dr.set_thread_count(options.threads)
    if options.list:
        for case in CASES:
            print(f"{case.name:22} {case.views} views of {case.size[0]}x{case.size[1]}: {case.title}")
        return 0
    if options.self_test:
        return self_test()
    chosen = [case for case in CASES if not options.case or case.name in options.case]
    unknown = set(options.case or []) - {case.name for case in CASES}
    if unknown:
        sys.exit(f"no case named {', '.join(sorted(unknown))}; --list shows them")
    failed = [case.name for case in chosen if not make(case.resized(options.size, options.views), options)]
    if options.out == HERE:
        write_table(HERE / "README.md")
    return 1 if failed else 0


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", action="append", metavar="NAME", help="only this case (may be repeated); default all")
    parser.add_argument("--out", type=Path, default=HERE, help="folder in which the sets' folders are made; default: this one")
    parser.add_argument("--size", type=parse_size, metavar="WxH", help="image size instead of the case's own")
    parser.add_argument("--views", type=int, metavar="N", help="number of views over the full circle")
    parser.add_argument("--float", action="store_true", help="32-bit EXR instead of half")
    noise = parser.add_mutually_exclusive_group()
    noise.add_argument("--clean", dest="noise", action="store_false", help="no noise (default)")
    noise.add_argument("--noise", action="store_true", help="add seeded shot and read noise, and say so in [sensor]")
    parser.set_defaults(noise=False)
    parser.add_argument("--seed", type=int, default=1, help="of the noise")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--list", action="store_true", help="list the cases")
    parser.add_argument("--self-test", action="store_true", help="compare small views with Mitsuba's own path integrator")
    options = parser.parse_args()
    options.out = options.out.resolve()
    if options.out == HERE and (options.size or options.views or options.float or options.noise):
        parser.error("--size, --views, --float and --noise make other sets than the committed ones: give --out a folder for them")
    return options


def parse_size(text):
    width, height = (int(n) for n in text.lower().split("x"))
    return width, height


def make(case, options):
    """Renders one set beside its place and moves it in only when its check is passed."""
    options.out.mkdir(parents=True, exist_ok=True)
    pixel_kind = "float" if options.float else "half"
    with tempfile.TemporaryDirectory(dir=options.out, prefix=f".{case.name}-") as scratch:
        folder = Path(scratch) / case.name
        (folder / "views").mkdir(parents=True)
        renderer = Renderer(case)
        views = [renderer.view(orbit) for orbit in case.orbit_degrees()]
        files.write_capture(folder, case)
        files.write_truth(folder / "truth", case)
        files.write_recipe(folder, case)
        write_views(folder, views, pixel_kind)
        figures = check.check(folder)
        passed = figures[check.LIMIT_DEG] <= check.LIMIT
        verdict = "ok" if passed else f"FAILED, more than {check.LIMIT}: not kept"
        print(f"{case.name:22} rms/max {figures[75.0]:.2e} below 75 deg, {figures[85.0]:.2e} below 85 deg: {verdict}", flush=True)
        if not passed:
            return False
        if options.noise:
            electrons = files.FULL_WELL_E * files.FILL_FRACTION / max(view.max() for view in views)
            random = np.random.default_rng(options.seed)
            write_views(folder, [files.add_noise(view, electrons, random) for view in views], pixel_kind)
            files.write_capture(folder, case, electrons)
        files.write_readme(folder, case, figures, command(case, options), pixel_kind, options.noise)
        place = options.out / case.name
        if place.exists() and not (place / "capture.toml").exists():
            sys.exit(f"{place} is not a set of photographs: not replaced")
        if place.exists():
            shutil.rmtree(place)
        folder.rename(place)
    return True


def write_views(folder, views, pixel_kind):
    for index, view in enumerate(views):
        files.write_exr(folder / files.view_name(index), view, ("R", "G", "B"), pixel_kind)


def command(case, options):
    """The command that makes this set again."""
    words = ["python testdata/generate.py --case", case.name]
    if options.size:
        words.append(f"--size {options.size[0]}x{options.size[1]}")
    if options.views:
        words.append(f"--views {options.views}")
    if options.float:
        words.append("--float")
    if options.noise:
        words.append(f"--noise --seed {options.seed}")
    if options.out != HERE:
        words.append("--out DIR")
    return " ".join(words)


def write_table(readme):
    """Brings the table of cases in README.md up to date with what is on disk."""
    rows = ["| case | shows | views | size | bytes | rms/max, 75° | 85° |", "|---|---|---|---|---|---|---|"]
    total = 0
    for case in CASES:
        folder = HERE / case.name
        if not folder.exists():
            continue
        size = sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())
        total += size
        figures = check.check(folder)
        shape = f"{case.size[0]}x{case.size[1]}"
        rows.append(f"| {case.name} | {case.title} | {case.views} | {shape} | {size} | {figures[75.0]:.1e} | {figures[85.0]:.1e} |")
    rows.append(f"| total | | | | {total} | | |")
    before, rest = readme.read_text().split("<!-- cases -->\n")
    after = rest.split("<!-- end -->")[1]
    readme.write_text(before + "<!-- cases -->\n" + "\n".join(rows) + "\n<!-- end -->" + after)


def self_test():
    """Direct evaluation against the stock integrator, where pixels lie wholly on the object."""
    worst = 0.0
    for name in ("phong32-two-suns", "phong32-orthographic", "ggx-sphere", "lambertian-smooth"):
        case = next(case for case in CASES if case.name == name).resized(size=(96, 8))
        light = case.light
        if light.has_smooth() or any(light.uniform):
            # Two suns instead: the integrator renders one source at a time.
            case = replace(case, light=Light(TWO_SUNS.sources))
        ours = Renderer(case).view(20.0)
        stock = stock_view(case, 20.0, samples=1024)
        inside = np.abs(case.sine_of_exitance(np.arange(case.camera.width) + 0.5)) < np.sin(np.radians(80))
        difference = np.sqrt(np.mean((ours - stock)[:, inside] ** 2)) / ours.max()
        worst = max(worst, difference)
        print(f"{name:22} direct against path integrator: rms/max {difference:.1e}")
    return 0 if worst <= 1e-3 else 1


if __name__ == "__main__":
    sys.exit(main())
