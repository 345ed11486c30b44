"""A recording of a run: nothing is lost, and the recording is usable."""

from __future__ import annotations

import shutil
import signal
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from domain_coordinator import domain_id
from graph import Graph, Probe, Started, wait_until
from pga_me_msgs.msg import Metrics, Transitions
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pga_me_ros.core.storage.checkpoint import load_checkpoint
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.stored_run import REPERTOIRE
from pga_me_ros.recording.bag import read_bag
from pga_me_ros.recording.definitions import definition, type_name
from pga_me_ros.replay.__main__ import main
from pga_me_ros.ros import names, qos

EPISODES, GENERATIONS = 20, 2

TRIES = 3
"""Maximum attempts at a recording, as many as a test of processes gets."""


@dataclass(frozen=True)
class Recorded:
    """A finished run, its recording, and the recorder's output."""

    run: Path
    bag: Path
    said: str


def start_recorder(graph: Graph, bag: Path) -> Started:
    recorder = graph.start("record", {"bag": bag})
    recorder.wait_for_output("Ctrl-C ends it")
    return recorder


def record_run(folder: Path) -> tuple[Recorded, str]:
    """Record one tiny run and stop the recorder with Ctrl-C when the run is over; also return the run's output."""
    with domain_id() as domain:
        graph = Graph(domain, folder)
        try:
            recorder = start_recorder(graph, folder / "bag")
            run = graph.run(folder / "run", evaluations=EPISODES)
            assert run.wait() == 0, run.output
            recorder.signal(signal.SIGINT)
            assert recorder.wait() == 0, recorder.output
            return Recorded(folder / "run", folder / "bag", recorder.output), run.output
        finally:
            graph.kill()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Return the recording of a run in which every evaluation took place once.

    On a machine that stalls, a run repeats evaluations whose experience is late, and the recording has them twice. A
    rerun of a failed test would get the same recording, so another run is recorded here.
    """
    for _ in range(TRIES):
        recording, said = record_run(tmp_path_factory.mktemp("recorded"))
        if " 0 re-evaluations" in said:
            break
    return recording


def transitions(bag: Path) -> list[bytes]:
    return [m.data for m in read_bag(bag, [type_name(Transitions)])]


def test_the_recorder_reports_what_it_has_recorded(recorded: Recorded) -> None:
    first, summary, episodes = recorded.said.splitlines()
    assert first == f"recording into {recorded.bag}; Ctrl-C ends it"
    assert summary.startswith("recorded ")
    assert summary.endswith(f" s, into {recorded.bag}")
    assert episodes.endswith(f": {EPISODES} episodes, evaluations 0 to {EPISODES - 1}")


def test_experience_is_byte_for_byte_what_the_run_stored(recorded: Recorded) -> None:
    # Read by a program that knows the project's types only from the file.
    kind = type_name(Transitions)
    with AnyReader([recorded.bag]) as reader:
        (connection,) = [c for c in reader.connections if c.msgtype == kind]
        found = {
            episode.evaluation: episode
            for _, _, data in reader.messages([connection])
            for episode in [reader.deserialize(data, kind)]
        }
    assert sorted(found) == list(range(EPISODES))
    for generation in range(GENERATIONS):
        stored, _ = load_checkpoint(
            recorded.run / "experience" / f"experience-{generation:08d}.ckpt"
        )
        batch = [found[k] for k in sorted(found) if found[k].generation == generation]
        for name in ("states", "actions", "rewards"):
            theirs = np.concatenate([getattr(episode, name) for episode in batch])
            assert theirs.tobytes() == stored[name].tobytes()
        assert [e.fitness for e in batch] == stored["fitness"].tolist()
        assert [e.steps for e in batch] == stored["lengths"].tolist()
        assert [e.terminated for e in batch] == stored["terminated"].tolist()
        assert np.array_equal(np.stack([e.descriptor for e in batch]), stored["descriptors"])


def test_metrics_of_every_generation_are_recorded(recorded: Recorded) -> None:
    kind = type_name(Metrics)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition(kind).text, kind))
    heard = [store.deserialize_cdr(m.data, kind) for m in read_bag(recorded.bag, [kind])]
    with Repertoire.open(recorded.run / REPERTOIRE, read_only=True) as repertoire:
        stored = {g.metrics.generation: g.metrics for g in repertoire.generations()}
    assert {m.generation for m in heard} - {-1} == set(stored)
    for m in heard:
        if m.generation >= 0:
            assert (m.coverage, m.qd_score) == (
                stored[m.generation].coverage,
                stored[m.generation].qd_score,
            )


@pytest.mark.parametrize("named", ["", REPERTOIRE])
def test_lost_experience_is_restored_byte_for_byte(
    recorded: Recorded, tmp_path: Path, capsys: pytest.CaptureFixture[str], named: str
) -> None:
    run = shutil.copytree(recorded.run, tmp_path / "run")
    files = sorted((run / "experience").iterdir())
    before = [file.read_bytes() for file in files]
    assert len(files) == GENERATIONS
    for file in files:
        file.unlink()
    assert main([str(recorded.bag), "--into", str(run / named)]) == 0
    assert "restored the experience of 2 generations" in capsys.readouterr().out
    assert [file.read_bytes() for file in files] == before
    assert main([str(recorded.bag), "--into", str(run / named)]) == 0
    assert "has all the experience that it needs" in capsys.readouterr().out


def test_messages_published_again_equal_those_recorded(
    recorded: Recorded,
    graph: Graph,
    probe: Probe,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    raw: list[bytes] = []
    probe.node.create_subscription(
        Transitions, names.TRANSITIONS, raw.append, qos.EXPERIENCE_READER, raw=True
    )
    metrics = probe.listen(Metrics, names.METRICS, qos.LATCHED)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain))
    assert main([str(recorded.bag), "--publish", "--rate", "0", "--wait", "60"]) == 0
    wait_until(lambda: len(raw) == EPISODES, "all episodes")
    assert raw == transitions(recorded.bag)
    wait_until(lambda: bool(metrics) and metrics[-1].generation == GENERATIONS - 1, "metrics")
    assert capsys.readouterr().out.startswith("published ")


def test_an_existing_folder_is_refused_in_a_line(graph: Graph, tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    recorder = graph.start("record", {"bag": tmp_path / "bag"})
    assert recorder.wait() == 2
    assert recorder.output.count("\n") == 1
    assert "exists already; give the recording a folder that does not" in recorder.output


def test_missing_episodes_are_named_at_the_end(graph: Graph, probe: Probe, tmp_path: Path) -> None:
    recorder = start_recorder(graph, tmp_path / "bag")
    topic = probe.node.create_publisher(Transitions, names.TRANSITIONS, qos.EXPERIENCE_WRITER)
    wait_until(lambda: topic.get_subscription_count() == 1, "the recorder")
    for evaluation in (3, 4, 8, *[6] * 150):
        topic.publish(Transitions(run_id="run", task="qd_walker", evaluation=evaluation))
    # Sent right before the signal: messages already sent are still recorded.
    recorder.signal(signal.SIGTERM)
    assert recorder.wait() == 0, recorder.output
    assert "run run: 4 episodes, evaluations 3 to 8, 149 more came twice" in recorder.output
    assert "warning: 2 episodes between them are missing: evaluations 5, 7" in recorder.output
    assert len(transitions(tmp_path / "bag")) == 153
