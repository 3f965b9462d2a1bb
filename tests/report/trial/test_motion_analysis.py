import re
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from lxml import etree
from tests.walker import having, shown

from myomorph.core.model.contacts import Cone, ContactForces, Contacts, Site, Touch
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.join import join_models, join_motions
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.lab.analysis.center_of_mass import centroid
from myomorph.lab.analysis.phases import Phase
from myomorph.lab.analysis.presets import (
    CUTS,
    MUSCLES,
    PRESETS,
    fitting_preset,
    named_muscles,
    preset_of,
)
from myomorph.lab.analysis.selection import centroids, subjects
from myomorph.lab.report.charts.pictures import even_times, picture_strip, pictures_beside
from myomorph.lab.report.charts.tracks import Backdrop
from myomorph.lab.report.scene.pictures import pictures, proportion
from myomorph.lab.report.scene.scene import make_scene
from myomorph.lab.report.trial.analysis_sections import analysis_sections
from myomorph.lab.report.trial.estimated_forces import (
    acting_forces,
    compared_with_plates,
    contact_verdicts,
    group_forces,
    groups_of,
    situation_of,
)
from myomorph.lab.report.trial.motion_analysis import analyse
from myomorph.lab.report.trial.prepared import prepare
from myomorph.lab.report.trial.report_input import (
    AnalysisChoice,
    HeardImpact,
    InfeasibleContact,
    PlateForce,
    ReportInput,
)
from myomorph.lab.report.trial.trial_page import report_page
from myomorph.lab.store import settings
from walker import GRAVITY, Tension, everything, model, motion, steps

WEIGHT = 60.0 * GRAVITY


def _contact_forces(time: np.ndarray) -> ContactForces:
    """Two sites of one foot and a grip on another body, half a body weight up at each sole."""
    sites = (
        Site("heel_r", "tibia_r", np.zeros((1, 3)), group="foot_r"),
        Site("toe_r", "femur_r", np.zeros((1, 3)), group="foot_r"),
        Site(
            name="hand_l",
            body="tibia_l",
            points=np.zeros((1, 3)),
            cone=Cone(None),
            against="pelvis",
        ),
    )
    forces = np.zeros((len(time), 3, 3))
    forces[:, :2, 1] = WEIGHT / 2
    forces[:, 2, 0] = 50.0
    points = np.tile([[0.0, 0.0, 0.1], [0.2, 0.0, 0.1], [0.1, 0.9, 0.0]], (len(time), 1, 1))
    return ContactForces(
        time=time,
        sites=sites,
        contact_activation=np.ones((len(time), 3)),
        contact_force=forces,
        contact_point=points,
        contact_torque=np.zeros_like(forces),
    )


def pair(apart: float = 1.0) -> tuple[Motion, ReportInput]:
    """Two walkers face to face as one model."""
    body = model()
    one = motion(body)
    values = np.array(one.values)
    values[:, 0] = apart - values[:, 0]
    both = {"tori": one, "uke": Motion(one.time, one.names, values)}
    joined = join_models(dict.fromkeys(both, body))
    moving = join_motions(both)
    return moving, shown(
        "two", model=joined, coordinates=moving, tension=Tension(joined, moving.time)
    )


def test_presets_name_only_what_exists() -> None:
    assert {"taichi", "tap", "drum", "judo", "gait", "lift"} <= set(PRESETS)
    for name, one in PRESETS.items():
        assert one.name == name
        assert one.title
        assert set(one.muscles) <= set(MUSCLES)
        assert one.muscles
        assert set(one.cuts) <= set(CUTS)
        assert one.pictures > 0
        assert len(set(one.muscles)) == len(one.muscles)
    assert len(PRESETS["taichi"].muscles) == 8
    with pytest.raises(UnknownName, match="gait"):
        preset_of("walking")


def test_a_study_file_knows_every_preset() -> None:
    assert set(get_args(settings.Preset)) == {"", *PRESETS}


def test_times_outside_the_motion_are_refused() -> None:
    with pytest.raises(BadData, match="no picture at 99 s: the motion lasts from"):
        report_page(having(everything(), times=(99.0,)))


def test_the_preset_follows_from_the_recording() -> None:
    assert fitting_preset(True, ("plates",), 1, False).name == "gait"
    assert fitting_preset(True, ("sound",), 1, False).name == "drum"
    assert fitting_preset(False, ("plates",), 2, False).name == "judo"
    assert fitting_preset(False, (), 1, True).name == "lift"
    assert fitting_preset(False, ("plates",), 1, False).name == "motion"
    # A walk needs no plates to be one, and what is known to be none is none.
    assert fitting_preset(False, (), 1, False, "walking").name == "gait"
    assert fitting_preset(True, ("plates",), 1, False, "running").name == "gait"
    assert fitting_preset(True, ("plates",), 1, False, "jumping").name == "motion"


def test_muscles_that_a_model_lacks_are_named() -> None:
    found, lacking = named_muscles(
        ("uke_recfem_r", "uke_recfem_l", "uke_DELT1_r"), PRESETS["taichi"].muscles, "uke_"
    )
    assert [one.label for one in found] == ["Deltoid, anterior", "Rectus femoris"]
    assert found[1].members == {"right": ("uke_recfem_r",), "left": ("uke_recfem_l",)}
    assert "Tibialis anterior" in lacking
    assert len(found) + len(lacking) == 8
    section = analysis_sections(prepare(having(everything(60), preset="taichi")))[0]
    assert "Missing in the model: Deltoid, anterior;" in section.lead


def test_a_user_chooses_muscles_by_the_names_of_the_report_or_of_the_model() -> None:
    found, lacking = named_muscles(
        ("glut_med1_r", "glut_med1_l", "soleus_r"), ("Soleus", "glut_med1_r", "psoas")
    )
    assert [(one.label, one.names) for one in found] == [
        ("Soleus", ("soleus_r",)),
        ("glut_med1_r", ("glut_med1_r", "glut_med1_l")),
    ]
    assert lacking == ("psoas",)
    choice = AnalysisChoice("taichi", muscles=("glmax2", "psoas"))
    section = analysis_sections(prepare(replace(everything(60), analysis=choice)))[0]
    assert "Missing in the model: psoas." in section.lead


def test_presets_make_pages_of_well_formed_drawings() -> None:
    for name in ("taichi", "tap", "motion"):
        sections = analysis_sections(prepare(having(everything(), preset=name)))
        assert [one.key for one in sections] == [
            "analysis",
            "center-of-gravity",
            "phases",
            "correlations",
        ]
        for drawing in (
            one
            for section in sections
            for figure in section.figures
            for one in _drawings(figure.svg)
        ):
            assert (
                etree.fromstring(drawing).get("aria-label")
                or etree.fromstring(drawing).get("role") == "presentation"
            )
    with pytest.raises(UnknownName, match="taichi"):
        report_page(having(everything(), preset="swim"))


def _drawings(svg: str) -> list[str]:
    return re.findall(r"<svg.*?</svg>", svg, re.DOTALL)


def test_height_of_the_center_of_gravity_and_of_standing() -> None:
    body = model()
    moving = motion(body)
    found = analyse(prepare(shown("one", model=body, coordinates=moving)))
    assert found is not None
    person = found.persons[0]
    height = centroid(body, moving).values[:, 1]
    np.testing.assert_allclose(person.center.values[:, 0], height, atol=1e-12)
    # Masses 0.6, 0.3 and 0.1 of the whole at 1.1, 0.7 and 0.3 m; the lowest joint is the knee, at
    # 0.5 m.
    assert person.standing[0] == pytest.approx(0.9 - 0.5)
    # Hips and knees swing at 1 Hz, but right and left against each other: the height repeats twice
    # as often.
    vertical = person.periods[0]
    assert not vertical.periodic or vertical.period == pytest.approx(0.5, rel=0.05)


def test_given_phases_win_and_times_choose_the_pictures() -> None:
    given = having(
        everything(),
        phases=(Phase("first", 0.0, 0.7), Phase("second", 0.7, 1.99)),
        times=(0.3, 1.1),
    )
    found = analyse(prepare(given))
    assert found is not None
    assert [one.stage.name for one in found.measures] == ["first", "second"]
    text = report_page(given)
    assert text.count('alt="From the right side,') == 2
    assert "The body at 0.30 s" in text
    assert "The body at 1.10 s" in text


def test_a_page_needs_no_model() -> None:
    """Contacts alone make a graph; nothing is drawn of what is not known."""
    time = np.arange(0.0, 2.0, 0.01)
    sections = analysis_sections(prepare(shown("plates", wrenches=steps(time, WEIGHT))))
    assert [one.key for one in sections] == ["analysis", "phases"]
    assert analysis_sections(prepare(shown("nothing"))) == []


def test_two_subjects_have_each_their_center_of_gravity() -> None:
    moving, given = pair()
    who = subjects(given.model)
    assert [one.name for one in who] == ["tori", "uke"]
    tori, uke = centroids(given.model, moving, who)
    alone = centroid(model(), motion(model()))
    np.testing.assert_allclose(tori.values, alone.values, atol=1e-12)
    both = centroid(given.model, moving)
    np.testing.assert_allclose((tori.values + uke.values) / 2, both.values, atol=1e-12)
    found = analyse(prepare(given))
    assert found is not None
    assert found.preset.name == "judo"
    assert len(found.persons) == 2
    assert [one.label for one in found.persons[1].muscles] == [
        one.label for one in found.persons[0].muscles
    ]


def test_an_object_has_no_muscles_and_comes_last() -> None:
    body = model()
    box = replace(
        body,
        muscles=(),
        bodies=body.bodies[:1],
        joints=body.joints[:1],
        coordinates=body.coordinates[:4],
    )
    who = subjects(join_models({"box": box, "lifter": body}))
    assert [(one.name, bool(one.muscles)) for one in who] == [("lifter", True), ("box", False)]


def test_two_bodies_are_seen_from_the_side_whole_and_in_one_scale() -> None:
    moving, given = pair(3.0)
    scene = make_scene(given.model, moving, [0, 50])
    assert abs(scene.forward @ [1.0, 0.0, 0.0]) == pytest.approx(1.0)
    assert proportion(scene, "side") > proportion(
        make_scene(model(), motion(model()), [0, 50]), "side"
    )
    drawn = pictures(scene, (120, 300))
    assert len({one.height for one in drawn}) == 1
    assert all(one.width <= 301 and one.height <= 121 for one in drawn)


def test_the_strip_is_not_empty_and_the_same_twice() -> None:
    body = model()
    moving = motion(body)
    times = even_times((0.0, 2.0), 4)
    assert times == pytest.approx((0.25, 0.75, 1.25, 1.75))
    scene = make_scene(body, moving, [25, 75, 125, 175])
    one = picture_strip(scene, Backdrop((0.0, 2.0)))
    other = picture_strip(scene, Backdrop((0.0, 2.0)))
    assert one == other
    svg = etree.fromstring(one)
    images = svg.xpath("//*[local-name()='image']/@href")
    assert len(images) == 4
    assert len(set(images)) > 1
    assert all(len(one) > 1000 and one.startswith("data:image/png;base64,") for one in images)


def test_pictures_stand_near_their_times_and_apart() -> None:
    wanted = np.array([200.0, 202.0, 400.0, 410.0, 590.0])
    places = pictures_beside(wanted, 80.0, 100.0, 600.0)
    assert np.diff(places).min() >= 80.0 - 1e-9
    assert places[0] >= 140.0
    assert places[-1] <= 560.0
    assert places[:2].mean() == pytest.approx(201.0)
    assert places[2:4].mean() == pytest.approx(405.0)
    free = np.array([150.0, 300.0, 450.0])
    np.testing.assert_array_equal(pictures_beside(free, 80.0, 100.0, 600.0), free)


def test_groups_add_their_sites_and_stand_beside_what_was_measured() -> None:
    time = np.arange(0.0, 2.0, 0.01)
    given = shown("x", wrenches=steps(time, WEIGHT), forces=_contact_forces(time))
    foot, hand = groups_of(_contact_forces(time), compared_with_plates(given))
    assert (foot.name, foot.label, hand.against) == ("foot_r", "Right foot", "pelvis")
    np.testing.assert_allclose(foot.forces[:, 1], WEIGHT)
    assert foot.measured is not None
    assert np.nanmax(foot.measured[:, 1]) == pytest.approx(WEIGHT, rel=1e-3)
    assert np.isnan(foot.measured[0]).all(), "no plate carries the foot before 0.2 s"
    together = group_forces(_contact_forces(time))
    assert together.names[0] == "foot_r"
    np.testing.assert_allclose(together.points[:, 0], [[0.1, 0.0, 0.1]] * len(time))
    np.testing.assert_allclose(together.forces[:, 1:].sum(axis=1), 0.0, atol=1e-12)


HEEL_AND_TOE = ("heel_r", "toe_r")
UP = np.array([0.0, 1.0, 0.0])


def _shared_plate(time: np.ndarray) -> tuple[ContactForces, np.ndarray]:
    """Make a heel and a toe that share a body weight, and what their plate measured."""
    sites = tuple(Site(name, "tibia_r", np.zeros((1, 3))) for name in HEEL_AND_TOE)
    force = np.zeros((len(time), 2, 3))
    force[:, 0, 1] = WEIGHT * 0.5 * (1.0 + np.sin(time))
    force[:, 1, 1] = WEIGHT - force[:, 0, 1]
    estimated = ContactForces(
        time=time,
        sites=sites,
        contact_activation=np.ones((len(time), 2)),
        contact_force=force,
        contact_point=0 * force,
        contact_torque=0 * force,
    )
    return estimated, np.outer(WEIGHT * (1.0 + 0.1 * np.sin(3.0 * time)), UP)


def test_contacts_on_one_plate_are_compared_with_it_together() -> None:
    """A heel and a toe that share a plate are each far from it, and their sum is not."""
    time = np.arange(0.0, 2.0, 0.01)
    estimated, measured = _shared_plate(time)
    plate = Wrenches(
        time=time,
        names=("plate 1",),
        bodies=("tibia_r",),
        forces=measured[:, None],
        points=0 * measured[:, None],
        torques=0 * measured[:, None],
    )
    off = _off_of(measured[:, 1] - WEIGHT, time >= 0.0)
    by_bodies = shown("x", wrenches=plate, forces=estimated)
    told = having(by_bodies, on_plates=(PlateForce("plate 1", HEEL_AND_TOE, measured),))
    for given in (by_bodies, told):
        (comparison,) = compared_with_plates(given)
        assert comparison.groups == HEEL_AND_TOE
        assert comparison.rms(UP) == pytest.approx(off, rel=1e-6)
        groups = groups_of(estimated, compared_with_plates(given))
        assert [group.measured for group in groups] == [None, None]


def test_a_contact_alone_on_its_plate_is_shown_beside_it() -> None:
    time = np.arange(0.0, 2.0, 0.01)
    estimated, measured = _shared_plate(time)
    early = (time < 1.0)[:, None]
    parts = (
        PlateForce("plate 1", ("heel_r",), np.where(early, measured, np.nan)),
        PlateForce("plate 1 (2)", HEEL_AND_TOE, np.where(early, np.nan, measured)),
    )
    comparisons = compared_with_plates(shown("x", forces=estimated, on_plates=parts))
    heel, toe = groups_of(estimated, comparisons)
    assert toe.measured is None
    assert heel.measured is not None
    np.testing.assert_array_equal(np.isfinite(heel.measured[:, 1]), time < 1.0)
    (_, both) = comparisons
    assert both.plates == ("plate 1",)
    assert both.rms(UP) == pytest.approx(_off_of(measured[:, 1] - WEIGHT, time >= 1.0), rel=1e-6)


def _off_of(values: np.ndarray, where: np.ndarray) -> float:
    """Root mean square of some values."""
    return float(np.sqrt(np.mean(values[where] ** 2)))


SURE = HeardImpact(
    time=0.7,
    site="stick_r",
    instrument="snare",
    impulse=0.4,
    low=0.35,
    high=0.46,
    confidence=1.0,
)


def test_impacts_are_a_table() -> None:
    given = having(
        everything(),
        impacts=(
            replace(SURE, time=0.5),
            replace(SURE, site="stick_l", low=np.nan, high=np.nan, confidence=0.5),
        ),
        forces=_contact_forces(everything().dynamics.wrenches.time),
    )
    panel = next(one for one in analysis_sections(prepare(given)) if one.key == "contact-forces")
    (table,) = [grid for grid in panel.grids if grid.title == "Impacts heard: 2"]
    assert table.rows[0][2:] == ("snare", "0.4 N·s", "0.35 to 0.46 N·s", "100 %")
    assert table.rows[1][4:] == ("not shown", "50 %")


def test_what_acts_is_what_was_estimated_and_what_was_measured_elsewhere() -> None:
    time = np.arange(0.0, 2.0, 0.01)
    given = shown("x", wrenches=steps(time, WEIGHT), forces=_contact_forces(time))
    acting = acting_forces(given)
    assert acting is not None
    assert "plate 1" not in acting.names
    assert "plate 2" not in acting.names
    apart = having(given, forces=replace(_contact_forces(time), sites=_elsewhere(time)))
    acting = acting_forces(apart)
    assert acting is not None
    assert {"plate 1", "plate 2"} <= set(acting.names)
    assert situation_of(given) == "unknown"
    assert situation_of(shown("x", wrenches=steps(time, WEIGHT))) == "measured"
    heard = Contacts(
        ("stick_r",), (Touch(site="stick_r", start=0.0, stop=0.1, surface="drum", source="sound"),)
    )
    assert situation_of(having(given, touches=heard)) == "sound"


def test_a_measured_force_acts_while_nothing_is_estimated_in_its_place() -> None:
    """A foot on a plate for a second and next to it for another.

    The force is one body weight all the time.
    """
    time = np.arange(0.0, 2.0, 0.01)
    loaded = time < 1.0
    site = Site("sole_r", "tibia_r", np.zeros((1, 3)), group="foot_r")
    force = np.zeros((len(time), 1, 3))
    force[:, 0, 1] = WEIGHT
    strength = np.where(loaded, 0.0, 1.0)[:, None]
    estimated = ContactForces(
        time=time,
        sites=(site,),
        contact_activation=strength,
        contact_force=force * strength[..., None],
        contact_point=0 * force,
        contact_torque=0 * force,
    )
    plate = Wrenches(
        time=time,
        names=("plate",),
        bodies=("tibia_r",),
        forces=force * loaded[:, None, None],
        points=0 * force,
        torques=0 * force,
    )
    given = shown("x", wrenches=plate, forces=estimated)
    acting = acting_forces(given)
    assert acting is not None
    np.testing.assert_allclose(acting.forces.sum(axis=1)[:, 1], WEIGHT)
    (foot,) = groups_of(estimated, compared_with_plates(given))
    assert not (np.isfinite(foot.measured[:, 1]) & foot.estimated).any()
    hidden = having(
        given,
        forces=replace(estimated, contact_activation=np.ones_like(strength), contact_force=force),
    )
    acting = acting_forces(hidden)
    assert acting is not None
    np.testing.assert_allclose(acting.forces.sum(axis=1)[:, 1], WEIGHT)


def _elsewhere(time: np.ndarray) -> tuple[Site, ...]:
    return tuple(
        replace(one, body="pelvis", against="ground") for one in _contact_forces(time).sites
    )


def test_residuals_are_held_against_the_limits() -> None:
    """5 % of the peak external force and 1 % of it times the height (Hicks et al. 2015).

    Frames with infeasible contacts count.
    """
    time = np.arange(0.0, 1.0, 0.01)
    force = _contact_forces(time)
    names = (
        "residual_FX",
        "residual_FY",
        "residual_FZ",
        "residual_MX",
        "residual_MY",
        "residual_MZ",
    )
    peak = float(
        np.linalg.norm(np.nan_to_num(group_forces(force).forces).sum(axis=1), axis=1).max()
    )
    values = np.zeros((len(time), 6))
    values[:, 1] = 0.04 * peak
    values[10, 1] = 0.06 * peak
    values[:, 3] = 0.005 * peak
    given = shown(
        "x",
        forces=force,
        residuals=Series(time, names, values),
        infeasible=(InfeasibleContact(0.5, "friction 0.8 to 1.1"),),
    )
    rows = {one.quantity: one for one in contact_verdicts(given, 1.0)}
    assert rows["Residual force beside contacts, peak"].state == "over"
    assert rows["Residual force beside contacts, peak"].value == pytest.approx(6.0)
    assert rows["Residual force beside contacts, RMS"].state == "ok"
    assert rows["Residual moment beside contacts, peak"].value == pytest.approx(0.5)
    not_carried = rows["Infeasible contact frames"]
    assert (not_carried.value, not_carried.state, not_carried.time) == (1.0, "over", 0.5)
    assert contact_verdicts(shown("x"), 1.0) == []


class Open:
    """Intervals of forty newtons around each force, at every so many frames."""

    def __init__(self, forces: ContactForces, every: int):
        self.time = forces.time[::every]
        self.names = ("foot_r",)
        foot = forces.contact_force[::every, :2].sum(axis=1)[:, None]
        self.lower = foot - 40.0
        self.upper = foot + 40.0


def test_the_panel_of_contact_forces() -> None:
    given = everything()
    time = given.dynamics.wrenches.time
    forces = _contact_forces(time)
    told = having(
        given,
        forces=forces,
        intervals=Open(forces, 2),
        infeasible=(InfeasibleContact(0.5, "more friction"),),
    )
    panel = next(one for one in analysis_sections(prepare(told)) if one.key == "contact-forces")
    assert "fourth situation" in panel.lead
    assert "that the data allow" in panel.lead
    assert "its opposite" in panel.lead
    assert ("measured", "measured") in panel.legend
    rows = {row[0]: row for row in panel.grids[0].rows}
    assert rows["Right foot"][1].startswith("588 N")
    (compared,) = panel.grids[1].rows
    assert compared[0] == "Right foot"
    assert "of its range" in compared[3]
    assert panel.grids[2].rows == (("0.500 s", "more friction"),)
    vertical = etree.fromstring(_drawings(panel.figures[0].svg)[0])
    assert len(vertical.xpath("//*[contains(@class, 'band')]")) == 1
    seldom = having(told, intervals=Open(forces, 20))
    panel = next(one for one in analysis_sections(prepare(seldom)) if one.key == "contact-forces")
    bars = etree.fromstring(_drawings(panel.figures[0].svg)[0]).xpath(
        "//*[contains(@class, 'interval')]/@d"
    )
    assert [one.count("M") for one in bars] == [len(time[::20])]
    assert "Green arrows are estimated contact forces." in report_page(told)
