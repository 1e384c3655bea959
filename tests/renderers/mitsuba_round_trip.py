"""Renders RUN_FOLDER/export/scene.xml, as `flatlight export --to mitsuba` wrote it, and compares it with the photographs.

    python round_trip.py RUN_FOLDER CAPTURE_FOLDER LIMB_DEG

The photographs are linear EXR files, one per view. Compared are the pixels of the object's cross-section row by row, up to LIMB_DEG from
the normal. Prints, as JSON, the root mean square of the difference over that of the photographs: of all views together, and of each view
by itself, where a dark view shows its own noise.
"""
import json
import pathlib
import sys
import tomllib

import numpy as np

import mitsuba as mi

SPP = 4096
VIEWS = 8


def main(run_folder, capture_folder, limb_deg):
    mi.set_variant("llvm_ad_rgb")
    run, folder = pathlib.Path(run_folder), pathlib.Path(capture_folder)
    scene_file = run / "export/scene.xml"
    if (scene_file.parent / "flatlight_merl.py").exists():
        sys.path.insert(0, str(scene_file.parent))
        import flatlight_merl  # noqa: F401
    # As the run resolved it: every view, every default.
    capture = tomllib.loads((run / "capture.toml").read_text())
    views = [(view["orbit_deg"], folder / view["photos"][0]["file"]) for view in capture["view"]]
    camera = capture["camera"]
    width, height = camera["image_size"]
    seen = cross_section(capture, width, float(limb_deg))
    shares, squares, power = [], 0.0, 0.0
    for view in range(0, len(views), max(1, len(views) // VIEWS)):
        orbit, photo_file = views[view]
        photo = np.array(mi.Bitmap(str(photo_file)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))
        scene = mi.load_file(str(scene_file), orbit=str(orbit), spp=str(SPP))
        # Rows of a cylinder's strip are alike: their mean has the noise of all their samples.
        picture = np.array(mi.render(scene, seed=view))
        rows = slice(height // 2 - 2, height // 2 + 2) if capture["object"]["shape"] == "sphere" else slice(0, height)
        a, b = picture[rows].mean(0)[seen], photo[rows].mean(0)[seen]
        difference, photographed = ((a - b) ** 2).sum(0), (b**2).sum(0)
        squares, power = squares + difference, power + photographed
        shares.append(np.sqrt(difference / photographed).tolist())
    print(json.dumps({"views": len(shares), "relative_rms": np.sqrt(squares / power).tolist(), "of_each_view": shares}))


def cross_section(capture, width, limb_deg):
    """Columns whose ray meets the circle less than limb_deg from its normal's direction to the camera."""
    camera, radius = capture["camera"], capture["object"]["radius"]
    column = np.arange(width) + 0.5 - camera.get("principal_point_px", [width / 2, 0])[0]
    if camera["projection"] == "orthographic":
        sine = column * camera["width_m"] / width / radius
    else:
        tangent = column / camera["focal_px"]
        sine = camera["distance"] / radius * tangent / np.sqrt(1 + tangent**2)
    return np.abs(sine) < np.sin(np.radians(limb_deg))


if __name__ == "__main__":
    main(*sys.argv[1:])
