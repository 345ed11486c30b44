"""Hosts on a network, made of Linux namespaces: each has its own network card, name and shared memory.

Cables that can be pulled connect them to a switch. The machine's own network is not touched: the switch has its own
namespace, too, and everything vanishes with the processes that hold the namespaces.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from graph import Graph, Started

SETUP = 10.0
"""Maximum seconds for a command that sets up the network."""


class NotPermittedError(Exception):
    """This user may not make networks of namespaces on this machine."""


class Network:
    """A switch and the hosts on it.

    Args:
        names: Names of the hosts; they get the addresses 10.77.0.1, 10.77.0.2, ...

    Raises:
        NotPermittedError: A required program is missing, or the kernel refuses.
    """

    def __init__(self, names: Sequence[str]) -> None:
        for program in ("ip", "unshare", "nsenter"):
            if shutil.which(program) is None:
                raise NotPermittedError(f"there is no program '{program}'")
        self._holders: dict[str, subprocess.Popen[bytes]] = {}
        self._cables = {name: f"cable{i}" for i, name in enumerate(names, start=1)}
        # Root of its own user namespace has root's permissions within its own namespaces.
        self._user = [] if os.geteuid() == 0 else ["--user"]
        try:
            self._hold("switch", ["unshare", *self._user, *self._map_root(), "--net"])
            self._do("switch", "ip link add switch type bridge")
            self._do("switch", "ip link set switch up")
            for i, name in enumerate(names, start=1):
                self._add_host(name, f"10.77.0.{i}/24")
        except NotPermittedError:
            self.close()
            raise

    def inside(self, name: str) -> list[str]:
        """Return the prefix for a command that should run on a host."""
        pid = str(self._holders[name].pid)
        user = [*self._user, "--preserve-credentials"] if self._user else []
        spaces = ["--net"] if name == "switch" else ["--net", "--uts", "--ipc", "--mount"]
        return ["nsenter", "--target", pid, *user, *spaces, "--"]

    def pull_cable(self, name: str) -> None:
        """Take a host off the network."""
        self._do("switch", f"ip link set {self._cables[name]} down")

    def plug_cable(self, name: str) -> None:
        """Bring a host back onto the network."""
        self._do("switch", f"ip link set {self._cables[name]} up")

    def close(self) -> None:
        """Remove everything."""
        for holder in reversed(self._holders.values()):
            holder.kill()
            holder.wait()

    def _map_root(self) -> list[str]:
        return ["--map-root-user"] if self._user else []

    def _add_host(self, name: str, address: str) -> None:
        spaces = ["unshare", "--net", "--uts", "--ipc", "--mount"]
        self._hold(name, [*self.inside("switch"), *spaces])
        cable, pid = self._cables[name], self._holders[name].pid
        self._do("switch", f"ip link add {cable} type veth peer name eth0 netns {pid}")
        self._do("switch", f"ip link set {cable} master switch up")
        self._do(name, f"{sys.executable} -c 'import socket; socket.sethostname(\"{name}\")'")
        self._do(name, "mount -t tmpfs shared_memory /dev/shm")
        self._do(name, "ip link set lo up && ip link set eth0 up")
        self._do(name, f"ip address add {address} dev eth0")

    def _hold(self, name: str, command: list[str]) -> None:
        """Make namespaces that live as long as an idle process."""
        holder = subprocess.Popen(
            [*command, "sh", "-c", "echo made; exec sleep infinity"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self._holders[name] = holder
        assert holder.stdout is not None
        assert holder.stderr is not None
        if holder.stdout.readline() != b"made\n":
            reason = holder.stderr.read().decode(errors="replace").strip()
            raise NotPermittedError(f"no namespaces for '{name}': {reason}")

    def _do(self, name: str, command: str) -> None:
        done = subprocess.run(
            [*self.inside(name), "sh", "-c", command],
            capture_output=True,
            text=True,
            timeout=SETUP,
        )
        if done.returncode:
            raise NotPermittedError(f"'{command}' failed: {done.stderr.strip()}")


class Host(Graph):
    """Nodes on one host of a network.

    Args:
        network: The network.
        name: Name of the host.
        folder: Folder for the output of its nodes.
    """

    def __init__(self, network: Network, name: str, folder: Path) -> None:
        super().__init__(0, folder)
        folder.mkdir()
        self._network = network
        self._name = name

    @property
    def environment(self) -> dict[str, str]:
        """Environment of every node, as in docs/two_machines.md."""
        return {**super().environment, "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}

    def launch(self, command: list[str]) -> Started:
        """Start any command on this host."""
        # Entering another mount namespace changes the working directory to its root.
        go_there = ["sh", "-c", 'cd "$0" && exec "$@"', str(self.folder)]
        return super().launch([*self._network.inside(self._name), *go_there, *command])
