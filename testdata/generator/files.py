"""Everything a set consists of, written to a folder."""
import numpy as np
import OpenImageIO as oiio

from .quadrature import reflected

SPECTRUM_ORDER = 60
FIELD_NORMALS, FIELD_LOCALS = 360, 90
# Centres of 1-degree cells: at +-90 degrees the cosine is zero, and rho = eval / cosine is not defined.
BRDF_NODES_DEG = np.arange(-89.5, 90.0, 1.0)
# The sensor of sets with noise: the brightest pixel of the set is at 0.9 of the full well.
FULL_WELL_E, READ_NOISE_E, FILL_FRACTION = 15000.0, 8.0, 0.9
SENSOR_WIDTH_MM = 23.5


def toml(value):
    if isinstance(value, str):
        return '"' + value + '"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml(v) for v in value) + "]"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    return repr(float(value))


def table(name, entries):
    lines = [f"[{name}]"] + [f"{key} = {toml(value)}" for key, value in entries.items()]
    return "\n".join(lines) + "\n"


def view_name(index):
    return f"views/{index:03d}.exr"


def write_exr(path, pixels, channels, kind, attributes=()):
    """One-part ZIP EXR, `kind` half or float; the date is fixed so that equal pixels are equal bytes."""
    height, width, _ = pixels.shape
    spec = oiio.ImageSpec(width, height, len(channels), kind)
    spec.channelnames = channels
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", "2001:01:01 00:00:00")
    for name, value in attributes:
        spec.attribute(name, value)
    output = oiio.ImageOutput.create(str(path))
    if not output.open(str(path), spec) or not output.write_image(np.ascontiguousarray(pixels, np.float32)):
        raise OSError(f"cannot write {path}: {output.geterror()}")
    output.close()


def write_capture(folder, case, noise_scale=None):
    camera = case.camera
    text = f'format = 1\nname = "{case.title}"\n\n'
    text += table("object", {"shape": case.shape, "radius": case.radius}) + "\n"
    entries = {"projection": camera.projection, "image_size": [camera.width, camera.height]}
    if camera.projection == "orthographic":
        entries["width_m"] = camera.width_m
    elif camera.stated_as == "fov_x_deg":
        entries["fov_x_deg"] = np.degrees(2 * np.arctan(camera.width / 2 / camera.focal_px))
    elif camera.stated_as == "sensor_width_mm":
        entries["focal_mm"] = camera.focal_px * SENSOR_WIDTH_MM / camera.width
        entries["sensor_width_mm"] = SENSOR_WIDTH_MM
    else:
        entries["focal_px"] = camera.focal_px
    if camera.shift_px:
        entries["principal_point_px"] = list(camera.principal_point_px)
    entries["distance"] = camera.distance
    text += table("camera", entries) + "\n"
    if noise_scale:
        sensor = {"encoding": "linear", "black_level": 0.0, "white_level": FULL_WELL_E / noise_scale}
        text += table("sensor", {**sensor, "full_well_e": FULL_WELL_E, "read_noise_e": READ_NOISE_E}) + "\n"
    if case.orbit_jitter_deg:
        for index, orbit in enumerate(case.orbit_degrees()):
            text += f'[[view]]\norbit_deg = {toml(orbit)}\nphotos = [{{ file = "{view_name(index)}" }}]\n\n'
    else:
        orbit = {"orbit_start_deg": case.orbit_start_deg, "orbit_step_deg": case.orbit_step_deg}
        text += table("views", {"files": "views/*.exr", **orbit})
    (folder / "capture.toml").write_text(text.rstrip() + "\n")


def write_truth(folder, case):
    folder.mkdir(parents=True)
    write_scene(folder / "scene.toml", case)
    write_lighting(folder / "lighting.csv", case.light)
    write_spectrum(folder / "lighting_spectrum.csv", case.light)
    write_light_field(folder / "light_field.exr", case)
    if case.tabulated:
        write_brdf_table(folder / "brdf.csv", case.material)


def write_scene(path, case):
    light = case.light
    text = "# What was rendered. The light is the sum of the entries of [lighting].\n\n"
    text += table("brdf", case.material) + "\n[lighting]\n"
    if light.sources:
        rows = [f"    {{ theta_deg = {toml(s.theta_deg)}, irradiance = {toml(s.irradiance)} }},\n" for s in light.sources]
        text += "sources = [\n" + "".join(rows) + "]\n"
    if any(light.uniform):
        text += f"uniform = {toml(light.uniform)}\n"
    if light.has_smooth():
        text += 'table = "lighting.csv"\n'
    path.write_text(text)


def write_lighting(path, light):
    theta = -180 + 0.5 * np.arange(720)
    rows = np.column_stack([theta, light.continuous(np.radians(theta))])
    write_csv(path, "theta_deg,L_R,L_G,L_B", rows)


def write_spectrum(path, light):
    spectrum = light.spectrum(SPECTRUM_ORDER)
    lines = ["channel,p,re,im"]
    for c, channel in enumerate("RGB"):
        lines += [f"{channel},{p},{float(v.real)!r},{float(v.imag)!r}" for p, v in enumerate(spectrum[:, c])]
    path.write_text("\n".join(lines) + "\n")


def write_light_field(path, case):
    alpha = np.radians(-180 + (np.arange(FIELD_NORMALS) + 0.5) * 360 / FIELD_NORMALS)
    theta_o = np.radians(-90 + (np.arange(FIELD_LOCALS) + 0.5) * 180 / FIELD_LOCALS)
    field = reflected(case.material, case.light, np.repeat(alpha[:, None], FIELD_LOCALS, axis=1), theta_o)
    axes = [("columns", "theta_o_deg = -90 + (j + 0.5) * 180 / 90"), ("rows", "alpha_deg = -180 + (i + 0.5) * 360 / 360")]
    write_exr(path, field, ("mean.R", "mean.G", "mean.B"), "float", axes)


def write_brdf_table(path, material):
    # Imported here so that the truth's tables can be made, and read, without a renderer.
    from .render import tabulate_brdf

    theta_i, theta_o = np.meshgrid(BRDF_NODES_DEG, BRDF_NODES_DEG, indexing="ij")
    values = tabulate_brdf(material, np.radians(theta_i), np.radians(theta_o)).reshape(-1, 3)
    lines = ["theta_i_deg,theta_o_deg,rho_R,rho_G,rho_B"]
    # Mitsuba computes in single precision: nine digits are all there is.
    lines += [f"{i!r},{o!r},{r:.9g},{g:.9g},{b:.9g}" for i, o, (r, g, b) in zip(theta_i.ravel().tolist(), theta_o.ravel().tolist(), values)]
    path.write_text("\n".join(lines) + "\n")


def write_csv(path, header, rows):
    lines = [header] + [",".join(repr(float(v)) for v in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")


def write_recipe(folder, case):
    text = '# Recovers the light of this set from its known BRDF.\nformat = 1\nrecover = "lighting"\n\n'
    text += table("brdf", {"table": "truth/brdf.csv"} if case.tabulated else case.material)
    text += f'\n[report]\ntitle = "{case.title[0].upper() + case.title[1:]}: the light"\n'
    (folder / "recipe.toml").write_text(text)


def add_noise(pixels, electrons_per_radiance, random):
    """Shot noise and read noise of a linear sensor, in units of radiance."""
    electrons = random.poisson(np.maximum(pixels, 0) * electrons_per_radiance)
    return (electrons + random.normal(0, READ_NOISE_E, pixels.shape)) / electrons_per_radiance


def write_readme(folder, case, figures, command, pixel_kind, noisy):
    camera, light = case.camera, case.light
    size = sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())
    parts = [f"{s.irradiance} W/m² at {s.theta_deg}°" for s in light.sources]
    if any(light.uniform):
        parts.append(f"uniform {light.uniform} W/m²/rad")
    if light.has_smooth():
        parts.append(f"smooth, nonnegative, band-limited at order {len(light.coefficients) - 1}, different per channel")
    lens = f"perspective, f = {camera.focal_px} px (stated as {camera.stated_as.replace('sensor_width_mm', 'focal_mm and sensor_width_mm')}), distance {camera.distance} m"
    if camera.projection == "orthographic":
        lens = f"orthographic, {camera.width_m} m wide"
    if camera.shift_px:
        lens += f", principal point {camera.shift_px} px right of the centre"
    orbit = f"from {case.orbit_start_deg}° in steps of {case.orbit_step_deg:g}°"
    if case.orbit_jitter_deg:
        orbit += f", uneven by up to {case.orbit_jitter_deg}°, listed one by one"
    material = ", ".join(f"{key} = {toml(value)}" for key, value in case.material.items())
    table_note = "`truth/brdf.csv` is Mitsuba's BRDF at the centres of 1° cells, ±89.5°.\n" if case.tabulated else ""
    noise_note = (
        f"\nWith noise: full well {FULL_WELL_E:g} e, read noise {READ_NOISE_E:g} e, brightest pixel at {FILL_FRACTION} of the full well. "
        "The check is of the set before noise.\n"
        if noisy
        else ""
    )
    (folder / "README.md").write_text(
        f"""# {case.name}

{case.title[0].upper() + case.title[1:]}: {case.views} photographs of {camera.width} x {camera.height} pixels,
linear radiance, OpenEXR ({pixel_kind}, ZIP), cropped to a strip about the cross-section. No {"distortion" if noisy else "noise, no distortion"}.

| | |
|---|---|
| object | {case.shape}, radius {case.radius} m |
| material | {material} |
| light, in the measurement plane | {"; ".join(parts)} |
| camera | {lens} |
| orbit | {orbit} |
| check against eq. 4 | rms / maximum {figures[75.0]:.1e} for abs(θo′) < 75°, {figures[85.0]:.1e} for < 85° (limit 1e-3 at 75°) |
| bytes without this file | {size} |
{noise_note}
`truth/scene.toml` is what was rendered. `truth/lighting.csv` is all the light but the sources (the
uniform part included); where `scene.toml` names it as a table it is the whole continuous part.
`truth/lighting_spectrum.csv` is the spectrum of the whole light, sources included.
`truth/light_field.exr` is B(α, θo′) at cell centres, by quadrature.
{table_note}
Own render, dedicated to the public domain (CC0 1.0). To make it again:

    {command}
"""
    )
