"""Runs the server of the live page until it is stopped."""

from __future__ import annotations

import errno
import ipaddress
import secrets
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress

import uvicorn

from pga_me_ros.errors import RequestError
from pga_me_ros.explorer.server import Access, Server
from pga_me_ros.explorer.source import Source

LOOPBACK = ("127.0.0.1", "localhost", "::1")


def is_loopback(host: str) -> bool:
    """Whether an address is reached from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def access_for(host: str, *, control: bool, token: bool) -> Access:
    """Return who may do what on a page.

    Args:
        host: Address that the server listens on.
        control: Whether the user asked for control; on this machine alone the page has it anyway.
        token: Whether the user asked for a token; a page that others can reach has one anyway.
    """
    local = is_loopback(host)
    return Access(
        token=secrets.token_urlsafe(18) if token or not local else "",
        control=control or local,
        hosts=tuple(dict.fromkeys((*LOOPBACK, host))) if local else (),
    )


def serve(sources: Sequence[Source], host: str, port: int, access: Access, title: str) -> None:
    """Serve the page until Ctrl-C, and say where it is.

    Args:
        sources: What is shown.
        host: Address to listen on.
        port: Port; 0 for any that is free.
        access: Who may do what.
        title: Title of the page.

    Raises:
        RequestError: The port is taken, or the address is not one of this machine.
    """
    listening = _listen(host, port)
    place = f"[{host}]" if ":" in host else host
    address = f"http://{place}:{listening.getsockname()[1]}/"
    if access.token:
        address += f"?token={access.token}"
    ending: list[uvicorn.Server] = []
    server = Server(sources, access, title, lambda: any(s.should_exit for s in ending))
    config = uvicorn.Config(
        server.app, log_level="warning", access_log=False, timeout_graceful_shutdown=2
    )
    ending.append(uvicorn.Server(config))
    reach = (
        "this machine only" if is_loopback(host) else "everybody who can reach it, with this token"
    )
    steer = "and can control the run" if access.control else "and is read-only"
    print(f"The page is for {reach} {steer}; Ctrl-C ends it.", file=sys.stderr)
    print(address, flush=True)
    try:
        with suppress(KeyboardInterrupt):  # which uvicorn passes on when it has ended
            ending[0].run(sockets=[listening])
    finally:
        listening.close()


def _listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens.

    Raises:
        RequestError: It cannot be.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen()  # before its address is printed: whoever reads that is answered, not refused
    except (OSError, OverflowError) as error:
        listening.close()
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            raise RequestError(
                f"Port {port} of {host} is taken, perhaps by another explorer; give another --port, or 0 for any."
            ) from None
        raise RequestError(
            f"Cannot listen on {host}:{port} ({error}); give another --host or --port."
        ) from None
    return listening
