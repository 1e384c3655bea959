use super::*;

fn lighting(folder: &Path, name: &str, n: usize, value: impl Fn(f64) -> [f64; 3]) -> PathBuf {
    let mut text = String::from("theta_deg,L_R,L_G,sigma_R,sigma_G\n");
    for k in 0..n {
        let theta = -180.0 + 360.0 * k as f64 / n as f64;
        let [r, g, sigma] = value(theta.to_radians());
        text += &format!("{theta},{r},{g},{sigma},{sigma}\n");
    }
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

fn compared(first: &Path, second: &Path, options: Options) -> Comparison {
    compare(
        &Product::read(first).unwrap(),
        &Product::read(second).unwrap(),
        &options,
    )
    .unwrap()
}

/// A planted factor, offset and peak: each is found, with its place, on grids of different steps.
#[test]
fn planted_differences_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let light = |t: f64| 2.0 + t.cos();
    let truth = lighting(folder.path(), "b.csv", 720, |t| [light(t), light(t), 0.0]);
    let scaled = lighting(folder.path(), "a.csv", 360, |t| {
        [0.5 * light(t), 0.25 * light(t), 0.0]
    });
    let raw = compared(&scaled, &truth, Options::default());
    assert_eq!(raw.kind, Kind::Lighting);
    for (channel, factor) in raw.channels.iter().zip([0.5, 0.25]) {
        assert_eq!(channel.pairs.len(), 360);
        assert!((channel.relative - (1.0 - factor)).abs() < 1e-12);
        // The largest value, 3, is at θ = 0, and so is the largest difference.
        assert!((channel.worst_relative - (1.0 - factor)).abs() < 1e-12);
        assert_eq!(channel.pairs[channel.worst].point[0], 0.0);
        assert_eq!(channel.agrees, None);
    }
    let own = Options {
        scale: Scale::Channel,
        tolerance: Some(1e-12),
    };
    for (channel, factor) in compared(&scaled, &truth, own)
        .channels
        .iter()
        .zip([2.0, 4.0])
    {
        assert!((channel.scale - factor).abs() < 1e-12);
        assert!(channel.relative < 1e-14);
        assert_eq!(channel.agrees, Some(true));
    }
    let one = Options {
        scale: Scale::Common,
        tolerance: Some(0.1),
    };
    for channel in compared(&scaled, &truth, one).channels {
        // Σ x y / Σ x² of x = y/2 and x = y/4 together: (1/2 + 1/4) / (1/4 + 1/16).
        assert!((channel.scale - 2.4).abs() < 1e-12);
        assert_eq!(channel.agrees, Some(false));
    }
}

#[test]
fn error_bars_decide_where_no_tolerance_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let truth = lighting(folder.path(), "b.csv", 720, |_| [1.0, 1.0, 0.0]);
    for (size, agrees) in [(1.9, true), (2.1, false)] {
        let first = lighting(folder.path(), "a.csv", 720, |t| {
            [1.0 + 0.01 * size * (9.0 * t).cos().signum(), 1.0, 0.01]
        });
        let found = compared(&first, &truth, Options::default());
        assert_eq!(found.channels[0].agrees, Some(agrees));
        let (_, z) = found.channels[0].within.unwrap();
        assert!((z - size).abs() < 1e-9, "{z}");
        assert_eq!(found.channels[1].within, Some((1.0, 0.0)));
    }
}

#[test]
fn slices_are_compared_between_their_grids_and_holes_left_out() {
    let folder = tempfile::tempdir().unwrap();
    // ρ cos cos of this continues smoothly as an odd function across the horizon, as the interpolation takes it.
    let write = |name: &str, n: usize, hole: bool| {
        let mut text = String::from("theta_i_deg,theta_o_deg,rho_Y\n");
        for i in 0..n {
            for j in 0..n {
                let angle = |k: usize| -90.0 + (k as f64 + 0.5) * 180.0 / n as f64;
                let (a, b) = (angle(i), angle(j));
                let rho = 0.2 + 0.06 * a.to_radians().sin() * b.to_radians().sin();
                if hole && i == 3 {
                    text += &format!("{a},{b},\n");
                } else {
                    text += &format!("{a},{b},{rho}\n");
                }
            }
        }
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let (fine, coarse) = (write("a.csv", 90, false), write("b.csv", 50, false));
    let found = compared(&coarse, &fine, Options::default());
    assert_eq!(found.channels[0].pairs.len(), 2500);
    // A cubic spline of steps h = 2° leaves h⁴/384 of the fourth derivative, 2⁴ times the size of sin 2θ: 6e-8.
    let relative = found.channels[0].relative;
    assert!(relative < 6e-8, "{relative}");
    let holed = write("c.csv", 50, true);
    let found = compared(&holed, &coarse, Options::default());
    assert_eq!(found.channels[0].pairs.len(), 2450);
    assert_eq!(found.channels[0].relative, 0.0);
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let light = lighting(folder.path(), "l.csv", 360, |_| [1.0, 1.0, 0.1]);
    let spectrum = folder.path().join("s.csv");
    std::fs::write(
        &spectrum,
        "channel,p,re,im,sigma,status\nR,0,1,0,0.1,determined\n",
    )
    .unwrap();
    let other = folder.path().join("o.csv");
    std::fs::write(
        &other,
        "channel,p,re,im,sigma,status\nB,0,1,0,0.1,determined\n",
    )
    .unwrap();
    let odd = folder.path().join("x.csv");
    std::fs::write(&odd, "a,b\n1,2\n").unwrap();
    let options = Options::default();
    for (a, b, expected) in [
        (&light, &spectrum, "same kind"),
        (&spectrum, &other, "common channel"),
        (&odd, &light, "lighting.csv"),
        (&light, &folder.path().join("none.csv"), "cannot read"),
        (
            &light,
            &folder.path().to_path_buf(),
            "two files or two folders",
        ),
    ] {
        let error = compare_paths(a, b, &options).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
        assert_eq!(error.exit_code(), 2);
    }
}
