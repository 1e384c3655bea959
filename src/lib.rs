//! Photographs of a cylinder or a sphere in; measurements of light and material out.
//!
//! A homogeneous convex object is photographed from many directions in a plane. Every pixel on its
//! cross-section is one sample of the **reflected light field** B(α, θo′). Reflection is a
//! convolution of the incident light with the BRDF, so lighting and BRDF follow by deconvolution:
//! R. Ramamoorthi and P. Hanrahan, "Analysis of planar light fields from homogeneous convex curved
//! surfaces under distant illumination", Proc. SPIE 4299 (2001), cited everywhere as \[RH01\] with
//! its equation numbers.
//!
//! # Conventions
//!
//! This is the only table of conventions; everything else refers to it.
//!
//! | symbol | meaning | range, unit |
//! |---|---|---|
//! | measurement plane | the plane of the object's cross-section; it holds the camera's centre and the light | |
//! | α ([`NormalAngle`]) | direction of the outward surface normal, from the reference axis, counter-clockwise | [−π, π) rad |
//! | θi, θo ([`WorldAngle`]) | incident / exitant direction, global; both point **away** from the surface | rad |
//! | θi′ = θi − α, θo′ = θo − α ([`LocalAngle`]) | the same, local to the normal, **signed** (eq. 1) | [−π/2, π/2] rad |
//! | L(θi) | incident light per radian of in-plane angle | W m⁻² rad⁻¹, on a surface facing θi |
//! | ρ(θi′, θo′) | BRDF, plane-of-incidence slice of the 3-D BRDF; **no cosine** in it | sr⁻¹ |
//! | ρ̂ = ρ cos θi′ | transfer function (eq. 3) | |
//! | ρ̃ = ρ cos θi′ cos θo′ | reciprocal transfer function (eq. 5): ρ̃(a, b) = ρ̃(b, a) | |
//! | B(α, θo′) | reflected light field | W m⁻² sr⁻¹ |
//! | B̃ = B cos θo′ | (eq. 5) | |
//!
//! * Reflection equation (eq. 4): B(α, θo′) = ∫ L(α + θi′) ρ̂(θi′, θo′) dθi′ over the half circle.
//! * The mirror direction is θi′ = −θo′; a lobe is a function of θi′ + θo′.
//! * A distant source of irradiance E (on a surface facing it) at θ is L = E δ(θ).
//! * Fourier series (eq. 6): f_k = (1/2π) ∫ f(θ) e^{−ikθ} dθ, f(θ) = Σ f_k e^{ikθ}. Functions of local
//!   angles are zero outside [−π/2, π/2]. The 2π and the sign are applied in [`fourier`] and nowhere else.
//! * Product form (eq. 14): B(α, θo′) = Σ_p L_p H_p(θo′) e^{ipα} with
//!   H_p(θo′) = 2π ρ̂_{−p}(θo′) = ∫ ρ̂(θi′, θo′) e^{ipθi′} dθi′.
//! * Inside the program angles are radians; in files degrees, and the name says so (`_deg`).
//!
//! # The stages from Rust
//!
//! All of it: photographs and a recipe in, everything a run finds out.
//!
//! ```
//! use flatlight::{capture::Capture, pipeline::{Recipe, Silent, execute}};
//! # fn main() -> flatlight::Result<()> {
//! let capture = Capture::read("testdata/phong32-sun".as_ref())?;
//! let recipe = Recipe::read("pipelines/lighting.toml".as_ref())?;
//! let run = execute(&recipe, &capture, &Silent)?;
//! let light = run.lighting.expect("a recipe for lighting recovers it");
//! assert!((light.sources[0].theta_deg - 37.3).abs() < 0.1);
//! # Ok(()) }
//! ```
//!
//! Or stage by stage: photographs to samples of B with their variances, samples to light.
//!
//! ```
//! use flatlight::capture::Capture;
//! use flatlight::pipeline::{LightFieldOptions, Recipe, Silent, measure};
//! use flatlight::recover::lighting::{Options, Regularisation, recover};
//! # fn main() -> flatlight::Result<()> {
//! let capture = Capture::read("testdata/phong32-sun".as_ref())?;
//! let options = LightFieldOptions { normals: 720, locals: 180, limb_cut_deg: None, rows: None };
//! let measured = measure(&capture, &options, 1.5, &Silent)?;
//! let recipe = Recipe::read("pipelines/lighting.toml".as_ref())?;
//! let model = recipe.brdf.expect("the recipe states a BRDF");
//! let material = model.material(&measured.samples.channels, &recipe.folder)?;
//! let options = Options { band: None, regularisation: Regularisation::Evidence, non_negative: true };
//! let light = recover(&measured.samples, &material, &options)?;
//! assert!(light.channels[0].determined_band >= Some(12));
//! # Ok(()) }
//! ```
//!
//! A light and a material to the light field they make, and a result handed on.
//!
//! ```
//! use std::sync::Arc;
//! use flatlight::brdf::{Brdf, Phong};
//! use flatlight::{LocalAngle, NormalAngle, WorldAngle};
//! let surface: Arc<dyn Brdf> = Arc::new(Phong { diffuse: 0.3, specular: 0.4, exponent: 32.0 });
//! let (alpha, exitant) = (NormalAngle::degrees(10.0), LocalAngle::degrees(-25.0));
//! // One sun of 3 W m⁻² at 37.3°: B = E ρ(θi′, θo′) cos θi′.
//! let incident = WorldAngle::degrees(37.3) - alpha;
//! let radiance = 3.0 * surface.value(incident, exitant) * incident.rad().cos();
//! assert!(radiance > 1.0 && radiance < 6.0);
//! ```
//!
//! A whole light field by the product form, and back from it what made it: the material under the known light, and both of them when
//! neither is known, up to a factor.
//!
//! ```
//! use std::sync::Arc;
//! use flatlight::brdf::{GgxConductor, Material};
//! use flatlight::lighting::{Lighting, Source};
//! use flatlight::recover::{brdf, factorise};
//! use flatlight::{Grid, LocalAngle, WorldAngle, light_field::Samples, reflect::product};
//! # fn main() -> flatlight::Result<()> {
//! let gold = GgxConductor { alpha: 0.3, eta: 0.2, k: 3.9, specular: 1.0 };
//! let material = Material { channels: vec!["Y".into()], brdfs: vec![Arc::new(gold)] };
//! let suns = [(37.3, 3.0), (-104.6, 1.1)].map(|(deg, e)| Source { theta: WorldAngle::degrees(deg), irradiance: vec![e] });
//! let light = Lighting::from_sources(vec!["Y".into()], suns.to_vec());
//! let grid = Grid { normals: 120, locals: 60 };
//! let field = product::on_grid(&light, &material, grid, 60)?;
//! let samples = Samples::from_grid(grid, vec!["Y".into()], &field, &[vec![1e-8; grid.len()]]);
//!
//! let options = brdf::Options { size: 60, curve: false, ..Default::default() };
//! let slice = brdf::recover(&samples, &light, &options)?;
//! let (rho, sigma) = slice.rho(0, 40, 22).expect("seen");
//! assert!(rho > 0.0 && sigma < 0.02 * rho);
//!
//! let both = factorise::recover(&samples, &factorise::Options { band: Some(12), ..Default::default() })?;
//! let ratio = |p| both.channels[0].lighting.get(p) / both.channels[0].lighting.get(0);
//! let truth = light.series(0, 12);
//! assert!((ratio(5) - truth.get(5) / truth.get(0)).norm() < 0.01);
//! # Ok(()) }
//! ```
//!
//! An environment prefiltered for a renderer, each value within the tolerance.
//!
//! ```
//! use std::sync::Arc;
//! use flatlight::brdf::{Brdf, Material, Phong};
//! use flatlight::fourier::Series;
//! use flatlight::{Grid, lighting::Lighting, reflect::prefilter};
//! # fn main() -> flatlight::Result<()> {
//! let mut series = Series::zero(8);
//! series.coefficients[0].re = 1.0;
//! series.coefficients[8].re = 0.3;
//! let light = Lighting::band_limited(vec!["Y".into()], vec![series]);
//! let surface: Arc<dyn Brdf> = Arc::new(Phong { diffuse: 0.3, specular: 0.4, exponent: 32.0 });
//! let material = Material { channels: vec!["Y".into()], brdfs: vec![surface] };
//! let grid = Grid { normals: 360, locals: 90 };
//! let table = prefilter::prefilter(&light, &material, grid, &prefilter::Options::default())?;
//! assert_eq!(table.value[0].len(), grid.len());
//! # Ok(()) }
//! ```
//!
//! Two results compared, with the factor between them that fits best; a run folder as it was written, and its result for another program.
//!
//! ```no_run
//! use flatlight::compare::{Options, Scale, compare_paths};
//! # fn main() -> flatlight::Result<()> {
//! let options = Options { scale: Scale::Common, tolerance: Some(0.01) };
//! for (product, comparison) in compare_paths("out".as_ref(), "other".as_ref(), &options)? {
//!     println!("{product}: {}", comparison.csv());
//! }
//! # Ok(()) }
//! ```
//!
//! ```no_run
//! use flatlight::{export, pipeline::Folder};
//! # fn main() -> flatlight::Result<()> {
//! let run = Folder::new("out".as_ref()).read()?;
//! for file in export::export(&run, export::Format::Mitsuba, "out/export".as_ref())? {
//!     println!("{}", file.display());
//! }
//! # Ok(()) }
//! ```

#![warn(missing_docs)]

pub mod angle;
pub mod batch;
pub mod brdf;
pub mod capture;
pub mod compare;
pub mod error;
pub mod export;
pub mod files;
pub mod fourier;
pub mod geometry;
pub mod grid;
pub mod light_field;
pub mod lighting;
pub mod photo;
pub mod pipeline;
pub mod radiance;
pub mod recover;
pub mod reflect;
pub mod report;
pub mod simulate;
pub mod validate;

pub use angle::{LocalAngle, NormalAngle, WorldAngle};
pub use error::{Error, Result};
pub use grid::Grid;
