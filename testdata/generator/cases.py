"""What each set shows. A case is plain data; the geometry of its camera is here too."""
from dataclasses import dataclass, field, replace

import numpy as np

from .light import Light, Source, band_limited

# The object's outline covers this part of the image's width: background is seen on both sides.
APPARENT = 0.85


@dataclass(frozen=True)
class Camera:
    width: int
    height: int
    distance: float = 0.6
    projection: str = "perspective"
    focal_px: float = 0.0
    width_m: float = 0.0
    # How capture.toml states the focal length: focal_px, fov_x_deg or sensor_width_mm.
    stated_as: str = "focal_px"
    # The principal point from the image's centre, in pixels to the right.
    shift_px: float = 0.0

    @property
    def principal_point_px(self):
        return (self.width / 2 + self.shift_px, self.height / 2)


@dataclass(frozen=True)
class Case:
    name: str
    title: str
    material: dict
    light: Light
    views: int
    size: tuple[int, int]
    shape: str = "cylinder"
    radius: float = 0.05
    distance: float = 0.6
    projection: str = "perspective"
    stated_as: str = "focal_px"
    shift_px: float = 0.0
    orbit_start_deg: float = 0.0
    # +1: the camera goes counter-clockwise, -1: clockwise.
    orbit_sense: int = 1
    # Seed and size of irregular steps; then the views are listed one by one.
    orbit_jitter_deg: float = 0.0
    # Recipes get the BRDF as a table instead of a model.
    tabulated: bool = False
    camera: Camera = field(init=False)

    def __post_init__(self):
        width, height = self.size
        sensed = dict(width=width, height=height, distance=self.distance, projection=self.projection)
        if self.projection == "orthographic":
            camera = Camera(**sensed, width_m=round(2 * self.radius / APPARENT, 6))
        else:
            focal_px = APPARENT * width / 2 * np.sqrt(self.distance**2 - self.radius**2) / self.radius
            camera = Camera(
                **sensed, focal_px=round(float(focal_px), 1), stated_as=self.stated_as, shift_px=self.shift_px
            )
        object.__setattr__(self, "camera", camera)

    def resized(self, size=None, views=None):
        return replace(self, size=size or self.size, views=views or self.views)

    @property
    def orbit_step_deg(self):
        return self.orbit_sense * 360 / self.views

    def orbit_degrees(self):
        regular = self.orbit_start_deg + self.orbit_step_deg * np.arange(self.views)
        if self.orbit_jitter_deg:
            jitter = np.random.default_rng(11).uniform(-1, 1, self.views) * self.orbit_jitter_deg
            return np.round(regular + jitter, 3)
        return regular

    def sine_of_exitance(self, u):
        """sin(-theta_o') on the ray through column position u in the plane; beyond +-1 it misses."""
        camera = self.camera
        if camera.projection == "orthographic":
            return (u - camera.width / 2) * camera.width_m / camera.width / self.radius
        slope = (u - camera.principal_point_px[0]) / camera.focal_px
        return np.sin(np.arctan(slope)) * camera.distance / self.radius


def phong(exponent):
    return {
        "model": "phong",
        "diffuse": [0.30, 0.22, 0.15],
        "specular": [0.40, 0.40, 0.38],
        "exponent": exponent,
    }


def metal(alpha, eta, k):
    return {"model": "ggx-conductor", "alpha": alpha, "eta": eta, "k": k, "specular": [1.0, 1.0, 1.0]}


def copper(alpha):
    return metal(alpha, [0.2004, 0.9240, 1.1022], [3.9129, 2.4528, 2.1421])


def gold(alpha):
    return metal(alpha, [0.1431, 0.3749, 1.4424], [3.9831, 2.3857, 1.6032])


SUN = Source(37.3, (3.0, 2.9, 2.7))
BLUE_SUN = Source(-104.6, (1.1, 1.3, 1.7))
FILL = (0.04, 0.045, 0.055)

SMOOTH = Light(coefficients=band_limited(12, [1.0, 0.9, 0.8], seed=20010))
SMOOTH_20 = Light(coefficients=band_limited(20, [1.0, 0.95, 0.9], seed=4299))
ONE_SUN = Light(sources=(SUN,))
TWO_SUNS = Light(sources=(SUN, BLUE_SUN), uniform=FILL)

CASES = [
    Case(
        "phong32-smooth", "glossy Phong cylinder under smooth light of order 12",
        phong(32), SMOOTH, views=72, size=(480, 24),
    ),
    Case(
        "phong32-sun", "glossy Phong cylinder under one sun",
        phong(32), ONE_SUN, views=72, size=(480, 24), stated_as="fov_x_deg", orbit_start_deg=2.5,
    ),
    Case(
        "phong32-two-suns", "glossy Phong cylinder under two suns and a uniform fill",
        phong(32), TWO_SUNS, views=72, size=(480, 24), stated_as="sensor_width_mm", orbit_sense=-1,
    ),
    Case(
        "phong8-smooth", "dull Phong cylinder under smooth light of order 12",
        phong(8), SMOOTH, views=36, size=(540, 25), radius=0.08, distance=0.5, orbit_start_deg=-177.0,
    ),
    Case(
        "phong8-sun", "dull Phong cylinder under one sun, uneven orbit, principal point off the centre",
        phong(8), ONE_SUN, views=36, size=(480, 24), stated_as="sensor_width_mm",
        shift_px=5.5, orbit_start_deg=4.0, orbit_sense=-1, orbit_jitter_deg=1.5,
    ),
    Case(
        "phong8-two-suns", "dull Phong cylinder under two suns and a uniform fill",
        phong(8), TWO_SUNS, views=36, size=(512, 24), stated_as="fov_x_deg", radius=0.03, distance=0.9,
        orbit_start_deg=10.0, orbit_sense=-1,
    ),
    Case(
        "lambertian-smooth", "matte cylinder under smooth light of order 12",
        {"model": "lambertian", "albedo": [0.6, 0.5, 0.4]}, SMOOTH, views=36, size=(480, 24),
    ),
    Case(
        "ggx-sphere", "polished copper sphere under smooth light of order 20",
        copper(0.1), SMOOTH_20, views=36, size=(600, 24), shape="sphere", stated_as="sensor_width_mm",
        orbit_start_deg=3.0, tabulated=True,
    ),
    Case(
        "phong32-orthographic", "glossy Phong cylinder seen by a parallel projection, two suns and a fill",
        phong(32), TWO_SUNS, views=36, size=(481, 25), projection="orthographic", orbit_start_deg=1.0,
    ),
    Case(
        "ggx02-two-suns", "brushed gold cylinder under two suns and a uniform fill",
        gold(0.2), TWO_SUNS, views=72, size=(480, 24), orbit_start_deg=1.25,
    ),
]
