"""Eq. 4 of [RH01] by integration: B(alpha, theta_o') = int L(alpha + t) rho(t, theta_o') cos t dt.

The continuous light is a finite Fourier sum, so the integral over t is taken once per
(theta_o', order) by Gauss-Legendre, which is exact to rounding for these smooth integrands;
sources are evaluated directly, since interpolating across a sun's terminator is not.
"""
import numpy as np

from .material import rho

NODES, WEIGHTS = np.polynomial.legendre.leggauss(256)


def reflected(material, light, alpha, theta_o):
    """B at alpha (..., N) for theta_o (N,), radians: (..., N, 3). Column j of alpha belongs to theta_o[j]."""
    return continuous_part(material, light, alpha, theta_o) + source_part(material, light, alpha, theta_o)


def continuous_part(material, light, alpha, theta_o):
    t = NODES * np.pi / 2
    transfer = rho(material, t[None, :], theta_o[:, None]) * (WEIGHTS * np.pi / 2 * np.cos(t))[None, :, None]
    coefficients = light.continuous_coefficients()
    total = np.zeros(alpha.shape + (3,))
    for p, value in enumerate(coefficients):
        per_row = np.einsum("t,jtc->jc", np.exp(1j * p * t), transfer)
        term = np.exp(1j * p * alpha)[..., None] * (per_row * value)
        total += term.real * (1 if p == 0 else 2)
    return total


def source_part(material, light, alpha, theta_o):
    total = np.zeros(alpha.shape + (3,))
    for source in light.sources:
        local = np.radians(source.theta_deg) - alpha
        local = (local + np.pi) % (2 * np.pi) - np.pi
        facing = np.maximum(np.cos(local), 0.0)
        total += rho(material, local, theta_o) * facing[..., None] * np.array(source.irradiance)
    return total
