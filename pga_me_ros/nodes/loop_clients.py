"""Clients of the services that the generation loop calls."""

from __future__ import annotations

from typing import Any

from pga_me_msgs.srv import AddToArchive, Propose, SampleParents, StoreExperience, Train
from rclpy.client import Client
from rclpy.node import Node

from pga_me_ros.ros import names, qos


class LoopClients:
    """One client per service.

    Args:
        node: The orchestrator's node.
    """

    def __init__(self, node: Node) -> None:
        def client(srv_type: Any, name: str) -> Client:
            return node.create_client(srv_type, name, qos_profile=qos.CLIENT)

        self.add_to_archive = client(AddToArchive, names.ADD_TO_ARCHIVE)
        self.sample_parents = client(SampleParents, names.SAMPLE_PARENTS)
        self.propose = client(Propose, names.PROPOSE)
        self.train = client(Train, names.TRAIN)
        self.store_experience = client(StoreExperience, names.STORE_EXPERIENCE)

    def ready(self) -> bool:
        """Whether all services have been discovered."""
        return all(client.service_is_ready() for client in vars(self).values())
