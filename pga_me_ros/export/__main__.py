"""``ros2 run pga_me_ros export RUN --to FORMAT``: a repertoire, or one of its controllers, for other programs."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.runs.stored_actor import StoredActor
from pga_me_ros.core.storage.files import save_bytes
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.export.arrays import write_npz, write_pyribs
from pga_me_ros.export.source import Source
from pga_me_ros.export.table import write_csv
from pga_me_ros.paths import user_path
from pga_me_ros.process.program import run_program

TABLES = {"npz": (write_npz, ".npz"), "csv": (write_csv, ".csv"), "pyribs": (write_pyribs, ".npz")}
"""Formats with all elites in one file: the function that writes it, and its suffix."""

MODELS = {"onnx": ".onnx", "torchscript": ".pt"}
"""Formats with one file per controller, and its suffix."""


def main(args: Sequence[str] | None = None) -> int:
    """Export as the command line says, and print the name of the file or folder.

    Args:
        args: Command line without the program's name, None for that of this process.

    Returns:
        Exit status, as for `run_program`.
    """
    options = _parser().parse_args(args)
    return run_program(lambda: print(export(options)))


def export(options: argparse.Namespace) -> Path:
    """Carry out a parsed command line.

    Returns:
        The file or folder that was written.

    Raises:
        PgaError: The run cannot be read, has no such elite, or the export cannot be written.
    """
    if options.single and not options.best:
        raise RequestError("--single says how the fittest is chosen; give it together with --best.")
    if options.actor:
        return _export_actor(options)
    make = _model_maker(options.to) if options.to in MODELS else None
    source = Source.load(
        options.run,
        cell=options.cell,
        best=options.best,
        evaluation=options.evaluation,
        single=options.single,
    )
    if options.best:
        print(f"note: {_judged(source, single=options.single)}", file=sys.stderr)
    if source.run.archive.note:
        print(f"note: {source.run.archive.note}", file=sys.stderr)
    out = options.out or Path(_default_name(source, options.to))
    if make is None or source.one:
        _require_file(out)
        if make is None:
            TABLES[options.to][0](source, out)
        else:
            save_bytes(out, make(source, next(source.elites())))
        return out
    _make_folder(out)
    width = len(str(source.run.archive.cells - 1))
    for elite in source.elites():
        save_bytes(out / f"cell-{elite.cell:0{width}d}{MODELS[options.to]}", make(source, elite))
    return out


def export_evaluation(run: Path, kind: str, evaluation: int, out: Path) -> Path:
    """Write a controller, as ``export RUN --to KIND --evaluation K --out PATH`` does, and return the file.

    Raises:
        PgaError: As in `export`.
    """
    words = [str(run), "--to", kind, "--evaluation", str(evaluation), "--out", str(out)]
    return export(_parser().parse_args(words))


def _judged(source: Source, *, single: bool) -> str:
    """Return by what the fittest elite was chosen."""
    (cell,), known = source.cells, source.run.statistics
    fitness, repeats = source.run.archive.fitness[cell], known.repeats[cell]
    if single or not repeats:
        return f"the behavior of cell {cell} has fitness {fitness:.1f} in its single evaluation"
    return (
        f"the behavior of cell {cell} has the fitness {known.mean_fitness[cell]:.1f} on average of {repeats} "
        f"re-evaluations, {100.0 * known.fall_share[cell]:.0f} % of them falls (found with {fitness:.1f}; --single "
        "chooses by that)"
    )


def _export_actor(options: argparse.Namespace) -> Path:
    """Write the actor of a run that learns one, and return the file."""
    if options.to != "onnx":
        raise RequestError(
            f"--actor is exported as an ONNX model, not --to {options.to}; write --to onnx --actor."
        )
    from pga_me_ros.export.onnx_model import onnx_actor_bytes, require_onnx

    require_onnx()
    run = StoredRun.load(options.run, elites=False)
    out = options.out or Path(f"{run.name}-actor{MODELS[options.to]}")
    stored = StoredActor.of(run)
    if stored.note:
        print(f"note: {stored.note}", file=sys.stderr)
    content = onnx_actor_bytes(run, stored.actor)
    _require_file(out)
    save_bytes(out, content)
    return out


def _require_file(out: Path) -> None:
    """Make sure that a file can be written: it names no folder, and its own folder is there.

    Raises:
        StorageError: It names a folder, or its folder cannot be made.
    """
    if out.is_dir():
        raise StorageError(f"'{out}' is a folder; give --out the name of a file.")
    _make_folder(out.parent)


def _model_maker(kind: str) -> Callable[[Source, Elite], bytes]:
    """Return the function that makes a model of a controller; missing packages are reported before a run is read."""
    if kind == "onnx":
        from pga_me_ros.export.onnx_model import onnx_bytes, require_onnx

        require_onnx()
        return onnx_bytes
    from pga_me_ros.export.torchscript import require_torch, torchscript_bytes

    require_torch()
    return torchscript_bytes


def _default_name(source: Source, kind: str) -> str:
    which = f"-cell{source.cells[0]}" if source.one else ""
    mark = "-pyribs" if kind == "pyribs" else ""
    if kind in TABLES:
        return f"{source.run.name}{which}{mark}{TABLES[kind][1]}"
    return f"{source.run.name}{which}{MODELS[kind]}" if source.one else f"{source.run.name}-{kind}"


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(
            f"Cannot make the folder '{path}' ({error.strerror}); give --out another name."
        ) from None


def _parser() -> argparse.ArgumentParser:
    parser = ArgumentParser(
        prog="export",
        description="Write a repertoire, or one controller of it, for other programs; docs/export.md has the formats.",
    )
    parser.add_argument(
        "run", type=user_path, metavar="RUN", help="folder of a run, or repertoire file"
    )
    parser.add_argument("--to", required=True, choices=[*TABLES, *MODELS], help="format")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--cell", type=int, metavar="N", help="only the controller of this cell")
    which.add_argument(
        "--best",
        action="store_true",
        help="only the fittest controller, by the means of its re-evaluations if it has any",
    )
    which.add_argument(
        "--evaluation", type=int, metavar="K", help="only the controller of this evaluation"
    )
    which.add_argument(
        "--actor",
        action="store_true",
        help="the actor, with the descriptor as a second input (onnx; repertoires of dcrl_map_elites)",
    )
    parser.add_argument(
        "--single",
        action="store_true",
        help="with --best: the fittest in its single evaluation, also where means of re-evaluations are known",
    )
    parser.add_argument(
        "--out", type=user_path, metavar="PATH", help="file to write; folder for several models"
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
