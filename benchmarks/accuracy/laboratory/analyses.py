"""Analyses of AnalyzeTool here and in OpenSim 4.6, table by table.

The models have every class of muscle that is built.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.accuracy.kinematics.setups import GAIT, SMALL, apart
from benchmarks.opensim_tools import read_table
from benchmarks.run_setup import run_in_opensim
from myomorph.exchange.opensim.run import run_tool

WALK = "walk-so-jointload-emg/"
WALKER = f"{WALK}Rajagopal_scaled_Sub1_gasAvoid.osim"
SPRING = f"{GAIT}ref_so_10dof18musc/"
SHOULDER = "shoulder-thoracoscapular/"
POINT = "<body_name>{body}</body_name><point_name>tip</point_name><point>0.01 -0.2 0.03</point>"
ANALYSES = """<MuscleAnalysis name="MuscleAnalysis"/><BodyKinematics name="BodyKinematics"/>
<BodyKinematics name="BodyAxes">\
<express_results_in_body_local_frame>true</express_results_in_body_local_frame>
</BodyKinematics><PointKinematics name="PointKinematics">{point}</PointKinematics>\
<Kinematics name="Kinematics"/>
<Actuation name="Actuation"/><ForceReporter name="ForceReporter"/>\
<StatesReporter name="StatesReporter"/>
<JointReaction name="JointReaction"/>"""
SETUP = """<?xml version="1.0"?><OpenSimDocument Version="40000"><AnalyzeTool name="a">\
<model_file>{model}</model_file>
<results_directory>{results}</results_directory><output_precision>12</output_precision>
<initial_time>{start}</initial_time><final_time>{end}</final_time>
<solve_for_equilibrium_for_auxiliary_states>{balanced}</solve_for_equilibrium_for_auxiliary_states>
<AnalysisSet name="Analyses"><objects>{analyses}</objects></AnalysisSet>{loads}
<{kind}_file>{motion}</{kind}_file>
<lowpass_cutoff_frequency_for_coordinates>{cutoff}</lowpass_cutoff_frequency_for_coordinates></AnalyzeTool>
</OpenSimDocument>"""
LOAD = """<ExternalForce name="{body}_force"><applied_to_body>{body}</applied_to_body>\
<force_expressed_in_body>ground
</force_expressed_in_body><point_expressed_in_body>ground</point_expressed_in_body><force_identifier>{side}ground_force_v
</force_identifier><point_identifier>{side}ground_force_p</point_identifier><torque_identifier>{side}ground_torque_
</torque_identifier></ExternalForce>"""
LOADS = """<?xml version="1.0"?><OpenSimDocument Version="40000"><ExternalLoads name="loads">
<objects>{objects}</objects><datafile>{data}</datafile></ExternalLoads></OpenSimDocument>"""


@dataclass(frozen=True)
class Case:
    """A model, a motion or states, and a time [s].

    `kind`: "coordinates" or "states"; `balanced`: whether muscles are put into equilibrium;
    `muscles`: how the model's muscles are changed: "", "degroote", or "undamped and rigid".
    """

    name: str
    model: str
    motion: str
    kind: str
    start: float
    end: float
    body: str
    balanced: bool = False
    muscles: str = ""
    loaded: bool = False
    cutoff: float = 6.0


STATES = f"{WALK}results_SO/results_states.sto"
CASES = (
    Case(
        name="Thelen, arm, default states",
        model=f"{SMALL}arm26_bounds.osim",
        motion=f"{SMALL}arm26_InverseKinematics.mot",
        kind="coordinates",
        start=0.25,
        end=0.75,
        body="r_ulna_radius_hand",
    ),
    Case(
        name="Thelen, arm, equilibrium",
        model=f"{SMALL}arm26_bounds.osim",
        motion=f"{SMALL}arm26_InverseKinematics.mot",
        kind="coordinates",
        start=0.25,
        end=0.75,
        body="r_ulna_radius_hand",
        balanced=True,
    ),
    Case(
        name="Millard, walk, states, plates",
        model=WALKER,
        motion=STATES,
        kind="states",
        start=11.1,
        end=11.3,
        body="tibia_r",
        loaded=True,
    ),
    Case(
        name="Millard, walk, equilibrium, plates",
        model=WALKER,
        motion=STATES,
        kind="states",
        start=11.1,
        end=11.3,
        body="tibia_r",
        balanced=True,
        loaded=True,
    ),
    Case(
        name="De Groote, walk, default states, plates",
        model=WALKER,
        motion=STATES,
        kind="states",
        start=11.1,
        end=11.3,
        body="tibia_r",
        balanced=False,
        muscles="degroote",
        loaded=True,
    ),
    Case(
        name="De Groote, walk, equilibrium, plates",
        model=WALKER,
        motion=STATES,
        kind="states",
        start=11.1,
        end=11.3,
        body="tibia_r",
        balanced=True,
        muscles="degroote",
        loaded=True,
    ),
    Case(
        name="Millard undamped (right), rigid (left), walk, equilibrium",
        model=WALKER,
        motion=STATES,
        kind="states",
        start=11.1,
        end=11.3,
        body="tibia_r",
        balanced=True,
        muscles="undamped and rigid",
    ),
    Case(
        name="Millard, 10 coordinates, limit force, actuators of bodies",
        model=f"{SPRING}subject01_adjusted_spring.osim",
        motion=f"{SPRING}walk_subject01_Kinematics_q.sto",
        kind="coordinates",
        start=0.6,
        end=0.9,
        body="tibia_r",
        balanced=True,
        cutoff=-1.0,
    ),
    Case(
        name="Millard, shoulder with closed loops, equilibrium",
        model=f"{SHOULDER}model_rmr/TSM_subject_noWeight.osim",
        motion=f"{SHOULDER}ik/ABD01.mot",
        kind="coordinates",
        start=1.0,
        end=1.2,
        body="ulna",
        balanced=True,
    ),
)


def changed_model(data: Path, case: Case, folder: Path) -> Path:
    """Return the case's model, with the muscles that it wants."""
    if not case.muscles:
        return data / case.model
    import opensim

    model = opensim.Model(str(data / case.model))
    if case.muscles == "degroote":
        opensim.DeGrooteFregly2016Muscle.replaceMuscles(model)
    else:
        for one in model.getMuscles():
            muscle = opensim.Millard2012EquilibriumMuscle.safeDownCast(one)
            if one.getName().endswith("_l"):
                muscle.set_ignore_tendon_compliance(True)
            else:
                muscle.set_fiber_damping(0.0)
    model.finalizeConnections()
    path = folder / "model.osim"
    model.printToXML(str(path))
    return path


def setup_of(data: Path, case: Case, folder: Path, results: str) -> Path:
    """Write the case's setup; returns its path."""
    model = changed_model(data, case, folder)
    loads = ""
    if case.loaded:
        objects = "".join(
            LOAD.format(body=b, side=s) for b, s in (("calcn_r", ""), ("calcn_l", "1_"))
        )
        text = LOADS.format(objects=objects, data=data / WALK / "walking_baseline1_forces.mot")
        (folder / "loads.xml").write_text(text.replace("\n<", "<"))
        loads = "<external_loads_file>loads.xml</external_loads_file>"
    motion = data / case.motion
    if case.muscles:
        # Fiber lengths of other muscles mean nothing to these: only coordinates and their speeds
        # are left.
        table = mm.read_sto(motion)
        keep = [k for k, name in enumerate(table.names) if name.startswith("/jointset")]
        kept = mm.Table(
            table.time,
            tuple(table.names[k] for k in keep),
            table.values[:, keep],
            facts=table.facts,
        )
        motion = folder / "states.sto"
        mm.write_sto(kept, motion)
    analyses = ANALYSES.format(point=POINT.format(body=case.body))
    path = folder / f"{results}.xml"
    balanced = "true" if case.balanced else "false"
    path.write_text(
        SETUP.format(
            model=model,
            results=results,
            start=case.start,
            end=case.end,
            balanced=balanced,
            analyses=analyses,
            loads=loads,
            kind=case.kind,
            motion=motion,
            cutoff=case.cutoff,
        )
    )
    return path


def measure(data: Path) -> Iterator[dict[str, object]]:
    """One row a case and analysis: how far the columns of both programs' tables are apart."""
    for case in CASES:
        with tempfile.TemporaryDirectory() as work:
            folder = Path(work)
            run_tool(setup_of(data, case, folder, "ours"))
            failed = run_in_opensim(setup_of(data, case, folder, "theirs"), "AnalyzeTool")
            if failed:
                raise RuntimeError(f"{case.name}: OpenSim: {failed}")
            yield from rows_of(case, folder)


def rows_of(case: Case, folder: Path) -> Iterator[dict[str, object]]:
    """Rows of one case, an analysis each."""
    names = {
        kind: {path.name for path in (folder / kind).glob("*.sto")} for kind in ("ours", "theirs")
    }
    groups: dict[str, list[str]] = {}
    for name in sorted(names["theirs"] & names["ours"]):
        groups.setdefault(name.split("_")[1].removesuffix(".sto"), []).append(name)
    if lacking := names["theirs"] ^ names["ours"]:
        raise RuntimeError(f"{case.name}: only one program writes {', '.join(sorted(lacking))}")
    for analysis, files in groups.items():
        shares = []
        alike = 0
        frames = 0
        worst = (-1.0, "")
        for name in files:
            ours = read_table(folder / "ours" / name)
            theirs = read_table(folder / "theirs" / name)
            alike += ours[1] == theirs[1] and len(ours[0]) == len(theirs[0])
            frames = len(theirs[0])
            common = [one for one in theirs[1] if one in ours[1]]
            share = apart(
                *(one[2][:, [one[1].index(column) for column in common]] for one in (ours, theirs))
            )
            shares += list(share)
            k = int(np.argmax(share))
            if share[k] > worst[0]:
                table = name.removeprefix(f"a_{analysis}_").removesuffix(".sto")
                worst = (float(share[k]), f"{table}: {common[k]}")
        yield {
            "case": case.name,
            "analysis": analysis,
            "tables": len(files),
            "alike": alike,
            "frames": frames,
            "columns": len(shares),
            "median": float(np.median(shares)),
            "99th percentile": float(np.percentile(shares, 99)),
            "worst": worst[0],
            "where": worst[1],
        }
