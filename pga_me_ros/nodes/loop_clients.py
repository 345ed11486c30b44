"""Clients of the services that the generation loop calls."""

from __future__ import annotations

from pga_me_msgs.srv import AddToArchive, Propose, SampleParents, StoreExperience, Train
from rclpy.node import Node

from pga_me_ros.ros import names


class LoopClients:
    """One client per service.

    Args:
        node: The orchestrator's node.
    """

    def __init__(self, node: Node) -> None:
        self.add_to_archive = node.create_client(AddToArchive, names.ADD_TO_ARCHIVE)
        self.sample_parents = node.create_client(SampleParents, names.SAMPLE_PARENTS)
        self.propose = node.create_client(Propose, names.PROPOSE)
        self.train = node.create_client(Train, names.TRAIN)
        self.store_experience = node.create_client(StoreExperience, names.STORE_EXPERIENCE)

    def ready(self) -> bool:
        """Whether all services have been discovered."""
        return all(client.service_is_ready() for client in vars(self).values())
