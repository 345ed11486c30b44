"""A foreign node that sends anything to everything in its ROS domain, and records wrong answers."""

from __future__ import annotations

import importlib
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from fuzz_cases import Case, any_cases, parameter_cases, run_cases, status_cases
from fuzz_targets import World, run_targets
from graph import Probe, wait_until
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from pga_me_msgs.msg import Metrics, NodeStatus, Progress
from rcl_interfaces.srv import ListParameters
from rclpy.client import Client
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from pga_me_ros.core.settings import Settings
from pga_me_ros.ros import names, qos
from pga_me_ros.tasks.registry import task_spec

AT_A_TIME = 2
"""Maximum pending requests to one service: a server's queue holds ten, and the run needs some of them."""

STALL = 200.0
"""Seconds after which an unanswered request means that its node stalls. If two messages of tens of megabytes reach a
process at once, Fast DDS drops pieces and repairs them one heartbeat at a time, every three seconds: one such request
took 81 s on a busy machine, while the node answered all others."""

USERS = ("/pause", "/resume", "/stop")
"""Services of the orchestrator that anybody may call; their requests cannot be wrong."""

MIDDLEWARE = ("/rosout", "/parameter_events", "/clock")
SLOW = ("/evaluator",)
"""Targets that answer only between two episodes, and so get fewer requests."""


class Fuzzer:
    """Sends cases to a running run.

    Args:
        probe: Node to send with, in the domain of the run.
        run_settings: Settings of the run.

    Attributes:
        world: What it has found out about the run.
        sent: Number of cases by target.
        refusals: Number of refusals by target.
        wrong: Descriptions of everything that went wrong.
        slowest: Longest time of an answer by service [s].
        heard: Number of messages by topic, those of the fuzzer included; somebody who looks must do no harm, either.
    """

    def __init__(self, probe: Probe, run_settings: Settings) -> None:
        self._probe = probe
        self._metrics = probe.listen(Metrics, names.METRICS, qos.LATCHED)
        self._progress = probe.listen(Progress, names.PROGRESS, qos.LATCHED)
        self._clients: dict[str, Client] = {}
        self._publishers: dict[str, Publisher] = {}
        self._types: dict[str, Any] = {}
        self._under_way: dict[str, list[tuple[float, Case, Any]]] = defaultdict(list)
        self.heard: Counter[str] = Counter()
        self.world = self._explore(run_settings)
        self.sent: Counter[str] = Counter()
        self.refusals: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.slowest: dict[str, float] = {}

    @property
    def generation(self) -> int:
        """Newest generation known to be committed."""
        ours = (m.generation for m in reversed(self._metrics) if m.run_id == self.world.run_id)
        return next(ours, -1)

    def fuzz(self, count: int, watch: Callable[[int], None] = lambda _: None) -> None:
        """Send a number of cases, always the same for the same run, and wait for all answers.

        Args:
            count: Number of cases.
            watch: Called after each with the number sent so far.
        """
        strategy = self._cases()

        @settings(
            max_examples=count,
            derandomize=True,
            database=None,
            deadline=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(strategy)
        def send(case: Case) -> None:
            if not self.wrong:  # nothing new can be learned after a node has died
                self.send(case)
                watch(sum(self.sent.values()))

        send()
        for target in list(self._under_way):
            if not self.wrong:
                self._wait(target, 0)

    def send(self, case: Case) -> None:
        """Send one case; a wrong answer is recorded, not raised."""
        kind = self._types[case.target]
        is_service = case.target in self._clients
        message = kind.Request() if is_service else kind()
        for name, value in case.fields.items():
            if name in case.relative:
                value += self.generation
            setattr(message, name, value)
        self.sent[case.target] += 1
        if is_service:
            self._wait(case.target, AT_A_TIME - 1)
            sent = time.monotonic()
            future = self._clients[case.target].call_async(message)
            future.add_done_callback(
                lambda _: self._note_time(case.target, time.monotonic() - sent)
            )
            self._under_way[case.target].append((sent, case, future))
        else:
            self._publishers[case.target].publish(message)

    def _wait(self, target: str, most: int) -> None:
        """Wait until at most this many requests to a service are pending."""
        pause = threading.Event()
        while len(self._under_way[target]) > most:
            sent, case, future = self._under_way[target][0]
            while not future.done() and time.monotonic() < sent + STALL:
                pause.wait(0.0005)
            del self._under_way[target][0]
            if future.done():
                self._judge(case, future.result())
            else:
                self.wrong.append(f"{target} gave no answer within {STALL:.0f} s to {_short(case)}")

    def _note_time(self, target: str, took: float) -> None:
        self.slowest[target] = max(self.slowest.get(target, 0.0), took)

    def _judge(self, case: Case, answer: Any) -> None:
        for ok, reason, unchanged in _verdicts(answer):
            self.refusals[case.target] += not ok
            if not ok and not reason:
                self.wrong.append(f"{case.target} refused without a reason: {_short(case)}")
            if ok and case.refused and not unchanged:
                self.wrong.append(f"{case.target} accepted {_short(case)}")

    def _explore(self, run_settings: Settings) -> World:
        """Find out everything that subscribers can find out, and all services and topics."""
        node = self._probe.node
        status = self._probe.listen(NodeStatus, names.STATUS, qos.STATUS)

        def at_work() -> bool:
            return any(p.state == "running" for p in self._progress) and len(
                {s.kind for s in status}
            ) == len({"archive_manager", "critic_trainer", "variation", "evaluator"})

        wait_until(at_work, "a working run")
        self._take_services(dict(node.get_service_names_and_types()))
        topics = dict(node.get_topic_names_and_types())
        self._listen_to_all(topics)
        self._take_topics(topics)
        wait_until(
            lambda: all(c.service_is_ready() for c in self._clients.values()), "all services"
        )
        evaluators = [s for s in status if s.kind == "evaluator"]
        return World(
            run_id=self._progress[-1].run_id,
            spec=task_spec(run_settings.task),
            settings=run_settings,
            versions=evaluators[0].versions,
            nodes=tuple(sorted({s.node for s in status})),
            host=evaluators[0].host,
            pids=tuple(sorted({s.pid for s in status})),
        )

    def _take_services(self, found: dict[str, list[str]]) -> None:
        for name, (kind, *_) in sorted(found.items()):
            if not name.startswith("/probe/") and not name.endswith(USERS):
                self._types[name] = _load(kind)
                self._clients[name] = self._probe.node.create_client(
                    self._types[name], name, qos_profile=qos.CLIENT
                )

    def _listen_to_all(self, topics: dict[str, list[str]]) -> None:
        """Subscribe to every topic that the run publishes, pictures included, and wait for a message on each."""
        published = []
        for name, (kind, *_) in sorted(topics.items()):
            offers = self._probe.node.get_publishers_info_by_topic(name)
            if not offers or name in MIDDLEWARE:
                continue
            published.append(name)
            profile = QoSProfile(depth=10, durability=offers[0].qos_profile.durability)
            self._probe.node.create_subscription(
                _load(kind), name, partial(self._hear, name), profile, raw=True
            )
        wait_until(
            lambda: all(self.heard[name] for name in published), f"messages on all of {published}"
        )

    def _hear(self, topic: str, _: bytes) -> None:
        self.heard[topic] += 1

    def _take_topics(self, found: dict[str, list[str]]) -> None:
        profiles = {
            f"/{names.TRANSITIONS}": qos.EXPERIENCE_WRITER,
            f"/{names.STATUS}": qos.STATUS,
        }
        for name, (kind, *_) in sorted(found.items()):
            if name not in MIDDLEWARE:
                self._types[name] = _load(kind)
                profile = profiles.get(name, qos.LATCHED)
                self._publishers[name] = self._probe.node.create_publisher(
                    self._types[name], name, profile
                )

    def _cases(self) -> st.SearchStrategy[Case]:
        """Return the strategy for all cases; the most important targets get the most cases."""
        fields = {name: _fields(kind) for name, kind in self._types.items()}
        evaluators = [n for n in self._clients if n.endswith("/evaluate")]
        strategies: list[tuple[int, st.SearchStrategy[Case]]] = []
        mine = run_targets(self.world, evaluators[0].removesuffix("/evaluate"))
        for target in mine:
            name = target.name if target.name.startswith("/") else f"/{target.name}"
            cases = run_cases(target, fields[name]).map(lambda c, n=name: _renamed(c, n))
            strategies.append((4 if name in evaluators else 40, cases))
        status = f"/{names.STATUS}"
        cases = status_cases(self.world, fields[status]).map(lambda c: _renamed(c, status))
        strategies.append((40, cases))
        covered = {evaluators[0], status, *(f"/{t.name}" for t in mine)}
        for name in sorted(set(self._types) - covered):
            weight = 1 if name.startswith(SLOW) else 5 if "parameter" in name else 25
            strategies.append((weight, self._generic(name, fields[name])))
        picks = [i for i, (weight, _) in enumerate(strategies) for _ in range(weight)]
        return st.sampled_from(picks).flatmap(lambda i: strategies[i][1])

    def _generic(self, name: str, types: dict[str, str]) -> st.SearchStrategy[Case]:
        node, _, service = name.rpartition("/")
        if service.startswith("set_parameters"):
            listed = self._probe.call(ListParameters, f"{node}/list_parameters")
            return parameter_cases(name, listed.result.names)
        return any_cases(name, types)


def _renamed(case: Case, name: str) -> Case:
    return Case(name, case.fields, case.refused, case.relative)


def _load(kind: str) -> Any:
    package, folder, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.{folder}"), name)


def _fields(kind: Any) -> dict[str, str]:
    return dict(getattr(kind, "Request", kind).get_fields_and_field_types())


def _verdicts(answer: Any) -> Sequence[tuple[bool, str, bool]]:
    """Return (accepted, reason, whether nothing was changed) for each part of an answer."""
    if hasattr(answer, "results"):  # of set_parameters
        return [(r.successful, r.reason, False) for r in answer.results]
    if hasattr(answer, "result") and hasattr(answer.result, "successful"):
        return [(answer.result.successful, answer.result.reason, False)]
    unchanged = hasattr(answer, "status") and not len(
        answer.status
    )  # a generation that was already in the archive
    for ok in ("accepted", "found", "ok", "success"):
        if hasattr(answer, ok):
            return [(getattr(answer, ok), answer.message, unchanged)]
    return []


def _short(case: Case) -> str:
    return str({k: f"{v!r}"[:80] for k, v in case.fields.items()})
