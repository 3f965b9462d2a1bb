"""Processor time of one command by part: imports, kernels from the cache, reading, steps.

Each part is counted without the parts inside it: an import within a step belongs to the imports.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence

PARTS = ("imports", "kernels", "reading", "steps", "rest")
WATCHED = """
import importlib.machinery as machinery, json, sys, time
from collections import Counter

LABELS = {
    "KernelCache.load_overload": "kernels",
    "open_trial": "reading",
    "read_model": "reading",
    "run_step": "steps",
}
stack, parts = [], Counter()

def watched(function, label):
    def call(*arguments, **options):
        began = time.process_time()
        stack.append(0.0)
        try:
            return function(*arguments, **options)
        finally:
            spent = time.process_time() - began
            parts[label] += spent - stack.pop()
            if stack:
                stack[-1] += spent
    return call

compiled = machinery.ExtensionFileLoader
compiled.create_module = watched(compiled.create_module, "imports")
compiled.exec_module = watched(compiled.exec_module, "imports")
executed = watched(machinery.SourceFileLoader.exec_module, "imports")

def exec_module(loader, module):
    executed(loader, module)
    if not module.__name__.startswith("myomorph."):
        return
    for path, label in LABELS.items():
        *owners, name = path.split(".")
        holder = module
        for owner in owners:
            holder = vars(holder).get(owner)
        function = None if holder is None else vars(holder).get(name)
        if getattr(function, "__module__", "") == module.__name__:
            setattr(holder, name, watched(function, label))

machinery.SourceFileLoader.exec_module = exec_module
from myomorph.lab.cli import main
status = main(sys.argv[1:])
parts["rest"] = time.process_time() - sum(parts.values())
sys.stderr.write("PARTS" + json.dumps(parts) + chr(10))
sys.exit(status)
"""


def processor_times(
    commands: Mapping[str, Sequence[str]],
    environments: Mapping[str, Mapping[str, str]],
    runs: int,
) -> dict[tuple[str, str], dict[str, float]]:
    """Medians of several runs, in turns.

    Parameters
    ----------
    commands : words of each command, by its name
    environments : variables of each version that is compared, by its name
    runs : of each command with each version, after one that warms the caches

    Returns
    -------
    by command and version, processor seconds of every part
    """
    times: dict[tuple[str, str], list[dict[str, float]]] = defaultdict(list)
    for run in range(runs + 1):
        for name, words in commands.items():
            for version, environment in environments.items():
                parts = _one_run(words, environment)
                if run:
                    times[name, version].append(parts)
    return {
        key: {part: statistics.median(run.get(part, 0.0) for run in found) for part in PARTS}
        for key, found in times.items()
    }


def _one_run(words: Sequence[str], environment: Mapping[str, str]) -> dict[str, float]:
    done = subprocess.run(
        [sys.executable, "-c", WATCHED, *words],
        env={**os.environ, **environment},
        check=True,
        capture_output=True,
        text=True,
    )
    line = next(line for line in done.stderr.splitlines() if line.startswith("PARTS"))
    parts: dict[str, float] = json.loads(line.removeprefix("PARTS"))
    return parts
