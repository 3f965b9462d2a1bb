"""The files of one recording opened into what the steps take."""

from __future__ import annotations

from dataclasses import replace

from myomorph.analysis.presets import preset_of
from myomorph.model.model import Model
from myomorph.store.results import file_source
from myomorph.store.settings import (
    ReportOptions,
    with_settings,
)
from myomorph.study.inputs.by_type import ByType, OptionSet
from myomorph.study.inputs.input import Opened, Opening
from myomorph.study.inputs.reading import open_model
from myomorph.study.inputs.table import INPUTS, input_of, inputs_of
from myomorph.study.step.step import step_head
from myomorph.study.step.step_table import REPORT, STEPS
from myomorph.study.trial.trial_files import Settings, TrialFiles
from myomorph.study.trial.trial_inputs import TrialInputs, TrialNotes


def open_trial(files: TrialFiles, settings: Settings, model: Model | None = None) -> TrialInputs:
    """Read the files of a recording and make of them what the steps take. Inputs are opened in the order of their
    table, those only that the trial has.
    """
    model = open_model(files.model) if model is None else model
    opening = Opening(files.model, model, options_of(settings), files.inputs, ByType())
    wanted, parts = inputs_of(files.inputs), list[Opened]()
    for name in INPUTS:
        if name not in wanted:
            continue
        declared = input_of(name)
        opened = declared.open(declared.settings() if wanted[name] is None else wanted[name], opening)
        parts.append(opened)
        if opened.values:
            wanted = dict.fromkeys(declared.holds) | wanted
        options, values = opening.options.having(*opened.options), opening.values.having(*opened.values)
        opening = replace(opening, options=options, values=values)
    real = ", ".join(part.real for part in parts if part.real)
    assumed = tuple(text for part in parts for text in part.assumed)
    texts = (*(f"{files.model.name}: {text}" for text in model.warnings), *(t for part in parts for t in part.warnings))
    return TrialInputs(
        name=files.name or (files.recording or files.model).stem,
        subject=files.subject or model.name,
        model=model,
        options=opening.options,
        inputs=opening.values,
        notes=TrialNotes((f"{real[0].upper()}{real[1:]}.",) if real else (), assumed),
        sources=(file_source("model", files.model), *(source for part in parts for source in part.sources)),
        warnings=texts,
    )


def options_of(settings: Settings) -> OptionSet:
    """What a study file or a command says to the steps, as values of their options.

    Options that several steps have, as the low-pass filter, are one for all: the last step that names one counts. Steps
    to which nothing is said are not looked at, so that commands without them start faster.
    """
    result = OptionSet()
    for name in (*STEPS["trial"], REPORT):
        if settings.get(name):
            own = step_head(name).options
            result = result.having(*(with_settings(result[kind], settings[name]) for kind in own))
    if result[ReportOptions].preset:
        preset_of(result[ReportOptions].preset)
    return result
