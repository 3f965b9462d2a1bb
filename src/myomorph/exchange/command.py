"""`export` and `run-tool`."""

from __future__ import annotations

from pathlib import Path

from myomorph.lab.cli.options import Threads, documented, use_threads
from myomorph.lab.cli.output import said, warn

UNSOLVED = 2  # Exit status where frames of a tool have no solution, as for other faults of inputs.


@documented
def export_command(
    source: Path,
    /,
    *,
    mjcf: Path | None = None,
    bids: Path | None = None,
    geometry: Path | None = None,
    motion: Path | None = None,
) -> int:
    """Export a model for MuJoCo 3 and 4 with a certificate, or a study as a dataset of BIDS.

    The certificate says which muscle differs, where and by how much.

    Parameters
    ----------
    source : with --mjcf a model (.osim or .xml), or one of myo-sim by name (myo-sim:myoarm); with
        --bids a folder of results
    mjcf : MuJoCo file to write (.xml); meshes and tables (differences, muscle curves) go into a
        folder next to it
    bids : BIDS dataset to write: a folder of recordings and results (motion, EMG)
    geometry : folder of the model's meshes; by default those next to the model and in its folder
        Geometry
    motion : with --mjcf, coordinates (.mot, .sto) along which muscle lengths are compared, too
    """
    from myomorph.core.model.errors import BadData

    if mjcf is not None and bids is None:
        return _mjcf(source, mjcf, geometry, motion)
    if bids is None or mjcf is not None:
        which = "both --mjcf and --bids are" if bids is not None else "neither --mjcf nor --bids is"
        raise BadData(
            f"{which} given: a model takes --mjcf FILE.xml, a folder of results --bids FOLDER"
        )
    from myomorph.exchange.bids.dataset import export_bids

    warn(export_bids(source, bids), "recordings are looked for where results name them")
    said(f"wrote {bids}")
    return 0


def _mjcf(model: Path, mjcf: Path, geometry: Path | None, motion: Path | None) -> int:
    from myomorph.core.io.formats import read_model
    from myomorph.core.model.errors import BadFile
    from myomorph.exchange.mujoco.export import write_mjcf, write_tables
    from myomorph.lab.study.inputs.reading import read_motion

    if mjcf.suffix.lower() != ".xml":
        raise BadFile(
            mjcf, f"is no name for MuJoCo's file: it ends in '{mjcf.suffix}'", "expected .xml"
        )
    if geometry is not None and not geometry.is_dir():
        raise BadFile(geometry, "is not a folder", "give the folder of the model's meshes")
    read = read_model(model)
    moved = None if motion is None else read_motion(motion, read)
    certificate = write_mjcf(read, mjcf, () if geometry is None else (geometry,), moved)
    for line in certificate.lines:
        said(line)
    tables = write_tables(read, certificate, mjcf)
    names = ", ".join(path.name for path in tables)
    said(f"wrote {mjcf}, {names}")
    return 0


@documented
def run_tool_command(setup: Path, /, *, threads: Threads = None) -> int:
    """Run an OpenSim setup file.

    Where frames have no solution, files are written, and the exit status is 2.

    Parameters
    ----------
    setup : OpenSim setup file (.xml) of one of the four tools
    threads : number of threads; all cores by default
    """
    from myomorph.exchange.opensim.run import run_tool

    use_threads(threads)
    result = run_tool(setup)
    warn(result.warnings)
    for line in result.lines:
        said(f"{result.tool}: {line}")
    for path in result.written:
        said(f"wrote {path}")
    return 0 if result.solved else UNSOLVED
