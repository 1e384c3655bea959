//! Light from all of space on surfaces that show it: no planar result explains the photographs, and the program says so, names
//! the cause and calls nothing determined.

mod sets;

use flatlight::pipeline::{Recipe, Run, Silent, Verdict, execute};
use flatlight::recover::Status;
use sets::*;

fn run(name: &str, recipe: &str) -> Run {
    let folder = set(name);
    let file = folder.join("recipe.toml");
    let recipe = match recipe {
        "" => Recipe::read(&file),
        text => Recipe::parse(text, &file, &folder),
    };
    let recipe = recipe.unwrap_or_else(|e| panic!("{e}"));
    execute(&recipe, &capture(&folder), &Silent).unwrap_or_else(|e| panic!("{e}"))
}

/// The sun of another scene, as good a guess as any.
const BRDF: &str = "recover = \"brdf\"\n[lighting]\nsources = [{ theta_deg = 37.3, irradiance = 3.0 }]\nuniform = 0.2\n";
const BOTH: &str = "recover = \"both\"\n";

fn warns_of_the_cause(run: &Run) {
    let said = run.warnings.join("\n");
    assert!(
        said.contains("unexplained beyond the noise")
            && said.contains("out of the measurement plane"),
        "{said}"
    );
}

/// Every number that a run of a refused channel gives is marked as none.
fn nothing_is_determined(run: &Run) {
    for fit in &run.fit {
        assert_eq!(fit.verdict, Verdict::Refused, "{fit:?}");
    }
    let light = run.lighting.iter().flat_map(|l| &l.channels);
    for channel in light {
        assert_eq!(channel.determined_band, None);
        assert!(
            channel
                .spectrum
                .iter()
                .all(|c| c.status == Status::Indeterminate)
        );
    }
    for slice in run.brdf.iter().flat_map(|b| &b.slices) {
        assert!(slice.status.iter().all(|s| *s == Status::Indeterminate));
        assert!(
            slice
                .spectrum
                .iter()
                .all(|c| c.status == Status::Indeterminate)
        );
    }
    assert!(
        run.models.iter().all(|m| m.channels.is_empty()),
        "no model of what was refused"
    );
}

/// Half the light's width in the lobe of GGX 0.1 comes from above or below the plane.
#[test]
fn a_polished_metal_in_a_room_is_refused() {
    for recipe in ["", BRDF, BOTH] {
        let run = run("surround-ggx01", recipe);
        warns_of_the_cause(&run);
        nothing_is_determined(&run);
    }
}

/// A lobe as broad as Phong's at 8 blurs the room: 3 to 4 % remain of the light field, and 2 % break reciprocity. But the best light
/// is then another than the one that a diffuse surface would show, and the best slice is wrong by a third.
#[test]
fn a_dull_surface_in_a_room_is_refused() {
    for recipe in ["", BRDF, BOTH] {
        let run = run("surround-phong8", recipe);
        warns_of_the_cause(&run);
        nothing_is_determined(&run);
        // The rows beside the line alone say so: lamps 30° and more from the plane in a lobe of 20°.
        for fit in &run.fit {
            assert!(fit.across.is_some_and(|across| across > 0.12), "{fit:?}");
        }
        let said = run.warnings.join("\n");
        assert!(said.contains("across the measurement plane"), "{said}");
    }
}

/// Rendered light in the plane gives rows that are alike above and below it, to the last bit but for rounding.
#[test]
fn light_in_the_plane_is_alike_above_and_below() {
    let run = run("phong8-smooth", BOTH);
    for fit in &run.fit {
        assert!(fit.across.is_some_and(|across| across < 1e-3), "{fit:?}");
        assert_eq!(fit.verdict, Verdict::Explained, "{fit:?}");
    }
}
