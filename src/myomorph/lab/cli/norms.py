"""`norms`: a control group of one's own as a file of norms."""

from __future__ import annotations

from pathlib import Path

from myomorph.lab.cli.options import documented
from myomorph.lab.cli.output import said
from myomorph.lab.study.trial.result_folders import demo_model


@documented
def norms_command(folders: tuple[Path, ...], /, *, out: Path = Path("controls.csv")) -> int:
    """Make a file of norms of the walks of a control group, for report --norms.

    Parameters
    ----------
    folders : folders of results of three people or more
    out : file of norms to write (.csv)
    """
    from functools import partial

    from myomorph.core.model.errors import BadData, BadFile
    from myomorph.lab.study.trial.control_group import group_norm
    from myomorph.lab.study.trial.norm_file import write_norm
    from myomorph.lab.study.trial.reporting import gait_norms, model_of

    if not folders:
        raise BadData("no folder: give folders of results of a control group")
    if out.suffix.lower() != ".csv":
        raise BadFile(out, "is no name of a file of norms", "give a name that ends in .csv")
    names = tuple(map(str, folders))
    people = gait_norms(names, partial(model_of, demo_model=demo_model)).controls
    listed = ", ".join(people)
    norm = group_norm(tuple(people.values()), f"own control group: {listed}")
    write_norm(out, norm)
    said(f"wrote {out}: {len(people)} people ({listed})")
    return 0
