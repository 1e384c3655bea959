//! The camera: pixels to rays and points to pixels, in camera axes.
//!
//! Camera axes: origin at the nominal centre of the orbit, x towards the camera, y to the right in
//! the image, z up in the image. The camera's centre is at (distance, 0, 0) and looks along −x. Pixel
//! coordinates start at (0, 0) in the image's top-left corner: the centre of column u is at u + ½.

use nalgebra::{Matrix2, Vector2, Vector3};

use crate::capture::{Camera, Projection};
use crate::error::{Error, Result};

/// A line of sight, in camera axes, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// A point on it: the camera's centre, or for parallel rays the point at the camera's depth.
    pub origin: Vector3<f64>,
    /// Where it goes, into the scene; its length is such that it goes one metre deeper (x = −1).
    pub direction: Vector3<f64>,
}

/// A camera whose description was found to be usable.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraModel {
    projection: Projection,
    size: [f64; 2],
    principal: Vector2<f64>,
    distance: f64,
    lens: Option<Lens>,
}

impl CameraModel {
    /// Checks the description and prepares it.
    ///
    /// # Errors
    /// A size, length or focal length that is not positive and finite; distortion with parallel rays;
    /// distortion that folds within the image, so that two directions would share a pixel.
    pub fn new(camera: &Camera) -> Result<Self> {
        let (key, scale) = match camera.projection {
            Projection::Perspective { focal_px } => ("camera.focal_px", focal_px),
            Projection::Orthographic { metres_per_px } => ("camera.width_m", metres_per_px),
        };
        for (key, value) in [(key, scale), ("camera.distance", camera.distance)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(
                    Error::input(format!("expected a number above 0, found {value}")).key(key),
                );
            }
        }
        if camera.image_size.contains(&0) {
            let [w, h] = camera.image_size;
            return Err(Error::input(format!(
                "expected a width and a height above 0, found {w} × {h}"
            ))
            .key("camera.image_size"));
        }
        if !camera.principal_point_px.iter().all(|v| v.is_finite()) {
            return Err(
                Error::input("expected two finite numbers").key("camera.principal_point_px")
            );
        }
        let mut model = Self {
            projection: camera.projection,
            size: camera.image_size.map(f64::from),
            principal: camera.principal_point_px.into(),
            distance: camera.distance,
            lens: None,
        };
        if camera.distortion.iter().any(|k| *k != 0.0) {
            let Projection::Perspective { focal_px } = camera.projection else {
                return Err(Error::input(
                    "lens distortion is defined for perspective cameras only, and this one is orthographic",
                )
                .key("camera.distortion")
                .advice("Leave it out, or undistort the photos first."));
            };
            let border = model
                .border()
                .map(|pixel| (Vector2::from(pixel) - model.principal) / focal_px);
            model.lens = Some(Lens::new(camera.distortion, border)?);
        }
        Ok(model)
    }

    /// Points around the image's border, pixels: where distortion is strongest.
    fn border(&self) -> impl Iterator<Item = [f64; 2]> {
        const STEPS: u32 = 16;
        let [w, h] = self.size;
        (0..=STEPS).flat_map(move |i| {
            let t = f64::from(i) / f64::from(STEPS);
            [[t * w, 0.0], [t * w, h], [0.0, t * h], [w, t * h]]
        })
    }

    /// The camera's centre; for parallel rays the point on the optical axis at the same distance.
    pub fn centre(&self) -> Vector3<f64> {
        Vector3::new(self.distance, 0.0, 0.0)
    }

    /// Whether all rays are parallel.
    pub fn is_orthographic(&self) -> bool {
        matches!(self.projection, Projection::Orthographic { .. })
    }

    /// Width and height of the image, pixels.
    pub fn size(&self) -> [f64; 2] {
        self.size
    }

    /// Camera centre to the nominal centre of the orbit, metres.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Size of a pixel at the nominal centre of the orbit, metres.
    pub fn metres_per_px(&self) -> f64 {
        match self.projection {
            Projection::Perspective { focal_px } => self.distance / focal_px,
            Projection::Orthographic { metres_per_px } => metres_per_px,
        }
    }

    /// The line of sight of a position in the image, pixels.
    pub fn ray(&self, pixel: [f64; 2]) -> Ray {
        let from_axis = Vector2::from(pixel) - self.principal;
        match self.projection {
            Projection::Perspective { focal_px } => {
                let mut slope = from_axis / focal_px;
                if let Some(lens) = &self.lens {
                    slope = lens.undistort(slope);
                }
                Ray {
                    origin: self.centre(),
                    direction: Vector3::new(-1.0, slope.x, -slope.y),
                }
            }
            Projection::Orthographic { metres_per_px } => Ray {
                origin: Vector3::new(
                    self.distance,
                    from_axis.x * metres_per_px,
                    -from_axis.y * metres_per_px,
                ),
                direction: Vector3::new(-1.0, 0.0, 0.0),
            },
        }
    }

    /// Where a point is seen, pixels (also outside the image); `None` if it is not in front of the camera
    /// or so far off that the distortion's polynomial folds.
    pub fn project(&self, point: Vector3<f64>) -> Option<[f64; 2]> {
        let depth = self.distance - point.x;
        if depth.is_nan() || depth <= 0.0 {
            return None;
        }
        let across = Vector2::new(point.y, -point.z);
        let from_axis = match self.projection {
            Projection::Perspective { focal_px } => {
                let mut slope = across / depth;
                if let Some(lens) = &self.lens {
                    slope = lens.distort(slope)?;
                }
                slope * focal_px
            }
            Projection::Orthographic { metres_per_px } => across / metres_per_px,
        };
        Some((self.principal + from_axis).into())
    }
}

/// OpenCV's lens model on slopes (x, y), y down: radial k1 k2 k3, tangential p1 p2.
#[derive(Clone, Debug, PartialEq)]
struct Lens {
    k: [f64; 3],
    p: [f64; 2],
    /// Undistorted slopes beyond this radius are not to be trusted: the radial part may fold.
    largest: f64,
}

impl Lens {
    /// `border`: distorted slopes around the image's border.
    fn new(
        [k1, k2, p1, p2, k3]: [f64; 5],
        border: impl Iterator<Item = Vector2<f64>>,
    ) -> Result<Self> {
        let fault = |what: String| {
            Err(Error::input(what)
                .key("camera.distortion")
                .advice("The order is k1 k2 p1 p2 k3; check the signs and that focal_px belongs to the same calibration."))
        };
        if [k1, k2, p1, p2, k3].iter().any(|v| !v.is_finite()) {
            return fault("expected five finite numbers".into());
        }
        let mut lens = Self {
            k: [k1, k2, k3],
            p: [p1, p2],
            largest: f64::INFINITY,
        };
        let border: Vec<_> = border.collect();
        let needed = border.iter().map(|s| s.norm()).fold(0.0, f64::max);
        // Walk outwards until a fifth beyond what the image needs, or until the radial part folds.
        let step = needed / 256.0;
        let mut r = 0.0;
        while lens.radial(r) < 1.2 * needed && lens.radial_slope(r) > 0.0 && r < 16.0 * needed {
            r += step;
        }
        lens.largest = r;
        for slope in border {
            let found = lens.undistort(slope);
            let closes = (lens.polynomial(found) - slope).norm() <= 1e-12 * (1.0 + needed);
            if !closes || found.norm() > lens.largest || lens.jacobian(found).determinant() <= 0.0 {
                return fault(format!(
                    "the distortion cannot be inverted over the image: it folds {:.0} % of the way from the \
                     principal point to the farthest corner",
                    100.0 * (lens.radial(r) / needed).min(1.0)
                ));
            }
        }
        Ok(lens)
    }

    fn radial(&self, r: f64) -> f64 {
        let [k1, k2, k3] = self.k;
        let q = r * r;
        r * (1.0 + q * (k1 + q * (k2 + q * k3)))
    }

    fn radial_slope(&self, r: f64) -> f64 {
        let [k1, k2, k3] = self.k;
        let q = r * r;
        1.0 + q * (3.0 * k1 + q * (5.0 * k2 + q * 7.0 * k3))
    }

    fn distort(&self, slope: Vector2<f64>) -> Option<Vector2<f64>> {
        (slope.norm() <= self.largest).then(|| self.polynomial(slope))
    }

    fn polynomial(&self, s: Vector2<f64>) -> Vector2<f64> {
        let [k1, k2, k3] = self.k;
        let [p1, p2] = self.p;
        let (x, y) = (s.x, s.y);
        let q = s.norm_squared();
        let radial = 1.0 + q * (k1 + q * (k2 + q * k3));
        Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x),
            y * radial + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }

    fn jacobian(&self, s: Vector2<f64>) -> Matrix2<f64> {
        let [k1, k2, k3] = self.k;
        let [p1, p2] = self.p;
        let (x, y) = (s.x, s.y);
        let q = s.norm_squared();
        let radial = 1.0 + q * (k1 + q * (k2 + q * k3));
        let growth = 2.0 * (k1 + q * (2.0 * k2 + q * 3.0 * k3));
        let cross = growth * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
        Matrix2::new(
            radial + growth * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + growth * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        )
    }

    /// Newton's method from the distorted slope; quadratic, so a few steps reach rounding.
    fn undistort(&self, distorted: Vector2<f64>) -> Vector2<f64> {
        let mut s = distorted;
        for _ in 0..30 {
            let miss = self.polynomial(s) - distorted;
            let Some(inverse) = self.jacobian(s).try_inverse() else {
                break;
            };
            let mut step = inverse * miss;
            // A step longer than the slope itself leaves the basin of the wanted root.
            let limit = 0.5 * (distorted.norm() + s.norm());
            if step.norm() > limit {
                step *= limit / step.norm();
            }
            s -= step;
            if step.norm() <= 1e-16 * (1.0 + s.norm()) {
                break;
            }
        }
        s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(distortion: [f64; 5]) -> Camera {
        Camera {
            projection: Projection::Perspective { focal_px: 1400.0 },
            image_size: [960, 640],
            principal_point_px: [471.0, 327.5],
            distortion,
            distance: 0.6,
            orbit_sigma_deg: 0.0,
        }
    }

    #[test]
    fn a_ray_passes_through_the_points_it_shows() {
        for distortion in [
            [0.0; 5],
            [-0.28, 0.09, 0.0, 0.0, 0.0],
            [0.2, -0.1, 0.001, -0.002, 0.03],
        ] {
            let model = CameraModel::new(&camera(distortion)).unwrap();
            for (u, v) in [(0.0, 0.0), (960.0, 640.0), (471.0, 327.5), (130.3, 600.1)] {
                let ray = model.ray([u, v]);
                let point = ray.origin + ray.direction * 0.57;
                let [u2, v2] = model.project(point).unwrap();
                // 1e-12 of the image's size: a few roundings of a number near 1000.
                assert!(
                    (u2 - u).abs() < 1e-9 && (v2 - v).abs() < 1e-9,
                    "{distortion:?} {u} {v}: {u2} {v2}"
                );
            }
        }
    }

    #[test]
    fn image_right_is_y_and_image_up_is_z() {
        let model = CameraModel::new(&camera([0.0; 5])).unwrap();
        let [u, v] = model.project(Vector3::new(0.0, 0.01, 0.02)).unwrap();
        assert!((u - (471.0 + 1400.0 * 0.01 / 0.6)).abs() < 1e-10);
        assert!((v - (327.5 - 1400.0 * 0.02 / 0.6)).abs() < 1e-10);
        assert!(model.project(Vector3::new(0.7, 0.0, 0.0)).is_none());
    }

    #[test]
    fn distortion_that_folds_is_refused() {
        // r (1 − 3 r²) turns back at r = 1/3, where it is 0.22; the corner is at 0.41.
        let error = CameraModel::new(&camera([-3.0, 0.0, 0.0, 0.0, 0.0])).unwrap_err();
        assert!(error.to_string().contains("camera.distortion"), "{error}");
        let mut flat = camera([0.1, 0.0, 0.0, 0.0, 0.0]);
        flat.projection = Projection::Orthographic {
            metres_per_px: 1e-4,
        };
        assert!(CameraModel::new(&flat).is_err());
    }

    #[test]
    fn lengths_must_be_positive() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let mut c = camera([0.0; 5]);
            c.distance = bad;
            assert!(CameraModel::new(&c).is_err());
            let mut c = camera([0.0; 5]);
            c.projection = Projection::Perspective { focal_px: bad };
            assert!(CameraModel::new(&c).is_err());
        }
    }
}
