"""From what the page asks for to results, by the functions of `analyze`."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.movement import MOVEMENTS
from myomorph.core.motion.protocols import ProtocolTable
from myomorph.lab.analyze.analyze import PROPOSED, prepare_request
from myomorph.lab.analyze.recorded_trial import AnalyzeRequest, read_protocols
from myomorph.lab.cli.running import Running
from myomorph.lab.report.trial.gait.gait_page import GAIT_PAGE
from myomorph.lab.session.statements import StatedPerson, StatedTrial, Statements
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.study.plan.plan import Plan, read_plan
from myomorph.lab.study.run.job_plan import graph_of
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.run.step_times import StepTimes, times_file
from myomorph.lab.study.run.work import Graph, Work
from myomorph.lab.study.summary.study_tables import PAGE
from myomorph.lab.study.trial.reporting import REPORT
from myomorph.show.app.asked import Asked, AskedPerson, AskedTrial
from myomorph.show.app.found import landmark_words
from myomorph.show.app.words import in_page_words

COMMAND = "myomorph app"
LABELS_HEAD = "# What markers lie on, as stated on the page of 'myomorph app'.\n[common.labels]\n"


def compute(asked: Asked, say: Callable[..., None]) -> None:
    """Prepare the study and run it, as `analyze` does.

    Parameters
    ----------
    asked : by the page
    say : sends events: `planned` before the first job, `ended` after each, `done` at last
    """
    out = asked.out
    prepared = prepare_request(request_of(asked), out)
    plan = read_plan(prepared.study)
    workers = Running().hands(len(plan.trials) + len(plan.together), out)
    say(
        "planned",
        jobs=_planned(graph_of(plan, out)),
        side=workers.count,
        assumed=list(prepared.assumed),
        study=str(prepared.study),
    )

    def ended(outcome: Outcome) -> None:
        say("ended", subject=outcome.subject, trial=outcome.trial, error=outcome.error)

    outcomes = run_study(plan, out, workers=workers, report=ended)
    say("done", **_answer(plan, out, outcomes))


def request_of(asked: Asked) -> AnalyzeRequest:
    """Request of `analyze`, with what the page says of recordings and people."""
    used = asked.used
    statements = Statements(
        trials=FrozenMap({Path(trial.path): _stated_trial(trial) for trial in used}),
        people=FrozenMap({name: _stated_person(person) for name, person in asked.people.items()}),
    )
    return AnalyzeRequest(
        recordings=tuple(Path(trial.path) for trial in used),
        model=Path(asked.model) if asked.model else None,
        arms=asked.arms,
        table=_table(asked),
        command=COMMAND,
        statements=statements,
    )


def _stated_trial(trial: AskedTrial) -> StatedTrial:
    movement = next((name for name in MOVEMENTS if name == trial.movement), "")
    return StatedTrial(
        person=trial.person,
        movement=movement,  # type: ignore[arg-type]
        plates=trial.plates,
    )


def _stated_person(person: AskedPerson) -> StatedPerson:
    static = Path(person.static) if person.static else None
    return StatedPerson(mass=person.mass, height=person.height, age=person.age, static=static)


def _table(asked: Asked) -> ProtocolTable | None:
    """Protocols with what is said of labels, which a file beside the study keeps."""
    if not asked.labels:
        return None
    known = landmark_words()
    lines = [LABELS_HEAD]
    for label, place in asked.labels.items():
        check_name("place of a marker", place, known, "the list")
        lines.append(f"{json.dumps(label)} = {json.dumps(known[place])}\n")
    path = asked.out / PROPOSED
    try:
        asked.out.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(lines), encoding="utf-8")
    except OSError as error:
        reason = error.strerror or error
        raise BadData(f"{path}: cannot be written ({reason}): give another folder") from None
    return read_protocols(path)


def _planned(graph: Graph) -> list[dict[str, Any]]:
    """Jobs with what their steps are expected to take."""
    times = StepTimes(times_file())
    files = dict.fromkeys(work.model for work in graph.works if work.model is not None)
    muscles = [len(graph.open_model(path).muscles) for path in files if path.is_file()]
    jobs = [_planned_job(work, times, max(muscles, default=0)) for work in graph.works]
    return [*jobs, {"subject": "", "trial": "", "steps": ["tables"], "seconds": [None]}]


def _planned_job(work: Work, times: StepTimes, muscles: int) -> dict[str, Any]:
    frames = work.frames()
    seconds = [
        times.expected(step, work.settings.get(step, {}), muscles, frames) for step in work.steps
    ]
    return {
        "subject": work.outcome.subject,
        "trial": work.outcome.trial,
        "steps": list(work.steps),
        "seconds": seconds,
    }


def _answer(plan: Plan, out: Path, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Pages of a run, the one that answers first, and what failed."""
    by_key = {outcome.key: outcome for outcome in outcomes}
    trials = [
        _trial_answer(by_key.get((files.subject, files.name)), plan, out, files.name, files.subject)
        for files in plan.trials
    ]
    others = [
        {"name": outcome.subject or "tables", "error": in_page_words(outcome.error)}
        for outcome in outcomes
        if outcome.error and not outcome.trial
    ]
    ready = [trial for trial in trials if trial["pages"]]
    study = PAGE if len(trials) > 1 and (out / PAGE).is_file() else ""
    first = study
    if not first and ready:
        first = ready[0]["pages"][0]["place"]
    return {"trials": trials, "others": others, "study": study, "open": first, "out": str(out)}


def _trial_answer(
    outcome: Outcome | None, plan: Plan, out: Path, name: str, subject: str
) -> dict[str, Any]:
    """Pages of a trial, and why it failed."""
    home = plan.home(out, subject, name)
    error = "" if outcome is None else outcome.error
    pages = [
        {"text": text, "place": (home / page).relative_to(out).as_posix()}
        for text, page in (("Report", REPORT), ("Page for the clinic", GAIT_PAGE))
        if (home / page).is_file() and not error
    ]
    return {"name": name, "subject": subject, "error": in_page_words(error), "pages": pages}
