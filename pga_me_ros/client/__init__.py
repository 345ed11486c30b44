"""The client library for robot nodes: ask a repertoire for behaviors and run them. Needs only rclpy and NumPy."""

from __future__ import annotations

from pga_me_ros.client.actor import Actor
from pga_me_ros.client.adapter import AdaptationResult, Adapter
from pga_me_ros.client.answers import ActorNotFoundError, BehaviorNotFoundError
from pga_me_ros.client.behaviors import Behavior, FoundBehavior, ListedBehavior, RepertoireInfo
from pga_me_ros.client.controller import Controller
from pga_me_ros.client.generations import ListedGeneration
from pga_me_ros.client.patient_caller import BlockedExecutorError, RepertoireTimeoutError
from pga_me_ros.client.repertoire_client import RepertoireClient

__all__ = [
    "Actor",
    "ActorNotFoundError",
    "AdaptationResult",
    "Adapter",
    "Behavior",
    "BehaviorNotFoundError",
    "BlockedExecutorError",
    "Controller",
    "FoundBehavior",
    "ListedBehavior",
    "ListedGeneration",
    "RepertoireClient",
    "RepertoireInfo",
    "RepertoireTimeoutError",
]
