//! What the paper states, equation by equation, in its own symbols.

/// An equation or figure of \[RH01\].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Statement {
    /// Its number; a range where one derivation runs over several numbers; words where it has none.
    pub equation: &'static str,
    /// A few words.
    pub title: &'static str,
    /// In LaTeX, with the misprints put right.
    pub latex: &'static str,
}

/// Sections of the statements: title, and the equation with which each begins.
pub const SECTIONS: [(&str, &str); 6] = [
    ("Reflection as an integral", "1"),
    ("Reflection as a product", "6"),
    ("Mirror and Lambertian surfaces", "17"),
    ("Light known: the BRDF", "24"),
    ("Neither known, and how many terms", "29"),
    ("Surfaces with a lobe", "31"),
];

const fn state(equation: &'static str, title: &'static str, latex: &'static str) -> Statement {
    Statement {
        equation,
        title,
        latex,
    }
}

/// All statements that are recomputed, in the order of the paper.
pub const STATEMENTS: [Statement; 32] = [
    state(
        "1",
        "global and local directions",
        r"\theta_i = \alpha + \theta_i' , \qquad \theta_o = \alpha + \theta_o'",
    ),
    state(
        "2",
        "the reflection equation",
        r"B = \int L(\theta_i) \, \rho(\theta_i', \theta_o') \cos\theta_i' \, \mathrm{d}\theta_i",
    ),
    state(
        "3",
        "the transfer function",
        r"\hat\rho(\theta_i', \theta_o') = \rho(\theta_i', \theta_o') \cos\theta_i'",
    ),
    state(
        "4",
        "reflection about the normal",
        r"B(\alpha, \theta_o') = \int_{-\pi/2}^{\pi/2} L(\alpha + \theta_i') \, \hat\rho(\theta_i', \theta_o') \, \mathrm{d}\theta_i'",
    ),
    state(
        "5",
        "the reciprocal form",
        r"\tilde\rho = \rho \cos\theta_i' \cos\theta_o' , \qquad \tilde\rho(\theta_i', \theta_o') = \tilde\rho(\theta_o', \theta_i') , \qquad \tilde{B} = B \cos\theta_o'",
    ),
    state(
        "6",
        "the Fourier series",
        r"f(\theta) = \sum_k f_k \, e^{i k \theta} , \qquad f_k = \frac{1}{2\pi} \int_{-\pi}^{\pi} f(\theta) \, e^{-i k \theta} \, \mathrm{d}\theta",
    ),
    state(
        "7–10",
        "from the integral to the product, step by step (equations 7, 8, 9 and 10)",
        r"L(\alpha + \theta_i') = \sum_p L_p \, e^{i p \alpha} e^{i p \theta_i'} , \qquad \hat\rho = \sum_q \hat\rho_q(\theta_o') \, e^{i q \theta_i'} , \qquad \frac{1}{2\pi} \int e^{i p \theta} e^{-i q \theta} \, \mathrm{d}\theta = \delta_{pq}",
    ),
    state(
        "11",
        "the product form, one angle",
        r"B_p(\theta_o') = 2\pi \, L_p \, \hat\rho_{-p}(\theta_o')",
    ),
    state(
        "12–13",
        "series in both angles (equations 12 and 13)",
        r"B_p(\theta_o') = \sum_q B_{p,q} \, e^{i q \theta_o'} , \qquad \hat\rho_p(\theta_o') = \sum_q \hat\rho_{p,q} \, e^{i q \theta_o'}",
    ),
    state(
        "14",
        "the product form, both angles",
        r"B_{p,q} = 2\pi \, L_p \, \hat\rho_{-p,q}",
    ),
    state(
        "15",
        "the reciprocal product form",
        r"\tilde{B}_{p,q} = 2\pi \, L_p \, \tilde\rho_{-p,q}",
    ),
    state(
        "16",
        "inverse lighting",
        r"L_p = \frac{1}{2\pi} \frac{B_{p,q}}{\hat\rho_{-p,q}}",
    ),
    state(
        "17",
        "the mirror",
        r"\hat\rho(\theta_i', \theta_o') = \delta(\theta_i' + \theta_o')",
    ),
    state(
        "18",
        "the mirror's spectrum",
        r"\hat\rho_{p,q} = \frac{\delta_{pq}}{2\pi}",
    ),
    state(
        "19",
        "a mirror shows the light",
        r"B(\alpha, \theta_o') = L(\alpha - \theta_o')",
    ),
    state(
        "20",
        "the Lambertian surface",
        r"\hat\rho(\theta_i') = \tfrac{1}{2} \cos\theta_i'",
    ),
    state(
        "21",
        "its odd terms",
        r"\hat\rho_{\pm 1} = \tfrac{1}{8} , \qquad \hat\rho_{2p+1} = 0 \quad (|2p+1| > 1)",
    ),
    state(
        "22",
        "its even terms",
        r"\hat\rho_{2p} = \frac{(-1)^{p+1}}{2\pi \, (4p^2 - 1)}",
    ),
    state(
        "23",
        "light that cannot be seen",
        r"\int_{-\pi/2}^{\pi/2} \cos 3(\alpha + \theta_i') \cos\theta_i' \, \mathrm{d}\theta_i' = 0 , \qquad \sin 3x \cos x = \tfrac{1}{2} \left( \sin 4x + \sin 2x \right)",
    ),
    state(
        "24",
        "inverse BRDF",
        r"\hat\rho_{p,q} = \frac{1}{2\pi} \frac{B_{-p,q}}{L_{-p}}",
    ),
    state(
        "25",
        "a directional source",
        r"L(\theta_i) = \delta(\theta_i) , \qquad L_p = \frac{1}{2\pi}",
    ),
    state("26", "under it, in frequency", r"B_{p,q} = \hat\rho_{-p,q}"),
    state(
        "27",
        "under it, in angle",
        r"B(\alpha, \theta_o') = \hat\rho(-\alpha, \theta_o')",
    ),
    state(
        "28",
        "uniform light",
        r"L = \frac{1}{2\pi} , \qquad L_0 = \frac{1}{2\pi} , \qquad \hat\rho_{0,q} = B_{0,q}",
    ),
    state(
        "29",
        "light and BRDF from the light field alone",
        r"\frac{L_p}{L_0} = \frac{\tilde{B}_{p,0}}{\tilde{B}_{0,-p}} , \qquad L_p = L_{-q} \frac{\tilde{B}_{p,q}}{\tilde{B}_{-q,-p}}",
    ),
    state(
        "30",
        "the Lambertian light field",
        r"B_{2p} = \frac{(-1)^{p+1}}{4p^2 - 1} \, L_{2p}",
    ),
    state(
        "31",
        "the Phong lobe",
        r"\rho = \cos^\beta(\theta_i' + \theta_o') , \qquad \hat\rho_{-p}(0) = \frac{\Gamma(2 + \beta)}{4 \cdot 2^\beta \, \Gamma\!\left(\frac{3 - p + \beta}{2}\right) \Gamma\!\left(\frac{3 + p + \beta}{2}\right)}",
    ),
    state(
        "32",
        "where it vanishes, and how it falls off",
        r"\hat\rho_{\pm(\beta + 3 + 2k)} = 0 , \qquad |\hat\rho_p| \sim |p|^{-(2 + \beta)} \quad (|p| > \beta + 3)",
    ),
    state(
        "33",
        "what it is for low frequencies",
        r"\hat\rho_p \approx \hat\rho_0 \, e^{-p^2 / (2(\beta + 3))} \quad (|p| \ll \beta)",
    ),
    state(
        "figure 3",
        "the spectra of three Phong lobes",
        r"|\hat\rho_p(0)| , \qquad \beta = 0, 8, 128",
    ),
    state(
        "microfacet",
        "the microfacet distribution",
        r"\rho = e^{-((\theta_i' + \theta_o')/2)^2 / (2m^2)} , \qquad \hat\rho_p \sim e^{-2 m^2 p^2}",
    ),
    state(
        "§5.3",
        "the order that can be recovered",
        r"p_{\max} \sim \sqrt{\beta}",
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_33_equations_and_figure_3_are_stated_once() {
        let mut numbers = Vec::new();
        for statement in &STATEMENTS {
            let ends: Vec<u32> = statement
                .equation
                .split('–')
                .filter_map(|n| n.parse().ok())
                .collect();
            match ends.as_slice() {
                [] => {}
                [one] => numbers.push(*one),
                [first, .., last] => {
                    for n in *first..=*last {
                        // A range names each of its numbers.
                        assert!(statement.title.contains(&n.to_string()), "{n}");
                        numbers.push(n);
                    }
                }
            }
        }
        assert_eq!(numbers, (1..=33).collect::<Vec<u32>>());
        assert!(STATEMENTS.iter().any(|s| s.equation == "figure 3"));
        for (_, first) in SECTIONS {
            assert!(STATEMENTS.iter().any(|s| s.equation == first));
        }
    }
}
