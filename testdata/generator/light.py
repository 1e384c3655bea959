"""Planar light: everything comes from directions in the measurement plane.

L(theta) is the irradiance that the light within d theta gives a surface facing it, per radian
(W m^-2 rad^-1); a source is a delta function of a given irradiance (W m^-2).
"""
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Source:
    theta_deg: float
    irradiance: tuple[float, float, float]


@dataclass(frozen=True)
class Light:
    """sources + uniform + smooth, where smooth(theta) = sum_p coefficients[p] e^{i p theta}.

    coefficients: complex (order + 1, 3), p = 0..order; those of -p are the conjugates.
    """

    sources: tuple[Source, ...] = ()
    uniform: tuple[float, float, float] = (0.0, 0.0, 0.0)
    coefficients: np.ndarray = field(default_factory=lambda: np.zeros((1, 3), complex))

    def has_smooth(self):
        return bool(np.any(self.coefficients))

    def continuous_coefficients(self):
        """The smooth and the uniform part together, complex (order + 1, 3)."""
        together = self.coefficients.copy()
        together[0] += self.uniform
        return together

    def continuous(self, theta):
        """Everything but the sources at the angles theta (radians): (..., 3)."""
        return evaluate(self.continuous_coefficients(), theta)

    def spectrum(self, highest):
        """L_p of the whole light, sources included (eq. 6): complex (highest + 1, 3)."""
        spectrum = np.zeros((highest + 1, 3), complex)
        known = self.continuous_coefficients()[: highest + 1]
        spectrum[: len(known)] = known
        p = np.arange(highest + 1)
        for source in self.sources:
            phase = np.exp(-1j * p * np.radians(source.theta_deg)) / (2 * np.pi)
            spectrum += phase[:, None] * np.array(source.irradiance)
        return spectrum

    def emitters(self, count):
        """The continuous part as directional emitters: angles (count,) from -pi, irradiances (count, 3).

        Each stands for a step of 360/count degrees: the midpoint rule. At 720 its error, from the
        kink of the cosine at +-90 degrees, is about 1e-5. Both arrays are empty if there is no such part.
        """
        if not np.any(self.continuous_coefficients()):
            return np.zeros(0), np.zeros((0, 3))
        theta = -np.pi + np.arange(count) * 2 * np.pi / count
        return theta, self.continuous(theta) * 2 * np.pi / count

    def source_emitters(self):
        """The sources as directional emitters: angles (K,), irradiances (K, 3)."""
        irradiance = np.array([s.irradiance for s in self.sources], float).reshape(-1, 3)
        return np.radians([s.theta_deg for s in self.sources]), irradiance


def evaluate(coefficients, theta):
    """A real Fourier series from its terms p >= 0, at theta (radians): (..., 3)."""
    p = np.arange(len(coefficients))
    doubled = coefficients * np.where(p == 0, 1, 2)[:, None]
    return (np.exp(1j * np.multiply.outer(theta, p)) @ doubled).real


def band_limited(order, mean, seed):
    """A nonnegative light of exactly the given (even) order: coefficients (order + 1, 3).

    It is |a(theta)|^2 with a of half the order, hence nonnegative and band-limited at once.
    The channels share most of a, as the colours of a real scene do.
    """
    half = order // 2
    random = np.random.default_rng(seed)

    def amplitudes(shape):
        return random.uniform(0.6, 1.4, shape) * np.exp(2j * np.pi * random.random(shape))

    shared = amplitudes((2 * half + 1, 1))
    a = shared + 0.35 * amplitudes((2 * half + 1, 3))
    coefficients = np.stack(
        [
            [np.sum(a[p:, c] * np.conj(a[: 2 * half + 1 - p, c])) for c in range(3)]
            for p in range(order + 1)
        ]
    )
    return coefficients * (np.array(mean) / coefficients[0].real)
