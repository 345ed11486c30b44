"""How much of its fitness a damaged robot gets back, over a list of damages that was fixed before its first run.

``python bench/adapt.py zoo/qd_hopper --out build/adapt --seconds 500`` simulates for so long at most; the same command
goes on, and prints the tables of docs/adaptation.md once everything is there. Each repertoire needs its own folder.

Every elite runs from the same few poses under each damage. A trial of an adaptation, or of random search, is one of
these episodes, drawn at random; what was chosen counts by the mean over all of the elite's episodes. The hindsight
best is the elite with the greatest of these means. The hill climber's episodes are simulated.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import mannwhitneyu, wilcoxon

from pga_me_ros import StoredRun, make_task
from pga_me_ros.adapt_demo.robot import POSES, Robot, Way
from pga_me_ros.core.adaptation.adaptation import Adaptation
from pga_me_ros.core.adaptation.adaptation_settings import AdaptationSettings
from pga_me_ros.core.adaptation.alternatives import random_search
from pga_me_ros.core.adaptation.performance_map import PerformanceMap
from pga_me_ros.core.archive.worlds import Worlds

DAMAGES = {
    "qd_hopper": (
        "weak thigh_joint 0.5",
        "weak leg_joint 0.5",
        "weak foot_joint 0.5",
        "jam foot_joint",
        "jam leg_joint -0.3",
        "load 2",
        "slope 5",
        "slope -5",
        "ice 0.5",
        "ice 0.25",
    ),
    "qd_walker": (
        "weak leg_joint 0.5",
        "weak thigh_left_joint 0.5",
        "jam foot_joint",
        "jam leg_left_joint -0.5",
        "free foot_left_joint",
        "load 2",
        "slope 5",
        "ice 0.5",
    ),
    "qd_half_cheetah": (
        "weak bthigh 0.5",
        "jam bfoot",
        "jam ffoot",
        "free fshin",
        "gone bfoot",
        "load 5",
        "slope 5",
        "ice 0.3",
    ),
}
TUNING = (
    "weak thigh_joint 0.4",
    "weak leg_joint 0.7",
    "jam foot_joint -0.2",
    "load 1",
    "slope 3",
    "slope -3",
    "ice 0.35",
    "weak foot_joint 0.6",
)
"""Other damages of the hopper, on which `--tune` compares length scales; none of them counts as evidence."""

SCALES = ((0.4, 0.0), (0.2, 0.0), (0.1, 0.0), (0.05, 0.0), (0.02, 0.0), (0.4, 0.02))
"""What `--tune` compares: `length_scale` and `least_length_scale`."""

REPEATS = 20
BUDGET = 15
CLIMBS = 20


class TimeUpError(Exception):
    """The seconds of this call are over."""


@dataclass
class Bench:
    """The repertoire, and where results are kept."""

    run: Any
    out: Path
    deadline: float
    worlds: Worlds | None = None

    def __post_init__(self) -> None:
        """Read what the repertoire promises."""
        self.promises = PerformanceMap.of(self.run.choices())
        self.cells = self.promises.cells.tolist()

    def file(self, damage: str, kind: str) -> Path:
        """Return the file of one kind of result."""
        return self.out / f"{kind}-{damage.replace(' ', '_')}.npz"

    def kept(self, file: Path, count: int, width: int) -> np.ndarray:
        """Return the rows of a file, NaN where they are missing."""
        rows = np.full((count, width), np.nan)
        if file.exists():
            with np.load(file) as stored:
                if stored["fitness"].shape != rows.shape:
                    raise SystemExit(f"{file} is of another repertoire; give another --out")
                rows[:] = stored["fitness"]
        return rows

    def table(self, damage: str) -> np.ndarray:
        """Return the fitness of each elite from each pose, (elites, POSES); '' is the sound robot."""
        file = self.file(damage, "elites")
        rows = self.kept(file, len(self.cells), POSES)
        missing = np.flatnonzero(np.isnan(rows).any(axis=1))
        if len(missing):
            task = make_task(self.run.settings.task, damage=damage)
            try:
                robot = Robot(task)
                for row in missing.tolist():
                    self.check_time()
                    controller = self.run.behavior(self.cells[row]).controller
                    rows[row] = [robot.episode(controller, k).fitness for k in range(POSES)]
            finally:
                save(file, rows)
                task.close()
        return rows

    def climbs(self, damage: str) -> np.ndarray:
        """Return the mean fitness, over all poses, of what each hill climb ended with, (CLIMBS,)."""
        file = self.file(damage, "climbs")
        rows = self.kept(file, CLIMBS, 1)
        missing = np.flatnonzero(np.isnan(rows[:, 0]))
        if len(missing):
            shape, best = self.run.shape, self.run.choose()
            task = make_task(self.run.settings.task, damage=damage)
            try:
                robot = Robot(task)
                for row in missing.tolist():
                    self.check_time()
                    found = robot.climb(shape, best.parameters, Way.CLIMB.generator(row))
                    rows[row] = robot.average(found).fitness
            finally:
                save(file, rows)
                task.close()
        return rows[:, 0]

    @property
    def damages(self) -> tuple[str, ...]:
        """What this robot suffers."""
        return DAMAGES[self.run.settings.task]

    def check_time(self) -> None:
        """Raise TimeUpError if the seconds are over."""
        if time.monotonic() > self.deadline:
            raise TimeUpError


def save(file: Path, rows: np.ndarray) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    np.savez(file, fitness=rows)


def scaled(length_scale: float, least: float, sound: float) -> AdaptationSettings:
    return AdaptationSettings(BUDGET, length_scale, least, sound=sound)


def adapted(
    bench: Bench, table: np.ndarray, repeat: int, settings: AdaptationSettings
) -> tuple[int, int]:
    """Return the row of what an adaptation ended with, and the number of its trials."""
    rng = Way.ADAPT.generator(repeat)
    adaptation = Adaptation(bench.promises, settings, worlds=bench.worlds)
    while trial := adaptation.next():
        row = bench.cells.index(trial.cell)
        adaptation.report(float(table[row, rng.integers(POSES)]))
    best = adaptation.best
    assert best is not None
    return bench.cells.index(best.cell), len(adaptation.trials)


def searched(bench: Bench, table: np.ndarray, repeat: int, trials: int) -> int:
    """Return the row of what random search ended with."""
    rng = Way.RANDOM.generator(repeat)
    rows = range(len(bench.cells))
    return random_search(rows, trials, lambda row: float(table[row, rng.integers(POSES)]), rng)


def tune(bench: Bench, sound: float) -> None:
    """Print what each length scale recovers of the hindsight best, and what random search does with as many trials."""
    names = " | ".join(f"`{damage}`" for damage in TUNING)
    print(f"| length scale | {names} | better than random |")
    print("|---|" + "---|" * (len(TUNING) + 1))
    for length_scale, least in SCALES:
        settings, cells, better = scaled(length_scale, least, sound), [], 0
        for damage in TUNING:
            table = bench.table(damage)
            means = table.mean(axis=1)
            done = [adapted(bench, table, k, settings) for k in range(REPEATS)]
            ours = np.median([means[row] for row, _ in done])
            random = np.median(
                [means[searched(bench, table, k, n)] for k, (_, n) in enumerate(done)]
            )
            trials = np.median([count for _, count in done])
            cells.append(f"{ours / means.max():.0%}, {random / means.max():.0%} ({trials:g})")
            better += ours > random
        name = f"{least} to {length_scale}" if least else f"{length_scale}"
        print(f"| {name} | {' | '.join(cells)} | {better} |")


def report(bench: Bench, settings: AdaptationSettings) -> None:
    """Print the tables; every number in them comes from the files."""
    sound = bench.table("").mean(axis=1)
    first = int(np.argmax(bench.promises.fitness))
    print(f"sound: promised gait {sound[first]:.0f}, best elite {sound.max():.0f}\n")
    print(
        "| damage | promised gait | adapted | trials | random, as many | random, 15 | climb, 20 | hindsight best | "
        "recovered | p |"
    )
    print("|---|" + "---|" * 9)
    shares, counts, pairs = [], [], []
    for damage in bench.damages:
        table = bench.table(damage)
        means = table.mean(axis=1)
        done = [adapted(bench, table, k, settings) for k in range(REPEATS)]
        ours = np.array([means[row] for row, _ in done])
        trials = np.array([count for _, count in done])
        equal = np.array([means[searched(bench, table, k, n)] for k, (_, n) in enumerate(done)])
        longer = np.array([means[searched(bench, table, k, BUDGET)] for k in range(REPEATS)])
        climbed = bench.climbs(damage)
        p = mannwhitneyu(ours, equal, alternative="greater").pvalue
        share = np.median(ours) / means.max()
        shares.append(share)
        counts.append(np.median(trials))
        pairs.append((np.median(ours), np.median(equal), np.median(longer), np.median(climbed)))
        print(
            f"| `{damage}` | {means[first]:.0f} | {np.median(ours):.0f} | {np.median(trials):.0f} | "
            f"{np.median(equal):.0f} | {np.median(longer):.0f} | {np.median(climbed):.0f} | {means.max():.0f} | "
            f"{100 * share:.0f} % | {p:.2g} |"
        )
    ours, equal, longer, climbed = (np.array(column) for column in zip(*pairs, strict=True))
    print(
        f"\nrecovered, median over damages: {100 * np.median(shares):.0f} %; least {100 * min(shares):.0f} %; "
        f"damages with 70 % or more: {sum(s >= 0.7 for s in shares)} of {len(shares)}; trials, median over damages: "
        f"{np.median(counts):g}"
    )
    for name, other in (("random, as many", equal), ("random, 15", longer), ("climb, 20", climbed)):
        p = wilcoxon(ours, other, alternative="greater").pvalue
        print(
            f"over damages, adapted against {name}: better in {(ours > other).sum()}, p = {p:.2g}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("repertoire", nargs="?", default="zoo/qd_hopper")
    parser.add_argument("--out", type=Path, default=Path("build/adapt"))
    parser.add_argument("--seconds", type=float, default=500.0)
    parser.add_argument(
        "--tune", action="store_true", help="compare length scales on other damages"
    )
    parser.add_argument("--length-scale", type=float, default=AdaptationSettings().length_scale)
    parser.add_argument("--least-length-scale", type=float, default=0.0)
    parser.add_argument(
        "--worlds", action="store_true", help="the robot may be in the repertoire's other worlds"
    )
    parser.add_argument("--sound", type=float, default=AdaptationSettings().sound)
    args = parser.parse_args()
    run = StoredRun.load(args.repertoire)
    if args.worlds and run.worlds is None:
        parser.error(f"{args.repertoire} has not been evaluated in other worlds")
    worlds = run.worlds if args.worlds else None
    bench = Bench(run, args.out, time.monotonic() + args.seconds, worlds)
    try:
        for damage in TUNING if args.tune else ("", *bench.damages):
            bench.table(damage)
            if damage and not args.tune:
                bench.climbs(damage)
            print(f"there: {damage or 'sound'}", flush=True)
    except TimeUpError:
        print("time is up; the same command goes on")
        return
    if args.tune:
        tune(bench, args.sound)
    else:
        report(bench, scaled(args.length_scale, args.least_length_scale, args.sound))


if __name__ == "__main__":
    main()
