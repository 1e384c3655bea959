"""The BRDF slice rho(theta_i', theta_o') in the measurement plane: 1/sr, no cosine, NumPy only.

Angles are local and signed: the mirror direction is theta_i' = -theta_o'. A material is a
dictionary with the keys of a recipe's [brdf] table. This file is independent of the renderer on
purpose: the photographs are checked against it.
"""
import numpy as np


def rho(material, theta_i, theta_o):
    """rho for arrays of angles (radians), broadcast: (..., 3). Zero outside the half circle."""
    theta_i, theta_o = np.broadcast_arrays(theta_i, theta_o)
    model = MODELS[material["model"]]
    visible = (np.cos(theta_i) > 0) & (np.cos(theta_o) > 0)
    inside = model(material, np.where(visible, theta_i, 0.0), np.where(visible, theta_o, 0.0))
    return np.where(visible[..., None], inside, 0.0)


def lambertian(material, theta_i, theta_o):
    return np.ones(theta_i.shape + (1,)) * (np.array(material["albedo"]) / np.pi)


def phong(material, theta_i, theta_o):
    """diffuse/pi + specular (n+2)/(2 pi) cos^n(theta_i' + theta_o') (modified Phong)."""
    n = material["exponent"]
    lobe = (n + 2) / (2 * np.pi) * np.maximum(np.cos(theta_i + theta_o), 0.0) ** n
    return np.array(material["diffuse"]) / np.pi + lobe[..., None] * np.array(material["specular"])


def ggx_conductor(material, theta_i, theta_o):
    """F D G1 G1 / (4 cos cos), after Walter et al. 2007; specular scales the Fresnel factor."""
    a2 = material["alpha"] ** 2
    half = 0.5 * (theta_i + theta_o)
    difference = 0.5 * (theta_i - theta_o)
    # Two directions in the upper half plane: the half vector is always above the surface and
    # |difference| <= 90 degrees, so no wrapping is needed here.
    cos2_half = np.cos(half) ** 2
    distribution = a2 / (np.pi * (cos2_half * (a2 - 1) + 1) ** 2)
    shadowing = smith_g1(a2, theta_i) * smith_g1(a2, theta_o)
    fresnel = np.stack(
        [
            specular * fresnel_conductor(np.cos(difference), eta, k)
            for eta, k, specular in zip(material["eta"], material["k"], material["specular"])
        ],
        axis=-1,
    )
    cosines = 4 * np.cos(theta_i) * np.cos(theta_o)
    return fresnel * (distribution * shadowing / cosines)[..., None]


def smith_g1(a2, theta):
    return 2 / (1 + np.sqrt(1 + a2 * np.tan(theta) ** 2))


def fresnel_conductor(cosine, eta, k):
    """Unpolarised reflectance for the relative index eta - i k."""
    cos2 = cosine**2
    sin2 = 1 - cos2
    t0 = eta**2 - k**2 - sin2
    a2_plus_b2 = np.sqrt(t0**2 + 4 * eta**2 * k**2)
    a = np.sqrt(0.5 * (a2_plus_b2 + t0))
    t1, t2 = a2_plus_b2 + cos2, 2 * a * cosine
    r_s = (t1 - t2) / (t1 + t2)
    t3, t4 = cos2 * a2_plus_b2 + sin2**2, t2 * sin2
    r_p = r_s * (t3 - t4) / (t3 + t4)
    return 0.5 * (r_s + r_p)


MODELS = {"lambertian": lambertian, "phong": phong, "ggx-conductor": ggx_conductor}
