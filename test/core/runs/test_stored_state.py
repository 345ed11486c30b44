"""The state that a run resumes from: damage is reported or repaired, and repairs give the same bits."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from graph_in_small import GraphInSmall
from lane_task import SETTINGS

from pga_me_ros.core.runs.stored_state import require_sound_state
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.errors import StorageError

T = 6
"""Committed generations; the first two are random."""

NEWEST, BEFORE = f"critic-{T:08d}.ckpt", f"critic-{T - 1:08d}.ckpt"
SMALL_BUFFER = SETTINGS.replace(replay_size=150)
"""Settings with a replay buffer of about three generations, so that older experience is deleted."""


def rates(settings: Settings) -> dict[str, Any]:
    return {name: getattr(settings, name) for name in RATES}


def check(folder: Path, settings: Settings = SETTINGS, now: Settings | None = None) -> list[str]:
    """Check a run of `T` generations with the rates of `settings`; those of the next generation are `now`."""
    return require_sound_state(folder, [rates(settings)] * T, settings, now or settings)


@pytest.fixture(scope="module")
def grown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("grown")
    GraphInSmall(SETTINGS, folder).grow(range(T))
    return folder


@pytest.fixture
def run(grown: Path, tmp_path: Path) -> Path:
    """Return a copy of a run's folder, to be damaged."""
    return Path(shutil.copytree(grown, tmp_path / "run"))


def flip(share: float) -> Callable[[Path], None]:
    def damage(path: Path) -> None:
        content = bytearray(path.read_bytes())
        content[int(share * (len(content) - 1))] ^= 4
        path.write_bytes(content)

    return damage


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def other_version(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[7:8] = b"2"
    path.write_bytes(content)


FAULTS: dict[str, Callable[[Path], None]] = {
    "bit at the beginning": flip(0.0),
    "bit in the header": flip(0.02),
    "bit in the middle": flip(0.5),
    "bit at the end": flip(1.0),
    "cut in half": cut,
    "empty": lambda path: path.write_bytes(b"") and None,
    "other version": other_version,
    "missing": Path.unlink,
}


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_an_undamaged_run_resumes_without_a_note(run: Path) -> None:
    before = names(run)
    assert check(run) == []
    assert names(run) == before


@pytest.mark.parametrize("fault", FAULTS)
def test_damaged_critics_are_set_aside_and_trained_again(run: Path, fault: str) -> None:
    FAULTS[fault](run / NEWEST)
    notes = check(run)
    if fault == "missing":
        (note,) = notes
        assert note.startswith(
            f"the training for {NEWEST} had not finished, or its file was removed"
        )
    else:
        assert notes[0] == f"the training that made {NEWEST} is repeated"
    assert not (run / NEWEST).exists()
    assert (run / f"{NEWEST}.damaged").exists() == (fault != "missing")


@pytest.mark.parametrize("settings", [SETTINGS, SMALL_BUFFER], ids=["all", "small buffer"])
def test_a_run_whose_critics_were_damaged_ends_with_the_same_repertoire(
    tmp_path: Path, settings: Settings
) -> None:
    graph, undisturbed = (GraphInSmall(settings, tmp_path / name) for name in "ab")
    undisturbed.grow(range(T + 2))
    graph.grow(range(T))
    flip(0.5)(tmp_path / "a" / NEWEST)
    assert check(tmp_path / "a", settings)
    graph.restart_learner()
    graph.grow(range(T, T + 2))
    assert graph.archive.digest() == undisturbed.archive.digest()


def test_the_buffer_can_be_filled_for_a_repeated_training_during_a_generation(
    tmp_path: Path,
) -> None:
    GraphInSmall(SMALL_BUFFER, tmp_path).grow(range(T + 1))  # the last one is not committed
    flip(0.5)(tmp_path / NEWEST)
    assert check(tmp_path, SMALL_BUFFER)


@pytest.mark.parametrize("fault", FAULTS)
def test_critics_that_cannot_be_recreated_are_reported_and_nothing_is_changed(
    run: Path, fault: str
) -> None:
    for name in (NEWEST, BEFORE):
        FAULTS[fault](run / name)
    before = names(run)
    with pytest.raises(StorageError, match=f"{NEWEST}.*cannot be repeated.*repertoire.db"):
        check(run)
    assert names(run) == before


def test_damaged_critics_that_are_no_longer_needed_are_set_aside(run: Path) -> None:
    flip(0.5)(run / BEFORE)
    (note,) = check(run)
    assert note == f"{BEFORE} is damaged and was renamed to {BEFORE}.damaged"


def test_critics_are_recreated_even_if_the_next_generation_uses_none(run: Path) -> None:
    flip(0.5)(run / NEWEST)
    assert check(run, now=SETTINGS.replace(n_evo=SETTINGS.batch_size))


def test_recreating_them_needs_their_experience(run: Path) -> None:
    (run / NEWEST).unlink()
    (run / "experience" / "experience-00000000.ckpt").unlink()
    with pytest.raises(StorageError, match=r"experience-00000000\.ckpt"):
        check(run, now=SETTINGS.replace(n_evo=SETTINGS.batch_size))


def first_training(folder: Path, **changes: Any) -> Settings:
    """Grow a run up to its first training, for the next generation; return its settings."""
    settings = SETTINGS.replace(critic_start="last_init_batch", **changes)
    GraphInSmall(settings, folder).grow(range(2))
    (folder / "critic-00000002.ckpt").unlink()
    return settings


def test_the_first_training_is_repeated_from_nothing(tmp_path: Path) -> None:
    settings = first_training(tmp_path, greedy_init="random")
    history: Sequence[dict[str, Any]] = [rates(settings)] * 2
    assert require_sound_state(tmp_path, history, settings, settings)


def test_the_first_training_is_not_repeated_from_another_best_controller(tmp_path: Path) -> None:
    settings = first_training(tmp_path, greedy_init="best")
    with pytest.raises(StorageError, match="are missing"):
        require_sound_state(tmp_path, [rates(settings)] * 2, settings, settings)


@pytest.mark.parametrize("generation", [0, 3, T - 1])
@pytest.mark.parametrize("fault", FAULTS)
def test_damaged_experience_that_the_critics_need_is_reported(
    run: Path, generation: int, fault: str
) -> None:
    FAULTS[fault](run / "experience" / f"experience-{generation:08d}.ckpt")
    with pytest.raises(StorageError, match=f"experience-{generation:08d}.ckpt"):
        check(run)


def test_experience_that_the_buffer_has_overwritten_may_be_damaged(tmp_path: Path) -> None:
    GraphInSmall(SMALL_BUFFER, tmp_path).grow(range(T))
    flip(0.5)(min((tmp_path / "experience").iterdir()))
    assert check(tmp_path, SMALL_BUFFER) == []


def test_a_run_that_trains_no_critics_needs_none_of_it(tmp_path: Path) -> None:
    settings = SETTINGS.replace(n_evo=SETTINGS.batch_size)
    assert check(tmp_path, settings) == []
