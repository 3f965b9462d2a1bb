"""Where the limits and the formulas come from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reference:
    """A source: what it is cited for, authors and title, place, digital object identifier or address ("" if none)."""

    key: str
    used: str
    text: str
    link: str


REFERENCES: tuple[Reference, ...] = (
    Reference(
        "hicks2015",
        "limits on marker errors and residuals",
        "Hicks JL, Uchida TK, Seth A, Rajagopal A, Delp SL (2015). Is my model good enough? Best practices for "
        "verification and validation of musculoskeletal models and simulations of movement. J Biomech Eng 137:020905.",
        "https://doi.org/10.1115/1.4029304",
    ),
    Reference(
        "opensim",
        "limit on reserve actuators; inverse kinematics, inverse dynamics and static optimization as defined there",
        "Delp SL, Anderson FC, Arnold AS, Loan P, Habib A, John CT, Guendelman E, Thelen DG (2007). OpenSim: "
        "open-source software to create and analyze dynamic simulations of movement. IEEE Trans Biomed "
        "Eng 54:1940–1950; and the "
        "simulation checklist of its user's guide.",
        "https://doi.org/10.1109/TBME.2007.901024",
    ),
    Reference(
        "lu1999",
        "inverse kinematics as one least-squares problem over all markers",
        "Lu TW, O'Connor JJ (1999). Bone position estimation from skin marker co-ordinates using global optimisation "
        "with joint constraints. J Biomech 32:129–134.",
        "https://doi.org/10.1016/S0021-9290(98)00158-4",
    ),
    Reference(
        "featherstone2008",
        "inverse dynamics by the recursive Newton-Euler algorithm",
        "Featherstone R (2008). Rigid Body Dynamics Algorithms. Springer, chapter 5.",
        "https://doi.org/10.1007/978-1-4899-7560-7",
    ),
    Reference(
        "woltring1986",
        "derivatives of the motion by splines",
        "Woltring HJ (1986). A Fortran package for generalized, cross-validatory spline smoothing and differentiation. "
        "Adv Eng Softw 8:104–113.",
        "https://doi.org/10.1016/0141-1195(86)90098-7",
    ),
    Reference(
        "crowninshield1981",
        "muscle forces by static optimization",
        "Crowninshield RD, Brand RA (1981). A physiologically based criterion of muscle force prediction in "
        "locomotion. J Biomech 14:793–801.",
        "https://doi.org/10.1016/0021-9290(81)90035-X",
    ),
    Reference(
        "millard2013",
        "muscle force from length, velocity and activation",
        "Millard M, Uchida T, Seth A, Delp SL (2013). Flexing computational muscle: modeling and simulation of "
        "musculotendon dynamics. J Biomech Eng 135:021005.",
        "https://doi.org/10.1115/1.4023390",
    ),
    Reference(
        "owen2014",
        "onset of a jump: five standard deviations of quiet standing, less 30 ms",
        "Owen NJ, Watkins J, Kilduff LP, Bevan HR, Bennett MA (2014). Development of a criterion method to determine "
        "peak mechanical power output in a countermovement jump. J Strength Cond Res 28:1552–1558.",
        "https://doi.org/10.1519/JSC.0000000000000311",
    ),
    Reference(
        "mcmahon2018",
        "phases of a countermovement jump",
        "McMahon JJ, Suchomel TJ, Lake JP, Comfort P (2018). Understanding the key phases of the countermovement jump "
        "force-time curve. Strength Cond J 40:96–106.",
        "https://doi.org/10.1519/SSC.0000000000000375",
    ),
    Reference(
        "dissertation",
        "identification of lengths and masses; the tables and figures here are those of its chapter 3 ([D])",
        "Subject-specific inertia modeling based on geometric morphing of skin. Chapter 3 of a dissertation on "
        "subject-specific musculoskeletal modeling; equations 3.1 to 3.15, tables 3.1 to 3.5, figure 3.3.",
        "",
    ),
    Reference(
        "experts",
        "analysis of a motion: center of gravity, contacts and muscles of experts ([D])",
        "Motion analysis with contact force estimation, and analysis of masters' skills from musculoskeletal "
        "estimation. Chapters 4 and 5 of a dissertation on subject-specific musculoskeletal modeling.",
        "",
    ),
    Reference(
        "bartlett1946",
        "confidence of a period",
        "Bartlett MS (1946). On the theoretical specification and sampling properties of autocorrelated time-series. "
        "Suppl J R Stat Soc 8:27–41.",
        "https://doi.org/10.2307/2983611",
    ),
    Reference(
        "mcleod2005",
        "autocorrelation of a signal after one period",
        "McLeod P, Wyvill G (2005). A smarter way to find pitch. Proc Int Comput Music Conf, 138–141.",
        "",
    ),
    Reference(
        "bartlett1935",
        "effective number of samples of a correlation",
        "Bartlett MS (1935). Some aspects of the time-correlation problem in regard to tests of significance. "
        "J R Stat Soc 98:536–543.",
        "https://doi.org/10.2307/2342284",
    ),
    Reference(
        "benjamini1995",
        "which of many correlations are significant",
        "Benjamini Y, Hochberg Y (1995). Controlling the false discovery rate: a practical and powerful approach to "
        "multiple testing. J R Stat Soc B 57:289–300.",
        "https://doi.org/10.1111/j.2517-6161.1995.tb02031.x",
    ),
    Reference(
        "nichols2002",
        "permutation tests of curves, corrected by the maximum statistic",
        "Nichols TE, Holmes AP (2002). Nonparametric permutation tests for functional neuroimaging: a primer with "
        "examples. Hum Brain Mapp 15:1–25.",
        "https://doi.org/10.1002/hbm.1058",
    ),
    Reference(
        "tusher2001",
        "the constant in the statistic along a curve",
        "Tusher VG, Tibshirani R, Chu G (2001). Significance analysis of microarrays applied to the ionizing radiation "
        "response. Proc Natl Acad Sci 98:5116–5121.",
        "https://doi.org/10.1073/pnas.091062498",
    ),
    Reference(
        "holm1979",
        "correction for the number of parameters",
        "Holm S (1979). A simple sequentially rejective multiple test procedure. Scand J Stat 6:65–70.",
        "",
    ),
    Reference(
        "hedges1981",
        "effect size of small groups",
        "Hedges LV (1981). Distribution theory for Glass's estimator of effect size and related estimators. "
        "J Educ Stat 6:107–128.",
        "https://doi.org/10.3102/10769986006002107",
    ),
    Reference(
        "zeni2008",
        "foot strike and foot off from markers",
        "Zeni JA, Richards JG, Higginson JS (2008). Two simple methods for determining gait events during treadmill "
        "and overground walking using kinematic data. Gait Posture 27:710–714.",
        "https://doi.org/10.1016/j.gaitpost.2007.07.007",
    ),
    Reference(
        "zar1999",
        "test of phase locking",
        "Zar JH (1999). Biostatistical Analysis, 4th edition. Prentice Hall, chapter 27.",
        "",
    ),
    Reference(
        "ayusawa2014",
        "identification of masses from the wrench on the base link",
        "Ayusawa K, Venture G, Nakamura Y (2014). Identifiability and identification of inertial parameters using the "
        "underactuated base-link dynamics for legged multibody systems. Int J Robot Res 33:446–468.",
        "",
    ),
    Reference(
        "ae1992",
        "segment masses of Japanese male athletes",
        "Ae M, Tang H, Yokoi T (1992). Estimation of inertia properties of the body segments in Japanese athletes. "
        "Biomechanisms 11:23–33.",
        "https://www.dh.aist.go.jp/database/properties/segment/e-k-06.html",
    ),
    Reference(
        "wensing2018",
        "physical consistency of the inertial parameters of a link",
        "Wensing PM, Kim S, Slotine JE (2018). Linear matrix inequalities for physically consistent inertial parameter "
        "identification: a statistical perspective on the mass distribution. IEEE Robot Autom Lett 3:60–67.",
        "https://doi.org/10.1109/LRA.2017.2729659",
    ),
    Reference(
        "murai2016",
        "the experiment, its three steps and tables I and II ([S])",
        "Murai A, Kawano Y, Ayusawa K, Tada M, Matsumura N, Nagura T. In-vitro identification of shoulder joint and "
        "muscle dynamics based on motion capture and musculoskeletal computation. Equations 1 to 3, tables I and II.",
        "",
    ),
    Reference(
        "stroeve1999",
        "viscosity of a shoulder with its muscles, 0.2 N·m·s/rad, as [S] cites it",
        "Stroeve S (1999). Impedance characteristics of a neuromusculoskeletal model of the human arm I. Posture "
        "control. Biol Cybern 81:475–494.",
        "",
    ),
    Reference(
        "cameron2008",
        "intervals: a wild bootstrap over blocks of swings",
        "Cameron AC, Gelbach JB, Miller DL (2008). Bootstrap-based improvements for inference with clustered errors. "
        "Rev Econ Stat 90:414–427; after Wu CFJ (1986), Ann Stat 14:1261–1295.",
        "https://doi.org/10.1162/rest.90.3.414",
    ),
    Reference(
        "iglewicz1993",
        "outliers: modified z-score above 3.5",
        "Iglewicz B, Hoaglin DC (1993). How to detect and handle outliers. ASQC Basic References in Quality Control, "
        "volume 16.",
        "",
    ),
)

MORPHING: tuple[Reference, ...] = (
    Reference(
        "morphing",
        "muscles from the shape of bones: feature points, local transforms blended by distance, virtual links, another "
        "species in two steps ([D])",
        "Subject-specific musculoskeletal modeling based on geometric morphing. Chapters 2, 6 and 7 of a dissertation "
        "on subject-specific musculoskeletal modeling, of which outlines are published; the equations are those of the "
        "documentation.",
        "",
    ),
    Reference(
        "umeyama1991",
        "the similarity that brings points onto others",
        "Umeyama S (1991). Least-squares estimation of transformation parameters between two point patterns. IEEE "
        "Trans Pattern Anal Mach Intell 13:376–380.",
        "https://doi.org/10.1109/34.88573",
    ),
    Reference(
        "shepard1968",
        "weights by the inverse distance",
        "Shepard D (1968). A two-dimensional interpolation function for irregularly-spaced data. Proc 23rd ACM "
        "National Conference, 517–524.",
        "https://doi.org/10.1145/800186.810616",
    ),
    Reference(
        "lewis2000",
        "skeletal subspace deformation",
        "Lewis JP, Cordner M, Fong N (2000). Pose space deformation: a unified approach to shape interpolation and "
        "skeleton-driven deformation. Proc SIGGRAPH, 165–172.",
        "https://doi.org/10.1145/344779.344862",
    ),
    Reference(
        "carr2001",
        "radial basis functions with an affine part, and smoothing",
        "Carr JC, Beatson RK, Cherrie JB, Mitchell TJ, Fright WR, McCallum BC, Evans TR (2001). Reconstruction and "
        "representation of 3D objects with radial basis functions. Proc SIGGRAPH, 67–76.",
        "https://doi.org/10.1145/383259.383266",
    ),
    Reference(
        "amberg2007",
        "dense correspondence of two bones",
        "Amberg B, Romdhani S, Vetter T (2007). Optimal step nonrigid ICP algorithms for surface registration. IEEE "
        "Conf Computer Vision and Pattern Recognition.",
        "https://doi.org/10.1109/CVPR.2007.383165",
    ),
    Reference(
        "modenese2016",
        "fiber and tendon lengths that keep the range in which fibers work",
        "Modenese L, Ceseracciu E, Reggiani M, Lloyd DG (2016). Estimation of musculotendon parameters for scaled and "
        "subject specific musculoskeletal models using an optimization technique. J Biomech 49:141–148.",
        "https://doi.org/10.1016/j.jbiomech.2015.11.006",
    ),
    Reference(
        "barill2018",
        "inside and outside of bones whose surfaces are not closed",
        "Barill G, Dickson NG, Schmidt R, Levin DIW, Jacobson A (2018). Fast winding numbers for soups and clouds. ACM "
        "Trans Graph 37:43.",
        "https://doi.org/10.1145/3197517.3201337",
    ),
    Reference(
        "pellikaan2014",
        "how far attachments carried from one body to another lie from those found in it: 13.3 mm on average, standard "
        "deviation 8.1 mm",
        "Pellikaan P, van der Krogt MM, Carbone V, Fluit R, Vigneron LM, Van Deun J, Verdonschot N, Koopman HFJM "
        "(2014). Evaluation of a morphing based method to estimate muscle attachment sites of the lower extremity. J "
        "Biomech 47:1144–1150.",
        "https://doi.org/10.1016/j.jbiomech.2013.12.010",
    ),
)

ANALYSIS = ("experts", "bartlett1946", "mcleod2005", "bartlett1935", "benjamini1995", "zar1999")


def references(
    kinematics: bool, dynamics: bool, tension: bool, jump: bool, identification: bool = False, analysis: bool = False
) -> tuple[Reference, ...]:
    """Those that a report with these parts relies on."""
    wanted = set() if identification and not (kinematics or dynamics or tension) else {"hicks2015", "opensim"}
    wanted |= {"lu1999"} if kinematics else set()
    wanted |= {"featherstone2008", "woltring1986"} if dynamics else set()
    wanted |= {"crowninshield1981", "millard2013"} if tension else set()
    wanted |= {"dissertation", "ayusawa2014", "ae1992", "wensing2018"} if identification else set()
    wanted |= {"owen2014", "mcmahon2018"} if jump else set()
    wanted |= set(ANALYSIS) if analysis else set()
    return tuple(one for one in REFERENCES if one.key in wanted)


def cited(*keys: str) -> tuple[Reference, ...]:
    """Sources in the order of their keys."""
    known = {one.key: one for one in (*REFERENCES, *MORPHING)}
    return tuple(known[key] for key in keys)
