"""The photographs: Mitsuba traces the rays and evaluates the BSDF, we sum over the lights.

A renderer picks emitters at random and so is noisy; here every ray meets every directional
light. Rays keep their true elevation out of the plane: this is the 3-D picture, not eq. 4.
Directions are 3-D with the measurement plane at z = 0.
"""
import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")

# Samples per pixel, (across, down), on a regular grid in the pixel: a box-shaped pixel.
FOOTPRINT = (8, 2)
# The normal turns fast inside a pixel near the limb, and the outline itself is a step.
LIMB_FOOTPRINT = (48, 2)
LIMB_DEG = 70.0
# Directional emitters that stand for the continuous part of the light.
EMITTERS = 720


class Phong(mi.BSDF):
    """diffuse/pi + specular (n+2)/(2 pi) max(0, cos angle(reflect(wo), wi))^n, times the cosine of wi.

    Mitsuba's names are the other way round: its si.wi points to the viewer, its wo to the light.
    """

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.diffuse = mi.Color3f(props["diffuse"])
        self.specular = mi.Color3f(props["specular"])
        self.exponent = props["exponent"]
        self.m_components = [mi.BSDFFlags.Glossy | mi.BSDFFlags.FrontSide]
        self.m_flags = self.m_components[0]

    def eval(self, ctx, si, wo, active=True):
        cos_light, cos_view = mi.Frame3f.cos_theta(wo), mi.Frame3f.cos_theta(si.wi)
        mirrored = mi.Vector3f(-wo.x, -wo.y, wo.z)
        n = self.exponent
        lobe = (n + 2) / (2 * dr.pi) * dr.maximum(dr.dot(mirrored, si.wi), 0.0) ** n
        value = (self.diffuse / dr.pi + self.specular * lobe) * cos_light
        return value & (active & (cos_light > 0) & (cos_view > 0))

    # The rest is only for the stock integrator of the self-test, whose lights are all
    # directional: a sampled direction never meets one, so any valid density will do.
    def pdf(self, ctx, si, wo, active=True):
        return mi.warp.square_to_cosine_hemisphere_pdf(wo)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def sample(self, ctx, si, sample1, sample2, active=True):
        sample = mi.BSDFSample3f()
        sample.wo = mi.warp.square_to_cosine_hemisphere(sample2)
        sample.pdf = self.pdf(ctx, si, sample.wo, active)
        sample.eta = 1.0
        sample.sampled_type = mi.UInt32(+mi.BSDFFlags.Glossy)
        sample.sampled_component = 0
        return sample, self.eval(ctx, si, sample.wo, active) / sample.pdf

    def to_string(self):
        return "Phong[]"


mi.register_bsdf("phong-modified", Phong)


def bsdf_description(material):
    """Mitsuba's dictionary for a material given in the keys of a recipe."""

    def rgb(values):
        return {"type": "rgb", "value": list(values)}

    if material["model"] == "lambertian":
        return {"type": "diffuse", "reflectance": rgb(material["albedo"])}
    if material["model"] == "ggx-conductor":
        return {
            "type": "roughconductor",
            "distribution": "ggx",
            "alpha": material["alpha"],
            "eta": rgb(material["eta"]),
            "k": rgb(material["k"]),
            "specular_reflectance": rgb(material["specular"]),
        }
    return {
        "type": "phong-modified",
        "diffuse": mi.ScalarColor3f(material["diffuse"]),
        "specular": mi.ScalarColor3f(material["specular"]),
        "exponent": float(material["exponent"]),
    }


def shape_description(case):
    if case.shape == "sphere":
        return {"type": "sphere", "radius": case.radius}
    ends = {"p0": [0, 0, -20 * case.radius], "p1": [0, 0, 20 * case.radius]}
    return {"type": "cylinder", "radius": case.radius, **ends}


def sensor_description(camera, orbit_deg, samples=1):
    """A sensor at the orbit angle, looking at the origin with +z up: image right is larger theta."""
    phi = np.radians(orbit_deg)
    position = [camera.distance * np.cos(phi), camera.distance * np.sin(phi), 0.0]
    pose = mi.ScalarTransform4f().look_at(origin=position, target=[0, 0, 0], up=[0, 0, 1])
    film = {"width": camera.width, "height": camera.height, "pixel_format": "rgb", "component_format": "float32"}
    common = {
        "film": {"type": "hdrfilm", "filter": {"type": "box"}, **film},
        "sampler": {"type": "multijitter", "sample_count": samples},
    }
    if camera.projection == "orthographic":
        # The sensor's own width is 2, whatever the film's shape.
        pose = pose @ mi.ScalarTransform4f().scale([camera.width_m / 2, camera.width_m / 2, 1.0])
        return {"type": "orthographic", "to_world": pose, "near_clip": 1e-3, **common}
    cx, cy = camera.principal_point_px
    return {
        "type": "perspective",
        "to_world": pose,
        "fov_axis": "x",
        "fov": float(np.degrees(2 * np.arctan(camera.width / 2 / camera.focal_px))),
        # Mitsuba's offsets move the image the other way.
        "principal_point_offset_x": 0.5 - cx / camera.width,
        "principal_point_offset_y": 0.5 - cy / camera.height,
        **common,
    }


class Renderer:
    """Renders the views of one case."""

    def __init__(self, case):
        self.case = case
        self.scene = mi.load_dict({"type": "scene", "shape": {**shape_description(case), "bsdf": bsdf_description(case.material)}})
        self.bsdf = self.scene.shapes()[0].bsdf()
        self.continuous = Emitters(*case.light.emitters(EMITTERS))
        self.sources = Emitters(*case.light.source_emitters())

    def view(self, orbit_deg):
        """One photograph: float64 (height, width, 3), radiance."""
        camera = self.case.camera
        sensor = mi.load_dict(sensor_description(camera, orbit_deg))
        picture = np.zeros((camera.height, camera.width, 3))
        limb = limb_columns(self.case)
        for columns, footprint in ((np.flatnonzero(~limb), FOOTPRINT), (np.flatnonzero(limb), LIMB_FOOTPRINT)):
            picture[:, columns] = self.pixels(sensor, columns, footprint)
        return picture

    def pixels(self, sensor, columns, footprint):
        """Averages of the pixels of some columns over all rows: (height, len(columns), 3)."""
        camera = self.case.camera
        across, down = footprint
        u = columns[:, None] + (np.arange(across) + 0.5) / across
        v = np.arange(camera.height * down) / down + 0.5 / down
        grid_v, grid_u = np.meshgrid(v / camera.height, u.ravel() / camera.width, indexing="ij")
        position = mi.Point2f(mi.Float(grid_u.ravel()), mi.Float(grid_v.ravel()))
        ray, _ = sensor.sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
        samples = self.radiance(ray).reshape(camera.height, down, len(columns), across, 3)
        return samples.mean(axis=(1, 3))

    def radiance(self, ray):
        """Reflected radiance along each ray, summed over all lights in double precision: (N, 3)."""
        si = self.scene.ray_intersect(ray)
        total = [dr.zeros(mi.Float64, dr.width(si.t)) for _ in range(3)]
        if self.continuous.count:
            # Only the half circle above the surface, and one step more on each side for rounding.
            step = 2 * np.pi / EMITTERS
            normal = dr.atan2(si.sh_frame.n.y, si.sh_frame.n.x)
            first = mi.Int32(dr.floor((normal + dr.pi / 2) / step)) - 1 + EMITTERS
            total = self.add(si, total, self.continuous, mi.UInt32(first), EMITTERS // 2 + 3)
        if self.sources.count:
            total = self.add(si, total, self.sources, dr.zeros(mi.UInt32, dr.width(si.t)), self.sources.count)
        return np.stack([np.array(channel) for channel in total], axis=-1)

    def add(self, si, total, emitters, first, count):
        """Adds what `count` emitters from index `first` on (cyclic) send along each ray."""
        context, valid = mi.BSDFContext(), si.is_valid()

        def body(step, r, g, b):
            k = (first + step) % emitters.count
            value = self.bsdf.eval(context, si, si.to_local(emitters.toward(k)), valid) * emitters.irradiance(k)
            return step + 1, r + mi.Float64(value.x), g + mi.Float64(value.y), b + mi.Float64(value.z)

        start = (dr.zeros(mi.UInt32, dr.width(si.t)), *total)
        return dr.while_loop(start, lambda step, r, g, b: step < count, body)[1:]


class Emitters:
    """Directional emitters in the plane, indexed by Dr.Jit arrays."""

    def __init__(self, angles, irradiances):
        self.count = len(angles)
        self.cosines, self.sines = mi.Float(np.cos(angles)), mi.Float(np.sin(angles))
        self.irradiances = [mi.Float(irradiances[:, c]) for c in range(3)]

    def toward(self, k):
        return mi.Vector3f(dr.gather(mi.Float, self.cosines, k), dr.gather(mi.Float, self.sines, k), 0.0)

    def irradiance(self, k):
        return mi.Color3f(*(dr.gather(mi.Float, values, k) for values in self.irradiances))


def limb_columns(case):
    """Columns whose |theta_o'| at an edge exceeds LIMB_DEG, and those just outside the outline."""
    camera = case.camera
    edges = np.abs(case.sine_of_exitance(np.arange(camera.width + 1.0)))
    near, far = np.minimum(edges[:-1], edges[1:]), np.maximum(edges[:-1], edges[1:])
    return (far > np.sin(np.radians(LIMB_DEG))) & (near < 1.02)


def tabulate_brdf(material, theta_i, theta_o):
    """rho from Mitsuba's BSDF in the plane; eval includes the light's cosine, rho does not: (..., 3)."""
    bsdf = mi.load_dict(bsdf_description(material))
    si = dr.zeros(mi.SurfaceInteraction3f, theta_i.size)
    si.wi = mi.Vector3f(mi.Float(np.sin(theta_o).ravel()), 0.0, mi.Float(np.cos(theta_o).ravel()))
    toward = mi.Vector3f(mi.Float(np.sin(theta_i).ravel()), 0.0, mi.Float(np.cos(theta_i).ravel()))
    value = np.array(bsdf.eval(mi.BSDFContext(), si, toward)).T
    return value.reshape(theta_i.shape + (3,)) / np.cos(theta_i)[..., None]


def stock_view(case, orbit_deg, samples):
    """The same photograph by Mitsuba's own path integrator, for the self-test.

    One emitter at a time: with several the integrator would choose among them at random.
    """
    total = 0.0
    angles, irradiances = case.light.source_emitters()
    for angle, irradiance in zip(angles, irradiances):
        scene = mi.load_dict(
            {
                "type": "scene",
                "shape": {**shape_description(case), "bsdf": bsdf_description(case.material)},
                "sensor": sensor_description(case.camera, orbit_deg, samples),
                "sun": {
                    "type": "directional",
                    "direction": [-np.cos(angle), -np.sin(angle), 0.0],
                    "irradiance": {"type": "rgb", "value": [float(e) for e in irradiance]},
                },
            }
        )
        integrator = mi.load_dict({"type": "path", "max_depth": 2})
        total = total + np.array(mi.render(scene, integrator=integrator, spp=samples, seed=1), dtype=float)
    return total
