"""Critics trained on recordings equal those of a run; what is unclear is refused."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded import BATCH, COUNT, EPISODES, RUN, SPEC, shuffled, transitions, write

from pga_me_ros.core.algorithms.learners import make_learner
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.runs.critic_checkpoints import CriticCheckpoints
from pga_me_ros.core.runs.start_from import read_controllers
from pga_me_ros.core.settings import Settings
from pga_me_ros.recording.episodes import recorded_run
from pga_me_ros.replay.__main__ import main
from pga_me_ros.tasks.rollout import Episode

SMALL = {
    "task": "qd_hopper",
    "seed": 3,
    "controller_hidden": (8, 8),
    "critic_hidden": (16, 16),
    "transition_batch": 32,
    "critic_learning_rate": 1e-3,
}
OPTIONS = [
    word
    for name, value in SMALL.items()
    if name != "task"  # which is that of the recording
    for word in ("--set", f"{name}={list(value) if isinstance(value, tuple) else value}")
]
STEPS = 15


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("recording") / "bag", shuffled())


def learned(
    settings: Settings,
    evaluations: range = range(COUNT),
    episodes: Mapping[int, Episode] = EPISODES,
) -> dict[str, np.ndarray]:
    """Return the state of a learner that was fed by hand."""
    learner = make_learner(SPEC, settings)
    for generation in range(COUNT // BATCH):
        ids = range(generation * BATCH, (generation + 1) * BATCH)
        learner.add(generation, [episodes[k] for k in ids if k in evaluations])
    learner.train(settings, COUNT // BATCH)
    return learner.state()


def replayed(bag: Path, out: Path, *options: str) -> dict[str, np.ndarray]:
    """Return the state stored by `replay`."""
    assert main([str(bag), "--out", str(out), "--steps", str(STEPS), *OPTIONS, *options]) == 0
    found = CriticCheckpoints(out).before(COUNT)
    assert found is not None
    return found[1]


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> bool:
    return one.keys() == other.keys() and all(
        one[name].tobytes() == other[name].tobytes() for name in one
    )


def test_critics_equal_those_of_a_learner_with_the_same_episodes(bag: Path, tmp_path: Path) -> None:
    settings = Settings.from_mapping({**SMALL, "n_crit": STEPS})
    state = replayed(bag, tmp_path / "one")
    assert same(state, learned(settings))
    assert same(state, replayed(bag, tmp_path / "two"))
    assert not same(state, replayed(bag, tmp_path / "three", "--set", "discount=0.9"))
    written = {p.name: p.read_bytes() for p in (tmp_path / "one").iterdir()}
    assert written == {p.name: p.read_bytes() for p in (tmp_path / "two").iterdir()}


def test_a_small_replay_buffer_holds_the_newest_transitions(bag: Path, tmp_path: Path) -> None:
    size = sum(EPISODES[k].length for k in (9, 10, 11)) - 5
    settings = Settings.from_mapping({**SMALL, "n_crit": STEPS, "replay_size": size})
    state = replayed(bag, tmp_path / "out", "--set", f"replay_size={size}")
    assert same(state, learned(settings))
    assert json.loads((tmp_path / "out" / "statistics.json").read_text())["evaluations"] == [9, 11]


def test_the_training_is_summarized(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    replayed(bag, tmp_path / "out")
    count = sum(e.length for e in EPISODES.values())
    assert f"trained 15 steps on {count} transitions of 12 episodes" in capsys.readouterr().out
    told = json.loads((tmp_path / "out" / "statistics.json").read_text())
    assert (told["run_id"], told["task"], told["transitions"]) == (RUN, "qd_hopper", count)
    assert (told["episodes"], told["missing"], told["steps"]) == (12, 0, 15)
    assert np.isfinite([told["critic_loss"], told["mean_q"]]).all()


def test_a_run_can_start_from_the_greedy_controller(bag: Path, tmp_path: Path) -> None:
    state = replayed(bag, tmp_path / "out")
    shape = controller_shape(SPEC, Settings.from_mapping(SMALL))
    controllers = read_controllers(tmp_path / "out" / "greedy.npz", SPEC, shape)
    assert np.array_equal(controllers, state["greedy"])


def test_settings_may_be_those_of_a_run(bag: Path, tmp_path: Path, hopper_run: Path) -> None:
    out = tmp_path / "out"
    assert main([str(bag), "--out", str(out), "--steps", "2", "--like", str(hopper_run)]) == 0
    told = json.loads((out / "statistics.json").read_text())["settings"]
    assert (told["seed"], told["controller_hidden"], told["n_crit"]) == (5, [16, 8], 2)


def test_an_actor_is_trained_on_what_episodes_were_meant_to_achieve(
    tmp_path: Path, dcrl_run: Path
) -> None:
    """Its critics are those of the run's own learner, whether the algorithm is named or taken from a run."""
    rng = np.random.default_rng(0)
    aimed = {k: replace(e, intended=rng.random(1)) if k % 2 else e for k, e in EPISODES.items()}
    bag = write(tmp_path / "bag", [transitions(k, e) for k, e in aimed.items()])
    named = ("--set", "algorithm=dcrl_map_elites")
    state = replayed(bag, tmp_path / "named", *named)
    settings = Settings.from_mapping({**SMALL, "algorithm": "dcrl_map_elites", "n_crit": STEPS})
    assert same(state, learned(settings, episodes=aimed))
    assert not same(state, learned(settings))
    assert not (tmp_path / "named" / "greedy.npz").exists()
    strict = ("--set", "similarity_length=0.01")
    assert not same(state, replayed(bag, tmp_path / "strict", *named, *strict))
    like = ["--like", str(dcrl_run), "--steps", "2"]
    assert main([str(bag), "--out", str(tmp_path / "like"), *like]) == 0
    told = json.loads((tmp_path / "like" / "statistics.json").read_text())["settings"]
    assert (told["algorithm"], told["transition_batch"]) == ("dcrl_map_elites", 32)


def test_repeated_and_missing_episodes_are_counted(tmp_path: Path) -> None:
    some = [k for k in range(COUNT) if k not in (2, 6, 7)]
    messages = [transitions(k) for k in some] + [transitions(some[0])]
    messages.append(transitions(4, EPISODES[5]))
    recorded = recorded_run(write(tmp_path / "bag", messages))
    assert [head.evaluation for head in recorded.heads] == some
    assert (recorded.missing, recorded.repeated, recorded.differing) == ((2, 6, 7), 2, (4,))
    (_, found), *_ = recorded.episodes([h for h in recorded.heads if h.evaluation == 4], SPEC)
    assert found[4].fitness == EPISODES[5].fitness


def test_an_incomplete_recording_trains_only_when_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    some = range(2, COUNT)
    bag = write(tmp_path / "bag", [transitions(k) for k in range(COUNT) if k not in (4, 5)])
    assert main([str(bag), "--out", str(tmp_path / "out"), *OPTIONS]) == 2
    told = capsys.readouterr().err
    assert "2 episodes are missing: evaluations 4-5. --incomplete trains on the rest" in told
    assert not (tmp_path / "out").exists()
    replayed(bag, tmp_path / "out", "--incomplete")
    assert json.loads((tmp_path / "out" / "statistics.json").read_text())["episodes"] == 10
    # Episodes from before the recording are not missing.
    late = write(tmp_path / "late", [transitions(k) for k in some])
    replayed(late, tmp_path / "other")


def other_robot(k: int) -> bytes:
    broken = EPISODES[k]
    return transitions(k, type(broken)(**{**vars(broken), "states": broken.states[:, :-1]}))


def not_finite(k: int) -> bytes:
    broken = EPISODES[k]
    return transitions(k, type(broken)(**{**vars(broken), "rewards": broken.rewards * np.nan}))


@pytest.mark.parametrize(
    ("messages", "options", "said"),
    [
        ([], [], "holds no experience"),
        (
            [transitions(0)],
            ["--task", "qd_walker"],
            "recorded with task 'qd_hopper', but the critics",
        ),
        (
            [transitions(0)],
            ["--run-id", "b"],
            "no experience of run b, only of run-of-the",
        ),
        ([transitions(0), transitions(1, run_id="b")], [], "several runs: run-of-the-tests (1 ep"),
        ([transitions(0), transitions(1, task="a")], [], "contradict each other"),
        ([transitions(0, generation=1), transitions(1)], [], "contradict each other"),
        ([transitions(0, task="a b")], [], "a b"),
        ([transitions(0)[:150]], [], "cannot be used"),
        ([other_robot(0)], [], "dimensions (14, 3, 1), task 'qd_hopper' has (15, 3, 1)"),
        ([not_finite(0)], [], "holds NaN or infinity"),
        ([transitions(0)], ["--steps", "0"], "n_crit"),
        ([transitions(0)], ["--set", "sead=3"], "did you mean 'seed'"),
        ([transitions(0)], ["--set", "seed"], "--set NAME=VALUE"),
        ([transitions(0)], ["--set", "greedy_init=best"], "add --set greedy_init=random"),
        ([transitions(0)], ["--set", "algorithm=map_elites_es"], "map_elites_es learns no critics"),
        ([transitions(0)], ["--set", "algorithm=map_elites"], "map_elites learns no critics"),
        ([transitions(0)], ["--set", "n_crit=7"], "the number of steps; give it by --steps"),
        ([transitions(0)], ["--set", "discount=1", "--set", "discount=0.9"], "discount is given"),
        (
            [transitions(0)],
            ["--task", "a", "--set", "task=b"],
            "--task and --set task are both given",
        ),
        ([transitions(0)], ["--set", "cells=9"], "--set cells has no effect on the training"),
        ([transitions(0)], ["--set", "schedule=ahead"], "--set schedule has no effect"),
    ],
)
def test_unusable_recordings_and_options_are_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], messages, options, said: str
) -> None:
    bag = write(tmp_path / "bag", messages, committed=1)
    assert main([str(bag), "--out", str(tmp_path / "out"), *OPTIONS, *options]) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ")
    assert said in told
    assert told.count("\n") == 1


def test_a_folder_that_is_not_empty_is_refused(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine").touch()
    assert main([str(bag), "--out", str(tmp_path), *OPTIONS]) == 2
    assert "not an empty folder" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


TRAINING = ("--steps 3", "--task a", "--like a", "--set a=3", "--run-id a", "--incomplete")
PUBLISHING = ("--rate 0", "--wait 1", "--ros-args -r a:=b")


@pytest.mark.parametrize(
    ("use", "given", "other"),
    [
        *[("--out out", words, "--publish") for words in PUBLISHING],
        *[("--into run", words, "--publish") for words in PUBLISHING],
        *[("--into run", words, "--out") for words in TRAINING],
        *[("--publish", words, "--out") for words in TRAINING],
    ],
)
def test_options_of_another_use_are_refused(
    use: str, given: str, other: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bag", *use.split(), *given.split()]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"error: '{given.split()[0]}")
    assert f"has a meaning only with {other}, not with {use.split()[0]}; leave it out." in told
    assert told.count("\n") == 1


def test_publishing_takes_no_parameters(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(bag), "--publish", "--ros-args", "-p", "rate:=100"]) == 2
    assert "'-p rate:=100' has no effect: replay has no parameters" in capsys.readouterr().err


def test_a_thinned_repertoire_needs_no_experience(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(bag), "--into", "zoo/qd_hopper"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: 'zoo/qd_hopper' is a thinned repertoire, which cannot be conti")
    assert told.count("\n") == 1
