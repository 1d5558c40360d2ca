//! Tissues by name: Young's modulus, Poisson's ratio and density, each with where it comes from.
//!
//! What the numbers are:
//! - **Young's modulus** is that of healthy human tissue at small strain, loaded slowly, as one figure for a material that
//!   is taken as linear and isotropic. Every entry gives the range found in its sources. Ranges are wide because tissue
//!   stiffens with strain, rate, age and blood pressure and because methods disagree: the spleen differs sevenfold between
//!   two studies of living people. Elastography measures the speed of shear waves of 50 Hz or more; the modulus is
//!   `3 density speed^2`, somewhat above the static one.
//! - **Poisson's ratio** of soft tissue is close to 1/2, and sources say no more than "nearly incompressible". Every such
//!   entry has 0.45, the low end of what finite-element models use: an explicit step pays for every further digit. At 0.49
//!   the step is half that at 0.45 without dampers, and a quarter with a damping ratio of 0.2.
//! - **Density** is that of reference persons of radiation dosimetry.
//!
//! Not promised: the stiffness of a patient. Nor that of an organ with a wall: the entries of hollow organs and vessels are
//! those of the wall, pulled along itself, while a label in a CT mostly holds what fills it and is softer as a whole.

use std::fmt;

/// A tissue and its constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tissue {
    /// Its name in scenes: lower case, words joined by `_`.
    pub name: &'static str,
    /// Other names it is found by, in the same spelling.
    pub synonyms: &'static [&'static str],
    /// Young's modulus [Pa].
    pub youngs_modulus: f64,
    /// Lowest and highest Young's modulus of the sources [Pa].
    pub youngs_modulus_range: [f64; 2],
    /// Poisson's ratio.
    pub poissons_ratio: f64,
    /// Density [kg/m^3].
    pub density: f64,
    /// How the value was chosen among the sources, and what to beware of.
    pub note: &'static str,
    /// What was measured where: author, title, journal or book, year.
    pub sources: &'static [&'static str],
}

/// The tissue of a name or synonym; letter case does not matter, and blanks and hyphens count as `_`.
pub fn tissue(name: &str) -> Option<&'static Tissue> {
    let name = name.trim().to_lowercase().replace([' ', '-'], "_");
    TISSUES.iter().find(|tissue| tissue.name == name || tissue.synonyms.contains(&name.as_str()))
}

/// All tissues, by ascending name.
pub fn tissues() -> &'static [Tissue] {
    TISSUES
}

impl fmt::Display for Tissue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.youngs_modulus_range.map(pascal);
        let modulus = pascal(self.youngs_modulus);
        let Self { name, poissons_ratio, density, .. } = self;
        write!(f, "{name}: {modulus} ({low} to {high}), Poisson's ratio {poissons_ratio}, {density} kg/m3")
    }
}

/// A modulus in the unit that keeps it short.
fn pascal(value: f64) -> String {
    let (scale, unit) = match value {
        v if v >= 1e9 => (1e9, "GPa"),
        v if v >= 1e6 => (1e6, "MPa"),
        v if v >= 1e3 => (1e3, "kPa"),
        _ => (1.0, "Pa"),
    };
    format!("{} {unit}", (value / scale * 1e3).round() / 1e3)
}

/// The customary "nearly incompressible" of soft tissue, see the head of this module.
const NEARLY_INCOMPRESSIBLE: f64 = 0.45;
/// Customary for bone, and what its indentation tests assume.
const BONE_RATIO: f64 = 0.3;

const WOODARD: &str = "density: Woodard and White, The composition of body tissues, Br. J. Radiol. 59 (1986) 1209; the \
                       same figures in ICRU Report 46 (1992)";
const ICRP: &str =
    "density: ICRP Publication 110, Adult reference computational phantoms, Ann. ICRP 39 (2009), Annex B";
const RATIO: &str = "Poisson's ratio: Current Poisson's ratio values of finite element models are too low to consider \
                     soft tissues nearly-incompressible: illustration on the human heel region (arXiv), which finds \
                     0.45 to 0.4999 in use and 0.49 the best for fat under a heel";
const BONE_RATIO_SOURCE: &str = "Poisson's ratio: assumed 0.3 in Zysset et al., Elastic modulus and hardness of cortical \
                                 and trabecular bone lamellae measured by nanoindentation in the human femur, J. Biomech. \
                                 32 (1999) 1005";
const ARDA: &str = "Arda et al., Quantitative assessment of normal soft-tissue elasticity using shear-wave ultrasound \
                    elastography, AJR Am. J. Roentgenol. 197 (2011) 532: 127 healthy volunteers";
const VICECONTI: &str = "Viceconti et al., Shear wave elastography in healthy patients: Pancreatic stiffness is less \
                         reliable than liver and spleen measurements, World J. Radiol. 17 (2025) 111651: mean of 50 \
                         healthy volunteers with three methods: liver 3.9 to 4.7 kPa, spleen 19.4 to 23.0 kPa, pancreas \
                         5.2 to 7.6 kPa";

#[rustfmt::skip] // One fact per line.
const TISSUES: &[Tissue] = &[
    Tissue {
        name: "aorta",
        synonyms: &["artery", "blood_vessel", "vessel", "vessels"],
        youngs_modulus: 5e5,
        youngs_modulus_range: [6e4, 1.5e6],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1050.0,
        note: "Wall of a large artery stretched by the pressure of blood; uncertain by a factor of three. The low end is \
               the unstretched wall under an indenter. Veins are softer.",
        sources: &[
            "Learoyd and Taylor, Alterations with age in the viscoelastic properties of human arterial walls, Circ. Res. \
             18 (1966) 278: 1e5 to 1e6 Pa in order of magnitude, rising with pressure and age",
            "Hemmasizadeh, Autieri and Darvish, Multilayer material properties of aorta determined from nanoindentation \
             tests, J. Mech. Behav. Biomed. Mater. 15 (2012) 199: 60 kPa (inner half) and 70 kPa (outer half), pig",
            WOODARD, RATIO,
        ],
    },
    Tissue {
        name: "bladder",
        synonyms: &["urinary_bladder"],
        youngs_modulus: 1.9e6,
        youngs_modulus_range: [1e6, 4.1e6],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1040.0,
        note: "Wall, pulled until it is taut; slack it is far softer. A full bladder in a CT is mostly urine.",
        sources: &[
            "Martins et al., Uniaxial mechanical behavior of the human female bladder, Int. Urogynecol. J. 22 (2011) 991: \
             1 to 4.1 MPa, mean 1.9 MPa",
            ICRP, RATIO,
        ],
    },
    Tissue {
        name: "bone",
        synonyms: &["compact_bone", "cortical_bone"],
        youngs_modulus: 1.7e10,
        youngs_modulus_range: [1.15e10, 2.07e10],
        poissons_ratio: BONE_RATIO,
        density: 1920.0,
        note: "Cortical bone along its osteons; 11.5 GPa across them. Three million times stiffer than liver, \
               so its step is a thousand times smaller: beside soft organs give bone as rigid.",
        sources: &[
            "Reilly and Burstein, The elastic and ultimate properties of compact bone tissue, J. Biomech. 8 (1975) 393: \
             17.0 GPa along, 11.5 GPa across",
            "Rho, Ashman and Turner, Young's modulus of trabecular and cortical bone material: ultrasonic and \
             microtensile measurements, J. Biomech. 26 (1993) 111: 18.6 GPa (tension), 20.7 GPa (ultrasound)",
            WOODARD, BONE_RATIO_SOURCE,
        ],
    },
    Tissue {
        name: "bowel",
        synonyms: &["colon", "duodenum", "intestine", "large_bowel", "small_bowel"],
        youngs_modulus: 2.4e5,
        youngs_modulus_range: [1.8e5, 5.2e6],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1030.0,
        note: "Wall, mean of both directions in the slack part of the curve; the high end is taut human colon. A loop \
               filled with gas or chyme is softer as a whole by orders of magnitude.",
        sources: &[
            "Terry, Wang, Schoen and Rentschler, A preconditioning protocol and biaxial mechanical measurement of the \
             small intestine, Int. J. Exp. Comput. Biomech. 2 (2014): 307 kPa along, 180 kPa around; taut 2.2 and 1.4 \
             MPa, pig",
            "Christensen, Oberg and Wolchok, Tensile properties of the rectal and sigmoid colon: a comparative analysis \
             of human and porcine tissue, SpringerPlus 4 (2015) 142: taut 5.2 MPa, human",
            WOODARD, RATIO,
        ],
    },
    Tissue {
        name: "brain",
        synonyms: &[],
        youngs_modulus: 1.6e3,
        youngs_modulus_range: [1.1e3, 2.5e3],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1040.0,
        note: "Mean of grey (1.4 kPa) and white matter (1.9 kPa); the range is one standard deviation around them.",
        sources: &[
            "Budday et al., Mechanical properties of gray and white matter brain tissue by indentation, J. Mech. Behav. \
             Biomed. Mater. 46 (2015) 318: cattle",
            WOODARD, RATIO,
        ],
    },
    Tissue {
        name: "cartilage",
        synonyms: &["costal_cartilage"],
        youngs_modulus: 1.1e7,
        youngs_modulus_range: [5.5e6, 5.1e7],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1100.0,
        note: "Of the ribs, indented to 5 % strain; the high end is compression. Articular cartilage is ten times softer \
               when loaded slowly.",
        sources: &[
            "Weber, Rothschild and Niehoff, Anisotropic and age-dependent elastic material behavior of the human costal \
             cartilage, Sci. Rep. 11 (2021): 11.1 +- 5.6 MPa indented, 32.9 +- 17.9 MPa compressed",
            WOODARD, RATIO,
        ],
    },
    Tissue {
        name: "fat",
        synonyms: &["adipose", "adipose_tissue", "subcutaneous_fat", "visceral_fat"],
        youngs_modulus: 2.5e3,
        youngs_modulus_range: [1e3, 4.2e3],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 950.0,
        note: "Between breast fat (3.3 kPa) and fat below the skin (1.6 kPa).",
        sources: &[
            "Samani, Zubovits and Plewes, Elastic moduli of normal and pathological human breast tissues: an \
             inversion-technique-based investigation of 169 samples, Phys. Med. Biol. 52 (2007) 1565: 3.25 +- 0.91 kPa",
            "Sims et al., Elastic and viscoelastic properties of porcine subdermal fat using MRI and inverse FEA, \
             Biomech. Model. Mechanobiol. 9 (2010) 703: shear modulus 0.53 +- 0.31 kPa",
            "Comley and Fleck, A micromechanical model for the Young's modulus of adipose tissue, Int. J. Solids Struct. \
             47 (2010) 2982: of the order of 1 kPa, pig",
            WOODARD, RATIO,
        ],
    },
    Tissue {
        name: "gallbladder",
        synonyms: &["gall_bladder"],
        youngs_modulus: 4.5e5,
        youngs_modulus_range: [2.3e5, 6.7e5],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1030.0,
        note: "Wall, mean of both directions, one study. A gallbladder in a CT is mostly bile.",
        sources: &[
            "Karimi, Shojaei and Tehrani, Measurement of the mechanical properties of the human gallbladder, J. Med. Eng. \
             Technol. 41 (2017) 541: 641 kPa along, 255 kPa across",
            ICRP, RATIO,
        ],
    },
    Tissue {
        name: "heart",
        synonyms: &["heart_muscle", "myocardium"],
        youngs_modulus: 1.2e4,
        youngs_modulus_range: [5.3e3, 1.8e4],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1050.0,
        note: "Relaxed (diastolic) muscle of the left ventricle, three times the shear modulus that was measured; it \
               doubles with age and is many times stiffer when it contracts.",
        sources: &[
            "Villemain et al., Myocardial stiffness evaluation using noninvasive shear wave imaging in healthy and \
             hypertrophic cardiomyopathic adults, JACC Cardiovasc. Imaging 12 (2019) 1135: 2.6, 4.7 and 6.1 kPa for \
             adults around 30, 50 and 70 years",
            "Song et al., Quantitative assessment of left ventricular diastolic stiffness using cardiac shear wave \
             elastography, J. Ultrasound Med. 35 (2016) 1419: speeds of 1.29 to 1.96 m/s",
            WOODARD, RATIO,
        ],
    },
    Tissue {
        name: "kidney",
        synonyms: &["kidneys"],
        youngs_modulus: 5e3,
        youngs_modulus_range: [2.1e3, 2.4e4],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1050.0,
        note: "Cortex; the high end is the region of the pelvis.",
        sources: &[ARDA, "there: renal cortex 5.0 +- 2.9 kPa, renal pelvis 23.6 +- 5.4 kPa", WOODARD, RATIO],
    },
    Tissue {
        name: "liver",
        synonyms: &[],
        youngs_modulus: 5e3,
        youngs_modulus_range: [5e2, 8.5e3],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1060.0,
        note: "In the body, with blood in it. The low end is cut samples; a cirrhotic liver reaches several tens of kPa.",
        sources: &[
            "Fung et al., Defining normal liver stiffness range in a normal healthy Chinese population without liver \
             disease, PLoS ONE 8 (2013) e85067: mean 4.1 kPa, 2.3 to 5.9 kPa",
            "Das et al., \"Normal\" liver stiffness measure (LSM) values are higher in both lean and obese individuals: a \
             population-based study from a developing country, Hepatology 55 (2012) 584: 3.2 to 8.5 kPa",
            "Yeh et al., Elastic modulus measurements of human liver and correlation with pathology, Ultrasound Med. \
             Biol. 28 (2002) 467: hundreds to thousands of Pa, cut samples",
            WOODARD, RATIO,
        ],
    },
    Tissue {
        name: "lung",
        synonyms: &["lung_parenchyma", "lungs"],
        youngs_modulus: 2e3,
        youngs_modulus_range: [7.5e2, 5e3],
        poissons_ratio: 0.43,
        density: 260.0,
        note: "Half inflated, at 1.2 kPa; the modulus is 1.5 to 2 times the pressure that inflates it, which goes from \
               0.5 kPa (breathed out) to 2.5 kPa (full breath). Density of the inflated lung; collapsed 1050 kg/m3.",
        sources: &[
            "Lai-Fook, Wilson, Hyatt and Rodarte, Elastic constants of inflated lobes of dog lungs, J. Appl. Physiol. 40 \
             (1976) 508: modulus and Poisson's ratio",
            WOODARD,
        ],
    },
    Tissue {
        name: "muscle",
        synonyms: &["skeletal_muscle"],
        youngs_modulus: 1.1e4,
        youngs_modulus_range: [6.7e3, 4.4e4],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1050.0,
        note: "At rest, calf and jaw; the high end is a shoulder muscle. Stiffer along its fibres and when it contracts.",
        sources: &[
            ARDA, "there: gastrocnemius 11.1 +- 4.1 kPa, masseter 10.4 +- 3.7 kPa, supraspinatus 31.2 +- 13 kPa",
            WOODARD, RATIO,
        ],
    },
    Tissue {
        name: "pancreas",
        synonyms: &[],
        youngs_modulus: 5e3,
        youngs_modulus_range: [1.8e3, 7.8e3],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1040.0,
        note: "Deep and moved by the pulse, so hard to measure.",
        sources: &[ARDA, "there: pancreas 4.8 +- 3 kPa", VICECONTI, WOODARD, RATIO],
    },
    Tissue {
        name: "skin",
        synonyms: &[],
        youngs_modulus: 1e5,
        youngs_modulus_range: [5e3, 1.4e8],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1090.0,
        note: "The order of magnitude of suction in the living; indentation gives the low end, pulled strips the high \
               one, so any single number is a choice.",
        sources: &[
            "Kalra, Lowe and Al-Jumaily, Mechanical behaviour of skin: a review, J. Mater. Sci. Eng. 5 (2016): 5 kPa to \
             140 MPa",
            "Briot et al., In vivo measurement of breast tissues stiffness using a light aspiration device, Clin. \
             Biomech. (2022): 56 +- 16 kPa",
            "Diridollou et al., In vivo model of the mechanical properties of the human skin under suction, Skin Res. \
             Technol. 6 (2000) 214: of the order of 100 kPa",
            WOODARD, RATIO,
        ],
    },
    Tissue {
        name: "spleen",
        synonyms: &[],
        youngs_modulus: 1e4,
        youngs_modulus_range: [1.1e3, 2.3e4],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1060.0,
        note: "Two studies of living people, 2.9 and 21 kPa, contradict each other; the value lies between them.",
        sources: &[ARDA, "there: spleen 2.9 +- 1.8 kPa", VICECONTI, WOODARD, RATIO],
    },
    Tissue {
        name: "stomach",
        synonyms: &[],
        youngs_modulus: 1e4,
        youngs_modulus_range: [1.7e3, 3.7e5],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1030.0,
        note: "Wall under slight pressure, between its muscle (17 kPa) and its mucosa (1.7 kPa); the high end is a strip \
               pulled to breaking. Uncertain by an order of magnitude.",
        sources: &[
            "Dargar, Rahul, Kruger and De, In vivo layer-specific mechanical characterization of porcine stomach tissue, \
             J. Biomech. Eng. 141 (2019) 101004: shear moduli of 5.7 (muscle), 3.0 (submucosa), 0.56 kPa (mucosa), pig",
            "Lim, Deo, Singh, Jones and De, In situ measurement and modeling of biomechanical response of human cadaveric \
             soft tissues for physics-based surgical simulation, Surg. Endosc. 23 (2009) 1298: 1.9 kPa",
            "Egorov, Schastlivtsev, Prut, Baranov and Turusov, Mechanical properties of the human gastrointestinal tract, \
             J. Biomech. 35 (2002) 1417: breaks at 0.5 to 0.7 MPa and 190 %",
            WOODARD, RATIO,
        ],
    },
    Tissue {
        name: "thyroid",
        synonyms: &["thyroid_gland"],
        youngs_modulus: 1.1e4,
        youngs_modulus_range: [7.9e3, 1.4e4],
        poissons_ratio: NEARLY_INCOMPRESSIBLE,
        density: 1050.0,
        note: "One study.",
        sources: &[ARDA, "there: thyroid 10.97 +- 3.1 kPa", WOODARD, RATIO],
    },
    Tissue {
        name: "trabecular_bone",
        synonyms: &["cancellous_bone", "spongy_bone"],
        youngs_modulus: 3e8,
        youngs_modulus_range: [1e5, 9.8e8],
        poissons_ratio: BONE_RATIO,
        density: 1180.0,
        note: "Of vertebrae, with marrow. Depends on site and goes with a power of density of about two.",
        sources: &[
            "Kopperdahl and Keaveny, Yield strain behavior of trabecular bone, J. Biomech. 31 (1998) 601: vertebrae, of \
             the order of 300 MPa",
            "Öhman-Mägi et al., Density and mechanical properties of vertebral trabecular bone: a review, JOR Spine 4 \
             (2021): 0.1 to 976 MPa",
            "Morgan, Bayraktar and Keaveny, Trabecular bone modulus-density relationships depend on anatomic site, J. \
             Biomech. 36 (2003) 897: exponents 1.49 to 2.18",
            WOODARD, BONE_RATIO_SOURCE,
        ],
    },
];

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn names_are_sorted_and_lead_to_one_tissue_each() {
        assert!(tissues().windows(2).all(|pair| pair[0].name < pair[1].name));
        let mut seen = BTreeSet::new();
        for known in tissues() {
            for &name in std::iter::once(&known.name).chain(known.synonyms) {
                assert!(name.chars().all(|c| c.is_ascii_lowercase() || c == '_'), "{name}");
                assert!(seen.insert(name), "{name} twice");
                assert_eq!(tissue(name), Some(known));
            }
        }
        assert!(seen.len() > 30, "{seen:?}");
    }

    #[test]
    fn spelling_of_a_name_is_lenient_but_not_the_name() {
        for name in ["bowel", "Intestine", " small bowel", "SMALL-BOWEL"] {
            assert_eq!(tissue(name).map(|tissue| tissue.name), Some("bowel"), "{name}");
        }
        for name in ["", "_", "live", "livers", "bone marrow"] {
            assert_eq!(tissue(name), None, "{name}");
        }
    }

    #[test]
    fn numbers_are_those_of_tissue() {
        for tissue in tissues() {
            let [low, high] = tissue.youngs_modulus_range;
            assert!(low < high && (low..=high).contains(&tissue.youngs_modulus), "{tissue}");
            assert!((100.0..=3e10).contains(&low) && high <= 3e10, "{tissue}");
            // What a scene takes, and no entry whose volume term would be negative.
            assert!((0.25..=0.49).contains(&tissue.poissons_ratio), "{tissue}");
            assert!((200.0..=2000.0).contains(&tissue.density), "{tissue}");
        }
        let density = |name| tissue(name).unwrap().density;
        assert!(density("lung") < density("fat") && density("fat") < 1000.0 && density("muscle") < density("bone"));
        let modulus = |name| tissue(name).unwrap().youngs_modulus;
        assert!(modulus("fat") < modulus("liver") && modulus("liver") < modulus("trabecular_bone"));
        assert!(modulus("trabecular_bone") < modulus("bone"));
    }

    #[test]
    fn every_number_has_a_source_with_a_year() {
        for tissue in tissues() {
            assert!(tissue.note.ends_with('.') && tissue.note.len() > 5, "{tissue}");
            let cites = |start: &str| tissue.sources.iter().any(|source| source.starts_with(start));
            assert!(cites("density: "), "{tissue}");
            // The lung's comes from the same tests as its modulus.
            let lung = tissue.sources[0].ends_with("modulus and Poisson's ratio");
            assert!(cites("Poisson's ratio: ") || lung, "{tissue}");
            let of_modulus =
                |source: &&&str| !source.starts_with("density: ") && !source.starts_with("Poisson's ratio: ");
            let dated = |source: &&str| source.contains("(19") || source.contains("(20");
            assert!(tissue.sources.iter().filter(of_modulus).any(dated), "{tissue}");
        }
    }

    #[test]
    fn a_tissue_prints_on_one_line() {
        let shown = tissue("liver").unwrap().to_string();
        assert_eq!(shown, "liver: 5 kPa (500 Pa to 8.5 kPa), Poisson's ratio 0.45, 1060 kg/m3");
        let bone = tissue("bone").unwrap().to_string();
        assert_eq!(bone, "bone: 17 GPa (11.5 GPa to 20.7 GPa), Poisson's ratio 0.3, 1920 kg/m3");
    }
}
