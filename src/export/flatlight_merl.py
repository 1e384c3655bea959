"""A BSDF for Mitsuba 3 that reads a MERL table: <bsdf type="flatlight-merl"> with the string `filename`.

Import it after mi.set_variant(...) and before loading a scene. Between the centres of the table's cells it
interpolates linearly in sqrt(theta_h), theta_d and phi_d.
"""
import drjit as dr
import mitsuba as mi
import numpy as np

SIZE = (90, 90, 180)
UNIT = (1.0 / 1500, 1.15 / 1500, 1.66 / 1500)


class Merl(mi.BSDF):
    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        path = mi.Thread.thread().file_resolver().resolve(props["filename"])
        with open(str(path), "rb") as file:
            if tuple(np.fromfile(file, "<i4", 3)) != SIZE:
                raise ValueError(f"{path}: expected a MERL table of 90 x 90 x 180 cells")
            values = np.fromfile(file, "<f8").reshape(3, -1)
        values = np.maximum(values, 0) * np.array(UNIT)[:, None]
        self.values = mi.Float(values.T.ravel().astype(np.float32))
        self.m_components = [mi.BSDFFlags.Glossy | mi.BSDFFlags.FrontSide]
        self.m_flags = self.m_components[0]

    def rho(self, wi, wo):
        half = dr.normalize(wi + wo)
        theta_h = dr.safe_acos(half.z)
        # wi in the frame of the half vector.
        sin_h = dr.sqrt(dr.maximum(1 - dr.square(half.z), 1e-12))
        c, s = half.x / sin_h, half.y / sin_h
        upright = sin_h < 1e-5
        c, s = dr.select(upright, 1.0, c), dr.select(upright, 0.0, s)
        along = c * wi.x + s * wi.y
        x = half.z * along - sin_h * wi.z
        y = c * wi.y - s * wi.x
        z = sin_h * along + half.z * wi.z
        theta_d = dr.atan2(dr.sqrt(x * x + y * y), z)
        phi = dr.atan2(y, x)
        phi = dr.select(phi < 0, phi + dr.pi, phi)
        at = [
            dr.sqrt(dr.maximum(theta_h / (dr.pi / 2), 0)) * SIZE[0] - 0.5,
            theta_d / (dr.pi / 2) * SIZE[1] - 0.5,
            phi / dr.pi * SIZE[2] - 0.5,
        ]
        low = [dr.floor(a) for a in at]
        t = [a - b for a, b in zip(at, low)]
        low = [mi.Int(b) for b in low]
        total = mi.Color3f(0)
        for corner in range(8):
            offset = [(corner >> k) & 1 for k in range(3)]
            weight = mi.Float(1)
            for k in range(3):
                weight *= t[k] if offset[k] else 1 - t[k]
            i = dr.clip(low[0] + offset[0], 0, SIZE[0] - 1)
            j = dr.clip(low[1] + offset[1], 0, SIZE[1] - 1)
            k = low[2] + offset[2]
            k = dr.select(k < 0, k + SIZE[2], dr.select(k >= SIZE[2], k - SIZE[2], k))
            index = mi.UInt32((i * SIZE[1] + j) * SIZE[2] + k) * 3
            value = mi.Color3f(*(dr.gather(mi.Float, self.values, index + channel) for channel in range(3)))
            total += weight * value
        return total

    def eval(self, ctx, si, wo, active=True):
        cos_light, cos_view = mi.Frame3f.cos_theta(wo), mi.Frame3f.cos_theta(si.wi)
        return (self.rho(si.wi, wo) * cos_light) & (active & (cos_light > 0) & (cos_view > 0))

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
        active = active & (sample.pdf > 0)
        return sample, (self.eval(ctx, si, sample.wo, active) / sample.pdf) & active

    def to_string(self):
        return "flatlight-merl[]"


mi.register_bsdf("flatlight-merl", Merl)
