"""What is measured for the pages of docs/validation, by page and section."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from benchmarks import fuzz
from benchmarks.accuracy import (
    analyses,
    analyze,
    calibration,
    calibration_static,
    calibration_zeros,
    certificates,
    conditions,
    contact_defaults,
    cutoff,
    elastic,
    elastic_convergence,
    emg,
    emg_faults,
    faults,
    groups,
    hands,
    hidden_plates,
    identification,
    identification_intervals,
    interrupted,
    kernels,
    kinematics,
    knee,
    live,
    live_limits,
    loop_forces,
    loops,
    marker_faults,
    masspoints,
    models,
    mouse,
    mouse_morphed,
    muscles,
    pair,
    passive,
    personalize,
    personalize_passive,
    reaction,
    recruitment,
    refine,
    refine_held_out,
    regressor,
    scale,
    setups,
    shape,
    shoulder,
    simulated,
    sound,
    stairs,
    strides,
    tension,
    tension_defaults,
    transfer,
    uncertainty,
    uncertainty_measured,
    unseen_faults,
    unseen_marker_faults,
    vendors,
)
from benchmarks.accuracy.morph import (
    articular,
    branches,
    clearing,
    correspondence,
    deformed_legs,
    demo,
    held_out,
    laws,
    masses,
    mirror,
    real_bones,
    shapes,
    species,
    species_arm,
    species_intervals,
    species_relative,
)
from benchmarks.accuracy.viscosity import calibrations, cohort, limbs, pendulum, scans, steps, tracking, trust, virtual
from benchmarks.cases import FORCE_CASES, MARKER_CASES

Row = dict[str, object]
Sections: TypeAlias = dict[str, Callable[[], Iterable[Row]]]


@dataclass(frozen=True)
class Page:
    """One page of docs/validation.

    Attributes
    ----------
    name : of its file
    title, lead : its heading, and one sentence below it
    sections : what measures each section, by the name of its text
    """

    name: str
    title: str
    lead: str
    sections: Sections


def pages(folder: Path) -> tuple[Page, ...]:
    """All pages in their order; `folder` holds the recordings."""
    return (
        _models(folder),
        _kinematics_and_dynamics(folder),
        _raw_recordings(folder),
        _opensim_setups(folder),
        _tensions(folder),
        _joint_loads(folder),
        _uncertainty(folder),
        _emg_and_sound(folder),
        _hands(folder),
        _faults(folder),
        _ground_forces(folder),
        _two_bodies(folder),
        _calibration(folder),
        _identification(folder),
        _personal(folder),
        _instruments(folder),
        _viscosity(folder),
        _bone_maps(folder),
        _real_bones(folder),
        _species(folder),
        _animals(folder),
        _studies(folder),
    )


def _models(folder: Path) -> Page:
    return Page(
        "models",
        "Models, kernels and muscle paths",
        "Files that open, kernels against Pinocchio, MuJoCo and OpenSim, lengths and moment arms.",
        {
            "models": lambda: models.measure(folder),
            "kernels": kernels.measure,
            "curved_knees": lambda: kernels.measure_curved_knee(folder),
            "muscles": lambda: muscles.measure(folder),
            "tendons": kernels.measure_tendons,
            "loops": lambda: loops.measure_constraints(folder),
            "loops_trees": loops.measure_trees,
            "loop_arms": lambda: loop_forces.measure_arms(folder),
        },
    )


def _kinematics_and_dynamics(folder: Path) -> Page:
    return Page(
        "kinematics-and-dynamics",
        "Inverse kinematics and inverse dynamics",
        "Against OpenSim's tools, and frame by frame against whole recordings.",
        {
            "inverse_kinematics": lambda: (
                kinematics.measure_inverse_kinematics(folder, case) for case in MARKER_CASES
            ),
            "loops_inverse_kinematics": lambda: loops.measure_inverse_kinematics(folder),
            "inverse_dynamics": lambda: (kinematics.measure_inverse_dynamics(folder, case) for case in FORCE_CASES),
            "cutoff": lambda: cutoff.measure(folder),
            "loop_torques": lambda: loop_forces.measure_torques(folder),
            "live": lambda: live.measure(folder),
            "live_markers": lambda: live.measure_losses(folder),
        },
    )


def _raw_recordings(folder: Path) -> Page:
    return Page(
        "raw-recordings",
        "From raw recordings to a report",
        "One command on recordings of many laboratories, beside each one's own joint moments.",
        {"analyze": lambda: analyze.measure(folder), "vendors": lambda: vendors.measure(folder)},
    )


def _opensim_setups(folder: Path) -> Page:
    return Page(
        "opensim-setups",
        "Setup files of OpenSim's tools",
        "Every setup of the collection, run by `myomorph run-tool` and by OpenSim 4.6.",
        {
            "scale": lambda: scale.measure(folder),
            "tools": lambda: scale.measure_tools(folder),
            "setups": lambda: setups.measure_setups(folder),
            "analyses": lambda: analyses.measure(folder),
        },
    )


def _tensions(folder: Path) -> Page:
    return Page(
        "tensions",
        "Muscle tensions and joint reactions",
        "Against OpenSim's static optimization and joint reactions, and beside published studies.",
        {
            "tension": lambda: tension.measure(folder),
            "elastic_forward": lambda: elastic.forward_rows(folder),
            "elastic_fine": lambda: elastic.fine_rows(folder),
            "elastic_convergence": lambda: elastic_convergence.convergence_rows(folder),
            "elastic_moco": lambda: elastic.moco_rows(folder),
            "loop_static": lambda: loop_forces.measure_static(folder),
            "reaction": lambda: reaction.measure_same(folder),
            "tension_defaults": lambda: tension_defaults.measure_settings(folder),
            "recruitment": lambda: recruitment.measure_programs(folder),
            "recruitment_truth": lambda: recruitment.measure_truth(folder),
            "shoulder": lambda: shoulder.measure_shoulder(folder),
            "reaction_tensions": lambda: reaction.measure_tensions(folder),
            "reaction_loads": lambda: reaction.measure_loads(folder),
            "passive": lambda: passive.measure(folder),
            "passive_muscles": lambda: passive.measure_muscles(folder),
            "passive_forms": lambda: passive.measure_forms(folder),
        },
    )


def _joint_loads(folder: Path) -> Page:
    return Page(
        "joint-loads",
        "Loads of joints that were measured",
        "Beside an instrumented knee, and beside OpenSim.",
        {
            "knee": lambda: knee.measure(folder),
            "knee_peaks": lambda: knee.measure_peaks(folder),
            "knee_where": lambda: knee.measure_where(folder),
            "knee_cutoffs": lambda: knee.measure_cutoffs(folder),
        },
    )


def _uncertainty(folder: Path) -> Page:
    return Page(
        "uncertainty",
        "Whether limits hold",
        "Limits of results that hold 90 % of draws, against known and measured truth.",
        {
            "uncertainty_assumed": lambda: uncertainty.measure_assumed(folder),
            "uncertainty_other": lambda: uncertainty.measure_other(folder),
            "uncertainty_factors": lambda: uncertainty.measure_factors(folder),
            "uncertainty_linear": lambda: uncertainty.measure_linear(folder),
            "uncertainty_live": lambda: live_limits.measure(folder),
            "uncertainty_knee": lambda: uncertainty.measure_knee(folder),
            "uncertainty_plates": lambda: uncertainty_measured.measure_plates(folder),
            "uncertainty_plates_factor": lambda: uncertainty_measured.measure_plates_factor(folder),
            "uncertainty_pins": lambda: uncertainty_measured.measure_pins(folder),
            "uncertainty_box": lambda: uncertainty_measured.measure_box(folder),
        },
    )


def _personal(folder: Path) -> Page:
    return Page(
        "personal",
        "Muscles of the person",
        "Simulated people whose muscles are known, held-out strides of real walks, scaled models.",
        {
            "personal_truth": lambda: personalize.measure_truth(folder),
            "personal_many": lambda: personalize.measure_many(folder),
            "personal_walks": lambda: personalize.measure_walks(folder),
            "personal_passive": lambda: personalize_passive.measure(folder),
            "personal_map": lambda: personalize.measure_map(folder),
            "personal_published": lambda: personalize.measure_published(folder),
        },
    )


def _emg_and_sound(folder: Path) -> Page:
    return Page(
        "emg-and-sound",
        "EMG and sound",
        "Channels that are left out and predicted; impacts that are heard.",
        {
            "emg_held_out": lambda: emg.measure_held_out(folder),
            "emg_channels": lambda: emg.measure_channels(folder),
            "emg_calibration": lambda: emg.measure_calibration(folder),
            "emg_faults": lambda: emg_faults.measure(folder),
            "emg_faults_unseen": lambda: emg_faults.measure_unseen(folder),
            "emg_study": lambda: emg.measure_study(folder),
            "emg_envelopes": lambda: emg.measure_envelopes(folder),
            "sound": sound.measure,
            "sound_motion": sound.measure_motion,
        },
    )


def _hands(folder: Path) -> Page:
    return Page(
        "hands",
        "Forces of hands, chairs and wheels",
        "Forces at hands and seat that were measured, hidden and estimated.",
        {
            "hands_lift": lambda: hands.measure_lift(folder),
            "hands_lift_open": lambda: hands.measure_lift_open(folder),
            "hands_spine": lambda: hands.measure_spine(folder),
            "hands_spine_point": lambda: hands.measure_spine_point(folder),
            "hands_rim": lambda: hands.measure_rim(folder),
            "hands_rim_directions": lambda: hands.measure_rim_directions(folder),
            "hands_seat": lambda: hands.measure_seat(folder),
            "hands_seat_open": lambda: hands.measure_seat_open(folder),
            "hands_seat_times": lambda: hands.measure_seat_times(folder),
        },
    )


def _ground_forces(folder: Path) -> Page:
    return Page(
        "ground-forces",
        "Ground forces without plates",
        "Plates that were hidden and estimated, and the intervals that physics leaves.",
        {
            "hidden_plates": lambda: hidden_plates.measure(folder),
            "hidden_plates_parts": lambda: hidden_plates.measure_parts(folder),
            "hidden_plates_partial": lambda: hidden_plates.measure_partial(folder),
            "contact_defaults": lambda: contact_defaults.measure_contact_settings(folder),
            "certificates_truth": certificates.measure_truth,
            "certificates": lambda: certificates.measure(folder),
            "certificates_programs": lambda: certificates.measure_programs(folder),
            "certificates_faults": lambda: certificates.measure_faults(folder),
        },
    )


def _faults(folder: Path) -> Page:
    return Page(
        "faults",
        "Faults of recordings",
        "Faults that were put into clean recordings: found, mended or missed, and what is called on clean ones.",
        {
            "force_faults": lambda: faults.injected_force_faults(folder),
            "force_faults_clean": lambda: faults.clean_forces(folder),
            "force_faults_mended": lambda: faults.mended_torques(folder),
            "force_faults_unseen": lambda: unseen_faults.injected_unseen(folder),
            "force_faults_unseen_clean": lambda: unseen_faults.clean_unseen(folder),
            "marker_faults": lambda: marker_faults.injected_marker_faults(folder),
            "marker_faults_clean": lambda: marker_faults.clean_markers(folder),
            "marker_faults_mended": lambda: marker_faults.mended_angles(folder),
            "marker_faults_unseen": lambda: unseen_marker_faults.injected_after_calibration(folder),
            "marker_faults_unseen_clean": lambda: unseen_marker_faults.clean_after_calibration(folder),
            "marker_faults_raw": lambda: unseen_marker_faults.injected_marker_faults(folder),
            "marker_faults_raw_clean": lambda: unseen_marker_faults.clean_markers(folder),
        },
    )


def _two_bodies(folder: Path) -> Page:
    return Page(
        "two-bodies",
        "Two bodies that pull on each other",
        "Simulated fighters: every force is known.",
        {
            "pair_bouts": pair.measure_bouts,
            "pair": pair.measure,
            "pair_emg": pair.measure_emg,
            "pair_open": pair.measure_open,
            "pair_truths": pair.measure_truths,
            "pair_compliance": pair.measure_compliance,
        },
    )


def _calibration(folder: Path) -> Page:
    return Page(
        "calibration",
        "Lengths, markers and body shape",
        "Calibrated models on motions that calibration did not see, simulated subjects, body shape.",
        {
            "calibration": lambda: calibration.measure(folder),
            "calibration_lengths": lambda: calibration.measure_lengths(folder),
            "calibration_static": lambda: calibration_static.measure(folder),
            "calibration_zeros": lambda: calibration_zeros.measure_zeros(folder),
            "calibration_simulated_zeros": lambda: calibration_zeros.measure_simulated(folder),
            "calibration_unequal": lambda: calibration_zeros.measure_unequal(folder),
            "transfer": lambda: transfer.measure(folder),
            "shape_people": shape.measure_people,
            "shape_segments": shape.measure_segments,
            "shape_poses": lambda: shape.measure_poses(folder),
            "simulated": lambda: simulated.measure(folder),
        },
    )


def _identification(folder: Path) -> Page:
    return Page(
        "identification",
        "Masses and inertias",
        "Base parameters, mass points, and identified masses on motion that identification did not see.",
        {
            "regressor": lambda: regressor.measure_regressor(folder),
            "base_parameters": lambda: regressor.measure_base_parameters(folder),
            "figaroh": regressor.measure_figaroh,
            "sequential": lambda: regressor.measure_sequential(folder),
            "deviations": lambda: regressor.measure_deviations(folder),
            "masspoints": masspoints.measure_solvers,
            "masspoints_grid": masspoints.measure_grid,
            "weight_maps": lambda: masspoints.measure_maps(folder),
            "identification": lambda: identification.measure(folder),
            "identification_prototype": lambda: identification.measure_prototype(folder),
            "identification_intervals": lambda: identification_intervals.measure(folder),
            "identification_segments": lambda: identification.measure_segments(folder),
            "refine": lambda: refine.measure(folder),
            "refine_held_out": lambda: refine_held_out.measure(folder),
            "refine_simulated": refine.measure_simulated,
        },
    )


def _instruments(folder: Path) -> Page:
    return Page(
        "instruments",
        "Plates, clocks, scans and handles",
        "Where instruments are, and how far their clocks are apart.",
        {
            "plates": calibrations.measure_plates,
            "plates_standing": lambda: calibrations.measure_standing(folder),
            "clocks": calibrations.measure_clocks,
            "scans": lambda: calibrations.measure_scans(folder),
            "scans_persons": lambda: calibrations.measure_persons(folder),
            "handle": lambda: calibrations.measure_handle(folder),
        },
    )


def _viscosity(folder: Path) -> Page:
    return Page(
        "viscosity",
        "Viscosity of a joint and of its muscles",
        "Virtual joints and specimens, a real pendulum, and the tables of [S].",
        {
            "tracking_noise": tracking.measure_noise,
            "tracking_faults": tracking.measure_faults,
            "viscosity_methods": steps.measure,
            "passive_laws": trust.measure_laws,
            "trust_specimens": trust.measure_specimens,
            "trust_attachments": trust.measure_attachments,
            "pendulum_inertias": lambda: pendulum.measure_inertias(folder / "pendulum-swing-inertia"),
            "pendulum_damping": lambda: pendulum.measure_decay(folder / "pendulum-swing-inertia"),
            "pendulum_period": lambda: pendulum.measure_periods(folder / "pendulum-swing-inertia"),
            "cohort": cohort.measure,
            "limbs_systematic": limbs.measure_systematic,
            "limbs_coverage": limbs.measure_coverage,
            "scans_of_other_bones": scans.measure,
            "virtual_joints": virtual.measure_joints,
            "virtual_cohort": virtual.measure_cohort,
            "virtual_muscles": virtual.measure_muscles,
        },
    )


def _bone_maps(folder: Path) -> Page:
    return Page(
        "bone-maps",
        "Maps between bones",
        "Round surfaces, landmarks, and muscles transferred to bones whose deformation is known.",
        {
            "articular_made": articular.measure_made,
            "articular_centers": lambda: articular.measure_centers(folder),
            "articular_persons": articular.measure_persons,
            "landmarks_found": articular.measure_landmarks,
            "correspondence_affine": lambda: correspondence.measure("affine", range(20, 23)),
            "correspondence_smooth": lambda: correspondence.measure("smooth"),
            "correspondence_landmarks": lambda: correspondence.measure("landmarks", range(20, 25)),
            "correspondence_persons": correspondence.measure_persons,
            "deformed_legs": deformed_legs.measure,
            "persons_held_out": held_out.measure,
            "morph_laws": lambda: laws.measure(folder),
            "morph_branches": lambda: branches.measure(folder),
            "morph_shapes": shapes.measure,
            "morph_shapes_bones": shapes.measure_bones,
            "morph_shapes_beside": shapes.measure_beside,
            "morph_demo": demo.measure,
            "morph_demo_joints": demo.measure_joints,
        },
    )


def _real_bones(folder: Path) -> Page:
    return Page(
        "real-bones",
        "Real bones",
        "Muscles in the bones of living persons, and the other side of a model.",
        {
            "real_bones": lambda: real_bones.measure(folder),
            "real_bones_arms": lambda: real_bones.measure_arms(folder),
            "real_bones_depths": lambda: real_bones.measure_depths(folder),
            "real_bones_round": lambda: real_bones.measure_round(folder),
            "real_bones_clearing": lambda: clearing.measure(folder),
            "real_bones_pairs": lambda: real_bones.measure_pairs(folder),
            "morph_masses": lambda: masses.measure(folder),
            "mirror": lambda: mirror.measure(folder),
        },
    )


def _species(folder: Path) -> Page:
    return Page(
        "species",
        "Another species",
        "A man's muscles on a mouse's bones, beside an anatomist's.",
        {
            "species": lambda: species.measure(folder),
            "species_muscles": lambda: species.measure_muscles(folder),
            "species_arms": lambda: species.measure_arms(folder),
            "species_relative": lambda: species_relative.measure(folder),
            "species_signs": lambda: species.measure_signs(folder),
            "species_alignment": lambda: species.measure_alignment(folder),
            "species_architecture": lambda: mouse_morphed.measure_architecture(folder),
            "species_toes": lambda: mouse_morphed.measure_toes(folder),
            "species_follows": lambda: mouse_morphed.measure_follows(folder),
            "species_tension": lambda: mouse_morphed.measure_tension(folder),
            "species_reserves": lambda: mouse_morphed.measure_reserves(folder),
            "species_groups": lambda: mouse_morphed.measure_groups(folder),
            "species_keypoints": lambda: mouse_morphed.measure_keypoints(folder),
            "species_arm": lambda: species_arm.measure(folder),
            "species_arm_signs": lambda: species_arm.measure_arms(folder),
            "species_arm_forces": lambda: species_arm.measure_architecture(folder),
            "species_intervals": lambda: species_intervals.measure(folder),
        },
    )


def _animals(folder: Path) -> Page:
    return Page(
        "animals",
        "Strides and mice",
        "Foot strikes without plates, mice through every step, stairs that measure force.",
        {
            "strides": lambda: strides.measure(folder),
            "strides_duty": lambda: strides.measure_duty(folder),
            "strides_mouse": lambda: strides.measure_mouse(folder),
            "mouse_markers": lambda: mouse.measure_markers(folder),
            "mouse_keypoints": lambda: mouse.measure_keypoints(folder),
            "mouse_strides": lambda: mouse.measure_strides(folder),
            "mouse_lengths": lambda: mouse.measure_lengths(folder),
            "mouse_plate": lambda: mouse.measure_plate(folder),
            "mouse_masses": lambda: mouse.measure_masses(folder),
            "stairs": lambda: stairs.measure(folder),
        },
    )


def _studies(folder: Path) -> Page:
    return Page(
        "studies",
        "Groups, outliers and whole studies",
        "How often differences are found that are none; interrupted studies; wrong files.",
        {
            "groups_false": groups.measure_false,
            "groups_power": groups.measure_power,
            "conditions_within": conditions.measure_within,
            "outliers": conditions.measure_outliers,
            "interrupted": interrupted.measure,
            "wrong_files": fuzz.run,
        },
    )
